# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of a body's skin with a volume: the inside fraction of each cell.

The weight of a vertex is the mean strength of the volume over the cell. Contacts between two
samples count at the later sample: the largest fraction that was inside at one moment, for cells
without contact at the earlier sample.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..scene import EffectBlock, PoseBlock, SkinBinding, SurfaceBinding
from ..volume.shape import Falloff, Shape
from .boundary import nearest
from .cells import EXACT, Fineness, Samples, Skin, cells_of, vertex_samples
from .pose import is_rotating, moved, placement_between, world_points
from .shapes import strength
from .sweep import along, passage

_WHOLE: Final = 1.0 - 1e-9  # a sum of fractions that equals 1 up to rounding
_LOOKED_UP: Final = 5  # positions of a passage with a strength lookup
_TURNING_STEPS: Final = 64


@dataclass(frozen=True, eq=False)
class Body:
    """Skin of a posed body, sampled in cells, or at vertices only with ``fineness`` None."""

    skin: Skin
    binding: SkinBinding | SurfaceBinding
    pose: PoseBlock
    fineness: Fineness | None = EXACT
    cells: I64 | None = None  # only cells that may be in contact; None: all

    def samples(self) -> Iterator[Samples]:
        """Yield the samples of ``cells``, or of all cells, in blocks with whole cells; with
        ``fineness`` None one sample per vertex of the model."""
        if self.fineness is None:
            yield vertex_samples(self.skin.model)
        else:
            yield from cells_of(self.skin, self.fineness).samples(self.cells)

    def world_points(self, row: int, samples: Samples | None = None) -> F64:
        """World positions (3, N) of samples at a row of the pose, or (3, V) of the model's vertices
        for None; metres."""
        if samples is None:
            return world_points(self.skin.model, self.binding, self.pose, row)
        points = world_points(self.skin.surface, self.binding, self.pose, row)
        handedness = np.sign(np.linalg.det(self.pose.to_world[row, :3, :3]))
        return samples.posed(points, float(handedness))


@dataclass(frozen=True, eq=False)
class Volume:
    """Volume of an effect with a placing matrix and a shape at each row."""

    effect: EffectBlock
    falloff: Falloff

    def shape(self, row: int) -> Shape:
        """Shape at a row."""
        return self.effect.shapes[int(self.effect.shapes_at(np.array([row]))[0])]

    def matrix(self, row: int) -> F64:
        """Shape space to world (4, 4) at a row, metres."""
        assert self.effect.matrices is not None
        matrix: F64 = self.effect.matrices[row]
        return matrix

    def strength(self, points: F64, row: int) -> F64:
        """Strengths 0..1 (N,) at points (3, N) in shape space, with shape and falloff at a row; 0
        outside."""
        return strength(self.shape(row), self.falloff, points)


