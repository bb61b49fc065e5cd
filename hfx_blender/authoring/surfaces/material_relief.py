# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes of materials: relief and colour for bakes, and a hash that detects edits.

Displacement and Bump nodes are read as heights. Further sources of a bent normal (normal maps,
groups, mixed shaders) are baked as normals. Nodes are added and rewired, so materials must be
copies. A map at full strength nearly everywhere is traced to the node.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import bpy

from ...blender.scene_info import metres_of, nodes_of
from ...errors import InputError

if TYPE_CHECKING:
    from ...engine.texture.haptic_map import HapticMap

Value = bpy.types.NodeSocket | float | None  # an output socket or a constant; None means 0
_BENDS = {"BUMP", "NORMAL_MAP"}

_DEPTH = 5  # of structures in a hash
_IRRELEVANT = frozenset(bpy.types.Node.bl_rna.properties.keys()) - {"mute"}
_MATERIAL_PROPERTIES = ("diffuse_color", "roughness", "metallic")

MOST_SATURATED: Final = 0.5  # share of a map at full strength that causes a warning
_LIKELY_M: Final = 0.01  # largest plausible height of a relief for stroking, metres
_HEIGHT_INPUTS: Final = {"BUMP": "Distance", "DISPLACEMENT": "Scale"}


@dataclass(frozen=True)
class ReliefNodes:
    """Nodes of a material's relief."""

    height: Value = None  # outwards, Blender units in the world
    normal: bpy.types.NodeSocket | None = None  # further bent normal; None if missing
    is_surface_bent: bool = False  # bent by an unknown combination of shaders


def prepare(material: bpy.types.Material, name: str) -> None:
    """Give a material without nodes a shader with the colour and roughness. ``name`` is the
    material's name for messages. Raises InputError: the material has no output for Cycles."""
    if material.node_tree is None:  # before 5.0 a material can be without nodes
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
    """Add an image node as the only selected and active node: the target of Cycles' bakes."""
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for selected in tree.nodes:
        selected.select = False
    node.select = True
    tree.nodes.active = node


def relief_of(material: bpy.types.Material) -> ReliefNodes:
    """Relief nodes of a material: sum of displacement and chained Bump nodes, and another source of
    normals. Nodes are added; the displacement is unlinked and missing in later bakes."""
    tree = material.node_tree
    displaced = tree.get_output_node("CYCLES").inputs["Displacement"]
    heights: list[Value] = []
    if displaced.is_linked:
        # Displacement vectors count as height along the normal only.
        along = tree.nodes.new("ShaderNodeVectorMath")
        along.operation = "DOT_PRODUCT"
        tree.links.new(displaced.links[0].from_socket, along.inputs[0])
        normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
        tree.links.new(normal, along.inputs[1])
        heights.append(along.outputs["Value"])
        tree.links.remove(displaced.links[0])
    shader = _shader(material)
    if shader is None:
        is_bent = any(node.type in _BENDS for node in nodes_of(tree))
        return ReliefNodes(_sum(tree, heights), is_surface_bent=is_bent)
    source = _source(shader.inputs["Normal"]) if "Normal" in shader.inputs else None
    # Chained Bump nodes add their heights; another source of normals ends the chain.
    while source is not None and source.node.type == "BUMP":
        heights.append(_bump_height(tree, source.node))
        source = _source(source.node.inputs["Normal"])
    return ReliefNodes(_sum(tree, heights), source)


def colour_of(material: bpy.types.Material) -> Value:
    """Socket of the base colour, of a new node for a constant; None without a shader's colour."""
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


def colour_image_of(material: bpy.types.Material) -> bpy.types.Image | None:
    """Only image upstream of a material's base colour; None for none or several."""
    shader = _shader(material)
    if shader is None:
        return None
    sockets = _colour_inputs(shader)[:1]
    images, visited = set(), set()
    # Upstream through all nodes. An image ends its branch: its coordinates are no colour.
    while sockets:
        for link in sockets.pop().links:
            node = link.from_node
            if node in visited:
                continue
            visited.add(node)
            if node.type == "TEX_IMAGE" and node.image is not None:
                images.add(node.image)
            else:
                sockets.extend(node.inputs)
    return images.pop() if len(images) == 1 else None


def emission(material: bpy.types.Material, value: Value) -> Callable[[], None]:
    """Rewire a material to emit a socket, constant or 0 (None); return the undo function."""
    # Emission passes values on unlit, so a bake reads exact values.
    node = material.node_tree.nodes.new("ShaderNodeEmission")
    if isinstance(value, bpy.types.NodeSocket):
        material.node_tree.links.new(value, node.inputs["Color"])
    else:
        node.inputs["Color"].default_value = [value or 0.0] * 3 + [1.0]
    return _as_surface(material, node)


def diffuse(material: bpy.types.Material, relief: ReliefNodes) -> Callable[[], None]:
    """Rewire a material to a diffuse shader with the relief's normal; return the undo function.
    Unchanged, with an undo without effect, if unknown shaders bend the surface."""
    if relief.is_surface_bent:
        return lambda: None
    node = material.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
    if relief.normal is not None:
        material.node_tree.links.new(relief.normal, node.inputs["Normal"])
    return _as_surface(material, node)


def _as_surface(material: bpy.types.Material, node: bpy.types.Node) -> Callable[[], None]:
    """Link a shader node to the Cycles output; return a function that removes the node and restores
    the earlier link."""
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
    """Label of the first input besides UV map ``uv_map``, as other coordinates, attributes or
    projections; "" if UVs alone matter."""
    for material in materials:
        for node in nodes_of(material.node_tree):
            dependency = _dependency(node, uv_map)
            if dependency:
                return dependency
    return ""


