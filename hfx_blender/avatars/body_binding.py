# SPDX-License-Identifier: GPL-3.0-or-later
"""Binding of a haptic body to the bones, or the evaluated surface, of an avatar.

Bones alone are exact, and cheap, for an avatar deformed by a single plain Armature modifier.
Further deformation (Preserve Volume, shape keys, cloth ...) is evaluated by Blender, and the
perceptual vertices are anchored to the evaluated surface.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..blender import compat, mesh_arrays
from ..blender.scene_info import metres_of
from ..engine.body.levels_and_cells import cell_of_skin
from ..engine.body.model import PerceptualModel, load_avatar, load_model, load_skeleton
from ..engine.scene import FittedModel, SkinBinding, SurfaceAnchors, SurfaceBinding
from ..engine.volume.mesh_distance import plane_weights
from ..errors import InputError
from . import avatar_meshes, evaluated_skin, mesh_copies, stored_fits

REST_TOLERANCE_M = 1e-4

_MISPLACED_MM = 2.0  # above the rounding of the matrices of an avatar 10 km away
_TRANSFORMS = ("location", "rotation", "scale", "delta_", "constraints[")

_BEYOND = 0.25
"""Largest distance of an anchor beyond an edge of its triangle, as a barycentric weight: anchors on
a convex ridge then reproduce the rest pose exactly."""


def binding_of(body: bpy.types.Object, model_ids: Collection[str]) -> SkinBinding | SurfaceBinding:
    """Binding of a body, with the fits or anchors of the given models. Raises InputError: the
    armature is not canonical and not fitted, or the avatar cannot be followed."""
    fitted: dict[str, FittedModel] = {}
    if stored_fits.is_fitted(body):
        models = (stored_fits.fitted_model(body, model) for model in _with_skins(model_ids))
        fitted = {model.model_id: model for model in models}
    elif (difference := canonical_difference(body)) is not None:
        raise InputError(f"Body '{body.name}': {difference}")
    reason = surface_reason(body)
    if reason is None:
        return SkinBinding(tuple(bone.name for bone in body.pose.bones), fitted)
    _deformation_reason(body)  # measures the surface that read_surface() needs
    anchors = {model_id: anchors_of(body, model_id) for model_id in _with_skins(model_ids)}
    return SurfaceBinding(anchors, reason)


def _with_skins(model_ids: Collection[str]) -> list[str]:
    """Sorted ids of the models, and of the finer models that temperature cells are sampled by."""
    models = [load_model(model_id) for model_id in model_ids]
    fine = [cell_of_skin(model)[0] for model in models if model.modality == "temperature"]
    return sorted({model.id for model in models}.union(fine))


def anchors_of(body: bpy.types.Object, model_id: str) -> SurfaceAnchors:
    """Anchors of a model's vertices on the avatar's meshes, numbered mesh after mesh; heights in
    units of the main mesh."""
    fitted = stored_fits.fitted_model(body, model_id)
    anchors = _anchors(body, load_model(model_id)) if fitted is None else fitted.anchors
    to_avatar = body.hfx.avatar.matrix_world.inverted_safe() @ body.matrix_world
    scale = float(np.cbrt(abs(to_avatar.determinant())))
    return replace(anchors, offset_m=scale * anchors.offset_m)


def surface_reason(body: bpy.types.Object) -> str | None:
    """Reason for following the avatar's evaluated surface; None if the body follows the bones.
    Raises InputError: *Surface* was chosen for a body without a mesh."""
    if stored_fits.is_by_bones(body):
        return None
    follow = body.hfx.follow
    if follow == "SURFACE":
        if body.hfx.avatar is None:
            raise InputError(
                f"Body '{body.name}' is set to follow the surface of its avatar, but has no mesh; "
                "choose Automatic or Bones, or add the haptic body with a mesh selected."
            )
        return "that is chosen for it"
    return None if follow == "BONES" else _deformation_reason(body)


def warning_of(body: bpy.types.Object) -> str | None:
    """Export warning about a body's binding; None for an exact binding to bones."""
    reason = surface_reason(body)
    if reason is not None:
        return f"body '{body.name}' follows its avatar's evaluated surface, because {reason}"
    lost_reason = _deformation_reason(body) if body.hfx.follow == "BONES" else None
    if lost_reason is None:
        return None
    return (
        f"body '{body.name}' follows its bones, because that is chosen for it, although "
        f"{lost_reason}: what this adds to the avatar's shape is not felt"
    )


def canonical_difference(body: bpy.types.Object) -> str | None:
    """Sentence on missing bones, or a bone head more than 0.1 mm off the canonical one; or None."""
    skeleton = load_skeleton()
    bones = body.data.bones
    missing = [name for name in skeleton.bone_names if name not in bones]
    if missing:
        return (
            f"its armature lacks {len(missing)} bones of the canonical "
            f"skeleton, '{missing[0]}' first. Add the built-in avatar, or mark the armature of "
            "your own as a haptic body."
        )
    heads = np.array([bones[name].head_local for name in skeleton.bone_names], np.float64)
    distance = np.linalg.norm(heads - skeleton.rest[:, :3, 3], axis=1)
    if distance.max() > REST_TOLERANCE_M:
        bone = skeleton.bone_names[int(distance.argmax())]
        return (
            f"in rest pose bone '{bone}' is {distance.max() * 1000:.1f} mm "
            "from its place in the canonical skeleton; the armature's rest pose was edited."
        )
    return None


