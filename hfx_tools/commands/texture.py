# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture``: makes haptic maps, renders strokes and measures roughness of surfaces."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, UsageError, refuse_no_file
from hfx_blender.files import limits

from . import (
    texture_board,
    texture_generate,
    texture_source,
    texture_train_decoder,
    texture_train_relief,
)

_RENDERERS = ("mcha", "textile", "direct")
_FAINT = 0.01  # of full strength


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("texture", help="haptic surfaces: maps, strokes, roughness")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)

    build = actions.add_parser(
        "build",
        help="make a haptic map",
        description="Make the two layers of a haptic map as grey PNGs, and a JSON of its scale, "
        "ranges and steps: STEM.intensity.png, STEM.sharpness.png, STEM.texture.json. With --from "
        "relief also the estimates: STEM.height.png, STEM.roughness.png.",
    )
    texture_source.add_arguments(build)
    build.add_argument("-o", "--output", type=Path, metavar="STEM", help="folder and name")
    build.add_argument("--bits", type=int, choices=(8, 16), default=16, help="of a value (16)")

    stroke = actions.add_parser(
        "stroke",
        help="render a stroke over a surface",
        description="Stroke over a surface along a line or a path, and write the vibration.",
    )
    texture_source.add_arguments(stroke, readings=False)  # here, --from is a position
    stroke.add_argument("--from", dest="start", type=texture_source.pair, metavar="MM,MM")
    stroke.add_argument("--to", dest="end", type=texture_source.pair, metavar="MM,MM")
    stroke.add_argument(
        "--path", type=Path, metavar="CSV", help="x and y in mm; or time in s, x and y"
    )
    stroke.add_argument(
        "--speed", type=float, metavar="MM/S", help="mm/s (default: 100, a fast stroke)"
    )
    stroke.add_argument("--renderer", choices=_RENDERERS, default="mcha", help="renderer (mcha)")
    stroke.add_argument("--rate", type=float, default=120.0, metavar="HZ", help="of the pointer")
    stroke.add_argument(
        "--drive", type=float, metavar="1/MM", help="c_v, instead of your calibration"
    )
    stroke.add_argument(
        "--device",
        default="",
        metavar="NAME",
        help="device for the stroke: its calibrated c_v, range, frequencies and update interval",
    )
    stroke.add_argument(
        "-o",
        "--output",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help=".wav, .ahap, .he, .haptic or .csv; may be repeated",
    )

    info = actions.add_parser("info", help="size, ranges and roughness of a surface")
    texture_source.add_arguments(info)
    rough = actions.add_parser("roughness", help="Ra, Rz and Rmax by ISO 4287")
    texture_source.add_arguments(rough)
    for sub in (info, rough):
        sub.add_argument("--cutoff", type=float, default=2.5, metavar="MM", help="(2.5)")
    listing = actions.add_parser("list", help="list the materials of the library")
    for sub, function in (
        (build, _build),
        (stroke, _stroke),
        (info, _info),
        (rough, _roughness),
        (listing, _list),
    ):
        add_json(sub, function)
    texture_generate.add_parser(actions)
    for command in (texture_train_decoder, texture_board, texture_train_relief):
        command.add_parser(actions)


def _build(options: argparse.Namespace, console: Console) -> int:
    import numpy as np

    from hfx_blender.formats.pictures import texture_map

    source = texture_source.read(options)
    stem = options.output or Path(source.name)
    texture_source.check_folder(stem)
    written = texture_map.write(source.map, stem, options.bits, source.name)
    files, facts = list(written.files), {}
    if source.is_estimate and source.height is not None:
        # Black is lowest, white highest.
        heights = source.height.heights_m - source.height.heights_m.min()
        layers = {
            "height": heights / max(float(heights.max()), np.finfo(np.float64).tiny),
            "roughness": 1.0 - source.map.sharpness,
        }
        files += texture_map.write_layers(layers, stem, options.bits).values()
        facts["height_mm"] = 1000.0 * float(np.ptp(source.height.heights_m))
    for note in (*source.notes, *written.notes):
        console.warn(f"note: {note}")
    for path in files:
        console.say(f"wrote {path}")
    console.result({"files": [str(p) for p in files], **facts, "notes": list(source.notes)})
    return 0


