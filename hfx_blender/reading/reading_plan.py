# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading plan: each effect and body is read from F-curves or by stepping a scene.

F-curves are sampled in whole blocks. Other objects are stepped, in a scratch scene where that gives
equal results, else in the user's scene. A plan is compared with Blender's own evaluation at a few
times.
"""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..authoring.effects.effect_values import ShapeCache
from ..engine.arrays import I64
from ..engine.scene import AnimationBlock, SceneDescription, SurfaceBinding
from .bounded_volumes import BoundedVolumes
from .curves.animation_curves import NotModelledError
from .curves.curve_reading import CurveBody, CurveEffect, is_steady
from .curves.fcurve_kinematics import Parents
from .curves.presampled_rig import PresampledRig
from .description.scene_description import HapticObjects
from .stepped import stepping
from .stepped.simulation import has_simulation_anywhere
from .stepped.stepped_reading import EffectRow, PoseRow, SceneRow, SteppedReading, agree
from .stepped.stepped_rows import objects_of

_PROBES = 5
"""Times at which a plan is compared with Blender."""


@dataclass(frozen=True)
class Plan:
    """Effects and bodies read from F-curves, by index, and how all others are read."""

    effects: dict[int, CurveEffect] = field(default_factory=dict)
    bodies: dict[int, CurveBody] = field(default_factory=dict)
    reason: str = ""  # why some are stepped; empty if none
    in_own_scene: bool = False
    presampled: dict[int, PresampledRig] = field(default_factory=dict)  # bodies posed by Blender
    bounded: BoundedVolumes | None = None  # further effects
    in_one_go: bool = False  # the own scene must be read in order
    is_sequential: bool = False  # a handler may depend on the order of frames

    @property
    def bounded_numbers(self) -> Collection[int]:
        """Indices of the effects in ``bounded``."""
        return () if self.bounded is None else self.bounded.numbers

    @property
    def note(self) -> str:
        """Clause for the report: F-curves were sampled, or which scene was stepped and why."""
        if not self.reason:
            return "sampled F-curves, stepped no scene"
        where = "the whole scene" if self.in_own_scene else "a scratch scene"
        return f"stepped {where}, because {self.reason}"


Agrees = Callable[[Plan, list[SceneRow]], bool]
"""Function that compares a plan's readings with rows of Blender's evaluation."""


def plan_of(found: HapticObjects, scene: SceneDescription, shapes: ShapeCache) -> Plan:
    """Cheapest plan for a scene, before any comparison with Blender: F-curves where these define
    all values, else stepping. A scratch scene is stepped unless a dependency needs the own scene. A
    frame handler of another add-on forces the own scene, read in order. Shapes of rigid volumes are
    converted into ``shapes``."""
    handler = stepping.foreign_handler()
    if handler is not None:
        return Plan(reason=handler, in_own_scene=True, in_one_go=True, is_sequential=True)
    reasons = []
    # Shared: a parent of many objects is read and sampled once.
    parents = Parents()

    def curve_effect(k: int) -> CurveEffect:
        """Effect by index, read from F-curves; NotModelledError if these do not define it."""
        effect, shape = found.effects[k], None
        if effect.hfx.kind == "VOLUME" and is_steady(effect):
            shape = shapes.shape_of(effect, effect.evaluated_get(found.layer.depsgraph))
        return CurveEffect(effect, found.activations[k], shape, found.unit_m, parents)

    bounded_volumes = BoundedVolumes(found, scene, curve_effect)
    plan = Plan(bounded=bounded_volumes if bounded_volumes.numbers else None)
    for k in sorted({*found.active}.difference(plan.bounded_numbers)):
        try:
            plan.effects[k] = curve_effect(k)
        except NotModelledError as error:
            reasons.append(str(error))
    for k, (body, described) in enumerate(zip(found.bodies, scene.bodies, strict=True)):
        try:
            plan.bodies[k] = CurveBody(body, described.binding, found.unit_m, parents)
        except NotModelledError as error:
            reasons.append(str(error))
    if not reasons:
        return plan
    own = stepping.why_own_scene(found.read)
    # Simulations are played in the user's scene; a scratch scene lacks their caches.
    if own is None and found.simulation is not None:
        own = "particles move"
    presampled = {}
    if not own:
        # Of stepped bodies with plain bone animation Blender need only solve the constraints.
        for k, (body, described) in enumerate(zip(found.bodies, scene.bodies, strict=True)):
            if k not in plan.bodies and not isinstance(described.binding, SurfaceBinding):
                with suppress(NotModelledError):
                    step = scene.time.fps / scene.time.rate_hz
                    presampled[k] = PresampledRig(found.scene, body, scene.time.frame(0), step)
    return replace(
        plan,
        reason=own or reasons[0],
        in_own_scene=own is not None,
        in_one_go=found.simulation is not None,
        presampled=presampled,
    )


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
    in_own_scene = plan.in_own_scene or (
        stepping.runs_code(haptics.read)
        and (haptics.simulation is not None or not has_simulation_anywhere(haptics.scene))
    )
    is_sampled = bool(plan.effects or plan.bodies or plan.presampled or plan.bounded_numbers)
    if plan.in_own_scene == in_own_scene and not is_sampled:
        return plan
    probes = np.unique(indices[np.linspace(0, len(indices) - 1, _PROBES).astype(int)])
    # Blender has placed bounded volumes at one time: still ones stay, and of keyed ones enough are
    # among the other effects.
    bounded = {*plan.bounded_numbers}
    effects = [k for k in haptics.active if k not in bounded]
    truth = _as_evaluated(haptics, scene, reading, probes.tolist(), in_own_scene, effects)
    if agrees(plan, truth):
        return plan
    # From cheap to expensive: presampled rigs, F-curves, scratch scene, own scene.
    if plan.presampled:
        plan = replace(plan, presampled={})
        if agrees(plan, truth):
            return plan
    if plan.effects or plan.bodies or plan.bounded_numbers:
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
    effects: Sequence[int],
) -> list[SceneRow]:
    """Rows of ``effects`` by index and all bodies at sample indices ``probes``, stepped by Blender
    in the user's scene or, with ``in_own_scene`` False, in a scratch scene. Meshes are read as
    boxes."""
    bodies = range(len(haptics.bodies))
    if in_own_scene:
        stepped = stepping.own_scene(haptics)
    else:
        objects = objects_of(haptics, scene, effects, bodies)
        stepped = stepping.scratch_scene(haptics.scene, objects)
    # Placements and values are compared, so boxes replace meshes.
    reading.far = frozenset(effects)
    with stepped as stepper:
        return [reading.read(index, stepper, effects, bodies) for index in probes]


def is_same(row: SceneRow, block: AnimationBlock, time: int) -> bool:
    """Test that a time of a block, by number, equals a row up to float32 rounding: effects of the
    row, and bodies that are valid in the block."""

    def at(values: Any) -> Any:
        # The vertices of a steady surface are those of all times.
        return None if values is None else values[min(time, len(values) - 1)]

    for k, read_effect in row.effects.items():
        effect = block.effects[k]
        block_row = EffectRow(
            float(effect.levels[time]),
            effect.parameters[time].tolist(),
            at(effect.matrices),
            response=at(effect.response),
            vertices=at(effect.vertices),
            place=at(effect.place),
            drive=at(effect.drive),
        )
        # Shapes are not compared, and of a silent effect only the level. NaN counts as silent here.
        names = ["level"]
        if read_effect.level > 0.0:
            names += ["parameters", "matrix", "response", "vertices", "place", "drive"]
        if not agree(read_effect, block_row, names):
            return False
    for k, pose in enumerate(block.poses):
        if not pose.valid[time]:
            continue
        read = row.poses[k]
        block_pose = PoseRow(pose.to_world[time], at(pose.bones), at(pose.surface))
        if read is None or not agree(read, block_pose, ("to_world", "bones", "surface")):
            return False
    return True
