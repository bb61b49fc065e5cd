# SPDX-License-Identifier: GPL-3.0-or-later
"""The baked part of a clip: what each actuator plays, as the rows that change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import MODALITIES
from ...engine.rendering.device_config import (
    DEAD_MAN_MS,
    Actuator,
    ActuatorControl,
    BodyPlace,
    DeviceConfig,
    RoomPlace,
)
from ...engine.rendering.raster import Raster
from ...engine.rendering.schemes import cells_of
from ...engine.track.excerpt import named_clips, sample_range
from ...engine.track.header import TrackHeader
from ..written import Written
from .common_rigs import rig_names
from .container import Records, Sections, Texts, records

FULL_SCALE: Final = 65535
_LOOPS: Final = ("loop", "cycle")  # ends of names, as Godot's importers read them
_SIDES: Final = {None: 0, "left": 1, "right": 2}
_OTHER_SIDE: Final = {None: None, "left": "right", "right": "left"}
_MODALITIES: Final = tuple(MODALITIES)

Played = Sequence[tuple[DeviceConfig, Raster]]


def sections_of(
    header: TrackHeader, played: Played, texts: Texts, title: str
) -> tuple[dict[str, Records], Written]:
    """Sections of what devices play of a track, and notes on what had to be left out.

    Parameters
    ----------
    played : sequence of (DeviceConfig, Raster)
        Rasters on the sample clock of the track.
    texts : Texts
        Gets all names; the section ``TEXT`` is made of it afterwards.
    title : str
        Name of the scene.
    """
    time = header.time
    start_s = float(time.times_s(np.array([0]))[0])
    baked = _Baked(texts, {body.id: body.name for body in header.bodies}, _models(header))
    for device, raster in played:
        baked.add(device, raster)
    found = baked.sections()
    found["TIME"] = records(
        "TIME", [(float(time.rate_hz), start_s, time.sample_count, texts.add(title))]
    )
    found["CLIP"], left_out = _clips(header, texts)
    return found, left_out


def numbers_of(values: F64, lowest: float, highest: float, neutral: float) -> Records:
    """Values of a column as numbers of 16 bits, half a step off at most.

    A value that gets the number of the neutral one is read as that, at most a step off.
    """
    scale = highest - lowest
    if not scale > 0.0:
        return np.zeros(len(values), np.uint16)
    numbers = np.rint((np.clip(values, lowest, highest) - lowest) * (FULL_SCALE / scale))
    return numbers.astype(np.uint16)


def values_of(sections: Sections, actuator: int) -> tuple[Records, F64]:
    """Rows (n,) of an actuator, and its values (n, columns), of a clip that keeps the rules."""
    at = sections["ACTR"][actuator]
    count, columns = int(at["rows"]), int(at["columns"])
    first_row, first_value = int(at["first_row"]), int(at["first_value"])
    rows = sections["ROWS"][first_row : first_row + count]
    numbers = sections["VALU"][first_value : first_value + count * columns]
    of = sections["COLM"][int(at["first_column"]) :][:columns]
    numbers = numbers.reshape(count, columns)
    values = of["lowest"] + (of["highest"] - of["lowest"]) * (numbers / FULL_SCALE)
    return rows, np.where(numbers == of["neutral_number"], of["neutral"], values)


def _models(header: TrackHeader) -> dict[str, PerceptualModel]:
    """Perceptual model of the track for each modality of actuators that it has one for."""
    ids = {model.modality: model.id for model in header.models}
    return {
        name: load_model(ids[modality.model])
        for name, modality in MODALITIES.items()
        if modality.model in ids
    }


class _Baked:
    """Collector of the records of devices, actuators, columns and rows."""

    def __init__(
        self, texts: Texts, bodies: dict[str, str], models: dict[str, PerceptualModel]
    ) -> None:
        self._texts = texts
        self._bodies = bodies
        self._models = models
        self._devices: list[tuple[Any, ...]] = []
        self._actuators: list[tuple[Any, ...]] = []
        self._columns: list[tuple[Any, ...]] = []
        self._rows: list[Records] = []
        self._numbers: list[Records] = []
        self._row_count = self._number_count = 0

    def sections(self) -> dict[str, Records]:
        return {
            "DEVC": records("DEVC", self._devices),
            "ACTR": records("ACTR", self._actuators),
            "COLM": records("COLM", self._columns),
            "ROWS": np.concatenate([np.zeros(0, np.uint32), *self._rows]),
            "VALU": np.concatenate([np.zeros(0, np.uint16), *self._numbers]),
        }

    def add(self, device: DeviceConfig, raster: Raster) -> None:
        text = self._texts.add
        names = text(device.id), text(device.name), text(self._bodies[raster.body_id])
        firsts = len(self._actuators), len(self._columns)
        for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
            self._add_actuator(device, actuator, raster.values[:, part])
        counts = len(device.actuators), len(device.controls)
        self._devices.append((*names, firsts[0], counts[0], firsts[1], counts[1], DEAD_MAN_MS))

    def _add_actuator(self, device: DeviceConfig, actuator: Actuator, values: F64) -> None:
        kind, text = actuator.type, self._texts.add
        numbers = np.stack(
            [
                numbers_of(values[:, k], control.lowest, control.highest, control.neutral)
                for k, control in enumerate(kind.controls)
            ],
            axis=1,
        )
        is_new = np.ones(len(numbers), np.bool_)
        is_new[1:] = (numbers[1:] != numbers[:-1]).any(axis=1)
        rows = np.flatnonzero(is_new).astype(np.uint32)
        bone = _bone(device, actuator, self._models.get(kind.modality))
        self._actuators.append(
            (
                text(actuator.id),
                _MODALITIES.index(kind.modality),
                len(self._columns),
                len(kind.controls),
                self._row_count,
                len(rows),
                self._number_count,
                *_place(device, actuator, text),
                text(bone),
                text(rig_names(bone).human),
                *_patch(device, actuator),
                kind.latency_ms,
                kind.update_interval_ms,
                kind.slew_per_s,
                kind.maximum_on_s,
                kind.rest_s,
                0,
            )
        )
        self._columns += [
            self._column(len(self._actuators) - 1, control, kind.unit(control))
            for control in kind.controls
        ]
        self._rows.append(rows)
        self._numbers.append(numbers[rows].ravel())
        self._row_count += len(rows)
        self._number_count += numbers[rows].size

    def _column(self, actuator: int, control: ActuatorControl, unit: str) -> tuple[Any, ...]:
        lowest, highest, neutral = control.lowest, control.highest, control.neutral
        number = int(numbers_of(np.array([neutral]), lowest, highest, neutral)[0])
        text = self._texts.add
        return text(control.name), text(unit), actuator, number, lowest, highest, neutral


def _place(device: DeviceConfig, actuator: Actuator, text: Any) -> tuple[int, int, int]:
    """Kind of an actuator's place, its side, and the parts of the body."""
    place = actuator.place
    if isinstance(place, BodyPlace):
        side = _OTHER_SIDE[place.side] if device.is_mirrored else place.side
        return 1, _SIDES[side], text(",".join(place.parts))
    if isinstance(place, RoomPlace):
        return 2, 0, text(",".join(place.parts))
    return 0, 0, 0


