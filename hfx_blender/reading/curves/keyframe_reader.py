# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a keyed scene ahead of the playhead: F-curves in blocks of frames, without stepping.

Devices that answer late are told early. Where something else than F-curves moves a scene, it
cannot be known without evaluating it, which playback has no time for. Only what needs Blender is
read here; bones are posed and contacts found by whoever evaluates it.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ...authoring.effects.effect_values import Shapes, to_metres
from ...engine.arrays import F64
from ...engine.keyed_scene import KeyedBlock, KeyedScene
from ...engine.scene import HapticSurface, HapticVolume
from ..live.live_scene import LiveScene
from ..stepped import stepping
from .animation_curves import NotModelledError
from .animation_time import animation_frames
from .curve_reading import CurveBody, CurveEffect, is_steady

Key = tuple[str, str]
"""Kind and name of a datablock."""


class KeyframeReader:
    """Reader of a scene's keyframes at other frames.

    Parameters
    ----------
    live : LiveScene
    before : KeyframeReader, optional
        Of the same scene before an edit that concerned no body: those are not read again.

    Attributes
    ----------
    reason : str
        Why it is not known; empty: it is.
    posing : frozenset of Key
        What bodies follow.
    """

    def __init__(self, live: LiveScene, before: KeyframeReader | None = None) -> None:
        self._live = live
        self._effects: list[CurveEffect] = []
        self._bodies: list[CurveBody] = []
        self._shapes = Shapes()
        self.posing: frozenset[Key] = frozenset()
        self.reason = _why_not(live)
        if self.reason:
            return
        try:
            self._read(before)
        except NotModelledError as error:
            self.reason = str(error)

    def _read(self, before: KeyframeReader | None) -> None:
        found, described = self._live.objects, self._live.description
        graph = found.layer.depsgraph
        for effect, state in zip(found.effects, found.activations, strict=True):
            shape = None
            if effect.hfx.kind == "VOLUME" and is_steady(effect):
                shape = self._shapes.shape_of(effect, effect.evaluated_get(graph))
            self._effects.append(CurveEffect(effect, state, shape, found.unit_m))
        if before is not None and not before.reason:
            self._bodies, self.posing = before._bodies, before.posing
            return
        for body, each in zip(found.bodies, described.bodies, strict=True):
            self._bodies.append(CurveBody(body, each.binding, found.unit_m))
        self.posing = frozenset(key for body in found.bodies for key in _followed_by(body))

    def scene(self, edition: int) -> KeyedScene:
        """Constant part of the scene, for another process."""
        live = self._live
        return KeyedScene(
            edition,
            replace(live.description, source={}, warnings=()),
            live.tolerance,
            tuple(live.record),
            tuple(effect.shape for effect in self._effects),
            tuple(body.rig.keyed for body in self._bodies),
        )

    def block(self, edition: int, frames: F64) -> KeyedBlock:
        """Animated state at played frames, (T,); they may lie between whole ones."""
        animation = animation_frames(self._live.objects.scene, frames)
        effects = (effect.read(animation) for effect in self._effects)
        unit_m = self._live.objects.unit_m
        return KeyedBlock(
            edition,
            frames.astype(np.float32).astype(np.float64),
            tuple(replace(each, shapes=()) for each in effects),
            tuple(to_metres(body.rig.body.world(animation), unit_m) for body in self._bodies),
            tuple(body.rig.channels(animation) for body in self._bodies),
        )


def _why_not(live: LiveScene) -> str:
    """Reason why the scene does not follow from a frame's values alone; empty if it may."""
    handler = stepping.foreign_handler()
    if handler is not None:
        return handler
    effects = live.description.effects
    if len(effects) > len(live.objects.effects):
        return "instances and particles are not keyed one by one"
    for each in effects:
        if isinstance(each.area, HapticSurface):
            return "a surface is felt by the way that skin goes over it"
        if isinstance(each.area, HapticVolume) and each.area.response:
            return f"how '{each.name}' answers a touch depends on what was before"
    return ""


def _followed_by(body: bpy.types.Object) -> list[Key]:
    found: list[Key] = [("Armature", body.data.name)]
    owner: bpy.types.Object | None = body
    while owner is not None:
        found.append(("Object", owner.name))
        if owner.type == "ARMATURE":
            found.append(("Armature", owner.data.name))
        data = owner.animation_data
        if data is not None:
            actions = [data.action, *(s.action for t in data.nla_tracks for s in t.strips)]
            found += [("Action", action.name) for action in actions if action is not None]
        owner = owner.parent
    return found
