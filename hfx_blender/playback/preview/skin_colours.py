# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of haptic samples on the vertices of a mesh, and the mesh as displayed.

Equal to the colours of ``engine.colouring``, but computed at coloured vertices only.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from ...engine.arrays import F32, F64, I32, I64, U8
from ...engine.colouring import Colour, Spread, colour_name, overlay, strengths
from ...engine.samples import Sample

# Height of colours over the skin, metres: avoids flicker.
_ABOVE_SKIN_M = 0.0015

Numbers = npt.NDArray[np.integer]


class Incidence:
    """Index of the occurrences of ``vertex_count`` vertices in ``table``, vertex indices of any
    shape.

    The attribute ``places`` (E,) has indices into the flattened table, sorted by vertex. Data of
    the table's entries is reordered by these once, then selected by :meth:`of`.
    """

    def __init__(self, table: Numbers, vertex_count: int) -> None:
        flat = table.ravel()
        self.places: I64 = np.argsort(flat, kind="stable")
        counts = np.bincount(flat, minlength=vertex_count)
        self._first = np.concatenate([[0], np.cumsum(counts)])

    def of(self, vertices: Numbers) -> tuple[I64, I64]:
        """Indices into ``places`` for vertices (n,), concatenated, and the count of each, (n,)."""
        # Concatenate the ranges begin..begin + count of all vertices without a loop: shift each
        # begin by the length of the ranges before it, repeat, and add a running number.
        begin = self._first.take(vertices)
        counts = self._first[1:].take(vertices) - begin
        begin -= counts.cumsum()
        begin += counts
        entries = np.repeat(begin, counts)
        entries += np.arange(len(entries))
        return entries, counts


class _Spreading:
    """Interpolation from a model of ``vertex_count`` vertices to a mesh, by model vertex."""

    def __init__(self, spread: Spread, vertex_count: int) -> None:
        self._where = Incidence(spread.nearest, vertex_count)
        # Entry e of the flattened table belongs to mesh vertex e // K, of K neighbours each.
        self._coloured = self._where.places // spread.nearest.shape[1]
        self._shares = spread.shares.ravel()[self._where.places]

    def of(self, sample: Sample, is_contact: bool) -> tuple[I64, F64]:
        """Mesh vertices (E,) of a sample, repeated for several model vertices, and the addend of
        each to the vertex's strength (E,)."""
        entries, counts = self._where.of(sample.vertices)
        strength = np.repeat(strengths(sample, is_contact), counts)
        strength *= self._shares.take(entries)
        return self._coloured.take(entries), strength


class SkinColours:
    """Colours of a mesh of ``vertex_count`` vertices.

    ``spreads``: interpolation to the mesh and number of model vertices, by model id.
    """

    def __init__(self, vertex_count: int, spreads: Mapping[str, tuple[Spread, int]]) -> None:
        self._spreading = {model: _Spreading(*spread) for model, spread in spreads.items()}
        self._is_shown = np.zeros(vertex_count, np.bool_)
        self._place = np.zeros(vertex_count, np.int64)  # row of a coloured vertex

    def of(
        self,
        samples: Iterable[Sample],
        contact_effects: frozenset[str],
        palette: Mapping[str, Colour],
    ) -> tuple[I64, F64]:
        """Coloured vertices (N,), ascending, with colours and opacities (N, 4)."""
        parts_by_colour: dict[str, list[tuple[I64, F64]]] = {}
        for sample in samples:
            if not len(sample.vertices):
                continue
            is_contact = sample.stream.effect_id in contact_effects
            here = self._spreading[sample.stream.model_id].of(sample, is_contact)
            parts_by_colour.setdefault(colour_name(sample, is_contact), []).append(here)
        # Flags of all vertices, reset after use, need no sorting and no new arrays.
        for parts in parts_by_colour.values():
            for vertices, values in parts:
                self._is_shown[vertices[values > 0.0]] = True
        shown = np.flatnonzero(self._is_shown)
        self._is_shown[shown] = False
        if not len(shown):
            return shown, np.zeros((0, 4))
        # Sum in rows of the coloured vertices only: a contact colours few of many thousands.
        self._place[shown] = np.arange(len(shown))
        shares = {}
        for name, parts in parts_by_colour.items():
            vertices, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            # Entries of weight 0 may point to any row: nothing is added there.
            share = np.bincount(self._place.take(vertices), values, len(shown))[: len(shown)]
            # Opacity is the root of the strength, which keeps weak samples visible.
            shares[name] = np.sqrt(share)
        return shown, overlay(shares, palette)


