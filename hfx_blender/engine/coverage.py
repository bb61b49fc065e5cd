# SPDX-License-Identifier: GPL-3.0-or-later
"""The skin that a perceptual vertex stands for, and where it is sampled.

A vertex stands for its cell of skin: the places that are nearer to it than to its neighbours,
each distance counted in the neighbour's own spacing. A cell is sampled in its triangles; on
limbs, where the temperature model has too few to follow the skin, in those of a finer model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from .body.cells import cell_of_skin
from .body.clusters import clusters_of
from .body.model import PerceptualModel
from .body.posing import PosableModel
from .indexing import ramp
from .tolerance import Tolerance

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

FINEST_SHARE: Final = 1.0 / 8.0
FINEST_M: Final = (0.00025, 0.001)
"""Distance of samples where no error at all is accepted: an eighth of the spacing of vertices,
and between these. A finer one changes no coverage by more than a hundredth."""

_HEXAGON: Final = math.sqrt(2.0 / math.sqrt(3.0))  # spacing of cells of area 1
_FLAT_ENOUGH: Final = 0.1  # of the distance of samples: a lower bulge is not modelled
_BULGE_LIMIT: Final = 0.25  # of a triangle's size; more is a crease, not a curve


def spacing_m(area_m2: F64) -> F64:
    """Distance of neighbours whose cells have this area."""
    spacing: F64 = _HEXAGON * np.sqrt(area_m2)
    return spacing


def sample_distance_m(tolerance: Tolerance, spacing: F64) -> F64:
    """How far apart samples may be where vertices are ``spacing`` apart, metres.

    Samples no farther apart than the accepted error find every edge of a contact within it,
    and everything that is larger. What asks for less than the finest gets the finest.
    """
    wanted = np.minimum(tolerance.spacing_share * spacing, tolerance.distance_m)
    finest: F64 = np.clip(FINEST_SHARE * spacing, *FINEST_M)
    return np.maximum(wanted, finest)


def _distances(model: PerceptualModel, tolerance: Tolerance) -> tuple[F64, F64]:
    """Spacing and distance of samples at each vertex, metres."""
    spacing = spacing_m(model.areas_m2.astype(np.float64))
    return spacing, sample_distance_m(tolerance, spacing)


def _is_split(model: PerceptualModel, tolerance: Tolerance) -> bool:
    spacing, distance = _distances(model, tolerance)
    return bool((distance < spacing).any()) and len(model.triangles) > 0


def finer_id(model: PerceptualModel, tolerance: Tolerance) -> str | None:
    """The model whose surface a model's cells are sampled on; None where its own will do.

    Vertices of the temperature model are too far apart to follow a limb's surface.
    """
    if model.modality != "temperature" or not _is_split(model, tolerance):
        return None
    return cell_of_skin(model)[0]


@dataclass(frozen=True, eq=False)
class SkinPatch:
    """The skin of a cluster of cells, in units that belong to a skin vertex each.

    A unit is the vertex, and of each triangle around it the *quad* next to the vertex: from it
    over a place on one edge and a place inside to a place on the other edge. These places
    divide edges and triangle by the size of the cells, so that skin next to a much finer
    neighbour belongs to the coarser one. A quad is sampled at ``steps`` by ``steps`` places.
    """

    cells: I32  # (C,) ascending vertices of the perceptual model
    vertices: I32  # (n,) vertices of the skin: one for each unit, then corners around them
    units: int
    cell_starts: I64  # (C,) first unit of each cell; units come in the order of their cells
    unit_shares: F64  # (units,) of the cell's area, sum 1 in each cell
    vertex_shares: F64  # (units,) of the cell's area, that the sample at the vertex stands for
    steps: I64  # (units,) 0 where the vertex is the only sample
    reaches: F64  # (units,) how far samples go towards the farthest corner, as a share
    offsets: I64  # (units + 1,) unit ``u`` has the quads ``slice(offsets[u], offsets[u + 1])``
    around: I32  # (Q, 2) the triangle's other corners, places in ``vertices``
    places: F64  # (4, Q) along each edge and, inside, along both: the share of that edge
    areas: F64  # (3, Q) of samples at (s, t) of the unit square: first + s second + t third
    bulges: (
        F64  # (3, Q) of the edges to the corners and between them; times the weights of both ends
    )
    heights_m: F64  # (Q,) of the bulge in the rest pose; 0 where it does not count
    wholes: F64  # (Q,) of the cell's area, all samples of the quad together
    unit_of: I64  # (Q,)

    @cached_property
    def bulge_m(self) -> float:
        """The highest bulge, rest pose."""
        return float(self.heights_m.max(initial=0.0))

    def cells_of(self, units: I64) -> I64:
        """Places in ``cells`` of some units."""
        return np.searchsorted(self.cell_starts, units, side="right") - 1

    def quads_of(self, rows: I64, units: I64) -> tuple[I64, I64]:
        """All quads of some units, each unit at a row: rows and quads."""
        step, owner = ramp(self.offsets[units + 1] - self.offsets[units])
        return rows[owner], self.offsets[units][owner] + step

    def corners(self, rows: I64, quads: I64) -> tuple[I64, I64, I64]:
        """Where the corners of quads' triangles, each at a row, are in points (n V)."""
        first = rows * len(self.vertices)
        around = self.around[quads]
        return first + self.unit_of[quads], first + around[:, 0], first + around[:, 1]

    @property
    def links(self) -> I64:
        """Units, ascending, and the corners of their triangles, (2 Q, 2) places in ``vertices``."""
        return np.stack([np.repeat(self.unit_of, 2), self.around.ravel()], axis=1)


