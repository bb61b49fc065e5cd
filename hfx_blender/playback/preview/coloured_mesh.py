# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh of an avatar with colours of haptic samples, restricted to the part where any show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ...engine.arrays import F32, I32, I64, U8
from ...engine.colouring import Colour, Spread
from ...engine.samples import Sample
from .skin_colours import DisplayedSkin, Incidence, SkinColours, triangles_of

_ABOVE_SKIN_M = 0.0015
"""Height of colours over the skin, metres: avoids flicker."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Visible part of a mesh, N vertices, with colours."""

    vertices: I64  # (N,) of the mesh, ascending
    triangles: I32  # (F, 3) of the N; the same array as long as they are the same
    colours: U8  # (N, 4) straight alpha, 255 is one

    @property
    def nbytes(self) -> int:
        """Memory of the three arrays, bytes."""
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

    Parameters
    ----------
    spreads : mapping of str to (Spread, int)
        Model id -> interpolation to the mesh, and number of model vertices.
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
    corners = points.reshape(-1, 3).take(triangles, axis=0)
    outward = normals.reshape(-1, 3).take(triangles, axis=0)
    chords = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cosines = np.einsum("fkx,fkx->fk", outward, np.roll(outward, 1, axis=1))
    turns = np.arccos(np.clip(cosines, -1.0, 1.0))
    return float(np.percentile(chords / 2.0 * np.tan(turns / 4.0), 98.0)) * 4.0 / 3.0
