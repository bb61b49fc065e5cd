# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin represented by perceptual vertices, their samples, and skins bound to bodies.

The cell of a vertex has the points nearer to the vertex than to neighbours, with distances relative
to the spacing of each vertex. Cells are sampled in their triangles; cells of the temperature model
on limbs, too coarse to follow the skin, in the triangles of a finer model.
"""

import math
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..arrays import F64, I32, I64, expand, sorted_by
from ..body.levels_and_cells import cell_of_skin
from ..body.model import PerceptualModel
from ..counters import Counters
from ..native import library
from ..native.cluster_bounds import Outline
from ..scene import BodyDescription, SkinBinding, SurfaceBinding
from ..tolerance import Tolerance
from .bound_clusters import CellGroups, UsedBones
from .posing import BlendedModel, PointwiseModel, SurfaceModel, clusters_of
from .skin_table import SkinMesh, SkinTable
from .skinned_model import SkinnedModel

FINEST_SHARE: Final = 1.0 / 8.0
FINEST_M: Final = (0.00025, 0.001)
"""Smallest distance of samples: an eighth of the vertex spacing, clipped to this range, metres.

Finer samples change coverages by less than 0.01 in any pose."""

PosableModel = PointwiseModel | SkinnedModel  # perceptual model bound to a body
_HEXAGON: Final = math.sqrt(2.0 / math.sqrt(3.0))  # spacing of cells of area 1


def spacing_m(area_m2: F64) -> F64:
    """Distance of neighbouring vertices with cells of an area (hexagonal), metres."""
    return np.asarray(_HEXAGON * np.sqrt(area_m2))


def sample_distance_m(tolerance: Tolerance, spacing: F64) -> F64:
    """Accepted distance of skin from its sample, metres, for vertices ``spacing`` apart.

    At least :func:`finest_m`. A sample represents the skin within this distance. So a sample is
    inside if the skin is inside a volume smaller by the distance, and outside if the skin is
    outside a volume larger by the distance: the edge of a contact is off by no more.
    """
    accepted = np.minimum(tolerance.spacing_share * spacing, tolerance.distance_m)
    return np.maximum(accepted, finest_m(spacing))


def finest_m(spacing: F64) -> F64:
    """Smallest distance of samples, metres: an eighth of ``spacing``, clipped to 0.25 to 1 mm."""
    return np.asarray(np.clip(FINEST_SHARE * spacing, *FINEST_M))


def _is_split(model: PerceptualModel, tolerance: Tolerance) -> bool:
    """True if a tolerance requires more samples than the vertices of a model with triangles: a
    share below 1 or a finite distance. Skin is never farther from the vertex than the spacing."""
    is_finer = tolerance.spacing_share < 1.0 or math.isfinite(tolerance.distance_m)
    return is_finer and len(model.triangles) > 0


def finer_id(model: PerceptualModel, tolerance: Tolerance) -> str | None:
    """Id of a finer model to sample a model's cells on, or None for the model itself. Only for
    temperature models, whose vertices are too far apart on limbs."""
    if model.modality != "temperature" or not _is_split(model, tolerance):
        return None
    return cell_of_skin(model)[0]


class SkinCoverage:
    """Samples of a perceptual model's cells, shared by all bodies with the model.

    ``finer`` is the model of :func:`finer_id`; without it the model's own triangles are the skin.
    ``is_split``: cells have several samples (False at tolerance ``paper``). ``edge_m`` and
    ``least_edge_m`` are the largest and smallest accepted error of the edge of a contact over the
    model, metres. ``clusters`` are the model's vertices (C,) tested together. For the compiled
    library, ``surface`` is the model with the triangles of the skin, and for each cluster
    ``outlines`` are the vertices (n,) of the surface around its skin, ``margins_m`` (or None) the
    bulge of the skin beyond the outline in rest pose.
    """

    def __init__(
        self, model: PerceptualModel, tolerance: Tolerance, finer: PerceptualModel | None = None
    ) -> None:
        self.model = model
        self.tolerance = tolerance
        spacing = spacing_m(model.areas_m2.astype(np.float64))
        self.is_split = _is_split(model, tolerance)
        self.surface, owner = model, np.arange(len(model), dtype=np.int32)
        self.finer = finer
        # Sampled on the finer model's triangles: ``owner`` maps its vertices to cells.
        if finer is not None and library.is_there():
            self.surface, owner = finer, cell_of_skin(model)[1]
        self.edge_m = tolerance.edge_m(float(spacing.max()))
        self.least_edge_m = tolerance.edge_m(float(spacing.min()))
        self._owner = owner
        self._spacing = spacing[owner]  # (skin vertices,)
        # Clusters are limited by the number of skin vertices, not of cells.
        if self.surface is model:
            self.clusters = clusters_of(model)
        else:
            self.clusters = clusters_of(model, load=np.bincount(owner, minlength=len(model)))
        self.outlines: list[I32] = self.clusters
        self.margins_m: F64 | None = None
        if self.is_split and library.is_there():
            # Skin vertices grouped by cell, then in the order of the cells in the clusters: units
            # come first in an outline, then the corners around them.
            order, firsts = sorted_by(owner, len(model))
            units = order[expand(firsts, np.concatenate(self.clusters))[0]].astype(np.int32)
            cluster_of = owners_of(self.clusters, len(model))[owner]
            starts = sorted_by(cluster_of, len(self.clusters))[1]
            mesh = SkinMesh.of(self.surface)
            self.outlines, self.margins_m = mesh.outlined(starts, units, cluster_of)

    @cached_property
    def table(self) -> SkinTable:
        """Table of the skin's samples, cached, without any cluster filled at first."""
        return SkinTable(
            self.surface,
            self.clusters,
            self.outlines,
            self._owner,
            sample_distance_m(self.tolerance, self._spacing),
            finest_m(self._spacing),
            self.is_split,
            self.tolerance,
        )


