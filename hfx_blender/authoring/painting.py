# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting of an effect's area, on the perceptual model as a mesh for Weight Paint; saved areas."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bmesh
import bpy

from ..engine.body.parts import PARTS, SIDES
from ..engine.modality import MODALITIES
from ..errors import InputError
from ..files import resources
from ..files.atomic import amend_json
from ..files.json_shapes import Node, read
from .effects import effects

if TYPE_CHECKING:
    from ..engine.arrays import F64, Bool
    from ..engine.body.model import PerceptualModel


_GROUP = "hfx_group"
"""ID property of a canvas: name of the vertex group, which headers show: that of the effect."""

PAINTED_EFFECT = "hfx_painted_effect"
"""ID property of a canvas, its mesh and shape keys: the painted effect."""

_BRUSH_SPACINGS = 1.5
_SMALLEST_BRUSH_M = 0.03
_LONGEST_NAME = 60
_MOST_BYTES = 64 << 20


def begin(context: bpy.types.Context, effect: bpy.types.Object) -> bpy.types.Object:
    """Add a canvas for an effect: the perceptual model as a mesh, ready for Weight Paint. Raises
    InputError: the effect has a canvas already, or no body in the scene."""
    from ..avatars import model_mesh, stored_fits

    if canvas_of(effect) is not None:
        raise InputError(f"'{effect.name}' is being painted already.")
    body = effects.body_in(context.scene, effect)
    if body is None:
        raise InputError(
            f"'{effect.name}' {effects.missing_body_reason(effect)}: press Move to Body in the "
            "panel Haptic Effect first."
        )
    model = stored_fits.model_of(body, effects.model_id_of(effect))
    painted = weights_of(effect)
    canvas = model_mesh.add_posed(context, body, model, f"{effect.name} Area")
    model_mesh.freeze_pose(context, canvas)
    for owner in (canvas, canvas.data, canvas.data.shape_keys):
        owner[PAINTED_EFFECT] = effect
    canvas.vertex_groups.active = canvas.vertex_groups.new(name=effect.name)
    canvas[_GROUP] = canvas.vertex_groups.active.name
    canvas.data.use_mirror_x = False
    _write_group(canvas, painted)
    return canvas


def spacing(canvas: bpy.types.Object, effect: bpy.types.Object, vertex: int | None = None) -> float:
    """Distance of neighbouring vertices of a canvas, Blender units, from the area of ``vertex``; of
    the median area for None or a vertex not in the model."""
    import numpy as np

    model = effects.model_of(effect)
    # Cells of an even triangular grid: area = spacing ** 2 * sqrt(3) / 2. After an edit of the mesh
    # a vertex may be none of the model's.
    is_valid = vertex is not None and vertex < len(model)
    area_m2 = model.areas_m2[vertex] if is_valid else np.median(model.areas_m2)
    spacing_m = float(np.sqrt(area_m2 * (2.0 / np.sqrt(3.0))))
    return spacing_m * _units_per_metre(canvas, model)


def brush_radius(canvas: bpy.types.Object, effect: bpy.types.Object) -> float:
    """Brush radius in Blender units: 1.5 median vertex distances, at least 3 cm."""
    smallest = _SMALLEST_BRUSH_M * _units_per_metre(canvas, effects.model_of(effect))
    return max(_BRUSH_SPACINGS * spacing(canvas, effect), smallest)


def _units_per_metre(canvas: bpy.types.Object, model: PerceptualModel) -> float:
    """Blender units per metre on a canvas: longest box edge over that of the model, times the mean
    scale of the object."""
    import numpy as np

    # The canvas has the pose of the avatar, so the ratio of the longest edges is an estimate. The
    # cube root of the determinant is the mean scale of a matrix.
    size_m = float(np.ptp(model.vertices, axis=0).max())
    size = float(np.ptp(np.array(canvas.bound_box), axis=0).max())
    return size / size_m * abs(canvas.matrix_world.determinant()) ** (1 / 3)


