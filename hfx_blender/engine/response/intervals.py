# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample intervals: motion within, and contacts at steps of the intervals."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64, Bool
from ..contact.reachable_bounds import bounds_of
from ..samples import SampleRun
from ..scene import EffectBlock, Motion, PoseBlock
from .grazes import Contacts, follow_on
from .motion_estimate import NEIGHBOURS, MotionEstimate
from .touches import BodyPlaces, Moments, Touches

_MOST_STEPS: Final = 100  # per interval, for rates below 20 Hz
_LEAST_SHARE: Final = 1e-6  # fraction of an interval: nearer to an end is the end


@dataclass(frozen=True, eq=False)
class TouchedSets:
    """Touched skin at k moments between samples, with vertex sets as in SampleRun."""

    rows: I64  # (k,) of the samples after the moments
    times_s: F64  # (k,)
    set_of: I64  # (k,) set numbers
    offsets: I64
    vertices: I32
    weights: F32


@dataclass(frozen=True, eq=False)
class IntervalSteps:
    """Contacts without filters at S + 1 steps of each of n intervals, both ends included."""

    run: SampleRun | None
    rows: I64  # (k,) flat step indices with a sample in the run, interval by interval
    which: I64  # (n,) interval numbers
    chosen: I64  # (n,) rows at the intervals' ends
    times_s: F64  # (n, S + 1)
    shares: F64  # (n, S + 1) fractions of the intervals
    sums: F64  # (n, S + 1) sums of the weights

    @property
    def is_touched(self) -> Bool:
        """Mask (n, S + 1) of steps with a weight sum above 0; False at the start, which belongs to
        the sample before."""
        touched = self.sums > 0.0
        touched[:, 0] = False
        return touched

    @property
    def sets(self) -> list[TouchedSets]:
        """Touched skin at steps strictly inside the intervals, as a single list entry; an empty
        list without contacts."""
        if self.run is None:
            return []
        inside = (self.rows % self.shares.shape[1] > 0) & (self.shares.ravel()[self.rows] < 1.0)
        which, run = self.rows[inside] // self.shares.shape[1], self.run
        rows, times = self.chosen[which], self.times_s.ravel()[self.rows[inside]]
        sets = run.set_of[inside], run.offsets, run.vertices, run.weights
        return [TouchedSets(rows, times, *sets)]

    def strengths(self, slow: F64) -> F64:
        """Weight sums (n, S + 1) times exp(-fraction / ``slow``): decay since the interval's start.
        ``slow`` (N,) are time constants of all N intervals, as fractions of their lengths."""
        return np.asarray(self.sums * np.exp(-self.shares / slow[self.which, None]))