class BodySkin:
    """Skin of a perceptual model on one body. ``bind`` returns a model bound to the body, given the
    model and its clusters."""

    def __init__(
        self,
        skin: SkinCoverage,
        binding: SkinBinding | SurfaceBinding,
        bind: Callable[[PerceptualModel, list[I32]], PosableModel],
    ) -> None:
        self.skin, self.binding = skin, binding
        self._bind = bind
        self.surface = bind(skin.surface, skin.outlines)  # posable skin

    @cached_property
    def vertices(self) -> PosableModel:
        """Posable vertices of the model, in clusters of the skin; the skin's surface if equal."""
        if self.skin.outlines is self.skin.clusters:
            return self.surface
        return self._bind(self.skin.model, self.skin.clusters)

    @cached_property
    def own_outline(self) -> Outline | None:
        """Bone boxes of the model's own vertices for the native library; None if these are the
        skin's vertices."""
        if not self.is_grouped:
            return None
        assert isinstance(self.vertices, SkinnedModel)
        return self.vertices.outline

    @cached_property
    def used_bones(self) -> UsedBones:
        """Unique bones with weights on the skin or on the vertices of the model; only for bodies
        moved by bones."""
        models = {self.surface, self.vertices} if self.is_grouped else {self.surface}
        used = [model.used_bones for model in models if isinstance(model, SkinnedModel)]
        return UsedBones(np.unique(np.concatenate(used)))

    @cached_property
    def _groups(self) -> CellGroups:
        return CellGroups(len(self.surface.clusters))

    def cell_groups(self, clusters: I64) -> Any:
        """Native table of bounds of cell sizes in a pose, with the given clusters filled (ids).
        Only for bodies moved by bones. Does not fill the skin table."""
        missing = self._groups.missing(clusters)
        if len(missing):
            assert isinstance(self.surface, SkinnedModel)
            own_clusters = None
            if self.is_grouped:
                assert isinstance(self.vertices, SkinnedModel)
                own_clusters = self.vertices.native_clusters(missing)
            # Sizes also depend on the bones of the cells' vertices, where of another model.
            surface = self.surface.native_clusters(missing)
            self._groups.add(missing, self.skin.table, surface, own_clusters)
        return self._groups.table

    def fill(self) -> None:
        """Compute the tables of all clusters, which otherwise wait for the first contact of each
        cluster with a volume; needs the compiled library."""
        every = np.arange(len(self.surface.clusters))
        self.skin.table.need(every)
        if isinstance(self.surface, SkinnedModel):
            self.surface.native_clusters(every, self.skin.table)
            self.cell_groups(every)

    def is_moved_by(self, binding: SkinBinding | SurfaceBinding) -> bool:
        """Test for a binding to bones with the bones and fits of this skin's own binding; False if
        either binding is to a surface."""
        own = self.binding
        if isinstance(own, SurfaceBinding) or isinstance(binding, SurfaceBinding):
            return False
        model_ids = {self.skin.model.id, self.skin.surface.id}
        fits = [(own.fitted.get(name), binding.fitted.get(name)) for name in model_ids]
        return own.bone_names == binding.bone_names and all(
            now is before or (before is not None and before.is_moved_as(now))
            for before, now in fits
        )

    @property
    def is_grouped(self) -> bool:
        """True if the skin's vertices belong to another model."""
        return self.skin.surface is not self.skin.model


