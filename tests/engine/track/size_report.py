# SPDX-License-Identifier: GPL-3.0-or-later
"""Size of tracks of the shipped models, as a Markdown table.

``docs/regenerate.py tracks`` puts the table into ``docs/track-format.md``.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from track_synthetic import header, run, walking_contact

from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.retargeting.target import areas_of
from hfx_blender.engine.track import TrackWriter

SAMPLES = 600


def table() -> str:
    """Markdown table of bytes for each (sample, vertex) entry."""
    soft = "falloff: every weight changes in every sample"
    lines = [f"| model | contacts a sample | hard boundary | {soft} |", "|---|---|---|---|"]
    for name in ("vibration", "pressure", "temperature"):
        model = load_model(f"hfx-{name}-1")
        (contacts, hard), (_, eased) = (_measured(model, falloff) for falloff in (False, True))
        cells = (
            f"{name} ({len(model):,} vertices)",
            f"{contacts:,.0f}",
            f"{hard:.2f}",
            f"{eased:.2f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _measured(model: PerceptualModel, with_falloff: bool) -> tuple[float, float]:
    """Return contacts per sample, and bytes per contact."""
    points, triangles = model.vertices.astype(np.float64), model.triangles.astype(np.int64)
    thirds = np.repeat(areas_of(points, triangles) / 3.0, 3)
    spacing_m = np.sqrt(np.bincount(triangles.ravel(), thirds, minlength=len(points)))
    contacts = [walking_contact(points, k, with_falloff, spacing_m) for k in range(SAMPLES)]
    entries = sum(len(vertices) for vertices, _ in contacts)
    track_header = header(SAMPLES, len(points), ("vibration",), header().bodies[:1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.hfxtrack"
        with TrackWriter(path, track_header) as writer:
            writer.append([run(track_header, 0, range(SAMPLES), *zip(*contacts, strict=True))])
        return entries / SAMPLES, path.stat().st_size / entries


if __name__ == "__main__":
    sys.stdout.write(f"{table()}\n")
