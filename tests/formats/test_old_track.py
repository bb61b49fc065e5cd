# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a track of the first days with the present version.

``old_files/arrow.hfxtrack`` and a vest's pressures, ``arrow.pressure_vest.csv``, were written by
commit 2fe248f2 of 23 November 2026: frames 149 to 155 of the demo; the arrow begins at frame 150.
Clips of those days are in ``players/conformance``.
"""

from __future__ import annotations

import csv
from fractions import Fraction
from pathlib import Path

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.track import TrackReader

FOLDER = Path(__file__).parent / "old_files"


def test_the_samples_of_an_old_track_are_there() -> None:
    with TrackReader(FOLDER / "arrow.hfxtrack") as track:
        time = track.header.time
        # Seconds from the first frame of the scene: frame 149 at 60 frames per second is before
        # the clip from frame 150, frame 153 is in the clip.
        before = [s for s in track.samples_at(149 / 60) if len(s.vertices)]
        during = [s for s in track.samples_at(153 / 60) if len(s.vertices)]
    assert (time.fps, time.frame_first, time.frame_last) == (Fraction(60), 149, 155)
    assert before == []
    (arrow,) = during
    assert arrow.stream.modality == "pressure" and len(arrow.vertices) == 144


def test_an_old_track_renders_to_the_values_of_its_time() -> None:
    with TrackReader(FOLDER / "arrow.hfxtrack") as track:
        raster = render(track.header, track.runs(), load_device("pressure_vest"))
    with (FOLDER / "arrow.pressure_vest.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    expected = np.array(rows, np.float64)[:, 1:]
    names = [f"{c.actuator}.{c.parameter} [{c.unit}]" for c in raster.columns]
    assert names == head[1:]
    assert expected.max() == 8.0 and expected.min() == 0.0  # kPa: the vest's strength, and none
    np.testing.assert_allclose(raster.values, expected, atol=1e-9)
