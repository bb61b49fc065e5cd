# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene reader: conversion of a Blender scene into the engine's plain data.

No other code does this. First the constant part is read (:class:`SceneDescription`), then samples
with possible effects are found from animation data, and only these are read by the cheapest plan
that agrees with Blender.
"""

from collections.abc import Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..authoring.effects import effects
from ..authoring.effects.effect_values import ShapeCache
from ..blender import linked_files
from ..engine.arrays import I64
from ..engine.counters import ReadingCounters, Unfelt
from ..engine.rendering.room import SETTING, PlaySpace
from ..engine.response.motion_estimate import NEIGHBOURS
from ..engine.scene import AnimationBlock, HapticVolume
from ..engine.tolerance import EXACT, Tolerance
from ..text import shortened
from .curves.animation_time import animation_frames, sample_frames, time_base
from .description import scene_description, scene_settings, unfelt, visibility
from .description.missed_effects import missed_warnings
from .reading_pass import ReadingPass
from .reading_plan import Plan, checked, is_same, plan_of
from .stepped import instances, stepping
from .stepped.simulation import Simulation, has_simulation_anywhere, to_bake
from .stepped.stepped_reading import SceneRow, SteppedReading

BLOCK_SIZE = 128
"""Largest number of samples in a block. Blocks start at multiples of their size, so that results
do not depend on the range."""

_FEW_EFFECTS = 8  # largest number of effects in the largest blocks, which need more memory


class SceneReader:
    """Reader of a scene of the open file. Raises InputError if the scene has no body or no effects,
    or if all of them are faulty.

    ``frames`` (first and last, both included) and ``rate_hz`` (samples per second) default to the
    scene's settings. ``tolerance`` is that of the engine; reading itself is exact.
    ``with_positions`` reads poses also of bodies with painted effects only; ``with_velocities``
    too, and neighbouring samples of each block, so that all velocities are central differences.
    ``with_far`` reads stepped volumes also while far from skin, instead of leaving them silent.
    ``is_probed`` compares a few times with Blender's evaluation, which sets the scene's frame.

    Attributes: ``found``, the participating objects, ``instances``, ``unfelt``, effects by name
    known before reading not to be felt, and ``files``, the external files of the .blend.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        *,
        frames: tuple[int, int] | None = None,
        rate_hz: Fraction | None = None,
        tolerance: Tolerance = EXACT,
        with_positions: bool = False,
        with_velocities: bool = False,
        with_far: bool = False,
        is_probed: bool = True,
    ) -> None:
        self.tolerance = tolerance
        self._is_probed = is_probed
        # Only the context's scene has a layer that the user chose.
        layer = scene.view_layers[0]
        if scene == bpy.context.scene:
            layer = bpy.context.view_layer
        self._shapes = ShapeCache()
        self._with_velocities = with_velocities
        self._with_far = with_far
        haptics = scene_description.find(scene, layer)
        self.time = time_base(scene, frames, rate_hz)
        states = dict(zip(haptics.effects, haptics.activations, strict=True))
        dormant = unfelt.asleep(scene, self.time, states, haptics.equal)
        haptics = replace(haptics, dormant=dormant)
        # Physics and particles must be played in the user's scene before any reading. A scratch
        # scene without instanced volumes needs neither.
        if has_simulation_anywhere(scene) and (
            stepping.foreign_handler() is not None
            or stepping.why_own_scene(haptics.read) is not None
            or instances.Sources(haptics, self._shapes, time=self.time).objects
        ):
            last = animation_frames(scene, np.array([self.time.frame_last + 1.0]))
            haptics = replace(haptics, simulation=Simulation(scene, int(np.ceil(last[0]))))
        faults: dict[str, set[int]] = {}
        self.instances = instances.Instances(haptics, self.time, self._shapes, faults)
        haptics = replace(haptics, dormant={**haptics.dormant, **self.instances.asleep})
        # Excluded effects with instances are felt at the instances.
        absent, sources = scene_description.ABSENT, self.instances.sources
        gone = {e: why for e, why in haptics.gone.items() if why != absent or e not in sources}
        haptics = replace(haptics, gone=gone)
        more = self.instances.descriptions
        is_keyed = any(visibility.is_keyed(body) for body in haptics.bodies)
        self._always_posed = with_positions or with_velocities or bool(more) or is_keyed
        self.found, self.description = scene_description.describe(
            haptics, self.time, self._shapes, always_posed=self._always_posed, more=more
        )
        self._blinking = [visibility.is_keyed(body) for body in self.found.bodies]
        makers = self.found.instancers if more else ()
        unbaked = to_bake(scene, [*self.found.read, *makers])
        self.files = linked_files.linked_files()
        unfelt_warnings = self._find_unfelt(layer)
        warnings = (
            *(*self.description.warnings, *unfelt_warnings, *self.instances.warnings),
            *(*unbaked, *linked_files.warnings_of_files(self.files)),
        )
        self.description = replace(self.description, warnings=shortened(warnings))
        # Instances have no object of their own, and are appended to each block.
        own = self.description.effects[: len(self.found.effects)]
        self._described = replace(self.description, effects=own)
        self._reading = SteppedReading(
            self.found,
            self._described,
            self._shapes,
            keeps_settings=stepping.foreign_handler() is None,
            faults=faults,
        )
        self._has_impacts = any(
            isinstance(effect.area, HapticVolume) and effect.area.has_impacts
            for effect in self.description.effects
        )
        self.stepping_note = ""

    def _find_unfelt(self, layer: bpy.types.ViewLayer) -> tuple[str, ...]:
        """Set :attr:`unfelt` to reasons by name of effects that are certainly not felt; returns
        warnings about these effects, lost clips and instances. Expected reasons give no warning."""
        haptics = self.found
        states = dict(zip(haptics.effects, haptics.activations, strict=True))
        states |= self.instances.activations
        new, clip_warnings = unfelt.reasons(
            haptics.scene, self.time, states, haptics.dormant, haptics.equal
        )
        gone = {effect: Unfelt(why) for effect, why in haptics.gone.items()}
        names = effects.shown_names({**gone, **new})
        self.unfelt = {names[effect]: why for effect, why in {**gone, **new}.items()}
        return (
            *clip_warnings,
            *missed_warnings(
                (names[effect], reason.reason)
                for effect, reason in new.items()
                if not (reason.is_expected or reason.is_warned)
            ),
            *unfelt.instanced(haptics.scene, layer, haptics.instancers),
        )

    @property
    def counters(self) -> ReadingCounters:
        """Copy of the counters so far, with simulated frames, instances and dormant effects."""
        simulation, asleep = self.found.simulation, self.found.dormant.items()
        return replace(
            self._shapes.counters,
            frames_played=0 if simulation is None else simulation.frames_played,
            instances=len(self.instances.descriptions),
            skipped={effect.name: why for effect, why in asleep},
        )

    @property
    def faults(self) -> dict[str, set[int]]:
        """Faults while reading: message -> sample indices."""
        return self._reading.faults

    @property
    def notes(self) -> tuple[str, ...]:
        """Unique notes on non-finite keys, corrected shapes and doubtful surface settings."""
        surfaces = (effect for effect in self.found.effects if effect.hfx.kind == "SURFACE")
        warned = {f"surface '{s.name}': {s.hfx.surface.warning}": s.hfx.surface for s in surfaces}
        warned = {text: s for text, s in warned.items() if s.warning}
        keys = (*self.found.notes, *self.instances.notes)
        return tuple(dict.fromkeys((*keys, *self._shapes.notes, *warned)))

    def play_space_setting(self) -> dict[str, Any]:
        """Track setting with the play space at all samples; empty without a play space."""
        poses = scene_settings.play_space_poses(self.found.scene, self.time, self.found.unit_m)
        return {} if poses is None else {SETTING: PlaySpace.as_setting(poses)}

    def steps(self) -> bool:
        """True if F-curves alone do not define all values, so that a scene must be stepped. Without
        the comparison with Blender."""
        return bool(plan_of(self.found, self._described, self._shapes).reason)

    @property
    def is_stepped(self) -> bool:
        """True if the plan, after comparison with Blender, steps a scene; see :attr:`plan`."""
        return bool(self.plan.reason)

    @property
    def sample_indices(self) -> I64:
        """Ascending indices in the range at which an effect may be on; instances are volumes."""
        indices = np.arange(self.time.sample_count, dtype=np.int64)
        every = ("PAINTED", "SPOT", "ACTUATORS", *scene_description.IN_SCENE)
        return np.flatnonzero(self._may_be_on(indices, every))

    def _may_be_on(self, indices: I64, kinds: tuple[str, ...]) -> npt.NDArray[np.bool_]:
        """Mask (n,) of sample indices at which an effect of one of the ``kinds`` may be on;
        "VOLUME" includes instances."""
        frames = sample_frames(self.time, indices)
        animation = animation_frames(self.found.scene, frames)
        on = np.zeros(len(indices), np.bool_)
        for effect, state in zip(self.found.effects, self.found.activations, strict=True):
            if on.all():
                break
            if effect.hfx.kind in kinds:
                on |= state.may_be_on(animation)
        if "VOLUME" in kinds:
            on |= self.instances.may_be_on(frames)
        return on

    def why_in_one_go(self) -> str | None:
        """Reason why all samples must be read in order, starting with the first; None if not.
        Without a reason any part made of whole blocks can be read alone with equal results."""
        plan = self.plan
        return plan.reason if plan.in_own_scene and plan.in_one_go else None

    def blocks(self, part: tuple[int, int] | None = None) -> Generator[AnimationBlock, None, None]:
        """Yield blocks of :attr:`sample_indices`; the scene is restored at the end.

        Blocks with volumes start with the sample before their own, if consecutive, for
        motion between samples. With impacts, more samples on both sides are included.

        With ``part`` only samples ``part[0] <= index < part[1]``, both multiples of the block size
        or the end. Negative indices are samples before the first read frame, as far as the scene
        has any.
        """
        plan = self.plan
        self.stepping_note = plan.note
        sample_indices = self.sample_indices
        if part is not None:
            is_inside = (sample_indices >= part[0]) & (sample_indices < part[1])
            # Before the first read frame only volumes and surfaces have effects on later samples.
            earlier = [k for k in range(min(part[0], 0), 0) if self._is_in_scene(k)]
            before = np.array(earlier, np.int64)
            before = before[self._may_be_on(before, scene_description.IN_SCENE)]
            sample_indices = np.concatenate([before, sample_indices[is_inside]])
        with ExitStack() as stack:
            reading = self.open_pass(stack)
            own = None
            if self.instances.descriptions:
                own = stack.enter_context(self.instances.stepper())
            for indices in contiguous_blocks(sample_indices, self._block_size(reading)):
                # Neighbouring samples are read with the block, so that results do not depend on the
                # split of time.
                first, last = int(indices[0]), int(indices[-1])
                history, future = self._beside(first, last)
                indices = np.arange(first - history, last + future + 1)
                block = self._without_hidden(reading.block(indices, history, future))
                if own is not None:
                    block = self.instances.extended(block, own)
                    self._shapes.counters.times_stepped += len(indices)
                yield block

    def _block_size(self, reading: ReadingPass) -> int:
        """Number of samples in a block of a reading pass. Blocks are smaller in stepped scenes
        (effects near skin are read again for a whole block, and evaluation waits for a block), with
        many effects (memory), and with impacts (the report counts the neighbours of blocks)."""
        if reading.stepped_effects:
            return BLOCK_SIZE // 4
        is_small = len(self.description.effects) > _FEW_EFFECTS or self._has_impacts
        return BLOCK_SIZE // 2 if is_small or self.plan.reason else BLOCK_SIZE

    def _without_hidden(self, block: AnimationBlock) -> AnimationBlock:
        """Copy of a block with level 0 for effects on a body at times without a valid pose, if the
        body's visibility is animated."""
        blocks, bodies = list(block.effects), self._described.bodies
        for pose, body, is_keyed in zip(block.poses, bodies, self._blinking, strict=True):
            if is_keyed and not pose.valid.all():
                for k in visibility.felt_on(self._described, [other is body for other in bodies]):
                    levels = np.where(pose.valid, blocks[k].levels, 0.0)
                    blocks[k] = replace(blocks[k], levels=levels)
        return replace(block, effects=tuple(blocks))

    @cached_property
    def plan(self) -> Plan:
        """Cheapest plan for all samples, cached; compared with Blender at a few samples, unless not
        ``is_probed`` or without samples."""
        plan = plan_of(self.found, self._described, self._shapes)
        indices = self.sample_indices
        if not self._is_probed or not len(indices):
            return plan

        def agrees(plan: Plan, truth: list[SceneRow]) -> bool:
            """Test that blocks read by a plan equal rows of Blender's evaluation."""
            with ExitStack() as stack:
                indices = np.array([row.index for row in truth])
                block = self.open_pass(stack, plan, is_comparison=True).block(indices)
                return all(is_same(row, block, n) for n, row in enumerate(truth))

        return checked(plan, self.found, self._described, self._reading, indices, agrees)

    def open_pass(
        self, stack: ExitStack, plan: Plan | None = None, *, is_comparison: bool = False
    ) -> ReadingPass:
        """Start a pass by ``plan`` (default :attr:`plan`), open until ``stack`` closes."""
        return ReadingPass(
            plan or self.plan,
            self.found,
            self._described,
            self._reading,
            always_posed=self._always_posed,
            stack=stack,
            is_comparison=is_comparison,
            with_far=self._with_far,
        )

    def _beside(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of samples before and after a block from ``first`` to ``last`` read with the
        block. One sample before, up to :data:`NEIGHBOURS` more on both sides with impacts, and one
        after for velocities; only within the scene's frames and, before, while volumes or surfaces
        may be on."""
        impacts = NEIGHBOURS if self._has_impacts else 0
        history = future = 0
        # Motion is estimated from neighbours of each sample. Their number is fixed, so that a
        # sample's value is the same in every block and every part of an export.
        while history <= impacts and self._has_history(first - history):
            history += 1
        while future < impacts and self._has_history(last + future + 1):
            if not self._is_in_scene(last + future + 1):
                break
            future += 1
        if self._with_velocities and not future:
            future = int(self._is_in_scene(last + 1))
        return history, future

    def _has_history(self, index: int) -> bool:
        """True if the sample before ``index`` is read with its block: within the scene, and with
        velocities or if a volume or surface may be on at both samples."""
        if not self._is_in_scene(index - 1):
            return False
        pair = np.array([index - 1, index])
        return self._with_velocities or bool(
            self._may_be_on(pair, scene_description.IN_SCENE).all()
        )

    def _is_in_scene(self, index: int) -> bool:
        """True for a sample from the scene's first frame up to, without, the end of the last frame,
        the scene's or the last read."""
        # The last frame lasts a whole frame.
        end = max(self.found.scene.frame_end, self.time.frame_last) + 1
        return self.time.scene_start <= self.time.frame(index) < end


def contiguous_blocks(indices: I64, size: int) -> Iterator[I64]:
    """Yield parts of ascending indices, consecutive, and cut at multiples of ``size``."""
    cuts = np.flatnonzero((np.diff(indices) != 1) | (indices[1:] % size == 0)) + 1
    yield from (block for block in np.split(indices, cuts) if len(block))
