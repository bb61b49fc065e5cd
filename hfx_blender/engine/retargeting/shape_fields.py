# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape fields: variation among people, and the shape of a target found from distances to its skin.

A posed body has the target's joints, lengths and girths; what is still missing is smooth and
much alike from person to person: where the flesh of a thigh lies along it, how breasts and belly
hang, how far a rig's joints are from where ours are. It is given as a few *fields*, displacements
of the canonical avatar's vertices (principal components over many people, see
``hfx_tools/body_building/shape_variation.py``). The distances to the target's skin tell how much
of each field there is; the fields then also move vertices *along* the skin, which no distance to
it can tell.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Generator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from ...errors import InputError
from ...files import resources
from ..arrays import F64, I64
from ..body.model import Avatar
from .joints import Skeletons
from .limbs import SLACK_M, Limbs
from .surface import TargetSurface, vertex_normals
from .target import areas_of

SHAPES_FILE: Final = "shapes.npz"
FORMAT: Final = "hfx shapes"
VERSION: Final = 1

_ROUNDS: Final = 6
_REACH_M: Final = 0.12
"""Farthest that the surface may be in the first round; half of it in the last."""

_OUTLIER_M: Final = 0.02
"""Distance at which the surface counts half: hair and clothes are no flesh."""

_DISTRUST: Final = 0.01
"""Square metres of vertices' misfit that one standard deviation of a field weighs as much as.

Far larger than the noise of a scan: the distances of neighbours are not independent, and a target
is of another modeller. Chosen on a body that no target of the fields' source made.
"""

_HOLD: Final = 0.3
"""Weight of a joint that has slid along its limb by what rigs differ, against one field's standard
deviation: the distances of loose cloth from a limb are many and all wrong in the same way."""


@dataclass(frozen=True, eq=False)
class ShapeFields:
    """Displacements of the canonical avatar's vertices, in metres of its rest space."""

    fields: F64  # (K, V, 3) one standard deviation each, the largest first

    def __len__(self) -> int:
        return len(self.fields)


def shape(
    fields: ShapeFields,
    matrices: F64,
    posed: F64,
    triangles: I64,
    bodies: Skeletons,
    surface: TargetSurface,
    limbs: Limbs,
) -> Generator[float, None, F64]:
    """Give a posed body the shape that brings it nearest to a target's skin, in steps.

    A regularised least-squares fit (Gauss-Newton on the distances to tangent planes, each field's
    share normally distributed), with the nearest places looked for anew in each round. The joints
    of the rig hold the skin along the limbs.

    Parameters
    ----------
    matrices : (V, 3, 4) float64
        What posed each vertex.
    posed : (V, 3) float64
        Normalised space.

    Returns
    -------
    (V, 3) float64
    """
    moves = np.einsum("vij,kvj->kvi", matrices[..., :3], fields.fields)
    areas = np.bincount(
        triangles.ravel(), np.repeat(areas_of(posed, triangles), 3), minlength=len(posed)
    ).astype(np.float64)
    areas = areas / areas.mean()
    shares = np.zeros(len(fields))
    prior = _DISTRUST * np.eye(len(fields))
    for name, ring in limbs.rings.items():
        slide = ring.slide(moves) / SLACK_M[name.partition(".")[0]]
        prior += _HOLD * _DISTRUST * np.outer(slide, slide)
    for number in range(_ROUNDS):
        at = posed + np.einsum("k,kvi->vi", shares, moves)
        reach = _REACH_M * (1.0 - 0.5 * number / _ROUNDS)
        places = surface.nearest(at, vertex_normals(at, triangles), bodies.avatar_shares, reach)
        gap = np.einsum("vi,vi->v", places.points - at, places.normals)
        weight = areas * places.found / (1.0 + (gap / _OUTLIER_M) ** 2)
        along = np.einsum("kvi,vi->kv", moves, places.normals)
        # Not as matrix products: large ones wake BLAS's threads, which cost more than they save.
        weighted = along * weight
        normal = np.einsum("kv,lv->kl", weighted, along)
        slope = np.einsum("kv,v->k", weighted, gap) - prior @ shares
        shares += np.linalg.solve(normal + prior, slope)
        yield (number + 1) / _ROUNDS
    return limbs.with_joints_joined(posed + np.einsum("k,kvi->vi", shares, moves), posed)


@lru_cache(maxsize=1)
def load_shapes() -> ShapeFields:
    """The shipped fields, of the shipped avatar.

    Raises
    ------
    InputError
        The file is missing or is none.
    """
    return read(resources.body_models() / SHAPES_FILE)


def fields_for(avatar: Avatar) -> ShapeFields | None:
    """Shipped fields, if they belong to an avatar."""
    fields = load_shapes()
    return fields if fields.fields.shape[1] == len(avatar.vertices) else None


def read(path: Path) -> ShapeFields:
    """Read fields from a file.

    Raises
    ------
    InputError
        The file is missing, is not such a file, or is of a newer version.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            meta = json.loads(stored["meta"].tobytes())
            if meta["format"] != FORMAT or meta["version"] > VERSION:
                raise ValueError(f"format {meta['format']!r}, version {meta['version']}")
            steps, scale = stored["steps"].astype(np.float64), stored["scale_m"].astype(np.float64)
            half, mirror = stored["half"], stored["mirror"]
            own = (steps * scale[:, None, None]).transpose(0, 2, 1)
            fields = np.zeros((len(own), len(mirror), 3))
            fields[:, mirror[half]] = own * (-1.0, 1.0, 1.0)
            fields[:, half] = own
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except (OSError, EOFError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not readable as shapes of people ({error}).") from error
    return ShapeFields(fields)
