# SPDX-License-Identifier: GPL-3.0-or-later
"""How a haptic body follows its avatar: by its bones, or by the avatar's evaluated surface.

Bones alone are exact where the avatar is deformed by one plain armature modifier, and cheap.
Whatever else deforms it (Preserve Volume, shape keys, cloth ...) is evaluated by Blender, and
the perceptual vertices ride on that surface.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from .engine.body.model import PerceptualModel, load_avatar, load_model
from .engine.scene import SkinBinding, SurfaceAnchors, SurfaceBinding
from .errors import InputError

REST_TOLERANCE_M = 1e-4

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
        The armature is not the canonical one, or the avatar cannot be followed.
    """
    _check_skeleton(body)
    avatar = body.hfx.avatar
    reason = None if avatar is None else _beyond_bones(body, avatar)
    if reason is None:
        return SkinBinding(tuple(bone.name for bone in body.pose.bones))
    return SurfaceBinding(
        {model_id: _anchors(body, avatar, load_model(model_id)) for model_id in model_ids}, reason
    )


def _check_skeleton(body: bpy.types.Object) -> None:
    skeleton = load_avatar().skeleton
    bones = body.data.bones
    missing = [name for name in skeleton.bone_names if name not in bones]
    if missing:
        raise InputError(
            f"Body '{body.name}': its armature lacks {len(missing)} bones of the canonical "
            f"skeleton, '{missing[0]}' first. Add the built-in avatar, or use MakeHuman's default "
            "rig."
        )
    found = np.array([bones[name].head_local for name in skeleton.bone_names], np.float64)
    distance = np.linalg.norm(found - skeleton.rest[:, :3, 3], axis=1)
    if distance.max() > REST_TOLERANCE_M:
        bone = skeleton.bone_names[int(distance.argmax())]
        raise InputError(
            f"Body '{body.name}': in rest pose bone '{bone}' is {distance.max() * 1000:.1f} mm "
            "from its place in the canonical skeleton; the armature's rest pose was edited."
        )


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
    corners = np.zeros((len(model), 3), np.int32)
    weights = np.zeros((len(model), 3), np.float64)
    offsets = np.zeros(len(model), np.float64)
    for k, vertex in enumerate(model.vertices):
        point = to_avatar @ Vector(vertex)
        nearest, _, index, _ = tree.find_nearest(point)
        corners[k] = triangles[index]
        a, b, c = (np.array(points[i], np.float64) for i in triangles[index])
        weights[k] = _barycentric(np.array(nearest, np.float64), a, b, c)
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length > 0:
            foot = weights[k] @ np.array([a, b, c])
            offsets[k] = (np.array(point, np.float64) - foot) @ normal / length
    return SurfaceAnchors(corners, weights, offsets)


def _barycentric(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    edges = np.stack([b - a, c - a], axis=1)
    solution, *_ = np.linalg.lstsq(edges, p - a, rcond=None)
    u, v = np.clip(solution, 0.0, 1.0)
    return np.array([1.0 - u - v, u, v])


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
