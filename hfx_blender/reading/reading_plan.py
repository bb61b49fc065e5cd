# SPDX-License-Identifier: GPL-3.0-or-later
"""How each effect and body of a scene is read: from F-curves, or by stepping through a scene.

What follows from F-curves alone is sampled whole blocks at a time. The rest is stepped, in a
scratch scene of what is needed where that gives the same, else in the user's own scene.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

from ..engine.scene import (
    SceneDescription,
    SurfaceBinding,
)
from . import effect_values, stepping, visibility
from .animation_curves import NotModelledError
from .curve_reading import CurveBody, CurveEffect, is_steady
from .fed_rig import FedRig
from .own_kinematics import Parents
from .scene_description import HapticObjects


@dataclass(frozen=True)
class Plan:
    """Which effects and bodies, by their place in the scene's lists, come from F-curves."""

    effects: dict[int, CurveEffect] = field(default_factory=dict)
    bodies: dict[int, CurveBody] = field(default_factory=dict)
    reason: str = ""  # why not all of them; empty if all
    in_own_scene: bool = False
    fed: dict[int, FedRig] = field(default_factory=dict)  # bodies that only Blender can pose
    is_exact: bool = False  # every sample that is stepped is read; none is interpolated
    is_sequential: bool = False  # a handler may do otherwise if it goes back in time

    @property
    def note(self) -> str:
        """What was done, for the report."""
        if not self.reason:
            return "sampled F-curves, stepped no scene"
        where = "the whole scene" if self.in_own_scene else "a scratch scene"
        return f"stepped {where}, because {self.reason}"


def plan_of(found: HapticObjects, scene: SceneDescription, shapes: effect_values.Shapes) -> Plan:
    """The cheapest way to read a scene, as far as can be told without trying."""
    handler = stepping.foreign_handler()
    if handler is not None:
        return Plan(reason=handler, in_own_scene=True, is_exact=True, is_sequential=True)
    plan = Plan()
    reasons = []
    parents = Parents()
    for k in found.awake:
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
        is_exact=found.simulation is not None or any(map(visibility.is_keyed, found.bodies)),
        fed={} if own else _fed(found, scene, plan),
    )


def _fed(found: HapticObjects, scene: SceneDescription, plan: Plan) -> dict[int, FedRig]:
    """Of the bodies that are stepped, those whose keyed channels need not be."""
    fed = {}
    for k, (body, described) in enumerate(zip(found.bodies, scene.bodies, strict=True)):
        if k in plan.bodies or isinstance(described.binding, SurfaceBinding):
            continue
        with suppress(NotModelledError):
            step = scene.time.fps / scene.time.rate_hz
            fed[k] = FedRig(found.scene, body, scene.time.frame(0), step)
    return fed