class Skin:
    """How one perceptual model's cells are sampled; the same for every body that has it.

    Parameters
    ----------
    model : PerceptualModel
    tolerance : Tolerance
    finer : PerceptualModel, optional
        The model of :func:`finer_id`; without it the model's own triangles are its skin.

    Attributes
    ----------
    is_split : bool
        Whether any cell has more than one sample; the paper's test has not.
    edge_m : float
        How far off the edge of a contact may be where that is most.
    surface : PerceptualModel
        Whose triangles are the skin: the model itself or a finer one.
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
        spacing, distance = _distances(model, tolerance)
        self.is_split = _is_split(model, tolerance)
        self.surface, owner = model, np.arange(len(model), dtype=np.int32)
        if finer is not None:
            self.surface, owner = finer, cell_of_skin(model)[1]
        self.edge_m = tolerance.edge_m(float(spacing.max()))
        self._owner = owner
        self._distance = distance[owner]  # (skin vertices,)
        if not self.is_split:
            self._distance = np.full(len(model), np.inf)
        if self.surface is model:
            self.clusters = clusters_of(model)
        else:
            self.clusters = clusters_of(model, load=np.bincount(owner, minlength=len(model)))
        self._patches: dict[int, SkinPatch] = {}
        self.outlines: list[I32] = self.clusters
        self.margins_m: F64 | None = None
        if self.is_split:
            self.outlines, self.margins_m = self._outlined()

    def changes(self, slopes: F64) -> F64:
        """How far a cell's mean may be from the value at its vertex, (n, number of clusters).

        ``slopes`` (n,) are the largest changes of that value in a metre of the rest pose.
        """
        changes: F64 = slopes[:, None] * self._sizes_m
        return changes

    @cached_property
    def _sizes_m(self) -> F64:
        """Mean distance of a cell's skin from its vertex, the largest of each cluster."""
        if not self.is_split:
            return np.zeros(len(self.clusters))
        areas = self.surface.areas_m2.astype(np.float64)
        own = 2.0 / 3.0 * np.sqrt(areas / np.pi)  # of a disc's points from its middle
        away = np.linalg.norm(
            self.surface.vertices - self.model.vertices[self._owner].astype(np.float64), axis=1
        )
        sums = np.bincount(self._owner, areas * np.maximum(away, own), len(self.model))
        means = sums / np.bincount(self._owner, areas, len(self.model))
        return np.array([means[cells].max() for cells in self.clusters])

    def _outlined(self) -> tuple[list[I32], F64]:
        """Each cluster's units and the corners around them, and how far skin may bulge there."""
        order, starts = self._units_of_cells
        cores = []
        for cells in self.clusters:
            step, cell_of = ramp(starts[cells + 1] - starts[cells])
            cores.append(order[starts[cells][cell_of] + step].astype(np.int32))
        cluster_of = np.zeros(len(self.surface), np.int64)
        cluster_of[np.concatenate(cores)] = np.repeat(
            np.arange(len(cores)), [len(core) for core in cores]
        )
        triangles = self.surface.triangles
        clusters = cluster_of[triangles]
        mixed = np.flatnonzero((clusters != clusters[:, :1]).any(axis=1))
        pairs = [
            clusters[mixed, a] * len(self.surface) + triangles[mixed, b]
            for a in range(3)
            for b in range(3)
            if a != b
        ]
        cluster, vertex = np.divmod(np.unique(np.concatenate(pairs)), len(self.surface))
        foreign = cluster_of[vertex] != cluster
        cluster, vertex = cluster[foreign], vertex[foreign]
        cuts = np.searchsorted(cluster, np.arange(len(cores) + 1))
        outlines = [
            np.concatenate([core, vertex[cuts[k] : cuts[k + 1]].astype(np.int32)])
            for k, core in enumerate(cores)
        ]
        margins = np.zeros(len(cores))
        np.maximum.at(margins, clusters.ravel(), np.repeat(self._bulge_bounds(), 3))
        return outlines, margins

    def _bulge_bounds(self) -> npt.NDArray[np.float32]:
        """No sample of a triangle is higher over it, (F,) metres."""
        corners = self.surface.triangles.T
        points = [self.surface.vertices[corner] for corner in corners]
        normals = [self.surface.normals[corner] for corner in corners]
        bounds = np.zeros(len(self.surface.triangles), np.float32)
        for one, other in ((0, 1), (1, 2), (2, 0)):
            edge = points[other] - points[one]
            both = np.abs(np.einsum("fi,fi->f", edge, normals[one]))
            both += np.abs(np.einsum("fi,fi->f", edge, normals[other]))
            np.maximum(bounds, both / 6.0, out=bounds)
        return bounds

    def patch(self, cluster: int) -> SkinPatch:
        """The skin of a cluster; made when first asked for."""
        if cluster not in self._patches:
            self._patches[cluster] = self._made(self.clusters[cluster], self.outlines[cluster])
        return self._patches[cluster]

    @cached_property
    def _is_split(self) -> Bool:
        """Skin vertices that stand for more than themselves."""
        return np.asarray(self._distance < spacing_m(self.surface.areas_m2.astype(np.float64)))

    @cached_property
    def _corner_order(self) -> tuple[I64, I64]:
        """Corners of triangles (3 f + k) by their vertex, and where each vertex's begin."""
        corners = self.surface.triangles.ravel()
        order = np.argsort(corners, kind="stable")
        starts = np.searchsorted(corners[order], np.arange(len(self.surface) + 1))
        return order, starts.astype(np.int64)

    @cached_property
    def _units_of_cells(self) -> tuple[I64, I64]:
        order = np.argsort(self._owner, kind="stable")
        starts = np.searchsorted(self._owner[order], np.arange(len(self.model) + 1))
        return order, starts.astype(np.int64)

    def _made(self, cells: I32, vertices: I32) -> SkinPatch:
        starts = self._units_of_cells[1]
        _, cell_of = ramp(starts[cells + 1] - starts[cells])
        count = len(cell_of)
        core = vertices[:count]

        corner_order, corner_starts = self._corner_order
        numbers = corner_starts[core + 1] - corner_starts[core]
        if not self.is_split:
            numbers = np.zeros_like(numbers)
        step, unit = ramp(numbers)
        face, turn = np.divmod(corner_order[corner_starts[core][unit] + step], 3)
        # Corners from the unit's own, the way round that the triangle goes.
        ring = np.stack(
            [self.surface.triangles[face, _TURNED[k].take(turn)] for k in range(3)], axis=1
        )
        quads = _Quads.of(self.surface, ring)
        areas = np.bincount(unit, quads.total, minlength=count)
        areas = np.where(areas > 0.0, areas, 1.0)

        distance = self._distance[core]
        longest, largest = np.zeros(count), np.zeros(count)
        np.maximum.at(longest, unit, quads.longest)
        np.maximum.at(largest, unit, quads.total)
        wanted = np.maximum(np.sqrt(largest), 0.5 * longest) / distance
        steps = np.maximum(np.ceil(wanted - 1e-9), 1.0).astype(np.int64)
        steps[~self._is_split[core]] = 0

        numbers = np.bincount(unit, minlength=count) * steps * steps
        cell_areas = np.bincount(cell_of, areas, minlength=len(cells))
        unit_shares = areas / cell_areas[cell_of]
        vertex_shares = unit_shares / (numbers + 1.0)
        scale = (unit_shares - vertex_shares) / areas / np.maximum(steps * steps, 1)

        heights = np.abs(quads.bulges).max(axis=0) / 3.0  # all three edges meet in the middle
        is_curved = heights * quads.sizes > _FLAT_ENOUGH * distance[unit]
        reaches = np.zeros(count)
        np.maximum.at(reaches, unit, quads.reaches + 2.0 * np.where(is_curved, heights, 0.0))
        reaches[steps == 0] = 0.0
        return SkinPatch(
            cells=cells,
            vertices=vertices,
            units=count,
            cell_starts=np.searchsorted(cell_of, np.arange(len(cells))).astype(np.int64),
            unit_shares=unit_shares,
            vertex_shares=vertex_shares,
            steps=steps,
            reaches=reaches,
            offsets=np.searchsorted(unit, np.arange(count + 1)).astype(np.int64),
            around=_placed(vertices, ring[:, 1:]),
            places=quads.places,
            areas=quads.areas * scale[unit],
            bulges=quads.bulges,
            heights_m=np.where(is_curved, heights * quads.sizes, 0.0),
            wholes=quads.total * (scale * steps * steps)[unit],
            unit_of=unit,
        )