def _deformation_reason(body: bpy.types.Object) -> str | None:
    """First reason against posing an avatar's meshes by bones alone; None if bones suffice. A mesh
    off the bones, without an enabled armature modifier of ``body``, is a reason; so is the measured
    error of a mesh with suspected deformation. Measurements are cached, and dropped without
    suspicion."""
    reasons: list[str | None] = []
    for mesh in avatar_meshes.meshes_of(body):
        if avatar_meshes.bone_of(body, mesh) is None and not _armatures(body, mesh):
            reasons.append(f"no enabled armature modifier of '{mesh.name}' uses '{body.name}'")
        elif suspects := _suspects(body, mesh):
            shape = stored_fits.shape_of(body, mesh)
            measured = evaluated_skin.cached_measurement(body, mesh, suspects, shape)
            reasons.append(measured.reason)
        else:
            evaluated_skin.drop_measurement(body, mesh)
    return next(filter(None, reasons), None)


def is_measured(body: bpy.types.Object) -> bool:
    """Test that each mesh of a body has no suspected deformation or a valid measurement."""
    suspects_of = {mesh: _suspects(body, mesh) for mesh in avatar_meshes.meshes_of(body)}
    return all(
        not suspects or evaluated_skin.valid_measurement(body, mesh, suspects) is not None
        for mesh, suspects in suspects_of.items()
    )


def _armatures(body: bpy.types.Object, mesh: bpy.types.Object) -> list[bpy.types.Modifier]:
    return [
        m for m in mesh.modifiers if m.type == "ARMATURE" and m.object == body and m.show_viewport
    ]


def _suspects(body: bpy.types.Object, mesh: bpy.types.Object) -> dict[str, str]:
    """Causes why bones alone may not pose a mesh, in words, by modifier name, "place", "armature",
    "bones" or "keys": a mesh off its place, enabled modifiers, special armature settings, shape
    keys. Empty for plain skinning."""
    armatures = _armatures(body, mesh)
    suspects = _misplacement(body, mesh)
    if armatures:
        suspects |= _armature_suspects(body, mesh, armatures)
    exact = [*armatures, *mesh_copies.mirrors_of(mesh)]  # exact with bones
    for modifier in mesh.modifiers:
        if modifier.show_viewport and modifier not in exact:
            suspects[modifier.name] = f"modifier '{modifier.name}' deforms it too"
    keys = mesh.data.shape_keys
    # A key at 0 without animation has no effect.
    if keys is not None and any(
        not key.mute and (key.value != 0.0 or keys.animation_data is not None)
        for key in keys.key_blocks[1:]
    ):
        suspects["keys"] = "shape keys deform it"
    elif stored_fits.shape_of(body, mesh):
        suspects["keys"] = "its shape keys are not those that the body was fitted to"
    return suspects


def _armature_suspects(
    body: bpy.types.Object, mesh: bpy.types.Object, armatures: list[bpy.types.Modifier]
) -> dict[str, str]:
    """Causes by "armature" (Preserve Volume, envelopes, vertex group, several modifiers) and
    "bones" (bendy or not deforming), in words; ``armatures`` is not empty."""
    suspects: dict[str, str] = {}
    modifier = armatures[0]
    if modifier.use_deform_preserve_volume:
        suspects["armature"] = "Preserve Volume is on"
    elif modifier.use_bone_envelopes or modifier.vertex_group or not modifier.use_vertex_groups:
        suspects["armature"] = f"modifier '{modifier.name}' does not deform by plain vertex groups"
    elif len(armatures) > 1:
        suspects["armature"] = "several armature modifiers deform it"
    bones = body.data.bones
    skin = filter(None, (bones.get(group.name) for group in mesh.vertex_groups))
    bent = [bone.name for bone in skin if bone.bbone_segments > 1 or not bone.use_deform]
    if bent:
        suspects["bones"] = f"bone '{bent[0]}' bends or does not deform"
    return suspects


def _misplacement(body: bpy.types.Object, mesh: bpy.types.Object) -> dict[str, str]:
    """Cause "place", in words, if a mesh moves without the armature, or is more than 2 mm off its
    place in rest pose: that of the fit, or of the built-in skin; other meshes have none."""
    if any(map(_is_moving, _carriers(mesh) ^ _carriers(body))):
        text = f"'{mesh.name}' does not move with '{body.name}' (animate the armature instead)"
        return {"place": text}
    scale = abs(body.matrix_world.determinant()) ** (1 / 3)
    gap_mm = 1000.0 * metres_of(bpy.context.scene) * scale * stored_fits.rest_gap(body, mesh)
    text = (
        f"'{mesh.name}' is up to {gap_mm:.0f} mm off its place on the armature (undo that with "
        "Alt G, Alt R and Alt S, move the armature instead, or fit the body again)"
    )
    return {"place": text} if gap_mm > _MISPLACED_MM else {}


