# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body build --variant``: the canonical models as another person, vertex ids unchanged.

No mesh is rebuilt: each vertex stays on its triangle of the dense skin, and the skin is shaped by
other MakeHuman targets. A vertex id is the same spot of the body in every variant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hfx_blender.engine.arrays import F64, U8
from hfx_blender.engine.body.model import Avatar, PerceptualModel, load_avatar, load_model, manifest
from hfx_blender.engine.body.parts import CENTRE, PARTS, RIGHT

from . import assemble, left_skin, model_file, model_set, outer_skin, segmentation, skeleton, stats
from . import source as source_data
from .left_skin import LeftSkin
from .meshes import measure
from .meshes.mesh_edges import triangle_normals
from .meshes.nearest_places import locate
from .outer_skin import Skins
from .progress import Progress, quiet
from .variant import Variant, target_shares


@dataclass(frozen=True, eq=False)
class Original:
    """Skin of the average adult, the start of every variant."""

    folder: Path
    skins: Skins
    part: U8  # (V,) of the dense skin
    side: U8  # (V,)
    left: LeftSkin


@dataclass(frozen=True, eq=False)
class Person:
    """Avatar and skin of a variant; the skin has the quads of the average adult."""

    variant: Variant
    avatar: Avatar
    original: LeftSkin
    left: LeftSkin


def original(source: Path | None) -> Original:
    """Rebuild the skin of the canonical models.

    ``source``: see :func:`.source.locate`.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    """
    folder = source_data.locate(source)
    average = source_data.read(folder)
    skins = outer_skin.make(average, skeleton.bone_order(average.rig))
    bones = skeleton.make(average, skins.scale, skins.ground_m)
    part, side = segmentation.label(skins.dense, bones)
    return Original(folder, skins, part, side, left_skin.left_of(skins, part, side))


def person(adult: Original, variant: Variant) -> Person:
    """Apply a variant to the average adult's skin and skeleton.

    Raises
    ------
    InputError
        A shape target is missing or cannot be read.
    """
    shaped = source_data.read(adult.folder, target_shares(variant))
    skins = outer_skin.reshape(adult.skins, shaped.vertices, variant.height)
    canonical = load_avatar()
    avatar = replace(
        canonical,
        id=canonical.id + variant.suffix,
        vertices=skins.avatar.vertices.astype(np.float32),
        skeleton=skeleton.make(shaped, skins.scale, skins.ground_m),
        provenance={**canonical.provenance, **_origin(canonical, variant)},
    )
    left = left_skin.left_of(skins, adult.part, adult.side)
    return Person(variant, avatar, adult.left, left)


def _origin(canonical: Avatar | PerceptualModel, variant: Variant) -> dict[str, Any]:
    return {
        "method": "vertices of the canonical one, each at its place on the skin of a variant",
        "canonical": {"id": canonical.id, "hash": canonical.content_hash},
        "variant": variant.values(),
    }


def model(canonical: PerceptualModel, person_: Person) -> PerceptualModel:
    """Move a canonical perceptual model to the skin of a variant; returns a new model.

    Vertex ids, triangles, parts, sides, mirror table and skin weights are canonical; positions,
    normals, areas, the binding to the avatar and the statistics are the variant's.
    """
    points = _both_sides(canonical, _points_on_variant(canonical, person_))
    triangles = canonical.triangles.astype(np.int64)
    normals = _both_sides(canonical, assemble.vertex_normals(points, triangles))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = points.astype(np.float32)
    areas_m2, gaps_m, errors_m = _measure(canonical, vertices.astype(np.float64), person_.left)
    avatar = person_.avatar
    avatar_triangles = assemble.triangles_of(avatar.faces)
    avatar_triangle, shares, offset_m = locate(
        points, avatar.vertices.astype(np.float64), avatar_triangles
    )
    moved = replace(
        canonical,
        id=canonical.id + person_.variant.suffix,
        vertices=vertices,
        normals=normals.astype(np.float32),
        areas_m2=areas_m2.astype(np.float32),
        avatar_vertices=avatar_triangles[avatar_triangle].astype(np.int32),
        avatar_weights=shares.astype(np.float32),
        avatar_offset_m=offset_m.astype(np.float32),
        provenance={**canonical.provenance, **_origin(canonical, person_.variant)},
    )
    moved.provenance["statistics"] = stats.statistics(moved, gaps_m, errors_m)
    return moved


