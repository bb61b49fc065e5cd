# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart of the trade: time against error, a panel for each kind of error."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from hfx_blender.text import printable

from ...charts import chart

_PANELS: Final = (
    ("wrong_share", 100.0, "skin that feels wrongly, % of what is felt"),
    ("amplitude_mean", 100.0, "error at actuators, % of full scale"),
    ("onset_mean_ms", 1.0, "error of the begin of contacts, ms"),
)
NOISE: Final = 1.03
"""Factor between two times, above which a setting counts as faster."""

_PRESET: Final = "#b03a2e"
_OTHER: Final = "#5d6d7e"


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw a result of :func:`trade.measure` as SVG.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with chart(path, 1240, 370) as figure:
        figure.suptitle(
            f"{printable(result['scene'])}: time against error; joined: the front; "
            "filled: on it within noise; cross: bounds no error"
        )
        for panel, (name, scale, label) in zip(figure.subplots(1, 3), _PANELS, strict=True):
            panel.set_title(label)
            _draw_panel(
                panel, result["settings"], [row[name] * scale for row in result["settings"]]
            )


def _draw_panel(panel: Any, settings: list[dict[str, Any]], errors: list[float]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    costs = [row["ms_per_frame"] for row in settings]
    bounded = [k for k, row in enumerate(settings) if row.get("is_bounded", True)]
    points = [(costs[k], errors[k]) for k in bounded]
    joined = [points[k] for k in front(points)]
    panel.plot(*zip(*joined, strict=True), color="#c9a227", zorder=1)
    filled = {bounded[k] for k in on_front(points)}
    named = 0
    for k in sorted(range(len(settings)), key=lambda k: costs[k]):
        row = settings[k]
        colour = _PRESET if row["is_preset"] else _OTHER
        face = {"facecolor": colour if k in filled else "white"} if k in bounded else {}
        panel.scatter(
            costs[k],
            errors[k],
            70 if row["is_preset"] else 35,
            marker="o" if k in bounded else "x",
            edgecolor=colour if k in bounded else None,
            **(face or {"color": colour}),
        )
        if row["is_preset"]:
            above = (0, (8, 20)[named % 2])  # names of neighbours at two heights
            panel.annotate(
                *(row["setting"], (costs[k], errors[k]), above),
                textcoords="offset points",
                ha="center",
                color=colour,
            )
            named += 1
    panel.set(xscale="log", xlabel="ms per frame")
    panel.margins(x=0.12)
    panel.set_ylim(0.0, 1.15 * max(errors) or 1.0)
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda cost, _: f"{cost:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.grid(color="#eeeeee")
    panel.set_axisbelow(True)


def front(points: list[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto front of points (cost, error), by rising cost."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    indices: list[int] = []
    for k in order:
        if not indices or points[k][1] < points[indices[-1]][1]:
            indices.append(k)
    return indices


def on_front(points: list[tuple[float, float]]) -> list[int]:
    """Indices of points (cost, error) that no other point beats: error no higher, cost lower by
    more than :data:`NOISE`.
    """
    return [
        k
        for k, (cost, error) in enumerate(points)
        if not any(
            rival_cost * NOISE < cost and rival_error <= error for rival_cost, rival_error in points
        )
    ]
