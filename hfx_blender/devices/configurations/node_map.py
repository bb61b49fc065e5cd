# SPDX-License-Identifier: GPL-3.0-or-later
"""Node maps of VRChat haptics as device configurations.

Such a map (VRC Haptics' configuration files) lists ``nodes``: a position on a standing avatar in
Unity's axes (Y up, facing +Z, the wearer's left at -X), a ``radius``, the humanoid bone that
carries the node, and the OSC address of its avatar parameter. Positions and radii are metres on an
avatar whose eyes are 1.585 m above the floor; the tools of VRC Haptics scale them by the eye height
of each avatar, and so does this importer.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel, load_model
from ...engine.body.parts import SIDES
from ...engine.rendering.actuator_vertices import on_parts
from ...errors import InputError
from ...files import resources
from ...files.atomic import atomic_file
from ...files.json_shapes import Items, Node, Number, Text, loose, read
from . import unitouch_layout
from .device_shape import ID

MODEL: Final = "hfx-vibration-1"
MAX_NODES: Final = 1000
MAP_EYE_HEIGHT_M: Final = 1.585
"""Height of the eyes of the avatar that node maps are made on, metres above the floor."""
EYE_HEIGHT_M: Final = 1.685
"""Height of the eyes of the perceptual models in rest, metres above the floor."""

_TORSO: Final = ("torso",)
_LIMB: Final = {
    "Shoulder": _TORSO,
    "UpperArm": ("upper_arm",),
    "LowerArm": ("forearm",),
    "Hand": ("hand_dorsum", "hand_palm"),
    "UpperLeg": ("upper_leg",),
    "LowerLeg": ("lower_leg",),
    "Foot": ("foot_dorsum", "foot_sole"),
    "Toes": ("foot_dorsum", "foot_sole"),
}
_MIDDLE: Final = {
    **dict.fromkeys(("Hips", "Spine", "Chest", "UpperChest", "Neck"), _TORSO),
    "Head": ("head",),
}
_AMPLITUDE_M_S2: Final = 10.0
_FREQUENCY_HZ: Final = 150.0
_POSITION: Final = loose(
    dict.fromkeys("xyz", Number(-3.0, 3.0, "m")),
    title="an object with x, y and z",
)
_MAP: Final = loose(
    {
        "nodes": Items(
            loose({}, {"radius": Number(0.0, 1.0, "m"), "node_data": _POSITION}),
            1,
            MAX_NODES,
        )
    },
    title="an object with 'nodes'",
)
_ADDRESS: Final = Text(pattern=r"(?:/[A-Za-z0-9_.\-]+)+", note="an OSC address")


def import_node_map(path: Path, device_id: str) -> Path:
    """Make a configuration of a node map, and keep it with the user's own devices.

    An actuator layout of Unitouch Studio is known by its content and taken as well. Every node
    becomes a motor at the nearest skin of its part of the body, and a channel of OSC
    at its own address. Amplitudes are a guess (10 m/s^2 at 150 Hz): measure your own.

    Raises
    ------
    InputError
        The file is neither, or the name is none or taken.
    OutputError
        It cannot be written.
    """
    if not re.fullmatch(ID.pattern, device_id):
        raise InputError(f"'{device_id[:80]}' is no name for a device; allowed: {ID.note}.")
    made = resources.user_devices() / f"{device_id}.json"
    if made.exists():
        raise InputError(f"{made}: exists already; choose another name.")
    document = read(path)
    if unitouch_layout.is_layout(document):
        content = unitouch_layout.configuration_of(document, device_id, load_model(MODEL))
    else:
        content = configuration_of(document, device_id, load_model(MODEL))
    made.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(made) as file:
        file.write(json.dumps(content, indent=2).encode() + b"\n")
    return made


def configuration_of(document: Node, device_id: str, model: PerceptualModel) -> dict[str, Any]:
    """A node map as a device configuration, plain data.

    Raises
    ------
    InputError
        The file is not a node map: the message names the place in it.
    """
    if isinstance(document.value, dict) and "actuator_types" in document:
        raise InputError(
            f"{document.file}: is a device configuration already, not a node map; copy it to "
            f"{resources.user_devices()}."
        )
    actuators, addresses = [], []
    scale = EYE_HEIGHT_M / MAP_EYE_HEIGHT_M
    for k, node in enumerate(document.hold(_MAP)["nodes"].items(), 1):
        parts, side = _carried_by(node)
        radius_m = node.number("radius", 0.02) * scale
        position = _position(node["node_data"] if "node_data" in node else node) * scale
        centre = _on_skin(position, parts, side, model)
        placement = {"parts": list(parts), "centre_m": centre, "radius_m": round(radius_m, 4)}
        if side is not None:
            placement["side"] = side
        actuators.append({"id": f"node_{k}", "type": "motor", "place": {"placement": placement}})
        address = f"/avatar/parameters/hfx_{k}"
        if node.get("address") not in (None, ""):
            address = node["address"].hold(_ADDRESS).value
        addresses.append(address)
    if len(set(addresses)) != len(addresses):
        raise InputError(f"{document.file}: two nodes have the same address.")
    source = Path(document.file).name
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": device_id,
        "name": device_id.replace("_", " "),
        "description": f"Imported from the node map {source}; amplitudes are guessed.",
        "actuator_types": {
            "motor": {
                "modality": "vibration",
                "parameters": {
                    "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": _AMPLITUDE_M_S2},
                    "frequency_hz": {"unit": "Hz", "fixed": _FREQUENCY_HZ},
                },
                "update_interval_ms": 20,
            }
        },
        "actuators": actuators,
        "output": {"encoder": {"kind": "osc", "addresses": addresses, "send": "messages"}},
    }


def _carried_by(node: Node) -> tuple[tuple[str, ...], str | None]:
    """Parts of the body and the side of the bone that carries a node."""
    bone = node.get("target_bone")
    if isinstance(bone, str):
        if bone in _MIDDLE:
            return _MIDDLE[bone], None
        for side in ("Left", "Right"):
            parts = _LIMB.get(bone.removeprefix(side)) if bone.startswith(side) else None
            if parts is not None:
                return parts, None if parts == _TORSO else side.lower()
    known = ", ".join([*_MIDDLE, *(f"Left{each}" for each in _LIMB)])
    Node(bone, node.file, (node.place, "target_bone")).fail(f"{known} (and Right)")


def _position(node: Node) -> F64:
    node.hold(_POSITION)
    x, y, z = (node.number(axis) for axis in "xyz")
    return np.array([-x, -z, y])


def _on_skin(
    place: F64,
    parts: tuple[str, ...],
    side: str | None,
    model: PerceptualModel,
) -> list[float]:
    allowed = on_parts(parts, model)
    if side is not None:
        allowed &= model.side == SIDES.index(side)
    candidates = model.vertices[allowed].astype(np.float64)
    nearest = candidates[np.argmin(np.linalg.norm(candidates - place, axis=1))]
    return [round(float(each), 4) for each in nearest]
