# SPDX-License-Identifier: GPL-3.0-or-later
"""Controls of contact responses in the engine's units, and bounds of impact durations."""

import bpy
import numpy as np

from ...authoring import responses
from ...authoring.effects import effect_values
from ...authoring.responses import PATH
from ...blender import compat
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.response_filters.controls import WIDTH, FilterKind
from ...engine.response_filters.envelope import longest_s
from ...engine.scene import HapticVolume, TimeBase
from ..curves.animation_curves import limits_of
from ..curves.animation_time import animation_frames

_STEPS_A_FRAME = 4  # integration steps per frame for a variable frequency


def volume_of(effect: bpy.types.Object) -> HapticVolume:
    """Falloff, contact law, and active filters of a volume, from top to bottom, each with the upper
    bound of the duration of the filter's impacts in seconds (``rings_s``; 0 unless an impact),
    animated attack and decay included."""
    filters = tuple(
        responses.described(item, _longest_s(effect, k, item))
        for k, item in responses.active_filters(effect.hfx)
    )
    hfx = effect.hfx
    return HapticVolume(effect_values.falloff(hfx), filters, effect_values.contact_law(hfx))


def _longest_s(effect: bpy.types.Object, index: int, item: bpy.types.PropertyGroup) -> float:
    """Upper bound over all times of the duration of the impacts of response item ``index``,
    seconds; 0 for other kinds. Attack and decay count with the highest animated value, at most the
    hard limit; a driver on either sets both to the limit."""
    if item.kind != FilterKind.IMPACT:
        return 0.0
    # The engine keeps an impact as long as this bound, so a bound too low would cut impacts.
    times_s = {name: limited(item, name) for name in ("attack", "decay")}
    data = effect.animation_data
    if data is None:
        return longest_s(*times_s.values())
    for name in times_s:
        path = f"hfx.response[{index}].{name}"
        highest = item.bl_rna.properties[name].hard_max
        if any(driver.data_path == path for driver in data.drivers):
            return longest_s(highest, highest)
        for curve in compat.all_fcurves(effect):
            if curve.data_path == path:
                times_s[name] = max(times_s[name], min(limits_of(curve)[1], highest))
    return longest_s(*times_s.values())


def controls(hfx: bpy.types.PropertyGroup, unit_m: float) -> F64 | None:
    """Present controls (F, WIDTH) of the F active filters, clamped to hard limits, lengths in
    metres, unused columns 0; None without filters."""
    active = responses.active_filters(hfx)
    if not active:
        return None
    values = np.zeros((len(active), WIDTH))
    for row, (_, item) in zip(values, active, strict=True):
        for c, name in enumerate(responses.properties_of(item)):
            row[c] = limited(item, name) * (unit_m if name in responses.LENGTHS else 1.0)
    return values


def controls_at(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    hfx: bpy.types.PropertyGroup,
    unit_m: float,
    time: TimeBase,
    index: int,
) -> F64 | None:
    """Controls (F, WIDTH) of the evaluated properties ``hfx`` of an effect at sample ``index``, see
    :func:`controls`, with continuous sine phases; None without filters."""
    values = controls(hfx, unit_m)
    if values is None:
        return None
    frame = np.array([float(time.frame(index))])
    return with_even_phase(scene, effect, values[None], frame, time)[0]


def with_even_phase(
    scene: bpy.types.Scene, effect: bpy.types.Object, values: F64, frames: F64, time: TimeBase
) -> F64:
    """Add phase offsets to controls (T, F, WIDTH) at played frames, in place, and return them. With
    an animated frequency, a sine's turns are the integral of the frequency. Its difference from
    frequency times time is added to the phase. Only F-curves are integrated, negative values as 0
    and from the scene's start; a driver's frequency is used as evaluated."""
    for f, (index, item) in enumerate(responses.active_filters(effect.hfx)):
        if item.kind != FilterKind.SINE or item.domain != "time":
            continue
        path = f"hfx.response[{index}].frequency"
        curve = next((c for c in compat.fcurves(effect) if c.data_path == path), None)
        if curve is not None:
            times = (frames - time.scene_start) / float(time.fps)
            # The integral of the frequency, by the trapezoidal rule at quarter frames. A common
            # grid from the scene's start makes the phase independent of the block.
            start = time.scene_start
            last = int(np.ceil(max(float(frames.max()), start) - start)) + 1
            grid = start + np.arange(last * _STEPS_A_FRAME + 1) / _STEPS_A_FRAME
            grid_frames = animation_frames(scene, grid).tolist()
            hertz = np.array([max(curve.evaluate(frame), 0.0) for frame in grid_frames])
            areas = 0.5 * (hertz[1:] + hertz[:-1]) / _STEPS_A_FRAME
            sums = np.concatenate([[0.0], np.cumsum(areas)])
            turns = np.interp(frames, grid, sums) / float(time.fps)
            values[:, f, 3] += turns - values[:, f, 1] * times
    return values


def place_of(path: str) -> tuple[int, str] | None:
    """Index in the response list and property name of an animated RNA path; or None."""
    match = PATH.match(path)
    return None if match is None else (int(match[1]), match[2])
