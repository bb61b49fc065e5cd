# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx device``: lists, checks, imports and approves devices and their scripts."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, refuse_no_file

from .info import describe_device

if TYPE_CHECKING:
    from hfx_blender.devices.live.approval import DeviceScript

_SHORTEST_HASH: Final = 8


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("device", help="device configurations")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="list devices for --device")
    finding = actions.add_parser(
        "find", help="list devices that can be connected now, with their units on a server"
    )
    check = actions.add_parser("check", help="list faults of a configuration file")
    check.add_argument("file", type=Path, metavar="FILE")
    _add_trial(
        check,
        "call the script next to the file even without an approval, with all of your rights; by "
        "default an approved script is called, another one only compiled",
    )
    imported = actions.add_parser(
        "import", help="make a device of a node map of VRChat haptics or a Unitouch layout (JSON)"
    )
    imported.add_argument("file", type=Path, metavar="FILE")
    imported.add_argument("--name", help="name of the device (default: that of the file)")
    scripts = actions.add_parser("scripts", help="list your device scripts and approved scripts")
    approve = actions.add_parser("approve", help="approve a device's script in its present state")
    approve.add_argument(
        "name", metavar="DEVICE", help="name of the device, or its configuration file"
    )
    approve.add_argument(
        "--hash", help="hash of the version that you have read; other versions are refused"
    )
    _add_trial(
        approve,
        "call the script first, with all of your rights, and refuse the approval if that fails; by "
        "default the script is only compiled",
    )
    revoke = actions.add_parser("revoke", help="withdraw an approval; a running script is stopped")
    revoke.add_argument("name", metavar="DEVICE|HASH", help="a device, or a hash of 'scripts'")
    for sub, function in (
        (listing, _list),
        (finding, _find),
        (check, _check),
        (imported, _import),
        (scripts, _scripts),
        (approve, _approve),
        (revoke, _revoke),
    ):
        add_json(sub, function)


