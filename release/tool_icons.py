# SPDX-License-Identifier: GPL-3.0-or-later
"""Icons of the tools that drag out effects: ``python -m release.tool_icons`` writes them anew.

Blender's format for icons of tools: ``VCO`` and a zero byte, width and height of the drawing and
its origin (a byte each), then the corners of all triangles (x and y of a byte each), then their
colours (RGBA of a byte each). Y points up.
"""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "hfx_blender" / "ui" / "icons"

Corner = tuple[float, float]
Triangle = tuple[Corner, Corner, Corner]

_LIGHT, _MIDDLE, _DARK = (232, 232, 232, 255), (190, 190, 190, 255), (140, 140, 140, 255)
_WAVES = (255, 150, 40, 255)  # orange, which no tool of Blender has


def _disc(x: float, y: float, radius: float) -> list[Triangle]:
    rim = [(x + radius * cos(k * pi / 12), y + radius * sin(k * pi / 12)) for k in range(25)]
    return [((x, y), *pair) for pair in pairwise(rim)]


def _arc(x: float, y: float, radius: float, first: float, last: float) -> list[Triangle]:
    """Arc of 16 units' width, between two angles in degrees."""
    angles = [pi / 180 * (first + (last - first) * k / 10) for k in range(11)]
    inner = [(x + (radius - 8) * cos(a), y + (radius - 8) * sin(a)) for a in angles]
    outer = [(x + (radius + 8) * cos(a), y + (radius + 8) * sin(a)) for a in angles]
    return [
        triangle
        for k in range(10)
        for triangle in (
            (inner[k], outer[k], outer[k + 1]),
            (inner[k], outer[k + 1], inner[k + 1]),
        )
    ]


def _quad(*corners: Corner) -> list[Triangle]:
    a, b, c, d = corners
    return [(a, b, c), (a, c, d)]


_TOP, _LEFT, _RIGHT, _BOTTOM = (96, 180), (32, 146), (160, 146), (96, 40)
_FRONT = (96, 112)

SHAPES = {
    "sphere": [(_disc(96, 104, 66), _LIGHT), (_disc(80, 122, 24), (255, 255, 255, 255))],
    "cuboid": [
        (_quad(_LEFT, _FRONT, _RIGHT, _TOP), _LIGHT),
        (_quad(_LEFT, (32, 74), _BOTTOM, _FRONT), _MIDDLE),
        (_quad(_FRONT, _BOTTOM, (160, 74), _RIGHT), _DARK),
    ],
    "spot": [(_arc(96, -60, 150, 50, 130), _MIDDLE), (_disc(96, 116, 32), _LIGHT)],
    "wind": [
        (_quad((20, 84), (104, 84), (104, 112), (20, 112)), _LIGHT),
        ([((104, 50), (176, 98), (104, 146))], _LIGHT),
    ],
}
"""Drawing of each tool, by the file's name: triangles and their colour, from back to front."""


def icon(name: str) -> bytes:
    """File of an icon, with waves in the upper right corner as the mark of haptics."""
    waves = [*_arc(140, 150, 46, -10, 100), *_arc(140, 150, 86, -10, 100)]
    drawing = [*SHAPES[name], (waves, _WAVES)]
    corners = bytearray()
    colours = bytearray()
    for triangles, colour in drawing:
        for triangle in triangles:
            for x, y in triangle:
                corners += bytes((round(min(max(x, 0), 255)), round(min(max(y, 0), 255))))
                colours += bytes(colour)
    return b"VCO\0" + bytes((255, 255, 0, 0)) + bytes(corners + colours)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for name in SHAPES:
        (FOLDER / f"{name}.dat").write_bytes(icon(name))


if __name__ == "__main__":
    main()
