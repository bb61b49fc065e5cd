# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of an avatar's meshes in a scratch scene: the mesh at rest, and what modifiers hide of it.

Vertices of a copy carry their number as an attribute, which Blender copies along: each evaluated
vertex is known to be an original one (or a duplicate of one), or to be new.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
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
    """New scene, the first of a list of datablocks that are removed at the end."""
    made: list[bpy.types.ID] = [bpy.data.scenes.new(".HFX Measurement")]
    try:
        yield made
    finally:
        # scenes.remove() crashes Blender 4.3 within ``blender --command``.
        bpy.data.batch_remove(made)


def copy_in(
    made: list[bpy.types.ID], source: bpy.types.Object, data: bpy.types.ID | None
) -> bpy.types.Object:
    """Copy of an object in a scratch scene, where nothing moves it."""
    copy = source.copy()
    made += [each for each in (copy, data) if each is not None and each not in made]
    copy.data = data
    copy.animation_data_clear()
    copy.constraints.clear()
    copy.parent = None
    copy.matrix_world = source.matrix_world
    copy.hide_viewport = copy.hide_render = False
    made[0].collection.objects.link(copy)
    return copy


def numbered(mesh: bpy.types.Mesh) -> bpy.types.Mesh:
    """Copy of a mesh whose vertices hold their number, and a second one that proves it."""
    copy = mesh.copy()
    numbers = np.arange(len(copy.vertices))
    for name, values in ((_VERTEX, numbers), (_CHECK, _proof(numbers))):
        if name in copy.attributes:
            copy.attributes.remove(copy.attributes[name])
        copy.attributes.new(name, "INT", "POINT").data.foreach_set("value", values.astype(np.int32))
    return copy


def _proof(numbers: I64) -> I64:
    """Second number of a vertex: a mean of several ones does not fit to the mean of the first."""
    return (numbers * 2654435761 + 40503) % (1 << 30)


def numbers_of(mesh: bpy.types.Mesh) -> I64:
    """Original vertex of each vertex of an evaluated mesh, (E,); -1: a new one."""
    columns = []
    for name in (_VERTEX, _CHECK):
        attribute = mesh.attributes.get(name)
        if attribute is None or (attribute.domain, attribute.data_type) != ("POINT", "INT"):
            return np.full(len(mesh.vertices), -1, np.int64)
        columns.append(mesh_arrays.values(attribute.data, "value", kind=np.int32))
    numbers = columns[0].astype(np.int64)
    return np.where(_proof(numbers) == columns[1], numbers, -1)


@contextmanager
def rest_mesh(mesh: bpy.types.Object, shape: Mapping[str, float]) -> Iterator[bpy.types.Mesh]:
    """Mesh of an object before its armature deforms it, with the half that Mirror modifiers make.

    Parameters
    ----------
    shape : mapping of str
        Values of shape keys; the others are 0.
    """
    if not shape and not mirrors_of(mesh):
        yield mesh.data
        return
    with scratch() as made:
        yield at_rest(made, mesh, mesh.data.copy(), shape)


def at_rest(
    made: list[bpy.types.ID],
    mesh: bpy.types.Object,
    data: bpy.types.Mesh,
    shape: Mapping[str, float],
) -> bpy.types.Mesh:
    """New mesh: that of an object's data with its Mirror modifiers and some shape keys alone."""
    alone = copy_in(made, mesh, data)
    kept = {modifier.name for modifier in mirrors_of(mesh)}
    for modifier in [each for each in alone.modifiers if each.name not in kept]:
        alone.modifiers.remove(modifier)
    if data.shape_keys is not None:
        data.shape_keys.animation_data_clear()
        alone.show_only_shape_key = False
        for key in data.shape_keys.key_blocks:
            key.value, key.mute = shape.get(key.name, 0.0), False
    graph = updated(made)
    whole = bpy.data.meshes.new_from_object(
        alone.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph
    )
    made.append(whole)
    made[0].collection.objects.unlink(alone)
    return whole


