# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx feel``: touch of a game clip on tracked bodies, on devices in real time."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack, closing
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.commands.export_options import add_profile
from hfx_blender.errors import DeviceError, UsageError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.tracking.receiver import PRIVATE, OscReceiver
from hfx_blender.tracking.vmc_body import VmcBody

from .play import (
    add_osc_arguments,
    add_output_arguments,
    check_outputs,
    connect,
    fault_of_log,
    no_progress,
)

if TYPE_CHECKING:
    from hfx_blender.engine.arrays import F64
    from hfx_blender.engine.rendering.device_config import DeviceConfig

VMC_PORT: Final = 39539
"""Port on which the protocol's receivers listen."""

_RECORD_HZ: Final = 100


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "feel",
        help="feel a game clip on tracked bodies",
        description="Evaluate the spatial part of a game clip on bodies that motion trackers send "
        "(VMC protocol), and play the values on devices with their limits and stops, until "
        "Ctrl-C. A lost sender fades to silence within 2 s.",
    )
    parser.add_argument("file", type=Path, metavar="CLIP", help="a .hfxclip with bodies")
    add_output_arguments(parser)
    add_profile(parser)
    parser.add_argument(
        "--vmc",
        type=int,
        metavar="PORT",
        help=f"port of the tracked body (default: {VMC_PORT}); the first device's body follows it",
    )
    parser.add_argument(
        "--body",
        action="append",
        metavar="NAME=PORT",
        help="tracked body of the clip and its port, instead of --vmc; repeat it for more",
    )
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="end after this time (default: at Ctrl-C)"
    )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="write the values of the device as .csv or .jsonl, or the touch as .hfxtrack, for any "
        "export",
    )
    parser.add_argument(
        "--sound",
        metavar="L",
        help="also play the volumes as sound around the tracked head: loudspeakers as of "
        "'hfx sound', such as stereo",
    )
    parser.add_argument(
        "--sound-card", default="", metavar="NAME", help="part of the card's name for --sound"
    )
    parser.add_argument(
        "--at",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Y"),
        help="place of the tracked room's origin on the floor of the scene, metres (default: 0 0)",
    )
    parser.add_argument(
        "--listen-on",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address of this computer that receives (default: 127.0.0.1, this computer only)",
    )
    add_osc_arguments(parser)
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Play until the end; DeviceError for devices that failed."""
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.configurations.person_profile import personal
    from hfx_blender.engine.track import SUFFIX
    from hfx_blender.files import resources

    from ..live_body.felt_bodies import FeltBodies
    from ..live_body.live_values import LiveValues
    from ..persons.personal_client import PersonalClient
    from .playback_loop import fault_of, play

    names = list(dict.fromkeys(options.device))
    check_outputs(options, names)
    if options.seconds is not None and not 0.0 < options.seconds < np.inf:
        raise UsageError(f"--seconds {options.seconds:g}: expected more than 0")
    suffix = ".csv" if options.record is None else options.record.suffix.lower()
    is_track = suffix == SUFFIX
    if not is_track and (suffix not in _RECORDS or (options.record is not None and len(names) > 1)):
        raise UsageError(
            "--record: expected a name that ends in .hfxtrack, or one --device and a name that "
            "ends in .csv or .jsonl"
        )
    if not all(abs(metres) <= 10_000.0 for metres in options.at):
        raise UsageError("--at: expected two numbers from -10000 to 10000")
    write_note = console.warn if console.as_json else console.say
    allowed = PRIVATE if options.sender is None else (options.sender,)
    with ExitStack() as stack:
        devices = {
            name: personal(load_device(name, resources.user_devices()), options.profile)
            for name in names
        }
        ports: dict[str, OscReceiver] = {}
        for body, port in _ports(options).items():
            receiver = OscReceiver(
                options.listen_on, port, allowed, VmcBody.is_used, is_single=True
            )
            ports[body] = stack.enter_context(closing(receiver))
        values = LiveValues()
        if options.osc is not None:
            values = LiveValues.listening(options.listen_on, options.osc, allowed)
            stack.enter_context(closing(values))
        with console.reading(options.file):
            source = FeltBodies(options.file, devices, ports, values, write_note, tuple(options.at))
        if options.sound is not None:
            from ..live_body.live_sound import LiveSound
            from ..spatial_sound.loudspeakers import parse
            from ..spatial_sound.sound_settings import SoundSettings

            settings = SoundSettings(layout=parse(options.sound))
            stack.enter_context(closing(LiveSound(source, settings, options.sound_card)))
        if options.seconds is not None:
            source.end_s = options.seconds
        if is_track:
            with console.reading(options.file):
                stack.callback(source.record().write, options.record)
        elif options.record is not None:
            # Written at every end, so also after Ctrl-C; devices are silent by then.
            rows, device = source.recorded[names[0]], devices[names[0]]
            stack.callback(_RECORDS[suffix], options.record, rows, device)
        client = stack.enter_context(closing(PersonalClient(devices)))
        offsets_ms = [
            connect(client, name, (device, None), options, write_note)
            for name, device in devices.items()
        ]
        listening = ", ".join(
            f"'{body}' at port {each.receiver.port}" for body, each in source.bodies.items()
        )
        if values.receiver is not None:
            listening += f"; values at port {values.receiver.port}"
        try:
            failed = play(
                source,
                client,
                offset_s=max(offsets_ms) / 1000.0,
                progress=no_progress,
                connected=lambda: write_note(f"{options.listen_on} receives {listening}"),
            )
        except DeviceError as error:
            raise fault_of_log(options.path, client) or error from error
    if failed:
        raise fault_of_log(options.path, client) or DeviceError(" ".join(map(fault_of, failed)))
    console.say(f"{options.file}: felt for {source.end_s:.2f} s on {', '.join(names)}")
    console.result({"file": str(options.file), "devices": names, "seconds": source.end_s})
    return 0


def _ports(options: argparse.Namespace) -> dict[str, int]:
    """Port by body of the clip; "" is the body of the first device. UsageError for an invalid
    option."""
    if options.body and options.vmc is not None:
        raise UsageError("--vmc is the port of a single body; give --body NAME=PORT for each body")
    ports = {} if options.body else {"": VMC_PORT if options.vmc is None else options.vmc}
    for text in options.body or ():
        name, separator, port = text.rpartition("=")
        if not separator or not port.isascii() or not port.isdigit() or not name:
            raise UsageError(f"--body {text[:100]}: expected NAME=PORT, as Anna=39540")
        if name in ports:
            raise UsageError(f"--body {name[:100]}: it is given twice")
        ports[name] = int(port)
    return ports


def _record_lines(path: Path, rows: list[tuple[float, F64]], _device: DeviceConfig) -> None:
    """Write each row at its own time, as a line of a simulator's log."""
    with atomic_file(path) as file:
        for time_s, values in rows:
            line = json.dumps({"time_s": round(time_s, 6), "values": values.tolist()})
            file.write(line.encode() + b"\n")


def _record(path: Path, rows: list[tuple[float, F64]], device: DeviceConfig) -> None:
    """Write values over time as a raster of 100 rows a second; each row has the latest values."""
    from hfx_blender.engine.rendering.raster import Raster, columns_of
    from hfx_blender.formats.rasters import csv_raster

    if not rows:
        return
    times_s = np.array([time_s for time_s, _ in rows])
    clock_s = np.arange(0, times_s[-1] + 1.0 / _RECORD_HZ, 1.0 / _RECORD_HZ)
    latest = np.maximum(np.searchsorted(times_s, clock_s, side="right") - 1, 0)
    raster = Raster(
        device.id,
        "",
        tuple(actuator.id for actuator in device.actuators),
        columns_of(device),
        clock_s,
        Fraction(_RECORD_HZ),
        np.array([values for _, values in rows])[latest],
        device.neutral,
        (),
        (),
    )
    csv_raster.write(raster, path)


_RECORDS: Final = {".csv": _record, ".jsonl": _record_lines}