class Intervals:
    """Sample intervals and the motion within.

    ``chosen`` (n,) are indices, among the rows of the moments, of the intervals' ends;
    ``parameters`` (T, P) the effect's. ``is_straight``: motion is linear between samples;
    ``with_passages``: contacts of a step include those since the step before.
    """

    def __init__(
        self,
        moments: Moments,
        chosen: I64,
        parameters: F64,
        contacts: Contacts,
        *,
        is_straight: bool,
        with_passages: bool,
    ) -> None:
        self._moments = moments
        self._parameters = parameters
        self._own_paths: dict[tuple[str, int, int, int], MotionEstimate] = {}
        self._own_motion: dict[tuple[str, int, bytes], F64] = {}
        self._contacts = contacts
        self._is_straight, self._with_passages = is_straight, with_passages
        self.chosen = chosen
        self._rows = moments.rows[chosen]
        self.lengths_s = moments.times_s[self._rows] - moments.times_s[self._rows - 1]
        follows = np.concatenate([follow_on(moments), [False]])
        # Numbers of known samples on both sides, the interval's own ends included.
        self._before = 1 + _chain(follows, chosen, -1, is_straight)
        self._after = 1 + _chain(follows, chosen + 1, 1, is_straight)

    def times_s(self, which: I64, shares: F64) -> F64:
        """Times (n,) in seconds at fractions ``shares`` (n,) of the intervals numbered ``which``
        (n,)."""
        ends = self._moments.times_s[self._rows[which]]
        return np.asarray(ends - (1.0 - shares) * self.lengths_s[which])

    def shares(self, steps_s: F64) -> F64:
        """Fractions (n, S) of each interval, ascending: 0, whole multiples of ``steps_s`` (n,)
        since time zero, keys of volume and pose, and 1. At most 100 multiples; shorter rows are
        padded with 1."""
        which, lengths_s = np.arange(len(self.chosen)), self.lengths_s
        starts_s = self.times_s(which, np.zeros(len(which)))
        # Multiples of the same steps at each rate: contacts of few samples of skin change abruptly,
        # so that other moments would have other maxima.
        steps_s = np.maximum(steps_s, lengths_s / _MOST_STEPS)
        first = np.floor(starts_s / steps_s) + 1.0
        numbers = np.arange(np.ceil((lengths_s / steps_s).max()))
        multiples = (first[:, None] + numbers) * steps_s[:, None]
        grid = (multiples - starts_s[:, None]) / lengths_s[:, None]
        keyed = [block.keys for block in (self._moments.effect, self._moments.pose)]
        keys = np.concatenate([np.zeros(0), *(values for values in keyed if values is not None)])
        at_keys = keys - (self._moments.indices[self._rows, None] - 1.0)
        inside = np.concatenate([grid, at_keys], axis=1)
        is_inside = (inside > _LEAST_SHARE) & (inside < 1.0 - _LEAST_SHARE)
        inside = np.sort(np.where(is_inside, inside, 1.0), axis=1)
        ends = np.broadcast_to([0.0, 1.0], (len(inside), 2))
        # Cuts the padding common to all rows.
        inside = inside[:, : int(is_inside.sum(axis=1).max(initial=0))]
        return np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1)

    def steps(self, which: I64, shares: F64) -> IntervalSteps:
        """Contacts without filters at fractions ``shares`` (n, S + 1), or (S + 1,) for all, of the
        intervals numbered ``which`` (n,)."""
        shares = np.broadcast_to(shares, (len(which), shares.shape[-1]))
        closer = self._closer(which, shares)
        run = self._contacts(closer, (closer.rows % shares.shape[1] != 0) & self._with_passages)
        sums, rows = np.zeros(shares.size), np.zeros(0, np.int64)
        if run is not None:
            rows = np.searchsorted(closer.indices, run.indices)
            sums[rows] = weight_sums(run)
        times = closer.times_s.reshape(shares.shape)
        sums = sums.reshape(shares.shape)
        return IntervalSteps(run, rows, which, self.chosen[which], times, shares, sums)

    def answered(self, which: I64, shares: F64, step: F64, run: SampleRun, sets: I64) -> Touches:
        """Touches with filters at one fraction (n,) of each interval numbered ``which`` (n,).
        Speeds are means over ``step`` (n,), fractions of the intervals. ``sets`` (n,) are the set
        numbers in ``run``, whose contacts have no filters."""
        closer = self._closer(which, np.stack([shares - np.minimum(step, shares), shares], axis=1))
        rows = closer.rows[1::2]
        touched = replace(
            run,
            indices=closer.indices[rows],
            times_s=closer.times_s[rows],
            levels=closer.effect.levels[rows],
            parameters=closer.effect.parameters[rows],
            sets=sets,
        )
        touches = replace(closer, rows=rows).touches(run.stream, closer.effect.parameters, touched)
        assert touches is not None  # a stack with impacts has all times
        return touches

    def _closer(self, which: I64, shares: F64) -> Moments:
        """Moments at fractions ``shares`` (n, S + 1) of the intervals ``which``, as rows of a block
        of their own: n times S + 1 rows, levels and controls linear, parameters of the interval's
        end."""
        moments, count = self._moments, shares.shape[1]
        effect, pose = moments.effect, moments.pose
        assert effect.matrices is not None
        ends = np.repeat(self._rows[which], count)
        s = shares.ravel()
        matrices = self._motion("matrices", effect.matrices, effect.matrices_at, which, shares)
        to_world = self._motion("to_world", pose.to_world, pose.to_world_at, which, shares)
        bones: F64 | None = None
        surface: F32 | None = None
        if pose.bones is not None:
            bones = self._motion("bones", pose.bones, pose.bones_at, which, shares)
        if pose.surface is not None:
            skin = self._motion("surface", pose.surface, None, which, shares)
            surface = skin.astype(np.float32)
        response = effect.response
        if response is not None:
            mix = s[:, None, None]
            # Levels and controls change slowly: linear interpolation is enough.
            response = (1.0 - mix) * response[ends - 1] + mix * response[ends]
        between_ends = EffectBlock(
            (1.0 - s) * effect.levels[ends - 1] + s * effect.levels[ends],
            self._parameters[ends],
            np.ascontiguousarray(matrices),
            effect.shapes,
            None if effect.shape_index is None else effect.shape_index[ends],
            response=response,
        )
        posed = PoseBlock(np.ones(len(s), np.bool_), np.ascontiguousarray(to_world), bones, surface)
        rows = np.arange(len(s))
        times = moments.times_s
        return replace(
            moments,
            effect=between_ends,
            rows=rows,
            # A missing index parts the intervals, so that no step continues another interval.
            indices=rows + rows // count,
            times_s=times[ends - 1] + (times[ends] - times[ends - 1]) * s,
            posed=rows,
            pose=posed,
            bounds=bounds_of(moments.skin, posed, rows),
            places=BodyPlaces(moments.skin, posed, rows),
        )

    def _motion(
        self, name: str, values: F64 | F32, at: Motion | None, which: I64, shares: F64
    ) -> F64:
        """Values (n S, ...) at fractions (n, S) of the intervals ``which``, from samples (T, ...).
        Computed by ``at``, a function of fractional sample indices; estimated if ``at`` is None or
        motion is straight."""
        # The common case: a volume or a body at rest needs no estimate, and a broadcast takes no
        # memory.
        if len(values) and (values == values[0]).all():
            still = values[0].astype(np.float64)
            return np.broadcast_to(still, (shares.size, *still.shape))
        if self._is_straight or at is None:
            paths = [self._path(name, values, n) for n in which.tolist()]
            parts = [path.at(mine) for path, mine in zip(paths, shares, strict=True)]
            read = np.concatenate(parts)
            is_matrix = values.shape[1:] == (4, 4)  # packed in columns
            return (
                read.transpose(0, 2, 1) if is_matrix else read.reshape(len(read), *values.shape[1:])
            )
        # All volumes share the motion of a body, so its values are cached with the body's
        # positions.

        known = self._own_motion if name == "matrices" else self._moments.places.motion
        rows = self._rows[which].tolist()
        # Shares of an interval are part of the key, because fine steps differ between volumes.
        keys = [(name, row, mine.tobytes()) for row, mine in zip(rows, shares, strict=True)]
        missing = [k for k, key in enumerate(keys) if key not in known]
        if missing:
            starts = self._moments.indices[self._rows[which[missing]] - 1]
            # All missing intervals in one call: an evaluation of curves has a high fixed cost.
            computed = at((starts[:, None] + shares[missing]).ravel())
            parts = np.split(computed, len(missing))
            known.update(zip([keys[k] for k in missing], parts, strict=True))
        return np.concatenate([known[key] for key in keys])

    def _path(self, name: str, values: F64 | F32, n: int) -> MotionEstimate:
        """Motion estimate in interval ``n`` from the samples ``values`` (T, ...), cached by
        ``name`` and interval; linear if motion is straight."""
        known = self._own_paths if name == "matrices" else self._moments.places.paths
        row, before, after = (int(counts[n]) for counts in (self._rows, self._before, self._after))
        key = name, row, before, after
        if key not in known:
            known[key] = MotionEstimate(
                [_packed(values[row - 1 - k]) for k in range(before)],
                [_packed(values[row + k]) for k in range(after)],
            )
        return known[key]


