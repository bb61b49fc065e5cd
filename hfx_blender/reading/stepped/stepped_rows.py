# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of one reading pass: effects and bodies at single times from stepped scenes."""

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
from .stepped_reading import SceneRow, SteppedReading
from .stepped_volumes import FarVolumes
from .stepping import Stepper


def scratch_scenes(
    found: HapticObjects,
    scene: SceneDescription,
    effects: Sequence[int],
    bodies: Sequence[int],
    rigs: Sequence[PresampledRig],
    stack: ExitStack,
) -> tuple[Stepper, Stepper]:
    """Steppers of two scratch scenes, open until the stack is closed: of effects and bodies by
    index, and of the effects alone. Without effects or without bodies the first is returned twice.

    Copies replace the bodies of ``rigs``, unless another object depends on a rig."""
    objects = objects_of(found, scene, effects, bodies)
    whole = None
    if rigs:
        presampled = [rig.obj for rig in rigs]
        others = [obj for obj in objects if obj not in presampled]
        # An object that follows a rig needs the original: then the scene without copies below
        # serves.
        with suppress(NotModelledError):
            whole = stack.enter_context(stepping.scratch_scene(found.scene, others, rigs))
    whole = whole or stack.enter_context(stepping.scratch_scene(found.scene, objects))
    if not effects or not bodies:
        return whole, whole
    alone = stepping.scratch_scene(found.scene, [found.effects[k] for k in effects])
    return whole, stack.enter_context(alone)


def objects_of(
    found: HapticObjects, scene: SceneDescription, effects: Iterable[int], bodies: Iterable[int]
) -> list[bpy.types.Object]:
    """Objects of effects, then bodies by index, then avatar meshes of surface-bound bodies."""
    bodies = list(bodies)
    surfaces = (k for k in bodies if isinstance(scene.bodies[k].binding, SurfaceBinding))
    meshes = (mesh for k in surfaces for mesh in avatar_meshes.meshes_of(found.bodies[k]))
    return [*(found.effects[k] for k in effects), *(found.bodies[k] for k in bodies), *meshes]


@dataclass
class SteppedRows:
    """Reader of rows in the order of time.

    ``whole`` steps bodies and effects, ``light`` effects only; the same stepper if a second scene
    saves nothing. ``bodies`` are indices of stepped bodies; placements of ``volumes`` are read at
    each time. Rows outside the ``sample_count`` samples of the range are not counted. ``last``
    holds the last rows by sample index, for the next block.
    """

    whole: Stepper
    light: Stepper
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
        """Rows at sample indices (T,): effects, placements of far volumes, and bodies where
        ``is_posed``. Bodies are also read where any effect of ``in_scene`` has a level above 0 or
        NaN. ``may_be_on`` (N,) selects far volumes whose activity is counted. The last rows are
        reused and kept."""
        # Neighbouring blocks overlap, and each step of Blender is costly.
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            rows.append(row or self._row(index, posed, effects, in_scene, may_be_on))
        self.last = {row.index: row for row in rows[-OVERLAP:]}
        return rows

    def read_bodies(self, indices: I64, is_posed: Bool) -> list[SceneRow]:
        """Rows at sample indices (T,) with bodies where ``is_posed``; further new rows are empty.
        Rows of the last block are reused, none are kept for the next."""
        rows = []
        for index, posed in zip(indices.tolist(), is_posed.tolist(), strict=True):
            row = self.last.get(index)
            if row is None and posed and self.bodies:
                row = self.reading.read(index, self.whole, (), self.bodies)
            rows.append(row or SceneRow(index))
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
        """Read one new row. The light scene is stepped, unless ``is_posed``; the whole scene only
        if bodies turn out to be needed."""
        stepper = self.whole if is_posed else self.light
        row = self.reading.read(index, stepper, effects, ())
        if self.volumes.numbers:
            counters, volumes = self.reading.counters, self.volumes
            row.places = volumes.read(stepper)
            counters.places_read += len(volumes.numbers)
            if 0 <= index < self.sample_count:
                on = volumes.seen_on(row.places.there, may_be_on, stepper)
                counters.on |= dict.fromkeys(on, True)
        # "not <= 0" instead of "> 0": NaN counts as on, and the engine reports it.
        is_on = any(not row.effects[k].level <= 0.0 for k in effects if k in in_scene)
        if self.bodies and (is_posed or is_on):
            if stepper is not self.whole:
                self.reading.read(index, self.whole, (), ())
            self.reading.add_poses(row, self.whole, self.bodies)
        return row

    def add_effects(self, rows: Iterable[SceneRow], effects: Iterable[int]) -> None:
        """Add missing effects by index to rows, in place, by stepping the light scene again."""
        for row in rows:
            missing = [k for k in effects if k not in row.effects]
            if missing:
                row.effects |= self.reading.read(row.index, self.light, missing, ()).effects
