# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuator layouts of Unitouch Studio become device configurations of the user's own.

Facts: the "Actuator Layout Guide" of its manual (Actronika, version 1.5.0): ``name``,
``visualReference``, ``views`` with the actuators that each shows, and each actuator's
``projectedViewPosition`` x, y, z, relative to a square. It does not say which way the axes go: here
X is to the right and Y up as the front view shows them, so X is the wearer's left, and Z goes
to the front. Nor does it know a body: positions are fitted to the parts that the reference shows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel
from ...engine.body.parts import PARTS
from ...engine.rendering.actuator_vertices import on_parts
from ...files.json_shapes import PRINTABLE, Anything, Items, Node, Number, Text, loose, strict

MAX_ACTUATORS: Final = 1000

_PARTS: Final[dict[str | None, tuple[str, ...]]] = {
    "Skinetic": ("torso",),
    "Chair": ("torso", "upper_leg"),
    "Full Body": PARTS,
    None: ("torso",),
}
_VIEWS: Final = ("Left", "Front", "Right", "Back", "Top", "Bottom")
_FURTHEST: Final = 1e6
_MARGIN: Final = 0.9  # of the parts' extent: actuators are not at the very ends
_RADIUS_M: Final = 0.03
_AXIS: Final = Number(-_FURTHEST, _FURTHEST)
_INDICES: Final = Items(Number(0, MAX_ACTUATORS - 1, is_whole=True), 0, MAX_ACTUATORS)
_REFERENCE: Final = Text(tuple(each for each in _PARTS if each is not None))
_LAYOUT: Final = strict(
    {
        "actuators": Items(
            loose({"projectedViewPosition": strict(dict.fromkeys("xyz", _AXIS))}),
            1,
            MAX_ACTUATORS,
        ),
        "views": Items(
            strict({"name": Text(_VIEWS)}, {"Indexes": _INDICES, "indexes": _INDICES}), 0, 64
        ),
    },
    {"name": PRINTABLE, "visualReference": Anything(), "version": Anything()},
)


def is_layout(document: Node) -> bool:
    """Test a document for such a layout."""
    return isinstance(document.value, dict) and {"actuators", "views"} <= set(document.value)


def configuration_of(document: Node, device_id: str, model: PerceptualModel) -> dict[str, Any]:
    """A layout as a device configuration, plain data.

    Raises
    ------
    InputError
        The file is not a layout: the message names the place in it.
    """
    top = document.hold(_LAYOUT)
    reference = top.get("visualReference")
    if reference is not None:
        top["visualReference"].hold(_REFERENCE)
    positions = (each["projectedViewPosition"] for each in top.get("actuators"))
    places = np.array([[float(each[axis]) for axis in "xyz"] for each in positions])
    fronts = _fronts(top["views"], places)
    parts = _PARTS[reference]
    centres = _on_skin(places, fronts, parts, model)
    actuators = [
        {
            "id": f"actuator_{k}",
            "type": "actuator",
            "place": {
                "placement": {"parts": list(parts), "centre_m": centre, "radius_m": _RADIUS_M}
            },
        }
        for k, centre in enumerate(centres)
    ]
    name = top.get("name", device_id.replace("_", " "))
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": device_id,
        "name": name,
        "description": (
            f"Imported from the actuator layout {Path(document.file).name[:200]}; places are "
            "fitted to the body, amplitudes and frequencies are guessed."
        ),
        "actuator_types": {
            "actuator": {
                "modality": "vibration",
                "parameters": {
                    "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10},
                    "frequency_hz": {"unit": "Hz", "minimum": 50, "maximum": 400},
                },
                "takes_waveform": True,
            }
        },
        "actuators": actuators,
    }


def _fronts(node: Node, places: F64) -> npt.NDArray[np.bool_]:
    """Mask of the actuators at the front: as views say; else by their depth."""
    depth = places[:, 2]
    found = depth >= 0.5 * (depth.min() + depth.max())
    said = np.zeros(len(places), np.bool_)
    index_of_layout = Number(0, len(places) - 1, is_whole=True)
    for view in node.items():
        name = view.get("name")
        for key in ("Indexes", "indexes"):
            for index in view[key].items() if key in view else ():
                k = index.hold(index_of_layout).value
                if name in ("Front", "Back") and not said[k]:
                    found[k], said[k] = name == "Front", True
    return np.asarray(found)


def _on_skin(
    places: F64, fronts: npt.NDArray[np.bool_], parts: tuple[str, ...], model: PerceptualModel
) -> list[list[float]]:
    """Nearest skin, seen from the front or the back, of places fitted to some parts, (A, 3)."""
    allowed = on_parts(parts, model)
    skin = model.vertices[allowed].astype(np.float64)
    faces_front = model.normals[allowed, 1] < 0.0
    lowest, highest = skin.min(axis=0), skin.max(axis=0)
    wanted = np.ptp(places[:, :2], axis=0)
    there = (highest - lowest)[[0, 2]] * _MARGIN
    scale = min((t / w for t, w in zip(there, wanted, strict=True) if w > 0.0), default=0.0)
    middle = 0.5 * (places[:, :2].min(axis=0) + places[:, :2].max(axis=0))
    fitted = (places[:, :2] - middle) * scale + 0.5 * (lowest + highest)[[0, 2]]
    found = []
    for place, is_front in zip(fitted, fronts, strict=True):
        candidates = skin[faces_front == is_front]
        away = np.linalg.norm(candidates[:, [0, 2]] - place, axis=1)
        found.append([round(float(each), 4) for each in candidates[np.argmin(away)]])
    return found
