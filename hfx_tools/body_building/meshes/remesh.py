# SPDX-License-Identifier: GPL-3.0-or-later
"""Evenly spaced mesh of the skin, with a spacing for each part, finer at joints if asked for.

Half the body is thinned to an expected number of vertices per part, then relaxed; excess vertices
are merged until the mean spacing reaches the target.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.parts import PARTS

from ..joint_gradient import UNIFORM, JointGradient
from ..left_skin import LeftSkin
from ..progress import Progress
from . import fit
from .remesher import Remesher

METHOD: Final = "centroidal Voronoi cells of the skin, each within its part, mirrored"

_START: Final = 1.10  # initial number of vertices, relative to the expected number
_SETTLE: Final = 25  # relaxation steps after each thinning
_CORRECTIONS: Final = 4
_FINAL: Final = 40
_PUSH: Final = 1.5  # overshoot toward the centres, for faster convergence


def remesh(
    skin: LeftSkin, spacing_m: F64, progress: Progress, gradient: JointGradient = UNIFORM
) -> Remesher:
    """Thin and relax the left half to the spacings.

    Parameters
    ----------
    spacing_m : (parts,) float64
        Target mean distance between neighbours, metres.
    progress : callable
        Called with the finished share, 0..1, and the current step.
    gradient : JointGradient
        Spacing within the parts, relative to the target.
    """
    mesh = Remesher(skin, spacing_m, gradient)
    off_midline, on_midline = mesh.expected()
    progress(0.0, "thinning")
    mesh.refine()
    mesh.thin(np.rint(off_midline * _START).astype(np.int64), on_midline)
    mesh.compact()
    for correction in range(_CORRECTIONS):
        progress(0.2 + 0.6 * correction / _CORRECTIONS, "relaxing")
        mesh.relax(_SETTLE, _PUSH)
        kinds = mesh.part.astype(np.int64) + len(PARTS) * mesh.is_midline
        present_count = mesh._counts(kinds)[: len(PARTS)]
        mean = mesh.mean_spacing(fit.raised(mesh))
        target_count = (present_count + 0.5 * on_midline) * (
            mean / spacing_m
        ) ** 2 - 0.5 * on_midline
        few = off_midline < 20
        target_count = np.where(few, off_midline, np.minimum(present_count, np.rint(target_count)))
        mesh.thin(target_count.astype(np.int64), on_midline)
        mesh.compact()
    progress(0.8, "relaxing")
    mesh.relax(_FINAL)
    progress(0.95, "fitting to the skin")
    fit.fit(mesh)
    progress(1.0, "done")
    return mesh
