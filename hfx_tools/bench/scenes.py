# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes for measurements: the demo, a crowd of volumes, fast passes, and small objects on skin.

Each is built in an empty file with the user's operators, and is equal at every call.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np

from hfx_blender.blender import compat
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS, SIDES

from ..demo import garage
from ..demo.walking import add_walk

MODALITIES = ("vibration", "pressure", "temperature", "wind")
_Vector = tuple[float, float, float]


def names() -> tuple[str, ...]:
    """Names of all scenes."""
    return tuple(_BUILDERS)


def about(name: str) -> str:
    """Description of a scene, one line."""
    return _BUILDERS[name][1]


def short_frames(name: str) -> tuple[int, int]:
    """First and last frame of a short range with many contacts."""
    return _BUILDERS[name][2]


def builder(name: str) -> Callable[[], Any]:
    """Builder of a scene; a call opens an empty file first."""
    return _BUILDERS[name][0]


def build(name: str, path: Path) -> Path:
    """Build a scene with the demo's devices and save a .blend; returns the path."""
    _BUILDERS[name][0]()
    for device in garage.DEVICES:
        if device not in bpy.context.scene.hfx.devices:
            bpy.context.scene.hfx.devices.add().name = device
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    return path


def empty_scene(name: str, fps: int, seconds: float) -> Any:
    """Open a new file with the avatar as the only, active object; returns the scene."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    scene.render.fps = fps
    scene.frame_start, scene.frame_end = 0, round(fps * seconds) - 1
    bpy.ops.hfx.add_avatar()
    return scene


def volume(modality: str, shape: str, place: _Vector, **settings: Any) -> Any:
    """Add a volume at a world-space location; returns the object."""
    bpy.ops.hfx.add_volume(
        modality=modality, shape=shape, location=place, name=f"{modality} {shape}", **settings
    )
    return bpy.context.object


def move(obj: Any, keys: list[tuple[float, _Vector]]) -> None:
    """Key an object's location, from (frame, location) pairs."""
    action = bpy.data.actions.new(obj.name)
    obj.animation_data_create().action = action
    for axis in range(3):
        curve = compat.new_fcurve(obj, action, "location", axis)
        compat.set_keys(curve, [(frame, position[axis]) for frame, position in keys])


def _build_crowded() -> None:
    """Build 300 volumes of all kinds in a hall, and a walk right through them."""
    scene = empty_scene("Crowded", 30, 4.0)
    add_walk(bpy.context.object, [(x, 0.0, 0.0) for x in (-2.0, 2.0)], 0, scene.frame_end)
    rng = np.random.default_rng(1)
    shapes = ("CUBOID", "SPHERE", "CYLINDER", "CAPSULE")
    for k in range(300):
        reach = (2.5, 0.6) if k % 3 == 1 else (6.0, 4.0)  # every third is close to the walk
        x, y, z = rng.uniform((-reach[0], -reach[1], 0.0), (*reach, 2.0)).tolist()
        size = float(rng.uniform(0.05, 0.5))
        obj = volume(
            MODALITIES[k % 4],
            shapes[k // 4 % 4],
            (x, y, z),
            radius=size / 2,
            height=1.5 * size,
            size=(size, size / 2, size),
        )
        obj.rotation_euler = rng.uniform(0.0, 2 * pi, 3).tolist()
        if k % 3 == 0:
            drift = rng.normal(0.0, 0.5, 3)
            end = (x + float(drift[0]), y + float(drift[1]), z + float(drift[2]))
            move(obj, [(0, (x, y, z)), (scene.frame_end, end)])


def _build_fast() -> None:
    """Build balls, bars and walls of a millimetre, flying through a standing person."""
    scene = empty_scene("Fast", 24, 4.0)
    rng = np.random.default_rng(2)
    speeds = (2.0, 5.0, 10.0, 20.0, 50.0)
    for k in range(20):
        speed = speeds[k % len(speeds)]
        angle = 2 * pi * float(rng.random())
        velocity = np.array([np.cos(angle), np.sin(angle), 0.0]) * speed
        middle = np.array([0.0, 0.0, float(rng.uniform(0.9, 1.5))])
        frame = 4.0 + 4.5 * k  # passes the middle of the body
        reach = 0.2  # seconds before and after
        kind = k % 3
        shape, settings = (
            ("SPHERE", {"radius": 0.05}),
            ("CUBOID", {"size": (0.001, 1.5, 1.5)}),
            ("CAPSULE", {"radius": 0.01, "height": 0.6}),
        )[kind]
        obj = volume(MODALITIES[k % 3], shape, (0.0, 0.0, 0.0), **settings)
        obj.rotation_euler = (0.0, 0.0, angle)
        frames = reach * scene.render.fps
        start, end = middle - reach * velocity, middle + reach * velocity
        move(obj, [(frame - frames, tuple(start)), (frame + frames, tuple(end))])


def _build_fine() -> None:
    """Build coins, pins, blades and pearls, creeping over hands, arms, face and feet."""
    scene = empty_scene("Fine", 24, 4.0)
    rng = np.random.default_rng(3)
    parts = ("hand_palm", "fingers", "forearm", "head", "foot_sole")
    places = [(part, side) for part in parts for side in ("left", "right")]
    kinds: tuple[tuple[str, dict[str, Any]], ...] = (
        ("CYLINDER", {"radius": 0.0116, "height": 0.0023}),  # a coin
        ("CAPSULE", {"radius": 0.0005, "height": 0.03}),  # a pin
        ("CUBOID", {"size": (0.06, 0.0005, 0.02)}),  # a blade
        ("SPHERE", {"radius": 0.004}),  # a pearl
    )
    model = load_model("hfx-vibration-1")
    for k in range(40):
        part, side = places[k % len(places)]
        chosen = np.flatnonzero(
            (model.part == PARTS.index(part)) & (model.side == SIDES.index(side))
        )
        vertex = int(rng.choice(chosen))
        position = model.vertices[vertex].astype(np.float64)
        along = np.cross(model.normals[vertex], rng.normal(size=3))
        along *= 0.03 / np.linalg.norm(along)
        shape, settings = kinds[k % len(kinds)]
        obj = volume(MODALITIES[k % 3], shape, (0.0, 0.0, 0.0), **settings)
        obj.rotation_euler = rng.uniform(0.0, 2 * pi, 3).tolist()
        ends = [tuple((position - along).tolist()), tuple((position + along).tolist())]
        move(obj, [(0, ends[0]), (scene.frame_end, ends[1])])


_BUILDERS: Final[dict[str, tuple[Callable[[], Any], str, tuple[int, int]]]] = {
    "demo": (
        garage.build,
        "the garage: a walk through four places, painted effects and volumes",
        (40, 45),
    ),
    "crowded": (
        _build_crowded,
        "300 volumes of all kinds in a hall, and a walk right through them",
        (60, 62),
    ),
    "fast": (
        _build_fast,
        "20 balls, bars and 1 mm walls at 2 to 50 m/s through somebody who stands",
        (0, 9),
    ),
    "fine": (
        _build_fine,
        "40 coins, pins, blades and pearls that creep over hands, arms, face and feet",
        (40, 43),
    ),
}
