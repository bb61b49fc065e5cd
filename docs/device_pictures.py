# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the shipped devices: actuators on the body, seen from the front and the back."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection
from PIL import Image

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.rendering.actuator_vertices import vertices_of
from hfx_blender.engine.rendering.device_config import BodyPlace, DeviceConfig, RoomPlace

_COLOURS = {
    "vibration": "#d62728",
    "pressure": "#2ca02c",
    "temperature": "#1f77b4",
    "wind": "#7f7f7f",
}
_VIEWS = (("front", 1.0), ("back", -1.0))
_MARGIN_M = 0.12


def draw(name: str, path: Path) -> None:
    """Draw a device, given by the name of its file without suffix, as a PNG."""
    device = load_device(name)
    avatar = load_avatar()
    places = _places(device)
    low, high = _frame(avatar.vertices.astype(np.float64), places, device)
    size = high - low
    # About square, as the panel in Blender is: wide views stand one above the other.
    if size[0] > size[1]:
        shape, wide, tall = (2, 1), 3.6, 2 * 3.6 * size[1] / size[0] + 0.4
    else:
        shape, wide, tall = (1, 2), 2 * 2.6 * size[0] / size[1] + 0.4, 2.8
    figure, axes = plt.subplots(*shape, figsize=(wide, tall), dpi=110)
    for (title, facing), panel in zip(_VIEWS, axes, strict=True):
        _draw_body(panel, avatar, facing)
        for actuator, point in zip(device.actuators, places, strict=True):
            colour = _COLOURS[actuator.type.modality]
            if isinstance(actuator.place, RoomPlace):
                continue
            is_seen = _frontward(point, avatar) * facing > 0.0
            panel.plot(
                facing * point[0],
                point[2],
                "o",
                markersize=5.0,
                color=colour if is_seen else "none",
                markeredgecolor=colour,
                alpha=1.0 if is_seen else 0.35,
            )
        panel.set_xlim(*sorted((facing * low[0], facing * high[0])))
        panel.set_ylim(low[1], high[1])
        panel.set_aspect("equal")
        panel.axis("off")
        panel.set_title(title, fontsize=7, color="#666666")
    standing = [a.id for a in device.actuators if isinstance(a.place, RoomPlace)]
    if standing:
        figure.text(0.5, 0.02, "in the room: " + ", ".join(standing), ha="center", fontsize=7)
    drawn = io.BytesIO()
    figure.savefig(drawn, bbox_inches="tight")
    plt.close(figure)
    # Few colours, in steps of 5 of 255: the extension's zip has all of these pictures.
    stepped = Image.open(drawn).convert("RGB").point(lambda value: round(value / 5) * 5)
    stepped.quantize(256, dither=Image.Dither.NONE).save(path, "PNG", optimize=True)


def _places(device: DeviceConfig) -> list[np.ndarray]:
    """Rest-pose points (3,) of the actuators, metres; zeros for an actuator in the room."""
    points = []
    for actuator in device.actuators:
        placement = actuator.place
        if isinstance(placement, BodyPlace):
            points.append(np.array(placement.centre_m))
        elif isinstance(placement, RoomPlace):
            points.append(np.zeros(3))
        else:
            model = load_model(placement.sets[0].model_id)
            points.append(model.vertices[vertices_of(placement, model)].mean(axis=0))
    return points


def _frame(
    vertices: np.ndarray, places: list[np.ndarray], device: DeviceConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (x, z) of the drawing, metres, around the worn actuators.

    The whole body is framed if no actuator is worn.
    """
    worn = [
        p
        for p, a in zip(places, device.actuators, strict=True)
        if not isinstance(a.place, RoomPlace)
    ]
    shown = np.array(worn or vertices)[:, [0, 2]]
    low, high = shown.min(axis=0) - _MARGIN_M, shown.max(axis=0) + _MARGIN_M
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 0.22)
    return middle - half, middle + half


def _frontward(place: np.ndarray, avatar: object) -> float:
    """Frontward component of the nearest skin's normal: above 0 in front, below 0 at the back."""
    vertices = avatar.vertices.astype(np.float64)
    near = np.argsort(np.linalg.norm(vertices - place, axis=1))[:40]
    is_near = np.isin(avatar.faces, near).any(axis=1)
    corners = vertices[avatar.faces[is_near][:, :3]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return -float(normals.sum(axis=0)[1])


def _draw_body(panel: object, avatar: object, facing: float) -> None:
    vertices = avatar.vertices.astype(np.float64)
    corners = vertices[avatar.faces]  # (F, 3 or 4, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    towards = -facing * normals[:, 1]
    seen = np.flatnonzero(towards > 0.0)
    seen = seen[np.argsort(-facing * corners[seen][:, :, 1].mean(axis=1))]
    flat = corners[seen][:, :, [0, 2]] * [facing, 1.0]
    shade = 0.72 + 0.24 * towards[seen]
    colours = np.repeat(shade[:, None], 3, axis=1)
    panel.add_collection(
        PolyCollection(flat, facecolors=colours, edgecolors=colours, linewidths=0.2)
    )
