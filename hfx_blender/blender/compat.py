# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between Blender 4.2 and 5.2, a function each."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import chain
from typing import Any

import bpy
from bpy_extras import anim_utils

TELLS_OWNERS_OF_PATHS = hasattr(bpy.types.BlendData, "file_path_map")

CAN_JOIN_AREAS = bpy.app.version >= (4, 3)
"""Support for joining areas of a window by their positions."""

HAS_ASSET_SHELVES = bpy.app.version >= (5, 0)
"""Support for asset shelves of objects, which Blender drags into the scene."""

GIZMOS_MAKE_UNDO_STEPS = "use_undo" in bpy.types.Gizmo.bl_rna.properties
"""Support for Blender's own undo steps after a gizmo is dragged."""


def fcurves(owner: bpy.types.ID) -> list[bpy.types.FCurve]:
    """F-curves of a datablock's assigned action and slot; empty without an action.
    ``Action.fcurves`` shows only the first slot in 4.4 and is removed in 5.0."""
    data = owner.animation_data
    if data is None or data.action is None:
        return []
    return action_fcurves(data.action, getattr(data, "action_slot", None))


def fcurve_of(owner: bpy.types.ID, data_path: str) -> bpy.types.FCurve | None:
    """First F-curve of a property in a datablock's assigned action; None if missing."""
    return next((curve for curve in fcurves(owner) if curve.data_path == data_path), None)


def action_fcurves(
    action: bpy.types.Action, slot: "bpy.types.ActionSlot | None"
) -> list[bpy.types.FCurve]:
    """F-curves of an action for a slot (ignored before 4.4, which has no slots)."""
    return list(_curves_of(action, slot) or ())


def _curves_of(
    action: bpy.types.Action, slot: "bpy.types.ActionSlot | None"
) -> bpy.types.bpy_prop_collection | None:
    if not hasattr(action, "slots"):
        return action.fcurves
    bag = None if slot is None else anim_utils.action_get_channelbag_for_slot(action, slot)
    return None if bag is None else bag.fcurves


def strip_fcurves(strip: bpy.types.NlaStrip) -> list[bpy.types.FCurve]:
    """F-curves of an NLA strip's action and slot."""
    if strip.action is None:
        return []
    return action_fcurves(strip.action, getattr(strip, "action_slot", None))


def curve_collections(owner: bpy.types.ID) -> list[bpy.types.bpy_prop_collection]:
    """Collections of F-curves of the actions of a datablock and its NLA strips, each once."""
    data = owner.animation_data
    if data is None:
        return []
    strips = [strip for track in data.nla_tracks for strip in with_grouped(track.strips)]
    # A strip and the datablock may share an action and slot.
    collections: dict[tuple[str, int], bpy.types.bpy_prop_collection] = {}
    for user in (data, *strips):
        action, slot = user.action, getattr(user, "action_slot", None)
        curves = None if action is None else _curves_of(action, slot)
        if curves is not None:
            collections[action.name, getattr(slot, "handle", 0)] = curves
    return list(collections.values())


def all_fcurves(owner: bpy.types.ID) -> list[bpy.types.FCurve]:
    """F-curves of the action of a datablock, then of its NLA strips, muted curves included."""
    return [curve for curves in curve_collections(owner) for curve in curves]


def with_grouped(strips: Iterable[bpy.types.NlaStrip]) -> Iterator[bpy.types.NlaStrip]:
    """Yield strips, including the strips inside meta strips."""
    for strip in strips:
        yield strip
        yield from with_grouped(strip.strips)


def new_fcurve(
    owner: bpy.types.ID, action: bpy.types.Action, data_path: str, index: int = 0
) -> bpy.types.FCurve:
    """F-curve of a property in an action assigned to the datablock; created if missing."""
    if hasattr(action, "fcurve_ensure_for_datablock"):  # 4.4 and later
        return action.fcurve_ensure_for_datablock(owner, data_path, index=index)
    # Before 4.4: new() fails where the F-curve exists.
    curve = action.fcurves.find(data_path, index=index)
    return curve or action.fcurves.new(data_path, index=index)


def own_fcurve(owner: bpy.types.ID, data_path: str, title: str, index: int = 0) -> bpy.types.FCurve:
    """F-curve in a datablock's assigned action; both made if missing, the action with ``title``."""
    data = owner.animation_data or owner.animation_data_create()
    if data.action is None:
        data.action = bpy.data.actions.new(f"{owner.name} {title}".rstrip())
    return new_fcurve(owner, data.action, data_path, index)


