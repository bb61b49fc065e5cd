# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief and colour that a material's nodes define.

Displacement and bump are heights, read as they are. Whatever else bends the shading normal (a
normal map, a group, a mix of shaders) is left to be baked as a normal. It works on copies of
materials only: nodes are added and rewired.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import bpy

from ...errors import InputError

Value = bpy.types.NodeSocket | float | None
"""An output socket, or a constant; None is 0."""

_BENDS = {"BUMP", "NORMAL_MAP"}


@dataclass(frozen=True)
class Relief:
    """Sources of a material's relief."""

    height: Value = None  # Blender's units of the world, outwards
    normal: bpy.types.NodeSocket | None = None  # a bent normal, besides the height
    is_surface_bent: bool = False  # only the normal of the whole surface shows it

    @property
    def has_normal(self) -> bool:
        return self.normal is not None or self.is_surface_bent


def prepare(material: bpy.types.Material, name: str) -> None:
    """See to it that a material has nodes with an output; ``name`` is for messages.

    Raises
    ------
    InputError
        It has none that Cycles renders.
    """
    if material.node_tree is None:  # before 5.0 a material may be without nodes
        colour, roughness = tuple(material.diffuse_color), material.roughness
        material.use_nodes = True
        shader = _shader(material)
        if shader is not None:
            shader.inputs["Base Color"].default_value = colour
            shader.inputs["Roughness"].default_value = roughness
    if material.node_tree.get_output_node("CYCLES") is None:
        raise InputError(
            f"Material '{name}' has no Material Output for Cycles: it cannot be baked."
        )


