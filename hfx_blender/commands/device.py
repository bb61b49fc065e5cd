# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx device``: which devices there are, and whether a configuration is right."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from .info import describe_device


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("device", help="device configurations")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="the devices that --device takes")
    check = actions.add_parser("check", help="faults of a configuration file")
    check.add_argument("file", type=Path, metavar="FILE")
    imported = actions.add_parser(
        "import", help="make a device of a node map of VRChat haptics or a Unitouch layout (JSON)"
    )
    imported.add_argument("file", type=Path, metavar="FILE")
    imported.add_argument("--name", help="of the device (default: the file's)")
    for sub, function in ((listing, _list), (check, _check), (imported, _import)):
        sub.add_argument("--json", action="store_true", help="the result as JSON")
        sub.set_defaults(run=function)


def _list(options: argparse.Namespace, console: Console) -> int:
    from ..devices.configuration import list_devices, load_device

    names = list_devices()
    width = max(map(len, names))
    found: dict[str, Any] = {}
    for name in names:
        try:
            facts = describe_device(load_device(name))
        except InputError as error:  # one of the user's own
            found[name] = {"device": name, "fault": str(error)}
            console.warn(f"hfx: {error}")
            continue
        found[name] = facts
        instead = "".join(f", {a} as {b}" for a, b in facts["instead"].items())
        plays = ", ".join(facts["plays"])
        console.say(f"{name:<{width}} {facts['actuators']:>4} actuators  {plays}{instead}")
    console.result(found)
    return 0


def _check(options: argparse.Namespace, console: Console) -> int:
    from ..devices.configuration import check, load_device

    if not options.file.is_file():
        what = "is a folder" if options.file.is_dir() else "there is no such file"
        raise InputError(f"{options.file}: {what}.")
    faults = check(options.file)
    for fault in faults:
        console.warn(fault)
    if not faults:
        console.say(f"{options.file}: is right")
        device = load_device(options.file)
        written = device.id if device.side is None else device.id.removesuffix(f"_{device.side}")
        if written != options.file.stem:
            console.say(
                f"note: its id is '{written}', and files that are written for it are named so; it "
                f"is found by the name of its file, '{options.file.stem}'"
            )
    console.result({"file": str(options.file), "faults": faults})
    return InputError.exit_code if faults else 0


def _import(options: argparse.Namespace, console: Console) -> int:
    from ..devices.node_map import import_node_map

    name = options.name or options.file.stem.lower().replace(" ", "_")
    made = import_node_map(options.file, name)
    console.say(f"{made}: device '{name}'")
    console.result({"file": str(made), "device": name})
    return 0