def _carriers(obj: bpy.types.Object) -> set[bpy.types.Object]:
    """An object, the parents and targets of constraints that it follows, and what these follow."""
    carriers = [obj]
    for carrier in carriers:  # grows
        targets = (getattr(held, "target", None) for held in carrier.constraints if not held.mute)
        carriers += {carrier.parent, *targets} - {None, *carriers}
    return set(carriers)


def _is_moving(obj: bpy.types.Object) -> bool:
    """Test for a driver, or unequal keyframes, of an object's transform or constraints."""
    data = obj.animation_data
    return data is not None and any(
        curve.data_path.startswith(_TRANSFORMS)
        # Importers key every object: equal keyframes are no movement.
        and (curve.driver or np.ptp([key.co[1] for key in curve.keyframe_points] or [0]) > 1e-5)
        for curve in (*compat.all_fcurves(obj), *data.drivers)
    )


def _anchors(body: bpy.types.Object, model: PerceptualModel) -> SurfaceAnchors:
    """Anchors of each vertex of a model on the nearest triangle of the avatar's undeformed meshes,
    heights in armature units; InputError without faces."""
    avatar, skin = body.hfx.avatar, load_avatar().vertices
    rest, faces, count = [], [], 0
    for mesh in avatar_meshes.meshes_of(body):
        points, triangles = avatar_meshes.rest_surface(body, mesh, {})
        faces.append(triangles + count)
        count += len(points)
        # The built-in skin may be moved or edited, and is bound where it coincides with the model.
        rest.append(skin if points.shape == skin.shape else points)
    vertices, triangles = np.concatenate(rest), np.concatenate(faces)
    if not len(triangles):
        raise InputError(f"Avatar '{avatar.name}' has no faces that a body could be bound to.")
    tree = BVHTree.FromPolygons(vertices.tolist(), triangles.tolist(), all_triangles=True)
    nearest = [tree.find_nearest(vertex)[2] for vertex in model.vertices.tolist()]
    corners = triangles[nearest].astype(np.int32)
    shape, places = vertices.astype(np.float64)[corners], model.vertices.astype(np.float64)
    return SurfaceAnchors(corners, *_project_on_triangles(places, shape))


def _project_on_triangles(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project points onto the planes of triangles (n, 3, 3). Returns barycentric weights (n, 3),
    clipped near the triangle, and signed heights (n,). A degenerate triangle gives the first corner
    and height 0."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    _, u, v = np.where(lengths > 0.0, plane_weights(points, *corners.swapaxes(0, 1)).T, 0.0)
    u = np.clip(u, -_BEYOND, 1.0 + _BEYOND)
    v = np.clip(v, -_BEYOND, 1.0 + _BEYOND - u)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    feet = np.einsum("nc,nci->ni", weights, corners)
    heights = np.einsum("ni,ni->n", points - feet, normals)
    return weights, np.divide(heights, lengths, out=np.zeros(len(points)), where=lengths > 0.0)


def read_surfaces(
    body: bpy.types.Object, evaluated: Callable[[bpy.types.Object], bpy.types.Object]
) -> np.ndarray:
    """Evaluated vertices of all meshes of an avatar, (A, 3) float32. Vertices are numbered mesh
    after mesh, in the local space of the main mesh, as in the anchors of :func:`binding_of`.
    ``evaluated`` returns the evaluated object at the time of reading."""
    meshes = avatar_meshes.meshes_of(body)
    copies = [evaluated(mesh) for mesh in meshes]
    surfaces = [read_surface(body, *pair) for pair in zip(meshes, copies, strict=True)]
    to_main = copies[0].matrix_world.inverted_safe()
    for number, copy in enumerate(copies[1:], 1):
        matrix = np.array(to_main @ copy.matrix_world, np.float64)
        points = surfaces[number] @ matrix[:3, :3].T + matrix[:3, 3]
        surfaces[number] = points.astype(np.float32)
    return np.concatenate(surfaces)


def read_surface(
    body: bpy.types.Object, mesh: bpy.types.Object, evaluated: bpy.types.Object
) -> np.ndarray:
    """Evaluated positions of a mesh's own vertices, (A, 3) float32, local space.

    Vertices added by modifiers are left out. Hidden or merged vertices follow the nearest visible
    triangle.

    Raises InputError: the number of evaluated vertices changes with time or pose.
    """
    points = mesh_arrays.positions(evaluated.data)
    surface, count = evaluated_skin.last_surface_map(body, mesh), len(mesh.data.vertices)
    # Vertex numbers identify vertices only if their count is that of the measurement.
    is_known = len(points) == count if surface is None else surface.fits(len(points))
    if not is_known:
        raise InputError(
            f"Avatar '{mesh.name}': a modifier changes its number of vertices from {count} to "
            f"{len(points)}, not always alike, so its surface cannot be followed; apply "
            "that modifier, move it above the Armature modifier, or turn it off in viewports."
        )
    return points if surface is None else surface.positions(points)
