# SPDX-License-Identifier: GPL-3.0-or-later
"""The open scene as it stands now, felt by the engine: what preview and live devices show.

It goes the way of an export (reader, engine, samples), but reads what Blender has evaluated
already instead of stepping through time. An effect that could not be exported is left out.
"""

from __future__ import annotations

from fractions import Fraction

import bpy
import numpy as np

from ..authoring import effects
from ..engine.evaluate import Engine
from ..engine.samples import SampleRun
from ..engine.scene import AnimationBlock, SceneDescription
from ..engine.tolerance import Tolerance
from ..errors import InputError
from . import scene_description
from .effect_values import Shapes
from .scene_description import HapticObjects
from .scene_reader import time_base
from .scene_rows import effect_block, pose_block
from .stepped_reading import SteppedReading
from .stepping import Stepper


class LiveScene:
    """One scene, described once; evaluated whenever something moved.

    Parameters
    ----------
    scene : bpy.types.Scene
    layer : bpy.types.ViewLayer
        Whose evaluated objects are read.
    tolerance : Tolerance

    Raises
    ------
    InputError
        Nothing can be felt: no body, or no effect without a fault.
    """

    def __init__(
        self, scene: bpy.types.Scene, layer: bpy.types.ViewLayer, tolerance: Tolerance
    ) -> None:
        self.signature = signature_of(scene)
        found = scene_description.find(scene, layer)
        self.objects, self.description, self.faults = _without_faults(found)
        self.engine = Engine(self.description, tolerance=tolerance)
        self._reading = SteppedReading(self.objects, self.description, Shapes())
        self._now = _AsItStands(scene, layer)
        self._volumes = [k for k, e in enumerate(self.description.effects) if e.kind == "volume"]

    def runs(self) -> list[SampleRun]:
        """What is felt now: at most one sample for each effect and body."""
        count = range(len(self.objects.effects))
        row = self._reading.read(0, self._now, count, ())
        if any(row.effects[k].level > 0.0 for k in self._volumes):
            self._reading.add_poses(row, self._now, range(len(self.objects.bodies)))
        block = AnimationBlock(
            indices=np.zeros(1, np.int64),
            effects=tuple(
                effect_block([row.effects[k]], self.description.effects[k].modality) for k in count
            ),
            poses=tuple(pose_block([row.poses.get(k)]) for k in range(len(self.objects.bodies))),
        )
        return self.engine.evaluate(block)


class _AsItStands(Stepper):
    """Reads what is evaluated; time is Blender's own."""

    def set_frame(self, frame: Fraction) -> None:
        pass


def signature_of(scene: bpy.types.Scene) -> tuple[object, ...]:
    """Changes where the description of a scene may: cheap enough to be asked at every update."""
    found: list[object] = [scene.name]
    for obj in (*effects.bodies_of(scene), *effects.effects_of(scene)):
        hfx = obj.hfx
        data = obj.animation_data
        strips = () if data is None else tuple(_strips(data))
        found.append(
            (
                obj.name,
                hfx.role,
                hfx.modality,
                hfx.kind,
                hfx.shape,
                hfx.falloff,
                hfx.falloff_share,
                hfx.temperature_reference,
                hfx.model_hash,
                hfx.body.name if hfx.body else "",
                hfx.avatar.name if hfx.avatar else "",
                hfx.follow,
                hash(bytes(memoryview(obj[effects.WEIGHTS]))) if _has_weights(obj) else 0,
                hash(bytes(memoryview(obj[effects.VERTICES]))) if _has_weights(obj) else 0,
                obj.hide_viewport,
                hfx.is_muted,
                hfx.is_solo,
                strips,
            )
        )
    return tuple(found)


def _has_weights(obj: bpy.types.Object) -> bool:
    # An empty ID-property array comes back as a list.
    return effects.WEIGHTS in obj and not isinstance(obj[effects.WEIGHTS], list)


def _strips(data: bpy.types.AnimData) -> list[object]:
    found: list[object] = [data.use_nla, data.action.name if data.action else ""]
    for track in data.nla_tracks:
        found.append((track.mute, track.is_solo))
        found += [(strip.name, strip.mute) for strip in track.strips]
    return found


def _without_faults(
    found: HapticObjects,
) -> tuple[HapticObjects, SceneDescription, tuple[str, ...]]:
    """The objects and description of what can be felt, and why the rest cannot."""
    time = time_base(found.scene)
    try:
        return found, scene_description.describe(found, time, always_posed=False), ()
    except InputError:
        pass
    kept, faults = [], []
    for k in range(len(found.effects)):
        alone = _only(found, [k])
        try:
            scene_description.describe(alone, time, always_posed=False)
            kept.append(k)
        except InputError as error:
            faults.append(str(error))
    if not kept:
        raise InputError(faults[0])
    some = _only(found, kept)
    return some, scene_description.describe(some, time, always_posed=False), tuple(faults)


def _only(found: HapticObjects, which: list[int]) -> HapticObjects:
    return HapticObjects(
        found.scene,
        found.layer,
        found.bodies,
        [found.effects[k] for k in which],
        [found.activations[k] for k in which],
        found.warnings,
    )