class BoundSkins:
    """Cache of the skins of a scene; ``counters`` count loaded models. ``models`` loads a
    perceptual model by id on first use."""

    def __init__(
        self, models: Callable[[str], PerceptualModel], tolerance: Tolerance, counters: Counters
    ) -> None:
        self._load = models
        self._tolerance = tolerance
        self._counters = counters
        self._models: dict[str, PerceptualModel] = {}
        self._skins: dict[tuple[str, str | None], SkinCoverage] = {}
        self._bound: dict[tuple[str, str], BodySkin] = {}

    def keep(self, before: "BoundSkins", bodies: Iterable[BodyDescription]) -> None:
        """Use loaded models and computed tables of ``before``, the skins of an earlier description
        of the scene, for the given ``bodies``. No effect with another tolerance; a body that has
        another binding to bones, or follows a surface, keeps none of its skins. Tables are not
        copied: both objects use, and fill, the same tables.
        """
        if before._tolerance != self._tolerance:
            return
        self._models, self._skins = before._models, before._skins
        bindings = {body.id: body.binding for body in bodies}
        for (body_id, model_id), skin in before._bound.items():
            binding = bindings.get(body_id)
            if binding is None or not skin.is_moved_by(binding):
                continue
            if skin.skin is self._skin_of(model_id, binding):
                self._bound[body_id, model_id] = skin

    def of(self, body: BodyDescription, model_id: str) -> BodySkin:
        """Skin of a model bound to a body, cached; by surface anchors, or fitted or canonical skin
        weights."""
        key = (body.id, model_id)
        if key not in self._bound:
            binding = body.binding

            def bind(model: PerceptualModel, clusters: list[I32]) -> PosableModel:
                if isinstance(binding, SurfaceBinding):
                    return SurfaceModel(model, binding.anchors[model.id], clusters)
                fitted = binding.fitted.get(model.id)
                placed = model if fitted is None else fitted.of(model)
                kind = SkinnedModel if library.is_there() else BlendedModel
                return kind(placed, binding, clusters)

            self._bound[key] = BodySkin(self._skin_of(model_id, binding), binding, bind)
        return self._bound[key]

    def _skin_of(self, model_id: str, binding: SkinBinding | SurfaceBinding) -> SkinCoverage:
        """Cached skin coverage of a model, shared by bodies. Sampled on a finer model unless the
        body was fitted without the finer model."""
        model = self.model(model_id)
        # A fitted body has finer skin only if the finer model was fitted too.
        fine = finer_id(model, self._tolerance)
        if isinstance(binding, SurfaceBinding):
            fine = fine if fine in binding.anchors else None
        elif model_id in binding.fitted:
            fine = fine if fine in binding.fitted else None
        if (model_id, fine) not in self._skins:
            finer = None if fine is None else self.model(fine)
            self._skins[model_id, fine] = SkinCoverage(model, self._tolerance, finer)
        return self._skins[model_id, fine]

    def model(self, model_id: str) -> PerceptualModel:
        """Perceptual model by id, not fitted to a body, loaded and counted once."""
        if model_id not in self._models:
            self._models[model_id] = self._load(model_id)
            self._counters.models_loaded.append(model_id)
        return self._models[model_id]


def owners_of(clusters: list[I32], count: int) -> I64:
    """Index (count,) of the cluster of each of ``count`` vertices; 0 for vertices in no cluster."""
    owners = np.zeros(count, np.int64)
    owners[np.concatenate(clusters)] = np.repeat(
        np.arange(len(clusters)), [len(ids) for ids in clusters]
    )
    return owners
