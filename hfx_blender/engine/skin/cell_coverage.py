# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin that perceptual vertices stand for, and the samples of these cells.

A vertex stands for its cell of skin: the places that are nearer to it than to its neighbours,
each distance counted in the neighbour's own spacing. A cell is sampled in its triangles; on
limbs, where the temperature model has too few to follow the skin, in those of a finer model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..arrays import F64, I32, I64, ramp, sorted_by
from ..body.model import PerceptualModel
from ..body.temperature_cells import cell_of_skin
from ..native import cluster_bounds as native
from ..native import library
from ..native.cluster_bounds import CellGroups, Outline
from ..native.skin import UsedBones
from ..scene import SkinBinding, SurfaceBinding
from ..tolerance import Tolerance
from .posing import PosableModel, clusters_of
from .skin_table import SkinMesh, SkinTable
from .skinned_model import SkinnedModel

FINEST_SHARE: Final = 1.0 / 8.0
FINEST_M: Final = (0.00025, 0.001)
"""Distance of samples where no error at all is accepted: an eighth of the spacing of vertices,
and between these. A finer one changes no coverage by more than a hundredth, however a pose
stretches the skin."""

_HEXAGON: Final = math.sqrt(2.0 / math.sqrt(3.0))  # spacing of cells of area 1


def spacing_m(area_m2: F64) -> F64:
    """Distance of neighbours whose cells have this area."""
    spacing: F64 = _HEXAGON * np.sqrt(area_m2)
    return spacing


def sample_distance_m(tolerance: Tolerance, spacing: F64) -> F64:
    """Accepted distance of skin from its sample where vertices are ``spacing`` apart, metres.

    A sample stands for the skin around it. Where all of that is within the accepted error, the
    sample is inside if the skin is inside of a volume that much smaller, and is not if the skin
    is outside of one that much larger: so no edge of a contact is found farther off. What asks
    for less than the finest gets the finest.
    """
    wanted = np.minimum(tolerance.spacing_share * spacing, tolerance.distance_m)
    return np.maximum(wanted, finest_m(spacing))


def finest_m(spacing: F64) -> F64:
    """Accepted distance where no error is accepted, metres."""
    finest: F64 = np.clip(FINEST_SHARE * spacing, *FINEST_M)
    return finest


def _is_split(model: PerceptualModel, tolerance: Tolerance) -> bool:
    """Test that single vertices do not represent enough of the skin.

    No skin is farther from its vertex than the vertices around.
    """
    is_asked = tolerance.spacing_share < 1.0 or math.isfinite(tolerance.distance_m)
    return is_asked and len(model.triangles) > 0


def finer_id(model: PerceptualModel, tolerance: Tolerance) -> str | None:
    """Id of the model whose surface a model's cells are sampled on; None for its own.

    Vertices of the temperature model are too far apart to follow a limb's surface.
    """
    if model.modality != "temperature" or not _is_split(model, tolerance):
        return None
    return cell_of_skin(model)[0]


