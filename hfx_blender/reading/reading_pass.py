# SPDX-License-Identifier: GPL-3.0-or-later
"""One reading pass over the times of a scene, by a plan: blocks of animation.

Stepped effects and bodies are read at single times; of volumes far from skin only placements.
"""

from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from ..engine.arrays import F64, I64, Bool
from ..engine.scene import (
    AnimationBlock,
    EffectBlock,
    HapticVolume,
    Motion,
    PoseBlock,
    SceneDescription,
)
from .curves.animation_time import ExactFrames, animation_frames, sample_frames
from .curves.curve_reading import CurveBody, CurveEffect, EffectChunks
from .description import response_values
from .description.scene_description import HapticObjects
from .reading_plan import Plan
from .stepped import stepping
from .stepped.stepped_reading import SceneRow, SteppedReading, effect_block, pose_block, silence
from .stepped.stepped_rows import SteppedRows, scratch_scenes
from .stepped.stepped_volumes import FarVolumes


class ReadingPass:
    """One pass over the times of a scene; scenes are stepped until ``stack`` is closed.

    ``always_posed``: pose bodies at all times, also without effects that need poses.
    ``is_comparison``: read distant samples in one block, without volumes that need no comparison.
    ``with_far``: read stepped volumes also while far from skin.

    Attributes hold indices in the scene description: ``stepped_effects`` and ``stepped_bodies``,
    other active objects being read from F-curves (``curves``); ``dormant`` effects, never read;
    ``in_scene``, active effects that need posed bodies. ``rows`` reads the stepped objects, and is
    None without any.
    """

    def __init__(
        self,
        plan: Plan,
        haptics: HapticObjects,
        scene: SceneDescription,
        reading: SteppedReading,
        *,
        always_posed: bool,
        stack: ExitStack,
        is_comparison: bool = False,
        with_far: bool = False,
    ) -> None:
        self.plan = plan
        read = {*plan.effects, *plan.bounded_numbers}
        self.stepped_effects = tuple(k for k in haptics.active if k not in read)
        self.stepped_bodies = tuple(k for k in range(len(haptics.bodies)) if k not in plan.bodies)
        self.dormant = tuple(sorted({*range(len(haptics.effects))}.difference(haptics.active)))
        # Surfaces count as volumes.
        self.in_scene = frozenset(k for k in haptics.active if scene.effects[k].kind == "volume")
        self.always_posed, self._is_comparison = always_posed, is_comparison
        self.counters = reading.counters
        # Of bounded volumes only those near skin are asked for.
        made = plan.effects.get
        self.curves = EffectChunks(lambda k: made(k) or plan.bounded.effect(k), self._frames)
        self._bounded_on = {scene.effects[k].id: True for k in plan.bounded_numbers}
        self._modalities = [effect.modality for effect in scene.effects]
        self._exact_frames = ExactFrames.of(haptics.scene, scene.time)
        self._key_indices: dict[CurveEffect | CurveBody, F64] = {}
        areas = [effect.area for effect in scene.effects]
        self._impacts = {
            k for k, area in enumerate(areas) if isinstance(area, HapticVolume) and area.has_impacts
        }
        self.found = haptics
        self.scene = scene
        self._reading = reading
        is_judged = not is_comparison and not plan.is_sequential and not with_far
        # None: judge by boxes. In a comparison no row has bounded volumes.
        self._are_bounded_near = False if is_comparison else with_far or None
        # Comparisons need placements and values only, so boxes replace meshes.
        reading.far = frozenset(self.stepped_effects if is_comparison else ())
        self.far_volumes = FarVolumes(haptics, scene, self.stepped_effects if is_judged else ())
        self.rows = self._stepped_rows(stack)

    def _stepped_rows(self, stack: ExitStack) -> SteppedRows | None:
        """Reader of stepped rows in the user's scene or in scratch scenes, open until ``stack``
        closes; None if all objects are read from F-curves."""
        effects, bodies = self.stepped_effects, self.stepped_bodies
        if self.plan.in_own_scene:
            whole = light = stack.enter_context(stepping.own_scene(self.found))
        elif effects or bodies:
            rigs = [*self.plan.presampled.values()]
            whole, light = scratch_scenes(self.found, self.scene, effects, bodies, rigs, stack)
        else:
            return None
        count = self.scene.time.sample_count
        return SteppedRows(whole, light, self._reading, bodies, self.far_volumes, count)

    def _frames(self, indices: I64) -> F64:
        """Animation frames (n,) of sample indices (n,)."""
        return animation_frames(self.found.scene, sample_frames(self.scene.time, indices))

    @np.errstate(invalid="ignore", over="ignore")  # the engine reports NaN
    def block(self, indices: I64, history: int = 0, future: int = 0) -> AnimationBlock:
        """Read all effects and poses at consecutive sample indices (T,), in index order; at any in
        a comparison. The first ``history`` and the last ``future`` samples belong to the
        neighbouring blocks."""
        frames, count = self._frames(indices), len(indices)
        effects = self._from_curves(indices, frames)
        may_be_on = self.far_volumes.may_be_on(frames)
        is_posed = self._times_on(effects, count) | may_be_on.any(axis=0) | self.always_posed
        is_posed |= bool(self.plan.bounded_numbers)  # always on
        # Far volumes that are off in this block start over as far ones; the other far volumes are
        # read in full if they were near skin in the last block.
        far, volumes_on = self.far_volumes, may_be_on.any(axis=1)
        far.in_full -= {k for k, on in zip(far.numbers, volumes_on, strict=True) if not on}
        placed_only = {*far.numbers} - far.in_full
        in_full = [k for k in self.stepped_effects if k not in placed_only]
        if self.rows is None:
            rows = [SceneRow(index) for index in indices.tolist()]
        elif in_full or volumes_on.any():
            rows = self.rows.read(indices, is_posed, in_full, self.in_scene, volumes_on)
        else:
            rows = self.rows.read_bodies(indices, is_posed)
        effects |= {k: self._effect_of(k, rows) for k in in_full}
        effects |= self._silent(self.dormant, count)
        # Stepped levels are known only now; bodies are also posed where these effects are on.
        is_posed |= self._times_on({k: effects[k] for k in in_full}, count)
        poses = self._poses(frames, is_posed, rows)
        own = rows[history : len(rows) - future]
        effects |= self._bounded_effects(indices, poses, own)
        effects |= self._far_effects(rows, poses, volumes_on, own)
        return AnimationBlock(
            indices=indices,
            effects=tuple(effects[k] for k in range(len(effects))),
            poses=tuple(poses),
            history=history,
            future=future,
        )

    def _from_curves(self, indices: I64, frames: F64) -> dict[int, EffectBlock]:
        """Blocks by index of the effects read from F-curves, with continuous sine phases; with
        impacts also motion between samples and key indices."""
        if self._is_comparison:  # a chunk around each distant sample would cost 256 times as much
            effects = {k: effect.read(frames) for k, effect in self.plan.effects.items()}
        else:
            effects = {k: self.curves.read(k, indices) for k in self.plan.effects}
        for k, effect in effects.items():
            if effect.response is not None:
                response = response_values.with_even_phase(
                    self.found.scene,
                    self.found.effects[k],
                    effect.response,
                    sample_frames(self.scene.time, indices),
                    self.scene.time,
                )
                effects[k] = replace(effect, response=response)
            # The moment and speed of an impact are searched between samples, on the exact curves.
            if k in self._impacts:
                curves = self.plan.effects[k]
                effects[k] = replace(
                    effects[k], matrices_at=self._at(curves.matrices), keys=self._keys(curves)
                )
        return effects

    def _at(self, motion: Motion) -> Motion:
        """Function of fractional sample indices, from ``motion`` as a function of animation
        frames."""
        return lambda indices: motion(self._exact_frames.at(indices))

    def _keys(self, curves: CurveEffect | CurveBody) -> F64:
        """Fractional sample indices (k,) of an effect's or a body's keys, ascending, cached."""
        if curves not in self._key_indices:
            self._key_indices[curves] = self._exact_frames.indices(curves.key_frames)
        return self._key_indices[curves]

    def _times_on(self, effects: dict[int, EffectBlock], count: int) -> Bool:
        """Mask (T,) of times with a level above 0 or NaN among the given effects that need posed
        bodies."""
        on = np.zeros(count, np.bool_)
        for k in self.in_scene & effects.keys():
            # Negated, so that NaN counts as on and is reported by the engine.
            on |= ~(effects[k].levels <= 0.0)
        return on

    def _poses(self, frames: F64, is_posed: Bool, rows: list[SceneRow]) -> list[PoseBlock]:
        """Pose blocks of all bodies by index: of bodies moved by F-curves at animation frames (T,),
        posed where the mask ``is_posed`` (T,) is True; of stepped bodies from their rows. With
        impacts, F-curve bodies also get motion between samples and keys."""
        poses = {k: body.read(frames, is_posed) for k, body in self.plan.bodies.items()}
        if self._impacts:
            for k, body in self.plan.bodies.items():
                poses[k] = replace(
                    poses[k],
                    to_world_at=self._at(body.to_world),
                    bones_at=self._at(body.rig.pose),
                    keys=self._keys(body),
                )
        for k in self.stepped_bodies:
            poses[k] = pose_block([row.poses.get(k) for row in rows])
        return [poses[k] for k in range(len(poses))]

    def _far_effects(
        self, rows: list[SceneRow], poses: list[PoseBlock], may_be_on: Bool, own: list[SceneRow]
    ) -> dict[int, EffectBlock]:
        """Blocks of far volumes by index: silent if far from skin or off, in full if near. Near
        volumes with constant settings need placements only, the rest is read in a second pass, and
        in the first pass of later blocks until far again. ``own`` are the rows without those of
        neighbouring blocks; these are counted as skipped for far volumes."""
        # Skin of the whole block is known only after posing, so far volumes are judged last.
        far, reading, far_blocks = self.far_volumes, self._reading, dict[int, EffectBlock]()
        is_near = may_be_on
        if is_near.any():
            places = far.places(rows)
            # A volume counts as near if its swept box overlaps the skin of any body in the block.
            is_near = is_near & far.are_near(places, poses)
        nearby = {k for k, near in zip(far.numbers, is_near, strict=True) if near}
        reread = [k for k in far.numbers if k in nearby - far.in_full and not reading.is_settled(k)]
        for n, k in enumerate(far.numbers):
            if k not in nearby:
                skipped = reading.counters.far.setdefault(self.scene.effects[k].name, {})
                skipped[str(own[0].index)] = len(own)
                if k not in far.in_full:
                    far_blocks[k] = silence(len(rows), self._modalities[k])
            elif reading.is_settled(k):
                far_blocks[k] = reading.placed(k, places.matrices[:, n], places.there[:, n])
        if reread and self.rows is not None:
            self.rows.add_effects(rows, reread)
            far_blocks |= {k: self._effect_of(k, rows) for k in reread}
        far.in_full = {k for k in nearby if not reading.is_settled(k)}
        return far_blocks

    def _bounded_effects(
        self, indices: I64, poses: list[PoseBlock], own: list[SceneRow]
    ) -> dict[int, EffectBlock]:
        """Blocks of bounded volumes by index at sample indices (T,): in full near skin, else
        silent, and counted for the rows ``own``."""
        bounded, count = self.plan.bounded, len(indices)
        if bounded is None:
            return {}
        near = np.full(len(bounded.numbers), bool(self._are_bounded_near))
        if self._are_bounded_near is None:
            near = bounded.are_near(poses)
        blocks = self._silent(bounded.numbers, count)
        for k in np.array(bounded.numbers)[near].tolist():
            is_keyed = k in bounded.keyed
            blocks[k] = self.curves.read(k, indices) if is_keyed else bounded.still_block(k, count)
        self.counters.on |= self._bounded_on
        if not self._is_comparison:
            self.counters.out_of_reach[str(own[0].index)] = int((~near).sum()) * len(own)
        return blocks

    def _silent(self, numbers: Collection[int], count: int) -> dict[int, EffectBlock]:
        """Blocks of effects by index that are off at ``count`` times."""
        blocks = {name: silence(count, name) for name in set(self._modalities)}
        return {k: blocks[self._modalities[k]] for k in numbers}

    def _effect_of(self, which: int, rows: list[SceneRow]) -> EffectBlock:
        """Block of stepped effect ``which`` from rows, all with the effect."""
        return effect_block([row.effects[which] for row in rows], self._modalities[which])
