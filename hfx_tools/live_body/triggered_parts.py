# SPDX-License-Identifier: GPL-3.0-or-later
"""Named parts of a game clip, started by other programs over the values of a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.files.strict_json import read_data

from ..commands.played_clip import PlayedClip
from ..formats import clip_rules
from ..formats.clip_reader import texts_at

F64 = npt.NDArray[np.float64]

_MOST_REPORTED: Final = 20  # unknown names: more are a flood


def is_strength(device: DeviceConfig) -> npt.NDArray[np.bool_]:
    """Columns (columns,) of a device that are strengths: the first control of each actuator."""
    return np.array([k == 0 for a in device.actuators for k in range(len(a.type.controls))])


def strongest(rows: Sequence[F64], device: DeviceConfig) -> F64:
    """Values (columns,) with each actuator from the row (columns,) whose strength is farthest from
    neutral, of equal rows the first."""
    strengths = is_strength(device)
    values = np.stack(rows)
    distances = np.abs(values - device.neutral)[:, strengths]
    actuators = np.cumsum(strengths) - 1
    return np.asarray(values[distances.argmax(axis=0)[actuators], np.arange(values.shape[1])])


class TriggeredParts:
    """Named parts of a clip that play once from their trigger.

    ``path``: a game clip; ``wearers``: device and body (None: the first) by the name of a device.
    Raises InputError as :class:`.PlayedClip`.
    """

    def __init__(self, path: Path, wearers: Mapping[str, tuple[DeviceConfig, str | None]]) -> None:
        sections = clip_rules.read(read_data(path), str(path))
        records = sections["CLIP"]
        names = texts_at(sections, records["name"])
        spans = zip(records["start_s"].tolist(), records["end_s"].tolist(), strict=True)
        self._spans = dict(zip(names, spans, strict=True))
        self._clips = {
            name: PlayedClip(path, {name: device}, body) for name, (device, body) in wearers.items()
        }
        self._unknown: set[str] = set()  # reported names
        # Trigger time, and clips by device, of each playing part.
        self._playing: dict[str, tuple[float, dict[str, PlayedClip]]] = {}

    def update(self, triggered: Sequence[str], now_s: float) -> list[str]:
        """Start parts by name at a time, and end those played to their end; returns unknown names,
        each once, 20 at most."""
        for name in triggered:
            if name in self._spans:
                # A copy, as a clip keeps the last row it gave.
                self._playing[name] = now_s, {k: copy(clip) for k, clip in self._clips.items()}
        for name, (begun_s, _) in list(self._playing.items()):
            start_s, end_s = self._spans[name]
            if now_s - begun_s >= end_s - start_s:
                del self._playing[name]
        unknown = sorted(set(triggered) - self._spans.keys() - self._unknown)
        reported = unknown[: _MOST_REPORTED - len(self._unknown)]
        self._unknown.update(reported)
        return reported

    def values(self, device: str, now_s: float) -> list[F64]:
        """Values (columns,) of a device for each playing part; to be called once at each time."""
        rows = []
        for name, (begun_s, clips) in self._playing.items():
            clip = clips[device]
            # Spans count from the first row.
            time_s = clip.start_s + self._spans[name][0] + now_s - begun_s
            rows.append(clip.values(device, time_s))
            clip.hold(time_s)
        return rows
