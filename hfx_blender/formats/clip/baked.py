# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked part of a clip: the output of each actuator, stored at its changing rows."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import MODALITIES
from ...engine.rendering.device_config import (
    DEAD_MAN_MS,
    Actuator,
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
from .container import Records, Texts, records

FULL_SCALE: Final = 65535
_LOOPS: Final = ("loop", "cycle")  # name endings of looping animations in Godot's importers
_SIDES: Final = {None: 0, "left": 1, "right": 2}
_OTHER_SIDE: Final = {None: None, "left": "right", "right": "left"}
_MODALITIES: Final = tuple(MODALITIES)

Played = Sequence[tuple[DeviceConfig, Raster]]


def sections_of(
    header: TrackHeader, played: Played, texts: Texts, title: str
) -> tuple[dict[str, Records], Written]:
    """Sections TIME, CLIP, DEVC, ACTR, COLM, ROWS and VALU; second, notes on skipped clips. Rasters
    are on the sample clock of the track; ``title`` names the scene. ``texts`` receives all names;
    the caller creates the section ``TEXT`` from it."""
    time = header.time
    start_s = float(time.times_s(np.array([0]))[0])
    baked = _Baked(texts, {body.id: body.name for body in header.bodies}, _models(header))
    for device, raster in played:
        baked.add(device, raster)
    sections = baked.sections()
    sections["TIME"] = records(
        "TIME", [(float(time.rate_hz), start_s, time.sample_count, texts.add(title))]
    )
    sections["CLIP"], left_out = _clips(header, texts)
    return sections, left_out


def numbers_of(values: F64, lowest: float, highest: float) -> Records:
    """Quantize values (n,) to uint16: 0 at ``lowest``, 65535 at ``highest``, rounded to nearest.
    Values outside are clipped; an empty or NaN range gives 0. Players read the number of the
    neutral value as exactly neutral."""
    scale = highest - lowest
    if not scale > 0.0:
        return np.zeros(len(values), np.uint16)
    numbers = np.rint((np.clip(values, lowest, highest) - lowest) * (FULL_SCALE / scale))
    return numbers.astype(np.uint16)


def _models(header: TrackHeader) -> dict[str, PerceptualModel]:
    """Perceptual models of the track by actuator modality, without modalities lacking a model."""
    ids = {model.modality: model.id for model in header.models}
    return {
        name: load_model(ids[modality.model])
        for name, modality in MODALITIES.items()
        if modality.model in ids
    }


class _Baked:
    """Collector of device, actuator, column and row records."""

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
        """Sections ``DEVC``, ``ACTR``, ``COLM``, ``ROWS`` and ``VALU`` of all added devices."""
        return {
            "DEVC": records("DEVC", self._devices),
            "ACTR": records("ACTR", self._actuators),
            "COLM": records("COLM", self._columns),
            "ROWS": np.concatenate([np.zeros(0, np.uint32), *self._rows]),
            "VALU": np.concatenate([np.zeros(0, np.uint16), *self._numbers]),
        }

    def add(self, device: DeviceConfig, raster: Raster) -> None:
        """Append the records of a device and of all its actuators and columns."""
        text = self._texts.add
        names = text(device.id), text(device.name), text(self._bodies[raster.body_id])
        firsts = len(self._actuators), len(self._columns)
        for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
            self._add_actuator(device, actuator, raster.values[:, part])
        column_count = sum(len(actuator.type.modality_controls) for actuator in device.actuators)
        counts = len(device.actuators), column_count
        self._devices.append((*names, firsts[0], counts[0], firsts[1], counts[1], DEAD_MAN_MS))

    def _add_actuator(self, device: DeviceConfig, actuator: Actuator, values: F64) -> None:
        """Append an actuator, its columns, and the rows where a quantized value changes. The first
        row is always stored."""
        kind, text = actuator.type, self._texts.add
        controls = kind.modality_controls  # the format has no custom columns
        numbers = np.stack(
            [
                numbers_of(values[:, k], control.lowest, control.highest)
                for k, control in enumerate(controls)
            ],
            axis=1,
        )
        # Players hold values between stored rows, so rows equal to their predecessor are dropped.
        is_new = np.ones(len(numbers), np.bool_)
        is_new[1:] = (numbers[1:] != numbers[:-1]).any(axis=1)
        rows = np.flatnonzero(is_new).astype(np.uint32)
        bone = _bone(device, actuator, self._models.get(kind.modality))
        # Places: 0 vertices, 1 body, 2 room. Side and centre of a mirrored device are mirrored.
        position, side, centre_m, radius_m = actuator.place, None, (0.0, 0.0, 0.0), 0.0
        parts: tuple[str, ...] = ()
        if isinstance(position, BodyPlace):
            x, y, z = position.centre_m
            side = _OTHER_SIDE[position.side] if device.is_mirrored else position.side
            centre_m, radius_m = (-x if device.is_mirrored else x, y, z), position.radius_m
            parts = position.parts
        elif isinstance(position, RoomPlace):
            parts = position.parts
        number = 1 if isinstance(position, BodyPlace) else 2 * isinstance(position, RoomPlace)
        self._actuators.append(
            (
                text(actuator.id),
                _MODALITIES.index(kind.modality),
                len(self._columns),
                len(controls),
                self._row_count,
                len(rows),
                self._number_count,
                number,
                _SIDES[side],
                text(",".join(parts)),
                text(bone),
                text(rig_names(bone).human),
                centre_m,
                radius_m,
                kind.latency_ms,
                kind.update_interval_ms,
                kind.slew_per_s,
                kind.maximum_on_s,
                kind.rest_s,
                0,
            )
        )
        for control in controls:
            lowest, highest, neutral = control.lowest, control.highest, control.neutral
            (neutral_number,) = numbers_of(np.array([neutral]), lowest, highest).tolist()
            names = text(control.name), text(kind.unit(control))
            owner = len(self._actuators) - 1
            self._columns.append((*names, owner, neutral_number, lowest, highest, neutral))
        self._rows.append(rows)
        self._numbers.append(numbers[rows].ravel())
        self._row_count += len(rows)
        self._number_count += numbers[rows].size


def _bone(device: DeviceConfig, actuator: Actuator, model: PerceptualModel | None) -> str:
    """Canonical bone with the largest skin area (times skin weight) among an actuator's vertices.
    The joint with the largest area is chosen first, then its largest bone. Empty without a model,
    for a place in the room, or without skin under the actuator."""
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
    # The joint is chosen first: its bones share the skin, and their largest would be arbitrary.
    joints = np.array([rig_names(bone_name).human for bone_name in model.bone_names])
    joint = max(dict.fromkeys(joints.tolist()), key=lambda each: shares[joints == each].sum())
    return model.bone_names[int(np.argmax(np.where(joints == joint, shares, 0.0)))]


def _clips(header: TrackHeader, texts: Texts) -> tuple[Records, Written]:
    """Records (name, loops, start and end in s from the first row) of named clips. Clips outside
    the track are left out with a note. Names ending in "loop" or "cycle" loop."""
    rate_hz = float(header.time.rate_hz)
    rows_of_clips, notes = [], []
    for named_clip in named_clips(header):
        rows = sample_range(named_clip.clip, header.time)
        if rows is None:
            notes.append(f"clip '{named_clip.name}' is outside the exported frames and left out")
            continue
        loops = named_clip.name.casefold().endswith(_LOOPS)
        rows_of_clips.append(
            (texts.add(named_clip.name), loops, rows[0] / rate_hz, (rows[1] + 1) / rate_hz)
        )
    return records("CLIP", rows_of_clips), Written(notes=tuple(notes))
