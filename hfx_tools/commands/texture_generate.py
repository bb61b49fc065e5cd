# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture generate``: makes haptic surfaces from words or generated pictures."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, UsageError, refuse_no_file
from hfx_blender.files.atomic import inputs_kept
from hfx_blender.version import __version__

from . import texture_source

if TYPE_CHECKING:
    from hfx_blender.generation.generated import Generated

BACK_ENDS: Final = ("library", "folder", "diffusers")
_MOST_VARIATIONS: Final = 64
_LOOK_S: Final = 0.5
"""Interval between two checks of the folder, seconds: a growing file is still being written."""

_DESCRIPTION: Final = """\
Make a colour picture, a relief, a haptic map in two layers, a .blend with the material and its
surface, and a record of the generation (NAME.generated.json).

  library   searches the library's materials and steers the nearest one by kind, size, depth, wear,
            weave, direction and colour; it does not paint. Offline, at once. The default.
  folder    takes each picture that comes into a folder from any other generator (--watch), or one
            (--picture), with the words that AUTOMATIC1111 or ComfyUI wrote into it.
  diffusers runs a diffusion model of your own (--model), offline; needs the extra 'generate'.
"""


def add_parser(actions: Any) -> None:
    """Add the action ``generate``."""
    parser = actions.add_parser(
        "generate",
        help="make a surface from words",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("words", nargs="?", default="", metavar="WORDS")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder")
    parser.add_argument("--back-end", choices=BACK_ENDS, default=BACK_ENDS[0], help="(library)")
    parser.add_argument("--negative", default="", metavar="WORDS", help="words to avoid")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another sample (0)")
    parser.add_argument(
        "--variations", type=int, default=1, metavar="N", help="with this seed and the next ones"
    )
    parser.add_argument(
        "--resolution", type=int, default=512, metavar="N", help="texels along an edge (512)"
    )
    parser.add_argument(
        "--steps", action="store_true", help="round to noticeable steps of 0.2 g and 40 Hz"
    )
    pictures = parser.add_argument_group("pictures of other generators")
    pictures.add_argument("--watch", type=Path, metavar="DIR", help="until Ctrl-C")
    pictures.add_argument("--once", action="store_true", help="end after the present pictures")
    pictures.add_argument("--picture", type=Path, metavar="FILE", help="only this picture")
    pictures.add_argument(
        "--from",
        dest="way",
        choices=("relief", "sobel"),
        default="relief",
        help="relief: a network's estimate (default); sobel: bright is high",
    )
    pictures.add_argument(
        "--size",
        type=texture_source.pair,
        metavar="MM,MM",
        help="width and height of what a picture shows (default: 100 mm along the longer edge)",
    )
    pictures.add_argument(
        "--height", type=float, default=0.2, metavar="MM", help="of white over black (0.2)"
    )
    pictures.add_argument("--tiles", action="store_true", help="opposite edges match")
    from . import texture_diffusers  # imports this module

    texture_diffusers.add_arguments(parser)
    parser.add_argument("--no-blend", action="store_true", help="write no .blend")
    add_json(parser, _run)


def _run(options: argparse.Namespace, console: Console) -> int:
    if not 1 <= options.variations <= _MOST_VARIATIONS:
        raise UsageError(f"--variations {options.variations}: expected 1 to {_MOST_VARIATIONS}")
    if options.resolution < 16:
        raise UsageError(f"--resolution {options.resolution}: expected 16 to 4096")
    texture_source.check_numbers(options)
    has_pictures = options.watch is not None or options.picture is not None
    # Pictures come from another program: words do not apply, except those in the pictures.
    if (options.back_end == "folder") != has_pictures:
        raise UsageError("--back-end folder takes --watch DIR or --picture FILE, and only it does")
    if options.watch is not None and options.picture is not None:
        raise UsageError("give --watch or --picture, not both")
    if options.watch is not None:
        return _watch(options, console)
    if options.picture is not None:
        refuse_no_file(options.picture)
        console.result({"made": [_keep(_of_picture(options.picture, options), options, console)]})
        return 0
    if options.back_end == "diffusers":
        from .texture_diffusers import maker

        return _make_all(maker(options, console), options, console)
    if not options.words.strip():
        raise UsageError('give the words, as in: hfx texture generate "coarse grey gravel" -o DIR')
    from hfx_blender.generation import library_search

    def make(seed: int) -> Generated:
        return library_search.generate(
            options.words,
            negative=options.negative,
            seed=seed,
            texels=options.resolution,
            steps=texture_source.steps_of(options),
        )

    return _make_all(make, options, console)


def _make_all(
    make: Callable[[int], Generated], options: argparse.Namespace, console: Console
) -> int:
    """Generate and write all variations, the surfaces of successive seeds; returns 0."""
    progress = console.progress("Generating")
    results: list[dict[str, Any]] = []
    for number in range(options.variations):
        progress(number / options.variations)
        surface = make(options.seed + number)
        results.append(_keep(surface, options, console))
    console.result({"made": results})
    return 0


def _watch(options: argparse.Namespace, console: Console) -> int:
    """Convert the pictures of a folder, until Ctrl-C or with ``--once`` all present ones; returns
    5 if a picture could not be read, else 0."""
    from .watched_folder import WatchedFolder, is_made

    watched = WatchedFolder(options.watch)
    results: list[dict[str, Any]] = []
    faults: list[str] = []
    watched.settled()  # the first call only records sizes, for comparison with the next
    if not options.once:
        console.say(f"watching {options.watch}; Ctrl-C ends it")
    while watched.is_waiting or not options.once:
        time.sleep(_LOOK_S)
        for picture in watched.settled():
            try:
                # A picture with results in the output folder is skipped: a watch can be started
                # again.
                if not is_made(picture, options.output):
                    with inputs_kept([picture]):
                        results.append(_keep(_of_picture(picture, options), options, console))
            except InputError as error:
                faults.append(str(error))
                console.warn(f"left out: {error}")
    # Reported at the end only: an empty file may still be filled.
    for picture in watched.passed_over:
        faults.append(f"{picture}: it is empty, or no plain file.")
        console.warn(f"left out: {faults[-1]}")
    console.say(f"{len(results)} made, {len(faults)} left out")
    console.result({"made": results, "left_out": faults})
    return 5 if faults else 0


def _of_picture(picture: Path, options: argparse.Namespace) -> Generated:
    from hfx_blender.generation import picture_folder

    size = options.size
    return picture_folder.generate(
        picture,
        lambda path: texture_source.picture(path, "colours"),
        size_m=None if size is None else (size[0] / 1000.0, size[1] / 1000.0),
        depth_m=options.height / 1000.0,
        tiles=options.tiles,
        way=options.way,
        steps=texture_source.steps_of(options),
    )


def _keep(surface: Generated, options: argparse.Namespace, console: Console) -> dict[str, Any]:
    """Write a surface into the output folder, with a .blend unless ``--no-blend``; returns facts
    about the results."""
    from hfx_blender.generation import generated

    written = generated.write(surface, options.output, __version__)
    files = [*written.files]
    if not options.no_blend:
        from hfx_blender.processes import blender_session

        # First, as the module imported below needs Blender.
        blender_session.start()
        from .swatch_file import write_blend

        files.append(write_blend(written.files[-1]))
    for path in files:
        console.say(f"wrote {path}")
    for note in surface.notes:
        console.warn(f"note: {note}")
    return {
        "name": surface.name,
        "record": str(written.files[-1]),
        "files": [str(path) for path in files],
        "notes": list(surface.notes),
        "unknown_words": list(surface.record.get("unknown_words", ())),
        "kind": surface.record.get("kind"),
    }
