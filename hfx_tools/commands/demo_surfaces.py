# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx demo --scene surfaces``: a fingertip strokes a board of materials, played by two phones."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from hfx_blender.commands.console import Console
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session

STEM = "board"
DEVICES = ("phone_wide_band", "phone_lra")


def run(options: argparse.Namespace, console: Console) -> int:
    """Build, save, reopen and export the scene; report the phones' output by square; returns 0."""
    bpy = blender_session.start()

    from hfx_blender.devices.configuration import load_device
    from hfx_blender.engine.track import TrackReader
    from hfx_blender.export.scene_export import ExportSettings, export_scene

    from ..demo import board
    from ..demo.scene_file import build_and_open
    from ..track_rendering import render_devices

    folder: Path = options.output
    make_folder(folder)
    console.say("Building the board ...")
    build_and_open(lambda: board.build(bpy.context), folder / f"{STEM}.blend")
    devices = tuple(load_device(name) for name in DEVICES)
    settings = ExportSettings(("track", "csv", "ahap", "he"), devices)
    report = export_scene(bpy.context.scene, folder, STEM, settings, console.progress("Exporting"))
    with TrackReader(folder / f"{STEM}.hfxtrack") as track:
        rasters = [raster for _, raster in render_devices(track, devices)]
    played = []
    console.say()
    console.say("square".ljust(14) + "from s".rjust(8) + "".join(f"{d:>24}" for d in DEVICES))
    for name, begin_s, end_s in board.crossings():
        row = {"square": name, "begin_s": begin_s, "end_s": end_s}
        for device, raster in zip(DEVICES, rasters, strict=True):
            inside = (raster.times_s >= begin_s) & (raster.times_s < end_s)
            amplitude, hz = raster.values[inside].T
            row[device] = {
                "amplitude_m_s2": float(amplitude.max()),
                "frequency_hz": float(np.median(hz[amplitude > 0.0])) if amplitude.any() else None,
            }
        played.append(row)
        cells = (row[device] for device in DEVICES)
        shown = (f"{c['amplitude_m_s2']:.2f} m/s2 {c['frequency_hz'] or 0.0:.0f} Hz" for c in cells)
        console.say(name.ljust(14) + f"{begin_s:8.2f}" + "".join(f"{cell:>24}" for cell in shown))
    console.say()
    console.say(f"In {folder}: {STEM}.blend, its track, and .csv, .ahap and .he of each phone")
    console.result({**report.as_dict(), "folder": str(folder), "squares": played})
    return 0
