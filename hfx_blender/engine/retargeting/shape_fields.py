# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape fields: variation of human shape, fitted to a target by distances to its skin.

A posed body has the target's joints, lengths and girths. The remaining difference is smooth and
common to people: flesh along thighs, breasts and belly, offsets of a rig's joints. *Fields* are
displacements of the canonical avatar's vertices (principal components over many people, see
``hfx_tools/body_building/shape_variation.py``). Their amounts follow from distances to the target's
skin, and determine the displacements *along* the skin as well.
"""

import json
import zipfile
from collections.abc import Generator
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
from .target import vertex_areas

SHAPES_FILE: Final = "shapes.npz"
FORMAT: Final = "hfx shapes"
VERSION: Final = 1

_ROUNDS: Final = 6
_REACH_M: Final = 0.12  # largest distance to the surface in the first round; half in the last
_OUTLIER_M: Final = 0.02  # distance with half weight; hair and clothes are outliers
# Squared misfit (m², summed over vertices) equivalent to one standard deviation of a field. Far
# above the noise of a scan, because distances of neighbours are correlated. Chosen on a body of
# another source than the fields.
_DISTRUST: Final = 0.01
# Weight of a joint's slide (in spreads of rigs) against a standard deviation of a field. Loose
# cloth has many distances with a common error.
_HOLD: Final = 0.3


def shape(
    fields: F64,
    matrices: F64,
    posed: F64,
    triangles: I64,
    bodies: Skeletons,
    surface: TargetSurface,
    limbs: Limbs,
) -> Generator[float, None, F64]:
    """Generator: fit shape fields to a target's skin; yields progress, returns vertices (V, 3).

    Regularised Gauss-Newton on distances to tangent planes, with normally distributed amounts and
    new nearest places in each round. Joints of the rig restrain slides along limbs. ``fields`` (K,
    V, 3) are those of :func:`read`; ``matrices``
    (V, 3, 4) posed each vertex, ``posed`` (V, 3) are posed vertices in normalised space.
    """
    moves = np.einsum("vij,kvj->kvi", matrices[..., :3], fields)
    areas = vertex_areas(posed, triangles)
    areas /= areas.mean()
    shares = np.zeros(len(fields))
    prior = _DISTRUST * np.eye(len(fields))
    for name, ring in limbs.rings.items():
        # Slides of joints enter the prior: the rig, not the distances, decides along a limb.
        slide = ring.slide(moves) / SLACK_M[name.partition(".")[0]]
        prior += _HOLD * _DISTRUST * np.outer(slide, slide)
    for number in range(_ROUNDS):
        at = posed + np.einsum("k,kvi->vi", shares, moves)
        reach = _REACH_M * (1.0 - 0.5 * number / _ROUNDS)
        places = surface.nearest(at, vertex_normals(at, triangles), bodies.avatar_shares, reach)
        gap = np.einsum("vi,vi->v", places.points - at, places.normals)
        # Cauchy weight: a surface farther than the outlier distance (clothes) counts less.
        weight = areas * places.found / (1.0 + (gap / _OUTLIER_M) ** 2)
        along = np.einsum("kvi,vi->kv", moves, places.normals)
        # einsum instead of matrix products: threads of BLAS cost more here than they save.
        weighted = along * weight
        normal = np.einsum("kv,lv->kl", weighted, along)
        slope = np.einsum("kv,v->k", weighted, gap) - prior @ shares
        shares += np.linalg.solve(normal + prior, slope)
        yield (number + 1) / _ROUNDS
    return limbs.with_joints_joined(posed + np.einsum("k,kvi->vi", shares, moves), posed)


def fields_for(avatar: Avatar) -> F64 | None:
    """Shipped fields, or None for an avatar with another number of vertices."""
    fields = read(resources.body_models() / SHAPES_FILE)
    return fields if fields.shape[1] == len(avatar.vertices) else None


@lru_cache(maxsize=1)
def read(path: Path) -> F64:
    """Read shape fields (K, V, 3) from a file: displacements of the canonical avatar's vertices by
    one standard deviation each, the largest first, metres in rest space; cached.

    Raises InputError: the file is missing, damaged, or of a newer version.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            meta = json.loads(stored["meta"].tobytes())
            if meta["format"] != FORMAT or meta["version"] > VERSION:
                raise ValueError(f"format {meta['format']!r}, version {meta['version']}")
            steps, scale = stored["steps"].astype(np.float64), stored["scale_m"].astype(np.float64)
            half, mirror = stored["half"], stored["mirror"]
            left_fields = (steps * scale[:, None, None]).transpose(0, 2, 1)
            fields = np.zeros((len(left_fields), len(mirror), 3))
            # Stored for one half of the body; the other half is the mirror image.
            fields[:, mirror[half]] = left_fields * (-1.0, 1.0, 1.0)
            fields[:, half] = left_fields
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except (OSError, EOFError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not readable as shapes of people ({error}).") from error
    return fields
