# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the window: from the full-screen virtual display, else by Blender's own operator."""

from __future__ import annotations

import struct
import time
import zlib
from pathlib import Path

import bpy
import numpy as np

_FILTER_NONE, _FILTER_UP = 0, 2  # of a PNG's rows


def redraw(window: bpy.types.Window) -> None:
    """Draw a window at once, with open menus."""
    with bpy.context.temp_override(window=window):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def save(window: bpy.types.Window, path: Path, screen: Path | None) -> np.ndarray:
    """Draw a window, save the picture as PNG and return the pixels.

    Parameters
    ----------
    window : bpy.types.Window
    path : Path
    screen : Path or None
        Memory of the virtual screen, in the X window dump format. Blender's own screenshot is black
        there.

    Returns
    -------
    (height, width, 3) uint8
        From the top.
    """
    redraw(window)
    if screen is None:
        with bpy.context.temp_override(window=window):
            bpy.ops.screen.screenshot(filepath=str(path))
        return _load(path)
    time.sleep(0.15)  # time for the drawing of the X server
    pixels = _read_dump(screen.read_bytes())
    _write_png(path, pixels)
    return pixels


def write(path: Path, pixels: np.ndarray) -> None:
    """Save (height, width, 3) uint8 as a small PNG: each row is stored as the change of bytes."""
    rows = pixels.reshape(len(pixels), -1)
    # Of bytes, as in the PNG filter.
    changes = np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1]))
    _write_rows(path, changes, _FILTER_UP, 9, pixels.shape[1])


def _read_dump(data: bytes) -> np.ndarray:
    header = struct.unpack_from(">25I", data)
    size, width, height, line, colours = header[0], header[4], header[5], header[12], header[19]
    start = size + colours * 12
    rows = np.frombuffer(data, np.uint8, height * line, start).reshape(height, line)
    return rows[:, : width * 4].reshape(height, width, 4)[..., 2::-1]  # blue first


def _write_png(path: Path, pixels: np.ndarray) -> None:
    _write_rows(path, pixels.reshape(len(pixels), -1), _FILTER_NONE, 3, pixels.shape[1])


def _write_rows(path: Path, data: np.ndarray, kind: int, level: int, width: int) -> None:
    height = len(data)
    rows = np.full((height, 1 + width * 3), kind, np.uint8)  # each begins with the filter byte
    rows[:, 1:] = data
    chunks = [
        (b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes(), level)),
        (b"IEND", b""),
    ]
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for name, content in chunks:
            check = struct.pack(">I", zlib.crc32(name + content))
            file.write(struct.pack(">I", len(content)) + name + content + check)


def _load(path: Path) -> np.ndarray:
    image = bpy.data.images.load(str(path))
    width, height = image.size
    flat = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    return (flat.reshape(height, width, 4)[::-1, :, :3] * 255).astype(np.uint8)
