# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of a user's avatar: selection, and reading for a fit.

An avatar has a mesh or several (body, head, hands, clothes). The mesh that covers most of the body
is ``hfx.avatar``, further meshes are ``hfx.avatar_parts``. All meshes together form a surface, with
vertices numbered mesh after mesh in that order.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import TYPE_CHECKING

import bpy
from mathutils import Matrix

from ..blender import compat
from ..blender.scene_info import metres_of
from ..engine.stepwise import within
from ..errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from ..engine.body.model import SkinWeights
    from ..engine.body.rigs.mapping import BoneMapping, RigBone
    from ..engine.retargeting.layers import Layer
    from ..engine.retargeting.target import TargetAvatar


def meshes_of(body: bpy.types.Object) -> list[bpy.types.Object]:
    """Meshes of a haptic body's avatar, in the order of their vertex numbering; may be empty."""
    parts = (part.mesh for part in body.hfx.avatar_parts)
    return [mesh for mesh in (body.hfx.avatar, *parts) if mesh is not None]


def store_meshes(body: bpy.types.Object, meshes: Sequence[bpy.types.Object]) -> None:
    """Replace the stored meshes of a haptic body's avatar; the main mesh comes first."""
    body.hfx.avatar = meshes[0] if meshes else None
    body.hfx.avatar_parts.clear()
    for mesh in meshes[1:]:
        part = body.hfx.avatar_parts.add()
        part.name = mesh.name
        part.mesh = mesh


def visible_meshes(
    context: bpy.types.Context, armature: bpy.types.Object
) -> list[bpy.types.Object]:
    """Visible meshes below, or deformed by, an armature, by name; no effects, no model meshes."""
    below = set(armature.children_recursive)
    meshes = [
        obj
        for obj in context.view_layer.objects
        if obj.type == "MESH"
        and obj.visible_get(view_layer=context.view_layer)
        and obj.hfx.role == "NONE"
        and not is_model_mesh(obj)
        and (obj in below or armature_of(obj) == armature)
    ]
    return sorted(meshes, key=lambda obj: obj.name)


def is_model_mesh(obj: bpy.types.Object) -> bool:
    """Test for a mesh that displays a perceptual model, for painting or viewing."""
    return "hfx_painted_effect" in obj or "hfx_shown_body" in obj


def armature_of(mesh: bpy.types.Object) -> bpy.types.Object | None:
    """Armature of a mesh's first Armature modifier with an object; None if missing."""
    armatures = (modifier.object for modifier in mesh.modifiers if modifier.type == "ARMATURE")
    return next(filter(None, armatures), None)


def bone_of(armature: bpy.types.Object, mesh: bpy.types.Object) -> str | None:
    """Name of the bone that carries a mesh by parenting; None for a deformed or loose mesh."""
    obj: bpy.types.Object | None = mesh
    # A piece may hang on a bone by a chain of parents; a deformed parent ends the chain.
    while obj is not None and armature_of(obj) is None:
        if obj.parent == armature and obj.parent_type == "BONE" and obj.parent_bone:
            return str(obj.parent_bone)
        obj = obj.parent
    return None


def is_held(armature: bpy.types.Object, mesh: bpy.types.Object) -> bool:
    """Test for an unmuted constraint to the armature on a mesh without armature and bone parent."""
    if armature_of(mesh) is not None or bone_of(armature, mesh) is not None:
        return False
    targets = [
        target
        for constraint in mesh.constraints
        for target in (constraint, *getattr(constraint, "targets", ()))
        if not constraint.mute
    ]
    return any(getattr(target, "target", None) == armature for target in targets)


def choosing_skin(
    armature: bpy.types.Object, meshes: Sequence[bpy.types.Object], mapping: BoneMapping
) -> Generator[float, None, list[bpy.types.Object]]:
    """Choose the meshes of the body in steps, without props and accessories: all visible layers, or
    only the skin if the user has set the armature's *Layer* to *Skin*. Yields progress, 0 to 1.
    None or one mesh is returned unchanged; of several, at least the largest. The choice is cached
    with the user's data."""
    from ..engine.body.model import load_avatar
    from ..engine.retargeting import layers, props
    from . import fit_cache

    if len(meshes) < 2:
        return list(meshes)
    # Reading takes about half of the time.
    targets = []
    for number, mesh in enumerate(meshes):
        yield 0.5 * number / len(meshes)
        targets.append(read_mesh(armature, mesh))
    body = _without_accessories(armature, dict(zip(meshes, targets, strict=True)), mapping)
    meshes, layer = list(body), layer_of(armature)
    targets, _ = props.without_props(load_avatar(), list(body.values()), mapping)
    key = fit_cache.key_of("meshes", targets, mapping, layer)
    cached = fit_cache.read(key)
    if cached is None:
        choice = layers.skin_of(load_avatar(), targets, mapping, layer)
        numbers = yield from within(choice, 0.5, 1.0)
        fit_cache.write(key, {"numbers": numbers})
    else:
        numbers = cached["numbers"]
    # Without a mesh that follows the bones, fitting the largest mesh reports the fault.
    largest = max(meshes, key=lambda mesh: (len(mesh.data.vertices), mesh.name))
    return [meshes[k] for k in numbers] or [largest]


