# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx play``: plays a track or a game clip on devices in real time."""

from __future__ import annotations

import argparse
import io
import os
import secrets
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import asdict, replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.commands.export_options import add_profile
from hfx_blender.errors import (
    DeviceError,
    HfxError,
    InputError,
    OutputError,
    UsageError,
    refuse_no_file,
)
from hfx_blender.files import kinds

if TYPE_CHECKING:
    from hfx_blender.devices.live.approval import DeviceScript
    from hfx_blender.devices.live.client import LiveClient
    from hfx_blender.devices.live.live_settings import LiveSettings
    from hfx_blender.engine.rendering.device_config import DeviceConfig

    from .playback_loop import ValueSource

    Targets = dict[str, tuple[DeviceConfig, DeviceScript | None]]

_TOKEN: Final = "HFX_TOKEN"
_KINDS: Final = {
    "device": "DEVICE",
    "sound-card": "AUDIO",
    "simulator": "SIMULATOR",
    "log": "CSV",
    "page": "PAGE",
}


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "play",
        help="play a track or a game clip on devices",
        description="Play a track or a game clip once on devices, in real time, with their limits "
        "and stops. It ends in silence: at its end, after Ctrl-C, and after a fault.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a .hfxtrack or a .hfxclip")
    add_output_arguments(parser)
    add_profile(parser)
    parser.add_argument(
        "--body", metavar="NAME", help="body that wears the devices (default: the first)"
    )
    parser.add_argument(
        "--from", dest="begin", type=float, metavar="S", help="begin at this time, seconds"
    )
    parser.add_argument(
        "--listen",
        nargs="?",
        type=int,
        const=0,
        metavar="PORT",
        help="play values that a game on this computer sends, instead of the clip, until Ctrl-C "
        "(docs/players/devices.md)",
    )
    parser.add_argument(
        "--follow",
        metavar="PORT|midi:NAME",
        help="follow the time of another program until Ctrl-C: OSC /time and /rate at this UDP "
        "port, or MIDI time code of an input (docs/following-time.md)",
    )
    parser.add_argument(
        "--page",
        dest="to",
        action="store_const",
        const="page",
        help="short for --to page: a web page that vibrates a phone or gamepad",
    )
    parser.add_argument(
        "--listen-on",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="own address of --follow, --osc, --page (default: 127.0.0.1, this computer only; for "
        "a phone the address of this computer in the local network)",
    )
    add_osc_arguments(parser)
    add_json(parser, run)


def add_output_arguments(parser: argparse.ArgumentParser, *, needs_device: bool = True) -> None:
    """Add the options of devices and their outputs."""
    parser.add_argument(
        "--device",
        action="append",
        required=needs_device,
        metavar="NAME",
        help="device by name or file ('hfx device list'); repeat it for more",
    )
    parser.add_argument(
        "--to",
        choices=tuple(_KINDS),
        default="device",
        help="the device itself, or a substitute (default: device)",
    )
    parser.add_argument(
        "--port",
        action="append",
        help="serial or network port, or part of a sound card's name (default: as last connected "
        "in Blender, else as found by its USB ids or as configured); repeat it for each output of "
        "a device with several outputs",
    )
    parser.add_argument(
        "--unit",
        action="append",
        metavar="NAME",
        help="unit among several devices of one server: a name from 'hfx device find', or '#' and "
        "a number (default: as last connected, else the first free unit)",
    )
    parser.add_argument(
        "--host", action="append", help="host of a network device (default: as last connected)"
    )
    parser.add_argument(
        "--path", type=Path, metavar="FILE", help="file that a log or a simulator writes"
    )