def _dependency(node: bpy.types.Node, uv_map: str) -> str:
    """Label of a node's input besides UV map ``uv_map``, as "Generated coordinates"; else ""."""
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
        # Textures without linked coordinates take the mesh's Generated coordinates.
        return "" if vector.is_linked else f"{node.bl_label} on Generated coordinates"
    return ""


def saturation_warning(obj: bpy.types.Object, haptic_map: HapticMap) -> str:
    """Warning about a map at full strength on half of the area or more; empty without a fault. The
    usual cause is a Bump node with its default distance of 1 m (until Blender 4.3), or a
    Displacement node with its default scale of 1 m, which look plausible when rendered."""
    share = float((haptic_map.intensity >= 1.0).mean())
    if share < MOST_SATURATED:
        return ""
    finding = f"the map is at full strength over {share:.0%} of the surface"
    tallest = _tallest(obj) if obj.hfx.surface.source == "MATERIAL" else None
    if tallest is None:
        return f"{finding}: lower its heights, or raise Full Slope"
    height_m, material, node = tallest
    return (
        f"{finding}: the {node.bl_label} node of material '{material.name}' has heights of "
        f"{height_m:g} m; set its {_HEIGHT_INPUTS[node.type]} to the relief's real height, such "
        "as 0.001 m, and press Make Maps"
    )


def _tallest(
    obj: bpy.types.Object,
) -> tuple[float, bpy.types.Material, bpy.types.ShaderNode] | None:
    """Height (m), material and node of the tallest Bump or Displacement of 1 cm or more, by
    constant distance, scale and strength; None without any."""
    unit = metres_of(bpy.context.scene)
    candidates = []
    for slot in obj.material_slots:
        tree = slot.material.node_tree if slot.material is not None else None
        for node in nodes_of(tree):
            factor = node.inputs.get(_HEIGHT_INPUTS.get(node.type, ""))
            if factor is None or factor.is_linked or not node.inputs["Height"].is_linked:
                continue
            height_m = abs(factor.default_value) * unit
            # The height of a Bump node is Strength times Distance.
            if node.type == "BUMP" and not node.inputs["Strength"].is_linked:
                height_m *= node.inputs["Strength"].default_value
            if height_m >= _LIKELY_M:
                candidates.append((height_m, slot.material, node))
    return max(candidates, key=lambda candidate: candidate[0], default=None)


def _source(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """Output socket linked to an input, skipping reroutes; None if unlinked."""
    # Reroutes pass a value on unchanged.
    while socket.is_linked:
        output = socket.links[0].from_socket
        if output.node.type != "REROUTE":
            return output
        socket = output.node.inputs[0]
    return None


def _shader(material: bpy.types.Material) -> bpy.types.Node | None:
    """Shader node at the Cycles output; None for a mix, sum, group or unlinked output."""
    source = _source(material.node_tree.get_output_node("CYCLES").inputs["Surface"])
    if source is None or source.node.type in ("MIX_SHADER", "ADD_SHADER", "GROUP"):
        return None
    return source.node


def _bump_height(tree: bpy.types.NodeTree, bump: bpy.types.Node) -> Value:
    """Height of a Bump node, in added nodes: Height * Strength * Distance, negative if inverted;
    None without a linked Height."""
    height = bump.inputs["Height"]
    if not height.is_linked:
        return None
    product = _math(tree, "MULTIPLY", height.links[0].from_socket, -1.0 if bump.invert else 1.0)
    for name in ("Strength", "Distance"):
        factor = bump.inputs[name]
        operand = factor.links[0].from_socket if factor.is_linked else factor.default_value
        product = _math(tree, "MULTIPLY", product, operand)
    return product


def _sum(tree: bpy.types.NodeTree, values: list[Value]) -> Value:
    """Sum of values by new Math nodes, without the Nones; None if there are no others."""
    total: Value = None
    for value in values:
        if value is not None:
            total = value if total is None else _math(tree, "ADD", total, value)
    return total


def _math(tree: bpy.types.NodeTree, operation: str, a: Value, b: Value) -> bpy.types.NodeSocket:
    """Output of a new Math node with two operands."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (a, b), strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value or 0.0
    return node.outputs[0]


def material_hash(obj: bpy.types.Object) -> str:
    """Hash of an object's materials, with all nodes, values, links and images. Node positions and
    pixels of images (see :func:`images_of`) do not count."""
    digest = hashlib.sha1(usedforsecurity=False)
    for slot in obj.material_slots:
        material, plain = slot.material, None
        if material is not None:
            values = [_plain(getattr(material, name), 0) for name in _MATERIAL_PROPERTIES]
            root = material.node_tree
            plain = [values, [] if root is None else [_tree(tree) for tree in _all_trees(root)]]
        digest.update(repr(plain).encode())
    return digest.hexdigest()


def images_of(obj: bpy.types.Object) -> set[bpy.types.Image]:
    """Images used by the nodes of an object's materials."""
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    nodes = (node for material in materials for node in nodes_of(material.node_tree))
    return {node.image for node in nodes if getattr(node, "image", None) is not None}


def _all_trees(tree: bpy.types.NodeTree) -> Iterator[bpy.types.NodeTree]:
    """Yield a tree and all nested groups, each once; hashes stored in files depend on the order."""
    trees, visited = [tree], set()
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
    if isinstance(value, set):  # sets have no order, which the hash must not depend on
        return sorted(value)
    if isinstance(value, bpy.types.bpy_prop_collection) and depth <= 0:
        return None
    try:
        return [_plain(item, depth) for item in value]  # type: ignore[attr-defined]
    except TypeError:
        return None
