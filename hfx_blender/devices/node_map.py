# SPDX-License-Identifier: GPL-3.0-or-later
"""Node maps of VRChat haptics as device configurations.

Such a map (VRC Haptics' configuration files) lists ``nodes``: a position on a standing avatar in
Unity's axes (Y up, facing +Z, the wearer's left at -X), a ``radius``, the humanoid bone that
carries the node, and the OSC address of its avatar parameter.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import resources
from ..atomic_files import atomic_file
from ..engine.body.model import PerceptualModel, load_model
from ..engine.body.parts import SIDES
from ..engine.rendering.actuator_vertices import on_parts
from ..errors import InputError
from . import unitouch_layout
from .layout_reader import ID_DESCRIBED, ID_PATTERN
from .strict_json import Node, read

MODEL: Final = "hfx-vibration-1"
MAX_NODES: Final = 1000

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


def import_node_map(
    path: Path,
    device_id: str,
    folder: Path | None = None,
) -> Path:
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
    if not re.fullmatch(ID_PATTERN, device_id):
        raise InputError(f"'{device_id[:80]}' is no name for a device; allowed: {ID_DESCRIBED}.")
    made = (folder or resources.user_devices()) / f"{device_id}.json"
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
    top, path = document.value, Path(document.file)
    nodes = top.get("nodes") if isinstance(top, dict) else None
    if isinstance(top, dict) and "actuator_types" in top:
        raise InputError(
            f"{path}: is a device configuration already, not a node map; copy it to "
            f"{resources.user_devices()}."
        )
    if not isinstance(nodes, list) or not 0 < len(nodes) <= MAX_NODES:
        raise InputError(f"{path}: 'nodes' is not a list of 1 to {MAX_NODES} nodes.")
    actuators, addresses = [], []
    for k, node in enumerate(nodes):
        if not isinstance(node, dict):
            raise InputError(f"{path}: nodes[{k}] is not an object.")
        parts, side = _carried_by(node.get("target_bone"), f"{path}: nodes[{k}]")
        centre = _on_skin(_position(node, f"{path}: nodes[{k}]"), parts, side, model)
        radius_m = _number(node.get("radius", 0.02), f"{path}: nodes[{k}].radius", 0.0, 1.0)
        placement = {"parts": list(parts), "centre_m": centre, "radius_m": round(radius_m, 4)}
        if side is not None:
            placement["side"] = side
        actuators.append(
            {"id": f"node_{k + 1}", "type": "motor", "place": {"placement": placement}}
        )
        addresses.append(_address(node.get("address"), k, f"{path}: nodes[{k}]"))
    if len(set(addresses)) != len(addresses):
        raise InputError(f"{path}: two nodes have the same address.")
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": device_id,
        "name": device_id.replace("_", " "),
        "description": f"Imported from the node map {path.name}; amplitudes are guessed.",
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


def _carried_by(bone: Any, where: str) -> tuple[tuple[str, ...], str | None]:
    if isinstance(bone, str):
        if bone in _MIDDLE:
            return _MIDDLE[bone], None
        for side in ("Left", "Right"):
            parts = _LIMB.get(bone.removeprefix(side)) if bone.startswith(side) else None
            if parts is not None:
                return parts, None if parts == _TORSO else side.lower()
    known = ", ".join([*_MIDDLE, *(f"Left{each}" for each in _LIMB)])
    raise InputError(f"{where}.target_bone is {str(bone)[:60]!r}, known are: {known} (and Right).")


def _position(node: dict[str, Any], where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    place = node.get("node_data", node)
    if not isinstance(place, dict):
        raise InputError(f"{where}.node_data is not an object.")
    x, y, z = (_number(place.get(axis), f"{where}.{axis}", -3.0, 3.0) for axis in "xyz")
    return np.array([-x, -z, y])


def _number(value: Any, where: str, lowest: float, highest: float) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and lowest <= value <= highest):  # not a number is in no range
        raise InputError(
            f"{where} is {str(value)[:60]!r}, allowed is a number from {lowest:g} to {highest:g}."
        )
    return float(value)


def _on_skin(
    place: np.ndarray[Any, np.dtype[np.float64]],
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


def _address(address: Any, k: int, where: str) -> str:
    found = f"/avatar/parameters/hfx_{k + 1}" if address in (None, "") else address
    if not isinstance(found, str) or not re.fullmatch(r"(?:/[A-Za-z0-9_.\-]+)+", found):
        raise InputError(f"{where}.address is {str(address)[:60]!r}, which is no OSC address.")
    return found