def add_osc_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of received values."""
    parser.add_argument(
        "--osc",
        type=int,
        metavar="PORT",
        help="receive gain, mutes, values and triggers at this port (docs/osc-addresses.md)",
    )
    parser.add_argument(
        "--sender",
        metavar="ADDRESS",
        help="address or network of the only sender of poses and values (default: this computer "
        "and private networks)",
    )


def run(options: argparse.Namespace, console: Console) -> int:
    """Play the file to the end; DeviceError for devices that failed."""
    from ..persons.personal_client import PersonalClient
    from .playback_loop import fault_of, play

    # With --json standard output holds nothing but the result.
    write_note = console.warn if console.as_json else console.say
    names = list(dict.fromkeys(options.device))
    check_outputs(options, names)
    with ExitStack() as stack:
        address_note, progress = "", console.progress(options.file.name)
        with console.reading(options.file):
            source, targets = _opened(options, names, stack)
        if options.listen is None:
            start_s, end_s = source.start_s, source.end_s
            if options.begin is not None and not start_s <= options.begin < end_s:  # NaN, too
                raise UsageError(
                    f"--from {options.begin:g}: expected {start_s:g} to below {end_s:g} s"
                )
        else:
            # The game is the source from here on; the clip has served to check devices and columns.
            source, address_note = _listening(options, targets, stack)
            progress = no_progress
        clock = None
        if options.follow is not None:
            from .followed_clock import FollowedClock

            if options.listen is not None or options.begin is not None:
                raise UsageError("--follow is without --listen and --from")
            clock = stack.enter_context(closing(FollowedClock(options.follow, options.listen_on)))
            address_note = f"{options.file.name} follows the time from {clock.name}"
            progress = no_progress
        if options.osc is not None:
            source = _controlled(source, options, targets, stack)
        # Entered last, hence closed first: devices are silent before their source is closed.
        devices = {name: device for name, (device, _) in targets.items()}
        client = stack.enter_context(closing(PersonalClient(devices)))
        offset_ms = 0.0
        for name, (device, script) in targets.items():
            device_offset_ms = connect(client, name, (device, script), options, write_note)
            # Playback ends when the most delayed device has finished.
            offset_ms = max(offset_ms, device_offset_ms)
        try:
            failed = play(
                source,
                client,
                from_s=options.begin,
                offset_s=offset_ms / 1000.0,
                clock=clock,
                progress=progress,
                connected=lambda: write_note(address_note) if address_note else None,
                printed=console.warn,
            )
        except DeviceError as error:
            raise fault_of_log(options.path, client) or error from error
        units = {name: client.devices[name].unit for name in names}
        length_s = source.end_s - (source.start_s if options.begin is None else options.begin)
    if failed:
        raise fault_of_log(options.path, client) or DeviceError(" ".join(map(fault_of, failed)))
    on = ", ".join(f"{name}: {units[name]}" if units[name] else name for name in names)
    console.say(f"{options.file}: played {length_s:.2f} s on {on}")
    result = {"file": str(options.file), "devices": names, "seconds": round(length_s, 3)}
    console.result({**result, "units": units} if any(units.values()) else result)
    return 0


def connect(
    client: LiveClient,
    name: str,
    target: tuple[DeviceConfig, DeviceScript | None],
    options: argparse.Namespace,
    write_note: Callable[[str], None],
) -> float:
    """Connect a device, with its script if any, by the options; returns the delay of its values in
    milliseconds."""
    from hfx_blender.devices.configuration import is_file
    from hfx_blender.devices.live import live_settings
    from hfx_blender.devices.transports.page_output import PORT as PAGE_PORT
    from hfx_blender.files import resources

    device, script = target
    settings = connection_of(name, options)
    output = live_settings.target_of(device, settings)
    if settings.kind == "PAGE":
        output = {**output, "code": f"{secrets.randbelow(10**6):06d}", "waits": True}
        output["port"] = int(options.port[0] if options.port else PAGE_PORT)
        write_note(
            f"Open http://{output['host']}:{output['port']} on the phone and type "
            f"{output['code']}; playback begins then"
        )
        if sys.stdout.isatty() and not options.json:
            for line in qr_code(f"http://{output['host']}:{output['port']}", sys.stdout.encoding):
                write_note(line)
    client.connect(
        name,
        Path(name).absolute() if is_file(name) else name,
        output,
        folder=resources.user_devices(),
        script=None if script is None else script.as_request(),
        offset_ms=settings.offset_ms,
        profile=getattr(options, "profile", ""),
    )
    return settings.offset_ms


def qr_code(address: str, encoding: str) -> list[str]:
    """Lines of a QR code for a terminal with light text, two rows of the code in each line; empty
    for an encoding without block characters."""
    import segno

    text = io.StringIO()
    segno.make(address, micro=False).terminal(text, border=2, compact=True)
    try:
        text.getvalue().encode(encoding)
    except UnicodeEncodeError:
        return []
    return text.getvalue().splitlines()


def check_outputs(options: argparse.Namespace, names: list[str]) -> None:
    """Raise UsageError for ``--to log`` without a file, and for the address of a single device with
    several devices; returns nothing."""
    addresses = [option for option in ("port", "host", "path", "unit") if getattr(options, option)]
    if options.to == "log" and options.path is None:
        raise UsageError("--to log: give the file with --path")
    if options.to == "page" and options.port and not options.port[0].isdecimal():
        raise UsageError(f"--port {options.port[0][:20]}: expected a network port")
    if options.to == "page" and len(names) > 1:
        raise UsageError("--page is of one device; give one --device")
    if len(names) > 1 and addresses:
        raise UsageError(f"--{addresses[0]} is of one device; give one --device")


def fault_of_log(path: Path | None, client: LiveClient) -> HfxError | None:
    """OutputError for an unwritable file of ``--path``; None if the log is not the cause."""
    for state in client.devices.values():
        if path is not None and state.state == "lost" and state.text.startswith(f"{path} "):
            return OutputError(f"{state.text.removesuffix('.')}.")
    return None


def no_progress(share: float) -> None:
    """Show no progress: the end of a game is unknown."""


def _controlled(
    source: ValueSource, options: argparse.Namespace, targets: Targets, stack: ExitStack
) -> ValueSource:
    """Source whose values are changed by OSC messages; the receiver is closed with ``stack``."""
    from hfx_blender.tracking.receiver import PRIVATE

    from ..live_body.controlled_playback import ControlledSource
    from ..live_body.live_values import LiveValues
    from ..live_body.triggered_parts import TriggeredParts
    from .played_clip import PlayedClip

    if options.listen is not None:
        raise UsageError("--osc is without --listen: a game has strengths of its own")
    allowed = PRIVATE if options.sender is None else (options.sender,)
    values = LiveValues.listening(options.listen_on, options.osc, allowed)
    stack.enter_context(closing(values))
    devices = {name: device for name, (device, _) in targets.items()}
    parts = None
    if isinstance(source, PlayedClip):
        wearers = {name: (device, options.body) for name, device in devices.items()}
        parts = TriggeredParts(options.file, wearers)
    return ControlledSource(source, values, devices, parts)


def _listening(
    options: argparse.Namespace, targets: Targets, stack: ExitStack
) -> tuple[ValueSource, str]:
    """Open a port for a game's values, closed with ``stack``; returns the source and a note with
    address and token. UsageError for a track, ``--from``, or a token that is not hexadecimal."""
    from hfx_blender.formats.clip.container import SUFFIX

    from .game_door import ADDRESS, TOKEN_BYTES, GameDoor

    if not options.file.name.lower().endswith(SUFFIX) or options.begin is not None:
        raise UsageError("--listen is of a game clip, without --from")
    # The token is secret: an environment variable does not show in the list of processes.
    given = os.environ.get(_TOKEN, "")
    try:
        token = bytes.fromhex(given) or None
    except ValueError:
        # An empty token has the wrong length, which is reported below.
        token = b""
    if token is not None and len(token) != TOKEN_BYTES:
        raise UsageError(f"{_TOKEN}: expected {2 * TOKEN_BYTES} hexadecimal digits")
    devices = {name: device for name, (device, _) in targets.items()}
    door = stack.enter_context(closing(GameDoor(devices, options.listen, token)))
    shown = _TOKEN if given else door.token.hex()
    return door, f"{ADDRESS}:{door.port} takes the values of a game; token: {shown}"


def _opened(
    options: argparse.Namespace, names: list[str], stack: ExitStack
) -> tuple[ValueSource, Targets]:
    """Open the file and load the devices, with their scripts for a track and None for a clip.
    InputError for a file of another kind, or an unusable device."""
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.configurations.person_profile import personal
    from hfx_blender.devices.live import live_settings
    from hfx_blender.engine.track import SUFFIX as TRACK_SUFFIX
    from hfx_blender.files import resources
    from hfx_blender.formats.clip.container import SUFFIX

    from ..missing_models import refuse_missing
    from .played_clip import PlayedClip
    from .played_track import PlayedTrackSource

    if options.file.name.lower().endswith(SUFFIX):
        devices_of = {
            name: personal(load_device(name, resources.user_devices()), options.profile)
            for name in names
        }
        clip = PlayedClip(options.file, devices_of, options.body)
        return clip, {name: (device, None) for name, device in devices_of.items()}
    refuse_no_file(options.file)
    if options.file.suffix.lower() != TRACK_SUFFIX:
        raise InputError(
            f"{options.file}: is {kinds.title_of(options.file)}; expected a track ({TRACK_SUFFIX}) "
            f"or a game clip ({SUFFIX}), both written by hfx export."
        )
    # A track is rendered here, by the device's script if any; a clip is rendered already.
    track = stack.enter_context(PlayedTrackSource(options.file, options.body))
    refuse_missing(options.file, track.header)
    targets = {name: live_settings.named(name) for name in names}
    for device, _ in targets.values():
        personal(device, options.profile)  # raises for a profile without the device
    devices = [device for device, _ in targets.values()]
    track.silences = {name: device.neutral for name, (device, _) in targets.items()}
    track.latencies_ms = {ms for device in devices for ms in live_settings.latencies_ms(device)}
    return track, targets


def connection_of(name: str, options: argparse.Namespace) -> LiveSettings:
    """Connection of a device: from the options, else as last connected in Blender."""
    from hfx_blender.devices.live import live_settings

    # Addresses of another kind of connection do not apply; the measured delay does.
    known = live_settings.load().get(name, live_settings.LiveSettings())
    kind = _KINDS[options.to]
    if known.kind != kind:
        known = live_settings.LiveSettings(offset_ms=known.offset_ms)
    if kind == "PAGE":
        return live_settings.LiveSettings(kind, host=options.listen_on, offset_ms=known.offset_ms)
    rows = zip_longest(options.port or (), options.host or (), options.unit or (), fillvalue="")
    outputs = []
    for index, (port, host, unit) in enumerate(rows):
        last = known.of_output(index)
        unit = unit or ("" if port or host else last.unit)
        outputs.append(live_settings.PortSettings(port or last.port, host or last.host, unit))
    path = str(options.path or "")
    if not outputs:
        return replace(known, kind=kind, path=path)
    more = (*outputs[1:], *known.more[len(outputs) - 1 :])
    return replace(known, kind=kind, path=path, **asdict(outputs[0]), more=more)
