# SPDX-License-Identifier: GPL-3.0-or-later
"""Stimuli of a study: values of a device over time, written before the session.

A file of values is named by its content, so that no name shows a condition; ``stimuli.tsv`` lists
hash and conditions of each.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import columns_of
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.files.hashes import sha256_of
from hfx_blender.files.staging import place, staging
from hfx_blender.formats.rasters import csv_raster

from ..formats import csv_reader
from .design import FIRST, SECOND, Trial
from .folder import Study
from .plan import MAX_ROWS, Conditions, Plan, Value, as_text, combinations
from .plan_values import kind_of, relevant_factors
from .stimulus_rendering import rendered
from .tables import read_table, write_table

FOLDER: Final = "stimuli"
TABLE: Final = "stimuli.tsv"
_NAME_DIGITS: Final = 16


@dataclass(frozen=True, eq=False)
class Stimulus:
    """Values of one device over time; each row holds for ``step_s``."""

    name: str  # first digits of the hash, as in the file name
    sha256: str
    device: str  # name or file of the configuration
    values: F64  # (T, columns)
    step_s: float

    @property
    def duration_s(self) -> float:
        return len(self.values) * self.step_s


def intervals_of(plan: Plan, trial: Trial, level: Value | None = None) -> list[Conditions]:
    """Conditions of each stimulus of a trial, in the order of play. ``level``: of a staircase or an
    adjustment; None for the level in the trial."""
    common = {name: trial[name] for name in (*plan.factors, *plan.random)}
    if plan.design == "paired":
        return [
            common | {name: trial[f"{name}_{side}"] for name in plan.compare}
            for side in (FIRST, SECOND)
        ]
    if not plan.level_factor:
        return [common]
    if level is None:
        level = trial[plan.level_factor]
    at_level = common | {plan.level_factor: level}
    if plan.design == "adjustment":
        return [at_level]
    reference = common | {plan.level_factor: plan.reference}
    return [at_level, reference] if trial["target"] == FIRST else [reference, at_level]


def conditions_of(plan: Plan) -> list[Conditions]:
    """Conditions of all stimuli of a plan, without factors that no stimulus depends on."""
    levels = {plan.level_factor: plan.levels} if plan.level_factor else {}
    if plan.design in ("2afc", "staircase"):
        levels[plan.level_factor] = tuple(dict.fromkeys((plan.reference, *plan.levels)))
    factors = relevant_factors(plan)
    every = {**plan.factors, **plan.random, **plan.compare, **levels}
    used = {name: values for name, values in every.items() if name in factors}
    count = int(np.prod([len(values) for values in used.values()], dtype=np.float64))
    if count > MAX_ROWS:
        raise InputError(f"{plan.path}: it has {count} stimuli, allowed are {MAX_ROWS}.")
    return combinations(used)


def devices_of(plan: Plan, named: Sequence[str]) -> list[str]:
    """Devices of a session: the values of the factor "device", else the named one or the plan's.
    InputError without a device, and for several."""
    values = {**plan.factors, **plan.random, **plan.compare}.get("device")
    if values is not None:
        return [as_text(value) for value in values]
    names = list(dict.fromkeys(named)) or [plan.device]
    if len(names) != 1 or not names[0]:
        allowed = 'one device, by --device NAME or "device" of the plan'
        raise InputError(
            f"{plan.path}: {len(names) if names[0] else 0} devices, allowed is {allowed}."
        )
    return names


class StimulusLibrary:
    """Stimuli of a study for a session's devices, rendered now unless present.

    ``report``: called with the rendered share, 0..1. Raises InputError for a changed or missing
    file, for conditions without a stimulus, and for a device that cannot play them.
    """

    def __init__(
        self, study: Study, devices: Sequence[str], report: Any = lambda share: None
    ) -> None:
        self._plan, self._devices = study.plan, tuple(devices)
        # Tables hold ids: the path of a configuration may name a person.
        self._configs = {name: load_device(name, resources.user_devices()) for name in devices}
        self._ids = {name: config.id for name, config in self._configs.items()}
        self._names = relevant_factors(study.plan) - {"device"}
        self._folder = study.folder / FOLDER
        missing = [key for key in self._keys() if key not in self._table()]
        if missing and kind_of(study.plan) == "file" and study.plan.path.parent == study.folder:
            # Takes lie next to the original plan.
            raise InputError(
                f"{self._folder}: has no stimuli for '{missing[0][0]}'; make the study again with "
                f"--device {self._devices[0]}."
            )
        if missing:
            self._render(missing, report)
        self._stimuli = {key: self._read(row) for key, row in self._table().items()}

    def __getitem__(self, conditions: Conditions) -> Stimulus:
        return self._stimuli[self._key(conditions)]

    def __len__(self) -> int:
        return len(self._stimuli)

    @property
    def device_ids(self) -> list[str]:
        """Ids of the session's devices."""
        return list(self._ids.values())

    @property
    def hashes(self) -> dict[str, str]:
        """SHA-256 by name of the file."""
        return {f"{one.name}.csv": one.sha256 for one in self._stimuli.values()}

    def _device(self, conditions: Conditions) -> str:
        return as_text(conditions.get("device", self._devices[0]))

    def _key(self, conditions: Conditions) -> tuple[str, ...]:
        """Key in the table: id of the device, then the texts of relevant conditions by name."""
        device = self._ids[self._device(conditions)]
        return device, *(as_text(conditions[name]) for name in sorted(self._names))

    def _keys(self) -> dict[tuple[str, ...], Conditions]:
        return {self._key(one): one for one in conditions_of(self._plan)}

    def _table(self) -> dict[tuple[str, ...], dict[str, str]]:
        """Rows of the table of these devices by key; empty without a table."""
        path = self._folder / TABLE
        if not path.exists():
            return {}
        names = sorted(self._names)
        rows = read_table(path, ["stimulus", "sha256", "device", *names])
        return {
            (row["device"], *(row[name] for name in names)): row
            for row in rows
            if row["device"] in self._ids.values()
        }

    def _render(self, missing: Iterable[tuple[str, ...]], report: Any) -> None:
        """Write the missing stimuli and the new table, all or none."""
        conditions = self._keys()
        names = sorted(self._names)
        path = self._folder / TABLE
        table = read_table(path) if path.exists() else []
        missing = list(missing)
        with staging(self._folder, FOLDER) as staged:
            stage = staged / "new"
            stage.mkdir()
            for k, key in enumerate(missing):
                one = conditions[key]
                raster = rendered(self._plan, one, self._configs[self._device(one)])
                csv_raster.write(raster, stage / "next.csv")
                sha256 = sha256_of(stage / "next.csv")
                name = sha256[:_NAME_DIGITS]
                (stage / "next.csv").replace(stage / f"{name}.csv")
                row = {"stimulus": name, "sha256": sha256, "device": key[0]}
                table.append(row | dict(zip(names, key[1:], strict=True)))
                report((k + 1) / len(missing))
            write_table(stage / TABLE, ["stimulus", "sha256", "device", *names], table)
            # The table comes last: its rows are complete then.
            files = sorted(stage.iterdir(), key=lambda file: (file.name == TABLE, file.name))
            place(files, self._folder, stage)

    def _read(self, row: dict[str, str]) -> Stimulus:
        path = self._folder / f"{row['stimulus']}.csv"
        try:
            is_same = sha256_of(path) == row["sha256"]
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}).") from error
        if not is_same:
            raise InputError(
                f"{path}: was changed after it was rendered; restore or delete {TABLE}."
            )
        raster = csv_reader.read(path)
        name = next(name for name, device_id in self._ids.items() if device_id == row["device"])
        _refuse_columns(raster.columns, self._configs[name], path)
        return Stimulus(
            row["stimulus"],
            row["sha256"],
            name,
            np.asarray(raster.values),
            1.0 / float(raster.rate_hz),
        )


def _refuse_columns(columns: Sequence[Any], device: DeviceConfig, path: Path) -> None:
    """Raise InputError for columns of another device, or of an earlier configuration."""
    if tuple(columns) != columns_of(device):
        raise InputError(f"{path}: its columns are not those of '{device.id}' any more.")
