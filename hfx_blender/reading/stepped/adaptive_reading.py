# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive reading of poses: as few as a tolerance needs, interpolated linearly.

Stretches of time are divided on a grid that does not depend on the range that is read. In each
part the ends are read and the middle; where the middle is farther from the straight line than
the tolerance, both halves are divided on. Smooth motion is then off by a quarter of it; what may
swing faster than these poses show is read at every sample, see :mod:`.slow_motion`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel
from ...engine.scene import SkinBinding
from ...engine.tolerance import Tolerance
from .scene_rows import PoseRow

_LONGEST_S = Fraction(5, 100)
"""Longest time between two poses that are read, seconds: any swing back within it is noticed."""

_NEAR_M = 0.2
"""Vertices this near to a volume count: they stand for their neighbours on the same bone."""

Poses = dict[int, PoseRow]


def grid_step(rate_hz: Fraction) -> int:
    """Samples between points of the grid, a power of two."""
    step = 1
    while 2 * step <= rate_hz * _LONGEST_S:
        step *= 2
    return step


@dataclass(frozen=True, eq=False)
class Span:
    """Span of samples whose ends and middle were read."""

    low: int
    middle: int
    high: int
    cell: tuple[int, int]  # of the grid, the first and the last sample


class AdaptivePoses:
    """Poses of bodies at samples of ascending indices, most of them interpolated.

    Parameters
    ----------
    read : callable
        Reads the bodies at a sample.
    stretch_of : callable
        The first and the last sample of the stretch without gaps that a sample is in. Nothing
        is interpolated over its ends.
    allows : callable
        Whether it does not matter what a straight line leaves out over a span.
    step : int
        Samples between points of the grid.
    offset : int
        Added to indices before they are laid on the grid, so that the grid is the scene's.
    """

    def __init__(
        self,
        read: Callable[[int], Poses],
        stretch_of: Callable[[int], tuple[int, int]],
        allows: Callable[[Span], bool],
        step: int,
        offset: int,
    ) -> None:
        self._read = read
        self._stretch_of = stretch_of
        self._allows = allows
        self._step = step
        self._offset = offset
        self._cell = (0, -1)
        self._known: dict[int, Poses] = {}
        self._nodes: list[int] = []

    def bones(self, index: int, body: int) -> F64:
        """Bones of a body at a sample that was read, in the world, (B, 3, 4)."""
        found = self._pose(index)[body].bones
        assert found is not None
        return found.astype(np.float64)

    def at(self, index: int) -> Poses:
        """The bodies at a sample."""
        if not self._cell[0] <= index <= self._cell[1]:
            self._enter(index)
        if index in self._known:
            return self._known[index]
        place = bisect_right(self._nodes, index)
        low, high = self._nodes[place - 1], self._nodes[place]
        return self._between(low, high, index)

    def _enter(self, index: int) -> None:
        """Go to the part of the grid that holds a sample, and divide it as far as is needed."""
        first, last = self._stretch_of(index)
        start = (index + self._offset) // self._step * self._step - self._offset
        low, high = max(start, first), min(start + self._step, last)
        self._cell = (low, high)
        self._known = {k: poses for k, poses in self._known.items() if k in (low, high)}
        for end in (low, high):
            self._pose(end)
        self._divide(low, high)
        self._nodes = sorted(self._known)

    def _divide(self, low: int, high: int) -> None:
        if high - low < 2:
            return
        middle = (low + high) // 2
        self._pose(middle)
        if not self._allows(Span(low, middle, high, self._cell)):
            self._divide(low, middle)
            self._divide(middle, high)

    def _pose(self, index: int) -> Poses:
        if index not in self._known:
            read = self._read(index)
            self._known[index] = {k: _in_world(pose) for k, pose in read.items()}
        return self._known[index]

    def _between(self, low: int, high: int, index: int) -> Poses:
        share = (index - low) / (high - low)
        ends = self._known[low], self._known[high]
        return {k: pose.between(ends[1][k], share) for k, pose in ends[0].items()}


def _in_world(pose: PoseRow) -> PoseRow:
    """Pose with its bones in the world, so that vertices between two poses move straight."""
    assert pose.bones is not None
    bones = pose.to_world[:3, :3] @ pose.bones.astype(np.float64)
    bones[..., 3] += pose.to_world[:3, 3]
    return PoseRow(np.eye(4), bones)


@dataclass(frozen=True, eq=False)
class Volume:
    """Volume that may be felt over a part of the grid."""

    model_id: str
    low: F64  # (3,) of its world box over the whole part
    high: F64  # (3,)
    matrices: F64  # (S, 4, 4) shape space to world at each sample of the part


