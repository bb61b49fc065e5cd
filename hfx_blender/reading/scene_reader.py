# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene reader: the only code that turns Blender's scene into the engine's plain data.

It first reads what does not change (:class:`SceneDescription`), finds from the animation data
when anything can be felt at all, and then reads just those times, in the cheapest way that
gives what Blender gives.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..authoring.effects.effect_values import ShapeCache
from ..blender import linked_files
from ..blender.scene_info import scene_objects
from ..engine.arrays import I64
from ..engine.counters import ReadingCounters, Unfelt
from ..engine.rendering.room import SETTING, PlaySpace
from ..engine.response.paths import NEIGHBOURS
from ..engine.scene import AnimationBlock, HapticVolume, TimeBase
from ..engine.tolerance import EXACT, Tolerance
from ..text import shortened
from .curves.animation_time import animation_frames, time_base
from .description import dormant, play_space, scene_description, unfelt, visibility
from .plan_check import checked, is_same
from .reading_pass import ReadingPass
from .reading_plan import Plan, plan_of
from .stepped import instances, stepping
from .stepped.reached import is_instancer
from .stepped.scene_rows import Row
from .stepped.simulation import Simulation, has_simulation_anywhere, to_bake
from .stepped.stepped_reading import SteppedReading

BLOCK_SIZE = 64
"""Times in a block; blocks start at multiples of it, so that results do not depend on the range."""

_STEPPED_SIZE = 32
"""The same at most where Blender is stepped: evaluation waits for less, and so does who cancels."""


