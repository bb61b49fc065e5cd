# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations: effects that hold a curve for each actuator of one device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ...blender import compat
from ...engine.modality import MODALITIES
from ...errors import InputError
from ..clips import clips
from ..effects import effects

if TYPE_CHECKING:
    from ...engine.rendering.device_config import DeviceConfig

Key = tuple[float, float]


def add(
    scene: bpy.types.Scene,
    device: DeviceConfig,
    body: bpy.types.Object,
    *,
    modality: str | None = None,
    name: str | None = None,
) -> bpy.types.Object:
    """A vector sensation for a device, every actuator at 0.

    Its strength is as much as the actuators may give, so that a value of 1 is all of it.

    Parameters
    ----------
    modality : str, optional
        Of the actuators; that of the first one by default.

    Raises
    ------
    InputError
        The device has no actuator of the modality, or the body is none.
    """

    modality = modality or device.modalities[0]
    chosen = [each for each in device.actuators if each.type.modality == modality]
    if not chosen:
        raise InputError(
            f"Device '{device.id}' has no actuator for {modality}, only for "
            f"{', '.join(device.modalities)}."
        )
    effect = add_named(
        scene,
        modality,
        device.id,
        [(actuator.id, ()) for actuator in chosen],
        body,
        name or f"{device.name} Vector",
    )
    highest = max(each.type.strength.highest for each in chosen)
    setattr(effect.hfx, MODALITIES[modality].strength_parameter.prop, highest)
    if modality == "vibration" and len(chosen[0].type.controls) > 1:
        effect.hfx.frequency = chosen[0].type.controls[1].neutral
    if modality == "temperature":
        effect.hfx.temperature_reference = "CONTACT"
    return effect


def add_named(
    scene: bpy.types.Scene,
    modality: str,
    device_id: str,
    curves: Sequence[tuple[str, Sequence[Key]]],
    body: bpy.types.Object,
    name: str,
) -> bpy.types.Object:
    """A vector sensation for actuators that are named; the device need not be known here.

    One that has a single key keeps its value.
    """
    effect = effects.add_on_body(scene, modality, body, "ACTUATORS", name)
    effect.hfx.device = device_id
    for actuator, keys in curves:
        item = effect.hfx.drive.add()
        item.name = actuator
        item.value = keys[0][1] if keys else 0.0
    return effect


def curves_of(
    effect: bpy.types.Object, first: float, fps: float
) -> tuple[tuple[str, tuple[Key, ...]], ...]:
    """The curve of each actuator as (seconds, value), timed from a frame; never empty.

    Between linear keys nothing is lost; others are sampled at each frame.
    """
    found = {curve.data_path: curve for curve in compat.fcurves(effect)}
    curves = []
    for k, item in enumerate(effect.hfx.drive):
        curve = found.get(f"hfx.drive[{k}].value")
        if curve is None or not len(curve.keyframe_points):
            curves.append((item.name, ((0.0, float(item.value)),)))
            continue
        keys = tuple(
            (max((frame - first) / fps, 0.0), min(max(value, 0.0), 1.0))
            for frame, value in clips.linear_keys(curve)
        )
        curves.append((item.name, keys))
    return tuple(curves)


def set_curve(effect: bpy.types.Object, actuator: str, keys: list[tuple[float, float]]) -> None:
    """Replace the keyframes of one actuator: (frame, value in 0..1) pairs.

    Raises
    ------
    InputError
        The effect has no such actuator.
    """
    index = effect.hfx.drive.find(actuator)
    if index < 0:
        names = ", ".join(each.name for each in effect.hfx.drive) or "none"
        raise InputError(f"Effect '{effect.name}' has no actuator '{actuator}'; it has: {names}.")
    curve = compat.own_fcurve(effect, f"hfx.drive[{index}].value", "Curves")
    compat.set_keys(curve, keys, "LINEAR")
    effect.update_tag()
