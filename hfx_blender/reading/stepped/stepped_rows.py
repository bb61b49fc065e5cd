# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of one reading pass: effects and bodies at single times from stepped scenes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field

import bpy

from ...avatars import avatar_meshes
from ...engine.arrays import I64, Bool
from ...engine.response.motion_estimate import OVERLAP
from ...engine.scene import SceneDescription, SurfaceBinding
from ..curves.animation_curves import NotModelledError
from ..curves.presampled_rig import PresampledRig
from ..description.scene_description import HapticObjects
from . import stepping
from .scene_rows import SceneRow
from .stepped_reading import SteppedReading
from .stepped_volumes import FarVolumes
from .stepping import Stepper


@dataclass(frozen=True)
class SteppedScenes:
    """Scenes for stepping: ``whole`` with bodies and effects, ``light`` with effects only.

    Both are the same stepper if a second scene saves nothing.
    """

    whole: Stepper
    light: Stepper

    @classmethod
    def own(cls, found: HapticObjects, stack: ExitStack) -> SteppedScenes:
        """Use the user's own scene until the stack is closed."""
        stepper = stack.enter_context(stepping.own_scene(found))
        return cls(stepper, stepper)

    @classmethod
    def scratch(
        cls,
        found: HapticObjects,
        scene: SceneDescription,
        effects: Sequence[int],
        bodies: Sequence[int],
        rigs: Sequence[PresampledRig],
        stack: ExitStack,
    ) -> SteppedScenes:
        """Make scratch scenes of effects and bodies by index until the stack is closed.

        Bodies of ``rigs`` are replaced by the copies.
        """
        objects = objects_of(found, scene, effects, bodies)
        whole = _scratch(found, objects, rigs, stack)
        if not effects or not bodies:
            return cls(whole, whole)
        alone = stepping.scratch_scene(found.scene, [found.effects[k] for k in effects])
        return cls(whole, stack.enter_context(alone))


def objects_of(
    found: HapticObjects, scene: SceneDescription, effects: Iterable[int], bodies: Iterable[int]
) -> list[bpy.types.Object]:
    """Objects to evaluate for effects and bodies by index, surface-bound avatar meshes included."""
    bodies = list(bodies)
    surfaces = (k for k in bodies if isinstance(scene.bodies[k].binding, SurfaceBinding))
    meshes = (mesh for k in surfaces for mesh in avatar_meshes.meshes_of(found.bodies[k]))
    return [
        *(found.effects[k] for k in effects),
        *(found.bodies[k] for k in bodies),
        *meshes,
    ]


def _scratch(
    found: HapticObjects,
    objects: list[bpy.types.Object],
    rigs: Sequence[PresampledRig],
    stack: ExitStack,
) -> Stepper:
    """Scratch scene with presampled rigs, or without if an object follows one of them."""
    if rigs:
        presampled = [rig.obj for rig in rigs]
        others = [obj for obj in objects if obj not in presampled]
        with suppress(NotModelledError):
            return stack.enter_context(stepping.scratch_scene(found.scene, others, rigs))
    return stack.enter_context(stepping.scratch_scene(found.scene, objects))


@dataclass
class SteppedRows:
    """Reader of rows in the order of time.

    Attributes
    ----------
    scenes : SteppedScenes
    reading : SteppedReading
    bodies : collection of int
        Indices of stepped bodies.
    volumes : FarVolumes
        Volumes whose placements are read at each time.
    sample_count : int
        Number of samples in the scene's range; rows outside the range are not counted.
    last : dict of int to SceneRow
        Last rows by sample index, which the next block may share.
    """

    scenes: SteppedScenes
    reading: SteppedReading
    bodies: Collection[int]
    volumes: FarVolumes
    sample_count: int
    last: dict[int, SceneRow] = field(default_factory=dict)

    def read(
        self,
        indices: I64,
        is_posed: Bool,
        effects: Sequence[int],
        in_scene: Collection[int],
        may_be_on: Bool,
    ) -> list[SceneRow]:
        """Read effects at samples, placements of far volumes, and bodies at posed samples.

        Bodies are also posed at samples with any active ``in_scene`` effect. ``may_be_on``
        (N,) selects far volumes.
        """
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            rows.append(row or self._row(index, posed, effects, in_scene, may_be_on))
        self.last = {row.index: row for row in rows[-OVERLAP:]}
        return rows

    def read_bodies(self, indices: I64, is_posed: Bool) -> list[SceneRow]:
        """Read bodies at posed samples; other rows stay empty."""
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            if row is None:
                row = SceneRow(index)
                if posed and self.bodies:
                    self._set_time(row)
                    self._add_bodies(row)
            rows.append(row)
        self.last = {}
        return rows

    def _row(
        self,
        index: int,
        is_posed: bool,
        effects: Sequence[int],
        in_scene: Collection[int],
        may_be_on: Bool,
    ) -> SceneRow:
        """Read one row; the light scene is stepped first unless bodies are certainly needed."""
        stepper = self.scenes.whole if is_posed else self.scenes.light
        row = self.reading.read(index, stepper, effects, ())
        if self.volumes.numbers:
            counters, volumes = self.reading.counters, self.volumes
            row.places = volumes.read(stepper)
            counters.places_read += len(volumes.numbers)
            if 0 <= index < self.sample_count:
                on = volumes.seen_on(row.places.there, may_be_on, stepper)
                counters.on |= dict.fromkeys(on, True)
        is_on = any(not row.effects[k].level <= 0.0 for k in effects if k in in_scene)
        if self.bodies and (is_posed or is_on):
            if stepper is not self.scenes.whole:
                self._set_time(row)
            self._add_bodies(row)
        return row

    def _set_time(self, row: SceneRow) -> None:
        """Step the whole scene to a row's sample."""
        self.reading.read(row.index, self.scenes.whole, (), ())

    def _add_bodies(self, row: SceneRow) -> None:
        """Read bodies at the present time of the whole scene into a row."""
        self.reading.add_poses(row, self.scenes.whole, self.bodies)

    def add_effects(self, rows: Iterable[SceneRow], effects: Iterable[int]) -> None:
        """Add missing effects to rows that were read without them, in place."""
        for row in rows:
            missing = [k for k in effects if k not in row.effects]
            if missing:
                row.effects |= self.reading.read(row.index, self.scenes.light, missing, ()).effects
