# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces: vibration samples of skin moving over a surface."""

import sys
from dataclasses import dataclass

import numpy as np

from ..active_rows import ActiveEffect, followed
from ..arrays import F32, F64, I32, I64, Bool
from ..body.model import PerceptualModel
from ..body.parts import PARTS
from ..contact.contact_force import is_deep, surface_forces
from ..contact.reachable_bounds import ReachableBounds
from ..counters import Counters
from ..modality import MODALITIES
from ..scene import EffectBlock, HapticSurface, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..texture.contact_path import ContactFollower, ContactPaths, SurfaceMesh
from ..texture.contact_rendering import ContactRenderer
from ..texture.haptic_map import DeviceRange
from ..volume.mesh_distance import NearestPlaces

_FINGERS = PARTS.index("fingers")
# Number of points followed together; intermediate arrays fit the processor's cache
_POINTS_PER_BATCH = 512
_DEEP = 4  # skin behind a surface with forces is searched up to this multiple of the reach


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Samples of a surface at rows with contact, with a vertex set per row."""

    rows: I64  # (n,)
    amplitude_m_s2: F64  # (n,) of the strongest contact
    frequency_hz: F64  # (n,) of the strongest contact
    offsets: I64  # (n + 1,)
    vertices: I32  # (total,) ascending within a row
    weights: F32  # (total,) amplitude relative to the strongest, in (0, 1]
    distance_m: F32  # (total,) from the surface
    forces_n: F32 | None = None  # (total, 3) of a surface with a contact law

    @property
    def parameters(self) -> F64:
        """Amplitude and frequency (n, 2), clipped to vibration's limits."""
        values = np.stack([self.amplitude_m_s2, self.frequency_hz], axis=1)
        return np.asarray(np.clip(values, *MODALITIES["vibration"].limits))


