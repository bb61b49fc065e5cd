# SPDX-License-Identifier: GPL-3.0-or-later
"""How a haptic body follows its avatar: by its bones, or by the avatar's evaluated surface.

Bones alone are exact where the avatar is deformed by one plain armature modifier, and cheap.
Whatever else deforms it (Preserve Volume, shape keys, cloth ...) is evaluated by Blender, and
the perceptual vertices ride on that surface.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from . import retargeting
from .engine.body.model import PerceptualModel, load_avatar, load_model
from .engine.scene import FittedModel, SkinBinding, SurfaceAnchors, SurfaceBinding
from .errors import InputError

REST_TOLERANCE_M = 1e-4

_BEYOND = 0.25
"""How far a foot may lie beyond an edge of its triangle, as a barycentric weight: enough for the
rest pose to be met exactly where the nearest triangle meets its neighbour in a ridge."""

_HARMLESS_MODIFIERS = {
    "ARMATURE", "DATA_TRANSFER", "EDGE_SPLIT", "NORMAL_EDIT", "PARTICLE_SYSTEM", "COLLISION",
    "SUBSURF", "TRIANGULATE", "UV_PROJECT", "UV_WARP", "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX",
    "VERTEX_WEIGHT_PROXIMITY", "WEIGHTED_NORMAL",
}  # fmt: skip
"""Modifiers that leave the skin where the armature puts it (subdivision only smooths it)."""


def binding_of(body: bpy.types.Object, model_ids: Iterable[str]) -> SkinBinding | SurfaceBinding:
    """How a body is bound, for the models that the scene's effects need.

    Raises
    ------
    InputError
        The armature is neither the canonical one nor fitted, or the avatar cannot be followed.
    """
    fitted: dict[str, FittedModel] = {}
    if retargeting.is_fitted(body):
        found = (retargeting.fitted_model(body, model_id) for model_id in sorted(model_ids))
        fitted = {model.model_id: model for model in found}
    else:
        difference = from_canonical(body)
        if difference is not None:
            raise InputError(f"Body '{body.name}': {difference}")
    avatar = body.hfx.avatar
    reason = None if avatar is None else _beyond_bones(body, avatar)
    if reason is None:
        return SkinBinding(tuple(bone.name for bone in body.pose.bones), fitted)
    return SurfaceBinding(
        {
            model_id: _fitted_anchors(body, avatar, fitted[model_id])
            if model_id in fitted
            else _anchors(body, avatar, load_model(model_id))
            for model_id in model_ids
        },
        reason,
    )


def from_canonical(body: bpy.types.Object) -> str | None:
    """How an armature differs from the canonical one in rest pose; None if it does not."""
    skeleton = load_avatar().skeleton
    bones = body.data.bones
    missing = [name for name in skeleton.bone_names if name not in bones]
    if missing:
        return (
            f"its armature lacks {len(missing)} bones of the canonical "
            f"skeleton, '{missing[0]}' first. Add the built-in avatar, or mark the armature of "
            "your own as a haptic body."
        )
    found = np.array([bones[name].head_local for name in skeleton.bone_names], np.float64)
    distance = np.linalg.norm(found - skeleton.rest[:, :3, 3], axis=1)
    if distance.max() > REST_TOLERANCE_M:
        bone = skeleton.bone_names[int(distance.argmax())]
        return (
            f"in rest pose bone '{bone}' is {distance.max() * 1000:.1f} mm "
            "from its place in the canonical skeleton; the armature's rest pose was edited."
        )
    return None


def _fitted_anchors(
    body: bpy.types.Object, avatar: bpy.types.Object, fitted: FittedModel
) -> SurfaceAnchors:
    """The fit's anchors, their heights in the avatar's own unit."""
    to_avatar = avatar.matrix_world.inverted_safe() @ body.matrix_world
    scale = float(np.cbrt(abs(to_avatar.determinant())))
    return replace(fitted.anchors, offset_m=scale * fitted.anchors.offset_m)


def _beyond_bones(body: bpy.types.Object, avatar: bpy.types.Object) -> str | None:
    """Why bones alone would pose the avatar wrongly; None if they would not."""
    armatures = [
        m for m in avatar.modifiers if m.type == "ARMATURE" and m.object == body and m.show_viewport
    ]
    if not armatures:
        return f"no enabled armature modifier of '{avatar.name}' uses '{body.name}'"
    modifier = armatures[0]
    if modifier.use_deform_preserve_volume:
        return "Preserve Volume is on"
    if modifier.use_bone_envelopes or modifier.vertex_group or not modifier.use_vertex_groups:
        return f"modifier '{modifier.name}' does not deform by plain vertex groups"
    if len(armatures) > 1:
        return "several armature modifiers deform it"
    others = [m for m in avatar.modifiers if m.show_viewport and m.type not in _HARMLESS_MODIFIERS]
    if others:
        return f"modifier '{others[0].name}' deforms it too"
    skin = (bone for bone in body.data.bones if bone.name in avatar.vertex_groups)
    bent = [bone.name for bone in skin if bone.bbone_segments > 1 or not bone.use_deform]
    if bent:
        return f"bone '{bent[0]}' bends or does not deform"
    keys = avatar.data.shape_keys
    if keys is not None and any(
        not key.mute and (key.value != 0.0 or keys.animation_data is not None)
        for key in keys.key_blocks[1:]
    ):
        return "shape keys deform it"
    return None


def _anchors(
    body: bpy.types.Object, avatar: bpy.types.Object, model: PerceptualModel
) -> SurfaceAnchors:
    """Nearest point of the avatar's undeformed mesh to each perceptual vertex."""
    mesh = avatar.data
    mesh.calc_loop_triangles()
    triangles = [tuple(triangle.vertices) for triangle in mesh.loop_triangles]
    if not triangles:
        raise InputError(f"Avatar '{avatar.name}' has no faces that a body could be bound to.")
    points = [vertex.co.copy() for vertex in mesh.vertices]
    tree = BVHTree.FromPolygons(points, triangles, all_triangles=True)
    to_avatar = avatar.matrix_world.inverted_safe() @ body.matrix_world
    places = [to_avatar @ Vector(vertex) for vertex in model.vertices]
    nearest = [tree.find_nearest(place)[2] for place in places]
    corners = np.array(triangles, np.int32)[nearest]
    shape = np.array(points, np.float64)[corners]
    weights, offsets = _over_triangles(np.array(places, np.float64), shape)
    return SurfaceAnchors(corners, weights, offsets)