def _stroke(options: argparse.Namespace, console: Console) -> int:
    import numpy as np

    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.configurations import surface_calibration
    from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
    from hfx_blender.engine.texture.stroke_rendering import render_stroke
    from hfx_blender.formats.signals import stroke_files

    from .stroke_device import StrokeDevice

    for path in options.output:
        stroke_files.check(path)
        texture_source.check_folder(path)
    stroke = _stroke_of(options)
    device = StrokeDevice(load_device(options.device)) if options.device else None
    source = texture_source.read(options)
    if options.drive is not None and not 0.0 < options.drive < 1e6:
        raise UsageError(f"--drive {options.drive:g}: expected a number above 0")
    # The option is per millimetre, as textures are measured; the calibration is per metre.
    drive = (
        surface_calibration.drive_per_m(options.device)
        if options.drive is None
        else options.drive * 1000.0
    )
    renderer = SurfaceRenderer(options.renderer)
    if source.height is None and renderer is not SurfaceRenderer.MCHA:
        raise InputError(
            f"{options.source}: a map has no heights; --renderer {renderer.value} needs the "
            "picture, scan or material that it was made of."
        )
    texture = SurfaceTexture(source.height, source.map, renderer, drive, source.map.device)
    # A WAV needs audio rates; envelopes are computed from a coarser waveform.
    has_sound = any(path.suffix.lower() == ".wav" for path in options.output)
    rate = stroke_files.WAV_RATE_HZ if has_sound else 8000.0
    signal = render_stroke(
        texture, stroke, step_s=device and device.update_s, waveform_rate_hz=rate
    )
    # Values are shares of a range: of the map's own, or of the device that plays.
    played_range = source.map.device
    if device is not None:
        signal, played_range = device.played(signal), device.range
    facts = {
        "seconds": stroke.duration_s,
        "length_mm": 1000.0 * stroke.length_m,
        "speed_mm_s": 1000.0 * stroke.length_m / stroke.duration_s,
        "mean_amplitude_m_s2": float(signal.amplitude_m_s2.mean()),
        "peak_amplitude_m_s2": float(signal.amplitude_m_s2.max()),
        "mean_frequency_hz": float(np.mean(signal.frequency_hz)),
    }
    console.say(
        f"{facts['length_mm']:.1f} mm in {facts['seconds']:.2f} s "
        f"({facts['speed_mm_s']:.1f} mm/s): amplitude {facts['mean_amplitude_m_s2']:.2f} m/s^2, "
        f"at most {facts['peak_amplitude_m_s2']:.2f}; {facts['mean_frequency_hz']:.0f} Hz"
    )
    notes, files = list(source.notes), []
    if facts["peak_amplitude_m_s2"] < _FAINT * float(played_range.amplitude_m_s2(1.0)):
        notes.append("hardly anything is felt: less than 1 % of the device's strongest")
    for path in options.output:
        written = stroke_files.write(signal, stroke, played_range, path)
        notes += [f"{path}: {note}" for note in written.notes]
        files += [str(file) for file in written.files]
        console.say(f"wrote {path}")
    for note in notes:
        console.warn(f"note: {note}")
    console.result({**facts, "files": files, "notes": notes})
    return 0


def _stroke_of(options: argparse.Namespace) -> Any:
    """Stroke from the options: along a line, or along the path of a file, at 100 mm/s by default,
    or with the file's own times. UsageError for options out of range or in conflict."""
    import numpy as np

    from hfx_blender.engine.texture import stroke

    speed = 100.0 if options.speed is None else options.speed
    if not 0.0 < speed <= 10_000.0:
        raise UsageError(f"--speed {speed:g}: expected mm a second, above 0, up to 10000")
    if not 1.0 <= options.rate <= 10_000.0:
        raise UsageError(f"--rate {options.rate:g}: expected 1 to 10000 Hz")
    if options.path is None:
        if options.start is None or options.end is None:
            raise UsageError("give --from and --to, or --path")
        path = np.array([options.start, options.end]) / 1000.0
        _refuse_long(path, speed)
        return stroke.along(path, speed / 1000.0, options.rate)
    if options.start is not None or options.end is not None:
        raise UsageError("give --path, or --from and --to, not both")
    table = path_table(options.path)
    # Positions alone are passed at a constant speed; positions with times are played as recorded.
    if table.shape[1] == 2:
        _refuse_long(table / 1000.0, speed)
        return stroke.along(table / 1000.0, speed / 1000.0, options.rate)
    if options.speed is not None:
        raise UsageError(f"{options.path} has times of its own: leave out --speed")
    timed = stroke.Stroke(table[:, 0], table[:, 1:] / 1000.0)
    _refuse_lasting(timed.duration_s)
    return timed


def _refuse_long(path_m: Any, speed_mm_s: float) -> None:
    """Raise TooLargeError for a path of too long a duration at a speed."""
    import numpy as np

    # Infinite and NaN coordinates give such a length, which the limit refuses.
    with np.errstate(over="ignore", invalid="ignore"):
        length_m = float(np.hypot(*np.diff(path_m, axis=0).T).sum())
    _refuse_lasting(1000.0 * length_m / speed_mm_s)


