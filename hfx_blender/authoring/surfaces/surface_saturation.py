# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects a haptic map that is at full strength nearly everywhere, and suggests what to set.

The usual reason is a Bump node at its default distance of 1 m (until Blender 4.3), or a
Displacement node at its default scale of 1 m: what is seen hardly tells, what is felt does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import bpy

from ...blender.scene_info import metres_of
from . import material_relief

if TYPE_CHECKING:
    from ...engine.texture.haptic_map import HapticMap

MOST: Final = 0.5
"""Share of a map at full strength from which on a warning is given."""

_LIKELY_M: Final = 0.01
"""Upper bound of relief that can be felt by stroking, metres."""

_STATES_HEIGHT: Final = {"BUMP": "Distance", "DISPLACEMENT": "Scale"}


def warning(obj: bpy.types.Object, made: HapticMap) -> str:
    """Warning about an object's map, one sentence; empty if nothing is wrong."""
    share = float((made.intensity >= 1.0).mean())
    if share < MOST:
        return ""
    finding = f"the map is at full strength over {share:.0%} of the surface"
    found = _tallest(obj) if obj.hfx.surface.source == "MATERIAL" else None
    if found is None:
        return f"{finding}: lower its heights, or raise Full Slope"
    height_m, material, node = found
    return (
        f"{finding}: the {node.bl_label} node of material '{material.name}' makes heights of "
        f"{height_m:g} m; set its {_STATES_HEIGHT[node.type]} to the relief's real height, such as "
        "0.001 m, and press Make Maps"
    )


def _tallest(
    obj: bpy.types.Object,
) -> tuple[float, bpy.types.Material, bpy.types.ShaderNode] | None:
    """Find the node that makes the greatest of all heights too high to be stroked."""
    unit = metres_of(bpy.context.scene)
    found = []
    for slot in obj.material_slots:
        tree = slot.material.node_tree if slot.material is not None else None
        for node in material_relief.nodes_of(tree) if tree is not None else ():
            factor = node.inputs.get(_STATES_HEIGHT.get(node.type, ""))
            if factor is None or factor.is_linked or not node.inputs["Height"].is_linked:
                continue
            height_m = abs(factor.default_value) * unit
            if node.type == "BUMP" and not node.inputs["Strength"].is_linked:
                height_m *= node.inputs["Strength"].default_value
            if height_m >= _LIKELY_M:
                found.append((height_m, slot.material, node))
    return max(found, key=lambda each: each[0], default=None)
