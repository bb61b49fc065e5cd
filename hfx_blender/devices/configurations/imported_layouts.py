# SPDX-License-Identifier: GPL-3.0-or-later
"""Import of actuator layouts of other programs as device configurations of the user.

*Node maps* of VRC Haptics list ``nodes``: a position on a standing avatar in Unity's axes (Y up,
facing +Z, the wearer's left at -X), a ``radius``, the humanoid bone of the node, and the OSC
address of its avatar parameter. Positions and radii are metres on an avatar whose eyes are 1.585 m
above the floor. VRC Haptics scales them by the eye height of each avatar, and so does this import.

*Layouts of Unitouch Studio* (Actronika, manual 1.5.0, "Actuator Layout Guide") have ``name``,
``visualReference``, ``views`` with the indices of their actuators, and ``projectedViewPosition``
x, y, z of each actuator, relative to a square. The manual does not define the axes: X is taken to
the right and Y up in the front view, so that X is the wearer's left, and Z to the front. Positions
are fitted to the body parts of the reference.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64, Bool
from ...engine.body.model import PerceptualModel, load_model
from ...engine.body.parts import PARTS, SIDES
from ...engine.rendering.actuator_vertices import on_parts
from ...errors import InputError
from ...files import resources
from ...files.atomic import atomic_file
from ...files.json_shapes import PRINTABLE, Anything, Items, Node, Number, Text, loose, read, strict
from .device_shape import ID, MAX_ACTUATORS

MODEL: Final = "hfx-vibration-1"
MAP_EYE_HEIGHT_M: Final = 1.585  # eye height of the avatar of node maps, metres above the floor
EYE_HEIGHT_M: Final = 1.685  # eye height of the perceptual models in rest, metres above the floor
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
_POSITION: Final = loose(
    dict.fromkeys("xyz", Number(-3.0, 3.0, "m")), title="an object with x, y and z"
)
_MAP: Final = loose(
    {
        "nodes": Items(
            loose({}, {"radius": Number(0.0, 1.0, "m"), "node_data": _POSITION}), 1, MAX_ACTUATORS
        )
    },
    title="an object with 'nodes'",
)
_ADDRESS: Final = Text(pattern=r"(?:/[A-Za-z0-9_.\-]+)+", note="an OSC address")

# Parts of the body for each ``visualReference`` of Unitouch Studio; None: without a reference.
_REFERENCES: Final[dict[str | None, tuple[str, ...]]] = {
    "Skinetic": _TORSO,
    "Chair": ("torso", "upper_leg"),
    "Full Body": PARTS,
    None: _TORSO,
}

_VIEWS: Final = ("Left", "Front", "Right", "Back", "Top", "Bottom")
_MARGIN: Final = 0.9  # share of the parts' extent: actuators are not at the ends
_RADIUS_M: Final = 0.03
_AXIS: Final = Number(-1e6, 1e6)
_INDICES: Final = Items(Number(0, MAX_ACTUATORS - 1, is_whole=True), 0, MAX_ACTUATORS)
_REFERENCE: Final = Text(tuple(name for name in _REFERENCES if name is not None))
_LAYOUT: Final = strict(
    {
        "actuators": Items(
            loose({"projectedViewPosition": strict(dict.fromkeys("xyz", _AXIS))}), 1, MAX_ACTUATORS
        ),
        "views": Items(
            strict({"name": Text(_VIEWS)}, {"Indexes": _INDICES, "indexes": _INDICES}), 0, 64
        ),
    },
    {"name": PRINTABLE, "visualReference": Anything(), "version": Anything()},
)


def import_layout(path: Path, device_id: str) -> Path:
    """Convert a node map or a layout of Unitouch Studio to a configuration of the user; return the
    written file.

    Nodes become motors on the nearest skin of their part of the body, with OSC channels at their
    own addresses. Amplitudes are guessed (10 m/s^2) and should be measured.

    Raises InputError: the file is neither, or the id is not allowed or in use.
    Raises OutputError: the configuration cannot be written.
    """
    if not re.fullmatch(ID.pattern, device_id):
        raise InputError(f"'{device_id[:80]}' is no name for a device; allowed: {ID.note}.")
    target = resources.user_devices() / f"{device_id}.json"
    if target.exists():
        raise InputError(f"{target}: exists already; choose another name.")
    content = configuration_of(read(path), device_id, load_model(MODEL))
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(target) as file:
        file.write(json.dumps(content, indent=2).encode() + b"\n")
    return target


def configuration_of(document: Node, device_id: str, model: PerceptualModel) -> dict[str, Any]:
    """Device configuration, as JSON data, of a node map or a layout of Unitouch Studio.

    Raises InputError: the document is neither; the message names the place of the fault.
    """
    if isinstance(document.value, dict) and {"actuators", "views"} <= set(document.value):
        return _of_unitouch(document, device_id, model)
    return _of_node_map(document, device_id, model)


def _of_node_map(document: Node, device_id: str, model: PerceptualModel) -> dict[str, Any]:
    if isinstance(document.value, dict) and "actuator_types" in document:
        raise InputError(
            f"{document.file}: is a device configuration already, not a node map; copy it to "
            f"{resources.user_devices()}."
        )
    actuators, addresses = [], []
    scale = EYE_HEIGHT_M / MAP_EYE_HEIGHT_M
    # Positions are scaled to the model's height, and projected to the skin of the bone's part.
    for k, node in enumerate(document.hold(_MAP)["nodes"].items(), 1):
        parts, side = _bone_parts(node)
        radius_m = node.number("radius", 0.02) * scale
        place = (node["node_data"] if "node_data" in node else node).hold(_POSITION)
        # From Unity (X right, Y up, Z front) to X left, Y back, Z up.
        x, y, z = (place.number(axis) for axis in "xyz")
        position = np.array([-x, -z, y]) * scale
        allowed = on_parts(parts, model)
        if side is not None:
            allowed &= model.side == SIDES.index(side)
        centre = _nearest(model.vertices[allowed].astype(np.float64), position, [0, 1, 2])
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
    motor = {
        "modality": "vibration",
        "parameters": {
            "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10.0},
            "frequency_hz": {"unit": "Hz", "fixed": 150.0},
        },
        "update_interval_ms": 20,
    }
    source = Path(document.file).name
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": device_id,
        "name": device_id.replace("_", " "),
        "description": f"Imported from the node map {source}; amplitudes are guessed.",
        "actuator_types": {"motor": motor},
        "actuators": actuators,
        "output": {"encoder": {"kind": "osc", "addresses": addresses, "send": "messages"}},
    }


def _bone_parts(node: Node) -> tuple[tuple[str, ...], str | None]:
    """Body parts of a node's ``target_bone``, and "left", "right" or None (middle and shoulders).
    Raises InputError: the bone is unknown or no text."""
    bone = node.get("target_bone")
    if isinstance(bone, str):
        if bone in _MIDDLE:
            return _MIDDLE[bone], None
        for side in ("Left", "Right"):
            parts = _LIMB.get(bone.removeprefix(side)) if bone.startswith(side) else None
            if parts is not None:
                return parts, None if parts == _TORSO else side.lower()
    known = ", ".join([*_MIDDLE, *(f"Left{limb}" for limb in _LIMB)])
    Node(bone, node.file, (node.place, "target_bone")).fail(f"{known} (and Right)")


def _nearest(skin: F64, position: F64, axes: Sequence[int]) -> list[float]:
    """Vertex of ``skin`` (V, 3) nearest to ``position`` (len(axes),) in these axes only; x, y, z in
    metres, rounded to 0.1 mm."""
    distance = np.linalg.norm(skin[:, axes] - position, axis=1)
    return [round(float(value), 4) for value in skin[np.argmin(distance)]]


def _of_unitouch(document: Node, device_id: str, model: PerceptualModel) -> dict[str, Any]:
    top = document.hold(_LAYOUT)
    reference = top.get("visualReference")
    if reference is not None:
        top["visualReference"].hold(_REFERENCE)
    positions = (item["projectedViewPosition"] for item in top.get("actuators"))
    places = np.array([[float(position[axis]) for axis in "xyz"] for position in positions])
    parts = _REFERENCES[reference]
    centres = _on_skin(places, _front_mask(top["views"], places), parts, model)
    actuators = []
    for k, centre in enumerate(centres):
        placement = {"parts": list(parts), "centre_m": centre, "radius_m": _RADIUS_M}
        place = {"placement": placement}
        actuators.append({"id": f"actuator_{k}", "type": "actuator", "place": place})
    vibrator = {
        "modality": "vibration",
        "parameters": {
            "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10},
            "frequency_hz": {"unit": "Hz", "minimum": 50, "maximum": 400},
        },
        "takes_waveform": True,
    }
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": device_id,
        "name": top.get("name", device_id.replace("_", " ")),
        "description": (
            f"Imported from the actuator layout {Path(document.file).name[:200]}; places are "
            "fitted to the body, amplitudes and frequencies are guessed."
        ),
        "actuator_types": {"actuator": vibrator},
        "actuators": actuators,
    }


def _front_mask(node: Node, places: F64) -> Bool:
    """Mask (A,) of actuators at the front: by the first of the views Front and Back with their
    index, else by Z of ``places`` (A, 3), at or above the middle of its range. Raises InputError: a
    view has an index of no actuator."""
    depth = places[:, 2]
    # Actuators in neither view: the middle of the depths divides front and back.
    is_front = depth >= 0.5 * (depth.min() + depth.max())
    is_viewed = np.zeros(len(places), np.bool_)
    index_of_layout = Number(0, len(places) - 1, is_whole=True)
    for view in node.items():
        name = view.get("name")
        for key in ("Indexes", "indexes"):
            for index in view[key].items() if key in view else ():
                k = index.hold(index_of_layout).value
                if name in ("Front", "Back") and not is_viewed[k]:
                    is_front[k], is_viewed[k] = name == "Front", True
    return np.asarray(is_front)


def _on_skin(
    places: F64, is_front: Bool, parts: tuple[str, ...], model: PerceptualModel
) -> list[list[float]]:
    """Vertices (A, 3) of the perceptual model, metres, for ``places`` (A, 3) of a layout. X and Y
    are scaled alike and centred, to fill 0.9 of the width or height of ``parts``; the nearest
    vertex with its normal to the front or back is chosen, by X and Z alone."""
    allowed = on_parts(parts, model)
    skin = model.vertices[allowed].astype(np.float64)
    faces_front = model.normals[allowed, 1] < 0.0
    lowest, highest = skin.min(axis=0), skin.max(axis=0)
    # One scale for X and Y, so that the layout keeps its proportions.
    extent = np.ptp(places[:, :2], axis=0)
    limit = (highest - lowest)[[0, 2]] * _MARGIN
    scale = min((t / w for t, w in zip(limit, extent, strict=True) if w > 0.0), default=0.0)
    middle = 0.5 * (places[:, :2].min(axis=0) + places[:, :2].max(axis=0))
    fitted = (places[:, :2] - middle) * scale + 0.5 * (lowest + highest)[[0, 2]]
    return [
        _nearest(skin[faces_front == front], position, [0, 2])
        for position, front in zip(fitted, is_front, strict=True)
    ]
