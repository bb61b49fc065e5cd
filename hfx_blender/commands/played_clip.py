# SPDX-License-Identifier: GPL-3.0-or-later
"""A clip's baked part as values for live devices; latencies are in its rows already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.arrays import F64
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.raster import columns_of
from ..errors import InputError
from ..files.strict_json import read_data
from ..formats.clip import baked, clip_rules
from ..formats.clip.container import Records, Sections, texts_at

if TYPE_CHECKING:
    from ..devices.live.client import LiveClient

_EARLY = 1e-6  # of a row: times are sums, and rounded


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows (n,) of an actuator, their values (n, columns), and how far each is from neutral."""

    rows: Records
    values: F64
    away: Records

    def strongest(self, first: int, last: int) -> F64:
        """Values of the strongest of a span of rows, (columns,); of equal ones the latest."""
        begin, end = np.searchsorted(self.rows, [first, last], side="right").tolist()
        of = self.away[begin - 1 : end]
        return np.asarray(self.values[end - 1 - int(np.argmax(of[::-1]))])


class PlayedClip:
    """Clip that live devices play, by the rules of ``docs/formats/clip.md``, "Playing".

    Parameters
    ----------
    path : Path
        A ``.hfxclip``.
    devices : mapping
        Devices by the names under which the client knows them.
    body : str, optional
        Name of who wears them; by default the first body that does.

    Attributes
    ----------
    start_s, end_s : float
        Times of the first row, and after the last one, on the clock of the recorded scene.
    sample_s : float
        Time from one row to the next.

    Raises
    ------
    InputError
        It is no valid clip, or has no values for one of the devices.
    """

    is_rendered = False

    def __init__(
        self, path: Path, devices: Mapping[str, DeviceConfig], body: str | None = None
    ) -> None:
        sections = clip_rules.read(read_data(path), str(path))
        at = sections["TIME"][0]
        self._rate_hz, self._last = float(at["rate_hz"]), int(at["rows"]) - 1
        self.sample_s = 1.0 / self._rate_hz
        self.start_s = float(at["start_s"])
        self.end_s = self.start_s + float(at["rows"]) / self._rate_hz
        self._actuators: dict[str, list[_Rows]] = {}
        for name, device in devices.items():
            found = _device_of(sections, device, body, str(path))
            _check_columns(sections, found, device, str(path))
            first, count = int(found["first_actuator"]), int(found["actuators"])
            each = [_rows_of(sections, k) for k in range(first, first + count)]
            self._actuators[name] = each
        self._neutral = {name: device.neutral for name, device in devices.items()}
        self._shown: int | None = None  # last row

    def begin(self, client: LiveClient) -> None:
        """Do nothing: its values need no rendering."""

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the strongest values since the last time; neutral ones after the end."""
        for name in self._actuators:
            client.send(name, self.values(name, time_s))
        self._shown = self._row(time_s)

    def values(self, name: str, time_s: float) -> F64:
        """Values of a device at a time, the strongest since :meth:`show`, (columns,)."""
        now = self._row(time_s)
        first = now if self._shown is None else self._shown + 1
        if time_s >= self.end_s and first > now:
            return self._neutral[name]
        first = min(first, now)
        return np.concatenate([each.strongest(first, now) for each in self._actuators[name]])

    def _row(self, time_s: float) -> int:
        row = np.floor((time_s - self.start_s) * self._rate_hz + _EARLY)
        return int(np.clip(row, 0, self._last))


def _device_of(sections: Sections, device: DeviceConfig, body: str | None, path: str) -> Any:
    """Record of a device, of the first body that wears it or of the one that is named."""
    ids, bodies = (texts_at(sections, sections["DEVC"][each]) for each in ("id", "body"))
    for k, (each, wearer) in enumerate(zip(ids, bodies, strict=True)):
        if each == device.id and body in (None, wearer):
            return sections["DEVC"][k]
    there = [f"'{each}' on '{wearer}'" for each, wearer in zip(ids, bodies, strict=True)]
    wanted = f"'{device.id}'" if body is None else f"'{device.id}' on '{body[:100]}'"
    raise InputError(
        f"{path}: it has no values for {wanted}; it has those of: {', '.join(there[:5]) or 'none'}."
    )


def _check_columns(sections: Sections, found: Any, device: DeviceConfig, path: str) -> None:
    """Refuse values of a device that has changed since.

    Raises
    ------
    InputError
        Its actuators or their parameters are others.
    """
    first, count = int(found["first_actuator"]), int(found["actuators"])
    owners = sections["COLM"]["actuator"]
    columns = sections["COLM"][(owners >= first) & (owners < first + count)]
    actuators = texts_at(sections, sections["ACTR"]["id"][columns["actuator"]])
    theirs = list(zip(actuators, texts_at(sections, columns["parameter"]), strict=True))
    ours = [(each.actuator, each.parameter) for each in columns_of(device)]
    for one, other in zip(theirs, ours, strict=False):
        if one != other:
            raise InputError(
                f"{path}: '{device.id}' has {' '.join(one)} where its configuration has "
                f"{' '.join(other)}; export the clip anew."
            )
    if len(theirs) != len(ours):
        raise InputError(
            f"{path}: '{device.id}' has {len(theirs)} columns, its configuration {len(ours)}; "
            "export the clip anew."
        )


def _rows_of(sections: Sections, actuator: int) -> _Rows:
    at = sections["ACTR"][actuator]
    rows, values = baked.values_of(sections, actuator)
    first, columns = int(at["first_value"]), int(at["columns"])
    numbers = sections["VALU"][first : first + len(rows) * columns : columns].astype(np.int64)
    neutral = int(sections["COLM"]["neutral_number"][int(at["first_column"])])
    return _Rows(rows, values, np.abs(numbers - neutral))
