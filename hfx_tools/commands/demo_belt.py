# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx demo --scene belt`` and ``life``: particles felt on a belt, and heard all around."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfx_blender.commands.console import Console
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session


def run(options: argparse.Namespace, console: Console) -> int:
    """Build, save, reopen and export the scene, write sound, draw, and report; returns 0."""
    bpy = blender_session.start()

    from hfx_blender.devices.configuration import load_device
    from hfx_blender.engine.track import TrackReader
    from hfx_blender.export.scene_export import ExportSettings, export_scene

    from ..demo import belt, life
    from ..demo.demo_charts import draw_belt
    from ..demo.scene_file import build_and_open
    from ..spatial_sound.scene_sound import write_sound
    from ..spatial_sound.sound_file import SOUND_SUFFIX
    from ..track_rendering import render_devices

    folder: Path = options.output
    make_folder(folder)
    stem: str = options.scene
    piece = life if stem == "life" else belt
    console.say("Building the scene of particles ...")
    scene_file = folder / f"{stem}.blend"
    build_and_open(piece.build, scene_file)
    device = load_device(piece.DEVICE)
    scene = bpy.context.scene
    settings = ExportSettings(("track", "csv", "wav"), (device,))
    report = export_scene(scene, folder, stem, settings, console.progress("Exporting"))
    layout = piece.SOUND.layout
    sound_file = folder / (stem + SOUND_SUFFIX)
    heard = write_sound(
        scene,
        sound_file,
        piece.SOUND,
        track=folder / f"{stem}.hfxtrack",
        progress=console.progress("Sound"),
    )
    with TrackReader(folder / f"{stem}.hfxtrack") as track:
        ((_, raster),) = render_devices(track, (device,))
    draw_belt(raster, sound_file, layout, folder / f"{stem}.svg")
    touched = {row["effect"] for row in report.felt}
    console.say(
        "\n".join(
            (
                f"\n{len(touched)} particles were felt, {heard} were heard.",
                "",
                f"In {folder}:",
                f"  {stem}.blend      the scene; hfx export and hfx sound make the rest again",
                f"  {stem}.hfxtrack   haptic samples, a stream for each particle",
                f"  {stem}.{piece.DEVICE}.wav, .csv   output of the belt's eight motors",
                f"  {stem}{SOUND_SUFFIX}  {len(layout)} loudspeakers, in step with the motors",
                f"  {stem}.svg        motors and loudspeakers over time",
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
