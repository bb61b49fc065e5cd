# SPDX-License-Identifier: GPL-3.0-or-later
"""One pass through the times of a scene, as its plan says: blocks of what is where.

Effects and bodies that are stepped are read at single times; of volumes among them that are
near no skin only the places.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import replace

import bpy
import numpy as np

from ..authoring.responses import responses
from ..avatars import avatar_meshes
from ..engine.arrays import F64, I64, Bool
from ..engine.response.paths import OVERLAP
from ..engine.scene import (
    AnimationBlock,
    EffectBlock,
    PoseBlock,
    SceneDescription,
    SurfaceBinding,
)
from .curves.animation_curves import NotModelledError
from .curves.animation_time import animation_frames
from .curves.curve_reading import EffectChunks
from .description import response_values
from .description.scene_description import IN_SCENE, HapticObjects, sample_frames
from .reading_plan import Plan
from .stepped import stepping
from .stepped.nearness import SkinBoxes, may_meet
from .stepped.scene_rows import Places, Row, effect_block, pose_block, silence
from .stepped.stepped_reading import SteppedReading
from .stepped.stepped_volumes import SteppedVolumes, near, over_time


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


class Pass:
    """One pass through the times of a scene, or through few single ones (``spots``, ascending).

    Volumes that have to be stepped are silent while they are near no skin, unless ``with_far``.
    """

    def __init__(
        self,
        plan: Plan,
        found: HapticObjects,
        scene: SceneDescription,
        reading: SteppedReading,
        *,
        always_posed: bool,
        stack: ExitStack,
        spots: I64 | None = None,
        with_far: bool = False,
    ) -> None:
        self._plan = plan
        self._found = found
        self._scene = scene
        self._reading = reading
        self._always_posed = always_posed
        self._effects = [k for k in found.active if k not in plan.effects]
        self._dormant = sorted({*range(len(found.effects))}.difference(found.active))
        self._bodies = [k for k in range(len(found.bodies)) if k not in plan.bodies]
        self._volumes = [k for k in found.active if found.effects[k].hfx.kind in IN_SCENE]
        self._chunks = EffectChunks(plan.effects, self._frames, spots=spots)
        goes_back = not plan.is_sequential and not with_far
        self._is_judged = goes_back and spots is None
        # Of meshes only boxes are read where places and values are compared.
        reading.far = frozenset(() if spots is None else self._effects)
        stepped = self._effects if self._is_judged else []
        self._placed = SteppedVolumes({k: found.effects[k] for k in stepped})
        placed = self._placed.numbers
        self._far = dict(enumerate(placed))  # of which only the place is read, by their number
        self._not_seen_on = dict(self._far)
        self._idle_now: set[int] = set()  # of those, in the present block
        self._full = [k for k in self._effects if k not in placed]
        model_ids = {scene.effects[k].model_id for k in placed}
        self._skins = [SkinBoxes(body, model_ids) for body in scene.bodies if placed]
        self._outlined = self._skins_of_surfaces()
        self._unread = set(self._outlined)  # of these: near no volume, only bounds are read
        self._last: dict[int, Row] = {}  # the last ones, which the next block may begin with
        self._whole = self._light = None
        if plan.in_own_scene:
            self._whole = self._light = stack.enter_context(stepping.own_scene(found))
        elif self._effects or self._bodies:
            stepped = [found.effects[k] for k in self._effects]
            needed = objects_of(found, scene, self._effects, self._bodies)
            self._whole = self._light = self._scratch(needed, stack)
            if stepped and self._bodies:
                self._light = stack.enter_context(stepping.scratch_scene(found.scene, stepped))

    def _skins_of_surfaces(self) -> dict[int, SkinBoxes]:
        """Bodies that follow their mesh, whose bounds can tell that no volume reaches them."""
        volumes = [self._found.effects[k].hfx for k in self._volumes]
        if not self._is_judged or self._always_posed:
            return {}
        if any(hfx.kind != "VOLUME" or responses.active(hfx) for hfx in volumes):
            return {}
        model_ids = {self._scene.effects[k].model_id for k in self._volumes}
        bodies = self._scene.bodies
        surfaces = (k for k in self._bodies if isinstance(bodies[k].binding, SurfaceBinding))
        return {k: SkinBoxes(bodies[k], model_ids) for k in surfaces}

    def _scratch(self, objects: list[bpy.types.Object], stack: ExitStack) -> stepping.Stepper:
        """Step these objects; rigs that are presampled as copies."""
        scene, rigs = self._found.scene, list(self._plan.presampled.values())
        if rigs:
            presampled = [rig.obj for rig in rigs]
            others = [obj for obj in objects if obj not in presampled]
            with suppress(NotModelledError):
                return stack.enter_context(stepping.scratch_scene(scene, others, rigs))
        return stack.enter_context(stepping.scratch_scene(scene, objects))

    def _effects_at(self, index: int, stepper: stepping.Stepper) -> Row:
        """Values of effects at one time."""
        row = self._reading.read(index, stepper, self._full, ())
        if self._far:
            row.places = self._placed.read(stepper)
            self._reading.counters.places_read += len(self._placed)
            if 0 <= index < self._scene.time.sample_count:
                self._look_who_is_on(row.places, stepper)
        return row

    def _look_who_is_on(self, places: Places, stepper: stepping.Stepper) -> None:
        """Note which volumes are on of those of which only the place is read, each once."""
        for n, k in [*self._not_seen_on.items()]:
            if k in self._idle_now or not places.there[n]:
                continue
            evaluated = stepper.evaluated(self._found.effects[k])
            is_there = evaluated.is_evaluated and not evaluated.hide_viewport
            if is_there and self._found.activations[k].level(evaluated.hfx) > 0.0:
                self._reading.counters.on[self._scene.effects[k].id] = True
                del self._not_seen_on[n]

    def _frames(self, indices: I64) -> F64:
        """Frames of the animation at samples."""
        return animation_frames(self._found.scene, sample_frames(self._scene.time, indices))

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is told by the engine
    def block(self, indices: I64, history: int = 0, future: int = 0) -> AnimationBlock:
        """Poses and places at samples without a gap between them."""
        frames = self._frames(indices)
        effects: dict[int, EffectBlock] = {
            k: self._chunks.read(k, indices) for k in self._plan.effects
        }
        for k, effect in effects.items():
            if effect.response is not None:
                effects[k] = replace(
                    effect,
                    response=response_values.with_even_phase(
                        self._found.scene,
                        self._found.effects[k],
                        effect.response,
                        sample_frames(self._scene.time, indices),
                        self._scene.time,
                    ),
                )
        wanted = np.full(len(indices), self._always_posed)
        for k in self._volumes:
            if k in effects:
                wanted |= ~(effects[k].levels <= 0.0)
        self._idle_now = idle = self._idle(frames, wanted)
        self._full = [k for k in self._full if k not in idle]
        is_stepped = len(idle) < len(self._effects)
        rows = [
            self._row(int(i), w, is_stepped) for i, w in zip(indices, wanted.tolist(), strict=True)
        ]
        self._last = {row.index: row for row in rows[-OVERLAP:]} if is_stepped else {}
        for k in self._full:
            effects[k] = self._block_of(k, rows)
            if k in self._volumes:
                wanted |= ~(effects[k].levels <= 0.0)
        effects |= {k: self._silence(k, len(indices)) for k in self._dormant}
        poses: dict[int, PoseBlock] = {
            k: body.read(frames, wanted) for k, body in self._plan.bodies.items()
        }
        for k in self._bodies:
            read = (row.outlines if k in self._outlined else row.poses for row in rows)
            poses[k] = pose_block([each.get(k) for each in read])
        own = rows[history : len(rows) - future]
        if self._far:
            bodies = [poses[k] for k in range(len(poses))]
            effects |= self._read_near_ones(rows, bodies, idle, own)
        for k in self._outlined:
            poses[k] = self._surface(k, rows, poses[k], [effects[each] for each in self._volumes])
            if k in self._unread:
                self._reading.count_far(self._scene.bodies[k].name, own[0].index, len(own))
        return AnimationBlock(
            indices=indices,
            effects=tuple(effects[k] for k in range(len(effects))),
            poses=tuple(poses[k] for k in range(len(poses))),
            history=history,
            future=future,
        )

    def _idle(self, frames: F64, wanted: Bool) -> set[int]:
        """Volumes that can be judged by their places, and are off at all of these frames.

        ``wanted`` is set where the others may be on.
        """
        idle = set()
        for k in self._far.values():
            on = self._found.activations[k].may_be_on(frames)
            wanted |= on
            if not on.any():
                idle.add(k)
        return idle

    def _read_near_ones(
        self, rows: list[Row], poses: list[PoseBlock], idle: set[int], own: list[Row]
    ) -> dict[int, EffectBlock]:
        """Volumes of which only the places were read: of those that come near skin, the rest.

        What has to be read again is read in full from now on, until it is far again.
        """
        is_near = np.array([k not in idle for k in self._far.values()])
        if is_near.any():
            skins = [skin.over(pose) for skin, pose in zip(self._skins, poses, strict=True)]
            places = over_time([row.places for row in rows if row.places is not None])
            is_near &= near(places, self._found.unit_m, skins)
        again: list[int] = []
        found: dict[int, EffectBlock] = {}
        for n, k in self._far.items():
            if not is_near[n]:
                self._reading.count_far(self._scene.effects[k].name, own[0].index, len(own))
                if k not in self._full:
                    found[k] = self._silence(k, len(rows))
            elif self._reading.is_settled(k):
                found[k] = self._reading.placed(k, places.matrices[:, n], places.there[:, n])
            elif k not in self._full:
                again.append(k)
        if again:
            self._complete(rows, again)
            found |= {k: self._block_of(k, rows) for k in again}
        nearby = {k for n, k in self._far.items() if is_near[n]}
        full = {k for k in nearby if not self._reading.is_settled(k)}
        self._full = [k for k in self._effects if k in full or k not in self._far.values()]
        return found

    def _complete(self, rows: list[Row], which: list[int]) -> None:
        """Read effects in full at times at which they were not."""
        for row in rows:
            missing = [k for k in which if k not in row.effects]
            if missing and self._light is not None:
                row.effects |= self._reading.read(row.index, self._light, missing, ()).effects

    def _surface(
        self, which: int, rows: list[Row], outline: PoseBlock, volumes: list[EffectBlock]
    ) -> PoseBlock:
        """A body that follows its mesh: not there where no volume reaches its bounds.

        Else it is read in full from now on, until it is far again.
        """
        skin = self._outlined[which].over(outline)
        if not any(may_meet(each, skin) for each in volumes):
            self._unread.add(which)
            return pose_block([None] * len(rows))
        self._unread.discard(which)
        for row in rows:
            if which in row.outlines and which not in row.poses and self._whole is not None:
                row.poses |= self._reading.read(row.index, self._whole, (), [which]).poses
        return pose_block([row.poses.get(which) for row in rows])

    def _block_of(self, which: int, rows: list[Row]) -> EffectBlock:
        return effect_block([row.effects[which] for row in rows], self._modality(which))

    def _silence(self, which: int, count: int) -> EffectBlock:
        """An effect that is not felt."""
        return silence(count, self._modality(which))

    def _modality(self, which: int) -> str:
        return self._scene.effects[which].modality

    def _row(self, index: int, is_posed: bool, is_stepped: bool) -> Row:
        """Stepped values at one time; of effects nothing unless ``is_stepped``."""
        if index in self._last:
            return self._last[index]
        row = Row(index)
        joint = is_posed or self._light is self._whole
        stepper = self._whole if joint else self._light
        if is_stepped and stepper is not None:
            row = self._effects_at(index, stepper)
            is_posed |= any(
                not row.effects[k].level <= 0.0 for k in self._full if k in self._volumes
            )
        if not is_posed or not self._bodies:
            return row
        if self._whole is not None and not (is_stepped and joint):
            self._reading.read(index, self._whole, (), ())
            stepper = self._whole
        if stepper is not None:
            read = (k for k in self._bodies if k not in self._unread)
            self._reading.add_poses(row, stepper, read)
            self._reading.add_outlines(row, stepper, self._outlined)
        return row
