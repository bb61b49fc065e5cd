# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart of the trade: time against error, one panel for each kind of error, as SVG."""

from __future__ import annotations

from html import escape
from math import ceil, floor, log10
from typing import Any, Final

_PANELS: Final = (
    ("wrong_share", 100.0, "skin that feels wrongly, % of what is felt"),
    ("amplitude_mean", 100.0, "error at actuators, % of full scale"),
    ("onset_mean_ms", 1.0, "error of the begin of contacts, ms"),
)
NOISE: Final = 1.03
"""A setting must be faster by more than this to count as faster."""

_WIDTH: Final = 340
_HEIGHT: Final = 260
_LEFT: Final = 56
_TOP: Final = 42
_GAP: Final = 74
_TEXT: Final = 'font-family="sans-serif" font-size="11"'
_PRESET: Final = "#b03a2e"
_OTHER: Final = "#5d6d7e"


def svg(result: dict[str, Any]) -> str:
    """Chart of the results of :func:`trade.measure`."""
    width = _LEFT + len(_PANELS) * (_WIDTH + _GAP)
    height = _TOP + _HEIGHT + 58
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="8" y="18" fill="#222" font-weight="bold" {_TEXT}>'
        f"{escape(_printable(result['scene']))}: time against error; joined: the front; filled: on "
        "it within noise; cross: bounds no error</text>",
    ]
    for k, (name, scale, label) in enumerate(_PANELS):
        parts += _panel(result["settings"], name, scale, label, _LEFT + k * (_WIDTH + _GAP))
    return "\n".join([*parts, "</svg>"]) + "\n"


def front(points: list[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto front of points (cost, error), by rising cost."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    kept: list[int] = []
    for k in order:
        if not kept or points[k][1] < points[kept[-1]][1]:
            kept.append(k)
    return kept


def on_front(points: list[tuple[float, float]]) -> list[int]:
    """Indices of points (cost, error) that no other surely beats: cheaper by more than
    :data:`NOISE`, no worse.
    """
    return [
        k
        for k, (cost, error) in enumerate(points)
        if not any(other * NOISE < cost and least <= error for other, least in points)
    ]


def _panel(
    rows: list[dict[str, Any]], name: str, scale: float, label: str, left: float
) -> list[str]:
    costs = [row["ms_per_frame"] for row in rows]
    values = [row[name] * scale for row in rows]
    low, high = _decades(costs)
    top = _rounded_up(max(values))
    bottom = _TOP + _HEIGHT

    def x(cost: float) -> float:
        return left + (log10(cost) - low) / (high - low) * _WIDTH

    def y(value: float) -> float:
        return bottom - value / top * _HEIGHT

    parts = [
        f'<text x="{left}" y="{_TOP - 8}" fill="#444" {_TEXT}>{escape(label)}</text>',
        f'<rect x="{left}" y="{_TOP}" width="{_WIDTH}" height="{_HEIGHT}" fill="none" '
        'stroke="#bbb"/>',
        f'<text x="{left + _WIDTH / 2}" y="{bottom + 36}" text-anchor="middle" fill="#444" '
        f"{_TEXT}>ms per frame</text>",
    ]
    for k in range(5):
        value = top * k / 4
        parts.append(
            f'<line x1="{left}" y1="{y(value):.1f}" x2="{left + _WIDTH}" y2="{y(value):.1f}" '
            'stroke="#eee"/>'
            f'<text x="{left - 6}" y="{y(value) + 4:.1f}" text-anchor="end" fill="#777" '
            f"{_TEXT}>{value:g}</text>"
        )
    for tick in _ticks(low, high):
        parts.append(
            f'<line x1="{x(tick):.1f}" y1="{_TOP}" x2="{x(tick):.1f}" y2="{bottom}" '
            'stroke="#eee"/>'
            f'<text x="{x(tick):.1f}" y="{bottom + 16}" text-anchor="middle" fill="#777" '
            f"{_TEXT}>{tick:g}</text>"
        )
    bounded = [k for k, row in enumerate(rows) if row.get("is_bounded", True)]
    points = [(costs[k], values[k]) for k in bounded]
    line = " ".join(f"{x(points[k][0]):.1f},{y(points[k][1]):.1f}" for k in front(points))
    filled = {bounded[k] for k in on_front(points)}
    parts.append(f'<polyline points="{line}" fill="none" stroke="#c9a227" stroke-width="1.5"/>')
    taken: list[tuple[float, float]] = []
    for k, row in enumerate(rows):
        colour = _PRESET if row["is_preset"] else _OTHER
        fill = colour if k in filled else "#ffffff"
        title = f"<title>{escape(row['setting'])}: {costs[k]:.3g} ms, {values[k]:.3g}</title>"
        if k in bounded:
            parts.append(
                f'<circle cx="{x(costs[k]):.1f}" cy="{y(values[k]):.1f}" '
                f'r="{5 if row["is_preset"] else 3.5}" fill="{fill}" stroke="{colour}" '
                f'stroke-width="1.5">{title}</circle>'
            )
        else:
            parts.append(
                f'<path d="M{x(costs[k]) - 5:.1f} {y(values[k]) - 5:.1f}l10 10m0-10l-10 10" '
                f'fill="none" stroke="{colour}" stroke-width="1.5">{title}</path>'
            )
        if row["is_preset"]:
            parts.append(_label(row["setting"], x(costs[k]), y(values[k]), left, taken))
    return parts


def _label(text: str, x: float, y: float, left: float, taken: list[tuple[float, float]]) -> str:
    """Place a name beside its point, clear of other names."""
    ends = x > left + 0.75 * _WIDTH
    place = x - 8.0 if ends else x + 8.0
    middle = place - 25.0 if ends else place + 25.0
    free = (
        y + shift
        for shift in (-6.0, 14.0, -20.0, 28.0)
        if all(abs(middle - a) > 55.0 or abs(y + shift - b) > 12.0 for a, b in taken)
    )
    height = next(free, y - 6.0)
    taken.append((middle, height))
    anchor = "end" if ends else "start"
    return (
        f'<text x="{place:.1f}" y="{height:.1f}" text-anchor="{anchor}" fill="{_PRESET}" '
        f"{_TEXT}>{escape(text)}</text>"
    )


def _printable(text: str) -> str:
    return "".join(each if each.isprintable() else "?" for each in text)


def _decades(costs: list[float]) -> tuple[float, float]:
    """Bounds of the cost axis, powers of ten."""
    low, high = log10(min(costs)), log10(max(costs))
    margin = 0.08 * (high - low) + 0.05
    return low - margin, high + margin


def _ticks(low: float, high: float) -> list[float]:
    steps = (1.0, 2.0, 5.0)
    found = [step * 10.0**k for k in range(floor(low), ceil(high) + 1) for step in steps]
    return [tick for tick in found if low <= log10(tick) <= high]


def _rounded_up(value: float) -> float:
    """Round number that is no less, so that quarters of it can be read."""
    if value <= 0.0:
        return 1.0
    unit = 10.0 ** floor(log10(value))
    return next(unit * k for k in (1.0, 2.0, 4.0, 6.0, 8.0, 10.0) if unit * k >= value * 0.999999)
