# SPDX-License-Identifier: GPL-3.0-or-later
"""Hash of an object's materials, for the detection of edits after a bake."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import bpy

_DEPTH = 5
_IRRELEVANT = frozenset(bpy.types.Node.bl_rna.properties.keys()) - {"mute"}
_MATERIAL_PROPERTIES = ("diffuse_color", "roughness", "metallic")


def hash_of(obj: bpy.types.Object) -> str:
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
    # Groups may contain groups, and may be used several times.
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