@dataclass(frozen=True, eq=False)
class ReferenceDetails:
    """Position and beginning of the contact of each vertex, shape space."""

    places: F64  # (3, V) of the contact; 0 without contact
    since: F64  # (V,) beginning, a fraction of the time since the sample before; NaN if earlier
    entries: F64  # (3, V) of the first inside point, for a beginning since the sample before
    ways: F64  # (3, V) velocity there, per time between two samples


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of all vertices of a model at one sample."""

    weights: F64  # (V,) 0 to 1
    details: ReferenceDetails | None


def contact(
    body: Body,
    volume: Volume,
    row: int,
    before: int | None = None,
    *,
    steps: int | None = None,
    with_details: bool = False,
) -> Contact:
    """Contact of a body with a volume at one row; ``with_details`` with positions and beginnings.

    With ``before``, the row of the sample before, also contacts in between, in straight ``steps``
    of a rotation: by default enough for the rotation, 1 without any. The position of a contact is
    its vertex if inside, else the deepest sample of the cell; of a contact that is over, the
    deepest sample halfway through its passage.
    """
    count, to_shape = len(body.skin.model), np.linalg.inv(volume.matrix(row))
    details = None
    own = moved(to_shape, body.world_points(row))
    has_vertex = volume.strength(own, row) > 0.0
    if with_details:
        zeros = np.zeros((3, count))
        details = ReferenceDetails(
            np.where(has_vertex, own, 0.0), np.full(count, np.nan), zeros, zeros.copy()
        )
    result = Contact(np.zeros(count), details)
    for samples in body.samples():
        points = moved(to_shape, body.world_points(row, samples))
        strengths = volume.strength(points, row)
        result.weights[:] += _summed(samples, strengths, count)  # blocks hold disjoint cells
        is_in = (strengths > 0.0) & ~has_vertex[samples.cells]
        _place(result, volume, row, samples.cells[is_in], points[:, is_in])
        if before is not None:
            _follow(result, body, volume, samples, (before, row), steps)
    result.weights[result.weights > _WHOLE] = 1.0
    return result


def _summed(samples: Samples, weights: F64, count: int) -> F64:
    """Sums (V,) of sample ``weights`` (N,) times area fractions in each of ``count`` cells; 0 in
    empty cells."""
    return np.asarray(np.bincount(samples.cells, samples.areas * weights, count), np.float64)


def _place(result: Contact, volume: Volume, row: int, cells: I64, points: F64) -> None:
    """Set contact positions, if details are kept, to the deepest of points (3, N), shape space, in
    each of their cells (N,), in place."""
    if result.details is None:
        return
    depths = nearest(volume.shape(row), points, volume.matrix(row))[2]
    order = np.lexsort((depths, cells))
    last = order[np.flatnonzero(np.diff(cells[order], append=-1))]
    result.details.places[:, cells[last]] = points[:, last]


def _follow(
    result: Contact,
    body: Body,
    volume: Volume,
    samples: Samples,
    rows: tuple[int, int],
    steps: int | None,
) -> None:
    """Add contacts between rows ``rows`` (earlier, later) to ``result``, in place, for cells
    without contact at the earlier row: the largest area fraction inside at one moment, if above the
    weight, and begin and entry for details."""
    before, row = rows
    path = _path(body, volume, samples, rows, steps)
    start = volume.strength(path[0], before)
    # A cell in contact at the earlier sample continues its contact and is not counted again.
    is_open = _summed(samples, start, len(result.weights)) == 0.0
    first, last = passage(volume.shape(row), path)
    entered = np.flatnonzero(np.isfinite(first) & is_open[samples.cells])
    if not len(entered):
        return
    cells, path, first, last = (
        samples.cells[entered],
        path[..., entered],
        first[entered],
        last[entered],
    )
    # Without falloff the strength is 1, also if a point leaves the volume for a moment.
    strongest = np.full(len(entered), float(volume.falloff.is_flat))
    for share in np.linspace(0.0, 1.0, _LOOKED_UP):
        positions = along(path, first + share * (last - first))[0]
        strongest = np.maximum(strongest, volume.strength(positions, row))
    peaks = _peaks(cells, first, last, samples.areas[entered] * strongest, len(result.weights))
    is_over = (result.weights == 0.0)[cells]
    middle = along(path[..., is_over], (0.5 * (first + last))[is_over])[0]
    _place(result, volume, row, cells[is_over], middle)
    result.weights[:] = np.maximum(result.weights, peaks)
    if result.details is not None:
        # Only the earliest entry of each cell.
        order = np.lexsort((first, cells))
        order = order[np.flatnonzero(np.diff(cells[order], prepend=-1))]
        cells, entries = cells[order], along(path[..., order], first[order])
        result.details.since[cells] = first[order]
        result.details.entries[:, cells], result.details.ways[:, cells] = entries


def _path(
    body: Body, volume: Volume, samples: Samples, rows: tuple[int, int], steps: int | None
) -> F64:
    """Paths (steps + 1, 3, N) of samples between two rows in shape space. ``steps`` None: 64 if
    volume or body rotates, else 1. Skin moves straight in the body's space between its positions
    there at both rows."""
    ends = [body.world_points(row, samples) for row in rows]
    volumes = [volume.matrix(row) for row in rows]
    bodies = [body.pose.to_world[row] for row in rows]
    if steps is None:
        is_turning = is_rotating(*volumes) or is_rotating(*bodies)
        steps = _TURNING_STEPS if is_turning else 1
    path = np.zeros((steps + 1, *ends[0].shape))
    for k, (points, matrix) in zip((0, steps), zip(ends, volumes, strict=True), strict=True):
        path[k] = moved(np.linalg.inv(matrix), points)
    own = [
        moved(np.linalg.inv(matrix), points) for matrix, points in zip(bodies, ends, strict=True)
    ]
    for k in range(1, steps):
        share = k / steps
        to_world = placement_between(bodies[0], bodies[1], share)
        to_shape = np.linalg.inv(placement_between(volumes[0], volumes[1], share))
        path[k] = moved(to_shape @ to_world, (1.0 - share) * own[0] + share * own[1])
    return path


def _peaks(cells: I64, first: F64, last: F64, shares: F64, count: int) -> F64:
    """Largest sum (V,) of the fractions ``shares`` (N,) of a cell's samples inside at one moment,
    for ``count`` cells; 0 in other cells. Fractions are added at ``first`` and subtracted at
    ``last`` (N,); at equal times additions come first."""
    key, when = np.tile(cells, 2), np.concatenate([first, last])
    change = np.concatenate([shares, -shares])
    order = np.lexsort((change < 0.0, when, key))
    key, change = key[order], change[order]
    inside = np.cumsum(change)
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    before = np.repeat(inside[starts] - change[starts], np.diff(starts, append=len(key)))
    peaks = np.zeros(count)
    peaks[key[starts]] = np.maximum.reduceat(inside - before, starts)
    return peaks
