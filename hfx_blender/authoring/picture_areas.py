# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas from the avatar: an image on the UV map, or selected vertices."""

import bpy
import numpy as np
import numpy.typing as npt

from ..avatars import avatar_meshes, body_binding
from ..blender import mesh_arrays
from ..engine.arrays import F64
from ..engine.body import areas
from ..engine.scene import SurfaceAnchors
from ..errors import InputError
from .effects import effects
from .surfaces import surface_uv
from .surfaces.image_values import pixels_of


def weights_of_image(
    effect: bpy.types.Object, image: bpy.types.Image, channel: str, uv_map: str
) -> F64:
    """Weights (V,) of an effect's vertices from an image on the avatar's UV map. ``channel`` is
    "brightness" (luma of the stored values, Rec. 709), "darkness" or "alpha". An empty ``uv_map``
    is the map active for rendering. Raises InputError: there is no avatar or no such map, or the
    image has no pixels."""
    body, anchors = _anchors(effect)
    colours = pixels_of(image)
    if channel == "alpha":
        if image.channels < 4:
            raise InputError(f"Image '{image.name}' has no alpha channel.")
        pixels = colours[..., 3].astype(np.float64)
    else:
        is_grey = image.channels < 3
        luma = colours[..., 0] if is_grey else colours[..., :3] @ [0.2126, 0.7152, 0.0722]
        # HDR images may hold values above 1, and NaN.
        pixels = np.clip(np.nan_to_num(luma.astype(np.float64)), 0.0, 1.0)
        if channel == "darkness":
            pixels = 1.0 - pixels
    corner_uv = _corner_uvs(avatar_meshes.meshes_of(body), uv_map, anchors.corners)
    uv = np.einsum("vc,vci->vi", anchors.weights, corner_uv)
    return areas.from_image(pixels, uv)


def weights_of_selection(effect: bpy.types.Object) -> F64:
    """Weights (V,), 0 to 1, of an effect's vertices: barycentric mean of the selection (0 or 1) at
    the avatar's triangle below each, on the meshes before modifiers. The selection of an open Edit
    Mode is fetched first. InputError without a body or mesh."""
    body, anchors = _anchors(effect)
    selected = []
    # Vertex numbers run over all meshes, as in the anchors.
    for mesh in avatar_meshes.meshes_of(body):
        mesh.update_from_editmode()
        selected.append(mesh_arrays.values(mesh.data.vertices, "select", kind=np.bool_))
    flags = np.concatenate(selected).astype(np.float64)
    return np.einsum("vc,vc->v", anchors.weights, flags[anchors.corners]).clip(0.0, 1.0)


def _anchors(effect: bpy.types.Object) -> tuple[bpy.types.Object, SurfaceAnchors]:
    """Body of an effect, and the avatar's triangles under the vertices of the effect's model.
    Raises InputError without a body or without an avatar."""
    body = effect.hfx.body
    if body is None:
        raise InputError(f"'{effect.name}' has no body; choose one first.")
    if body.hfx.avatar is None:
        raise InputError(f"Body '{body.name}' has no mesh; add the haptic body with one selected.")
    return body, body_binding.anchors_of(body, effects.model_id_of(effect))


def _corner_uvs(meshes: list[bpy.types.Object], uv_map: str, needed: npt.NDArray[np.int32]) -> F64:
    """UVs (V, 3, 2) at mesh vertices ``needed`` (V, 3), three corners of a triangle each; vertex
    numbers run over all ``meshes``. At seams the UV is that of the triangle. Corners that are no
    triangle have the UV of any triangle at the vertex, NaN without any."""
    corners, uvs, of_vertex, first = [], [], [], 0
    for obj in meshes:
        mesh = obj.data
        at_loops = mesh_arrays.values(surface_uv.layer_of(mesh, uv_map, obj.name).uv, "vector", 2)
        vertices = mesh_arrays.triangles(mesh)
        uv = at_loops[mesh_arrays.triangles(mesh, "loops")].astype(np.float64)
        vertex_uvs = np.full((len(mesh.vertices), 2), np.nan)
        vertex_uvs[vertices.ravel()] = uv.reshape(-1, 2)
        corners.append(vertices.astype(np.int64) + first)
        uvs.append(uv)
        of_vertex.append(vertex_uvs)
        first += len(mesh.vertices)
    all_corners, uv = np.concatenate(corners), np.concatenate(uvs)
    # Anchors name corners, not triangles: sorted corners are the key of a triangle.
    rows = {tuple(key): row for row, key in enumerate(np.sort(all_corners, axis=1).tolist())}
    corner_uvs = np.concatenate(of_vertex)[needed]
    for vertex, key in enumerate(np.sort(needed, axis=1).tolist()):
        row = rows.get(tuple(key))
        if row is not None:
            order = [int(np.flatnonzero(all_corners[row] == c)[0]) for c in needed[vertex]]
            corner_uvs[vertex] = uv[row, order]
    return corner_uvs
