# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes to several effects at once: strength, frequency, modulation.

Global parameters of Mango (Schneider et al., UIST 2015, interface requirement 6).
"""

from collections.abc import Iterable
from math import pi

import bpy

from ...blender import compat
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...errors import InputError

_MODULATION = "HFX Modulation"


def scale_strength(effects: Iterable[bpy.types.Object], factor: float) -> int:
    """Multiply the strength of effects and their keyframes; return the number of effects. For a
    temperature the deviation from neutral is scaled. Property limits apply."""
    count = 0
    for effect in effects:
        hfx, neutral = effect.hfx, 0.0
        if hfx.modality == "temperature":
            neutral = neutral_temperature_c(hfx.temperature_reference == "CONTACT")
        _scale(effect, MODALITIES[hfx.modality].strength_parameter.prop, factor, neutral)
        count += 1
    return count


def scale_frequency(effects: Iterable[bpy.types.Object], factor: float) -> int:
    """Multiply the frequency of vibrations and their keyframes; return their number."""
    vibrations = [effect for effect in effects if effect.hfx.modality == "vibration"]
    for effect in vibrations:
        _scale(effect, "frequency", factor, 0.0)
    return len(vibrations)


def _scale(effect: bpy.types.Object, name: str, factor: float, neutral: float) -> None:
    """Multiply the distance of a property from ``neutral``, now and in keyframes of the action."""

    def scaled(value: float) -> float:
        return neutral + (value - neutral) * factor

    setattr(effect.hfx, name, scaled(getattr(effect.hfx, name)))
    for curve in compat.fcurves(effect):
        if curve.data_path == f"hfx.{name}":
            for key in curve.keyframe_points:
                # Handles are scaled with the key, so that the curve keeps its form.
                for handle in (key.co, key.handle_left, key.handle_right):
                    handle[1] = scaled(handle[1])
            curve.update()
    effect.update_tag()


def modulate(effects: Iterable[bpy.types.Object], rate_hz: float, depth: float, fps: float) -> int:
    """Modulate the intensity of effects by a sine; return the number of effects.

    The modulation is an F-curve modifier on ``intensity``, visible in the Graph Editor. Peaks have
    the present intensity, troughs ``depth`` of it less. Depth 0 removes the modulation.

    Raises InputError: the rate exceeds half of the frame rate.
    """
    if depth > 0.0 and not 0.0 < rate_hz <= fps / 2:
        raise InputError(
            f"A modulation of {rate_hz:g} Hz cannot be shown at {fps:g} frames a second; allowed "
            f"is up to {fps / 2:g} Hz. Faster than that it is a vibration: change its frequency."
        )
    count = 0
    for effect in effects:
        curve = compat.fcurve_of(effect, "hfx.intensity")
        if curve is None and depth > 0.0:
            effect.keyframe_insert("hfx.intensity", frame=0.0)
            curve = compat.fcurve_of(effect, "hfx.intensity")
        count += 1
        if curve is None:
            continue
        # At most one modulation: an earlier one is replaced.
        for modifier in list(curve.modifiers):
            if modifier.type == "FNGENERATOR" and modifier.name.startswith(_MODULATION):
                curve.modifiers.remove(modifier)
        curve.update()  # Blender 4.2.0 evaluates removed modifiers until an update
        if depth > 0.0:
            # The modifier adds a sine: its amplitude and offset let it swing between the present
            # values and ``depth`` below.
            top = max(key.co[1] for key in curve.keyframe_points)
            modifier = curve.modifiers.new("FNGENERATOR")
            modifier.name = _MODULATION
            modifier.function_type = "SIN"
            modifier.use_additive = True
            modifier.amplitude = 0.5 * depth * top
            modifier.value_offset = -0.5 * depth * top
            modifier.phase_multiplier = 2.0 * pi * rate_hz / fps
    return count