def _over_triangles(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric weights (n, 3) of points' feet on triangles (n, 3, 3), and heights over them."""
    along = corners[:, 1:] - corners[:, :1]
    products = along @ along.transpose(0, 2, 1)
    onto = np.einsum("nei,ni->ne", along, points - corners[:, 0])
    area = products[:, 0, 0] * products[:, 1, 1] - products[:, 0, 1] ** 2
    flat = np.where(area > 0.0, area, np.inf)
    u = (products[:, 1, 1] * onto[:, 0] - products[:, 0, 1] * onto[:, 1]) / flat
    v = (products[:, 0, 0] * onto[:, 1] - products[:, 0, 1] * onto[:, 0]) / flat
    u = np.clip(u, -_BEYOND, 1.0 + _BEYOND)
    v = np.clip(v, -_BEYOND, 1.0 + _BEYOND - u)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    feet = np.einsum("nc,nci->ni", weights, corners)
    normals = np.cross(along[:, 0], along[:, 1])
    lengths = np.linalg.norm(normals, axis=1)
    heights = np.einsum("ni,ni->n", points - feet, normals)
    return weights, np.divide(heights, lengths, out=np.zeros(len(points)), where=lengths > 0.0)


def read_surface(avatar: bpy.types.Object, evaluated: bpy.types.Object) -> np.ndarray:
    """Evaluated vertices of an avatar, (A, 3) float32, its local space.

    Subdivision keeps the original vertices first; any other change of their number is refused.
    """
    mesh = evaluated.data
    count = len(avatar.data.vertices)
    positions = np.zeros(len(mesh.vertices) * 3, np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    if len(mesh.vertices) < count or (
        len(mesh.vertices) > count
        and not any(m.type == "SUBSURF" and m.show_viewport for m in avatar.modifiers)
    ):
        raise InputError(
            f"Avatar '{avatar.name}': a modifier changes its number of vertices from {count} to "
            f"{len(mesh.vertices)}, so it cannot be followed; turn that modifier off in viewports."
        )
    return positions.reshape(-1, 3)[:count]
