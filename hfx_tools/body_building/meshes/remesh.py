# SPDX-License-Identifier: GPL-3.0-or-later
"""An evenly spaced mesh of the skin: each part at its own spacing, without leaving its part.

Half the body is thinned to a set number of vertices a part, then relaxed, and vertices too many
are merged until the mean spacing is the target.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.parts import PARTS

from ..left_skin import LeftSkin
from ..progress import Progress
from . import fit
from .remesher import Remesher

METHOD: Final = "centroidal Voronoi cells of the skin, each within its part, mirrored"

_START: Final = 1.10  # vertices to start with, over the number expected
_SETTLE: Final = 25  # relaxation steps after each thinning
_CORRECTIONS: Final = 4
_FINAL: Final = 40
_PUSH: Final = 1.5  # overshoot of the centres, which settles faster


def remesh(skin: LeftSkin, spacing_m: F64, progress: Progress) -> Remesher:
    """Thin and relax the left half to the spacings.

    Parameters
    ----------
    spacing_m : (parts,) float64
        Wanted mean distance between neighbours.
    progress : callable
        Given the share that is done, 0..1, and what is being done.
    """
    mesh = Remesher(skin, spacing_m)
    beside, on = mesh.expected()
    progress(0.0, "thinning")
    mesh.refine()
    mesh.thin(np.rint(beside * _START).astype(np.int64), on)
    mesh.compact()
    for correction in range(_CORRECTIONS):
        progress(0.2 + 0.6 * correction / _CORRECTIONS, "relaxing")
        mesh.relax(_SETTLE, _PUSH)
        kinds = mesh.part.astype(np.int64) + len(PARTS) * mesh.is_midline
        now = mesh._counts(kinds)[: len(PARTS)]
        mean = mesh.mean_spacing(fit.raised(mesh))
        wanted = (now + 0.5 * on) * (mean / spacing_m) ** 2 - 0.5 * on
        few = beside < 20
        wanted = np.where(few, beside, np.minimum(now, np.rint(wanted)))
        mesh.thin(wanted.astype(np.int64), on)
        mesh.compact()
    progress(0.8, "relaxing")
    mesh.relax(_FINAL)
    progress(0.95, "fitting to the skin")
    fit.fit(mesh)
    progress(1.0, "done")
    return mesh