_TURNED: Final = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])


@dataclass(frozen=True, eq=False)
class _Quads:
    """The quads at the first corners of triangles; see :class:`SkinPatch`."""

    places: F64  # (4, Q)
    areas: F64  # (3, Q) square metres
    total: F64  # (Q,) square metres
    longest: F64  # (Q,) metres: the longer of the sides on edges
    reaches: F64  # (Q,) greatest share of the way to the other corners
    bulges: F64  # (3, Q)
    sizes: F64  # (Q,) metres: square root of twice the triangle's area

    @classmethod
    def of(cls, surface: PerceptualModel, ring: I32) -> _Quads:
        corners = ring.T
        points = [surface.vertices[corner].T.astype(np.float64) for corner in corners]
        normals = [surface.normals[corner].T.astype(np.float64) for corner in corners]
        closeness = [1.0 / np.sqrt(np.maximum(surface.areas_m2[c], 1e-12)) for c in corners]
        one, two, three = (each.astype(np.float64) for each in closeness)
        along, across = points[1] - points[0], points[2] - points[0]
        cross = _cross(along, across)
        doubled = np.sqrt(_dot(cross, cross))
        sizes = np.sqrt(doubled)

        whole = one + two + three
        places = np.stack([two / (one + two), three / (one + three), two / whole, three / whole])
        # The place for (s, t) is s (1 - t) a + (1 - s) t b + s t c: its area is linear in both.
        edge, other, inner, inner_2 = places
        twist, twist_2 = inner - edge, inner_2 - other
        areas = np.stack([edge * other, edge * twist_2, twist * other]) * doubled
        lengths = np.sqrt(np.maximum(edge**2 * _dot(along, along), other**2 * _dot(across, across)))

        # A quadratic patch over the triangle, half of what Phong tessellation gives (Boubekeur
        # and Alexa, 2008): a chord of a circle and a triangle on a sphere then have their true
        # sagitta, to second order.
        with np.errstate(divide="ignore", invalid="ignore"):
            upright = [each * (_dot(each, cross) / doubled) for each in normals]
            bulges = 0.5 * np.stack(
                [
                    _dot(along, upright[1] - upright[0]),
                    _dot(across, upright[2] - upright[0]),
                    _dot(across - along, upright[2] - upright[1]),
                ]
            )
            bulges = bulges / sizes
        bulges[~np.isfinite(bulges)] = 0.0
        bulges = np.clip(bulges, -_BULGE_LIMIT, _BULGE_LIMIT)
        return cls(
            places,
            areas,
            areas[0] + 0.5 * areas[1] + 0.5 * areas[2],
            lengths,
            np.maximum(np.maximum(edge, other), inner + inner_2),
            bulges,
            sizes,
        )