def weights_of(effect: bpy.types.Object) -> F64:
    """Current weights (V,) of an effect's area, from the canvas or as stored.

    An area on another model or edition counts as empty.

    Raises InputError: the canvas was edited, or the stored area is invalid.
    """
    import numpy as np

    canvas = canvas_of(effect)
    if canvas is not None:
        return _read_group(effect, canvas)
    model = effects.model_of(effect)
    weights = np.zeros(len(model))
    if (effect.hfx.model_id, effect.hfx.model_hash) == (model.id, model.content_hash):
        vertices, values = effects.checked_area(effect.name, *effects.area(effect), len(model))
        weights[vertices] = values
    return weights


def set_weights(effect: bpy.types.Object, weights: F64) -> int:
    """Replace an effect's area by ``weights`` (V,), stored and on a canvas; return the number of
    weights above 0. Raises InputError, before any change, if the canvas was edited."""
    canvas = canvas_of(effect)
    if canvas is not None:
        # Reading raises an error for an edited mesh, before anything is written.
        _read_group(effect, canvas)
        _write_group(canvas, weights)
    count = effects.store_weights(effect, weights)
    _move_arrow(effect)
    return count


def _move_arrow(effect: bpy.types.Object) -> None:
    """Move a painted wind, whose arrow shows the direction of the air, to the skin nearest to the
    middle of its area, on the posed body. No effect without area or body, and if parented."""
    import numpy as np

    from ..engine.body.model import load_model
    from .paths import skin_picking

    vertices, weights = effects.area(effect)
    body = effects.body_in(bpy.context.scene, effect)
    if effect.hfx.modality != "wind" or not vertices or body is None or effect.parent is not None:
        return
    places = load_model(effect.hfx.model_id).vertices[vertices]
    anchor = skin_picking.Anchors.of(np.average(places, axis=0, weights=weights)[None])
    with suppress(InputError):  # an outdated fit, which the panels report
        points, _ = anchor.posed_on(body, bpy.context.evaluated_depsgraph_get())
        effect.location = points[0].tolist()


def transfer_area(effect: bpy.types.Object) -> int:
    """Transfer an area to the model of the effect's present modality and body; return the vertex
    count. Raises InputError, with the area unchanged: the area was painted on another edition of
    the model, is invalid, or reaches no vertex of the new model."""
    import numpy as np

    from ..engine.body import areas
    from ..engine.body.model import load_model

    source = load_model(effect.hfx.model_id)
    if source.content_hash != effect.hfx.model_hash:
        raise InputError(f"Effect '{effect.name}' was painted on another edition of '{source.id}'.")
    weights = np.zeros(len(source))
    vertices, values = effects.checked_area(effect.name, *effects.area(effect), len(source))
    weights[vertices] = values
    target = effects.model_of(effect)
    transferred = areas.transferred(source, weights, target)
    if not transferred.any():
        raise InputError(f"Effect '{effect.name}': its area reaches no vertex of '{target.id}'.")
    return set_weights(effect, transferred)


def transfer_areas(
    scene: bpy.types.Scene, bodies: Collection[bpy.types.Object]
) -> tuple[list[tuple[int, int]], list[str]]:
    """Transfer the areas of effects on ``bodies``, in all scenes, to the bodies' present sets of
    models. Returns the numbers of vertices before and after of each transferred area, and the names
    of effects whose area stays on the earlier model: linked, overridden or invalid ones."""
    on_bodies = (effect for effect in bpy.data.objects if effect.hfx.body in bodies)
    counts, names = [], []
    for effect in dict.fromkeys((*effects.effects_of(scene), *on_bodies)):
        # An area painted for another modality stays, as it does not belong to the effect now.
        modality = MODALITIES.get(effect.hfx.modality)
        is_own = modality and effect.hfx.model_id.startswith(f"hfx-{modality.model}-")
        if effects.body_of(effect) not in bodies or not is_own:
            continue
        try:
            if not effects.has_other_area(effect):
                continue
            if effect.library is not None or effect.override_library is not None:
                names.append(effect.name)
            else:
                before = len(effects.area(effect)[0])
                counts.append((before, transfer_area(effect)))
        except InputError:
            names.append(effect.name)
    return counts, names


