# SPDX-License-Identifier: GPL-3.0-or-later
"""Updates of haptic maps after edits of settings and materials, which a hash of nodes detects.

Maps of edited settings are made again after a short delay. A material needs a new bake, which
blocks Blender: automatic bakes happen only while the maps are displayed, and if the last bake
was quick. Otherwise the maps are marked as outdated.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Iterator

import bpy

from ...blender.events import call_soon, redraw, remove_timers
from ...errors import HfxError

DELAY_S = 0.3
BAKE_DELAY_S = 0.8
QUICK_S = 1.5
"""Longest duration of automatic bakes, seconds."""

_SHOWN_S = 2.0
_PAINTED = "painted"  # no hash of a material

_DEPTH = 5
_IRRELEVANT = frozenset(bpy.types.Node.bl_rna.properties.keys()) - {"mute"}
_MATERIAL_PROPERTIES = ("diffuse_color", "roughness", "metallic")

_log = logging.getLogger(__name__)
_waiting: set[str] = set()  # names of objects
shown_s: dict[str, float] = {}  # time of an object's last display
painted_images: set[str] = set()  # images with possibly changed pixels
last_edit_s: list[float] = [0.0]


def request(obj: bpy.types.Object) -> None:
    """Schedule an update of a surface's maps in 0.3 s, unless they were never made."""
    from . import surfaces

    if not surfaces.is_surface(obj) or not obj.hfx.surface.made_of:
        return  # never baked
    _waiting.add(obj.name)
    remove_timers(make_waiting)
    call_soon(make_waiting, DELAY_S)


def on_shown(obj: bpy.types.Object) -> None:
    """Store the time of display; schedule a bake of outdated maps if the last bake was quick."""
    shown_s[obj.name] = time.monotonic()
    if obj.hfx.surface.is_outdated and may_bake(obj):
        call_soon(bake_outdated, BAKE_DELAY_S)


def may_bake(obj: bpy.types.Object) -> bool:
    """Test that maps were displayed within 2 s, and the last bake took at most 1.5 s."""
    from . import surfaces

    is_shown = time.monotonic() - shown_s.get(obj.name, -_SHOWN_S) < _SHOWN_S
    return is_shown and surfaces.bake_s.get(obj.name, QUICK_S + 1.0) <= QUICK_S