def _patch(device: DeviceConfig, actuator: Actuator) -> tuple[tuple[float, ...], float]:
    """Centre and radius of an actuator's patch of skin; zeros where it has none."""
    place = actuator.place
    if not isinstance(place, BodyPlace):
        return (0.0, 0.0, 0.0), 0.0
    x, y, z = place.centre_m
    return (-x if device.is_mirrored else x, y, z), place.radius_m


def _bone(device: DeviceConfig, actuator: Actuator, model: PerceptualModel | None) -> str:
    """Canonical bone of the joint that most of the skin under an actuator follows, or empty."""
    if model is None or isinstance(actuator.place, RoomPlace):
        return ""
    (vertices,) = cells_of(device, [actuator], model).rows
    weights, shares = model.weights, np.zeros(len(model.bone_names))
    for vertex in vertices.tolist():
        part = slice(int(weights.offsets[vertex]), int(weights.offsets[vertex + 1]))
        skin_m2 = weights.values[part] * model.areas_m2[vertex]
        np.add.at(shares, weights.bones[part], skin_m2)
    if not shares.any():
        return ""
    joints = np.array([rig_names(bone_name).human for bone_name in model.bone_names])
    joint = max(dict.fromkeys(joints.tolist()), key=lambda each: shares[joints == each].sum())
    return model.bone_names[int(np.argmax(np.where(joints == joint, shares, 0.0)))]


def _clips(header: TrackHeader, texts: Texts) -> tuple[Records, Written]:
    """Named clips of a track, from its first row on; those outside of it are told."""
    rate_hz = float(header.time.rate_hz)
    found, notes = [], []
    for named_clip in named_clips(header):
        rows = sample_range(named_clip.clip, header.time)
        if rows is None:
            notes.append(
                f"clip '{named_clip.name}' is outside the exported frames, so it is not in it"
            )
            continue
        loops = named_clip.name.casefold().endswith(_LOOPS)
        found.append(
            (texts.add(named_clip.name), loops, rows[0] / rate_hz, (rows[1] + 1) / rate_hz)
        )
    return records("CLIP", found), Written(notes=tuple(notes))