def selected_vertices(effect: bpy.types.Object) -> Bool:
    """Mask (V,) of the vertices selected on a canvas; InputError without canvas or if edited."""
    import numpy as np

    canvas = canvas_of(effect)
    if canvas is None:
        raise InputError(f"'{effect.name}' is not being painted.")
    size = len(effects.model_of(effect))
    # Selections of Edit Mode reach the mesh only on request.
    canvas.update_from_editmode()
    if len(canvas.data.vertices) != size:
        raise InputError(_edited_message(canvas, size))
    selected = np.zeros(size, np.bool_)
    canvas.data.vertices.foreach_get("select", selected)
    return selected


def store_all_painted() -> None:
    """Store the painted weights of every canvas, except linked canvases, as its effect's area. The
    canvases stay. Where the mesh of a canvas was edited (vertex count or group changed), the effect
    keeps the area stored before; no error is raised."""
    for obj in bpy.data.objects:
        effect = obj.get(PAINTED_EFFECT)
        if effect is not None and obj.library is None:
            with suppress(InputError):  # an edited canvas is reported when painting is finished
                effects.store_weights(effect, _read_group(effect, obj))


def canvas_of(effect: bpy.types.Object) -> bpy.types.Object | None:
    """Canvas of an effect; None outside of painting."""
    return next((obj for obj in bpy.data.objects if obj.get(PAINTED_EFFECT) == effect), None)


def is_stroke(depsgraph: bpy.types.Depsgraph) -> bool:
    """Test for an update of canvases, meshes and shape keys alone, which changes no effect."""
    updates = depsgraph.updates
    return bool(updates) and all(PAINTED_EFFECT in update.id for update in updates)