def set_keys(
    curve: bpy.types.FCurve, keys: Iterable[tuple[float, float]], interpolation: str = "LINEAR"
) -> None:
    """Replace the keyframes of an F-curve by (frame, value) pairs, all with ``interpolation``."""
    flat = [number for key in keys for number in key]
    curve.keyframe_points.clear()
    curve.keyframe_points.add(len(flat) // 2)
    curve.keyframe_points.foreach_set("co", flat)
    for point in curve.keyframe_points:
        point.interpolation = interpolation
    # Also sorts the keyframes and computes the handles.
    curve.update()


def place_along_parent_bone(obj: bpy.types.Object) -> float:
    """Position of an object along the parent bone: 0 head, 1 tail (always 1 before 5.2)."""
    return float(getattr(obj, "parent_bone_head_tail_factor", 1.0))


def _brush_settings(context: bpy.types.Context, mode: str = "weight_paint") -> tuple[Any, bool]:
    """Settings shared by brushes of a paint mode, and True if their size is a diameter. Before 5.0
    settings of the scene, and sizes are radii."""
    tools = context.tool_settings
    unified = getattr(getattr(tools, mode), "unified_paint_settings", None)
    return (tools.unified_paint_settings, False) if unified is None else (unified, True)


def set_brush_weight(context: bpy.types.Context, weight: float) -> None:
    """Set the weight of Weight Paint's brushes, and let all brushes share a size."""
    unified, _ = _brush_settings(context)
    unified.weight = weight
    unified.use_unified_size = True


def paint_white(context: bpy.types.Context, radius: int) -> None:
    """Set the colour and, since 5.0, the radius in pixels of Texture Paint's brushes, and let all
    brushes share them. Before, the size is that of Weight Paint, too."""
    unified, is_diameter = _brush_settings(context, "image_paint")
    unified.color, unified.use_unified_color = (1.0, 1.0, 1.0), True
    if is_diameter:
        unified.size, unified.use_unified_size = 2 * radius, True


def brush_radius(context: bpy.types.Context) -> int:
    """Radius of Weight Paint's brushes, pixels."""
    unified, is_diameter = _brush_settings(context)
    return round(unified.size / 2) if is_diameter else unified.size


def set_brush_radius(context: bpy.types.Context, radius: int) -> None:
    """Set the radius of Weight Paint's brushes, pixels."""
    unified, is_diameter = _brush_settings(context)
    unified.size = 2 * radius if is_diameter else radius


def strips(editor: bpy.types.SequenceEditor) -> bpy.types.bpy_prop_collection:
    """Strips of a sequence editor (``sequences`` before 4.4)."""
    return editor.strips if hasattr(editor, "strips") else editor.sequences


def properties(owner: bpy.types.ID) -> object:
    """The add-on's properties of a datablock as comparable plain values; None without any."""
    return plain(stored_properties(owner).get("hfx")) or None


def stored_properties(owner: bpy.types.bpy_struct) -> Mapping[str, Any]:
    """Raw stored values of the registered properties (before 5.0: all) of a datablock or bone."""
    if hasattr(owner, "bl_system_properties_get"):
        return owner.bl_system_properties_get() or {}
    return owner


def plain(value: Any) -> object:
    """Stored value as comparable plain data: data-blocks by full name, without empty groups."""
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if hasattr(value, "items"):
        entries = {key: plain(entry) for key, entry in value.items()}
        # Reading an unset group or pointer stores an empty group, which is no difference.
        return {key: entry for key, entry in entries.items() if entry or entry == 0}
    if hasattr(value, "to_list"):
        return value.to_list()
    return [plain(entry) for entry in value] if isinstance(value, list) else value


def data_blocks() -> Iterator[bpy.types.ID]:
    """Iterate over all data-blocks of the open file."""
    collections = (p for p in bpy.data.bl_rna.properties if p.type == "COLLECTION")
    return chain.from_iterable(getattr(bpy.data, p.identifier) for p in collections)


def file_path_map() -> Mapping[bpy.types.ID, set[str]]:
    """Paths of external files as stored, by datablock. Before 4.4 Blender lists paths without
    owners: owners are found by their ``filepath``, and further paths (of modifiers and particles)
    are assigned to the first object."""
    if TELLS_OWNERS_OF_PATHS:
        return bpy.data.file_path_map()
    owners = chain(
        *(bpy.data.libraries, bpy.data.images, bpy.data.sounds, bpy.data.movieclips),
        *(bpy.data.cache_files, bpy.data.volumes, bpy.data.fonts, bpy.data.texts),
    )
    paths = {id: {id.filepath} for id in owners if id.filepath not in ("", "<builtin>")}
    owned = {bpy.path.abspath(id.filepath, library=id.library) for id in paths}
    for path in bpy.utils.blend_paths(absolute=True, packed=True):
        if path not in owned and bpy.data.objects:
            raw = bpy.path.relpath(path) if bpy.data.filepath else path
            # Paths outside of the .blend's folder are given as absolute paths.
            is_below = raw.startswith("//") and not raw.startswith("//..")
            paths.setdefault(bpy.data.objects[0], set()).add(raw if is_below else path)
    return paths


def node_inputs(modifier: bpy.types.Modifier) -> list[tuple[Callable[[Any], None], Any]]:
    """Pairs (setter, present value) of the inputs of a Geometry Nodes modifier."""
    holder = getattr(getattr(modifier, "properties", None), "inputs", None)
    if holder is None:  # before Blender 5.2
        return [(partial(modifier.__setitem__, key), modifier[key]) for key in modifier.keys()]
    sockets = modifier.node_group.interface.items_tree if modifier.node_group is not None else ()
    names = (getattr(socket, "identifier", "") for socket in sockets)
    inputs = [getattr(holder, name) for name in names if hasattr(holder, name)]
    return [(partial(setattr, i, "value"), i.value) for i in inputs if hasattr(i, "value")]