def layer_of(armature: bpy.types.Object) -> Layer:
    """Layer to fit where clothes cover skin, by the armature's setting: "skin" or "visible"."""
    return "skin" if armature.hfx.felt_layer == "SKIN" else "visible"


def _without_accessories(
    armature: bpy.types.Object, targets: dict[bpy.types.Object, TargetAvatar], mapping: BoneMapping
) -> dict[bpy.types.Object, TargetAvatar]:
    """Leave out rigid pieces that hang on bones: accessories such as swords and hats. If most limb
    bones have no skin, the body itself is rigid (a robot): pieces on mapped bones and their parents
    stay. Returns all targets if there is no skin at all."""
    rigid = {mesh: bone for mesh in targets if (bone := bone_of(armature, mesh)) is not None}
    skin = {mesh: target for mesh, target in targets.items() if mesh not in rigid}
    skinned = {
        target.bone_names[bone] for target in skin.values() for bone in set(target.weights.bones)
    }
    limbs = ("upperarm01", "lowerarm01", "upperleg01", "lowerleg01")
    limb_bones = {mapping.bones.get(f"{limb}.{side}") for limb in limbs for side in "LR"} - {None}
    # Skin on more than half of the limb bones is a body; rigid pieces are extras.
    if not rigid or len(limb_bones & skinned) > 0.5 * len(limb_bones):
        return skin or targets
    bones = armature.data.bones
    body = {
        name
        for mapped in mapping.bones.values()
        for name in (mapped, *(above.name for above in bones[mapped].parent_recursive))
    }
    return {
        mesh: target for mesh, target in targets.items() if mesh not in rigid or rigid[mesh] in body
    }


def reading_meshes(
    armature: bpy.types.Object, meshes: Sequence[bpy.types.Object]
) -> Generator[float, None, list[TargetAvatar]]:
    """Read all meshes of an avatar in the armature's rest space, in steps. Raises InputError:
    armature or mesh is in Edit Mode, or has a zero or negative scale; a mesh of several has no
    faces or follows no bone."""
    targets = []
    for number, mesh in enumerate(meshes):
        yield number / len(meshes)
        targets.append(read_mesh(armature, mesh))
    if len(meshes) > 1:
        for mesh, target in zip(meshes, targets, strict=True):
            fault = None if len(target.triangles) else "has no faces"
            if not len(target.weights.bones):
                fault = f"follows no bone of '{armature.name}'"
            if fault is not None:
                raise InputError(
                    f"'{mesh.name}' {fault}, so it is no part of the avatar's skin: deselect it, "
                    "or parent it to the armature with weights first."
                )
    return targets


def read_bones(armature: bpy.types.Object) -> tuple[RigBone, ...]:
    """Bones of an armature in rest pose, armature space."""
    from ..engine.body.rigs.mapping import RigBone

    return tuple(
        RigBone(
            bone.name,
            bone.parent.name if bone.parent else None,
            tuple(bone.head_local),
            tuple(bone.tail_local),
            bone.use_deform,
        )
        for bone in armature.data.bones
    )


def skin_by_bone(armature: bpy.types.Object) -> dict[str, np.ndarray]:
    """Visible vertices (n, 3) with a weight above 0.5 on a bone, by bone, armature rest space. The
    armature's visible meshes are read; meshes with errors are skipped."""
    import numpy as np

    pieces: dict[str, list[np.ndarray]] = {}
    for mesh in visible_meshes(bpy.context, armature):
        try:
            target = read_mesh(armature, mesh)
        except InputError:  # reported when the mesh is fitted
            continue
        owners = np.repeat(np.arange(len(target.vertices)), np.diff(target.weights.offsets))
        # Vertices without a triangle are hidden by modifiers, and show no skin.
        shown = np.zeros(len(target.vertices), np.bool_)
        shown[target.triangles] = True
        is_dominant = (target.weights.values > 0.5) & shown[owners]
        places, bones = target.vertices[owners[is_dominant]], target.weights.bones[is_dominant]
        for number in np.unique(bones):
            pieces.setdefault(target.bone_names[number], []).append(places[bones == number])
    return {name: np.concatenate(places) for name, places in pieces.items()}


