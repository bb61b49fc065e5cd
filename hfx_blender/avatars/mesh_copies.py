# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of an avatar's meshes in a scratch scene: the rest mesh, and pieces hidden by modifiers.

Vertices of a copy store their number as an attribute, which Blender's modifiers propagate: so an
evaluated vertex is recognised as an original vertex (or its duplicate), or as new.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import takewhile
from typing import Final

import bpy
import numpy as np
import numpy.typing as npt

from ..blender import compat, mesh_arrays
from ..engine.arrays import F64, I64

_VERTEX: Final = "hfx_vertex"
_CHECK: Final = "hfx_vertex_check"


@contextmanager
def scratch() -> Iterator[list[bpy.types.ID]]:
    """Yield a list with a new scene. All datablocks in the list are removed at the end."""
    datablocks: list[bpy.types.ID] = [bpy.data.scenes.new(".HFX Measurement")]
    try:
        yield datablocks
    finally:
        # scenes.remove() crashes Blender 4.3 within ``blender --command``.
        bpy.data.batch_remove(datablocks)


def copy_into(
    datablocks: list[bpy.types.ID], source: bpy.types.Object, data: bpy.types.ID | None
) -> bpy.types.Object:
    """Copy an object into a scratch scene, without parent, constraints and animation. Copy and data
    are added to ``datablocks``. ``data`` becomes the copy's data and is not copied."""
    copy = source.copy()
    datablocks += [new for new in (copy, data) if new is not None and new not in datablocks]
    copy.data = data
    # Nothing may move the copy: no animation, constraint or parent.
    copy.animation_data_clear()
    copy.constraints.clear()
    copy.parent = None
    # After the parent is removed: Blender would convert the matrix to the parent's space.
    copy.matrix_world = source.matrix_world
    copy.hide_viewport = copy.hide_render = False
    datablocks[0].collection.objects.link(copy)
    return copy


def with_vertex_numbers(mesh: bpy.types.Mesh) -> bpy.types.Mesh:
    """Copy of a mesh with two integer vertex attributes: number and hash of the number."""
    copy = mesh.copy()
    numbers = np.arange(len(copy.vertices))
    for name, values in ((_VERTEX, numbers), (_CHECK, _check_numbers(numbers))):
        # With a name in use, a new attribute would be renamed with a suffix and never be read.
        if name in copy.attributes:
            copy.attributes.remove(copy.attributes[name])
        copy.attributes.new(name, "INT", "POINT").data.foreach_set("value", values.astype(np.int32))
    return copy


def _check_numbers(numbers: I64) -> I64:
    """Hash of vertex numbers, int64 below 2^30. A vertex that a modifier interpolates has a mean of
    hashes, which is not the hash of its mean number."""
    return (numbers * 2654435761 + 40503) % (1 << 30)


def original_vertices(mesh: bpy.types.Mesh) -> I64:
    """Original vertex of each evaluated vertex, (E,) int64; -1 for a new vertex, and for all if a
    modifier has dropped the numbers."""
    columns = []
    # A modifier may drop the attribute, or change the type: then no vertex is traced.
    for name in (_VERTEX, _CHECK):
        attribute = mesh.attributes.get(name)
        if attribute is None or (attribute.domain, attribute.data_type) != ("POINT", "INT"):
            return np.full(len(mesh.vertices), -1, np.int64)
        columns.append(mesh_arrays.values(attribute.data, "value", kind=np.int32))
    numbers = columns[0].astype(np.int64)
    return np.where(_check_numbers(numbers) == columns[1], numbers, -1)


@contextmanager
def rest_mesh(mesh: bpy.types.Object, shape: Mapping[str, float]) -> Iterator[bpy.types.Mesh]:
    """Yield an object's mesh before its Armature modifier, with earlier Mirror modifiers applied.
    ``shape`` holds values of shape keys; keys that are not given are 0. The mesh may be temporary,
    and is removed at the end then."""
    if not shape and not mirrors_of(mesh):
        yield mesh.data
        return
    with scratch() as datablocks:
        yield at_rest(datablocks, mesh, mesh.data.copy(), shape)


def at_rest(
    datablocks: list[bpy.types.ID],
    mesh: bpy.types.Object,
    data: bpy.types.Mesh,
    shape: Mapping[str, float],
) -> bpy.types.Mesh:
    """New mesh of an object's data with only the Mirror modifiers and the given shape keys applied.

    The mesh is added to ``datablocks``. The shape keys of ``data`` are changed; keys not given are
    0.
    """
    copy = copy_into(datablocks, mesh, data)
    mirror_names = {modifier.name for modifier in mirrors_of(mesh)}
    # Only Mirror modifiers change the set of vertices before the armature.
    for modifier in list(copy.modifiers):
        if modifier.name not in mirror_names:
            copy.modifiers.remove(modifier)
    if data.shape_keys is not None:
        data.shape_keys.animation_data_clear()
        copy.show_only_shape_key = False
        for key in data.shape_keys.key_blocks:
            key.value, key.mute = shape.get(key.name, 0.0), False
    graph = evaluated_graph(datablocks)
    rest = bpy.data.meshes.new_from_object(
        copy.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph
    )
    datablocks.append(rest)
    datablocks[0].collection.objects.unlink(copy)
    return rest


