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

    found = {name: describe_device(load_device(name)) for name in list_devices()}
    for name, facts in found.items():
        instead = "".join(f", {a} as {b}" for a, b in facts["instead"].items())
        plays = ", ".join(facts["plays"])
        console.say(f"{name:<20} {facts['actuators']:>3} actuators  {plays}{instead}")
    console.result(found)
    return 0


def _check(options: argparse.Namespace, console: Console) -> int:
    from ..devices.configuration import check

    if not options.file.is_file():
        raise InputError(f"{options.file}: there is no such file.")
    faults = check(options.file)
    for fault in faults:
        console.warn(fault)
    if not faults:
        console.say(f"{options.file}: is right")
    console.result({"file": str(options.file), "faults": faults})
    return InputError.exit_code if faults else 0


def _import(options: argparse.Namespace, console: Console) -> int:
    from ..devices.node_map import import_node_map

    name = options.name or options.file.stem.lower().replace(" ", "_")
    made = import_node_map(options.file, name)
    console.say(f"{made}: device '{name}'")
    console.result({"file": str(made), "device": name})
    return 0
