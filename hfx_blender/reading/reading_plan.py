# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading plan: each effect and body is read from F-curves or by stepping a scene.

F-curves are sampled in whole blocks. Other objects are stepped, in a scratch scene where that gives
equal results, else in the user's scene.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

from ..authoring.effects import effect_values
from ..engine.scene import SceneDescription, SurfaceBinding
from .curves.animation_curves import NotModelledError
from .curves.curve_reading import CurveBody, CurveEffect, is_steady
from .curves.fcurve_kinematics import Parents
from .curves.presampled_rig import PresampledRig
from .description.scene_description import HapticObjects
from .stepped import stepping


@dataclass(frozen=True)
class Plan:
    """Effects and bodies read from F-curves, by index, and how all others are read."""

    effects: dict[int, CurveEffect] = field(default_factory=dict)
    bodies: dict[int, CurveBody] = field(default_factory=dict)
    reason: str = ""  # why some are stepped; empty if none
    in_own_scene: bool = False
    presampled: dict[int, PresampledRig] = field(default_factory=dict)  # bodies posed by Blender
    in_one_go: bool = False  # the own scene must be read in order
    is_sequential: bool = False  # a handler may depend on the order of frames

    @property
    def note(self) -> str:
        """Clause for the report: F-curves were sampled, or which scene was stepped and why."""
        if not self.reason:
            return "sampled F-curves, stepped no scene"
        where = "the whole scene" if self.in_own_scene else "a scratch scene"
        return f"stepped {where}, because {self.reason}"


def plan_of(
    found: HapticObjects, scene: SceneDescription, shapes: effect_values.ShapeCache
) -> Plan:
    """Cheapest plan for a scene, before any comparison with Blender: F-curves where these define
    all values, else stepping. A scratch scene is stepped unless a dependency needs the own scene. A
    frame handler of another add-on forces the own scene, read in order. Shapes of rigid volumes are
    converted into ``shapes``."""
    handler = stepping.foreign_handler()
    if handler is not None:
        return Plan(reason=handler, in_own_scene=True, in_one_go=True, is_sequential=True)
    plan = Plan()
    reasons = []
    parents = Parents()
    for k in found.active:
        effect, state = found.effects[k], found.activations[k]
        shape = None
        if effect.hfx.kind == "VOLUME" and is_steady(effect):
            shape = shapes.shape_of(effect, effect.evaluated_get(found.layer.depsgraph))
        try:
            plan.effects[k] = CurveEffect(effect, state, shape, found.unit_m, parents)
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
    if own is None and found.simulation is not None:
        own = "particles move"
    return replace(
        plan,
        reason=own or reasons[0],
        in_own_scene=own is not None,
        in_one_go=found.simulation is not None,
        presampled={} if own else _presampled(found, scene, plan),
    )


def _presampled(
    found: HapticObjects, scene: SceneDescription, plan: Plan
) -> dict[int, PresampledRig]:
    """Presampled rigs by body index, for stepped bodies on an armature whose bone animation can be
    sampled."""
    presampled = {}
    for k, (body, described) in enumerate(zip(found.bodies, scene.bodies, strict=True)):
        if k in plan.bodies or isinstance(described.binding, SurfaceBinding):
            continue
        with suppress(NotModelledError):
            step = scene.time.fps / scene.time.rate_hz
            presampled[k] = PresampledRig(found.scene, body, scene.time.frame(0), step)
    return presampled