def read_mesh(armature: bpy.types.Object, mesh_object: bpy.types.Object) -> TargetAvatar:
    """Read a mesh in the armature's rest space, with unanimated shape keys applied. Pieces hidden
    by modifiers keep their vertices, but have no triangles. Raises InputError for another type of
    object, Edit Mode, or a zero or negative scale."""
    import numpy as np

    from ..blender import mesh_arrays
    from ..engine.body.model import SkinWeights
    from ..engine.retargeting.target import TargetAvatar
    from . import mesh_copies

    if mesh_object.type != "MESH":
        raise InputError(
            f"Avatar '{mesh_object.name}' is a {mesh_object.type.lower()}, not a mesh."
        )
    for obj in (armature, mesh_object):
        if obj.mode == "EDIT":
            raise InputError(f"'{obj.name}' is being edited; leave Edit Mode first.")
        _check_scale(obj)
    world = np.array(armature.matrix_world, np.float64)
    bones = armature.data.bones
    # Further groups serve masks, shape keys or hair, and follow no bone.
    groups = {
        group.name: group.index
        for group in mesh_object.vertex_groups
        if group.name in bones and bones[group.name].use_deform
    }
    names = tuple(groups)
    # All vertices of a rigid piece follow the bone.
    carrier = bone_of(armature, mesh_object)
    shape = mesh_copies.steady_shape(mesh_object.data)
    with mesh_copies.rest_mesh(mesh_object, shape) as mesh:
        points, triangles = mesh_arrays.points(mesh), mesh_arrays.triangles(mesh)
        if carrier is not None:
            offsets = np.arange(len(points) + 1, dtype=np.int32)
            names, bones_of = (carrier,), np.zeros(len(points), np.int32)
            weights = SkinWeights(offsets, bones_of, np.ones(len(points), np.float32))
        else:
            weights = _weights(mesh, list(groups.values()))
    hidden = mesh_copies.hidden_vertices(mesh_object, triangles, points)
    return TargetAvatar(
        vertices=in_rest_space(armature, mesh_object, points),
        triangles=triangles[~hidden[triangles].any(axis=1)].astype(np.int64),
        weights=weights,
        bone_names=names,
        bones=read_bones(armature),
        # The cube root of the determinant is the mean scale of the three axes.
        metres=metres_of(bpy.context.scene) * float(np.cbrt(np.linalg.det(world[:3, :3]))),
    )


def in_rest_space(
    armature: bpy.types.Object, mesh: bpy.types.Object, points: np.ndarray
) -> np.ndarray:
    """Points (n, 3) from a mesh's local space to that of the armature, with all bones at rest."""
    import numpy as np

    matrix = armature.matrix_world.inverted_safe() @ mesh.matrix_world
    if bone_of(armature, mesh) is not None:
        # Up the chain of parents to the bone: each step as Blender composes it.
        matrix, obj = Matrix(), mesh
        while obj.parent != armature or obj.parent_type != "BONE":
            matrix = obj.matrix_parent_inverse @ obj.matrix_basis @ matrix
            obj = obj.parent
        # Blender places children of a bone at the tail.
        bone = armature.data.bones[obj.parent_bone]
        along = Matrix.Translation((0.0, compat.place_along_parent_bone(obj) * bone.length, 0.0))
        # With Relative Parenting a child keeps the place in the armature while the bone rests.
        at_bone = Matrix() if bone.use_relative_parent else bone.matrix_local @ along
        matrix = at_bone @ obj.matrix_parent_inverse @ obj.matrix_basis @ matrix
    to_rest = np.array(matrix, np.float64)
    return points @ to_rest[:3, :3].T + to_rest[:3, 3]


def rest_surface(
    armature: bpy.types.Object, mesh_object: bpy.types.Object, shape: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (A, 3), rest space of the armature, and triangles (F, 3) of a mesh before its
    Armature modifier. ``shape`` holds values of shape keys; keys that are not given are 0."""
    from ..blender import mesh_arrays
    from . import mesh_copies

    with mesh_copies.rest_mesh(mesh_object, shape) as mesh:
        points, triangles = mesh_arrays.points(mesh), mesh_arrays.triangles(mesh)
    return in_rest_space(armature, mesh_object, points), triangles


def _check_scale(obj: bpy.types.Object) -> None:
    import numpy as np

    matrix = np.array(obj.matrix_world, np.float64)[:3, :3]
    lengths = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(matrix).all() or lengths.min() < 1e-9:
        raise InputError(f"'{obj.name}' is scaled by zero, so it has no size to fit a body to.")
    if np.linalg.det(matrix) < 0.0:
        raise InputError(
            f"'{obj.name}' has a negative scale, which swaps its left and right; apply the scale "
            "(Object > Apply > Scale) and recalculate the normals first."
        )


def _weights(mesh: bpy.types.Mesh, groups: Sequence[int]) -> SkinWeights:
    """Positive weights of a mesh in the vertex groups ``groups`` (indices), with sum 1 per vertex,
    none for a vertex without; bone k is ``groups[k]``."""
    import numpy as np

    from ..engine.body.model import SkinWeights

    column = {group: number for number, group in enumerate(groups)}
    rows = [
        (number, column[element.group], element.weight)
        for number, vertex in enumerate(mesh.vertices)
        for element in vertex.groups
        if element.group in column
    ]
    table = np.array(rows, np.float64).reshape(-1, 3)
    table = table[table[:, 2] > 0.0]
    owners, bones, values = table[np.lexsort((table[:, 1], table[:, 0]))].T
    owners = owners.astype(np.int32)
    # Blender normalises the weights of deform groups in the same way.
    values = values / np.bincount(owners, values)[owners]
    offsets = np.searchsorted(owners, np.arange(len(mesh.vertices) + 1))
    return SkinWeights(offsets.astype(np.int32), bones.astype(np.int32), values.astype(np.float32))
