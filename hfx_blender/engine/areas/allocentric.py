# SPDX-License-Identifier: GPL-3.0-or-later
"""Allocentric areas: samples of volumes and surfaces around a body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..active_rows import ActiveEffect, followed, with_pose
from ..arrays import F64, I64, Bool
from ..contact import contacts
from ..contact.broad_phase import BlockBroadPhase
from ..contact.contact_force import contact_forces
from ..contact.contact_query import ContactQuery, Contacts
from ..contact.reachable_bounds import ReachableBounds
from ..counters import Counters
from ..response.answering import Answering, at_vertices_of, with_own_sets
from ..response.touches import Moments
from ..samples import SampleRun, Stream
from ..scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
)
from ..skin.cell_coverage import BodySkin
from ..surface.surface_effects import SurfaceEffects
from ..volume.mesh import DECIMATION_SHARE, MeshVolume, of_fewer_faces
from ..volume.shape import Falloff, world_bounds
from .sample_run_builder import SampleRunBuilder, boundary_of, depths_m, impacts

if TYPE_CHECKING:
    from concurrent.futures import Executor

_SMALLEST_BODY: Final = 0.4  # smallest posed size of a body (curled up), fraction of rest size


class AllocentricAreas:
    """Sample runs of haptic volumes, contact responses, and haptic surfaces."""

    def __init__(
        self, builder: SampleRunBuilder, responses: Answering, threads: Executor | None
    ) -> None:
        self._builder = builder
        self._threads = threads
        self._responses = responses
        self.surfaces = SurfaceEffects(1.0 / float(builder.scene.time.rate_hz), builder.counters)

    def volume(
        self,
        active: ActiveEffect,
        volume: HapticVolume,
        body: BodyDescription,
        reach: BlockBroadPhase,
    ) -> Callable[[], SampleRun | None]:
        """Begin the contacts of a volume with a body; returns a function to finish them, to be
        called once. The function returns None without contact. Without rows of known pose, or with
        volume and body apart, nothing is computed. Worker threads may compute in between."""
        effect, animated, block = active.effect, active.animated, active.block
        pose = block.poses[self._builder.body_index[body.id]]
        posed = reach.posed(body)
        rows = self._with_pose(active.rows, pose, posed, body)
        if volume.has_impacts and len(rows):
            rows = _with_adjacent_rows(rows, posed, animated, block)
        if not len(rows):
            return lambda: None
        # Broad phase over the whole block: most volumes never come near a body.
        if reach.is_clear(animated, body, effect.model_id):
            self._builder.counters.volume_tests += len(rows)
            return lambda: None
        # Rows before the active rows are evaluated for motion between samples, but not reported.
        rows, reported, follows = followed(rows, posed, animated, block)
        skin = self._builder.skins.of(body, effect.model_id)
        bounds = reach.bounds(body, effect.model_id)
        if not (volume.falloff.is_flat or volume.response):
            animated = _coarse(animated, rows, skin, bounds)
        query = ContactQuery(
            animated,
            volume.falloff,
            skin,
            pose,
            bounds,
            self._builder.counters,
            rows,
            follows,
            reported,
            own_sets=bool(self._builder.record or volume.law),
            with_details=bool(self._builder.record & {"depth", "surface"} or volume.law),
            with_impact="impact" in self._builder.record,
            threads=self._threads,
            name=effect.name,
        )
        # Positions counted by either half show whether the narrow phase ran.
        counters = self._builder.counters
        before = counters.vertices_posed
        finish_contacts = contacts.begin(query)
        posed_at_begin = counters.vertices_posed - before

        def finish() -> SampleRun | None:
            before = counters.vertices_posed - posed_at_begin
            hits = finish_contacts()
            if counters.vertices_posed > before:
                counters.reach(body.id)
                if any(isinstance(shape, MeshVolume) for shape in animated.shapes):
                    counters.meshes_searched += int(np.count_nonzero(reported))
            run = self._samples_of(replace(active, animated=animated, rows=hits.rows), body, hits)
            if run is None or volume.law is None:
                return run
            steps = self._steps_s(block)
            steps[np.setdiff1d(np.arange(len(steps)), rows[follows])] = 0.0
            forces = contact_forces(volume.law, animated, hits, skin, pose, steps)
            return replace(run, forces_n=forces, sets=None)

        return finish

    def _samples_of(
        self, active: ActiveEffect, body: BodyDescription, hits: Contacts
    ) -> SampleRun | None:
        """Sample run of contacts ``hits``, with the recorded details depth, surface and impact;
        None without contact."""
        if not len(hits.rows):
            return None
        animated, block = active.animated, active.block
        details: dict[str, Any] = {}
        if hits.details is not None:
            if "depth" in self._builder.record:
                details["depth_m"] = depths_m(animated, hits)
            if "surface" in self._builder.record:
                surface, normals = boundary_of(animated, hits)
                details.update(surface=surface, surface_normals=normals)
            if "impact" in self._builder.record:
                time = self._builder.scene.time
                details["impact"] = impacts(animated, hits, block.indices, time)
        return self._builder.run(
            active,
            body.id,
            sets=hits.sets,
            offsets=hits.offsets,
            vertices=hits.vertices,
            weights=hits.weights.astype(np.float32),
            **details,
        )

    def _between(
        self, effect: EffectDescription, falloff: Falloff, moments: Moments, follows: Bool
    ) -> SampleRun | None:
        """Contacts at ``moments`` between samples, before the response; None without contact.
        ``follows`` (n,) are moments one step after the moment before. Counts only posed
        vertices."""
        query = ContactQuery(
            *(moments.effect, falloff, moments.skin, moments.pose, moments.bounds, Counters()),
            *(moments.rows, follows, np.ones(len(follows), np.bool_)),
            name=effect.name,
        )
        hits = contacts.begin(query)()
        self._builder.counters.vertices_posed += query.counters.vertices_posed
        if not len(hits.rows):
            return None
        return SampleRun(
            stream=Stream(effect.id, "", effect.modality, effect.model_id),
            indices=moments.indices[hits.rows],
            times_s=moments.times_s[hits.rows],
            levels=moments.effect.levels[hits.rows],
            parameters=moments.effect.parameters[hits.rows],
            offsets=hits.offsets,
            vertices=hits.vertices,
            weights=hits.weights.astype(np.float32),
            sets=hits.sets,
        )

    def surface(
        self, active: ActiveEffect, body: BodyDescription, reach: BlockBroadPhase
    ) -> SampleRun | None:
        """Samples of a surface touched by a body, amplitude and frequency as parameters; None
        without contact or row of known pose."""
        pose = active.block.poses[self._builder.body_index[body.id]]
        rows = self._with_pose(active.rows, pose, reach.posed(body), body)
        if not len(rows):
            return None
        skin = self._builder.skins.of(body, active.effect.model_id)
        bounds = reach.bounds(body, active.effect.model_id)
        active = replace(active, rows=rows)
        steps_s = self._steps_s(active.block)
        samples = self.surfaces.evaluate(active, body.id, skin, pose, bounds, steps_s)
        if samples is None:
            return None
        run = self._builder.run(
            replace(active, rows=samples.rows),
            body.id,
            sets=np.arange(len(samples.rows)),
            offsets=samples.offsets,
            vertices=samples.vertices,
            weights=samples.weights,
            depth_m=samples.distance_m if "depth" in self._builder.record else None,
        )
        run = replace(run, parameters=samples.parameters)
        if samples.forces_n is None:
            return run
        return replace(run, forces_n=samples.forces_n, sets=None)

    def _steps_s(self, block: AnimationBlock) -> F64:
        """Time (T,) of each row of a block since the row before, seconds; NaN for the first."""
        times = self._builder.scene.time.times_s(block.indices)
        return np.diff(times if block.live_s is None else block.live_s, prepend=np.nan)

    def _with_pose(self, rows: I64, pose: PoseBlock, posed: I64, body: BodyDescription) -> I64:
        """Rows at which the body was read (enabled) and the pose is known; warns of rows read
        without known pose."""
        read, builder = rows[pose.valid[rows]], self._builder
        return with_pose(read, posed, body, builder.counters, needs_pose=builder.wants_motion)

    def answered(
        self,
        active: ActiveEffect,
        body: BodyDescription,
        reach: BlockBroadPhase,
        run: SampleRun | None,
    ) -> SampleRun | None:
        """Response of a volume to its contacts ``run`` with a body (None without contact), with
        recorded motion and depth; None without a sample above 0."""
        effect, animated, block = active.effect, active.animated, active.block
        pose = block.poses[self._builder.body_index[body.id]]
        posed = reach.posed(body)
        rows = active.rows[np.isin(active.rows, posed)]
        assert isinstance(effect.area, HapticVolume)
        if effect.area.has_impacts and len(rows):
            rows = _with_adjacent_rows(rows, posed, animated, block)
        if not len(rows):
            return None
        skin = self._builder.skins.of(body, effect.model_id)
        bounds = reach.bounds(body, effect.model_id)
        falloff = effect.area.falloff

        def between(moments: Moments, follows: Bool) -> SampleRun | None:
            return self._between(effect, falloff, moments, follows)

        answer = self._responses.answer(
            *(effect, body, animated, block, rows, posed, skin, pose, bounds, run, between),
            is_clear=run is None and reach.is_clear(animated, body, effect.model_id, is_bent=True),
        )
        has_law = effect.area.law is not None
        if answer is None or not (self._builder.record or has_law):
            return answer
        # Recorded fields are per vertex and row, so rows cannot share vertex sets.
        answer = with_own_sets(answer)
        active = replace(active, rows=np.searchsorted(block.indices, answer.indices))
        motion = self._builder.motion(active, body.id, answer.vertices, answer.offsets)
        answer = replace(answer, **motion)
        if "depth" in self._builder.record:
            answer = replace(answer, depth_m=at_vertices_of(answer, run, "depth_m"))
        if has_law:
            forces = at_vertices_of(answer, run, "forces_n", 3)
            answer = replace(answer, forces_n=forces)
        return answer


def _with_adjacent_rows(rows: I64, posed: I64, animated: EffectBlock, block: AnimationBlock) -> I64:
    """Ascending union of ``rows`` and the history and future rows of a block with the effect on and
    a known pose (``posed``)."""
    count = len(block.indices)
    adjacent = np.concatenate([np.arange(block.own.start), np.arange(block.own.stop, count)])
    values = np.concatenate(
        [animated.levels[adjacent, None], animated.parameters[adjacent]], axis=1
    )
    # A row of the history counts only with the effect on.
    is_on = np.isfinite(values).all(axis=1) & (animated.levels[adjacent] > 0.0)
    adjacent = adjacent[is_on & np.isin(adjacent, posed)]
    return np.union1d(rows, adjacent) if len(adjacent) else rows


def _coarse(
    animated: EffectBlock, rows: I64, skin: BodySkin, bounds: ReachableBounds
) -> EffectBlock:
    """Copy of the block with a fine mesh decimated, within the tolerance. Unchanged for other
    shapes, exact tolerances, and boxes apart from the body. Faster only for searches of depth;
    tests of inside use voxels."""
    bound_m = DECIMATION_SHARE * skin.skin.least_edge_m
    is_fine = any(isinstance(shape, MeshVolume) and shape.is_fine for shape in animated.shapes)
    if not (is_fine and 0.0 < bound_m < np.inf) or animated.matrices is None or not len(rows):
        return animated
    # Only where the volume's box meets the body's box over the block.
    shape_ids, matrices = animated.shapes_at(rows), animated.matrices[rows]
    boxes = np.concatenate(
        [world_bounds(animated.shapes[k], matrices[shape_ids == k]) for k in np.unique(shape_ids)]
    )
    bodies = bounds.of_rows[np.searchsorted(bounds.rows, rows)]
    if not (
        (boxes[:, 0].min(axis=0) <= bodies[:, 1].max(axis=0)).all()
        and (boxes[:, 1].max(axis=0) >= bodies[:, 0].min(axis=0)).all()
    ):
        return animated
    # The accepted error scales with the body; a shrunken body keeps the fine mesh.
    sizes = np.linalg.norm(bodies[:, 1] - bodies[:, 0], axis=1)
    is_grown = sizes >= _SMALLEST_BODY * np.linalg.norm(np.ptp(skin.skin.model.vertices, axis=0))
    shapes, index = of_fewer_faces(
        animated.shapes, shape_ids, matrices, np.where(is_grown, bound_m, 0.0)
    )
    shape_index = np.zeros(len(animated.levels), np.int32)
    shape_index[rows] = index
    return replace(animated, shapes=shapes, shape_index=shape_index)
