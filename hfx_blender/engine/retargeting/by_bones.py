# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models on an avatar by its bones alone, where its surface cannot carry them.

The canonical avatar is posed and proportioned onto the target's joints and keeps its own skin:
for characters of rigid pieces, voxels, and meshes on which a body part is nowhere to be found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..body.model import Avatar, PerceptualModel
from ..body.rigs.mapping import BoneMapping
from ..scene import FittedModel, SurfaceAnchors
from .canonical_pose import matrices, posed
from .joints import skeletons_of
from .quality import PartQuality, Quality
from .retarget import carried, mapped_weights, with_mapped_bones
from .surface import vertex_normals
from .target import TargetAvatar

_LOST: Final = 0.5
"""Share of a part's vertices on that part of the avatar, below which the surface fit is none."""

_CARRYING: Final = ("head", "torso", "upper_arm", "forearm", "upper_leg", "lower_leg")
"""Parts without which a fit to the surface makes no sense; hands and feet may be missing."""


def fit_by_bones(
    models: Sequence[PerceptualModel], avatar: Avatar, target: TargetAvatar, mapping: BoneMapping
) -> list[FittedModel]:
    """Put perceptual models onto a target's joints.

    Returns
    -------
    list of FittedModel
        In the target's own space and unit; weights are the canonical ones through the mapping,
        anchors the nearest triangles, which pictures are taken from and nothing follows.

    Raises
    ------
    InputError
        The target's joints are missing or are not a person's.
    """
    from scipy.spatial import cKDTree

    bodies = skeletons_of(avatar, target, mapping)
    vertices = posed(avatar, matrices(avatar, bodies))
    faces = avatar.faces.astype(np.int64)
    normals = vertex_normals(vertices, np.concatenate((faces[:, [0, 1, 2]], faces[:, [0, 2, 3]])))
    nearest = cKDTree(bodies.points[target.triangles].mean(axis=1))
    boned = with_mapped_bones(target, mapping)
    found = []
    for model in models:
        points, _ = carried(model, vertices, normals)
        triangle = nearest.query(points)[1]
        found.append(
            FittedModel(
                model_id=model.id,
                model_hash=model.content_hash,
                vertices=(points @ bodies.to_target[:3, :3].T + bodies.to_target[:3, 3]).astype(
                    np.float32
                ),
                bone_names=boned.bone_names,
                weights=mapped_weights(model, boned, mapping),
                anchors=SurfaceAnchors(
                    target.triangles[triangle].astype(np.int32),
                    np.full((len(points), 3), 1.0 / 3.0),
                    np.zeros(len(points)),
                ),
            )
        )
    return found


def lost_part(qualities: Sequence[Quality]) -> PartQuality | None:
    """Carrying part of the body that lies mostly elsewhere; None if all are about in place."""
    parts = [part for quality in qualities for part in quality.parts if part.part in _CARRYING]
    worst = min(parts, key=lambda part: part.in_place, default=None)
    return worst if worst is not None and worst.in_place < _LOST else None
