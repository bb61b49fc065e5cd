# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison of a reading plan with Blender's own evaluation at a few times."""

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
from .stepped.scene_rows import EffectRow, PoseRow, SceneRow, effects_agree
from .stepped.simulation import has_simulation_anywhere
from .stepped.stepped_reading import SteppedReading
from .stepped.stepped_rows import objects_of

_PROBES = 5

Agrees = Callable[[Plan, list[SceneRow]], bool]
"""Function that compares a plan's readings with rows of Blender's evaluation."""


def checked(
    plan: Plan,
    haptics: HapticObjects,
    scene: SceneDescription,
    reading: SteppedReading,
    indices: I64,
    agrees: Agrees,
) -> Plan:
    """Cheapest plan, from ``plan`` upwards, that agrees with the user's own scene at up to five of
    the sample ``indices`` (n,), by ``agrees(plan, rows)``. ``plan`` itself if nothing needs
    comparison."""
    # The user's scene also evaluates objects that are not felt. Unplayed simulations among them
    # must not be disturbed, so such a scene is compared in a scratch scene.
    is_disturbed = haptics.simulation is None and has_simulation_anywhere(haptics.scene)
    in_own_scene = plan.in_own_scene or (stepping.runs_code(haptics.read) and not is_disturbed)
    is_sampled = bool(plan.effects or plan.bodies or plan.presampled)
    if plan.in_own_scene == in_own_scene and not is_sampled:
        return plan
    probes = np.unique(indices[np.linspace(0, len(indices) - 1, _PROBES).astype(int)])
    truth = _as_evaluated(haptics, scene, reading, probes.tolist(), in_own_scene)
    if agrees(plan, truth):
        return plan
    # From cheap to expensive: presampled rigs, F-curves, scratch scene, own scene.
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
    haptics: HapticObjects,
    scene: SceneDescription,
    reading: SteppedReading,
    probes: list[int],
    in_own_scene: bool,
) -> list[SceneRow]:
    """Rows of all active effects and all bodies at sample indices ``probes``, stepped by Blender in
    the user's scene or, with ``in_own_scene`` False, in a scratch scene. Meshes are read as
    boxes."""
    bodies = range(len(haptics.bodies))
    if in_own_scene:
        stepped = stepping.own_scene(haptics)
    else:
        objects = objects_of(haptics, scene, haptics.active, bodies)
        stepped = stepping.scratch_scene(haptics.scene, objects)
    # Placements and values are compared, so boxes replace meshes.
    reading.far = frozenset(haptics.active)
    with stepped as stepper:
        return [reading.read(index, stepper, haptics.active, bodies) for index in probes]


def is_same(row: SceneRow, block: AnimationBlock) -> bool:
    """Test that the first time of a block equals a row up to float32 rounding: effects of the row,
    and bodies that are valid in the block."""
    for k, read_effect in row.effects.items():
        effect = block.effects[k]
        block_row = EffectRow(
            float(effect.levels[0]),
            effect.parameters[0].tolist(),
            _first(effect.matrices),
            response=_first(effect.response),
            vertices=_first(effect.vertices),
            place=_first(effect.place),
            drive=_first(effect.drive),
        )
        if not effects_agree(read_effect, block_row):
            return False
    for k, pose in enumerate(block.poses):
        if not pose.valid[0]:
            continue
        read = row.poses[k]
        block_pose = PoseRow(pose.to_world[0], _first(pose.bones), _first(pose.surface))
        if read is None or not read.nearly_equals(block_pose):
            return False
    return True


def _first(values: Any) -> Any:
    """First entry along the first axis; None for None."""
    return None if values is None else values[0]