@bpy.app.handlers.persistent
def on_update(_scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Handler: schedule a bake 0.8 s after the last edit of a material, node tree or image; nothing
    in background mode.
    """
    if bpy.app.background or not is_material_update(graph):
        return
    # Each edit delays the bake, so that a slider is dragged without a bake per step.
    note_painted(graph)
    last_edit_s[0] = time.monotonic()
    call_soon(bake_outdated, BAKE_DELAY_S)


def is_material_update(graph: bpy.types.Depsgraph) -> bool:
    """Test for an update of a material, node tree or image."""
    return any(graph.id_type_updated(kind) for kind in ("MATERIAL", "NODETREE", "IMAGE"))


def note_painted(graph: bpy.types.Depsgraph) -> None:
    """Add the full names of updated images to :data:`painted_images`."""
    if graph.id_type_updated("IMAGE"):
        painted_images.update(
            update.id.name_full
            for update in graph.updates
            if isinstance(update.id, bpy.types.Image)
        )


def check() -> list[bpy.types.Object]:
    """Return the surfaces, baked before, with an edited material or painted image; sets
    ``is_outdated`` of material surfaces, and forgets the painted images.
    """
    from . import surfaces

    painted = {image for image in bpy.data.images if image.name_full in painted_images}
    painted_images.clear()
    outdated_surfaces = []
    for obj in surfaces.surfaces_of(bpy.context.scene):
        settings = obj.hfx.surface
        if not settings.made_of:
            continue
        if settings.source == "IMAGE" and painted & {settings.image, settings.roughness_image}:
            outdated_surfaces.append(obj)
        if settings.source != "MATERIAL":
            continue
        if painted and painted & images_of(obj):
            settings.material_state = _PAINTED
        is_outdated = has_edited_material(obj)
        # Assigning an equal value would cause another update.
        if is_outdated != settings.is_outdated:
            settings.is_outdated = is_outdated
        if is_outdated:
            outdated_surfaces.append(obj)
    return outdated_surfaces


def has_edited_material(obj: bpy.types.Object) -> bool:
    """Test that the hash of the materials differs from that at baking; False without a hash."""
    baked_state = obj.hfx.surface.material_state
    return baked_state != "" and baked_state != material_hash(obj)


def bake_outdated() -> float | None:
    """Timer: make outdated maps of images, and of materials displayed within 2 s whose last bake
    took at most 1.5 s; redraw. Returns seconds to wait within 0.8 s of an edit and in playback,
    else None.
    """
    since = time.monotonic() - last_edit_s[0]
    if since < BAKE_DELAY_S:  # still being edited
        return BAKE_DELAY_S - since
    if any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows):
        return BAKE_DELAY_S
    for obj in check():
        if obj.hfx.surface.source == "IMAGE" or may_bake(obj):
            _make_one(obj, remake=True)
    redraw("VIEW_3D", "IMAGE_EDITOR")
    return None


def make_waiting() -> None:
    """Timer: update the maps of scheduled objects, and redraw; faults are shown in the panel."""
    from . import surfaces

    waiting = sorted(_waiting)
    _waiting.clear()
    for name in waiting:
        obj = bpy.data.objects.get(name)
        if obj is not None and surfaces.is_surface(obj):
            _make_one(obj, remake=False)
    redraw("VIEW_3D", "IMAGE_EDITOR")


def _make_one(obj: bpy.types.Object, *, remake: bool) -> None:
    from . import surfaces

    try:
        surfaces.make_maps(obj, remake=remake)
    except HfxError:
        pass  # shown in the panel
    except Exception as error:  # errors in a timer are not shown
        _log.exception("surface '%s'", obj.name)
        obj.hfx.surface.note = f"{type(error).__name__}: {error}"
        obj.hfx.surface.is_faulty = True


def material_hash(obj: bpy.types.Object) -> str:
    """Hash of an object's materials, with all nodes, values, links and images.

    Node positions and pixels of images (see :func:`images_of`) do not count.
    """
    digest = hashlib.sha1(usedforsecurity=False)
    for slot in obj.material_slots:
        material, plain = slot.material, None
        if material is not None:
            values = [_plain(getattr(material, name), 0) for name in _MATERIAL_PROPERTIES]
            trees = [] if material.node_tree is None else _all_trees([material.node_tree])
            plain = [values, [_tree(part) for part in trees]]
        digest.update(repr(plain).encode())
    return digest.hexdigest()


def images_of(obj: bpy.types.Object) -> set[bpy.types.Image]:
    """Images used by the nodes of an object's materials."""
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    trees = [material.node_tree for material in materials if material.node_tree]
    nodes = (node for tree in _all_trees(trees) for node in tree.nodes)
    return {node.image for node in nodes if getattr(node, "image", None) is not None}


def _all_trees(trees: list[bpy.types.NodeTree]) -> Iterator[bpy.types.NodeTree]:
    visited: set[bpy.types.NodeTree] = set()
    # Groups may contain groups, and may be used several times.
    while trees:
        tree = trees.pop()
        if tree in visited:
            continue
        visited.add(tree)
        yield tree
        groups = (getattr(node, "node_tree", None) for node in tree.nodes)
        trees += [group for group in groups if group is not None]


def _tree(tree: bpy.types.NodeTree) -> object:
    """Nodes and links of a tree, nested groups not included, as plain data in a stable order."""
    # Links refer to nodes by position, and are sorted: Blender stores links in order of creation.
    numbers = {node.name: k for k, node in enumerate(tree.nodes)}
    links = sorted(
        (
            numbers[link.from_node.name],
            link.from_socket.identifier,
            numbers[link.to_node.name],
            link.to_socket.identifier,
            link.is_muted,
        )
        for link in tree.links
    )
    nodes = []
    for node in tree.nodes:
        values = [
            (socket.identifier, _plain(getattr(socket, "default_value", None), 0))
            for socket in (*node.inputs, *node.outputs)
        ]
        # Properties that all nodes share, such as the location, do not change a bake.
        nodes.append([node.bl_idname, node.mute, values, _struct(node, _DEPTH, _IRRELEVANT)])
    return [nodes, links]


def _struct(struct: bpy.types.bpy_struct, depth: int, without: frozenset[str]) -> object:
    """Pairs of name and plain value of a structure's properties, except those named ``without``."""
    return [
        (prop.identifier, _plain(getattr(struct, prop.identifier), depth - 1))
        for prop in struct.bl_rna.properties
        if prop.identifier != "rna_type" and prop.identifier not in without
    ]


def _plain(value: object, depth: int) -> object:
    """Value as plain data: datablocks by name, structures as lists, None below ``depth`` levels."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, bpy.types.Image):
        return [value.name_full, value.filepath, value.colorspace_settings.name, *value.size]
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.bpy_struct):
        return _struct(value, depth, frozenset()) if depth > 0 else None
    if isinstance(value, set):
        return sorted(value)
    if isinstance(value, bpy.types.bpy_prop_collection) and depth <= 0:
        return None
    try:
        return [_plain(item, depth) for item in value]  # type: ignore[attr-defined]
    except TypeError:
        return None


def register() -> None:
    """Watch for edits."""
    bpy.app.handlers.depsgraph_update_post.append(on_update)


def unregister() -> None:
    """Remove the handler and all scheduled updates."""
    from . import surfaces

    bpy.app.handlers.depsgraph_update_post.remove(on_update)
    for state in (_waiting, surfaces.bake_s, shown_s, painted_images):
        state.clear()
