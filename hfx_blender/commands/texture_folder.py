# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of other generators for ``hfx texture generate``: one, or all that come to a folder."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..errors import InputError, UsageError, refuse_no_file
from ..files.atomic import inputs_kept
from . import texture_source
from .console import Console

if TYPE_CHECKING:
    from ..generation.generated import Generated

Keep = Callable[["Generated", argparse.Namespace, Console], dict[str, Any]]

_LOOK_S: Final = 0.5
"""Interval of looks into the folder: a picture that grew meanwhile is still being written."""


def run(options: argparse.Namespace, console: Console, keep: Keep) -> int:
    """Convert one picture, or those of a folder; 5 if some of several could not be read."""
    if options.watch is not None and options.picture is not None:
        raise UsageError("give --watch or --picture, not both")
    if options.picture is not None:
        refuse_no_file(options.picture)
        console.result({"made": [keep(_generated(options.picture, options), options, console)]})
        return 0
    return _watch(options, console, keep)


def _watch(options: argparse.Namespace, console: Console, keep: Keep) -> int:
    from ..generation.picture_folder import WatchedFolder, is_made

    watched = WatchedFolder(options.watch)
    made: list[dict[str, Any]] = []
    faults: list[str] = []
    watched.settled()
    if not options.once:
        console.say(f"watching {options.watch}; Ctrl-C ends it")
    while watched.is_waiting or not options.once:
        time.sleep(_LOOK_S)
        for picture in watched.settled():
            try:
                if not is_made(picture, options.output):
                    with inputs_kept([picture]):
                        made.append(keep(_generated(picture, options), options, console))
            except InputError as error:
                faults.append(str(error))
                console.warn(f"left out: {error}")
    for picture in watched.passed_over:
        faults.append(f"{picture}: it is empty, or no plain file.")
        console.warn(f"left out: {faults[-1]}")
    console.say(f"{len(made)} made, {len(faults)} left out")
    console.result({"made": made, "left_out": faults})
    return 5 if faults else 0


def _generated(picture: Path, options: argparse.Namespace) -> Generated:
    from ..generation import picture_folder

    size = options.size
    return picture_folder.generate(
        picture,
        lambda path: texture_source.picture(path, "colours"),
        size_m=None if size is None else (size[0] / 1000.0, size[1] / 1000.0),
        depth_m=options.height / 1000.0,
        tiles=options.tiles,
        way=options.way,
        steps=steps_of(options),
    )


def steps_of(options: argparse.Namespace) -> Any:
    """Just-noticeable steps, if they are asked for."""
    from ..engine.texture.device_range import NoticeableSteps

    return NoticeableSteps() if options.steps else None