def canvas_in(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active object if a canvas, else the only canvas of the view layer; None otherwise."""
    active = getattr(context, "object", None)  # missing in a timer at times
    if active is not None and active.get(PAINTED_EFFECT) is not None:
        return active
    canvases = [obj for obj in context.view_layer.objects if obj.get(PAINTED_EFFECT) is not None]
    return canvases[0] if len(canvases) == 1 else None


def end(effect: bpy.types.Object) -> int:
    """Store the painted weights, remove the canvas and return the number of painted vertices.
    Raises InputError: the effect has no canvas, or the canvas was edited; nothing changes then."""
    canvas = canvas_of(effect)
    if canvas is None:
        raise InputError(f"'{effect.name}' is not being painted.")
    count = effects.store_weights(effect, _read_group(effect, canvas))
    _move_arrow(effect)
    mesh = canvas.data
    bpy.data.objects.remove(canvas)
    bpy.data.meshes.remove(mesh)
    return count


def fill_parts(effect: bpy.types.Object, parts: Iterable[str], side: str = "both") -> int:
    """Add body regions on ``side`` ("both", "left", "right") to an area; return the number of
    vertices in the whole area. Each vertex gets the larger of present weight and region weight.
    ``parts`` are ids of ``engine.body.regions.REGIONS``; empty: the whole side at weight 1. Raises
    KeyError for an unknown id, ValueError for an unknown side."""
    import numpy as np

    from ..engine.body.regions import region_weights

    model = effects.model_of(effect)
    layers = [region_weights(model, part, side) for part in parts]
    if not layers:
        layers = [part_flags(model, (), side).astype(np.float64)]
    return set_weights(effect, np.maximum.reduce([weights_of(effect), *layers]))


def part_flags(model: PerceptualModel, parts: Iterable[str], side: str = "both") -> Bool:
    """Mask (V,) of vertices on body parts (none: all) and ``side``; a side includes the centre."""
    import numpy as np

    numbers = [PARTS.index(part) for part in parts] or list(range(len(PARTS)))
    is_inside: Bool = np.isin(model.part, numbers)
    if side != "both":
        is_inside &= np.isin(model.side, (SIDES.index("centre"), SIDES.index(side)))
    return is_inside


def _group_name(canvas: bpy.types.Object) -> str:
    return str(canvas.get(_GROUP, "hfx"))  # the name in files of earlier versions


def _edited_message(canvas: bpy.types.Object, size: int) -> str:
    """Message about a canvas without its vertex group, or with another number of vertices."""
    return (
        f"'{canvas.name}' was edited: it must keep its {size} vertices and the vertex group "
        f"'{_group_name(canvas)}'. Undo that, or delete it and paint again."
    )


def _read_group(effect: bpy.types.Object, canvas: bpy.types.Object) -> F64:
    """Painted weights (V,) of a canvas, 0 to 1; InputError for an edited mesh."""
    import numpy as np

    size = len(effects.model_of(effect))
    canvas.update_from_editmode()
    # Vertex numbers identify skin only while the mesh has the model's vertices.
    if _group_name(canvas) not in canvas.vertex_groups or len(canvas.data.vertices) != size:
        raise InputError(_edited_message(canvas, size))
    group = canvas.vertex_groups[_group_name(canvas)].index
    weights = np.zeros(size)
    # Vertex groups are sparse, and foreach_get cannot read them.
    for vertex in canvas.data.vertices:
        for element in vertex.groups:
            if element.group == group:
                weights[vertex.index] = element.weight
    return weights


def saved_names() -> list[str]:
    """Sorted names of the user's saved areas; empty if their file is unreadable."""
    return sorted(_read_saved())


def save_area(effect: bpy.types.Object, name: str) -> int:
    """Save an effect's area by name for all files; return the number of vertices.

    Saving an empty area deletes the saved area.

    Raises InputError: the name is empty or too long, or the file of saved areas is unreadable or
    would be too large to read. Raises OutputError: the file cannot be written.
    """
    import numpy as np

    if not name or len(name) > _LONGEST_NAME:
        raise InputError(f"Name: expected 1 to {_LONGEST_NAME} letters, found {len(name)}.")
    weights = weights_of(effect)
    vertices = np.flatnonzero(weights > 0.0)
    area = {
        "model": effects.model_id_of(effect),
        "vertices": vertices.tolist(),
        "weights": np.round(weights[vertices], 4).tolist(),
    }

    # Read again under the lock of the file: another Blender may have saved an area.
    def content() -> dict[str, Any]:
        # An unreadable file must not pass for an empty one: every saved area would be lost.
        path = resources.saved_areas()
        known = _areas_of(read(path, _MOST_BYTES)) if os.path.lexists(path) else {}
        saved = {key: value for key, value in known.items() if key != name}
        saved |= {name: area} if len(vertices) else {}
        size = len(json.dumps(saved, indent=1))
        if size > _MOST_BYTES:
            raise InputError(
                f"{path}: saved areas would take {size:,} bytes, allowed are {_MOST_BYTES:,}; "
                "delete one: save an empty area by its name."
            )
        return saved

    amend_json(resources.saved_areas(), content)
    return len(vertices)


def add_saved(effect: bpy.types.Object, name: str) -> int:
    """Add a saved area to an effect's area, by the larger weight; return the number of vertices of
    both. An area saved on another model is transferred. Raises InputError: there is no readable
    area of that name, or the canvas was edited."""
    import numpy as np

    from ..engine.body import areas
    from ..engine.body.model import load_model

    model = effects.model_of(effect)
    try:
        area = _read_saved()[name]
        source = load_model(area["model"])
        weights = np.zeros(len(source))
        # A file may have been edited: NaN and values beyond 0 to 1 must not reach an effect.
        stored = np.asarray(area["weights"], np.float64)
        weights[np.asarray(area["vertices"], np.int64)] = np.clip(np.nan_to_num(stored), 0.0, 1.0)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError):
        text = f"{resources.saved_areas()}: has no readable area '{name}'; save it again."
        raise InputError(text) from None
    if source is not model:
        weights = areas.transferred(source, weights, model)
    return set_weights(effect, np.maximum(weights_of(effect), weights))


def _read_saved() -> dict[str, Any]:
    """Saved areas by name; empty if the file is missing, damaged or above 64 MiB."""
    try:
        return _areas_of(read(resources.saved_areas(), _MOST_BYTES))
    except InputError:
        return {}


def _areas_of(document: Node) -> dict[str, Any]:
    if not isinstance(document.value, dict):
        document.fail("an object with areas by name")
    return document.value


def _write_group(canvas: bpy.types.Object, weights: F64) -> None:
    """Replace the painted weights of a canvas by ``weights`` (V,), in any mode; 0: no weight."""
    group = canvas.vertex_groups[_group_name(canvas)].index
    # Edit Mode has a separate mesh; writing to the stored mesh would be lost.
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
