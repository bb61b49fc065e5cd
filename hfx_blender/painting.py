# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting an effect: its perceptual model as a mesh, whose vertex group Weight Paint edits."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from . import effects, retargeting
from .engine.body.model import PerceptualModel, load_model
from .engine.body.parts import PARTS, SIDES
from .errors import InputError

GROUP = "hfx"


def begin(context: bpy.types.Context, effect: bpy.types.Object) -> bpy.types.Object:
    """Show the effect's perceptual model in place of the avatar, ready to be painted on."""
    if painted_mesh(effect) is not None:
        raise InputError(f"'{effect.name}' is being painted already.")
    body = effect.hfx.body
    if body is None:
        raise InputError(f"'{effect.name}' is painted on no body; choose one first.")
    model = retargeting.model_of(body, effects.model_id_for(effect.hfx.modality))
    mesh = bpy.data.meshes.new(f"{effect.name} Area")
    mesh.from_pydata(model.vertices.tolist(), [], model.triangles.tolist())
    mesh.update()
    canvas = bpy.data.objects.new(mesh.name, mesh)
    canvas["hfx_painted_effect"] = effect
    canvas.hide_render = True
    context.scene.collection.objects.link(canvas)
    # The weights that pose it, as groups of its own; the painted group comes first.
    group = canvas.vertex_groups.new(name=GROUP)
    for vertex, weight in _area_on(load_model(model.id), effect).items():
        group.add([vertex], weight, "REPLACE")
    weights = model.weights
    bones = [canvas.vertex_groups.new(name=name) for name in model.bone_names]
    owners = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    for vertex, bone, value in zip(
        owners.tolist(), weights.bones.tolist(), weights.values.tolist(), strict=True
    ):
        bones[bone].add([vertex], value, "REPLACE")
    for bone_group in bones:
        bone_group.lock_weight = True
    canvas.vertex_groups.active = group
    canvas.parent = body
    modifier = canvas.modifiers.new("Armature", "ARMATURE")
    modifier.object = body
    return canvas


def _area_on(model: PerceptualModel, effect: bpy.types.Object) -> dict[int, float]:
    """What is painted on this very model; an area on another one, or edition, means nothing."""
    if (effect.hfx.model_id, effect.hfx.model_hash) != (model.id, model.content_hash):
        return {}
    return dict(zip(*effects.area(effect), strict=True))


def painted_mesh(effect: bpy.types.Object) -> bpy.types.Object | None:
    """The mesh on which an effect is being painted."""
    for obj in bpy.data.objects:
        if obj.get("hfx_painted_effect") == effect:
            return obj
    return None


def end(effect: bpy.types.Object) -> int:
    """Take the painted weights over into the effect and remove the mesh; how many vertices."""
    canvas = painted_mesh(effect)
    if canvas is None:
        raise InputError(f"'{effect.name}' is not being painted.")
    size = len(load_model(effects.model_id_for(effect.hfx.modality)))
    if GROUP not in canvas.vertex_groups or len(canvas.data.vertices) != size:
        raise InputError(
            f"'{canvas.name}' was edited: it must keep its {size} vertices and the vertex group "
            f"'{GROUP}'. Undo that, or delete it and paint again."
        )
    group = canvas.vertex_groups[GROUP].index
    found = {
        vertex.index: element.weight
        for vertex in canvas.data.vertices
        for element in vertex.groups
        if element.group == group and element.weight > 0.0
    }
    effects.set_area(effect, list(found), list(found.values()))
    mesh = canvas.data
    bpy.data.objects.remove(canvas)
    bpy.data.meshes.remove(mesh)
    return len(found)


def fill_parts(effect: bpy.types.Object, parts: Iterable[str], side: str = "both") -> int:
    """Paint whole body parts at full weight, added to the area; how many vertices it has now.

    Parameters
    ----------
    parts : iterable of str
        Names of ``engine.body.parts.PARTS``; empty: the whole body.
    side : "left", "right" or "both"
    """
    model = load_model(effects.model_id_for(effect.hfx.modality))
    wanted = [PARTS.index(part) for part in parts] or list(range(len(PARTS)))
    chosen = np.isin(model.part, wanted)
    if side != "both":
        chosen &= np.isin(model.side, (SIDES.index("centre"), SIDES.index(side)))
    area = _area_on(model, effect)
    area.update(dict.fromkeys(np.flatnonzero(chosen).tolist(), 1.0))
    effects.set_area(effect, list(area), list(area.values()))
    return len(area)
