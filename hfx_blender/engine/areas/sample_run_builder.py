# SPDX-License-Identifier: GPL-3.0-or-later
"""Construction of sample runs, shared by all kinds of areas, with optional fields of samples."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np

from ..active_rows import ActiveEffect, posed_rows
from ..arrays import F32, F64, I32, I64
from ..contact.contact_query import ContactDetails, Contacts
from ..counters import Counters
from ..modality import MODALITIES
from ..samples import Impact, SampleRun, Stream
from ..scene import EffectBlock, PoseBlock, SceneDescription, TimeBase
from ..skin.cell_coverage import BoundSkins, PosableModel
from ..volume.nearest_surface import boundary_normals, nearest_surface
from ..volume.shape import Shape

ON_DEMAND: Final = frozenset({"positions", "velocities", "depth"})
"""Optional fields stored in tracks."""

ON_DEMAND_HERE: Final = frozenset({"surface", "impact"})  # optional fields not stored in tracks


class SampleRunBuilder:
    """Builder of the sample runs of a scene; ``record`` has names of :data:`ON_DEMAND` and
    :data:`ON_DEMAND_HERE`."""

    def __init__(
        self, scene: SceneDescription, record: frozenset[str], skins: BoundSkins, counters: Counters
    ) -> None:
        self.scene = scene
        self.record = record
        self.skins = skins
        self.counters = counters
        self.body_index = {body.id: i for i, body in enumerate(scene.bodies)}

    @property
    def wants_motion(self) -> bool:
        """True if positions or velocities are recorded."""
        return bool(self.record & {"positions", "velocities"})

    def run(
        self,
        active: ActiveEffect,
        body_id: str,
        *,
        sets: I64,
        offsets: I64,
        vertices: I32,
        weights: F32,
        **details: Any,
    ) -> SampleRun:
        """Run of an effect on a body at the active rows, with motion if recorded; levels and
        parameters are clipped to the allowed ranges. ``details`` are further fields of
        :class:`SampleRun`. If fields are recorded, ``sets`` must give each row a set of its own,
        and is dropped."""
        effect, animated, rows = active.effect, active.animated, active.rows
        indices = active.block.indices[rows]
        least, largest = MODALITIES[effect.modality].limits
        return SampleRun(
            stream=Stream(effect.id, body_id, effect.modality, effect.model_id),
            indices=indices,
            times_s=self.scene.time.times_s(indices),
            levels=np.minimum(np.maximum(animated.levels[rows], 0.0), 1.0),
            parameters=np.minimum(np.maximum(animated.parameters[rows], least), largest),
            sets=None if self.record else sets,
            offsets=offsets,
            vertices=vertices,
            weights=weights,
            **self.motion(active, body_id, vertices, offsets),
            **details,
        )

    def motion(
        self, active: ActiveEffect, body_id: str, vertices: I32, offsets: I64
    ) -> dict[str, Any]:
        """Recorded fields among "positions" and "velocities" (total, 3), world space. Row ``k`` of
        the active rows has ``vertices[offsets[k]:offsets[k + 1]]``. See
        :func:`on_demand.motion`."""
        if not self.wants_motion:
            return {}
        if len(vertices):
            k = self.body_index[body_id]
            skin = self.skins.of(self.scene.bodies[k], active.effect.model_id).vertices
            self.counters.vertices_posed += len(vertices)
            positions, velocities = _motion(
                skin,
                active.block.poses[k],
                active.rows,
                [vertices[a:b] for a, b in pairwise(offsets)],
                active.block.indices,
                1.0 / float(self.scene.time.rate_hz),
                with_velocities="velocities" in self.record,
            )
        else:
            positions = velocities = np.zeros((0, 3), np.float32)
        columns = {"positions": positions, "velocities": velocities}
        return {name: column for name, column in columns.items() if name in self.record}


def _motion(
    model: PosableModel,
    pose: PoseBlock,
    rows: I64,
    vertices: list[I32],
    indices: I64,
    step_s: float,
    *,
    with_velocities: bool,
) -> tuple[F32, F32]:
    """World positions and velocities (total, 3) of the vertices of each row, concatenated.
    Velocities are central differences of the neighbouring samples; one-sided where a neighbour is
    missing in the block or without pose; 0 without neighbours, or without ``with_velocities``."""
    is_posed = np.zeros(len(indices), np.bool_)
    is_posed[posed_rows(pose)] = True
    # follows[k]: row k is one sample after row k - 1; False at both ends.
    follows = np.zeros(len(indices) + 1, np.bool_)
    follows[1:-1] = is_posed[1:] & is_posed[:-1] & (np.diff(indices) == 1)

    def places(row: int, ids: I32) -> F64:
        return model.points(ids, pose, row, pose.to_world[row])

    positions, velocities = [], []
    for row, ids in zip(rows.tolist(), vertices, strict=True):
        here = places(row, ids)
        positions.append(here.T)
        before, after = row - int(follows[row]), row + int(follows[row + 1])
        if not with_velocities or before == after:
            velocities.append(np.zeros_like(here.T))
            continue
        # Central differences where both neighbours are known.
        displacement = (places(after, ids) if after > row else here) - (
            places(before, ids) if before < row else here
        )
        velocities.append(displacement.T / (step_s * (after - before)))
    return np.concatenate(positions).astype(np.float32), np.concatenate(velocities).astype(
        np.float32
    )


def _by_row(
    animated: EffectBlock, hits: Contacts
) -> Iterator[tuple[slice, Shape, F64, ContactDetails]]:
    """Yield (slice of the contacts, shape, matrix (4, 4), details of all contacts) for each row
    with contacts."""
    assert animated.matrices is not None and hits.details is not None
    for k, row in enumerate(hits.rows):
        part = slice(int(hits.offsets[k]), int(hits.offsets[k + 1]))
        shape_id = 0 if animated.shape_index is None else int(animated.shape_index[row])
        yield part, animated.shapes[shape_id], animated.matrices[row], hits.details


def depths_m(animated: EffectBlock, hits: Contacts) -> F32:
    """Distance (total,) of each contact's position from the volume's boundary, metres, float32."""
    depths = np.zeros(len(hits.vertices), np.float32)
    for part, shape, matrix, details in _by_row(animated, hits):
        depths[part] = shape.depth_m(details.places[:, part], matrix)
    return depths


def boundary_of(animated: EffectBlock, hits: Contacts) -> tuple[F32, F32]:
    """Nearest boundary points and outward normals (total, 3 each) of the contacts, world space,
    metres."""
    places = np.zeros((len(hits.vertices), 3), np.float32)
    normals = np.zeros_like(places)
    for part, shape, matrix, details in _by_row(animated, hits):
        boundary_points, normal = nearest_surface(shape, details.places[:, part], matrix)
        places[part], normals[part] = boundary_points.T, normal.T
    return places, normals


def impacts(animated: EffectBlock, hits: Contacts, indices: I64, time: TimeBase) -> Impact:
    """Times (seconds since the scene's start), approach speeds (m/s, at least 0) and outward world
    normals of contacts begun since the previous sample; NaN for earlier contacts. ``indices`` are
    the block's sample indices."""
    count = len(hits.vertices)
    times, speeds = np.full(count, np.nan), np.full(count, np.nan, np.float32)
    normals = np.full((count, 3), np.nan, np.float32)
    rate = float(time.rate_hz)
    ends = time.times_s(indices[hits.rows])
    for end, (part, shape, matrix, details) in zip(ends, _by_row(animated, hits), strict=True):
        begun = np.flatnonzero(~np.isnan(details.since[part])) + part.start
        if len(begun):
            normal = boundary_normals(shape, details.entries[:, begun], matrix)
            velocity = matrix[:3, :3] @ details.ways[:, begun]
            # ``since`` is the time within the last interval (0..1) at which the contact began.
            times[begun] = end + (details.since[begun] - 1.0) / rate
            speeds[begun] = np.maximum(-np.einsum("in,in->n", velocity, normal) * rate, 0.0)
            normals[begun] = normal.T
    return Impact(times, speeds, normals)
