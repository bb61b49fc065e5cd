# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx sound``: writes the spatial sound of a scene's haptic volumes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError, refuse_no_file
from hfx_blender.files.atomic import inputs_kept
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session

from .size_option import add_largest


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "sound",
        help="write a scene's spatial sound",
        description="Write one WAV with a channel per loudspeaker. Each haptic volume of a scene "
        "is a sound source at its position, heard by the first body, in step with the rasters of "
        "its devices.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE.blend")
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="DIR")
    add_options(parser)
    add_largest(parser)
    add_json(parser, run)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the sound."""
    parser.add_argument(
        "--loudspeakers",
        default="stereo",
        metavar="L",
        help="stereo, quad, 5.0, 7.0, ring8, cube8, or azimuths in degrees, left positive, each "
        "with an elevation after a colon: 30,-30,110:20,-110:20 (default: stereo)",
    )
    parser.add_argument(
        "--panning", choices=("vbap", "ring"), default="vbap", help="panning method"
    )
    parser.add_argument(
        "--reference",
        type=float,
        default=2.0,
        metavar="M",
        help="distance at which direct and reverberated sound are equally loud (default: 2)",
    )
    parser.add_argument(
        "--audible",
        type=float,
        default=8.0,
        metavar="M",
        help="distance from which sources are silent (default: 8)",
    )
    parser.add_argument(
        "--air",
        type=float,
        default=0.0,
        metavar="TIMES",
        help="absorption of high frequencies by distance, as a multiple of real air (default: 0, "
        "none; 1 is inaudible within 8 m, 100 takes 3 dB from 880 Hz there)",
    )
    parser.add_argument(
        "--doppler", action="store_true", help="pitch rises as a source comes nearer"
    )
    parser.add_argument(
        "--voices",
        choices=("scale", "own"),
        default="scale",
        help="scale: a tone of a scale for each volume (default); own: the sound of a Speaker "
        "parented to the volume, else the frequency of its vibration",
    )
    parser.add_argument(
        "--ageing",
        type=float,
        default=0.0,
        metavar="S",
        help="pitch falls by a step of a pentatonic scale for each S seconds since a source was "
        "switched on, down to two octaves (default: 0, not at all)",
    )


def settings_of(options: argparse.Namespace) -> Any:
    """Sound settings from the options; UsageError for impossible combinations."""
    from ..spatial_sound.hearing import Hearing
    from ..spatial_sound.loudspeakers import Panner, parse
    from ..spatial_sound.sound_settings import SoundSettings

    try:
        hearing = Hearing(
            options.reference, options.audible, air=options.air, with_doppler=options.doppler
        )
    except ValueError as error:
        raise UsageError(f"sound: {error}") from None
    if not 0.0 <= options.ageing < 1e6:
        raise UsageError(f"--ageing {options.ageing:g}: expected seconds, from 0")
    layout = parse(options.loudspeakers)
    Panner(layout, hearing, options.panning)  # raises for impossible combinations
    return SoundSettings(
        layout=layout,
        scheme=options.panning,
        hearing=hearing,
        voices=options.voices,
        ageing_s=options.ageing,
    )


def run(options: argparse.Namespace, console: Console) -> int:
    """Open the scene and write the sound into the output folder; returns 0."""
    # First, as the modules imported below need Blender.
    bpy = blender_session.start()

    from hfx_blender.blender import linked_files

    from ..spatial_sound.scene_sound import write_sound
    from ..spatial_sound.sound_file import SOUND_SUFFIX

    settings = settings_of(options)
    refuse_no_file(options.scene)
    blender_session.open_blend(options.scene)
    make_folder(options.output)
    path = options.output / (options.scene.stem + SOUND_SUFFIX)
    # The sound must not replace a file of the scene.
    with inputs_kept(linked_files.files_read(linked_files.linked_files())):
        count = write_sound(
            bpy.context.scene, path, settings, progress=console.progress(options.scene.name)
        )
    console.say(f"{path}: {count} sources over {len(settings.layout)} loudspeakers")
    console.result({"file": str(path), "sources": count, "loudspeakers": len(settings.layout)})
    return 0