class SceneReader:
    """Reads one scene of the open file.

    Parameters
    ----------
    frames : (first, last), optional
        Frames to read, both included; the scene's own range by default.
    rate_hz : Fraction, optional
        Samples a second; the scene's own setting by default.
    tolerance : Tolerance
        That of the engine, which evaluates what is read; every sample is read exactly.
    with_positions : bool
        Also read the poses of bodies on which nothing but painted effects act.
    with_velocities : bool
        The same, exactly, and the samples before and after each block, so that all of its
        velocities are central differences.
    with_far : bool
        Tell of volumes also where they are near no skin; those that have to be stepped may be
        silent then otherwise.
    is_probed : bool
        Compare a few times with what Blender evaluates, which sets the scene's frame.

    Attributes
    ----------
    found : HapticObjects
        Objects of the scene that take part.
    instances : Instances
    unfelt : dict of str to Unfelt
        Effects of which nothing is felt, as far as that is known before times are read.

    Raises
    ------
    InputError
        The scene cannot be exported: no body, no effects, a fault in one of them.
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
        layer = scene.view_layers[0]
        if scene == bpy.context.scene:
            layer = bpy.context.view_layer
        self._shapes = ShapeCache()
        self._with_velocities = with_velocities
        self._with_far = with_far
        found = scene_description.find(scene, layer)
        self.time = time_base(scene, frames, rate_hz)
        states = zip(found.effects, found.activations, strict=True)
        found = replace(found, dormant=dormant.asleep(scene, self.time, states))
        found = replace(found, simulation=_simulation(found, self.time, self._shapes))
        faults: dict[str, set[int]] = {}
        self.instances = instances.Instances(found, self.time, self._shapes, faults)
        found = replace(found, dormant={**found.dormant, **self.instances.asleep})
        more = self.instances.descriptions
        is_keyed = any(visibility.is_keyed(body) for body in found.bodies)
        self._always_posed = with_positions or with_velocities or bool(more) or is_keyed
        self.found, self.description = scene_description.describe(
            found, self.time, self._shapes, always_posed=self._always_posed, more=more
        )
        self._blinking = [visibility.is_keyed(body) for body in self.found.bodies]
        warned = self.description.warnings
        makers = filter(is_instancer, scene_objects(scene)) if more else ()
        unbaked = to_bake(scene, [*self.found.read, *makers])
        unfelt_warnings = self._find_unfelt(layer)
        warnings = (
            *(*warned, *unfelt_warnings, *self.instances.warnings),
            *(*unbaked, *linked_files.warnings_of_files()),
        )
        self.description = replace(self.description, warnings=shortened(warnings))
        # Objects only; instances are read separately.
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
            isinstance(each.area, HapticVolume) and each.area.has_impacts
            for each in self.description.effects
        )
        self.stepping_note = ""

    def _find_unfelt(self, layer: bpy.types.ViewLayer) -> tuple[str, ...]:
        """Find what is known not to be felt; returns the warnings about it."""
        found = self.found
        states = dict(zip(found.effects, found.activations, strict=True))
        states |= self.instances.activations
        new, lost = unfelt.reasons(found.scene, self.time, states, found.dormant, self.is_part)
        self.unfelt = {**{name: Unfelt(why) for name, why in found.gone.items()}, **new}
        return (
            *unfelt.warnings_of_clips(lost, self.time),
            *(
                f"effect '{name}' {each.reason}: it is not felt"
                for name, each in new.items()
                if not each.is_expected
            ),
            *unfelt.instanced(found.scene, layer),
        )

    @property
    def is_part(self) -> bool:
        """Test for a range of frames that is not the scene's own."""
        scene, time = self.found.scene, self.time
        return (time.frame_first, time.frame_last) != (scene.frame_start, scene.frame_end)

    @property
    def instance_ids(self) -> frozenset[str]:
        """Ids of the effects that are instances or particles."""
        return frozenset(each.id for each in self.instances.descriptions)

    @property
    def counters(self) -> ReadingCounters:
        """Counters of reading, so far."""
        simulation, asleep = self.found.simulation, self.found.dormant.items()
        return replace(
            self._shapes.counters,
            frames_played=0 if simulation is None else simulation.frames_played,
            instances=len(self.instances.descriptions),
            skipped={effect.name: why for effect, why in asleep},
        )

    @property
    def faults(self) -> dict[str, set[int]]:
        """Faults while the scene was read, with their samples."""
        return self._reading.faults

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on values that were corrected, or are likely to be meant otherwise."""
        surfaces = (effect for effect in self.found.effects if effect.hfx.kind == "SURFACE")
        warned = {f"surface '{s.name}': {s.hfx.surface.warning}": s.hfx.surface for s in surfaces}
        warned = {text: s for text, s in warned.items() if s.warning}
        keys = (*self.found.notes, *self.instances.notes)
        return tuple(dict.fromkeys((*keys, *self._shapes.notes, *warned)))

    def play_space_setting(self) -> dict[str, Any]:
        """Play space at all samples, as a track stores it; empty without one."""
        poses = play_space.poses(self.found.scene, self.time, self.found.unit_m)
        return {} if poses is None else {SETTING: PlaySpace.as_setting(poses)}

    def steps(self) -> bool:
        """Test that scenes must be stepped, as not everything follows from F-curves."""
        return bool(plan_of(self.found, self._described, self._shapes).reason)

    @property
    def is_stepped(self) -> bool:
        """Test that Blender steps a scene while this one is read; compared with it before."""
        return bool(self.plan.reason)

    @property
    def sample_indices(self) -> I64:
        """Samples at which something can be felt, ascending."""
        indices = np.arange(self.time.sample_count, dtype=np.int64)
        every = ("PAINTED", "SPOT", "ACTUATORS", *scene_description.IN_SCENE)
        return np.flatnonzero(self._may_be_on(indices, every))

    def _earlier(self, first: int) -> I64:
        """Samples from one below 0 on, before the frames that are read, at which volumes may be
        on."""
        earlier = np.arange(min(first, 0), 0, dtype=np.int64)
        in_scene = [self._is_in_scene(index) for index in earlier.tolist()]
        earlier = earlier[np.array(in_scene, np.bool_)]
        if not len(earlier):
            return earlier
        return earlier[self._may_be_on(earlier, scene_description.IN_SCENE)]

    def _may_be_on(self, indices: I64, kinds: tuple[str, ...]) -> npt.NDArray[np.bool_]:
        """Test that an effect of these kinds can be on, for some samples."""
        frames = scene_description.sample_frames(self.time, indices)
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
        """Reason why the samples must be read one after another, from the first one on.

        None: any part of them, of whole blocks, can be read alone and gives the same.
        """
        plan = self.plan
        return plan.reason if plan.in_own_scene and plan.in_one_go else None

    def blocks(self, part: tuple[int, int] | None = None) -> Generator[AnimationBlock, None, None]:
        """Read blocks of :attr:`sample_indices`; scenes are left unchanged.

        Where volumes can be felt, a block begins with the sample before its own if that is of
        the same stretch of time, so that what moves between two samples can be followed; with
        more on both sides where impacts between two samples are to be found.

        Parameters
        ----------
        part : (first, stop), optional
            Only samples ``first <= index < stop``, both multiples of the block size or the end.
            Below 0 are those before the first frame that is read, as far as the scene has any.
        """
        plan = self.plan
        self.stepping_note = plan.note
        wanted = self.sample_indices
        if part is not None:
            wanted = wanted[(wanted >= part[0]) & (wanted < part[1])]
            wanted = np.concatenate([self._earlier(part[0]), wanted])
        with ExitStack() as stack:
            reading = self.open_pass(stack)
            own = None
            if self.instances.descriptions:
                own = stack.enter_context(self.instances.stepper())
            size = min(BLOCK_SIZE, _STEPPED_SIZE) if plan.reason else BLOCK_SIZE
            for indices in contiguous_blocks(wanted, size):
                first, last = int(indices[0]), int(indices[-1])
                history, future = self._beside(first, last)
                indices = np.arange(first - history, last + future + 1)
                block = self._without_hidden(reading.block(indices, history, future))
                if own is not None:
                    block = self.instances.extended(block, own)
                    self._shapes.counters.times_stepped += len(indices)
                yield block

    def _without_hidden(self, block: AnimationBlock) -> AnimationBlock:
        """Silence effects on a body while it is disabled."""
        found = list(block.effects)
        for pose, body in zip(block.poses, self._described.bodies, strict=True):
            if pose.valid.all():
                continue
            which = [each is body for each in self._described.bodies]
            if any(b and w for b, w in zip(self._blinking, which, strict=True)):
                for k in visibility.felt_on(self._described, which):
                    found[k] = replace(found[k], levels=np.where(pose.valid, found[k].levels, 0.0))
        return replace(block, effects=tuple(found))

    @cached_property
    def plan(self) -> Plan:
        """Plan for all of the samples, whichever of them are read: the cheapest one that agrees
        with the user's own scene at a few times.
        """
        plan = plan_of(self.found, self._described, self._shapes)
        indices = self.sample_indices
        if not self._is_probed or not len(indices):
            return plan
        return checked(plan, self.found, self._described, self._reading, indices, self._agrees)

    def open_pass(
        self, stack: ExitStack, plan: Plan | None = None, spots: I64 | None = None
    ) -> ReadingPass:
        """A pass through the scene by its own plan, or another one, until the stack is left."""
        return ReadingPass(
            plan or self.plan,
            self.found,
            self._described,
            self._reading,
            always_posed=self._always_posed,
            stack=stack,
            spots=spots,
            with_far=self._with_far,
        )

    def _beside(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of samples before and after those of a block that are read with it."""
        impacts = NEIGHBOURS if self._has_impacts else 0
        history = future = 0
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
        if not self._is_in_scene(index - 1):
            return False
        pair = np.array([index - 1, index])
        return self._with_velocities or bool(
            self._may_be_on(pair, scene_description.IN_SCENE).all()
        )

    def _is_in_scene(self, index: int) -> bool:
        """Test that a sample is taken between the scene's first and last frame, which lasts one."""
        end = max(self.found.scene.frame_end, self.time.frame_last) + 1
        return self.time.scene_start <= self.time.frame(index) < end

    def _agrees(self, plan: Plan, truth: list[Row]) -> bool:
        """Test that a plan gives at single times what Blender evaluated."""
        with ExitStack() as stack:
            spots = np.array([row.index for row in truth])
            reading = self.open_pass(stack, plan, spots)
            return all(is_same(row, reading.block(np.array([row.index]))) for row in truth)


def _simulation(
    found: scene_description.HapticObjects, time: TimeBase, shapes: ShapeCache
) -> Simulation | None:
    """Simulation to play through before a scene is read; None if the scene is not stepped, or
    simulates nothing."""
    scene = found.scene
    if not has_simulation_anywhere(scene):
        return None
    is_scratch = stepping.foreign_handler() is None and stepping.why_own_scene(found.read) is None
    if is_scratch and not instances.Sources(found, shapes, time=time).objects:
        return None
    last = animation_frames(scene, np.array([time.frame_last + 1.0]))
    return Simulation(scene, int(np.ceil(last[0])))


def contiguous_blocks(indices: I64, size: int) -> Iterator[I64]:
    """Runs without gaps, cut at multiples of the block size."""
    cuts = np.flatnonzero((np.diff(indices) != 1) | (indices[1:] % size == 0)) + 1
    yield from (block for block in np.split(indices, cuts) if len(block))
