# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces in the engine: skin that moves over them, as samples of vibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..active_rows import followed
from ..arrays import F32, F64, I32, I64, Bool
from ..body.model import PerceptualModel
from ..body.parts import PARTS
from ..contact.reachable_bounds import ReachableBounds
from ..counters import Counters
from ..modality import MODALITIES
from ..scene import AnimationBlock, EffectBlock, EffectDescription, HapticSurface, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..texture.contact_path import ContactFollower, ContactPaths, SurfaceMesh
from ..texture.contact_rendering import ContactRenderer
from ..texture.haptic_map import DeviceRange

_FINGERS = PARTS.index("fingers")
_AT_ONCE = 512
"""Number of points followed together: intermediate data of more leaves the processor's cache."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Samples of a surface at the rows of a block with any contact; each row has its own set."""

    rows: I64  # (n,)
    amplitude_m_s2: F64  # (n,) of the strongest contact
    frequency_hz: F64  # (n,) of the same one
    offsets: I64  # (n + 1,)
    vertices: I32  # (total,) ascending within a row
    weights: F32  # (total,) amplitude as a share of the strongest, in (0, 1]
    distance_m: F32  # (total,)

    @property
    def parameters(self) -> F64:
        """Amplitude and frequency in the order of vibration's parameters, (n, 2)."""
        values = np.stack([self.amplitude_m_s2, self.frequency_hz], axis=1)
        return np.asarray(np.clip(values, *MODALITIES["vibration"].limits))


class SurfaceEffects:
    """Follows the contacts of every surface with every body, from block to block.

    A block that goes on where the one before ended goes on with its contacts, so that nothing
    depends on how time was split.
    """

    def __init__(self, step_s: float, counters: Counters) -> None:
        self._step_s = step_s
        self._counters = counters
        self._followed: dict[tuple[str, str], _Followed] = {}

    def evaluate(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        body_id: str,
        skin: BodySkin,
        pose: PoseBlock,
        bounds: ReachableBounds,
        rows: I64,
        block: AnimationBlock,
    ) -> SurfaceSamples | None:
        """Evaluate a body's contacts with a surface.

        Parameters
        ----------
        bounds : ReachableBounds
            Boxes of the skin's clusters at all rows whose pose is known.
        rows : (n,) int64
            Rows at which the surface is on and the body's pose is known.
        """
        area = effect.area
        assert isinstance(area, HapticSurface)
        key = (effect.id, body_id)
        if key not in self._followed:
            self._followed[key] = _Followed(area, skin.skin.model, self._step_s)
        one = self._followed[key]
        rows, reported, follows = followed(rows, bounds.rows, animated, block)
        if one.index == int(block.indices[rows[0]]):  # it was the last of the block before
            rows, reported, follows = rows[1:], reported[1:], follows[1:]
        elif one.index != int(block.indices[rows[0]]) - 1:
            one.follower.restart()
        else:
            follows[0] = True
        placed = _placed(animated, rows)
        if not placed.all():
            self._counters.warn(
                f"surface '{effect.name}': its place is not a finite number; it is not felt there",
                int(np.count_nonzero(~placed)),
            )
            follows = follows & np.concatenate([[True], placed[:-1]])
            rows, reported, follows = rows[placed], reported[placed], follows[placed]
        if not len(rows):
            return None
        one.index = int(block.indices[rows[-1]])
        assert animated.matrices is not None and animated.vertices is not None
        vertices = animated.vertices
        if len(vertices) > 1:
            vertices = vertices[rows]
        matrices = animated.matrices[rows]
        self._counters.volume_tests += int(np.count_nonzero(reported))
        time, ids, points = self._near(area, matrices, vertices, skin, pose, bounds, rows)
        found = []
        for part in _parts(np.bincount(time, minlength=len(rows))):
            mine = slice(*np.searchsorted(time, (part.start, part.stop)))
            paths = one.follower.follow(
                matrices[part],
                vertices[part] if len(vertices) > 1 else vertices,
                time[mine] - part.start,
                ids[mine],
                points[mine],
                follows[part],
            )
            felt = one.renderer.render(paths)
            found.append(
                _gathered(paths, *felt, animated, rows[part], reported[part], area.texture.device)
            )
        if one.follower.crowded:
            text = f"surface '{effect.name}' touches more than {area.max_contacts} vertices"
            self._counters.warn(
                f"{text} at once: fingertips and the nearest of the others are felt",
                one.follower.crowded,
            )
            one.follower.crowded = 0
        return _joined([each for each in found if each is not None])

    def _near(
        self,
        area: HapticSurface,
        matrices: F64,
        vertices: F64,
        skin: BodySkin,
        pose: PoseBlock,
        bounds: ReachableBounds,
        rows: I64,
    ) -> tuple[I64, I64, F64]:
        """Vertices that may touch: time, id and place in the world; by time, then by id."""
        box_low, box_high = vertices.min(axis=1), vertices.max(axis=1)
        centre, half = 0.5 * (box_low + box_high), 0.5 * (box_high - box_low)
        middle = np.einsum(
            "tij,tj->ti", matrices[:, :3, :3], np.broadcast_to(centre, (len(rows), 3))
        )
        middle += matrices[:, :3, 3]
        reach = area.reach_m + np.einsum(
            "tij,tj->ti", np.abs(matrices[:, :3, :3]), np.broadcast_to(half, (len(rows), 3))
        )
        low, high = middle - reach, middle + reach
        at = np.searchsorted(bounds.rows, rows)
        reached = ((bounds.low[at] <= high[:, None]) & (bounds.high[at] >= low[:, None])).all(
            axis=2
        )
        cluster, times = reached.T.nonzero()
        if not len(times):
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3))
        places = skin.vertices.pair_points(cluster, times, pose, rows, pose.to_world[rows])
        members = [skin.skin.clusters[each] for each in cluster.tolist()]
        ids = np.concatenate(members)
        time = times.repeat([len(each) for each in members])
        self._counters.vertices_posed += len(time)
        inside = (places >= low.T.take(time, axis=1)) & (places <= high.T.take(time, axis=1))
        near = (inside[0] & inside[1] & inside[2]).nonzero()[0]
        near = near[np.lexsort((ids[near], time[near]))]
        return time[near], ids[near].astype(np.int64), places[:, near].T


