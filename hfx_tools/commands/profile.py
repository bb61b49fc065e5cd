# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx profile``: strengths that a person feels on devices."""

from __future__ import annotations

import argparse
import re
from contextlib import ExitStack, closing
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import DeviceError, UsageError

from .play import add_output_arguments, check_outputs, connect, fault_of_log


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("profile", help="strengths that a person feels on devices")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    make = actions.add_parser(
        "make",
        help="measure a person on a device, in two minutes",
        description="Raise the strength of up to 12 actuators in turn, within the limits of the "
        "device. The person presses Space when an actuator is first felt, strong enough, and too "
        "strong. The answers are stored for --profile; those of other devices remain.",
    )
    make.add_argument("name", metavar="NAME", help="name of the profile")
    add_output_arguments(make)
    listing = actions.add_parser("list", help="list profiles and their devices")
    remove = actions.add_parser("remove", help="remove a profile")
    remove.add_argument("name", metavar="NAME")
    for sub, function in ((make, _make), (listing, _list), (remove, _remove)):
        add_json(sub, function)


def _make(options: argparse.Namespace, console: Console) -> int:
    """Measure all given devices in turn and store the answers; nothing is stored after a fault."""
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.configurations import person_profile
    from hfx_blender.devices.configurations.device_shape import ID
    from hfx_blender.devices.live.client import LiveClient
    from hfx_blender.files import resources

    from ..persons.keys import terminal_keys
    from ..persons.walk import Walk
    from .playback_loop import fault_of, play

    if not re.fullmatch(ID.pattern, options.name):
        raise UsageError(f"profile name '{options.name[:100]}': expected {ID.note}")
    names = list(dict.fromkeys(options.device))
    check_outputs(options, names)
    if options.to == "page" or len(names) > 1:
        raise UsageError("profile make: expected one --device, not a page; repeat the command")
    write_note = console.warn if console.as_json else console.say
    device = load_device(names[0], resources.user_devices())
    with ExitStack() as stack:
        walk = Walk(names[0], device, stack.enter_context(terminal_keys()), write_note)
        client = stack.enter_context(closing(LiveClient()))
        connect(client, names[0], (device, None), options, write_note)
        failed = play(walk, client)
        if failed:
            texts = " ".join(map(fault_of, failed))
            raise fault_of_log(options.path, client) or DeviceError(texts)
    path = person_profile.store(options.name, device.id, walk.all_marks())
    console.say(f"{path}: {len(walk.marks)} actuators of '{device.id}' measured")
    console.result({"file": str(path), "device": device.id, "marks": walk.all_marks()})
    return 0


def _list(_options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.configurations import person_profile

    profiles = {name: list(person_profile.load(name)) for name in person_profile.names()}
    for name, devices in profiles.items():
        console.say(f"{name}: {', '.join(devices) or 'no device'}")
    if not profiles:
        console.say("no profile; 'hfx profile make' measures a person on a device")
    console.result(profiles)
    return 0


def _remove(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.configurations import person_profile
    from hfx_blender.files import resources

    person_profile.load(options.name)  # raises for an unknown profile
    path = resources.profiles() / f"{options.name}.json"
    path.unlink()
    console.say(f"{path}: removed")
    console.result({"file": str(path)})
    return 0
