# SPDX-License-Identifier: GPL-3.0-or-later
"""Garage scene of HFX Studio's study, built with the user's operators.

Tasks T1 to T4 follow Danieau et al., VRST 2018, section 4.1, with the paper's times taken as
seconds and frames at 60 frames a second. An avatar walks through the four places.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import pi

import bpy
import numpy as np

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS

from . import props
from .walking import add_walk

FPS = 60
DURATION_S = 15.5
SPEED_M_S = 0.85
START = (-5.0, -2.75, 0.0)
CORNER = (-5.0, 0.0, 0.0)
END = (-5.0 + DURATION_S * SPEED_M_S - 2.75, 0.0, 0.0)

DEVICES = ("forearm_band_left", "back_pad", "pressure_vest", "insoles", "fan_heater")


@dataclass(frozen=True)
class Task:
    """Task of the study, with times in seconds and names of effects."""

    name: str
    title: str
    start_s: float
    end_s: float
    effects: tuple[str, ...]
    telling_s: float  # time of the picture


TASKS = (
    Task("T1", "warm by the fire, on a humming floor", 0.0, 2.0, ("T1 Fire", "T1 Floor"), 0.9),
    Task("T2", "an arrow on the back: turn right", 2.5, 3.0, ("T2 Arrow",), 2.75),
    Task("T3", "wind, and three strikes of lightning", 5.0, 7.0, ("T3 Wind", "T3 Lightning"), 6.05),
    Task("T4", "a heartbeat on the torso", 13.0, 15.0, ("T4 Heartbeat",), 14.05),
)
STRIKES_S = (5.3, 6.0, 6.6)
STRIKE_LENGTH_S = 0.15


def build() -> bpy.types.Scene:
    """Build the scene in a new, empty file; returns the scene at frame 0."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.name = "Garage"
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, round(DURATION_S * FPS) - 1
    props.furnish(scene, fire=(-6.3, -2.2), people=[(END[0] + 1.0, 0.5), (END[0] + 1.2, -0.6)])
    body = _add_walking_avatar()
    _add_fire_and_floor()
    _add_arrow(body)
    _add_wind_and_lightning(body)
    _add_heartbeat(body)
    for name in DEVICES:
        scene.hfx.devices.add().name = name
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    scene.frame_set(0)
    return scene


def frame(time_s: float) -> float:
    """Convert seconds to frames."""
    return time_s * FPS


def _add_walking_avatar() -> bpy.types.Object:
    bpy.ops.hfx.add_avatar()
    body = bpy.context.object
    add_walk(body, (START, CORNER, END), 0, round(frame(DURATION_S)))
    return body


def _add_volume(name: str, modality: str, shape: str, **settings: object) -> bpy.types.Object:
    bpy.ops.hfx.add_volume(modality=modality, shape=shape, name=name, **settings)
    return bpy.context.object


def _add_clip(start_s: float, end_s: float, **settings: object) -> None:
    bpy.ops.hfx.add_clip(start=frame(start_s), duration=end_s - start_s, **settings)


def _add_fire_and_floor() -> None:
    fire = _add_volume("T1 Fire", "temperature", "SPHERE", radius=2.0, location=(-6.3, -2.2, 0.5))
    fire.hfx.temperature = 30.0
    fire.hfx.temperature_reference = "AMBIENT"
    _add_clip(0.0, 2.0, fade_out=0.25)
    floor = _add_volume(
        "T1 Floor", "vibration", "CUBOID", size=(2.0, 2.0, 0.1), location=(-5.0, -2.0, 0.0)
    )
    floor.hfx.frequency = 100.0
    floor.hfx.amplitude = 8.0
    _add_clip(0.0, 2.0)


def _add_painted(name: str, modality: str, body: bpy.types.Object) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = body
    bpy.ops.hfx.add_painted(modality=modality, name=name)
    return bpy.context.object


def _add_arrow(body: bpy.types.Object) -> None:
    arrow = _add_painted("T2 Arrow", "pressure", body)
    arrow.hfx.pressure = 8.0
    bpy.ops.hfx.set_area(area=json.dumps(dict.fromkeys(_arrow_on_the_back(), 1.0)))
    _add_clip(2.5, 3.0, fade_in=0.05, fade_out=0.05)


def _arrow_on_the_back() -> list[int]:
    """Pressure vertices under an arrow toward the wearer's right."""
    model = load_model("hfx-pressure-1")
    x, z = model.vertices[:, 0], model.vertices[:, 2]
    on_the_back = (model.part == PARTS.index("torso")) & (model.normals[:, 1] > 0.3)
    middle = 1.27
    shaft = (np.abs(z - middle) < 0.022) & (x < 0.14) & (x > -0.05)
    # The wearer's right is -X: the arrowhead narrows toward -X.
    head = (x <= -0.04) & (np.abs(z - middle) < 0.075 * (x + 0.15) / 0.11)
    return np.flatnonzero(on_the_back & (shaft | head)).tolist()


def _add_wind_and_lightning(body: bpy.types.Object) -> None:
    # Local Z is the direction of the wind, against the walker. 2 m x 2 m, 3 m high.
    wind = _add_volume(
        "T3 Wind", "wind", "CUBOID", size=(3.0, 2.0, 2.0), location=(-2.65, 0.0, 1.5)
    )
    wind.rotation_euler = (0.0, -pi / 2, 0.0)
    wind.hfx.wind_speed = 7.0
    _add_clip(5.0, 7.0, fade_in=0.3, fade_out=0.3)
    lightning = _add_painted("T3 Lightning", "pressure", body)
    lightning.hfx.pressure = 6.0
    bpy.ops.hfx.fill_part(part="all")
    for strike in STRIKES_S:
        _add_clip(strike, strike + STRIKE_LENGTH_S, fade_out=0.1, name="Strike")
    props.add_lightning([round(frame(strike)) for strike in STRIKES_S])


def _add_heartbeat(body: bpy.types.Object) -> None:
    heart = _add_painted("T4 Heartbeat", "vibration", body)
    heart.hfx.frequency = 60.0
    heart.hfx.amplitude = 10.0
    bpy.ops.hfx.fill_part(part="torso")
    bpy.ops.hfx.add_heartbeat(
        start=frame(13.0), duration=2.0, beats_per_minute=120.0, fade_in=0.5, fade_out=0.5
    )
