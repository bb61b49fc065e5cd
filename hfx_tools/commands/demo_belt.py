# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx demo --scene belt``: particles around a walker, felt on a belt, heard all around."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfx_blender.commands.console import Console
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session

STEM = "belt"


def run(options: argparse.Namespace, console: Console) -> int:
    """Build, save, reopen and export the scene, write sound, draw, and report; returns 0."""
    bpy = blender_session.start()

    from hfx_blender.devices.configuration import load_device
    from hfx_blender.engine.track import TrackReader
    from hfx_blender.export.scene_export import ExportSettings, export_scene

    from ..demo import belt
    from ..demo.demo_charts import draw_belt
    from ..demo.scene_file import build_and_open
    from ..spatial_sound.loudspeakers import LAYOUTS
    from ..spatial_sound.scene_sound import write_sound
    from ..spatial_sound.sound_file import SOUND_SUFFIX
    from ..spatial_sound.sound_settings import SoundSettings
    from ..track_rendering import render_devices

    folder: Path = options.output
    make_folder(folder)
    console.say("Building the belt's scene ...")
    scene_file = folder / f"{STEM}.blend"
    build_and_open(belt.build, scene_file)
    device = load_device(belt.DEVICE)
    scene = bpy.context.scene
    settings = ExportSettings(("track", "csv", "wav"), (device,))
    report = export_scene(scene, folder, STEM, settings, console.progress("Exporting"))
    layout = LAYOUTS[belt.LOUDSPEAKERS]
    sound_file = folder / (STEM + SOUND_SUFFIX)
    heard = write_sound(
        scene,
        sound_file,
        SoundSettings(layout=layout, hearing=belt.HEARING),
        track=folder / f"{STEM}.hfxtrack",
        progress=console.progress("Sound"),
    )
    with TrackReader(folder / f"{STEM}.hfxtrack") as track:
        ((_, raster),) = render_devices(track, (device,))
    draw_belt(raster, sound_file, layout, folder / "belt.svg")
    touched = {row["effect"] for row in report.felt}
    console.say(
        "\n".join(
            (
                f"\n{len(touched)} of {belt.PARTICLES} particles were felt, {heard} were heard.",
                "",
                f"In {folder}:",
                f"  {STEM}.blend      the scene; hfx export and hfx sound make the rest again",
                f"  {STEM}.hfxtrack   haptic samples, a stream for each particle",
                f"  {STEM}.{belt.DEVICE}.wav, .csv   output of the belt's eight motors",
                f"  {STEM}{SOUND_SUFFIX}  {len(layout)} loudspeakers, in step with the motors",
                "  belt.svg        motors and loudspeakers over time",
            )
        ),
        several_lines=True,
    )
    console.result(
        {
            **report.as_dict(),
            "folder": str(folder),
            "sound": sound_file.name,
            "particles_felt": len(touched),
            "particles_heard": heard,
        }
    )
    return 0
