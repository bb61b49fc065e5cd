# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks a plan: at a few times what it reads is compared with what Blender evaluates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..engine.arrays import I64
from ..engine.scene import AnimationBlock, SceneDescription
from .description.scene_description import HapticObjects
from .reading_plan import Plan
from .stepped import stepping
from .stepped.scene_rows import EffectRow, PoseRow, Row, effects_agree
from .stepped.simulation import has_simulation_anywhere
from .stepped.stepped_reading import SteppedReading
from .stepped.stepped_rows import objects_of

_PROBES = 5

Agrees = Callable[[Plan, list[Row]], bool]
"""Test that a plan gives at single times what Blender evaluated."""


def checked(
    plan: Plan,
    found: HapticObjects,
    scene: SceneDescription,
    reading: SteppedReading,
    indices: I64,
    agrees: Agrees,
) -> Plan:
    """A plan, or the cheapest one that costs more, that agrees with the user's own scene.

    Parameters
    ----------
    indices : (n,) int64
        Samples at which something can be felt, of which a few are compared.
    agrees : callable
    """
    # The user's scene evaluates what nobody feels, too. Simulations in it that were not played
    # through must not be disturbed, and cannot be felt.
    is_disturbed = found.simulation is None and has_simulation_anywhere(found.scene)
    in_own_scene = plan.in_own_scene or (stepping.runs_code(found.read) and not is_disturbed)
    is_sampled = bool(plan.effects or plan.bodies or plan.presampled)
    if plan.in_own_scene == in_own_scene and not is_sampled:
        return plan
    probes = np.unique(indices[np.linspace(0, len(indices) - 1, _PROBES).astype(int)])
    truth = _as_evaluated(found, scene, reading, probes.tolist(), in_own_scene)
    if agrees(plan, truth):
        return plan
    if plan.presampled:
        plan = replace(plan, presampled={})
        if agrees(plan, truth):
            return plan
    if plan.effects or plan.bodies:
        stepped = Plan(
            reason="a few frames came out differently from F-curves",
            in_own_scene=plan.in_own_scene,
            in_one_go=plan.in_one_go,
        )
        if plan.in_own_scene == in_own_scene or agrees(stepped, truth):
            return stepped
    return Plan(
        reason="a few frames came out differently in a scratch scene",
        in_own_scene=True,
        in_one_go=True,
    )


def _as_evaluated(
    found: HapticObjects,
    scene: SceneDescription,
    reading: SteppedReading,
    probes: list[int],
    in_own_scene: bool,
) -> list[Row]:
    """Effects and bodies as Blender evaluates them."""
    bodies = range(len(found.bodies))
    if in_own_scene:
        stepped = stepping.own_scene(found)
    else:
        objects = objects_of(found, scene, found.active, bodies)
        stepped = stepping.scratch_scene(found.scene, objects)
    # Places and values are compared, for which no mesh is needed.
    reading.far = frozenset(found.active)
    with stepped as stepper:
        return [reading.read(index, stepper, found.active, bodies) for index in probes]


def is_same(row: Row, block: AnimationBlock) -> bool:
    """Test that a block of one time equals what was read at that time."""
    for k, read_effect in row.effects.items():
        effect = block.effects[k]
        other = EffectRow(
            float(effect.levels[0]),
            effect.parameters[0].tolist(),
            _first(effect.matrices),
            response=_first(effect.response),
            vertices=_first(effect.vertices),
            place=_first(effect.place),
            drive=_first(effect.drive),
        )
        if not effects_agree(read_effect, other):
            return False
    for k, pose in enumerate(block.poses):
        if not pose.valid[0]:
            continue
        read = row.poses[k]
        other_pose = PoseRow(pose.to_world[0], _first(pose.bones), _first(pose.surface))
        if read is None or not read.nearly_equals(other_pose):
            return False
    return True


def _first(values: Any) -> Any:
    """Values of the first time; None where there are none."""
    return None if values is None else values[0]