def weight_sums(run: SampleRun) -> F64:
    """Sum of vertex weights (n,) of each sample of a run."""
    return np.asarray(np.add.reduceat(run.weights, run.offsets[:-1], dtype=np.float64)[run.set_of])


def _packed(value: F64 | F32) -> F64:
    """Rows (N, D) of a matrix (4 columns), of bones (B, 12) or of points (A, 3); rows move
    independently. Columns let an axis keep rotating while the origin bounces."""
    if value.shape == (4, 4):
        return value.T.astype(np.float64)
    return value.reshape(len(value), -1).astype(np.float64)


def _chain(follows: Bool, at: I64, way: int, is_straight: bool) -> I64:
    """Counts (n,), 0 to :data:`NEIGHBOURS`, of samples beyond an interval's end without a gap; 0 if
    ``is_straight``. ``follows`` masks rows that continue the row before. Counted are successive
    True from row ``at`` - 1 downwards for ``way`` -1, and from row ``at`` upwards for 1; none below
    row 0."""
    count, known = np.zeros(len(at), np.int64), np.full(len(at), not is_straight)
    for k in range(NEIGHBOURS):
        neighbour = at - 1 - k if way < 0 else at + k
        known = known & follows[np.clip(neighbour, 0, len(follows) - 1)] & (neighbour >= 0)
        count += known
    return count