def _parts(counts: I64) -> list[slice]:
    """Times in stretches that hold no more points than are quick to follow together."""
    parts, first, held = [], 0, 0
    for k, count in enumerate(counts.tolist()):
        if held and held + count > _AT_ONCE:
            parts.append(slice(first, k))
            first, held = k, 0
        held += count
    return [*parts, slice(first, len(counts))]


class _Followed:
    """Tracked contacts of one body with one surface, up to the last sample."""

    def __init__(self, area: HapticSurface, model: PerceptualModel, step_s: float) -> None:
        self.index: int | None = None  # last sample that was followed
        self.renderer = ContactRenderer(area.texture, step_s)
        self.follower = ContactFollower(
            SurfaceMesh(area.triangles, area.coordinates_m),
            area.reach_m,
            area.max_contacts,
            np.asarray(model.part) == _FINGERS,
        )


def _placed(animated: EffectBlock, rows: I64) -> Bool:
    """Test that all of a surface's numbers are finite, at each row."""
    assert animated.matrices is not None and animated.vertices is not None
    placed = np.isfinite(animated.matrices[rows]).all(axis=(1, 2))
    per_row = np.isfinite(animated.vertices).all(axis=(1, 2))
    return np.asarray(placed & (per_row if len(per_row) == 1 else per_row[rows]))


def _gathered(
    paths: ContactPaths,
    drive: F64,
    frequency: F64,
    animated: EffectBlock,
    rows: I64,
    reported: Bool,
    device: DeviceRange,
) -> SurfaceSamples | None:
    """Gather the contacts row by row; the strongest of a row is its amplitude."""
    felt = np.flatnonzero((drive > 0.0) & reported[np.maximum(paths.time, 0)])
    if not len(felt):
        return None
    time = paths.time[felt]
    values = animated.parameters[rows[time]]
    amplitude = values[:, 0] * device.amplitude_m_s2(drive[felt]) / device.amplitude_m_s2(1.0)
    times, starts = np.unique(time, return_index=True)
    strongest = np.maximum.reduceat(amplitude, starts)
    owner = np.repeat(np.arange(len(times)), np.diff(np.append(starts, len(felt))))
    is_it = np.flatnonzero(amplitude == strongest[owner])
    chosen = is_it[np.searchsorted(is_it, starts)]
    own = frequency[felt][chosen]
    scale = np.where(strongest > 0.0, strongest, 1.0)[owner]
    shares = np.maximum(amplitude / scale, np.finfo(np.float32).tiny)
    return SurfaceSamples(
        rows=rows[times],
        amplitude_m_s2=strongest,
        frequency_hz=np.where(own > 0.0, own, values[chosen, 1]),
        offsets=np.append(starts, len(felt)).astype(np.int64),
        vertices=paths.ids[felt].astype(np.int32),
        weights=shares.astype(np.float32),
        distance_m=paths.distance_m[felt].astype(np.float32),
    )


def _joined(parts: list[SurfaceSamples]) -> SurfaceSamples | None:
    if not parts:
        return None
    before = np.cumsum([0, *(part.offsets[-1] for part in parts)])
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("rows", "amplitude_m_s2", "frequency_hz", "vertices", "weights", "distance_m")
    }
    offsets = [part.offsets[:-1] + start for part, start in zip(parts, before, strict=False)]
    return SurfaceSamples(**joined, offsets=np.concatenate([*offsets, before[-1:]]))
