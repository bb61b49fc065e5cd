# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic bodies in the scene: the built-in avatar, marking an armature."""

import sys
import uuid
from collections.abc import Callable, Generator, Sequence
from importlib.util import find_spec

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..blender import early_imports, mesh_arrays
from ..blender.scene_info import metres_of
from ..engine.body.model import AVATAR_ID, Avatar, Skeleton, load_avatar
from ..engine.body.rigs.mapping import BoneMapping
from ..engine.retargeting.retarget import fitted_to_variant
from ..errors import InputError
from . import avatar_meshes, body_binding, bone_table, model_mesh, stored_fits

_LARGE_BONES = (
    *("root", "pelvis", "spine", "neck", "head", "clavicle", "shoulder"),
    *("upperarm", "lowerarm", "wrist", "upperleg", "lowerleg", "foot"),
)

_WAIT_S = 0.05
_INSIDE_M = 0.02
"""Shortening of the head bone, metres, to keep its end inside the head; also the tolerance of
overlapping boxes."""


def add_avatar(
    context: bpy.types.Context, name: str = "Avatar", avatar_id: str = AVATAR_ID
) -> tuple[bpy.types.Object, bpy.types.Object]:
    """Add the built-in avatar, or an installed variant, as a haptic body; return armature and mesh.
    Effects and devices of a variant refer to the canonical models, which are fitted to the
    variant's skin. Raises InputError: the avatar or a model of the variant is missing."""
    avatar = load_avatar(avatar_id)
    # Before anything is added: a missing model leaves the scene unchanged.
    fitted_models = fitted_to_variant(avatar) if avatar_id != AVATAR_ID else []
    armature = _armature(context, avatar.skeleton, name)
    armature.scale = [1.0 / metres_of(context.scene)] * 3  # as tall as a person in any unit
    skin = bpy.data.objects.new(f"{name} Skin", skin_mesh(avatar, f"{name} Skin"))
    armature.users_collection[0].objects.link(skin)
    model_mesh.add_bone_groups(skin, avatar.skeleton.bone_names, avatar.weights)
    skin.parent = armature
    skin.modifiers.new("Armature", "ARMATURE").object = armature
    if fitted_models:
        stored_fits.store(armature, stored_fits.Fit((skin,), tuple(fitted_models)))
    mark_body(armature, [skin])
    return armature, skin


def adding_body(
    armature: bpy.types.Object,
    avatar: bpy.types.Object | None,
    parts: Sequence[bpy.types.Object] = (),
    mapping_of: Callable[[bpy.types.Object], BoneMapping] = bone_table.mapping_of,
) -> Generator[float, None, list[str]]:
    """Fit the perceptual models to an avatar, and make the armature a haptic body, in steps.

    ``avatar`` is the main mesh, ``parts`` are further meshes; ``mapping_of`` returns the bone
    mapping of an armature, a cached one after :func:`choosing_meshes`. Returns notes and warnings
    for the user. The canonical armature needs no fit. A refitted body keeps the id, and painted
    areas stay valid. Raises InputError, with nothing changed: the avatar cannot become a body.
    """
    check_armature(armature)
    meshes = [mesh for mesh in dict.fromkeys((avatar, *parts)) if mesh is not None]
    if body_binding.canonical_difference(armature) is None:
        stored_fits.clear(armature)
        mark_body(armature, meshes)
        return []
    if not meshes:
        raise InputError(
            f"'{armature.name}' has no mesh that a body could be fitted to: select the avatar's "
            "mesh and then its armature."
        )
    if find_spec("scipy") is None:
        raise InputError(
            "Fitting the body to an avatar needs the Python package scipy, which this Blender "
            f"lacks: install it with '{sys.executable} -m pip install scipy', or use the built-in "
            "avatar."
        )
    mapping = mapping_of(armature)
    yield from _importing()
    # Half of this module's import time: imported on use, to keep Blender's start quick.
    from .fitting import fitting

    # Everything that may fail comes before the scene is changed.
    fit = yield from fitting(armature, meshes, mapping)
    stored_fits.store(armature, fit)
    bone_table.show_mapping(armature, mapping, is_automatic=not bone_table.is_corrected(armature))
    mark_body(armature, fit.meshes)
    return [*fit.notes, *fit.warnings]


def choosing_meshes(
    context: bpy.types.Context,
    armature: bpy.types.Object,
    mapping_of: Callable[[bpy.types.Object], BoneMapping] = bone_table.mapping_of,
) -> Generator[float, None, list[bpy.types.Object]]:
    """Choose the meshes to fit a body to, in steps: the selected meshes, or the avatar's skin.
    Selected props held by a constraint are left out; the mesh with most vertices comes first.
    Without selected meshes, see :func:`choosing_skin_meshes`."""
    selected = [
        obj
        for obj in context.selected_objects
        if obj.type == "MESH" and not avatar_meshes.is_model_mesh(obj)
    ]
    if selected:
        skin = [mesh for mesh in selected if not avatar_meshes.is_held(armature, mesh)]
        return _largest_first(skin or selected)
    return (yield from choosing_skin_meshes(context, armature, mapping_of))