class SurfaceEffects:
    """Contacts of each surface with each body, tracked over successive blocks. A block continuing
    the previous block continues its contacts, so results do not depend on the division into
    blocks."""

    def __init__(self, step_s: float, counters: Counters) -> None:
        self._step_s = step_s
        self._counters = counters
        self._followed: dict[tuple[str, str], _TrackedContacts] = {}
        self.touched: set[str] = set()  # ids of surfaces with a contact so far, felt or not

    def evaluate(
        self,
        active: ActiveEffect,
        body_id: str,
        skin: BodySkin,
        pose: PoseBlock,
        bounds: ReachableBounds,
        steps_s: F64,
    ) -> SurfaceSamples | None:
        """Contacts of a body with a surface at the active rows; None without any above 0. Rows
        without a finite placement are left out, with a warning. The pose is known at the active
        rows; ``bounds`` are cluster boxes at all rows with a known pose. ``steps_s`` (T,) is the
        time since the row before; set to 0, in place, where that has no contact to continue."""
        effect, animated, block = active.effect, active.animated, active.block
        area = effect.area
        assert isinstance(area, HapticSurface)
        key = (effect.id, body_id)
        if key not in self._followed:
            self._followed[key] = _TrackedContacts(area, skin.skin.model, self._step_s)
        tracked = self._followed[key]
        rows, reported, follows = followed(active.rows, bounds.rows, animated, block)
        # Continue the contacts of the previous block, or restart after a gap in time.
        if tracked.index == int(block.indices[rows[0]]):
            rows, reported, follows = rows[1:], reported[1:], follows[1:]
        elif tracked.index != int(block.indices[rows[0]]) - 1:
            tracked.follower.restart()
        else:
            follows[0] = True
        # Rigid vertices (1, n, 3) count for all rows.
        assert animated.matrices is not None and animated.vertices is not None
        is_placed: Bool = np.isfinite(animated.matrices[rows]).all(axis=(1, 2))
        per_row = np.isfinite(animated.vertices).all(axis=(1, 2))
        is_placed &= per_row if len(per_row) == 1 else per_row[rows]
        if not is_placed.all():
            self._counters.warn(
                f"surface '{effect.name}': its place is not a finite number; it is not felt there",
                int(np.count_nonzero(~is_placed)),
            )
            # A row after a missing place has no contacts to continue.
            follows = follows & np.concatenate([[True], is_placed[:-1]])
            rows, reported, follows = rows[is_placed], reported[is_placed], follows[is_placed]
        if not len(rows):
            return None
        tracked.index = int(block.indices[rows[-1]])
        vertices = animated.vertices
        if len(vertices) > 1:
            vertices = vertices[rows]
        matrices = animated.matrices[rows]
        steps_s[np.setdiff1d(np.arange(len(steps_s)), rows[follows])] = 0.0
        self._counters.volume_tests += int(np.count_nonzero(reported))
        time, ids, points = self._near(area, matrices, vertices, skin, pose, bounds, rows)
        parts, deep = [], 0
        for part in _parts(np.bincount(time, minlength=len(rows))):
            points_of_part = slice(*np.searchsorted(time, (part.start, part.stop)))
            placed = matrices[part], vertices[part] if len(vertices) > 1 else vertices
            times, near = time[points_of_part] - part.start, points[points_of_part]
            paths = tracked.follower.follow(
                *placed, times, ids[points_of_part], near, follows[part]
            )
            rendered = tracked.renderer.render(paths)
            own = rows[part], reported[part]
            if reported[part][paths.time[paths.carried :]].any():
                self.touched.add(effect.id)
            forces = None
            if area.law is not None:
                forces = surface_forces(area, animated, paths, own[0], skin, pose, steps_s)
                places, _ = tracked.deep.nearest(*placed, times, near)
                for k in np.unique(times[places.point]).tolist():
                    at = np.flatnonzero(times[places.point] == k)
                    found = NearestPlaces(*(column[at] for column in vars(places).values()))
                    is_counted = reported[part][k]
                    deep += is_counted and is_deep(
                        area, animated, int(own[0][k]), near[found.point], found
                    )
            parts.append(_gathered(paths, *rendered, animated, *own, area.texture.device, forces))
        if deep:
            self._counters.warn(
                f"surface '{effect.name}': skin stood more than {area.reach_m * 1e3:g} mm behind "
                "it, where no force is computed; where skin comes from that side, flip its normals "
                "(Mesh > Normals > Flip)",
                deep,
            )
        if tracked.follower.crowded:
            text = f"surface '{effect.name}' touches more than {area.max_contacts} vertices"
            self._counters.warn(
                f"{text} at once: fingertips and the nearest of the others are felt",
                tracked.follower.crowded,
            )
            tracked.follower.crowded = 0
        return _joined([samples for samples in parts if samples is not None])

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
        """Vertices within reach of a surface's bounding box: position in ``rows`` (n,), id (n,),
        world point (n, 3), sorted by row, then id."""
        box_low, box_high = vertices.min(axis=1), vertices.max(axis=1)
        centre, half = 0.5 * (box_low + box_high), 0.5 * (box_high - box_low)
        middle = np.einsum(
            "tij,tj->ti", matrices[:, :3, :3], np.broadcast_to(centre, (len(rows), 3))
        )
        middle += matrices[:, :3, 3]
        # A turned box spans its half size times the absolute matrix.
        reach = _search_m(area) + np.einsum(
            "tij,tj->ti", np.abs(matrices[:, :3, :3]), np.broadcast_to(half, (len(rows), 3))
        )
        # World box of the transformed object box, enlarged by the reach of a touch.
        low, high = middle - reach, middle + reach
        bound_rows = np.searchsorted(bounds.rows, rows)
        is_reached = (
            (bounds.low[bound_rows] <= high[:, None]) & (bounds.high[bound_rows] >= low[:, None])
        ).all(axis=2)
        # Transposed, so that pairs come cluster by cluster, as the posing of pairs requires.
        cluster, times = is_reached.T.nonzero()
        if not len(times):
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3))
        places = skin.vertices.pair_points(cluster, times, pose, rows, pose.to_world[rows])
        members = [skin.skin.clusters[k] for k in cluster.tolist()]
        ids = np.concatenate(members)
        time = times.repeat([len(member_ids) for member_ids in members])
        self._counters.vertices_posed += len(time)
        is_inside = (places >= low.T.take(time, axis=1)) & (places <= high.T.take(time, axis=1))
        chosen = (is_inside[0] & is_inside[1] & is_inside[2]).nonzero()[0]
        # By row, then id: the order in which contacts are followed and stored.
        chosen = chosen[np.lexsort((ids[chosen], time[chosen]))]
        return time[chosen], ids[chosen].astype(np.int64), places[:, chosen].T


