# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting an effect: its perceptual model as a mesh, whose vertex group Weight Paint edits."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING

import bmesh
import bpy

from ...engine.body.parts import PARTS, SIDES
from ...errors import InputError
from ..effects import effects

if TYPE_CHECKING:
    from ...engine.arrays import F64, Bool
    from ...engine.body.model import PerceptualModel


GROUP = "hfx"
PAINTED_EFFECT = "hfx_painted_effect"
"""Property of the mesh that is painted on: the effect whose area it shows."""

_BRUSH_SPACINGS = 1.5
_SMALLEST_BRUSH_M = 0.03


def begin(context: bpy.types.Context, effect: bpy.types.Object) -> bpy.types.Object:
    """Show the effect's perceptual model in place of the avatar, ready to be painted on."""
    from ...avatars import model_mesh, stored_fits

    if painted_mesh(effect) is not None:
        raise InputError(f"'{effect.name}' is being painted already.")
    body = effects.body_in(context.scene, effect)
    if body is None:
        raise InputError(
            f"'{effect.name}' {effects.missing_body_reason(effect)}: press Move to Body in the "
            "panel Haptic Effect first."
        )
    model = stored_fits.model_of(body, effects.model_id_for(effect.hfx.modality))
    painted = weights_of(effect)
    canvas = model_mesh.add_posed(context, body, model, f"{effect.name} Area")
    model_mesh.freeze_pose(context, canvas)
    canvas[PAINTED_EFFECT] = effect
    canvas.vertex_groups.active = canvas.vertex_groups.new(name=GROUP)
    canvas.data.use_mirror_x = False
    _write_group(canvas, painted)
    return canvas


def spacing(canvas: bpy.types.Object, effect: bpy.types.Object, vertex: int | None = None) -> float:
    """Distance between the vertices of a mesh that is painted on, Blender's units.

    Parameters
    ----------
    vertex : int, optional
        Where; else the median. Fingertips have vertices ten times as dense as the back.
    """
    import numpy as np

    model = effects.model_of(effect)
    # Vertices stand about as far apart as the sides of their equal triangles are long.
    is_there = vertex is not None and vertex < len(model)  # not if the mesh was edited
    area_m2 = model.areas_m2[vertex] if is_there else np.median(model.areas_m2)
    spacing_m = float(np.sqrt(area_m2 * (2.0 / np.sqrt(3.0))))
    return spacing_m * _units_a_metre(canvas, model)


def brush_radius(canvas: bpy.types.Object, effect: bpy.types.Object) -> float:
    """Brush radius that reaches the vertices next to the one under the brush, Blender's units."""
    smallest = _SMALLEST_BRUSH_M * _units_a_metre(canvas, effects.model_of(effect))
    return max(_BRUSH_SPACINGS * spacing(canvas, effect), smallest)


def _units_a_metre(canvas: bpy.types.Object, model: PerceptualModel) -> float:
    """Size of a mesh that shows a model, compared with the model."""
    import numpy as np

    size_m = float(np.ptp(model.vertices, axis=0).max())
    size = float(np.ptp(np.array(canvas.bound_box), axis=0).max())
    return size / size_m * abs(canvas.matrix_world.determinant()) ** (1 / 3)


def weights_of(effect: bpy.types.Object) -> F64:
    """Current area of the effect, painted or stored, as a weight for each vertex (V,).

    An area on another model, or on another edition of it, means nothing: all 0.

    Raises
    ------
    InputError
        The mesh that is being painted on was edited, or the stored area is spoilt.
    """
    import numpy as np

    canvas = painted_mesh(effect)
    if canvas is not None:
        return _read_group(effect, canvas)
    model = effects.model_of(effect)
    weights = np.zeros(len(model))
    if (effect.hfx.model_id, effect.hfx.model_hash) == (model.id, model.content_hash):
        vertices, values = effects.checked_area(effect.name, *effects.area(effect), len(model))
        weights[vertices] = values
    return weights


def set_weights(effect: bpy.types.Object, weights: F64) -> int:
    """Replace the effect's area, also while it is being painted; returns its size."""
    canvas = painted_mesh(effect)
    if canvas is not None:
        _read_group(effect, canvas)  # refuses a mesh that was edited
        _write_group(canvas, weights)
    return effects.store_weights(effect, weights)


def carry_over(effect: bpy.types.Object) -> int:
    """Carry an area over to the model of the modality that was chosen since; returns its size.

    Raises
    ------
    InputError
        It was painted on a model that is not here, or the stored area is spoilt.
    """
    import numpy as np

    from ...engine.body import areas
    from ...engine.body.model import load_model

    source = load_model(effect.hfx.model_id)
    if source.content_hash != effect.hfx.model_hash:
        raise InputError(f"Effect '{effect.name}' was painted on another edition of '{source.id}'.")
    weights = np.zeros(len(source))
    vertices, values = effects.checked_area(effect.name, *effects.area(effect), len(source))
    weights[vertices] = values
    return set_weights(effect, areas.transferred(source, weights, effects.model_of(effect)))