def evaluated_graph(datablocks: list[bpy.types.ID]) -> bpy.types.Depsgraph:
    """Evaluated dependency graph of a scratch scene."""
    layer = datablocks[0].view_layers[0]
    layer.update()
    return layer.depsgraph


def mirrors_of(mesh: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Enabled Mirror modifiers above a mesh's first Armature modifier; all without one."""
    above = takewhile(lambda modifier: modifier.type != "ARMATURE", mesh.modifiers)
    return [modifier for modifier in above if modifier.type == "MIRROR" and modifier.show_viewport]


def animated_paths(owner: bpy.types.ID) -> set[str]:
    """Data paths of a datablock's F-curves and drivers."""
    if owner.animation_data is None:
        return set()
    curves = compat.all_fcurves(owner)
    return {curve.data_path for curve in (*curves, *owner.animation_data.drivers)}


def animated_keys(mesh: bpy.types.Mesh) -> set[str]:
    """Names of shape keys with an F-curve or driver on their value."""
    paths = set() if mesh.shape_keys is None else animated_paths(mesh.shape_keys)
    return {
        key.name
        for key in (mesh.shape_keys.key_blocks if paths else ())
        if f'key_blocks["{bpy.utils.escape_identifier(key.name)}"].value' in paths
    }


def steady_shape(mesh: bpy.types.Mesh) -> dict[str, float]:
    """Non-zero values of shape keys without animation, by name; empty for absolute shape keys."""
    keys = mesh.shape_keys
    if keys is None or not keys.use_relative:
        return {}
    # Animated keys are expressions, unanimated keys are the person's shape.
    moving = animated_keys(mesh)
    return {
        key.name: float(key.value)
        for key in keys.key_blocks[1:]
        if key.value != 0.0 and not key.mute and key.name not in moving
    }


def hidden_vertices(mesh: bpy.types.Object, triangles: I64, points: F64) -> npt.NDArray[np.bool_]:
    """Vertices (A,) bool of connected pieces that modifiers hide in viewports and renders.

    ``triangles`` (F, 3) and ``points`` (A, 3) describe the mesh before the Armature modifier.
    Hidden vertices of a partly visible piece are the body under clothes, and are not marked. None
    are marked if no evaluated vertex is an original vertex (Remesh).
    """
    from ..engine.retargeting.target import connected_pieces, weld

    hidden = np.zeros(len(points), np.bool_)
    mirrors = mirrors_of(mesh)
    if not len(triangles) or not any(
        m.show_viewport or m.show_render
        for m in mesh.modifiers
        if m.type != "ARMATURE" and m not in mirrors
    ):
        return hidden
    # Armature and particles hide nothing, and would only cost time.
    with scratch() as datablocks:
        rest = with_vertex_numbers(at_rest(datablocks, mesh, mesh.data.copy(), {}))
        visible = copy_into(datablocks, mesh, rest)
        for modifier in [m for m in visible.modifiers if m.type in ("ARMATURE", "PARTICLE_SYSTEM")]:
            visible.modifiers.remove(modifier)
        for modifier in visible.modifiers:
            is_shown = modifier.show_viewport or modifier.show_render
            modifier.show_viewport = is_shown and modifier.name not in {m.name for m in mirrors}
        originals = original_vertices(visible.evaluated_get(evaluated_graph(datablocks)).data)
    is_visible = np.zeros(len(points), np.bool_)
    is_visible[originals[originals >= 0]] = True
    if not is_visible.any():
        return hidden
    # A Mask modifier hides skin under clothes; only a piece without a visible vertex is dropped.
    piece = connected_pieces(weld(points)[triangles])
    has_visible = np.bincount(piece, is_visible[triangles].any(axis=1)) > 0
    hidden[triangles[~has_visible[piece]]] = True
    return hidden


def objects_of(
    modifier: bpy.types.Modifier,
) -> Iterator[tuple[Callable[[bpy.types.Object], None], bpy.types.Object]]:
    """Yield each object that a modifier refers to, after a function that replaces the reference."""
    for prop in modifier.bl_rna.properties:
        value = getattr(modifier, prop.identifier) if prop.type == "POINTER" else None
        if isinstance(value, bpy.types.Object):
            yield partial(setattr, modifier, prop.identifier), value
    for put, value in compat.node_inputs(modifier) if modifier.type == "NODES" else ():
        if isinstance(value, bpy.types.Object):
            yield put, value
