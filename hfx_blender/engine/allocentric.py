# SPDX-License-Identifier: GPL-3.0-or-later
"""Allocentric areas: what a body feels of the volumes and surfaces around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from . import contact, on_demand
from .active_rows import followed, of_read, with_pose
from .coverage import BodySkin
from .reach import BlockReach
from .response.answering import Answering, depths_of, with_own_sets
from .run_maker import RunMaker
from .samples import SampleRun
from .scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
)
from .surface_effects import SurfaceEffects
from .volume.mesh import MeshVolume

if TYPE_CHECKING:
    from .parallel.threads import Threads

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


class AllocentricAreas:
    """Runs of haptic volumes, of their responses, and of haptic surfaces."""

    def __init__(self, maker: RunMaker, responses: Answering, threads: Threads | None) -> None:
        self._maker = maker
        self._threads = threads
        self._responses = responses
        self._surfaces = SurfaceEffects(1.0 / float(maker.scene.time.rate_hz), maker.counters)

    def volume(
        self,
        effect: EffectDescription,
        volume: HapticVolume,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        reach: BlockReach,
    ) -> Callable[[], SampleRun | None]:
        """Begin with a volume's contacts with a body; what is returned waits for them."""
        pose = block.poses[self._maker.body_index[body.id]]
        posed = reach.posed(body)
        rows = with_pose(of_read(rows, pose), posed, body, self._maker.counters)
        if not len(rows):
            return _nothing
        if reach.is_clear(animated, body, effect.model_id):
            self._maker.counters.volume_tests += len(rows)
            return _nothing
        rows, heard, follows = followed(rows, posed, animated, block)
        skin = self._maker.skins.of(body, effect.model_id)
        counters = self._maker.counters
        before = counters.vertices_posed
        found = contact.begin(
            animated,
            volume.falloff,
            rows,
            skin,
            pose,
            reach.bounds(body, effect.model_id),
            counters,
            follows=follows,
            heard=heard,
            own_sets=bool(self._maker.record),
            with_details=bool(self._maker.record & {"depth", "surface"}),
            with_impact="impact" in self._maker.record,
            threads=self._threads,
            title=f"effect '{effect.name}'",
        )

        at_once = counters.vertices_posed - before

        def felt() -> SampleRun | None:
            before = counters.vertices_posed - at_once
            hits = found()
            if counters.vertices_posed > before:
                counters.reach(body.id)
                if any(isinstance(shape, MeshVolume) for shape in animated.shapes):
                    counters.meshes_searched += int(np.count_nonzero(heard))
            return self._felt(effect, animated, body, block, pose, skin, hits)

        return felt

    def _felt(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        body: BodyDescription,
        block: AnimationBlock,
        pose: PoseBlock,
        skin: BodySkin,
        hits: contact.Contacts,
    ) -> SampleRun | None:
        """What contacts feel like."""
        if not len(hits.rows):
            return None
        positions, velocities = self._maker.motion(
            skin.vertices, pose, hits.rows, hits.vertices, hits.offsets, block.indices
        )
        depth = surface = normals = impact = None
        if hits.details is not None:
            if "depth" in self._maker.record:
                depth = on_demand.depths(animated, hits)
            if "surface" in self._maker.record:
                surface, normals = on_demand.surface(animated, hits)
            if "impact" in self._maker.record:
                impact = on_demand.impact(animated, hits, block.indices, self._maker.scene.time)
        return self._maker.run(
            effect,
            body.id,
            animated,
            hits.rows,
            block,
            sets=hits.sets,
            offsets=hits.offsets,
            vertices=hits.vertices,
            weights=hits.weights.astype(np.float32),
            positions=positions,
            velocities=velocities,
            depth_m=depth,
            surface=surface,
            surface_normals=normals,
            impact=impact,
        )

    def surface(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        reach: BlockReach,
    ) -> SampleRun | None:
        """What a body feels of a surface that it moves over."""
        pose = block.poses[self._maker.body_index[body.id]]
        rows = with_pose(of_read(rows, pose), reach.posed(body), body, self._maker.counters)
        if not len(rows):
            return None
        skin = self._maker.skins.of(body, effect.model_id)
        bounds = reach.bounds(body, effect.model_id)
        felt = self._surfaces.evaluate(effect, animated, body.id, skin, pose, bounds, rows, block)
        if felt is None:
            return None
        positions, velocities = self._maker.motion(
            skin.vertices, pose, felt.rows, felt.vertices, felt.offsets, block.indices
        )
        run = self._maker.run(
            effect,
            body.id,
            animated,
            felt.rows,
            block,
            sets=np.arange(len(felt.rows)),
            offsets=felt.offsets,
            vertices=felt.vertices,
            weights=felt.weights,
            positions=positions,
            velocities=velocities,
            depth_m=felt.distance_m if "depth" in self._maker.record else None,
        )
        return replace(run, parameters=felt.parameters)

    def answered(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        reach: BlockReach,
        run: SampleRun | None,
    ) -> SampleRun | None:
        """What a volume's response makes of its contacts with a body."""
        pose = block.poses[self._maker.body_index[body.id]]
        posed = reach.posed(body)
        rows = rows[np.isin(rows, posed)]
        if not len(rows):
            return None
        skin = self._maker.skins.of(body, effect.model_id)
        near = reach.bounds(body, effect.model_id)
        felt = self._responses.answer(
            effect, body, animated, block, rows, posed, skin, pose, near, run
        )
        if felt is None or not self._maker.record:
            return felt
        felt = with_own_sets(felt)
        at = np.searchsorted(block.indices, felt.indices)
        positions, velocities = self._maker.motion(
            skin.vertices, pose, at, felt.vertices, felt.offsets, block.indices
        )
        if "positions" in self._maker.record:
            felt = replace(felt, positions=positions)
        if "velocities" in self._maker.record:
            felt = replace(felt, velocities=velocities)
        if "depth" in self._maker.record:
            felt = replace(felt, depth_m=depths_of(felt, run))
        return felt


def _nothing() -> None:
    return None
