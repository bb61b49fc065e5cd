# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape variation of people, from MakeHuman's macro targets: ``body_models/shapes.npz``.

400 random people get rigs with randomly displaced joints, since rigs differ in the location of
hips and shoulders. The canonical avatar is retargeted to each person; the remaining error, in the
avatar's rest space, is a field of displacements. The principal components of these fields are the
basis of :mod:`...engine.retargeting.shape_fields`.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I32, I64
from hfx_blender.engine.body.model import Avatar
from hfx_blender.engine.body.rigs.mapping import BoneMapping, RigBone, map_bones
from hfx_blender.engine.retargeting.canonical_pose import matrices, posed
from hfx_blender.engine.retargeting.joints import skeletons_of
from hfx_blender.engine.retargeting.shape_fields import FORMAT, SHAPES_FILE, VERSION
from hfx_blender.engine.retargeting.target import TargetAvatar
from hfx_blender.engine.retargeting.turns import apply
from hfx_blender.errors import InputError
from hfx_blender.files.atomic import atomic_file

from . import skeleton
from . import source as source_data
from .source import Source
from .variant import _MACRO, _ORIGINS, Variant, target_shares

PEOPLE: Final = 400
FIELDS: Final = 32
"""Number of fields: more fields improve no part of a known person by half a millimetre."""

_SEED: Final = 6
_AVERAGE_EVERY: Final = 4
"""Period of the average adult, with displaced joints only, among the random people."""

_JOINTS_M: Final = {
    "upperleg01": (0.015, 0.015, 0.025),
    "lowerleg01": (0.005, 0.010, 0.015),
    "foot": (0.005, 0.010, 0.010),
    "upperarm01": (0.012, 0.012, 0.012),
    "lowerarm01": (0.006, 0.008, 0.012),
    "wrist": (0.004, 0.004, 0.008),
    **{f"finger{f}-{p}": (0.0025, 0.0025, 0.0025) for f in range(1, 6) for p in range(1, 4)},
    **{f"toe{number}-1": (0.006, 0.006, 0.006) for number in range(1, 6)},
}
"""Standard deviation (x, y, z) of joints between rigs, metres, for a body of 1.7 m."""


def write(average: Source, folder: Path, avatar: Avatar, destination: Path) -> None:
    """Build the fields and write their file into a folder of models; see :func:`make`."""
    fields, mirror = make(average, folder, avatar)
    save(fields, mirror, destination / SHAPES_FILE)


def make(average: Source, folder: Path, avatar: Avatar) -> tuple[F64, I64]:
    """Build the fields of the canonical avatar, and its mirror table (V,).

    Parameters
    ----------
    average : Source
        Average adult.
    folder : Path
        Folder of MakeHuman's data.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    """
    rng = np.random.default_rng(_SEED)
    try:
        base = source_data.read_obj(folder / source_data.BASE_MESH)[0]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read as MakeHuman data ({error}).") from error

    @cache
    def offsets(name: str) -> tuple[I32, F64]:
        return source_data.read_target(folder / name)

    ids = source_vertices(avatar)
    mirror = _mirror(avatar.vertices.astype(np.float64))
    mapping: BoneMapping | None = None
    errors = []
    for number in range(PEOPLE):
        shares = _random_person(rng) if number % _AVERAGE_EVERY else source_data.AVERAGE_ADULT
        vertices = base.copy()
        for name, share in shares.items():
            moved, by = offsets(name)
            vertices[moved] += share * by
        shaped = replace(average, vertices=0.1 * vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0))
        target = _avatar_of(shaped, avatar, ids, rng)
        mapping = mapping or map_bones(target.bones)  # type: ignore[arg-type]
        errors.append(_retarget_error(avatar, target, mapping, mirror))
    return _components(np.stack(errors)), mirror


def source_vertices(avatar: Avatar) -> I64:
    """Vertex id in MakeHuman's base mesh for each vertex of an avatar."""
    runs = avatar.provenance["source_vertices"]
    return np.concatenate([np.arange(first, last + 1) for first, last in runs])


def _random_person(rng: np.random.Generator) -> dict[str, float]:
    """Shares of shape targets for a random person; extremes are as likely as the middle."""
    gender, muscle, weight, stature, proportions = rng.beta(0.6, 0.6, 5).tolist()
    age = float(rng.uniform(4.0, 90.0))
    person = Variant(gender, age, muscle, weight, stature, proportions)
    origin = dict(zip(_ORIGINS, rng.dirichlet((0.5, 0.5, 0.5)).tolist(), strict=True))
    shares = {}
    for name, share in target_shares(person).items():
        first = name.removeprefix(f"{_MACRO}/").partition("-")[0]
        shares[name] = share * len(origin) * origin[first] if first in origin else share
    return {name: share for name, share in shares.items() if share > 1e-6}


