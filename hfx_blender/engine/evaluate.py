# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates an animated scene into per-vertex haptic samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from .active_rows import active_rows, warn_of_controls, warn_of_point, with_directions
from .areas.allocentric import AllocentricAreas
from .areas.egocentric import EgocentricAreas
from .areas.on_demand import ON_DEMAND, ON_DEMAND_HERE
from .areas.sample_run_builder import SampleRunBuilder
from .arrays import I64
from .body.model import PerceptualModel, load_model
from .contact.block_broad_phase import BlockBroadPhase
from .counters import Counters
from .native import library
from .response.answering import Answering
from .samples import SampleRun
from .scene import (
    ActuatorArea,
    AnimationBlock,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    SceneDescription,
    SpotArea,
)
from .skin.bound_skins import BoundSkins
from .tolerance import STANDARD, Tolerance

if TYPE_CHECKING:
    from concurrent.futures import Executor


_SLOW: Final = (
    "without the compiled part of HFX, what volumes touch was computed by its definition, "
    "some 500 times as slowly (measured on the garage scene)"
)


class Engine:
    """Evaluates one scene, block by block, and does only what its active effects require.

    Parameters
    ----------
    record : iterable of str
        What samples carry besides vertices and weights: any of ``ON_DEMAND`` and
        ``ON_DEMAND_HERE``.
    models : callable
        Loads a perceptual model by its id; called at the first moment it is needed.
    tolerance : Tolerance
        The error that is accepted; ``PAPER`` tests vertices, all others sample their skin.
    threads : int
        How many look at skin while this one goes on, where the compiled part is there; 1: none.
        The results are the same.
    """

    def __init__(
        self,
        scene: SceneDescription,
        *,
        record: Iterable[str] = (),
        models: Callable[[str], PerceptualModel] = load_model,
        tolerance: Tolerance = STANDARD,
        threads: int = 1,
    ) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.counters = Counters()
        self.touched: set[str] = set()  # ids of volumes with a response that a body was in
        self.record = wanted = frozenset(record)
        known = ON_DEMAND | ON_DEMAND_HERE
        if not wanted <= known:
            raise ValueError(f"record: expected some of {sorted(known)}, got {record}")
        self._skins = BoundSkins(models, tolerance, self.counters)
        self.responses = Answering(scene)
        builder = SampleRunBuilder(scene, wanted, self._skins, self.counters)
        self._egocentric = EgocentricAreas(builder)
        self._threads = _threads(threads)
        self._allocentric = AllocentricAreas(builder, self.responses, self._threads)

    @property
    def has_threads(self) -> bool:
        """Test for threads that look at skin while this one goes on."""
        return self._threads is not None

    @property
    def notes(self) -> tuple[str, ...]:
        """Facts for a report that hold for all blocks."""
        return (_SLOW,) if self.scene.has_volumes and not library.is_there() else ()

    def evaluate(self, block: AnimationBlock) -> list[SampleRun]:
        """Evaluate a block: one run of samples for each effect and body with any."""
        return self.begin(block)()

    def evaluated(
        self, blocks: Iterable[AnimationBlock]
    ) -> Generator[tuple[AnimationBlock, list[SampleRun]], None, None]:
        """Yield blocks with their samples, in their order.

        With threads, which go on working meanwhile, a block is begun before the samples of the
        one before it are given on. Counters hold what was given on.
        """
        begun: deque[tuple[AnimationBlock, Callable[[], list[SampleRun]], Counters]] = deque()
        for block in blocks:
            before = self.counters.copy()
            ended = self.begin(block)
            begun.append((block, ended, self.counters.since(before)))
            self.counters.go_back(before)
            if self._threads is None or len(begun) > 1:
                yield self._ended(*begun.popleft())
        while begun:
            yield self._ended(*begun.popleft())

    def _ended(
        self, block: AnimationBlock, ended: Callable[[], list[SampleRun]], counted: Counters
    ) -> tuple[AnimationBlock, list[SampleRun]]:
        self.counters.add(counted)
        return block, ended()

    def begin(self, block: AnimationBlock) -> Callable[[], list[SampleRun]]:
        """Begin to :meth:`evaluate` a block; the returned function, called once, gives the samples.

        Other threads work on it meanwhile. Blocks must be begun, and ended, in their order.
        """
        block = with_directions(self.scene.effects, block, self.counters)
        effects = list(zip(self.scene.effects, block.effects, strict=True))
        rows_of = active_rows(self.scene.effects, block, self.counters)
        is_active = np.zeros(len(block.indices), np.bool_)
        for rows in rows_of:
            is_active[rows] = True
        count = int(np.count_nonzero(is_active))
        self.counters.times_evaluated += count
        self.counters.times_skipped += len(block.own_indices) - count
        for body, pose in zip(self.scene.bodies, block.poses, strict=True):
            warn_of_point(is_active, pose, body, self.counters)
        reach = BlockBroadPhase(block, self.scene.bodies, self._skins)
        begun = [
            self._begin(effect, animated, rows, block, reach)
            for (effect, animated), rows in zip(effects, rows_of, strict=True)
            if len(rows)
        ]

        def ended() -> list[SampleRun]:
            runs = [run for each in begun for run in each() if run is not None]
            self.counters.contacts += sum(run.contact_count for run in runs)
            return runs

        return ended

    def _begin(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
        reach: BlockBroadPhase,
    ) -> Callable[[], list[SampleRun | None]]:
        """Begin one effect at the rows where it is on; each kind of area has its own method.

        What changes a kind of area is decided here; what changes all samples of an effect,
        whatever its area (a filter of its response), goes over the runs before they are returned.
        """
        area, bodies = effect.area, self.scene.bodies
        if isinstance(area, HapticVolume):
            warn_of_controls(effect, animated, rows, self.counters)
            begun = [
                self._allocentric.volume(effect, area, animated, rows, body, block, reach)
                for body in bodies
            ]

            def ended() -> list[SampleRun | None]:
                felt = [each() for each in begun]
                if not area.response:
                    return felt
                if any(run is not None for run in felt):
                    self.touched.add(effect.id)
                return [
                    self._allocentric.answered(effect, animated, rows, body, block, reach, run)
                    for body, run in zip(bodies, felt, strict=True)
                ]

            return ended
        if isinstance(area, PaintedArea):
            found = [self._egocentric.painted(effect, area, animated, rows, block)]
        elif isinstance(area, SpotArea):
            found = [self._egocentric.spot(effect, area, animated, rows, block)]
        elif isinstance(area, ActuatorArea):
            found = [self._egocentric.actuators(effect, area, animated, rows, block)]
        else:
            found = [
                self._allocentric.surface(effect, animated, rows, body, block, reach)
                for body in bodies
            ]
        return lambda: found


def _threads(count: int) -> Executor | None:
    """Thread pool of an engine; None where threads would have nothing to do."""
    if count < 2 or not library.is_there():
        return None
    from concurrent.futures import ThreadPoolExecutor  # Blender's start does not wait for it

    return ThreadPoolExecutor(count, "hfx")