def updated(made: list[bpy.types.ID]) -> bpy.types.Depsgraph:
    layer = made[0].view_layers[0]
    layer.update()
    return layer.depsgraph


def mirrors_of(mesh: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Mirror modifiers that make a mesh whole before its armature deforms it."""
    mirrors = []
    for modifier in mesh.modifiers:
        if modifier.type == "ARMATURE":
            break
        if modifier.type == "MIRROR" and modifier.show_viewport:
            mirrors.append(modifier)
    return mirrors


def animated(owner: bpy.types.ID) -> set[str]:
    """Paths of a datablock that F-curves or drivers write."""
    if owner.animation_data is None:
        return set()
    curves = [curve for curves in compat.curve_collections(owner) for curve in curves]
    return {curve.data_path for curve in (*curves, *owner.animation_data.drivers)}


def animated_keys(mesh: bpy.types.Mesh) -> set[str]:
    """Names of the shape keys whose value is animated or driven."""
    paths = set() if mesh.shape_keys is None else animated(mesh.shape_keys)
    return {
        key.name
        for key in (mesh.shape_keys.key_blocks if paths else ())
        if f'key_blocks["{bpy.utils.escape_identifier(key.name)}"].value' in paths
    }


def steady_shape(mesh: bpy.types.Mesh) -> dict[str, float]:
    """Values of the shape keys that are always on: those that make a person of a base mesh."""
    keys = mesh.shape_keys
    if keys is None or not keys.use_relative:
        return {}
    moving = animated_keys(mesh)
    return {
        key.name: float(key.value)
        for key in keys.key_blocks[1:]
        if key.value != 0.0 and not key.mute and key.name not in moving
    }


def hidden_vertices(mesh: bpy.types.Object, triangles: I64, points: F64) -> npt.NDArray[np.bool_]:
    """Find vertices of connected pieces that modifiers hide as a whole, in viewports or renders.

    What is hidden of a piece that shows is the body under its clothes, and stays. Nothing is
    hidden where no vertex can be traced (Remesh).

    Parameters
    ----------
    triangles : (F, 3) int64
    points : (A, 3) float64
        Of the mesh, before its armature deforms it.
    """
    from ..engine.retargeting.target import connected_pieces, weld

    hidden = np.zeros(len(points), np.bool_)
    of_mesh = mirrors_of(mesh)
    others = [m for m in mesh.modifiers if m.type != "ARMATURE" and m not in of_mesh]
    if not len(triangles) or not any(m.show_viewport or m.show_render for m in others):
        return hidden
    with scratch() as made:
        whole = numbered(at_rest(made, mesh, mesh.data.copy(), {}))
        shown = copy_in(made, mesh, whole)
        for modifier in [m for m in shown.modifiers if m.type in ("ARMATURE", "PARTICLE_SYSTEM")]:
            shown.modifiers.remove(modifier)
        for modifier in shown.modifiers:
            is_shown = modifier.show_viewport or modifier.show_render
            modifier.show_viewport = is_shown and modifier.name not in {m.name for m in of_mesh}
        numbers = numbers_of(shown.evaluated_get(updated(made)).data)
    is_left = np.zeros(len(points), np.bool_)
    is_left[numbers[numbers >= 0]] = True
    if not is_left.any():
        return hidden
    piece = connected_pieces(weld(points)[triangles])
    shows = np.bincount(piece, is_left[triangles].any(axis=1)) > 0
    hidden[triangles[~shows[piece]]] = True
    return hidden


def objects_of(
    modifier: bpy.types.Modifier,
) -> Iterator[tuple[Callable[[bpy.types.Object], None], bpy.types.Object]]:
    """Objects that a modifier refers to, each with a function that puts another one there."""
    for prop in modifier.bl_rna.properties:
        value = getattr(modifier, prop.identifier) if prop.type == "POINTER" else None
        if isinstance(value, bpy.types.Object):
            yield partial(setattr, modifier, prop.identifier), value
    for put, value in compat.node_inputs(modifier) if modifier.type == "NODES" else ():
        if isinstance(value, bpy.types.Object):
            yield put, value
