# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates an animated scene into per-vertex haptic samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import islice
from typing import TYPE_CHECKING, Final

import numpy as np

from .active_rows import ActiveEffect, active_rows, warn_of_controls, warn_of_point, with_directions
from .areas.allocentric import AllocentricAreas
from .areas.egocentric import EgocentricAreas
from .areas.sample_run_builder import ON_DEMAND, ON_DEMAND_HERE, SampleRunBuilder
from .body.model import PerceptualModel, load_model
from .contact.broad_phase import BlockBroadPhase
from .counters import Counters
from .native import library
from .response.answering import Answering
from .samples import SampleRun
from .scene import (
    ActuatorArea,
    AnimationBlock,
    HapticVolume,
    PaintedArea,
    SceneDescription,
    SpotArea,
)
from .skin.cell_coverage import BoundSkins
from .tolerance import STANDARD, Tolerance

if TYPE_CHECKING:
    from concurrent.futures import Executor

_MOST_BEGUN: Final = 16
"""Largest number of effects in work: each holds weights of the skin within reach, at all rows."""

_MOST_PREPARED: Final = 4
"""Largest number of bodies whose tables of skin are computed early; each takes about 30 ms."""

_SLOW: Final = (
    "without the compiled part of HFX, what volumes touch was computed by its definition, "
    "some 500 times as slowly (measured on the garage scene)"
)