def _points_on_variant(canonical: PerceptualModel, person_: Person) -> F64:
    """Positions (V, 3) on the variant's skin; zeros for vertices of the right side.

    A vertex raised above the skin keeps its height relative to the size of the triangle below.
    """
    old_skin, new_skin = person_.original, person_.left
    chosen = np.flatnonzero(canonical.side != RIGHT)
    points_ = canonical.vertices[chosen].astype(np.float64)
    triangle, shares, rise_m = locate(points_, old_skin.points, old_skin.triangles)
    corners = old_skin.triangles[triangle]
    facing = triangle_normals(new_skin.points, corners)
    size_before, size = (
        np.linalg.norm(normals, axis=1)
        for normals in (triangle_normals(old_skin.points, corners), facing)
    )
    rise_m *= np.sqrt(size / size_before)
    points = np.zeros((len(canonical), 3))
    points[chosen] = np.einsum("ij,ijk->ik", shares, new_skin.points[corners])
    points[chosen] += (rise_m / size)[:, None] * facing
    return points


def _both_sides(canonical: PerceptualModel, vectors: F64) -> F64:
    """Mirror vectors (V, 3) from left to right; x of the midline becomes 0. Returns a copy."""
    result = vectors.copy()
    right = canonical.side == RIGHT
    result[right] = vectors[canonical.mirror[right]] * (-1.0, 1.0, 1.0)
    result[canonical.side == CENTRE, 0] = 0.0
    return result


def _measure(canonical: PerceptualModel, points: F64, left: LeftSkin) -> tuple[F64, F64, F64]:
    """Skin of each vertex (V,), then largest gap and mean error by part, metres.

    Each sample of skin belongs to the nearest vertex of its part.
    """
    from scipy.spatial import cKDTree

    target_mm = canonical.provenance["targets_mm"]
    samples = left_skin.sample(left, np.array([target_mm[part] for part in PARTS]) / 1000.0)
    areas_m2 = np.zeros(len(points))
    for number in range(len(PARTS)):
        inside = samples.part == number
        own = np.flatnonzero((canonical.part == number) & (canonical.side != RIGHT))
        nearest = own[cKDTree(points[own]).query(samples.points[inside])[1]]
        areas_m2 += np.bincount(nearest, samples.areas_m2[inside], minlength=len(points))
    areas_m2[canonical.side == CENTRE] *= 2.0
    right = canonical.side == RIGHT
    areas_m2[right] = areas_m2[canonical.mirror[right]]

    triangles = canonical.triangles.astype(np.int64)
    gaps_m = measure.gaps_m(samples, points)
    return areas_m2, gaps_m, measure.errors_m(samples, points, triangles)


def build(
    source: Path | None, destination: Path, variant: Variant, progress: Progress = quiet
) -> dict[str, Any]:
    """Write avatar, perceptual models and manifest of a variant.

    Parameters
    ----------
    source : Path, optional
        See :func:`.source.locate`.
    destination : Path
        Folder; each file of the same name is replaced as a whole, the manifest last.
    progress : callable
        Called with the finished share, 0..1, and the current step.

    Returns the written manifest.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    OutputError
        The folder or a file in it cannot be written.
    UsageError
        The folder of the canonical models.
    """
    model_set.prepare(destination, "a variant")
    progress(0.0, "reading the source")
    adult = original(source)
    progress(0.25, "shaping the skin")
    person_ = person(adult, variant)
    avatar = person_.avatar
    heights_m = avatar.vertices[:, 2]
    new_manifest: dict[str, Any] = {
        "version": model_set.MANIFEST_VERSION,
        "variant": variant.values(),
        "avatar": {
            **model_set.avatar_entry(avatar),
            "height_m": round(float(heights_m.max() - heights_m.min()), 4),
        },
        "models": {},
    }
    model_file.save(avatar, destination / model_set.AVATAR_FILE)
    canonical_ids = list(manifest()["models"])
    for number, canonical_id in enumerate(canonical_ids):
        progress(0.3 + 0.7 * number / len(canonical_ids), canonical_id)
        moved = model(load_model(canonical_id), person_)
        model_file.save(moved, destination / f"{moved.modality}.npz")
        new_manifest["models"][moved.id] = model_set.model_entry(moved)
    model_set.write_manifest(destination, new_manifest)
    progress(1.0, "done")
    return new_manifest
