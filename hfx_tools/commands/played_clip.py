# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays the baked rows of a clip on live devices; latencies are contained in the rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import columns_of
from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import read_data
from hfx_blender.formats.clip.container import Records, Sections

from ..formats import clip_rules
from ..formats.clip_reader import texts_at

if TYPE_CHECKING:
    from hfx_blender.devices.live.client import LiveClient

_EARLY = 1e-6  # rows; tolerance for rounded times
_LONGEST_STEP_S = 0.5  # a later time is a jump; what lies between is not played


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of one actuator: row numbers (n,), values (n, columns), distance from neutral (n,)."""

    rows: Records
    values: F64
    away: Records

    def strongest(self, first: int, last: int) -> F64:
        """Values (columns,) of the row farthest from neutral, of equal rows the latest."""
        # Values hold between stored rows: the row before ``first`` counts as well.
        begin, end = np.searchsorted(self.rows, [first, last], side="right").tolist()
        distances = self.away[begin - 1 : end]
        return np.asarray(self.values[end - 1 - int(np.argmax(distances[::-1]))])


class PlayedClip:
    """Value source for live devices, by the rules of ``docs/formats/clip.md``, "Playing".

    ``devices`` maps names at the client to configurations; ``body`` names the wearer (None: the
    first body with the device). ``start_s`` and ``end_s`` are the times of the first row and after
    the last row on the recorded scene's clock, ``sample_s`` is the duration of a row. Raises
    InputError for an invalid clip, or a device without values.
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
            record = device_record(sections, device, body, str(path))
            check_columns(sections, record, device, str(path))
            first, count = int(record["first_actuator"]), int(record["actuators"])
            self._actuators[name] = [_rows_of(sections, k) for k in range(first, first + count)]
        self._neutral = {name: device.neutral for name, device in devices.items()}
        self._shown: int | None = None  # last row sent

    def begin(self, client: LiveClient) -> None:
        """Do nothing: baked values need no rendering."""

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the strongest values since the previous call; neutral values after the end."""
        for name in self._actuators:
            client.send(name, self.values(name, time_s))
        self.hold(time_s)

    def hold(self, time_s: float) -> None:
        """Begin the next strongest values after this time."""
        self._shown = self._row(time_s)

    def values(self, name: str, time_s: float) -> F64:
        """Strongest values (columns,) of a device since :meth:`show`; neutral after the end."""
        now = self._row(time_s)
        # Rows since the last call: a slow caller must not skip a short strong row.
        first = now if self._shown is None else self._shown + 1
        if now - first >= _LONGEST_STEP_S * self._rate_hz:
            first = now
        is_over = time_s >= self.end_s + _LONGEST_STEP_S
        if is_over or (time_s >= self.end_s and first > now):
            return self._neutral[name]
        # A time before the last call (a jump back) shows its own row only.
        first = min(first, now)
        return np.concatenate([rows.strongest(first, now) for rows in self._actuators[name]])

    def _row(self, time_s: float) -> int:
        row = np.floor((time_s - self.start_s) * self._rate_hz + _EARLY)
        return int(np.clip(row, 0, self._last))


def device_record(sections: Sections, device: DeviceConfig, body: str | None, path: str) -> Any:
    """Record of a device on the named body, or on the first body that wears it. InputError without
    such a record."""
    ids, bodies = (texts_at(sections, sections["DEVC"][device_id]) for device_id in ("id", "body"))
    for k, (device_id, wearer) in enumerate(zip(ids, bodies, strict=True)):
        if device_id == device.id and body in (None, wearer):
            return sections["DEVC"][k]
    available = [
        f"'{device_id}' on '{wearer}'" for device_id, wearer in zip(ids, bodies, strict=True)
    ]
    missing = f"'{device.id}'" if body is None else f"'{device.id}' on '{body[:100]}'"
    names = ", ".join(available[:5]) or "none"
    raise InputError(f"{path}: it has no values for {missing}; it has those of: {names}.")


def check_columns(sections: Sections, record: Any, device: DeviceConfig, path: str) -> None:
    """Raise InputError for a device whose actuators or parameters differ from the clip."""
    first, count = int(record["first_actuator"]), int(record["actuators"])
    owners = sections["COLM"]["actuator"]
    # Columns of the device: those owned by its actuators.
    columns = sections["COLM"][(owners >= first) & (owners < first + count)]
    actuators = texts_at(sections, sections["ACTR"]["id"][columns["actuator"]])
    theirs = list(zip(actuators, texts_at(sections, columns["parameter"]), strict=True))
    ours = [(column.actuator, column.parameter) for column in columns_of(device)]
    custom = [c for a in device.actuators for c in a.type.controls if c.unit]
    if custom and len(theirs) < len(ours):
        raise InputError(
            f"{path}: game clips have no custom columns, such as '{custom[0].name}' of "
            f"'{device.id}'; play a track of this device."
        )
    # The first difference says more than the lists.
    for recorded, configured in zip(theirs, ours, strict=False):
        if recorded != configured:
            raise InputError(
                f"{path}: '{device.id}' has {' '.join(recorded)} where its configuration has "
                f"{' '.join(configured)}; export the clip anew."
            )
    if len(theirs) != len(ours):
        raise InputError(
            f"{path}: '{device.id}' has {len(theirs)} columns, its configuration {len(ours)}; "
            "export the clip anew."
        )


def _rows_of(sections: Sections, actuator: int) -> _Rows:
    """Rows of the actuator with this record number; the distance is of the first column's number
    in the file from the neutral one."""
    at = sections["ACTR"][actuator]
    rows, values = clip_rules.values_of(sections, actuator)
    first, columns = int(at["first_value"]), int(at["columns"])
    numbers = sections["VALU"][first : first + len(rows) * columns : columns].astype(np.int64)
    neutral = int(sections["COLM"]["neutral_number"][int(at["first_column"])])
    return _Rows(rows, values, np.abs(numbers - neutral))