def selected_vertices(effect: bpy.types.Object) -> Bool:
    """Selected vertices of the mesh that is being painted on, as a mask (V,)."""
    import numpy as np

    canvas = painted_mesh(effect)
    if canvas is None:
        raise InputError(f"'{effect.name}' is not being painted.")
    size = len(effects.model_of(effect))
    canvas.update_from_editmode()
    if len(canvas.data.vertices) != size:
        raise InputError(_edited(canvas, size))
    found = np.zeros(size, np.bool_)
    canvas.data.vertices.foreach_get("select", found)
    return found


def store_all_painted() -> None:
    """Store all areas that are being painted with their effects, so that saved files and exports
    have them.
    """
    for obj in bpy.data.objects:
        effect = obj.get(PAINTED_EFFECT)
        if effect is not None and obj.library is None:
            with suppress(InputError):  # an edited canvas is reported when painting is finished
                effects.store_weights(effect, _read_group(effect, obj))


def painted_mesh(effect: bpy.types.Object) -> bpy.types.Object | None:
    """Mesh on which an effect is being painted."""
    found = (obj for obj in bpy.data.objects if obj.get(PAINTED_EFFECT) == effect)
    return next(found, None)


def canvas_in(context: bpy.types.Context) -> bpy.types.Object | None:
    """Mesh that is painted on: the active one, or the only one."""
    active = context.object
    if active is not None and active.get(PAINTED_EFFECT) is not None:
        return active
    found = [obj for obj in context.view_layer.objects if obj.get(PAINTED_EFFECT) is not None]
    return found[0] if len(found) == 1 else None


def end(effect: bpy.types.Object) -> int:
    """Take the painted weights over into the effect and remove the mesh; how many vertices."""
    canvas = painted_mesh(effect)
    if canvas is None:
        raise InputError(f"'{effect.name}' is not being painted.")
    count = effects.store_weights(effect, _read_group(effect, canvas))
    mesh = canvas.data
    bpy.data.objects.remove(canvas)
    bpy.data.meshes.remove(mesh)
    return count


def fill_parts(effect: bpy.types.Object, parts: Iterable[str], side: str = "both") -> int:
    """Paint whole body parts at full weight, added to the area; how many vertices it has now.

    Parameters
    ----------
    parts : iterable of str
        Ids of ``engine.body.regions.REGIONS``; empty: the whole body.
    side : "left", "right" or "both"
    """
    import numpy as np

    from ...engine.body.regions import region_weights

    model = effects.model_of(effect)
    found = [region_weights(model, part, side) for part in parts]
    if not found:
        found = [part_flags(model, (), side).astype(np.float64)]
    return set_weights(effect, np.maximum.reduce([weights_of(effect), *found]))


def part_flags(model: PerceptualModel, parts: Iterable[str], side: str = "both") -> Bool:
    """Mask (V,) of the vertices on some parts (none: the whole body), on one side or both."""
    import numpy as np

    wanted = [PARTS.index(part) for part in parts] or list(range(len(PARTS)))
    chosen: Bool = np.isin(model.part, wanted)
    if side != "both":
        chosen &= np.isin(model.side, (SIDES.index("centre"), SIDES.index(side)))
    return chosen


def _edited(canvas: bpy.types.Object, size: int) -> str:
    return (
        f"'{canvas.name}' was edited: it must keep its {size} vertices and the vertex group "
        f"'{GROUP}'. Undo that, or delete it and paint again."
    )


def _read_group(effect: bpy.types.Object, canvas: bpy.types.Object) -> F64:
    """The painted weights, (V,) in 0..1."""
    import numpy as np

    size = len(effects.model_of(effect))
    canvas.update_from_editmode()
    if GROUP not in canvas.vertex_groups or len(canvas.data.vertices) != size:
        raise InputError(_edited(canvas, size))
    group = canvas.vertex_groups[GROUP].index
    weights = np.zeros(size)
    for vertex in canvas.data.vertices:
        for element in vertex.groups:
            if element.group == group:
                weights[vertex.index] = element.weight
    return weights


def _write_group(canvas: bpy.types.Object, weights: F64) -> None:
    """Replace the painted weights, in whatever mode the mesh is."""
    group = canvas.vertex_groups[GROUP].index
    in_edit_mode = canvas.mode == "EDIT"
    mesh = bmesh.from_edit_mesh(canvas.data) if in_edit_mode else bmesh.new()
    if not in_edit_mode:
        mesh.from_mesh(canvas.data)
    layer = mesh.verts.layers.deform.verify()
    for vertex, weight in zip(mesh.verts, weights.tolist(), strict=True):
        if weight > 0.0:
            vertex[layer][group] = weight
        elif group in vertex[layer]:
            del vertex[layer][group]
    if in_edit_mode:
        bmesh.update_edit_mesh(canvas.data, loop_triangles=False, destructive=False)
    else:
        mesh.to_mesh(canvas.data)
        mesh.free()
        canvas.data.update()