def choosing_skin_meshes(
    context: bpy.types.Context,
    armature: bpy.types.Object,
    mapping_of: Callable[[bpy.types.Object], BoneMapping] = bone_table.mapping_of,
) -> Generator[float, None, list[bpy.types.Object]]:
    """Return a body's stored meshes, or choose the visible meshes of the skin, in steps.

    Stored meshes are not returned if the layer was changed after the fit. Clothes and uncovered
    skin are chosen, or skin alone by the armature's layer; hair is not.

    Raises InputError: there are several meshes, and no recognisable human bones.
    """
    stored = avatar_meshes.meshes_of(armature)
    if stored and armature.hfx.role == "BODY" and not stored_fits.is_of_other_layer(armature):
        return stored
    visible = avatar_meshes.visible_meshes(context, armature)
    if len(visible) < 2 or body_binding.canonical_difference(armature) is None:
        return _largest_first(visible)[:1]
    mapping = mapping_of(armature)
    yield from _importing()
    return (yield from avatar_meshes.choosing_skin(armature, visible, mapping))


def _importing() -> Generator[float, None, None]:
    """Wait for the import of scipy and trimesh, some seconds; yields 0.0 until the end."""
    # Imports of the same packages in two threads end in a deadlock of Python's module locks.
    imports = early_imports.begin()
    while imports.is_alive():
        imports.join(_WAIT_S)
        yield 0.0


def _largest_first(meshes: list[bpy.types.Object]) -> list[bpy.types.Object]:
    return sorted(meshes, key=lambda mesh: (-len(mesh.data.vertices), mesh.name))


def check_armature(armature: bpy.types.Object) -> None:
    """Raise InputError for an object that is no armature, or is linked without an override."""
    if armature.type != "ARMATURE":
        raise InputError(f"'{armature.name}' is a {armature.type.lower()}, not an armature.")
    if armature.library is not None:
        raise InputError(
            f"'{armature.name}' is linked from '{armature.library.filepath}', so nothing can be "
            "stored on it; make it local or a library override, or mark it in its own file."
        )


def mark_body(armature: bpy.types.Object, meshes: Sequence[bpy.types.Object]) -> None:
    """Mark an armature as a haptic body of the avatar ``meshes``, the main mesh first.

    ``meshes`` replace meshes stored earlier, none for an empty sequence. A stored fit and an id
    stay; without an id a random id is added. Raises InputError for an object that is no armature,
    or is linked without an override.
    """
    check_armature(armature)
    armature.hfx.role = "BODY"
    armature.hfx.uid = armature.hfx.uid or uuid.uuid4().hex
    avatar_meshes.store_meshes(armature, meshes)


def free_place(context: bpy.types.Context, armature: bpy.types.Object) -> Vector:
    """Free location for a new avatar, nearest to the 3D cursor along the x axis. Returns the 3D
    cursor itself if no free location lies within five avatar widths."""
    cursor = context.scene.cursor.location
    context.view_layer.update()
    avatar_objects = {armature, *armature.children_recursive}
    obstacles = set(context.visible_objects) - avatar_objects
    taken = [mesh_arrays.world_box(obj) for obj in obstacles if obj.type == "MESH"]
    avatar = mesh_arrays.world_box(armature.children[0])
    width = avatar[1, 0] - avatar[0, 0]
    for step in range(40):
        # Steps of a quarter of the width, to the right and left in turn.
        offset = 0.25 * width * ((step + 1) // 2) * (1.0 if step % 2 else -1.0)
        shift = cursor + Vector((offset, 0.0, 0.0))
        low, high = avatar + shift
        # Boxes that overlap by up to 0.02 on an axis count as side by side.
        if not any(
            (low < box[1] - _INSIDE_M).all() and (box[0] < high - _INSIDE_M).all() for box in taken
        ):
            return shift
    return cursor.copy()


def _armature(context: bpy.types.Context, skeleton: Skeleton, name: str) -> bpy.types.Object:
    """Add the armature of a skeleton, with 1 unit per metre, as the active and only selected
    object; bones of hands, feet and face are in a hidden bone collection."""
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    # In the active collection, if visible and editable, else in the scene's.
    active = context.view_layer.active_layer_collection
    collection = active.collection
    is_ours = collection.library is None and collection.override_library is None
    if not (is_ours and active.is_visible):
        collection = context.scene.collection
    collection.objects.link(armature)
    for selected in context.selected_objects:
        selected.select_set(False)
    context.view_layer.objects.active = armature
    armature.select_set(True)
    # Blender creates bones in Edit Mode only.
    bpy.ops.object.mode_set(mode="EDIT")
    edit_bones = []
    for bone_name, parent, rest, length in zip(
        skeleton.bone_names, skeleton.parents, skeleton.rest, skeleton.lengths_m, strict=True
    ):
        bone = armature.data.edit_bones.new(bone_name)
        # A new bone has no length, and bones without length are removed.
        bone.length = length
        bone.matrix = Matrix(rest.tolist())
        bone.length = length - (_INSIDE_M if bone_name == "head" else 0.0)
        if parent >= 0:
            bone.parent = edit_bones[parent]
        edit_bones.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    armature.data.display_type = "STICK"
    large = armature.data.collections.new("Body")
    small = armature.data.collections.new("Small Bones")
    for bone in armature.data.bones:
        (large if bone.name.startswith(_LARGE_BONES) else small).assign(bone)
    small.is_visible = False
    return armature


def skin_mesh(avatar: Avatar, name: str) -> bpy.types.Mesh:
    """Mesh of an avatar in rest pose, with UV map and smooth shading."""
    mesh = mesh_arrays.mesh_of(name, avatar.vertices, avatar.faces)
    layer = mesh.uv_layers.new(name="UVMap")
    corners = avatar.uv[avatar.faces >= 0].astype(np.float32)
    layer.data.foreach_set("uv", corners.ravel())
    mesh.shade_smooth()
    mesh.update()
    return mesh