def _refuse_lasting(seconds: float) -> None:
    """Raise TooLargeError for a stroke beyond the limits of duration, or of memory of its WAV."""
    from hfx_blender.formats.signals.stroke_files import WAV_RATE_HZ

    limits.SECONDS.check(seconds, "Stroke", "it lasts")
    limits.MEMORY.check(8.0 * WAV_RATE_HZ * seconds, "Stroke", "its waveform would take")


def path_table(path: Path) -> Any:
    """Read rows x, y or time, x, y (n, 2 or 3) of a CSV file; a first line may be a heading.
    InputError for an unreadable file, rows of other lengths, or fewer than two rows."""
    import numpy as np

    refuse_no_file(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            # Spreadsheets of many languages separate columns by semicolons.
            rows.append([float(part) for part in line.replace(";", ",").split(",")])
        except ValueError as error:
            if number > 1:
                raise InputError(f"{path}: line {number} has no numbers: '{line[:60]}'.") from error
        # The first row of numbers decides between positions and positions with times.
        if rows and (len(rows[-1]) != len(rows[0]) or len(rows[0]) not in (2, 3)):
            raise InputError(f"{path}: line {number}: expected x,y or time,x,y in every line.")
    if len(rows) < 2:
        raise InputError(f"{path}: {len(rows)} positions; a stroke needs two.")
    return np.array(rows)


def _info(options: argparse.Namespace, console: Console) -> int:
    source = texture_source.read(options)
    haptic_map = source.map
    rows, columns = haptic_map.intensity.shape
    facts: dict[str, Any] = {
        "name": source.name,
        "size_mm": [1000.0 * length for length in haptic_map.size_m],
        "texels": [columns, rows],
        "tiles": haptic_map.tiles,
        "amplitude_g": list(haptic_map.device.amplitude_g),
        "frequency_hz": list(haptic_map.device.frequency_hz),
        "mean_intensity": float(haptic_map.intensity.mean()),
        "highest_intensity": float(haptic_map.intensity.max()),
        "mean_sharpness": float(haptic_map.sharpness.mean()),
        "notes": list(source.notes),
    }
    if source.height is not None:
        # A surface may be too small for the cut-off: a note, as the other facts hold.
        try:
            facts["roughness_um"] = _measured(source.height, options.cutoff)
        except InputError as error:
            facts["notes"].append(str(error))
    for key, value in facts.items():
        if key != "notes":
            console.say(f"{key:<18} {_short(value)}")
    for note in facts["notes"]:
        console.say(f"note: {note}")
    console.result(facts)
    return 0


def _short(value: Any) -> str:
    """Text of a fact: four digits, lists joined by "x", dicts by commas, "-" for None."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {_short(v)}" for k, v in value.items())
    if value is None:
        return "-"
    if isinstance(value, list):
        return " x ".join(_short(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _measured(height: Any, cutoff_mm: float) -> dict[str, float | None]:
    """Roughness along both axes: lengths in micrometres, Rsk and Rku as they are, None for
    undefined values. InputError for a surface shorter than the cut-off needs."""
    from math import pi

    from hfx_tools.roughness import LENGTHS, SHAPES, roughness_of_surface

    values: dict[str, float | None] = {}
    for axis, angle in (("x", 0.0), ("y", pi / 2.0)):
        roughness = roughness_of_surface(height, cutoff_mm / 1000.0, direction_rad=angle)
        for name in (*LENGTHS, *SHAPES):
            value = getattr(roughness, name)
            is_length = name in LENGTHS and value is not None
            values[f"{name.removesuffix('_m')}_{axis}"] = 1e6 * value if is_length else value
    return values


def _roughness(options: argparse.Namespace, console: Console) -> int:
    source = texture_source.read(options)
    if source.height is None:
        raise InputError(f"{options.source}: a map has no heights, so it has no roughness.")
    facts = _measured(source.height, options.cutoff)
    console.say(f"cut-off {options.cutoff:g} mm; lengths in um, Rsk and Rku without a unit")
    names = [key.removesuffix("_x") for key in facts if key.endswith("_x")]
    titles = {"rsm": "RSm"}
    console.say("along" + "".join(f"{titles.get(n, n.capitalize()):>10}" for n in names))
    for axis in "xy":
        values = (facts[f"{name}_{axis}"] for name in names)
        shown = ("-" if value is None else f"{value:.3f}" for value in values)
        console.say(f"{axis:<5}" + "".join(f"{text:>10}" for text in shown))
    console.result({"cutoff_mm": options.cutoff, **facts})
    return 0


def _list(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.engine.texture.procedural import MATERIALS

    facts = {}
    for material in MATERIALS.values():
        name, kind, size = material.name, material.kind, 1000.0 * material.size_m
        console.say(f"{name:<18} {kind:<8} {material.title:<18} {size:g} x {size:g} mm")
        facts[name] = {"kind": kind, "size_mm": size}
    console.result(facts)
    return 0
