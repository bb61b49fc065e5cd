# SPDX-License-Identifier: GPL-3.0-or-later
"""Forces of volumes on the skin inside: Kelvin-Voigt contact with Coulomb friction.

Penalty method of haptic rendering: a spring and a damper side by side (K. L. Johnson, "Contact
Mechanics", 1985, section 6.4) push a vertex out along the normal of the nearest boundary point, and
friction opposes its motion along the boundary. With the depth d, the velocity v of the skin
relative to the volume, and the outward normal n::

    normal   = max(0, stiffness d - damping v.n)        no adhesion
    friction = -min(1, |t| / 1 mm/s) friction normal t / |t|,  t = v - (v.n) n
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F32, F64
from ..response_filters.controls import ContactLaw
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..volume.nearest_surface import nearest_surface
from .contact_query import Contacts

_SLIDING_M_S: Final = 1e-3
"""Speed of full friction; below, friction is proportional to the speed and cannot chatter."""


def contact_forces(
    law: ContactLaw,
    animated: EffectBlock,
    hits: Contacts,
    skin: BodySkin,
    pose: PoseBlock,
    steps_s: F64,
) -> F32:
    """Forces on the skin (total, 3) of contacts with details, world space, newtons, times the level
    of the effect. ``steps_s`` (T,): time since the row before, over which velocities are backward
    differences; 0 where the volume was off, or the pose unknown: no velocity."""
    assert animated.matrices is not None and hits.details is not None
    forces = np.zeros((3, len(hits.vertices)))
    for row, start, stop in zip(hits.rows, hits.offsets, hits.offsets[1:], strict=False):
        part = slice(int(start), int(stop))
        places, matrix = hits.details.places[:, part], animated.matrices[row]
        shape = animated.shapes[int(animated.shapes_at(np.array([row]))[0])]
        _, normals = nearest_surface(shape, places, matrix)
        velocities = np.zeros_like(places)
        if steps_s[row] > 0.0:
            now, before = (
                skin.vertices.points(hits.vertices[part], pose, k, pose.to_world[k])
                for k in (row, row - 1)
            )
            # The point of the volume at the place of contact moves with the volume.
            turned = matrix - animated.matrices[row - 1]
            carried = turned[:3, :3] @ places + turned[:3, 3:]
            velocities = (now - before - carried) / steps_s[row]
        level = min(max(float(animated.levels[row]), 0.0), 1.0)
        forces[:, part] = level * force(law, shape.depth_m(places, matrix), velocities, normals)
    return np.ascontiguousarray(forces.T, np.float32)


def force(law: ContactLaw, depths_m: F64, velocities: F64, normals: F64) -> F64:
    """Forces on points (3, N), newtons, from depths (N,), velocities relative to the volume (3, N)
    in m/s and outward unit normals (3, N)."""
    outward = np.einsum("in,in->n", velocities, normals)
    pushed = np.maximum(law.stiffness_n_m * depths_m - law.damping_n_s_m * outward, 0.0)
    along = velocities - outward * normals
    # Division by at least the sliding speed gives both branches of the friction.
    speeds = np.maximum(np.sqrt(np.einsum("in,in->n", along, along)), _SLIDING_M_S)
    return np.asarray(pushed * (normals - law.friction * along / speeds))