def _search_m(area: HapticSurface) -> float:
    """Largest distance of searched skin from a surface, metres; larger with a force law, so that
    skin that is too deep for a force is counted."""
    return area.reach_m * (1 if area.law is None else _DEEP)


def _parts(counts: I64) -> list[slice]:
    """Slices of successive rows with at most 512 points in all, or a single row with more;
    ``counts`` are the points of each row."""
    parts, first, total = [], 0, 0
    for k, count in enumerate(counts.tolist()):
        # A time with more points than the limit is a batch of its own.
        if total and total + count > _POINTS_PER_BATCH:
            parts.append(slice(first, k))
            first, total = k, 0
        total += count
    return [*parts, slice(first, len(counts))]


class _TrackedContacts:
    """Contacts of one body with one surface up to the last sample."""

    def __init__(self, area: HapticSurface, model: PerceptualModel, step_s: float) -> None:
        self.index: int | None = None  # last sample index
        self.renderer = ContactRenderer(area.texture, step_s)
        mesh = SurfaceMesh(area.triangles, area.coordinates_m)
        self.deep = ContactFollower(mesh, _search_m(area))
        self.follower = ContactFollower(
            mesh,
            area.reach_m,
            # Forces act on each touched vertex.
            area.max_contacts if area.law is None else sys.maxsize,
            np.asarray(model.part) == _FINGERS,
        )


def _gathered(
    paths: ContactPaths,
    drive: F64,
    frequency: F64,
    animated: EffectBlock,
    rows: I64,
    reported: Bool,
    device: DeviceRange,
    forces_n: F32 | None,
) -> SurfaceSamples | None:
    """Samples of the contacts with drive or force at ``reported`` rows; None without any. Amplitude
    and frequency of a row are of the strongest contact, weights relative to it. ``drive`` and
    ``frequency`` (contacts,) are rendered; a frequency of 0 means that of the effect. ``forces_n``
    (contacts, 3); None without a contact law."""
    is_felt = drive > 0.0 if forces_n is None else (drive > 0.0) | forces_n.any(axis=1)
    contacts = np.flatnonzero(is_felt & reported[np.maximum(paths.time, 0)])
    if not len(contacts):
        return None
    time = paths.time[contacts]
    values = animated.parameters[rows[time]]
    amplitude = values[:, 0] * device.amplitude_m_s2(drive[contacts]) / device.amplitude_m_s2(1.0)
    times, starts = np.unique(time, return_index=True)
    strongest = np.maximum.reduceat(amplitude, starts)
    owner = np.repeat(np.arange(len(times)), np.diff(np.append(starts, len(contacts))))
    # First of the strongest contacts of each row: its frequency is the row's.
    strongest_contacts = np.flatnonzero(amplitude == strongest[owner])
    chosen = strongest_contacts[np.searchsorted(strongest_contacts, starts)]
    frequencies = frequency[contacts][chosen]
    scale = np.where(strongest > 0.0, strongest, 1.0)[owner]
    # Weights must stay above 0, even where the ratio underflows in float32.
    shares = np.maximum(amplitude / scale, np.finfo(np.float32).tiny)
    return SurfaceSamples(
        rows=rows[times],
        amplitude_m_s2=strongest,
        frequency_hz=np.where(frequencies > 0.0, frequencies, values[chosen, 1]),
        offsets=np.append(starts, len(contacts)).astype(np.int64),
        vertices=paths.ids[contacts].astype(np.int32),
        weights=shares.astype(np.float32),
        distance_m=paths.distance_m[contacts].astype(np.float32),
        forces_n=None if forces_n is None else forces_n[contacts],
    )


def _joined(parts: list[SurfaceSamples]) -> SurfaceSamples | None:
    """Concatenate samples of successive times; None for an empty list. Offsets of each part are
    shifted by the number of vertices in the parts before."""
    if not parts:
        return None
    before = np.cumsum([0, *(part.offsets[-1] for part in parts)])
    offsets = [part.offsets[:-1] + start for part, start in zip(parts, before, strict=False)]
    columns = {name: [getattr(part, name) for part in parts] for name in vars(parts[0])}
    columns["offsets"] = [*offsets, before[-1:]]
    present = {name: column for name, column in columns.items() if column[0] is not None}
    return SurfaceSamples(**{name: np.concatenate(column) for name, column in present.items()})