class VertexMotion:
    """Error of straight interpolation between two poses, at some vertices of each bone.

    It is accepted where no volume is near, where it is less than the tolerance in space, and
    where the vertex covers as much within half of the tolerance in time, seen from the volume.

    Parameters
    ----------
    model : PerceptualModel
        As it stands on the body, with positions in its rest space.
    binding : SkinBinding
    tolerance : Tolerance
    """

    def __init__(self, model: PerceptualModel, binding: SkinBinding, tolerance: Tolerance) -> None:
        index = {name: k for k, name in enumerate(binding.bone_names)}
        bone_of = np.array([index.get(name, -1) for name in model.bone_names], np.int64)
        weights = model.weights
        vertices = _ends_of_bones(model)
        counts = np.diff(weights.offsets)[vertices]
        self._starts = np.cumsum(counts) - counts
        within = np.arange(counts.sum()) - np.repeat(self._starts, counts)
        entries = np.repeat(weights.offsets[vertices], counts) + within
        self._bones = bone_of[weights.bones[entries]]
        rest = np.repeat(np.insert(model.vertices[vertices], 3, 1.0, axis=1), counts, axis=0)
        self._weighted = (weights.values[entries, None] * rest).astype(np.float64)
        # Vertices stand about as far apart as the sides of their equal triangles are long.
        spacing = np.sqrt(model.areas_m2[vertices] * (2.0 / np.sqrt(3.0)))
        self._allowed = np.array([tolerance.edge_m(each) for each in spacing.tolist()])
        self._time_s = tolerance.time_s / 2
        self._known: dict[int, F64] = {}

    def _places(self, bones: F64) -> F64:
        """World positions of the vertices, (V, 3), for bones (B, 3, 4) in the world."""
        parts = np.einsum("nij,nj->ni", bones[self._bones], self._weighted)
        found: F64 = np.add.reduceat(parts, self._starts, axis=0)
        return found

    def allows(
        self, span: Span, bones: Callable[[int], F64], volumes: Sequence[Volume], period_s: float
    ) -> bool:
        """Test that the interpolation error of everything near a volume is accepted.

        ``bones`` gives them at the samples of the span, in the world.
        """
        if not volumes:
            return True
        for known in list(self._known):
            if not span.cell[0] <= known <= span.cell[1]:
                del self._known[known]
        for index in (span.low, span.middle, span.high):
            if index not in self._known:
                self._known[index] = self._places(bones(index))
        first, true, last = (self._known[k] for k in (span.low, span.middle, span.high))
        share = (span.middle - span.low) / (span.high - span.low)
        off = np.linalg.norm(true - (first + (last - first) * share), axis=1)
        if not np.isfinite(off).all():
            return False
        doubtful = np.flatnonzero(off > self._allowed)
        for volume in volumes:
            if not len(doubtful):
                return True
            at = true[doubtful]
            near = ((at >= volume.low - _NEAR_M) & (at <= volume.high + _NEAR_M)).all(axis=1)
            mine = doubtful[near]
            if not len(mine):
                continue
            start, end = (volume.matrices[k - span.cell[0]] for k in (span.low, span.high))
            carried = end @ np.linalg.pinv(start)  # where the volume's motion would take them
            still = first[mine] @ carried[:3, :3].T + carried[:3, 3]
            way = np.linalg.norm(last[mine] - still, axis=1)
            speed = way / ((span.high - span.low) * period_s)
            if (off[mine] > speed * self._time_s).any():
                return False
        return True


def _ends_of_bones(model: PerceptualModel) -> npt.NDArray[np.int64]:
    """Vertices at the ends of bones: nearly the farthest apart of those that a bone moves most."""
    weights = model.weights
    counts = np.diff(weights.offsets)
    largest = np.repeat(np.maximum.reduceat(weights.values, weights.offsets[:-1]), counts)
    entries = np.flatnonzero(weights.values == largest)[::-1]  # of several, the first one counts
    strongest = np.zeros(len(model), np.int64)
    strongest[np.repeat(np.arange(len(model)), counts)[entries]] = weights.bones[entries]
    ends: set[int] = set()
    for bone in np.unique(strongest).tolist():
        mine = np.flatnonzero(strongest == bone)
        places = model.vertices[mine]
        axis = int(np.ptp(places, axis=0).argmax())
        ends |= {int(mine[places[:, axis].argmin()]), int(mine[places[:, axis].argmax()])}
    return np.array(sorted(ends), np.int64)
