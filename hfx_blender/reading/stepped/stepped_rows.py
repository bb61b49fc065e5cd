# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of one pass: effects and bodies at single times, read from the scenes that are stepped."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field

import bpy

from ...avatars import avatar_meshes
from ...engine.arrays import I64, Bool
from ...engine.response.paths import OVERLAP
from ...engine.scene import SceneDescription, SurfaceBinding
from ..curves.animation_curves import NotModelledError
from ..curves.presampled_rig import PresampledRig
from ..description.scene_description import HapticObjects
from . import stepping
from .scene_rows import Row
from .stepped_reading import SteppedReading
from .stepped_volumes import FarVolumes
from .stepping import Stepper


@dataclass(frozen=True)
class SteppedScenes:
    """Scenes that are stepped: of effects and bodies, and of effects alone; the same one where
    the other would save nothing.
    """

    whole: Stepper
    light: Stepper

    @classmethod
    def own(cls, found: HapticObjects, stack: ExitStack) -> SteppedScenes:
        """The user's own scene, until the stack is left."""
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
        """Scratch scenes of some effects and bodies, until the stack is left; ``rigs`` among the
        bodies are in them as copies.
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
    """Objects that Blender has to evaluate for some effects and bodies, by their numbers."""
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
    if rigs:
        presampled = [rig.obj for rig in rigs]
        others = [obj for obj in objects if obj not in presampled]
        with suppress(NotModelledError):
            return stack.enter_context(stepping.scratch_scene(found.scene, others, rigs))
    return stack.enter_context(stepping.scratch_scene(found.scene, objects))


@dataclass
class SteppedRows:
    """Reads rows of ascending times.

    Attributes
    ----------
    scenes : SteppedScenes
    reading : SteppedReading
    bodies : collection of int
        Bodies that are stepped.
    volumes : FarVolumes
        Their places are read at each time, and who of them is on.
    sample_count : int
        Samples of the scene; others are read beside them.
    last : dict of int to Row
        The last rows by their sample, with which the next block may begin.
    """

    scenes: SteppedScenes
    reading: SteppedReading
    bodies: Collection[int]
    volumes: FarVolumes
    sample_count: int
    last: dict[int, Row] = field(default_factory=dict)

    def read(
        self,
        indices: I64,
        is_posed: Bool,
        effects: Sequence[int],
        in_scene: Collection[int],
        may_be_on: Bool,
    ) -> list[Row]:
        """Read effects at samples, the places of all volumes, and bodies where they are posed.

        Bodies are also posed where any effect that is ``in_scene`` is on. ``may_be_on`` are the
        volumes (N,) that may be.
        """
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            rows.append(row or self._row(index, posed, effects, in_scene, may_be_on))
        self.last = {row.index: row for row in rows[-OVERLAP:]}
        return rows

    def read_bodies(self, indices: I64, is_posed: Bool) -> list[Row]:
        """Read bodies alone where they are posed."""
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            if row is None:
                row = Row(index)
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
    ) -> Row:
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

    def _set_time(self, row: Row) -> None:
        self.reading.read(row.index, self.scenes.whole, (), ())

    def _add_bodies(self, row: Row) -> None:
        """Read bodies at the time that is set already."""
        self.reading.add_poses(row, self.scenes.whole, self.bodies)

    def add_effects(self, rows: Iterable[Row], effects: Iterable[int]) -> None:
        """Read effects at times at which they were not."""
        for row in rows:
            missing = [k for k in effects if k not in row.effects]
            if missing:
                row.effects |= self.reading.read(row.index, self.scenes.light, missing, ()).effects
