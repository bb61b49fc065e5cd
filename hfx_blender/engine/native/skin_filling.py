# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills in the sampling of the skin of clusters; ``skin_filling.c``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Final, Protocol

import numpy as np

from ..arrays import F64, I64
from .library import BYTES, DOUBLE, DOUBLES, INTEGER, INTS, LONGS, POINTER, loaded, structure
from .skin_mesh import Mesh, mesh_of

_TABLE_ARRAYS: Final = (
    "starts",
    "unit_counts",
    "cell_starts",
    "vertices",
    "cell_of",
    "quad_starts",
    "unit_shares",
    "vertex_shares",
    "reaches",
    "means",
    "is_ringed",
    "unit_of",
    "around",
    "steps",
    "finest",
    "sample_starts",
    "heights_m",
    "wholes",
    "bulge_m",
    "most_samples",
    "quads",
)
_OF_VERTICES: Final = ("distance", "finest_distance", "closeness")
_COUNTS: Final = {
    **dict.fromkeys(("starts", "unit_counts", "cell_starts", "cell_of", "quad_starts"), LONGS),
    **dict.fromkeys(("unit_of", "around", "steps", "finest", "sample_starts"), LONGS),
    **{"most_samples": LONGS, "vertices": INTS, "is_ringed": BYTES},
}
_Filling = structure(
    "hfx_filling",
    **(dict.fromkeys((*_TABLE_ARRAYS, *_OF_VERTICES), DOUBLES) | _COUNTS),
    is_split=INTEGER,
    most_share=DOUBLE,
)
_EXTENT: Final = 7  # numbers in extent


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    found.hfx_fill.argtypes = [
        *(POINTER, POINTER, INTEGER, LONGS, INTEGER),
        *(LONGS, LONGS, DOUBLES, DOUBLES, DOUBLES, LONGS),
    ]
    found.hfx_fill.restype = INTEGER
    found.hfx_place_samples.argtypes = [POINTER, INTEGER, LONGS, INTEGER, DOUBLES]
    found.hfx_place_samples.restype = None
    return found


class FilledTable(Protocol):
    """See :class:`..skin.skin_table.SkinTable`."""

    starts: I64
    unit_counts: I64
    cell_starts: I64
    quad_starts: I64


class Filling:
    """Fills in some clusters of a table.

    Parameters
    ----------
    table : FilledTable
        Its arrays are written to.
    mesh : Mesh
        Its surface.
    distances : (2, V) float64
        How far skin may be from its samples, metres, and how far at the finest.
    closeness : (V,) float64
        One over the spacing of vertices, but for a factor.
    is_split : bool
        Whether vertices stand for more than themselves.
    most_share : float
        Of a unit, that its vertex stands for.
    """

    def __init__(
        self,
        table: FilledTable,
        mesh: Mesh,
        distances: F64,
        closeness: F64,
        is_split: bool,
        most_share: float,
    ) -> None:
        self._table, self._mesh = table, mesh
        arrays = [getattr(table, name) for name in _TABLE_ARRAYS]
        arrays += [*distances, closeness]
        self._structure = _Filling(*arrays, int(is_split), most_share)

    def fill(self, clusters: I64, samples: int) -> int:
        """Fill in clusters, ascending, all but the samples.

        Parameters
        ----------
        clusters : (k,) int64
        samples : int
            How many the table has.

        Returns
        -------
        int
            How many it is to have.
        """
        table, vertices = self._table, len(self._mesh.vertices)
        first = table.starts[clusters]
        quads = table.quad_starts[first + table.unit_counts[clusters]] - table.quad_starts[first]
        cells = int((table.cell_starts[clusters + 1] - table.cell_starts[clusters]).max())
        self._clusters = clusters
        rooms = (
            *np.zeros((2, vertices), np.int64),
            np.empty((int(quads.max()), _EXTENT)),
            np.empty(int(table.unit_counts[clusters].max())),
            np.empty(cells),
            np.empty(cells, np.int64),
        )
        calls = _calls()
        count: int = calls.hfx_fill(
            ctypes.byref(self._structure),
            ctypes.byref(mesh_of(self._mesh)),
            len(clusters),
            clusters,
            samples,
            *rooms,
        )
        return count

    def place_samples(self, samples: F64) -> None:
        """Write the samples of these clusters, (4, S)."""
        calls = _calls()
        calls.hfx_place_samples(
            ctypes.byref(self._structure),
            len(self._clusters),
            self._clusters,
            samples.shape[1],
            samples,
        )
