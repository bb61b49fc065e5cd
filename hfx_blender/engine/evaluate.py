# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine: from what is where, to which vertices feel what."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from . import contact
from .body.model import PerceptualModel, load_model
from .body.posing import PosableModel, SkinnedModel, SurfaceModel
from .counters import Counters
from .coverage import BodySkin, Skin, finer_id
from .modality import MODALITIES
from .narrow import Details
from .samples import Impact, SampleRun, Stream
from .scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SurfaceBinding,
    TimeBase,
)
from .tolerance import STANDARD, Tolerance
from .volume.nearest_surface import boundary_normals, nearest_surface
from .volume.shape import Shape

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

ON_DEMAND = frozenset({"positions", "velocities", "depth"})
"""What samples carry only if they are asked to, and a track can hold."""

ON_DEMAND_HERE = frozenset({"surface", "impact"})
"""What samples carry only if they are asked to, and no track holds."""


_FARTHEST = 1e12
"""Metres, and entries of bone matrices: a pose beyond it is none, and its speed no float32."""


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
        self._load = models
        self._models: dict[str, PerceptualModel] = {}
        self._tolerance = tolerance
        self._skins: dict[tuple[str, str | None], Skin] = {}
        self._bound: dict[tuple[str, str], BodySkin] = {}
        self._body_index = {body.id: i for i, body in enumerate(scene.bodies)}

    def evaluate(self, block: AnimationBlock) -> list[SampleRun]:
        """Samples of a block: one run for each effect and body that felt something."""
        rows_of = [self._active_rows(e, b, block) for e, b in self._effects(block)]
        active = np.unique(np.concatenate([np.zeros(0, np.int64), *rows_of]))
        self.counters.times_evaluated += len(active)
        self.counters.times_skipped += len(block.indices) - block.history - len(active)
        bounds: dict[tuple[str, str], contact.ReachableBounds] = {}
        runs: list[SampleRun] = []
        for (effect, animated), rows in zip(self._effects(block), rows_of, strict=True):
            if not len(rows):
                continue
            area = effect.area
            if isinstance(area, PaintedArea):
                found = [self._painted_run(effect, area, animated, rows, block)]
            else:
                found = [
                    self._volume_run(effect, area, animated, rows, body, block, bounds)
                    for body in self.scene.bodies
                ]
            runs += [run for run in found if run is not None]
        self.counters.contacts += sum(int(run.sizes.sum()) for run in runs)
        return runs

    def _effects(self, block: AnimationBlock) -> Iterable[tuple[EffectDescription, EffectBlock]]:
        return zip(self.scene.effects, block.effects, strict=True)

    def _active_rows(
        self, effect: EffectDescription, animated: EffectBlock, block: AnimationBlock
    ) -> I64:
        """Rows at which an effect is on and all its values are numbers."""
        finite = np.isfinite(animated.levels) & np.isfinite(animated.parameters).all(axis=1)
        finite[: block.history] = True
        if not finite.all():
            self.counters.warn(
                f"effect '{effect.name}': a value is not a finite number; it is silent there",
                int(np.count_nonzero(~finite)),
            )
        on = finite & (np.where(finite, animated.levels, 0.0) > 0.0)
        on[: block.history] = False
        return np.flatnonzero(on)

    def _with_pose(self, rows: I64, posed: I64, body: BodyDescription) -> I64:
        """Those of ``rows`` whose pose is known."""
        known = np.isin(rows, posed)
        if not known.all():
            self.counters.warn(
                f"body '{body.name}': its pose is not a finite number; it feels nothing there",
                int(np.count_nonzero(~known)),
            )
        return rows[known]

    def _skin(self, body: BodyDescription, model_id: str) -> BodySkin:
        key = (body.id, model_id)
        if key not in self._bound:
            binding = body.binding

            def bind(model: PerceptualModel, clusters: list[I32]) -> PosableModel:
                if isinstance(binding, SkinBinding):
                    fitted = binding.fitted.get(model.id)
                    placed = model if fitted is None else fitted.of(model)
                    return SkinnedModel(placed, binding, clusters)
                return SurfaceModel(model, binding.anchors[model.id], clusters)

            self._bound[key] = BodySkin(self._skin_of(model_id, binding), bind)
        return self._bound[key]

    def _skin_of(self, model_id: str, binding: SkinBinding | SurfaceBinding) -> Skin:
        """One for all bodies whose binding can pose the same models."""
        model = self._model(model_id)
        fine = finer_id(model, self._tolerance)
        if isinstance(binding, SurfaceBinding):
            fine = fine if fine in binding.anchors else None
        elif model_id in binding.fitted:
            fine = fine if fine in binding.fitted else None
        if (model_id, fine) not in self._skins:
            finer = None if fine is None else self._model(fine)
            self._skins[model_id, fine] = Skin(model, self._tolerance, finer)
        return self._skins[model_id, fine]

    def _model(self, model_id: str) -> PerceptualModel:
        if model_id not in self._models:
            self._models[model_id] = self._load(model_id)
            self.counters.models_loaded.append(model_id)
        return self._models[model_id]

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
            rows = self._with_pose(rows, _posed_rows(pose), body)
            if not len(rows):
                return None
            positions, velocities = self._motion(
                self._skin(body, effect.model_id).vertices,
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

    def _volume_run(
        self,
        effect: EffectDescription,
        volume: HapticVolume,
        animated: EffectBlock,
        rows: I64,
        body: BodyDescription,
        block: AnimationBlock,
        bounds: dict[tuple[str, str], contact.ReachableBounds],
    ) -> SampleRun | None:
        pose = block.poses[self._body_index[body.id]]
        posed = _posed_rows(pose)
        rows = self._with_pose(rows, posed, body)
        if not len(rows):
            return None
        rows, heard, follows = _followed(rows, posed, animated, block)
        skin = self._skin(body, effect.model_id)
        key = (body.id, effect.model_id)
        if key not in bounds:
            bounds[key] = contact.bounds_of(skin, pose, posed)
        hits = contact.find(
            animated,
            volume.falloff,
            rows,
            skin,
            pose,
            bounds[key],
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
                depth = _depths(animated, hits)
            if "surface" in self._record:
                surface, normals = _surface(animated, hits)
            if "impact" in self._record:
                impact = _impact(animated, hits, block.indices, self.scene.time)
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
        """World positions and velocities of the vertices of each row, concatenated.

        Velocities are differences to the sample before, so that they do not look ahead;
        where the block does not hold it, they are 0.
        """
        step_s = 1.0 / float(self.scene.time.rate_hz)
        posed = frozenset(_posed_rows(pose).tolist())
        positions, velocities = [], []
        for row, ids in zip(rows, vertices, strict=True):
            here = model.points(ids, pose, int(row), pose.to_world[row])
            speed = np.zeros_like(here)
            known = int(row) - 1 in posed and indices[row - 1] == indices[row] - 1
            if "velocities" in self._record and known:
                before = model.points(ids, pose, int(row) - 1, pose.to_world[row - 1])
                speed = (here - before) / step_s
            positions.append(here.T)
            velocities.append(speed.T)
        self.counters.vertices_posed += sum(len(ids) for ids in vertices)
        return np.concatenate(positions).astype(np.float32), np.concatenate(velocities).astype(
            np.float32
        )


def _posed_rows(pose: PoseBlock) -> I64:
    """Rows that were read and hold nothing but numbers that a place can have."""
    finite = pose.valid.copy()
    for values in (pose.to_world, pose.bones, pose.surface):
        if values is not None:
            # NaN compares as false, too.
            finite &= (np.abs(values) <= _FARTHEST).reshape(len(values), -1).all(axis=1)
    return np.flatnonzero(finite)


def _followed(
    rows: I64, posed: I64, animated: EffectBlock, block: AnimationBlock
) -> tuple[I64, Bool, Bool]:
    """Rows with those that they follow; which are heard; which follow the row before them.

    A row follows the sample before its own if the effect was on then and the pose is known.
    """
    before = rows[rows > 0] - 1
    levels = animated.levels[before]
    before = before[
        (levels > 0.0)
        & np.isfinite(levels)
        & (block.indices[before] == block.indices[before + 1] - 1)
        & np.isin(before, posed)
    ]
    together = np.union1d(rows, before)
    return together, np.isin(together, rows), np.isin(together - 1, before)


def _by_row(
    animated: EffectBlock, hits: contact.Contacts
) -> Iterator[tuple[slice, Shape, F64, Details]]:
    """Where each row's contacts are, with the volume's shape and matrix."""
    assert animated.matrices is not None and hits.details is not None
    for k, row in enumerate(hits.rows):
        part = slice(int(hits.offsets[k]), int(hits.offsets[k + 1]))
        which = 0 if animated.shape_index is None else int(animated.shape_index[row])
        yield part, animated.shapes[which], animated.matrices[row], hits.details


def _depths(animated: EffectBlock, hits: contact.Contacts) -> F32:
    depths = np.zeros(len(hits.vertices), np.float32)
    for part, shape, matrix, details in _by_row(animated, hits):
        depths[part] = shape.depth_m(details.places[:, part], matrix)
    return depths


def _surface(animated: EffectBlock, hits: contact.Contacts) -> tuple[F32, F32]:
    places = np.zeros((len(hits.vertices), 3), np.float32)
    normals = np.zeros_like(places)
    for part, shape, matrix, details in _by_row(animated, hits):
        place, normal = nearest_surface(shape, details.places[:, part], matrix)
        places[part], normals[part] = place.T, normal.T
    return places, normals


def _impact(animated: EffectBlock, hits: contact.Contacts, indices: I64, time: TimeBase) -> Impact:
    count = len(hits.vertices)
    times, speeds = np.full(count, np.nan), np.full(count, np.nan, np.float32)
    normals = np.full((count, 3), np.nan, np.float32)
    rate = float(time.rate_hz)
    ends = time.times_s(indices[hits.rows])
    for end, (part, shape, matrix, details) in zip(ends, _by_row(animated, hits), strict=True):
        began = np.flatnonzero(~np.isnan(details.since[part])) + part.start
        if len(began):
            normal = boundary_normals(shape, details.entries[:, began], matrix)
            way = matrix[:3, :3] @ details.ways[:, began]
            times[began] = end + (details.since[began] - 1.0) / rate
            speeds[began] = np.maximum(-np.einsum("in,in->n", way, normal) * rate, 0.0)
            normals[began] = normal.T
    return Impact(times, speeds, normals)