def set_target(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Set the image that Cycles bakes a material into."""
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for other in tree.nodes:
        other.select = False
    node.select = True
    tree.nodes.active = node


def relief_of(material: bpy.types.Material) -> Relief:
    """Relief of a material; unlinks its displacement, so that no bake is bent by it."""
    tree = material.node_tree
    displaced = tree.get_output_node("CYCLES").inputs["Displacement"]
    heights: list[Value] = []
    if displaced.is_linked:
        heights.append(_along_normal(tree, displaced.links[0].from_socket))
        tree.links.remove(displaced.links[0])
    shader = _shader(material)
    if shader is None:
        is_bent = any(node.type in _BENDS for node in nodes_of(tree))
        return Relief(_sum(tree, heights), is_surface_bent=is_bent)
    source = _source(shader.inputs["Normal"]) if "Normal" in shader.inputs else None
    while source is not None and source.node.type == "BUMP":
        heights.append(_bump_height(tree, source.node))
        source = _source(source.node.inputs["Normal"])
    return Relief(_sum(tree, heights), source)


def colour_of(material: bpy.types.Material) -> Value:
    """The base colour of a material's surface, as far as it is that of one shader."""
    shader = _shader(material)
    inputs = [] if shader is None else _colour_inputs(shader)
    if not inputs:
        return None
    source = _source(inputs[0])
    if source is not None:
        return source
    node = material.node_tree.nodes.new("ShaderNodeRGB")
    node.outputs[0].default_value = inputs[0].default_value
    return node.outputs[0]


def _colour_inputs(shader: bpy.types.Node) -> list[bpy.types.NodeSocket]:
    return [shader.inputs[name] for name in ("Base Color", "Color") if name in shader.inputs]


def colour_picture_of(material: bpy.types.Material) -> bpy.types.Image | None:
    """Image behind the base colour of a material's surface, if there is just one; adds nothing."""
    shader = _shader(material)
    if shader is None:
        return None
    waiting = _colour_inputs(shader)[:1]
    found, seen = set(), set()
    while waiting:
        for link in waiting.pop().links:
            node = link.from_node
            if node in seen:
                continue
            seen.add(node)
            if node.type == "TEX_IMAGE" and node.image is not None:
                found.add(node.image)
            else:
                waiting.extend(node.inputs)
    return found.pop() if len(found) == 1 else None


def emission(material: bpy.types.Material, value: Value) -> Callable[[], None]:
    """Make a material emit a value; returns the function that restores it."""
    node = material.node_tree.nodes.new("ShaderNodeEmission")
    if isinstance(value, bpy.types.NodeSocket):
        material.node_tree.links.new(value, node.inputs["Color"])
    else:
        node.inputs["Color"].default_value = [value or 0.0] * 3 + [1.0]
    return _as_surface(material, node)


def matt(material: bpy.types.Material, relief: Relief) -> Callable[[], None]:
    """Make a material matt, bent by a relief's normal only; returns the function that
    restores it.
    """
    if relief.is_surface_bent:
        return lambda: None
    node = material.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
    if relief.normal is not None:
        material.node_tree.links.new(relief.normal, node.inputs["Normal"])
    return _as_surface(material, node)


def _as_surface(material: bpy.types.Material, node: bpy.types.Node) -> Callable[[], None]:
    tree = material.node_tree
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    before = surface.links[0].from_socket if surface.is_linked else None
    tree.links.new(node.outputs[0], surface)

    def undo() -> None:
        tree.nodes.remove(node)
        if before is not None:
            tree.links.new(before, surface)

    return undo


def depends_on(materials: Sequence[bpy.types.Material], uv_map: str) -> str:
    """Find what materials depend on besides one UV map; empty if nothing."""
    for material in materials:
        for node in nodes_of(material.node_tree):
            found = _stranger(node, uv_map)
            if found:
                return found
    return ""


def _stranger(node: bpy.types.Node, uv_map: str) -> str:
    if node.type == "TEX_COORD":
        used = next((s.name for s in node.outputs if s.is_linked and s.name != "UV"), "")
        return f"{used} coordinates" if used else ""
    if node.type in ("NEW_GEOMETRY", "OBJECT_INFO", "ATTRIBUTE", "VERTEX_COLOR"):
        return node.bl_label if any(s.is_linked for s in node.outputs) else ""
    if node.type == "UVMAP" and node.uv_map not in ("", uv_map):
        return f"UV map '{node.uv_map}'"
    if node.type == "TEX_IMAGE" and node.projection != "FLAT":
        return f"{node.projection.lower()} projection"
    vector = node.inputs.get("Vector")
    if node.type.startswith("TEX_") and node.type != "TEX_IMAGE" and vector is not None:
        # Textures without coordinates take the mesh's Generated ones.
        return "" if vector.is_linked else f"{node.bl_label} on Generated coordinates"
    return ""


def nodes_of(
    tree: bpy.types.NodeTree, seen: frozenset[str] = frozenset()
) -> Iterator[bpy.types.Node]:
    """Nodes of a tree and of its groups."""
    for node in tree.nodes:
        yield node
        group = getattr(node, "node_tree", None)
        if group is not None and group.name_full not in seen:
            yield from nodes_of(group, seen | {group.name_full})


def _source(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """Socket linked to an input, past reroutes."""
    while socket.is_linked:
        found = socket.links[0].from_socket
        if found.node.type != "REROUTE":
            return found
        socket = found.node.inputs[0]
    return None


def _shader(material: bpy.types.Material) -> bpy.types.Node | None:
    """Shader that is the whole surface; None if it is a mix, a group or nothing."""
    source = _source(material.node_tree.get_output_node("CYCLES").inputs["Surface"])
    if source is None or source.node.type in ("MIX_SHADER", "ADD_SHADER", "GROUP"):
        return None
    return source.node


def _along_normal(tree: bpy.types.NodeTree, vector: bpy.types.NodeSocket) -> Value:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "DOT_PRODUCT"
    tree.links.new(vector, node.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"], node.inputs[1])
    return node.outputs["Value"]


def _bump_height(tree: bpy.types.NodeTree, bump: bpy.types.Node) -> Value:
    """Height that a bump node states: its strength scales the slope, and so the height."""
    height = bump.inputs["Height"]
    if not height.is_linked:
        return None
    product = _math(tree, "MULTIPLY", height.links[0].from_socket, -1.0 if bump.invert else 1.0)
    for name in ("Strength", "Distance"):
        factor = bump.inputs[name]
        linked = factor.links[0].from_socket if factor.is_linked else factor.default_value
        product = _math(tree, "MULTIPLY", product, linked)
    return product


def _sum(tree: bpy.types.NodeTree, values: list[Value]) -> Value:
    total: Value = None
    for value in values:
        if value is not None:
            total = value if total is None else _math(tree, "ADD", total, value)
    return total


def _math(tree: bpy.types.NodeTree, operation: str, one: Value, two: Value) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (one, two), strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value or 0.0
    return node.outputs[0]