class SkinCoverage:
    """Sampling of one perceptual model's cells; shared by all bodies that have the model.

    Parameters
    ----------
    finer : PerceptualModel, optional
        The model of :func:`finer_id`; without it the model's own triangles are its skin.

    Attributes
    ----------
    is_split : bool
        Whether any cell has more than one sample; the paper's test has not.
    edge_m : float
        How far off the edge of a contact may be where that is most.
    least_edge_m : float
        The same where it is least.
    finer : PerceptualModel or None
        As given.
    surface : PerceptualModel
        Whose triangles are the skin: the model itself or a finer one. This, the outlines and the
        table are for the compiled library; without it clusters are of the model's vertices.
    clusters : list of (C,) int32
        Vertices of the model that are looked at together.
    outlines : list of (n,) int32
        For each cluster the vertices of the surface that its skin lies between.
    margins_m : (number of clusters,) float64 or None
        How far the skin may bulge beyond them in the rest pose.
    """

    def __init__(
        self,
        model: PerceptualModel,
        tolerance: Tolerance,
        finer: PerceptualModel | None = None,
    ) -> None:
        self.model = model
        self.tolerance = tolerance
        spacing = spacing_m(model.areas_m2.astype(np.float64))
        self.is_split = _is_split(model, tolerance)
        self.surface, owner = model, np.arange(len(model), dtype=np.int32)
        self.finer = finer
        if finer is not None and library.is_there():
            self.surface, owner = finer, cell_of_skin(model)[1]
        self.edge_m = tolerance.edge_m(float(spacing.max()))
        self.least_edge_m = tolerance.edge_m(float(spacing.min()))
        self._owner = owner
        self._spacing = spacing[owner]  # (skin vertices,)
        if self.surface is model:
            self.clusters = clusters_of(model)
        else:
            self.clusters = clusters_of(model, load=np.bincount(owner, minlength=len(model)))
        self.outlines: list[I32] = self.clusters
        self.margins_m: F64 | None = None
        if self.is_split and library.is_there():
            self.outlines, self.margins_m = self._outlined()

    def _outlined(self) -> tuple[list[I32], F64]:
        """Outline of each cluster (its units, the corners around them), and the margin of
        its skin.
        """
        order, firsts = sorted_by(self._owner, len(self.model))
        cells = np.concatenate(self.clusters)
        step, cell_of = ramp(firsts[cells + 1] - firsts[cells])
        units = order[firsts[cells][cell_of] + step].astype(np.int32)
        cluster_of = owners_of(self.clusters, len(self.model))[self._owner]
        starts = sorted_by(cluster_of, len(self.clusters))[1]
        return native.outlined(SkinMesh.of(self.surface), starts, units, cluster_of)

    @cached_property
    def table(self) -> SkinTable:
        """Table of the skin's samples; filled cluster by cluster, as they are needed."""
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
    """A perceptual model's skin on one body.

    Parameters
    ----------
    skin : SkinCoverage
    binding : SkinBinding or SurfaceBinding
        To the body.
    bind : callable
        Binds a model to the body, in the clusters that it is given.
    """

    def __init__(
        self,
        skin: SkinCoverage,
        binding: SkinBinding | SurfaceBinding,
        bind: Callable[[PerceptualModel, list[I32]], PosableModel],
    ) -> None:
        self.skin, self.binding = skin, binding
        self._bind = bind
        self.surface = bind(skin.surface, skin.outlines)

    @cached_property
    def vertices(self) -> PosableModel:
        """The model's own vertices, in the clusters of the skin."""
        if self.skin.outlines is self.skin.clusters:
            return self.surface
        return self._bind(self.skin.model, self.skin.clusters)

    @cached_property
    def own_outline(self) -> Outline | None:
        """Boxes of what bones move of the model's own vertices; None where these are the skin's."""
        if not self.is_grouped:
            return None
        assert isinstance(self.vertices, SkinnedModel)
        return self.vertices.outline

    @cached_property
    def used_bones(self) -> UsedBones:
        """Bones that move any of the skin, or of the model's own vertices."""
        models = {self.surface, self.vertices} if self.is_grouped else {self.surface}
        used = [each.used_bones for each in models if isinstance(each, SkinnedModel)]
        return UsedBones(np.unique(np.concatenate(used)))

    @cached_property
    def _groups(self) -> CellGroups:
        return CellGroups(len(self.surface.clusters))

    def cell_groups(self, clusters: I64) -> Any:
        """Native table of bounds of cell sizes in a pose, with these clusters filled in; no skin
        is filled in for it. For bodies that bones move.
        """
        new = self._groups.missing(clusters)
        if len(new):
            assert isinstance(self.surface, SkinnedModel)
            own = None
            if self.is_grouped:
                assert isinstance(self.vertices, SkinnedModel)
                own = self.vertices.native_clusters(new)
            table = self.skin.table
            self._groups.add(new, table, table.mesh, self.surface.native_clusters(new), own)
        return self._groups.table

    @property
    def is_grouped(self) -> bool:
        """Test that groups differ from the clusters of the skin."""
        return self.skin.surface is not self.skin.model


def owners_of(clusters: list[I32], count: int) -> I64:
    """Cluster of each vertex, (count,)."""
    owners = np.zeros(count, np.int64)
    owners[np.concatenate(clusters)] = np.repeat(
        np.arange(len(clusters)), [len(ids) for ids in clusters]
    )
    return owners
