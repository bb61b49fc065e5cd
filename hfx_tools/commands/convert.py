# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx convert``: converts a file to another format."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, UsageError

if TYPE_CHECKING:
    from hfx_blender.formats.sound.sound_analysis import SoundSettings

from .size_option import add_largest


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "convert",
        help="convert between formats",
        description=(
            "Convert a track or a raster (npz, csv) to what a device plays or to hjif and hmpg, a "
            "track to jsonl, HJIF and HMPG to each other, and vibration between AHAP, .haptic, "
            ".he, .tact, OpenXR, HJIF and HMPG, or with "
            "--device to the output of a device (wav, csv, npz, tact). A sound (wav, flac, ogg, "
            "mp3) becomes vibration that follows it. Content that the target format cannot hold is "
            "listed."
        ),
    )
    parser.add_argument("source", type=Path, metavar="A")
    parser.add_argument(
        "target",
        type=Path,
        metavar="B",
        help="file to write; its suffix determines the format, see --to",
    )
    parser.add_argument(
        "--to", metavar="FORMAT", help="the format, if the suffix does not determine it"
    )
    parser.add_argument(
        "--device", action="append", metavar="NAME", help="device for the output, by name or file"
    )
    parser.add_argument(
        "--body", metavar="NAME", help="body that wears the device, if the track has several"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1.0,
        metavar="%",
        help="largest error of simplified curves, per cent of full scale (default: 1)",
    )
    parser.add_argument(
        "--strict", action="store_true", help="treat omitted content as an error: exit code 3"
    )
    _add_sound_options(parser)
    add_largest(parser)
    add_json(parser, run)


def _add_sound_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of sounds; None where not given."""
    group = parser.add_argument_group("sounds")

    def add(name: str, kind: Callable[[str], object], metavar: str, text: str) -> None:
        group.add_argument(f"--{name}", type=kind, metavar=metavar, help=text)

    add("strength", float, "%", "amplitude of the loudest moment (default: 100)")
    add("smoothing", float, "MS", "length of the window that smooths the envelope (default: 12)")
    add("band", _range, "LOW:HIGH", "part of the sound to follow, Hz (default: 20:8000)")
    add("threshold", float, "DB", "silence below this, relative to the loudest (default: -40)")
    add(
        "frequencies",
        _range,
        "LOW:HIGH",
        "range of the vibration, Hz (default: that of the device or format, or 65:300)",
    )


def _range(text: str) -> tuple[float, float]:
    """Two numbers with a colon between; ValueError for another text."""
    low, high = map(float, text.split(":"))
    return low, high


def _sound_settings(options: argparse.Namespace) -> SoundSettings | None:
    """Settings of the given options of sounds, None without any; UsageError if out of range."""
    from hfx_blender.formats.signals.signals import FrequencyRange
    from hfx_blender.formats.sound.sound_analysis import SoundSettings

    names = ("strength", "smoothing", "band", "threshold", "frequencies")
    if all(getattr(options, name) is None for name in names):
        return None
    plain = SoundSettings()
    strength, smoothing, band, threshold, frequencies = (getattr(options, name) for name in names)
    try:
        return SoundSettings(
            plain.strength if strength is None else strength / 100.0,
            plain.smoothing_s if smoothing is None else smoothing / 1000.0,
            band or plain.band_hz,
            plain.threshold_db if threshold is None else threshold,
            FrequencyRange(*frequencies) if frequencies else plain.frequencies,
        )
    except ValueError as error:
        raise UsageError(str(error)) from error


def run(options: argparse.Namespace, console: Console) -> int:
    """Convert the file; print results, notes and omissions; returns 0. UsageError for options out
    of range, InputError without any result."""
    from .conversion import convert

    if not 0.0 < options.tolerance <= 50.0:
        raise UsageError(f"--tolerance {options.tolerance:g}: expected more than 0, up to 50")
    if options.device and len(options.device) > 1:
        raise UsageError("--device: expected one; 'hfx export' writes for several")
    with console.reading(options.source):
        written = convert(
            options.source,
            options.target,
            to=options.to,
            device=options.device[0] if options.device else None,
            body=options.body,
            tolerance=options.tolerance / 100.0,
            strict=options.strict,
            sound=_sound_settings(options),
        )
    for path in written.files:
        console.say(f"{path}  {path.stat().st_size} bytes")
    for note in written.notes:
        console.say(f"note: {note}")
    for omission in written.left_out:
        console.warn(f"hfx: left out: {omission}")
    console.result(
        {
            "files": [str(path) for path in written.files],
            "left_out": list(written.left_out),
            "notes": list(written.notes),
        }
    )
    # Notes and losses come first, with the reason for no file.
    if not written.files:
        raise InputError(f"{options.source}: has nothing that {options.target.name} can hold.")
    return 0