# Modifiers that add vertices behind those of the mesh.
_VERTICES_STAY_FIRST = frozenset({"SUBSURF", "MULTIRES", "SOLIDIFY", "MIRROR", "ARRAY"})


class DisplayedSkin:
    """Evaluated mesh at the current frame, copied from Blender by :meth:`read`.

    Attributes: ``size``, number of vertices before modifiers add more; ``positions`` and
    ``normals`` (V, 3) float32, mesh space, Blender's units, the mesh's own vertices first;
    ``world``, matrix from mesh space to world. The next frame overwrites the arrays.
    """

    def __init__(self) -> None:
        self.size = 0
        self.world = Matrix()
        self.positions = self.normals = np.empty((0, 3), np.float32)

    def read(self, evaluated: bpy.types.Object, size: int) -> None:
        """Copy the present state of an evaluated object, into the same arrays where V stays."""
        data = evaluated.data
        if len(self.positions) != len(data.vertices):
            # New arrays in each frame would cost more than the copy: their memory pages are new.
            self.positions, self.normals = np.empty((2, len(data.vertices), 3), np.float32)
        self.size, self.world = size, evaluated.matrix_world.copy()
        data.attributes["position"].data.foreach_get("vector", self.positions.ravel())
        data.vertex_normals.foreach_get("vector", self.normals.ravel())


class DisplayedSkins:
    """Displayed skins by mesh, each read at most once between two changes."""

    def __init__(self) -> None:
        self._known: dict[str, DisplayedSkin] = {}
        self._current: set[str] = set()  # names of the meshes read since the last change

    def invalidate(self) -> None:
        """Read each mesh again on its next use."""
        self._current.clear()

    def of(self, mesh: bpy.types.Object, graph: bpy.types.Depsgraph) -> DisplayedSkin | None:
        """Skin of a mesh; None while the mesh is hidden or in another mode than Object Mode.

        Without modifiers if these may renumber the vertices. All but the armature count: an
        armature never changes the number.
        """
        if not mesh.visible_get() or mesh.mode != "OBJECT":
            return None
        key = mesh.name_full
        if key not in self._current:
            size = len(mesh.data.vertices)
            evaluated = mesh.evaluated_get(graph)
            count = len(evaluated.data.vertices)
            types = {m.type for m in mesh.modifiers if m.show_viewport} - {"ARMATURE"}
            if count < size or (count > size and not types <= _VERTICES_STAY_FIRST):
                evaluated = mesh  # fall back to the mesh before modifiers
            self._known.setdefault(key, DisplayedSkin()).read(evaluated, size)
            self._current.add(key)
        return self._known[key]


def triangles_of(mesh: bpy.types.Object) -> npt.NDArray[np.int32]:
    """Vertex indices of Blender's triangulation of a mesh's faces, (F, 3)."""
    data = mesh.data
    if not len(data.loop_triangles):
        data.calc_loop_triangles()
    corners = np.zeros(len(data.loop_triangles) * 3, np.int32)
    data.loop_triangles.foreach_get("vertices", corners)
    return corners.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Shown:
    """Visible part of a mesh, N vertices, with colours."""

    vertices: I64  # (N,) of the mesh, ascending
    triangles: I32  # (F, 3) of the N; the same array while unchanged
    colours: U8  # (N, 4) straight alpha, 255 is one

    @property
    def nbytes(self) -> int:
        """Memory of vertices, triangles and colours, bytes."""
        return self.vertices.nbytes + self.triangles.nbytes + self.colours.nbytes


@dataclass(frozen=True, eq=False)
class Layer:
    """Colours over a mesh in its current pose."""

    shown: Shown
    positions: F32  # (N, 3) of its vertices, the mesh's space, Blender's units
    normals: F32  # (N, 3) unit
    matrix: Matrix  # mesh space to world
    above: float  # offset along the normal, mesh space


