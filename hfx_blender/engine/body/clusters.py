# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of neighbouring perceptual vertices: the unit that is tested and posed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..arrays import I32
from ..native import cluster_bounds as native
from ..native import library
from .model import PerceptualModel

LEAF_SIZE = 128
"""Vertices in a cluster at most: smaller ones cost more bounds, larger ones pose too much."""


def clusters_of(model: PerceptualModel, load: npt.NDArray[np.int64] | None = None) -> list[I32]:
    """Split a model into compact clusters, each within one body part and side.

    Parameters
    ----------
    load : (V,) int64, optional
        How much of :data:`LEAF_SIZE` a vertex takes; 1 by default.

    Returns
    -------
    list of (n,) int32
        Ascending vertex ids; every vertex is in exactly one cluster. Without the compiled library
        parts stay whole: their sizes only matter to it.
    """
    label = model.part.astype(np.int32) * 4 + model.side
    pieces = [np.flatnonzero(label == value).astype(np.int32) for value in np.unique(label)]
    return native.split(pieces, model.vertices, load, LEAF_SIZE) if library.is_there() else pieces
