# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations: effects with a curve per actuator of a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ...blender import compat
from ...engine.modality import MODALITIES
from ...errors import InputError
from .. import clips
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
    """Add a vector sensation for a device, all actuators at 0, at the neutral frequency of the
    first actuator, or as a contact for temperatures.

    Full strength is the highest of the actuators' strengths, reached at value 1. The default
    modality is that of the device's first actuator. Raises InputError: the device has no actuator
    of the modality, or the object is no body.
    """
    modality = modality or device.modalities[0]
    actuators = [actuator for actuator in device.actuators if actuator.type.modality == modality]
    if not actuators:
        raise InputError(
            f"Device '{device.id}' has no actuator for {modality}, only for "
            f"{', '.join(device.modalities)}."
        )
    effect = add_named(
        scene,
        modality,
        device.id,
        [(actuator.id, ()) for actuator in actuators],
        body,
        name or f"{device.name} Vector",
    )
    # Curves are shares of the effect's full strength, so that 1 reaches the strongest actuator's
    # limit; weaker actuators are limited to their own range.
    highest = max(actuator.type.strength.highest for actuator in actuators)
    setattr(effect.hfx, MODALITIES[modality].strength_parameter.prop, highest)
    if modality == "vibration" and len(actuators[0].type.controls) > 1:
        effect.hfx.frequency = actuators[0].type.controls[1].neutral
    if modality == "temperature":  # thermal actuators touch the skin
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
    """Add a vector sensation for actuators by name; the device may be unknown on this computer.

    The first key of each curve sets the actuator's value; no keyframes are added.
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
    """Keyframes (seconds, value) of each actuator, relative to a frame; 1 or more per actuator.

    Linear keyframes are exact, further curves are sampled at each frame.
    """
    fcurves = {curve.data_path: curve for curve in compat.fcurves(effect)}
    curves = []
    for k, item in enumerate(effect.hfx.drive):
        curve = fcurves.get(f"hfx.drive[{k}].value")
        # An actuator without keyframes has a constant value.
        if curve is None or not len(curve.keyframe_points):
            curves.append((item.name, ((0.0, float(item.value)),)))
            continue
        keys = clips.timed_shares(clips.linear_keys(curve), first, fps)
        curves.append((item.name, keys))
    return tuple(curves)


def set_curve(effect: bpy.types.Object, actuator: str, keys: list[tuple[float, float]]) -> None:
    """Replace an actuator's keyframes by (frame, value 0..1) pairs; InputError if unknown."""
    index = effect.hfx.drive.find(actuator)
    if index < 0:
        names = ", ".join(item.name for item in effect.hfx.drive) or "none"
        raise InputError(f"Effect '{effect.name}' has no actuator '{actuator}'; it has: {names}.")
    curve = compat.own_fcurve(effect, f"hfx.drive[{index}].value", "Curves")
    compat.set_keys(curve, keys, "LINEAR")
    effect.update_tag()