class ColouredMesh:
    """A mesh of A vertices, coloured by samples of perceptual models.

    ``spreads``: interpolation to the mesh and number of model vertices, by model id.
    """

    def __init__(self, mesh: bpy.types.Object, spreads: Mapping[str, tuple[Spread, int]]) -> None:
        self.mesh = mesh
        self.size = len(mesh.data.vertices)
        self.models = frozenset(spreads)
        self._colours = SkinColours(self.size, spreads)
        self._triangles = triangles_of(mesh)
        self._sagitta = _sagitta(mesh, self._triangles)
        self._around = Incidence(self._triangles, self.size)
        self._triangle_of = self._around.places // 3
        self._is_chosen = np.zeros(len(self._triangles), np.bool_)
        self._is_drawn = np.zeros(self.size, np.bool_)
        self._place = np.zeros(self.size, np.int32)  # among the drawn ones
        self._coloured = self._drawn = np.zeros(0, np.int64)
        self._indices = np.zeros((0, 3), np.int32)

    def shown(
        self,
        samples: Iterable[Sample],
        contact_effects: frozenset[str],
        palette: Mapping[str, Colour],
    ) -> Shown | None:
        """Visible part with the colours of samples; None without a visible colour."""
        # Contacts rarely change their vertices: the same arrays spare the graphics card an upload.
        coloured, colours = self._colours.of(samples, contact_effects, palette)
        if not len(coloured):
            return None
        if not np.array_equal(coloured, self._coloured):
            self._choose(coloured)
        bytes_ = np.zeros((len(self._drawn), 4), np.uint8)
        # Neighbours of coloured vertices are drawn, too, without opacity: colours fade out.
        bytes_[self._place.take(coloured)] = colours * 255.0 + 0.5
        return Shown(self._drawn, self._indices, bytes_)

    def layer(self, skin: DisplayedSkin, shown: Shown, unit_m: float) -> Layer:
        """Place a visible part on the posed skin; ``unit_m``: metres of one Blender unit."""
        scale = max(abs(skin.world.determinant()) ** (1 / 3), 1e-12)
        above = _ABOVE_SKIN_M / unit_m / scale
        if len(skin.positions) > skin.size:  # a modifier has rounded the straight edges
            above += self._sagitta
        return Layer(
            shown,
            skin.positions.take(shown.vertices, axis=0),
            skin.normals.take(shown.vertices, axis=0),
            skin.world,
            above,
        )

    def _choose(self, coloured: I64) -> None:
        """Store the triangles with a vertex among ``coloured`` (n,), and all vertices to draw."""
        # Flags of all vertices, reset after use, need no sorting and no new arrays.
        entries, _ = self._around.of(coloured)
        self._is_chosen[self._triangle_of.take(entries)] = True
        chosen = self._is_chosen.nonzero()[0]
        self._is_chosen[chosen] = False
        triangles = self._triangles.take(chosen, axis=0)
        self._is_drawn[coloured] = True  # though it were of no triangle
        self._is_drawn[triangles] = True
        self._drawn, self._coloured = self._is_drawn.nonzero()[0], coloured
        self._is_drawn[self._drawn] = False
        self._place[self._drawn] = np.arange(len(self._drawn), dtype=np.int32)
        self._indices = self._place.take(triangles)


def _sagitta(mesh: bpy.types.Object, triangles: I32) -> float:
    """Largest height of a curved surface over 98 % of a mesh's flat triangles, from their normals.

    Mesh units; 0 without triangles. An arc of angle t over a chord c has the height c/2 tan(t/4);
    the middle of a triangle 4/3 of this.
    """
    if not len(triangles):
        return 0.0
    points, normals = np.empty((2, len(mesh.data.vertices) * 3), np.float32)
    mesh.data.vertices.foreach_get("co", points)
    mesh.data.vertex_normals.foreach_get("vector", normals)
    # Angle between the normals along each edge: the turn of the arc over the edge.
    corners = points.reshape(-1, 3).take(triangles, axis=0)
    outward = normals.reshape(-1, 3).take(triangles, axis=0)
    chords = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cosines = np.einsum("fkx,fkx->fk", outward, np.roll(outward, 1, axis=1))
    turns = np.arccos(np.clip(cosines, -1.0, 1.0))
    return float(np.percentile(chords / 2.0 * np.tan(turns / 4.0), 98.0)) * 4.0 / 3.0
