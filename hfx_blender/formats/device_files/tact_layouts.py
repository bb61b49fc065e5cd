# SPDX-License-Identifier: GPL-3.0-or-later
"""Places of bHaptics' motors, and their assignment to a device's actuators."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...engine.body.model import load_model
from ...engine.rendering.device_config import BhapticsEncoder, BodyPlace, DeviceConfig, VertexPlace

MAX_DOTS: Final = 20


@dataclass(frozen=True)
class Layout:
    """Kind of suit, with the same dots at each position."""

    type: str
    name: str
    positions: tuple[str, ...]
    dots: tuple[tuple[float, float], ...]  # x from the left, y from the top, 0..1


@dataclass(frozen=True)
class Motor:
    """Motor of a kind of suit."""

    kind: str  # key of LAYOUTS
    position: str
    index: int


def _grid(columns: int, rows: int) -> tuple[tuple[float, float], ...]:
    """Places (x, y), 0..1, of a grid of dots, row by row from the top left; y 0.5 of one row."""
    return tuple(
        (round(column / (columns - 1), 3), round(row / (rows - 1), 3) if rows > 1 else 0.5)
        for row in range(rows)
        for column in range(columns)
    )


LAYOUTS: Final = {
    "Vest": Layout("Vest", "Tactot", ("VestFront", "VestBack"), _grid(4, 5)),
    "Sleeves": Layout("Tactosy2", "Tactosy2", ("ForearmL", "ForearmR"), _grid(3, 2)),
    "Head": Layout("Head", "Tactal", ("Head",), _grid(6, 1)),
    "Hands": Layout("Hand", "Hand", ("HandL", "HandR"), _grid(3, 1)),
    "Feet": Layout("Foot", "Foot", ("FootL", "FootR"), _grid(3, 1)),
    "Gloves": Layout("Glove", "TactGlove", ("GloveL", "GloveR"), _grid(6, 1)),
}
_KIND_OF: Final = {position: kind for kind, each in LAYOUTS.items() for position in each.positions}

# Motors of the vest in rest pose; the wearer's left is +X. Dot 0 of front and back is at the left
# shoulder (two independent maps of the vest, and the shipped configuration).
_VEST_X_M: Final = (0.105, 0.035, -0.035, -0.105)
_VEST_Z_M: Final = (1.40, 1.31, 1.22, 1.13, 1.04)


def motors_of(device: DeviceConfig) -> dict[str, Motor]:
    """Motor for each vibration actuator, by actuator id.

    A device of the bHaptics Player has the dots of its configuration, as in live playback.
    Otherwise an actuator on the torso has the nearest of 4 columns (x) and 5 rows (z) of the vest,
    front for y < 0; actuators on a forearm, left for x > 0, have the sleeve's motors in the order
    of the configuration. An actuator placed by vertices counts as on the torso, at the mean of its
    first set; x is negated for a mirrored device. Actuators elsewhere, or beyond the six of a
    sleeve, are missing.
    """
    encoders = [(part, output.encoder) for part in device.parts for output in part.outputs]
    served = [(part, how) for part, how in encoders if isinstance(how, BhapticsEncoder)]
    if served:
        return {
            actuator.id: Motor(_KIND_OF[position], position, index)
            for part, how in served
            for actuator, (position, index) in zip(
                part.actuators, how.worn_dots(is_mirrored=device.is_mirrored), strict=True
            )
            if actuator.type.modality == "vibration"
        }
    motors = {}
    taken = {"ForearmL": 0, "ForearmR": 0}
    for actuator in device.actuators:
        if actuator.type.modality != "vibration":
            continue
        parts = actuator.place.parts if isinstance(actuator.place, BodyPlace) else ("torso",)
        # Centre in rest space, for vertices the mean of the first set; none in the room.
        if isinstance(actuator.place, BodyPlace):
            x, y, z = actuator.place.centre_m
        elif isinstance(actuator.place, VertexPlace):
            first = actuator.place.sets[0]
            vertices = load_model(first.model_id).vertices[list(first.vertices)]
            x, y, z = vertices.mean(axis=0).tolist()
        else:
            continue
        x = -x if device.is_mirrored else x
        # Sleeves have no map of their motors.
        if parts == ("forearm",):
            position = "ForearmL" if x > 0.0 else "ForearmR"
            if taken[position] < len(LAYOUTS["Sleeves"].dots):
                motors[actuator.id] = Motor("Sleeves", position, taken[position])
                taken[position] += 1
        elif parts == ("torso",):
            column = int(np.argmin(np.abs(np.array(_VEST_X_M) - x)))
            row = int(np.argmin(np.abs(np.array(_VEST_Z_M) - z)))
            position = "VestFront" if y < 0.0 else "VestBack"
            motors[actuator.id] = Motor("Vest", position, 4 * row + column)
    return motors


def why_nothing(device: DeviceConfig) -> str:
    """Reason for a device without any bHaptics motor, a sentence without capital; else empty."""
    if motors_of(device):
        return ""
    return (
        f"device '{device.id}' has no vibration actuators on the torso or a forearm, where "
        "bHaptics' vest and sleeves are"
    )