class Engine:
    """Evaluates a scene in blocks of animation.

    Models, skins and poses are loaded and computed only for active effects. ``record`` names
    optional fields of samples, of ``ON_DEMAND`` and ``ON_DEMAND_HERE``; ValueError for another.
    ``models`` loads a perceptual model by id, on first use. ``tolerance`` is the accepted error;
    ``PAPER`` tests vertices only, other tolerances sample the skin. ``threads`` is the number of
    worker threads for the compiled library, 1 without threading; results are equal. ``before`` is
    the engine of an earlier description of the scene, whose models and skins are used further.
    """

    def __init__(
        self,
        scene: SceneDescription,
        *,
        record: Iterable[str] = (),
        models: Callable[[str], PerceptualModel] = load_model,
        tolerance: Tolerance = STANDARD,
        threads: int = 1,
        before: Engine | None = None,
    ) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.counters = Counters()
        self.touched: set[str] = set()  # ids of surfaces, and volumes with a response, with contact
        self.record = fields = frozenset(record)
        allowed = ON_DEMAND | ON_DEMAND_HERE
        if not fields <= allowed:
            raise ValueError(f"record: expected some of {sorted(allowed)}, got {record}")
        self._skins = BoundSkins(models, tolerance, self.counters)
        if before is not None:
            self._skins.keep(before._skins, scene.bodies)
        self.responses = Answering(scene)
        builder = SampleRunBuilder(scene, fields, self._skins, self.counters)
        self._egocentric = EgocentricAreas(builder)
        self._threads: Executor | None = None
        if threads > 1 and library.is_there():
            from concurrent.futures import ThreadPoolExecutor  # imported late for Blender's start

            self._threads = ThreadPoolExecutor(threads, "hfx")
        self._allocentric = AllocentricAreas(builder, self.responses, self._threads)

    @property
    def has_threads(self) -> bool:
        """True with worker threads."""
        return self._threads is not None

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence for a report if volumes are evaluated without the compiled library, or ""."""
        return (_SLOW,) if self.scene.has_volumes and not library.is_there() else ()

    def prepare(self) -> None:
        """Compute the tables of skin of the first four bodies for the volumes of the scene, so that
        no frame of a live scene waits. Other tables are computed at the first contacts. No effect
        without the compiled library."""
        if library.is_there():
            volumes = [e for e in self.scene.effects if isinstance(e.area, HapticVolume)]
            for model_id in sorted({volume.model_id for volume in volumes}):
                for body in self.scene.bodies[:_MOST_PREPARED]:
                    self._skins.of(body, model_id).fill()

    def evaluate(self, block: AnimationBlock) -> list[SampleRun]:
        """Samples of a block: a run for each effect and body with any sample, in the order of the
        effects, then bodies."""
        return [*self.begin(block)]

    def evaluated(
        self, blocks: Iterable[AnimationBlock]
    ) -> Generator[tuple[AnimationBlock, Iterator[SampleRun]], None, None]:
        """Yield (block, sample runs) for each block, in order; runs are computed as they are taken,
        and those not taken before the next block are dropped. With threads, the next block is begun
        before the samples of a block are yielded; a block with many active effects is evaluated
        alone. The counters include only yielded blocks."""
        begun: deque[tuple[AnimationBlock, Iterator[SampleRun], Counters]] = deque()

        def finished(most: int) -> Iterator[tuple[AnimationBlock, Iterator[SampleRun]]]:
            """Yield blocks with their samples until at most ``most`` are in work."""
            while len(begun) > most:
                block, runs, counted = begun.popleft()
                self.counters.add(counted)
                yield block, runs
                deque(runs, 0)

        for block in blocks:
            active = sum(bool((effect.levels > 0.0).any()) for effect in {*block.effects})
            waiting = int(self._threads is not None and active <= _MOST_BEGUN)
            yield from finished(waiting)
            # Counts of a begun block are held back until its samples are yielded.
            before = self.counters.copy()
            runs = self.begin(block)
            begun.append((block, runs, self.counters.since(before)))
            self.counters.go_back(before)
            yield from finished(waiting)
        yield from finished(0)

    def begin(self, block: AnimationBlock) -> Iterator[SampleRun]:
        """Begin to :meth:`evaluate` a block; returns an iterator that finishes its effects one by
        one. Worker threads compute in between. Blocks must be begun and finished in order."""
        block = with_directions(self.scene.effects, block, self.counters)
        effects = list(zip(self.scene.effects, block.effects, strict=True))
        rows_of = active_rows(self.scene.effects, block, self.counters)
        is_active = np.zeros(len(block.indices), np.bool_)
        for rows in filter(len, rows_of):
            is_active[rows] = True
        count = int(np.count_nonzero(is_active))
        self.counters.times_evaluated += count
        self.counters.times_skipped += len(block.own_indices) - count
        # Warnings count rows of this block once, not once for each effect.
        for body, pose in zip(self.scene.bodies, block.poses, strict=True):
            warn_of_point(is_active, pose, body, self.counters)
        reach = BlockBroadPhase(block, self.scene.bodies, self._skins)
        unbegun = (
            ActiveEffect(effect, animated, rows, block)
            for (effect, animated), rows in zip(effects, rows_of, strict=True)
            if len(rows)
        )
        # Several effects are begun before the first is finished, so that the threads have work.
        begun = deque(self._begin(active, reach) for active in islice(unbegun, _MOST_BEGUN))

        def finished() -> Iterator[SampleRun]:
            while begun:
                begun.extend(self._begin(active, reach) for active in islice(unbegun, 1))
                for run in begun.popleft()():
                    if run is not None:
                        self.counters.contacts += run.contact_count
                        yield run

        return finished()

    def _begin(
        self, active: ActiveEffect, reach: BlockBroadPhase
    ) -> Callable[[], list[SampleRun | None]]:
        """Begin an effect at the active rows; returns a function to finish it. The function
        returns a list of runs, of each body or of a single body, None without samples. Contact
        responses act on finished runs."""
        effect, bodies = active.effect, self.scene.bodies
        area = effect.area
        if isinstance(area, HapticVolume):
            warn_of_controls(effect, active.animated, active.rows, self.counters)
            begun = [self._allocentric.volume(active, area, body, reach) for body in bodies]

            def finish() -> list[SampleRun | None]:
                # A response follows contacts over time: also without a contact in this block.
                contact_runs = [finish_body() for finish_body in begun]
                if not area.response:
                    return contact_runs
                if any(run is not None for run in contact_runs):
                    self.touched.add(effect.id)
                return [
                    self._allocentric.answered(active, body, reach, run)
                    for body, run in zip(bodies, contact_runs, strict=True)
                ]

            return finish
        if isinstance(area, PaintedArea):
            runs = [self._egocentric.painted(active, area)]
        elif isinstance(area, SpotArea):
            runs = [self._egocentric.spot(active, area)]
        elif isinstance(area, ActuatorArea):
            runs = [self._egocentric.actuators(active, area)]
        else:
            runs = [self._allocentric.surface(active, body, reach) for body in bodies]
            self.touched |= self._allocentric.surfaces.touched
        return lambda: runs
