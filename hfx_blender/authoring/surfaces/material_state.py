# SPDX-License-Identifier: GPL-3.0-or-later
"""Fingerprint of an object's materials: a short text that changes with edits that may be felt."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import bpy

bake_s: dict[str, float] = {}
"""Duration of the last bake of an object's materials, seconds, by its name."""

_DEPTH = 5
_OF_NO_MATTER = frozenset(bpy.types.Node.bl_rna.properties.keys()) - {"mute"}
_OF_A_MATERIAL = ("diffuse_color", "roughness", "metallic")


def state_of(obj: bpy.types.Object) -> str:
    """Fingerprint of an object's materials: changes with any node, value, link or image.

    Where nodes are drawn does not count, nor do the pixels of an image (see :func:`images_of`).
    """
    digest = hashlib.sha1(usedforsecurity=False)
    for slot in obj.material_slots:
        digest.update(repr(_material(slot.material)).encode())
    return digest.hexdigest()


def images_of(obj: bpy.types.Object) -> set[bpy.types.Image]:
    """Images that the object's materials read."""
    materials = [slot.material for slot in obj.material_slots]
    trees = [each.node_tree for each in materials if each is not None and each.node_tree]
    nodes = (node for tree in _all_trees(trees) for node in tree.nodes)
    return {node.image for node in nodes if getattr(node, "image", None) is not None}


def _all_trees(trees: list[bpy.types.NodeTree]) -> Iterator[bpy.types.NodeTree]:
    known: set[bpy.types.NodeTree] = set()
    while trees:
        tree = trees.pop()
        if tree in known:
            continue
        known.add(tree)
        yield tree
        groups = (getattr(node, "node_tree", None) for node in tree.nodes)
        trees += [group for group in groups if group is not None]


def _material(material: bpy.types.Material | None) -> object:
    if material is None:
        return None
    plain = [_plain(getattr(material, name), 0) for name in _OF_A_MATERIAL]
    tree = material.node_tree
    return [plain, [] if tree is None else [_tree(each) for each in _all_trees([tree])]]


def _tree(tree: bpy.types.NodeTree) -> object:
    place = {node.name: k for k, node in enumerate(tree.nodes)}
    links = sorted(
        (
            place[link.from_node.name],
            link.from_socket.identifier,
            place[link.to_node.name],
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
    return [node.bl_idname, node.mute, values, _struct(node, _DEPTH, _OF_NO_MATTER)]


def _struct(struct: bpy.types.bpy_struct, depth: int, without: frozenset[str]) -> object:
    names = [p.identifier for p in struct.bl_rna.properties]
    return [
        (name, _plain(getattr(struct, name), depth - 1))
        for name in names
        if name != "rna_type" and name not in without
    ]


def _plain(value: object, depth: int) -> object:
    """A property's value as numbers, texts and lists of them."""
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
    if isinstance(value, bpy.types.bpy_prop_collection):
        return [_plain(each, depth) for each in value] if depth > 0 else None
    try:
        return [_plain(each, depth) for each in value]  # type: ignore[attr-defined]
    except TypeError:
        return None