def _add_trial(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--try", dest="is_tried", action="store_true", help=text)


def _list(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.configuration import list_devices, load_device

    names = list_devices()
    width = max(map(len, names))
    facts_of: dict[str, Any] = {}
    for name in names:
        try:
            facts = describe_device(load_device(name))
        except InputError as error:  # a faulty configuration of the user
            facts_of[name] = {"device": name, "fault": str(error)}
            console.warn(f"hfx: {error}")
            continue
        facts_of[name] = facts
        instead = "".join(
            f", {modality} as {substitute}" for modality, substitute in facts["instead"].items()
        )
        plays = ", ".join(facts["plays"])
        unit = "actuator " if facts["actuators"] == 1 else "actuators"
        console.say(f"{name:<{width}} {facts['actuators']:>4} {unit}  {plays}{instead}")
    console.result(facts_of)
    return 0


def _find(_options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.live.discovery import found_at
    from hfx_blender.files import resources

    ports, devices, faults = found_at(resources.user_devices())
    for fault in faults:
        console.warn(f"hfx: {fault}")
    for device in devices:
        where = f" --port {device.port}" if device.port else ""
        where += f" --unit '{device.unit}'" if device.unit and not device.port else ""
        console.say(f"--device {device.device}{where}: {device.description}")
    if not devices:
        console.say("no known device; serial ports: " + (", ".join(ports) or "none"))
    console.result({"devices": [asdict(device) for device in devices], "ports": ports})
    return 0


def _check(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.live import approval

    from .device_faults import faults_of
    from .script_faults import script_faults

    refuse_no_file(options.file)
    faults, notes = faults_of(options.file), []
    if not faults:
        device = load_device(options.file)
        script = approval.script_of(options.file)
        trial = script_faults(script, device, options.is_tried)
        faults, notes = [trial.fault] if trial.fault else [], trial.notes
        if script is not None and not (faults or options.is_tried or script.is_approved):
            notes.append(
                f"its script {script.path.name} was compiled, not called, as it is not approved; "
                "read it, then --try calls it with all of your rights"
            )
    for fault in faults:
        console.warn(fault)
    if not faults:
        console.say(f"{options.file}: is right")
        written = device.id if device.side is None else device.id.removesuffix(f"_{device.side}")
        if written != options.file.stem:
            console.say(
                f"note: its id is '{written}', and files that are written for it are named so; it "
                f"is found by the name of its file, '{options.file.stem}'"
            )
    for note in notes:
        console.say(f"note: {note}")
    console.result({"file": str(options.file), "faults": faults, "notes": notes})
    # Faults are the result of this command: no exception, but the exit code of a bad file.
    return InputError.exit_code if faults else 0


def _import(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.devices.configurations.imported_layouts import import_layout

    name = options.name or options.file.stem.lower().replace(" ", "_")
    path = import_layout(options.file, name)
    console.say(f"{path}: device '{name}'")
    console.result({"file": str(path), "device": name})
    return 0


def _scripts(_options: argparse.Namespace, console: Console) -> int:
    """List approved scripts by path, then the user's scripts without approval; returns 3 for a
    damaged list of approvals, else 0."""
    from hfx_blender.devices.live import approval

    fault = approval.fault_of_list()
    if fault:
        console.warn(f"hfx: {fault}")
    # Approved scripts first, by path; then scripts that wait for an approval.
    approved = sorted(approval.approved().items(), key=lambda entry: entry[1])
    entries = [{"script": path, "hash": mark, "is_approved": True} for mark, path in approved]
    # The fingerprint covers every byte: a changed script is not approved.
    now = {script.fingerprint: script for script in _own_scripts(console)}
    for mark, script in now.items():
        if not script.is_approved:
            entries.append({"script": str(script.path), "hash": mark, "is_approved": False})
    for entry in entries:
        state = "approved" if entry["is_approved"] else "not approved"
        if entry["is_approved"] and entry["hash"] not in now:
            state += " (changed since, gone, or in another folder)"
        console.say(f"{entry['hash']}  {entry['script']}: {state}")
    if not entries:
        console.say("no device scripts of your own")
    console.result({"scripts": entries, "fault": fault or None})
    return InputError.exit_code if fault else 0


def _own_scripts(console: Console) -> list[DeviceScript]:
    """Scripts in the user's device folder that belong to a configuration, sorted by path;
    unreadable scripts are left out with a warning."""
    from hfx_blender.devices.live import approval
    from hfx_blender.files import resources

    scripts = []
    for path in sorted(resources.user_devices().glob("*.py")):
        try:
            script = approval.script_of(path.with_suffix(".json"))
        except InputError as error:
            console.warn(f"hfx: {error}")
            continue
        if script is not None:
            scripts.append(script)
    return scripts


def _script_of(name: str) -> DeviceScript:
    """Script of a device; InputError for an unknown device or a device without a script."""
    from hfx_blender.devices.configuration import find_file
    from hfx_blender.devices.live import approval

    if find_file(name) is None:
        raise InputError(
            f"Device '{name[:100]}' is unknown; 'hfx device list' shows the known ones."
        )
    script = approval.script_of(name)
    if script is None:
        raise InputError(f"Device '{name[:100]}' has no script.")
    return script


def _approve(options: argparse.Namespace, console: Console) -> int:
    """Approve a device's script; InputError for another hash than given, or a configuration or
    script with faults. Shipped scripts need no approval. Returns 0."""
    from hfx_blender.devices.configuration import find_file, load_device
    from hfx_blender.devices.live import approval

    from .device_faults import faults_of
    from .script_faults import refuse_faulty_script

    script = _script_of(options.name)
    path = find_file(options.name)
    # A script of a device that cannot be loaded would never run.
    faults = faults_of(path) if path is not None else []
    if faults:
        more = f" (and {len(faults) - 1} more; see 'hfx device check')" if faults[1:] else ""
        raise InputError(f"{faults[0]}{more}")
    console.say(f"{script.path}")
    console.say(f"hash {script.fingerprint} (of script, configuration and interface)")
    if approval.is_shipped(script.path):
        console.say("is shipped: it needs no approval")
    else:
        # The hash names the version that the user has read; the file may have changed since.
        if options.hash is not None and options.hash.lower() != script.fingerprint:
            raise InputError(
                f"{script.path}: its hash is {script.fingerprint}, not {options.hash[:64]}; "
                "read it again."
            )
        # After the hash: a trial runs these bytes, which the user has read.
        device = load_device(options.name)
        for note in refuse_faulty_script(script, device, options.is_tried):
            console.say(f"note: {note}")
        approval.approve(script)
        console.say("approved: it runs with all of your rights until a byte of it changes")
    console.result({"script": str(script.path), "hash": script.fingerprint, "is_approved": True})
    return 0


def _revoke(options: argparse.Namespace, console: Console) -> int:
    """Withdraw the approval with the only hash that begins with 8 digits or more, else of a
    device's script. InputError for several hashes, and for a shipped script. Returns 0."""
    from hfx_blender.devices.live import approval

    digits = options.name.lower()
    # Shorter texts are names of devices, even of hexadecimal digits alone.
    is_long = len(digits) >= _SHORTEST_HASH
    marks = [mark for mark in approval.approved() if is_long and mark.startswith(digits)]
    if len(marks) > 1:
        raise InputError(
            f"'{options.name}' is the beginning of {len(marks)} hashes; give more digits."
        )
    if marks:
        approval.revoke_fingerprint(marks[0])
    else:
        script = _script_of(options.name)
        if approval.is_shipped(script.path):
            raise InputError(f"{script.path}: is shipped; its approval cannot be withdrawn.")
        approval.revoke(script)
    console.say(f"{options.name}: approval withdrawn")
    console.result({"withdrawn": options.name})
    return 0
