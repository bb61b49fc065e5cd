# SPDX-License-Identifier: GPL-3.0-or-later
"""Updates of haptic maps after edits of settings and materials.

Maps of edited settings are made again after a short delay. A material needs a new bake, which
blocks Blender: it is baked automatically only while its maps are displayed, and if the last bake
was quick. Otherwise the maps are marked as outdated. A hash of a material's nodes detects its
edits.
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
bake_s: dict[str, float] = {}  # duration of an object's last bake
shown_s: dict[str, float] = {}  # time of an object's last display
painted_images: set[str] = set()  # images with possibly changed pixels
last_edit_s: list[float] = [0.0]


def request(obj: bpy.types.Object) -> None:
    """Schedule an update of an object's maps; the first bake is not automatic."""
    from . import surfaces

    if not surfaces.is_surface(obj) or not obj.hfx.surface.made_of:
        return  # never baked
    _waiting.add(obj.name)
    remove_timers(make_waiting)
    call_soon(make_waiting, DELAY_S)


def on_shown(obj: bpy.types.Object) -> None:
    """Note the display of an object's maps, and schedule a bake if they are outdated."""
    shown_s[obj.name] = time.monotonic()
    if obj.hfx.surface.is_outdated and may_bake(obj):
        call_soon(bake_outdated, BAKE_DELAY_S)


def may_bake(obj: bpy.types.Object) -> bool:
    """Test for displayed maps with a quick last bake, for an automatic bake."""
    is_shown = time.monotonic() - shown_s.get(obj.name, -_SHOWN_S) < _SHOWN_S
    return is_shown and bake_s.get(obj.name, QUICK_S + 1.0) <= QUICK_S


@bpy.app.handlers.persistent
def on_update(_scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """React to an edit. Called at each update of the scene, so it must be quick."""
    if bpy.app.background or not is_material_update(graph):
        return
    note_painted(graph)
    last_edit_s[0] = time.monotonic()
    call_soon(bake_outdated, BAKE_DELAY_S)


def is_material_update(graph: bpy.types.Depsgraph) -> bool:
    """Test for an update of a material, node tree or image."""
    return any(graph.id_type_updated(kind) for kind in ("MATERIAL", "NODETREE", "IMAGE"))


def note_painted(graph: bpy.types.Depsgraph) -> None:
    """Store the names of updated images."""
    if graph.id_type_updated("IMAGE"):
        painted_images.update(
            update.id.name_full
            for update in graph.updates
            if isinstance(update.id, bpy.types.Image)
        )


def check() -> list[bpy.types.Object]:
    """Mark and return the surfaces with an edited material or image."""
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
        is_outdated = surfaces.has_edited_material(obj)
        if is_outdated != settings.is_outdated:
            settings.is_outdated = is_outdated
        if is_outdated:
            outdated_surfaces.append(obj)
    return outdated_surfaces


def bake_outdated() -> float | None:
    """Timer: bake outdated surfaces that allow it; returns seconds to wait during edits and
    playback.
    """
    since = time.monotonic() - last_edit_s[0]
    if since < BAKE_DELAY_S:  # still being edited
        return BAKE_DELAY_S - since
    if any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows):
        return BAKE_DELAY_S
    for obj in check():
        if obj.hfx.surface.source == "IMAGE" or may_bake(obj):
            _make_one(obj, anew=True)
    redraw("VIEW_3D", "IMAGE_EDITOR")
    return None


def make_waiting() -> None:
    """Timer: make the maps of all scheduled objects."""
    from . import surfaces

    waiting = sorted(_waiting)
    _waiting.clear()
    for name in waiting:
        obj = bpy.data.objects.get(name)
        if obj is not None and surfaces.is_surface(obj):
            _make_one(obj, anew=False)
    redraw("VIEW_3D", "IMAGE_EDITOR")


def _make_one(obj: bpy.types.Object, *, anew: bool) -> None:
    from . import surfaces

    try:
        surfaces.make_maps(obj, anew=anew)
    except HfxError:
        pass  # shown in the panel
    except Exception as error:  # errors in a timer are not shown
        _log.exception("surface '%s'", obj.name)
        obj.hfx.surface.note = f"{type(error).__name__}: {error}"
        obj.hfx.surface.is_faulty = True


def register() -> None:
    """Watch for edits."""
    bpy.app.handlers.depsgraph_update_post.append(on_update)


def unregister() -> None:
    """Remove the handler and all scheduled updates."""
    bpy.app.handlers.depsgraph_update_post.remove(on_update)
    for state in (_waiting, bake_s, shown_s, painted_images):
        state.clear()


def material_hash(obj: bpy.types.Object) -> str:
    """Hash of an object's materials, with all nodes, values, links and images.

    Node positions and pixels of images (see :func:`images_of`) do not count.
    """
    digest = hashlib.sha1(usedforsecurity=False)
    for slot in obj.material_slots:
        digest.update(repr(_material(slot.material)).encode())
    return digest.hexdigest()


def images_of(obj: bpy.types.Object) -> set[bpy.types.Image]:
    """Images used by the nodes of an object's materials."""
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    trees = [material.node_tree for material in materials if material.node_tree]
    nodes = (node for tree in _all_trees(trees) for node in tree.nodes)
    return {node.image for node in nodes if getattr(node, "image", None) is not None}


def _all_trees(trees: list[bpy.types.NodeTree]) -> Iterator[bpy.types.NodeTree]:
    visited: set[bpy.types.NodeTree] = set()
    while trees:
        tree = trees.pop()
        if tree in visited:
            continue
        visited.add(tree)
        yield tree
        groups = (getattr(node, "node_tree", None) for node in tree.nodes)
        trees += [group for group in groups if group is not None]


def _material(material: bpy.types.Material | None) -> object:
    if material is None:
        return None
    plain = [_plain(getattr(material, name), 0) for name in _MATERIAL_PROPERTIES]
    tree = material.node_tree
    return [plain, [] if tree is None else [_tree(part) for part in _all_trees([tree])]]


def _tree(tree: bpy.types.NodeTree) -> object:
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
    return [[_node(node) for node in tree.nodes], links]


def _node(node: bpy.types.Node) -> object:
    values = [
        (socket.identifier, _plain(getattr(socket, "default_value", None), 0))
        for socket in (*node.inputs, *node.outputs)
    ]
    return [node.bl_idname, node.mute, values, _struct(node, _DEPTH, _IRRELEVANT)]


def _struct(struct: bpy.types.bpy_struct, depth: int, without: frozenset[str]) -> object:
    return [
        (prop.identifier, _plain(getattr(struct, prop.identifier), depth - 1))
        for prop in struct.bl_rna.properties
        if prop.identifier != "rna_type" and prop.identifier not in without
    ]


def _plain(value: object, depth: int) -> object:
    """A property's value as numbers, strings and nested lists; None below ``depth`` levels."""
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
