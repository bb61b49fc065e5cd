# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart of the textile renderer's output against measured roughness."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from ...charts import chart
from .textile_correlation import PAPER_R, PARAMETERS

_COLOURS: Final = ("#2e6f9e", "#b03a2e")  # slow, fast
_LEAST_R: Final = 0.8


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw a result of :func:`textile_correlation.correlation` as SVG.

    Above, the surfaces' drive against roughness, by parameter; below, r of all sets at the last
    cut-off, a row for each family and speed, with the paper's r as a line.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    surfaces, speeds = result["surfaces"], result["speeds_m_s"]
    families = [(name, v) for name in result["sets"] for v in range(len(speeds))]
    listed = next(iter(result["sets"].values()))[0][0]  # r of the surfaces, by speed and parameter
    with chart(path, 340 * len(PARAMETERS), 400 + 18 * len(families)) as figure:
        figure.suptitle(
            f"{len(surfaces)} woven surfaces: drive at c_v = 1 against roughness "
            f"(ISO 4287, cut-off {result['cutoffs_mm'][0]:g} mm)"
        )
        ratios = [280, 18 * len(families)]
        panels = figure.subplots(2, len(PARAMETERS), squeeze=False, height_ratios=ratios)
        for k, (name, above, below) in enumerate(zip(PARAMETERS, *panels, strict=True)):
            for v, (speed, colour) in enumerate(zip(speeds, _COLOURS, strict=True)):
                drives = [row["drive"][v] for row in surfaces]
                label = f"{100 * speed:g} cm/s: r = {listed[v][k]:.3f}"
                roughness = [row[name] for row in surfaces]
                above.scatter(drives, roughness, 14, color=colour, alpha=0.6, lw=0, label=label)
            above.set(xlim=0, ylim=0, xlabel="drive, um", ylabel=f"{name}, um")
            above.legend()
            for row, (family, v) in enumerate(families):
                r = [max(set_[-1][v][k], _LEAST_R) for set_ in result["sets"][family]]
                below.scatter(r, [row] * len(r), 14, color=_COLOURS[v], alpha=0.5, lw=0)
            below.axvline(PAPER_R[k], color="#222222", linestyle="dotted")
            below.set_yticks(range(len(families)), [name for name, _ in families] if k == 0 else [])
            below.set(xlim=(_LEAST_R, 1.005), ylim=(len(families) - 0.5, -0.5))
            below.set_xlabel(
                f"r with {name} at {result['cutoffs_mm'][-1]:g} mm,\n"
                f"{result['rounds']} sets each; paper: {PAPER_R[k]:g}"
            )