def _dot(one: F64, other: F64) -> F64:
    product: F64 = np.einsum("ij,ij->j", one, other)
    return product


def _cross(one: F64, other: F64) -> F64:
    return np.stack(
        [
            one[1] * other[2] - one[2] * other[1],
            one[2] * other[0] - one[0] * other[2],
            one[0] * other[1] - one[1] * other[0],
        ]
    )


def _placed(vertices: I32, ring: I32) -> I32:
    """Where in ``vertices`` those of ``ring`` are."""
    order = np.argsort(vertices, kind="stable")
    return order[np.searchsorted(vertices[order], ring)].astype(np.int32)


class BodySkin:
    """A perceptual model's skin on one body.

    Parameters
    ----------
    skin : Skin
    bind : callable
        Binds a model to the body, in the clusters that it is given.
    """

    def __init__(
        self, skin: Skin, bind: Callable[[PerceptualModel, list[I32]], PosableModel]
    ) -> None:
        self.skin = skin
        self._bind = bind
        self.surface = bind(skin.surface, skin.outlines)

    @cached_property
    def vertices(self) -> PosableModel:
        """The model's own vertices, in the clusters of the skin."""
        if self.skin.outlines is self.skin.clusters:
            return self.surface
        return self._bind(self.skin.model, self.skin.clusters)

    @cached_property
    def cluster_of(self) -> I64:
        """The skin's cluster of each vertex of the model."""
        return _owners(self.skin.clusters, len(self.skin.model))

    @cached_property
    def groups(self) -> PosableModel:
        """The model's own vertices in the largest clusters that pay."""
        if self.skin.surface is self.skin.model:
            return self.vertices
        return self._bind(self.skin.model, clusters_of(self.skin.model))

    @cached_property
    def group_of(self) -> I64:
        """The group of each vertex of the model."""
        return _owners(self.groups.clusters, len(self.skin.model))


def _owners(clusters: list[I32], count: int) -> I64:
    owners = np.zeros(count, np.int64)
    owners[np.concatenate(clusters)] = np.repeat(
        np.arange(len(clusters)), [len(ids) for ids in clusters]
    )
    return owners
