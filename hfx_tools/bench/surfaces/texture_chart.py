# SPDX-License-Identifier: GPL-3.0-or-later
"""The textile renderer's output against measured roughness, as SVG: a panel for each parameter."""

from __future__ import annotations

from html import escape
from typing import Any, Final

from .textile_correlation import PAPER_R, PARAMETERS

_SIZE: Final = 250
_LEFT: Final = 96
_TOP: Final = 44
_GAP: Final = 60
_TEXT: Final = 'font-family="sans-serif" font-size="11"'
_COLOURS: Final = ("#2e6f9e", "#b03a2e")  # slow, fast
_ROW: Final = 16
_LEAST_R: Final = 0.8


def svg(result: dict[str, Any]) -> str:
    """Chart of the results of :func:`textile_correlation.correlation`."""
    width = _LEFT + len(PARAMETERS) * (_SIZE + _GAP)
    height = _TOP + _SIZE + 64 + _strip_height(result)
    title = (
        f"{len(result['surfaces'])} woven surfaces: drive at c_v = 1 against roughness "
        f"(ISO 4287, cut-off {result['cutoffs_mm'][0]:g} mm)"
    )
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="8" y="18" fill="#222" font-weight="bold" {_TEXT}>{escape(title)}</text>',
    ]
    for k, name in enumerate(PARAMETERS):
        parts += _panel(result, k, name, _LEFT + k * (_SIZE + _GAP))
        parts += _strip(result, k, name, _LEFT + k * (_SIZE + _GAP))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _panel(result: dict[str, Any], parameter: int, name: str, left: float) -> list[str]:
    rows = result["surfaces"]
    drives = [max(row["drive"][v] for row in rows) for v in range(len(result["speeds_m_s"]))]
    right, top = 1.05 * max(drives), 1.05 * max(row[name] for row in rows)
    bottom = _TOP + _SIZE
    parts = [
        f'<rect x="{left}" y="{_TOP}" width="{_SIZE}" height="{_SIZE}" fill="none" stroke="#999"/>',
        f'<text x="{left + _SIZE / 2}" y="{bottom + 30}" text-anchor="middle" fill="#222" {_TEXT}>'
        "drive, um</text>",
        f'<text x="{left}" y="{_TOP - 6}" fill="#222" {_TEXT}>{name}, um</text>',
    ]
    for share in (0.0, 0.5, 1.0):
        x, y = left + share * _SIZE, bottom - share * _SIZE
        parts += [
            f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle" fill="#555" {_TEXT}>'
            f"{share * right:.0f}</text>",
            f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end" fill="#555" {_TEXT}>'
            f"{share * top:.0f}</text>",
        ]
    for v, speed in enumerate(result["speeds_m_s"]):
        for row in rows:
            x = left + _SIZE * row["drive"][v] / right
            y = bottom - _SIZE * row[name] / top
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{_COLOURS[v]}" fill-opacity="0.6"/>'
            )
        parts.append(
            f'<text x="{left + 8}" y="{_TOP + 16 + 15 * v}" fill="{_COLOURS[v]}" {_TEXT}>'
            f"{100 * speed:g} cm/s: r = {_first_set(result)[v][parameter]:.3f}</text>"
        )
    return parts


def _first_set(result: dict[str, Any]) -> list[list[float]]:
    """r of the surfaces that are listed, by speed and parameter."""
    first: list[list[float]] = next(iter(result["sets"].values()))[0][0]
    return first


def _strip_height(result: dict[str, Any]) -> int:
    return _ROW * len(result["sets"]) * len(result["speeds_m_s"]) + 46


def _strip(result: dict[str, Any], parameter: int, name: str, left: float) -> list[str]:
    """r of all sets at the last cut-off, a row for each family and speed; the paper's as a line."""
    top = _TOP + _SIZE + 64

    def at(r: float) -> float:
        return left + _SIZE * (max(r, _LEAST_R) - _LEAST_R) / (1.0 - _LEAST_R)

    rows = [
        (recipe, v, [each[-1][v][parameter] for each in found])
        for recipe, found in result["sets"].items()
        for v in range(len(result["speeds_m_s"]))
    ]
    bottom, line = top + _ROW * len(rows), at(PAPER_R[parameter])
    parts = [
        f'<rect x="{left}" y="{top}" width="{_SIZE}" height="{bottom - top}" fill="none" '
        'stroke="#999"/>',
        f'<line x1="{line:.1f}" y1="{top}" x2="{line:.1f}" y2="{bottom}" stroke="#222" '
        'stroke-dasharray="3 3"/>',
        f'<text x="{left + _SIZE / 2}" y="{bottom + 30}" text-anchor="middle" fill="#222" {_TEXT}>'
        f"r with {name} at {result['cutoffs_mm'][-1]:g} mm, {result['rounds']} sets each; paper: "
        f"{PAPER_R[parameter]:g}</text>",
    ]
    for r in (_LEAST_R, 0.9, 1.0):
        parts.append(
            f'<text x="{at(r):.1f}" y="{bottom + 15}" text-anchor="middle" fill="#555" {_TEXT}>'
            f"{r:g}</text>"
        )
    for k, (recipe, v, found) in enumerate(rows):
        y = top + _ROW * (k + 0.5)
        if parameter == 0:
            parts.append(
                f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end" fill="{_COLOURS[v]}" '
                f"{_TEXT}>{recipe}</text>"
            )
        parts += [
            f'<circle cx="{at(r):.1f}" cy="{y:.1f}" r="3" fill="{_COLOURS[v]}" fill-opacity="0.5"/>'
            for r in found
        ]
    return parts