def _avatar_of(shaped: Source, avatar: Avatar, ids: I64, rng: np.random.Generator) -> TargetAvatar:
    """Target avatar of a person, with canonical mesh and weights and displaced joints."""
    bones = skeleton.make(shaped, 1.0, 0.0)
    vertices = shaped.vertices[ids]
    height = float(np.ptp(vertices[:, 2])) / 1.7
    heads = dict(zip(bones.bone_names, bones.rest[:, :3, 3].astype(np.float64), strict=True))
    for stem, spread in _JOINTS_M.items():
        away = height * rng.normal(size=3) * spread
        heads[f"{stem}.L"] = heads[f"{stem}.L"] + away
        heads[f"{stem}.R"] = heads[f"{stem}.R"] + away * (-1.0, 1.0, 1.0)
    names = bones.bone_names
    rig = tuple(
        RigBone(
            name,
            names[parent] if parent >= 0 else None,
            _point(heads[name]),
            _point(heads[name] + rest[:3, 1] * length),
        )
        for name, parent, rest, length in zip(
            names, bones.parents.tolist(), bones.rest, bones.lengths_m, strict=True
        )
    )
    return TargetAvatar(vertices, avatar_triangles(avatar), avatar.weights, names, rig)


def _point(point: F64) -> tuple[float, float, float]:
    x, y, z = point.tolist()
    return x, y, z


def avatar_triangles(avatar: Avatar) -> I64:
    """Split the quads of an avatar into triangles (2 F, 3)."""
    quads = avatar.faces.astype(np.int64)
    return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def _retarget_error(avatar: Avatar, target: TargetAvatar, mapping: BoneMapping, mirror: I64) -> F64:
    """Error (V, 3) of the canonical avatar retargeted to a person, in rest space, symmetric."""
    bodies = skeletons_of(avatar, target, mapping)
    moved = matrices(avatar, bodies)
    truth = apply(np.linalg.inv(bodies.to_target), target.vertices)
    miss = np.linalg.solve(moved[..., :3], (truth - posed(avatar, moved))[..., None])[..., 0]
    return (miss + miss[mirror] * (-1.0, 1.0, 1.0)) / 2.0


def _mirror(vertices: F64) -> I64:
    from scipy.spatial import cKDTree

    twin = cKDTree(vertices).query(vertices * (-1.0, 1.0, 1.0))[1].astype(np.int64)
    if not np.array_equal(twin[twin], np.arange(len(twin))):
        raise AssertionError("the avatar is not symmetric")
    return twin


def _components(fields: F64) -> F64:
    """Uncentred principal components, scaled to one standard deviation, (32, V, 3)."""
    rows = fields.reshape(len(fields), -1)
    # The Gram matrix of people is far smaller than the covariance of coordinates.
    _, vectors = np.linalg.eigh(rows @ rows.T)
    largest = vectors[:, ::-1][:, :FIELDS]
    # The sign of an eigenvector is arbitrary: the largest component becomes positive.
    largest *= np.sign(largest[np.abs(largest).argmax(axis=0), np.arange(largest.shape[1])])
    return (largest.T @ rows / np.sqrt(len(rows))).reshape(-1, *fields.shape[1:])


def save(fields: F64, mirror: I64, path: Path) -> None:
    """Write fields of one half of the body, as 8-bit steps with a scale for each field.

    ``mirror`` (V,) int64: id of the vertex at (-x, y, z); the fields must be symmetric.
    """
    half = np.flatnonzero(np.arange(len(mirror)) <= mirror)
    scale = np.abs(fields).max(axis=(1, 2)) / 127.0
    steps = np.round(fields[:, half] / scale[:, None, None]).astype(np.int8)
    meta = json.dumps({"format": FORMAT, "version": VERSION}, sort_keys=True).encode()
    with atomic_file(path) as file:
        np.savez_compressed(
            file,
            meta=np.frombuffer(meta, np.uint8),
            steps=steps.transpose(0, 2, 1),
            scale_m=scale.astype(np.float32),
            half=half.astype(np.int32),
            mirror=mirror.astype(np.int32),
        )
