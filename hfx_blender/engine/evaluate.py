# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine: from what is where, to which vertices feel what."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from . import contact, on_demand, spot, vector_sensation
from .active_rows import active_rows, followed, posed_rows, with_pose
from .body.model import PerceptualModel, load_model
from .body.posing import PosableModel
from .bound_skins import BoundSkins
from .counters import Counters
from .modality import MODALITIES
from .on_demand import ON_DEMAND, ON_DEMAND_HERE
from .reach import BlockReach
from .response.answering import Answering, depths_of, with_own_sets
from .samples import Impact, SampleRun, Stream
from .scene import (
    ActuatorArea,
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticSurface,
    HapticVolume,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SpotArea,
)
from .surface_effects import SurfaceEffects
from .tolerance import STANDARD, Tolerance

I32 = npt.NDArray[np.int32]
F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


class Engine:
    """Evaluates one scene, block by block, and does only what its active effects require.

    Parameters
    ----------
    scene : SceneDescription
    record : iterable of str
        What samples carry besides vertices and weights: any of ``ON_DEMAND`` and
        ``ON_DEMAND_HERE``.
    models : callable
        Loads a perceptual model by its id; called at the first moment it is needed.
    tolerance : Tolerance
        The error that is accepted; ``PAPER`` tests vertices, all others sample their skin.
    """

    def __init__(
        self,
        scene: SceneDescription,
        *,
        record: Iterable[str] = (),
        models: Callable[[str], PerceptualModel] = load_model,
        tolerance: Tolerance = STANDARD,
    ) -> None:
        self.scene = scene
        self.counters = Counters()
        self._record = frozenset(record)
        known = ON_DEMAND | ON_DEMAND_HERE
        if not self._record <= known:
            raise ValueError(f"record: expected some of {sorted(known)}, got {record}")
        self._skins = BoundSkins(models, tolerance, self.counters)
        self._spots: dict[str, spot.SpotSkin] = {}
        self._body_index = {body.id: i for i, body in enumerate(scene.bodies)}
        self.responses = Answering(scene)
        self._surfaces = SurfaceEffects(1.0 / float(scene.time.rate_hz), self.counters)

    def evaluate(self, block: AnimationBlock) -> list[SampleRun]:
        """Samples of a block: one run for each effect and body that felt something."""
        effects = list(zip(self.scene.effects, block.effects, strict=True))
        rows_of = [active_rows(e, b, block, self.counters) for e, b in effects]
        active = np.unique(np.concatenate([np.zeros(0, np.int64), *rows_of]))
        self.counters.times_evaluated += len(active)
        self.counters.times_skipped += len(block.indices) - block.history - len(active)
        reach = BlockReach(block, self.scene.bodies, self._skins)
        runs: list[SampleRun] = []
        for (effect, animated), rows in zip(effects, rows_of, strict=True):
            if len(rows):
                runs += self._felt(effect, animated, rows, block, reach)
        self.counters.contacts += sum(int(run.sizes.sum()) for run in runs)
        return runs

    def _felt(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
        reach: BlockReach,
    ) -> list[SampleRun]:
        """One effect at the rows where it is on: each kind of area has its own way.

        What changes a kind of area is decided here; what changes all samples of an effect,
        whatever its area (a filter of its response), goes over the runs before they are returned.
        """
        area = effect.area
        if isinstance(area, PaintedArea):
            found = [self._painted_run(effect, area, animated, rows, block)]
        elif isinstance(area, SpotArea):
            found = [self._spot_run(effect, area, animated, rows, block)]
        elif isinstance(area, ActuatorArea):
            found = [self._actuator_run(effect, area, animated, rows, block)]
        elif isinstance(area, HapticSurface):
            found = [
                self._surface_run(effect, animated, rows, body, block, reach)
                for body in self.scene.bodies
            ]
        else:
            found = [
                self._volume_run(effect, area, animated, rows, body, block, reach)
                for body in self.scene.bodies
            ]
            if area.response:
                found = [
                    self._answered(effect, animated, rows, body, block, reach, run)
                    for body, run in zip(self.scene.bodies, found, strict=True)
                ]
        return [run for run in found if run is not None]

    def _painted_run(
        self,
        effect: EffectDescription,
        area: PaintedArea,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
    ) -> SampleRun | None:
        positions = velocities = None
        sets = np.zeros(len(rows), np.int64)
        if self._record & {"positions", "velocities"}:
            k = self._body_index[area.body_id]
            body, pose = self.scene.bodies[k], block.poses[k]
            if not pose.valid[rows].all():
                raise ValueError("positions of painted vertices need a reader with_positions")
            rows = with_pose(rows, posed_rows(pose), body, self.counters)
            if not len(rows):
                return None
            positions, velocities = self._motion(
                self._skins.of(body, effect.model_id).vertices,
                pose,
                rows,
                [area.vertices] * len(rows),
                block.indices,
            )
        if self._record:
            sets = np.arange(len(rows))
        count = int(sets[-1]) + 1
        return self._run(
            effect,
            area.body_id,
            animated,
            rows,
            block,
            sets=sets,
            offsets=np.arange(count + 1, dtype=np.int64) * len(area.vertices),
            vertices=np.tile(area.vertices, count),
            weights=np.tile(area.weights, count),
            positions=positions,
            velocities=velocities,
        )

    def _spot_run(
        self,
        effect: EffectDescription,
        area: SpotArea,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
    ) -> SampleRun | None:
        rows, focus = spot.focus_of(effect.name, area, animated, rows, self.counters)
        k = self._body_index[area.body_id]
        body, pose = self.scene.bodies[k], block.poses[k]
        with_motion = bool(self._record & {"positions", "velocities"})
        if with_motion:
            known = with_pose(rows, posed_rows(pose), body, self.counters)
            rows, focus = known, focus[np.isin(rows, known)]
        if not len(rows):
            return None
        if effect.model_id not in self._spots:
            self._spots[effect.model_id] = spot.SpotSkin(self._skins.model(effect.model_id))
        assert animated.place is not None
        radii_m = np.maximum(animated.place[rows, 1], 0.0)
        found = self._spots[effect.model_id].sets(
            focus, radii_m, area.falloff, own_sets=bool(self._record)
        )
        positions = velocities = None
        if with_motion:
            touched = [found.vertices[a:b] for a, b in pairwise(found.offsets)]
            skin = self._skins.of(body, effect.model_id).vertices
            positions, velocities = self._motion(skin, pose, rows, touched, block.indices)
        run = self._run(
            effect,
            area.body_id,
            animated,
            rows,
            block,
            sets=found.sets,
            offsets=found.offsets,
            vertices=found.vertices,
            weights=found.weights,
            positions=positions,
            velocities=velocities,
        )
        return replace(run, focus=focus)

    def _actuator_run(
        self,
        effect: EffectDescription,
        area: ActuatorArea,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
    ) -> SampleRun | None:
        rows, drive = vector_sensation.driven(effect.name, area, animated, rows, self.counters)
        if not len(rows):
            return None
        count = len(rows) if self._record else 1
        nothing = np.zeros((0, 3), np.float32)
        run = self._run(
            effect,
            area.body_id,
            animated,
            rows,
            block,
            sets=np.minimum(np.arange(len(rows)), count - 1),
            offsets=np.zeros(count + 1, np.int64),
            vertices=np.zeros(0, np.int32),
            weights=np.zeros(0, np.float32),
            positions=nothing,
            velocities=nothing,
        )
        return replace(run, drive=drive)

    def _volume_run(
        self,
        effect: EffectDescription,
        volume: HapticVolume,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        reach: BlockReach,
    ) -> SampleRun | None:
        pose = block.poses[self._body_index[body.id]]
        posed = reach.posed(body)
        rows = with_pose(rows, posed, body, self.counters)
        if not len(rows):
            return None
        if reach.is_clear(animated, body, effect.model_id):
            self.counters.volume_tests += len(rows)
            return None
        rows, heard, follows = followed(rows, posed, animated, block)
        skin = self._skins.of(body, effect.model_id)
        hits = contact.find(
            animated,
            volume.falloff,
            rows,
            skin,
            pose,
            reach.bounds(body, effect.model_id),
            self.counters,
            follows=follows,
            heard=heard,
            own_sets=bool(self._record),
            with_details=bool(self._record & {"depth", "surface"}),
            with_impact="impact" in self._record,
        )
        if not len(hits.rows):
            return None
        positions = velocities = None
        if self._record & {"positions", "velocities"}:
            touched = [hits.vertices[a:b] for a, b in pairwise(hits.offsets)]
            positions, velocities = self._motion(
                skin.vertices, pose, hits.rows, touched, block.indices
            )
        depth = surface = normals = impact = None
        if hits.details is not None:
            if "depth" in self._record:
                depth = on_demand.depths(animated, hits)
            if "surface" in self._record:
                surface, normals = on_demand.surface(animated, hits)
            if "impact" in self._record:
                impact = on_demand.impact(animated, hits, block.indices, self.scene.time)
        return self._run(
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

    def _surface_run(
        self,
        effect: EffectDescription,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        reach: BlockReach,
    ) -> SampleRun | None:
        pose = block.poses[self._body_index[body.id]]
        rows = with_pose(rows, reach.posed(body), body, self.counters)
        if not len(rows):
            return None
        skin = self._skins.of(body, effect.model_id)
        bounds = reach.bounds(body, effect.model_id)
        felt = self._surfaces.evaluate(effect, animated, body.id, skin, pose, bounds, rows, block)
        if felt is None:
            return None
        positions = velocities = None
        if self._record & {"positions", "velocities"}:
            touched = [felt.vertices[a:b] for a, b in pairwise(felt.offsets)]
            positions, velocities = self._motion(
                skin.vertices, pose, felt.rows, touched, block.indices
            )
        run = self._run(
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
            depth_m=felt.distance_m if "depth" in self._record else None,
        )
        return replace(run, parameters=felt.parameters)

    def _answered(
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
        pose = block.poses[self._body_index[body.id]]
        posed = reach.posed(body)
        rows = rows[np.isin(rows, posed)]
        if not len(rows):
            return None
        skin = self._skins.of(body, effect.model_id)
        near = reach.bounds(body, effect.model_id)
        felt = self.responses.answer(
            effect, body, animated, block, rows, posed, skin, pose, near, run
        )
        if felt is None or not self._record:
            return felt
        felt = with_own_sets(felt)
        if self._record & {"positions", "velocities"}:
            at = np.searchsorted(block.indices, felt.indices)
            touched = [felt.vertices[a:b] for a, b in pairwise(felt.offsets)]
            positions, velocities = self._motion(skin.vertices, pose, at, touched, block.indices)
            if "positions" in self._record:
                felt = replace(felt, positions=positions)
            if "velocities" in self._record:
                felt = replace(felt, velocities=velocities)
        if "depth" in self._record:
            felt = replace(felt, depth_m=depths_of(felt, run))
        return felt

    def _run(
        self,
        effect: EffectDescription,
        body_id: str,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
        *,
        sets: I64,
        offsets: I64,
        vertices: I32,
        weights: F32,
        positions: F32 | None,
        velocities: F32 | None,
        depth_m: F32 | None = None,
        surface: F32 | None = None,
        surface_normals: F32 | None = None,
        impact: Impact | None = None,
    ) -> SampleRun:
        indices = block.indices[rows]
        parameters = MODALITIES[effect.modality].parameters
        return SampleRun(
            stream=Stream(effect.id, body_id, effect.modality, effect.model_id),
            indices=indices,
            times_s=self.scene.time.times_s(indices),
            levels=np.clip(animated.levels[rows], 0.0, 1.0),
            parameters=np.clip(
                animated.parameters[rows],
                [parameter.minimum for parameter in parameters],
                [parameter.maximum for parameter in parameters],
            ),
            sets=None if self._record else sets,
            offsets=offsets,
            vertices=vertices,
            weights=weights,
            positions=positions if "positions" in self._record else None,
            velocities=velocities if "velocities" in self._record else None,
            depth_m=depth_m,
            surface=surface,
            surface_normals=surface_normals,
            impact=impact,
        )

    def _motion(
        self,
        model: PosableModel,
        pose: PoseBlock,
        rows: I64,
        vertices: list[I32],
        indices: I64,
    ) -> tuple[F32, F32]:
        """See :func:`on_demand.motion`."""
        self.counters.vertices_posed += sum(len(ids) for ids in vertices)
        return on_demand.motion(
            model,
            pose,
            rows,
            vertices,
            indices,
            1.0 / float(self.scene.time.rate_hz),
            with_velocities="velocities" in self._record,
        )
