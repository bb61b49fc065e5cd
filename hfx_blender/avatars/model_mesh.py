# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh objects of a body's perceptual model that follow its armature, for display and painting."""

from collections.abc import Sequence
from itertools import islice

import bmesh
import bpy
import numpy as np

from ..blender import mesh_arrays
from ..blender.scene_info import metres_of
from ..engine.body.model import PerceptualModel, SkinWeights
from ..engine.body.parts import PARTS
from . import stored_fits

SHOWN = "hfx_shown_body"  # ID property of a displayed model's mesh: its body
MODEL = "hfx_shown_model"  # ID property of a displayed model's mesh: the model's id
_COLOURS = {
    "head": (0.90, 0.75, 0.35),
    "torso": (0.45, 0.62, 0.85),
    "upper_arm": (0.86, 0.47, 0.40),
    "forearm": (0.55, 0.78, 0.50),
    "hand_dorsum": (0.75, 0.55, 0.83),
    "hand_palm": (0.95, 0.62, 0.75),
    "fingers": (0.40, 0.77, 0.77),
    "upper_leg": (0.86, 0.47, 0.40),
    "lower_leg": (0.55, 0.78, 0.50),
    "foot_dorsum": (0.75, 0.55, 0.83),
    "foot_sole": (0.95, 0.62, 0.75),
}
_ABOVE_SKIN_M = 0.002
"""Height of a displayed model above the avatar, metres: coincident surfaces flicker."""

_COARSE = 5000
"""Number of vertices below which a model's edges run under the skin, and need In Front."""


def add_posed(
    context: bpy.types.Context, body: bpy.types.Object, model: PerceptualModel, name: str
) -> bpy.types.Object:
    """Add a mesh of a model in a body's rest pose, skinned to the armature as in an export. The
    object is hidden in renders, and its bones' vertex groups are locked."""
    mesh = mesh_arrays.mesh_of(name, model.vertices, model.triangles)
    mesh.shade_flat()
    obj = bpy.data.objects.new(mesh.name, mesh)
    obj.hide_render = True
    context.scene.collection.objects.link(obj)
    for group in add_bone_groups(obj, model.bone_names, model.weights):
        # Brushes change only the painted group.
        group.lock_weight = True
    obj.parent = body
    obj.modifiers.new("Armature", "ARMATURE").object = body
    return obj


def add_bone_groups(
    skin: bpy.types.Object, bone_names: Sequence[str], weights: SkinWeights
) -> list[bpy.types.VertexGroup]:
    """Add a vertex group with weights for each bone to a mesh object without groups."""
    groups = [skin.vertex_groups.new(name=bone) for bone in bone_names]
    # Vertex by vertex, `VertexGroup.add` takes three times as long.
    edited = bmesh.new()
    edited.from_mesh(skin.data)
    layer = edited.verts.layers.deform.verify()
    entries = iter(zip(weights.bones.tolist(), weights.values.tolist(), strict=True))
    for vertex, count in zip(edited.verts, np.diff(weights.offsets).tolist(), strict=True):
        of_vertex = vertex[layer]
        for bone, value in islice(entries, count):
            of_vertex[bone] = value
    edited.to_mesh(skin.data)
    edited.free()
    return groups


def freeze_pose(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Store the present pose of a mesh as a shape key; remove modifiers and vertex groups. The mesh
    itself stays in rest pose, symmetric for mirrored brush strokes."""
    context.view_layer.update()
    posed = obj.evaluated_get(context.view_layer.depsgraph)
    places = mesh_arrays.positions(posed.data).ravel()
    obj.modifiers.clear()
    obj.vertex_groups.clear()
    # Weight Paint mirrors strokes by the rest shape, which stays the basis.
    obj.shape_key_add(name="Basis", from_mix=False)
    pose = obj.shape_key_add(name="Pose", from_mix=False)
    pose.data.foreach_set("co", places)
    pose.value = 1.0
    obj.active_shape_key_index = 1


def show(context: bpy.types.Context, body: bpy.types.Object, model_id: str) -> bpy.types.Object:
    """Display a model on the avatar, with a colour per body part, to check the fit. Displayed
    models of the body are removed first."""
    hide(body)
    model = stored_fits.model_of(body, model_id)
    obj = add_posed(context, body, model, f"{body.name} {model_id}")
    obj[SHOWN], obj[MODEL] = body, model_id
    obj.show_wire = True
    obj.show_all_edges = True
    obj.show_in_front = len(model) < _COARSE
    for part in PARTS:
        # Materials are shared by all displayed models; the viewport colour is set again.
        material_name = f"HFX {part.replace('_', ' ').title()}"
        materials = bpy.data.materials
        material = materials.get(material_name) or materials.new(material_name)
        material.diffuse_color = (*_COLOURS[part], 1.0)
        obj.data.materials.append(material)
    part_of_face = model.part[model.triangles[:, 0]].astype(np.int32)
    obj.data.polygons.foreach_set("material_index", part_of_face)
    lift = obj.modifiers.new("Above the Skin", "DISPLACE")
    # Along the normals, by the strength alone.
    lift.mid_level = 0.0
    scale = abs(body.matrix_world.to_3x3().determinant()) ** (1 / 3)
    # The modifier works in the object's own units: metres are divided by unit and scale.
    lift.strength = _ABOVE_SKIN_M / (metres_of(context.scene) * scale)
    obj.data.update()
    return obj


def shown_meshes(body: bpy.types.Object) -> list[bpy.types.Object]:
    """Meshes that display models of a body."""
    return [obj for obj in bpy.data.objects if obj.get(SHOWN) == body]


def hide(body: bpy.types.Object) -> list[str]:
    """Remove the displayed models of a body and unused materials; return the models' ids."""
    model_ids = []
    for obj in shown_meshes(body):
        model_ids.append(obj[MODEL])
        mesh = obj.data
        materials = list(mesh.materials)
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)
        for material in materials:
            if material is not None and not material.users:
                bpy.data.materials.remove(material)
    return model_ids
