# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx doctor``: shows versions, libraries, ports, folders and devices of this installation."""

import argparse
import contextlib
import getpass
import importlib
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from ..errors import HfxError
from ..files import resources
from ..processes import blender_session
from ..version import __version__
from .arguments import add_json
from .console import Console

_LIBRARIES: Final = {
    "numpy": "",
    "scipy": "fits of avatars, maps of surfaces",
    "trimesh": "fits of avatars",
    "fast_simplification": "levels of detail, mesh volumes",
    "serial": "serial ports",
    "websockets": "Buttplug, bHaptics",
    "pythonosc": "OSC",
    "sounddevice": "sound cards",
}
"""Import name -> what needs the library; "" for a library that is always there."""
_DISTRIBUTIONS: Final = {"serial": "pyserial", "pythonosc": "python-osc"}
_OTHER_FOLDERS: Final = re.compile(
    r"(?<![\w.~:/\\])(?:[A-Za-z]:)?[/\\](?=\S)"
    r"(?!(?:bin|dev|etc|lib\d*|opt|sbin|usr|Applications|Library|System|Windows|Program Files)\b)"
    r"[^/\\\":;,()\n]+(?:[/\\][^/\\\":;,()\n]+)*(?=[/\\])"
)
"""Folders of an absolute path in a text, up to the last name."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "doctor",
        help="what this installation has and lacks",
        description="Show versions, libraries, ports, sound cards, folders and devices of this "
        "installation, without personal paths. For a report of a problem.",
    )
    add_json(parser, run)


def run(_options: argparse.Namespace, console: Console) -> int:
    try:
        blender_session.start()
        fault = ""
    except Exception as error:  # also of a damaged module of Blender
        fault = str(error)
    facts = system_information(fault)
    console.say(as_text(facts), several_lines=True)
    console.result(facts)
    return 0


def as_text(facts: dict[str, str]) -> str:
    """Facts as lines of ``name: value``."""
    return "\n".join(f"{name}: {value}" for name, value in facts.items())


def system_information(blender_fault: str = "") -> dict[str, str]:
    """Facts of this installation and computer, in the order of a report.

    Parameters
    ----------
    blender_fault : str
        Reason why Blender's module is not loaded; empty if it is loaded.
    """
    kind = "extension" if __package__.startswith("bl_ext.") else "command"
    folders = {
        "body models": resources.body_models(),
        "the user's devices": resources.user_devices(),
        "the user's sensations": resources.user_effects(),
        "settings": resources.live_settings().parent,
    }
    facts = {
        "HFX": f"{__version__}, {kind}",
        "Blender": blender_fault or _fact(_blender),
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        "System": f"{platform.platform()}, {os.cpu_count()} processors",
        "Compiled part": _fact(_compiled_part),
    }
    facts |= {f"Library {name}": _library(name, use) for name, use in _LIBRARIES.items()}
    facts |= {
        "Serial ports": _fact(lambda: ", ".join(_ports()) or "none"),
        "Sound cards": _sound_cards(),
        **{f"Folder of {name}": _folder(path) for name, path in folders.items()},
        "Devices of the user": _fact(lambda: ", ".join(_own_devices()) or "none"),
        "Approved scripts": _fact(_approvals),
    }
    return {name: without_personal_names(value) for name, value in facts.items()}


def without_personal_names(text: str) -> str:
    """Text with ``~`` in place of the home folder, ``...`` in place of folders outside of the
    system's, such as mount points, and ``USER`` in place of the user's name."""
    home = Path(os.path.expanduser("~"))
    for folder in sorted({str(home), str(home.resolve())}, key=len, reverse=True):
        if folder != home.anchor:
            text = re.sub(rf"{re.escape(folder)}(?![\w.-])", "~", text)
    text = _OTHER_FOLDERS.sub("...", text)
    names = {home.name}
    with contextlib.suppress(OSError, KeyError, ImportError):  # a user without an entry
        names.add(getpass.getuser())
    for name in names - {""}:
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", "USER", text, flags=re.IGNORECASE)
    return text


def _fact(question: Callable[[], str]) -> str:
    """Answer of a function, or its error: a report is needed most for a damaged installation."""
    try:
        return question()
    except Exception as error:
        return f"unknown ({type(error).__name__}: {error})"


def _own_devices() -> Iterator[str]:
    from ..devices.configuration import load_device

    for path in sorted(resources.user_devices().glob("*.json")):
        try:
            load_device(path)
            yield path.stem
        except HfxError:
            yield f"{path.stem} (has a fault: hfx device check)"


def _compiled_part() -> str:
    from ..engine.native import library

    return library.state()


def _approvals() -> str:
    from ..devices.live import approval

    return approval.fault_of_list() or str(len(approval.approved()))


def _blender() -> str:
    import bpy

    kind = "without a window" if bpy.app.background else "with a window"
    build = bpy.app.build_hash.decode(errors="replace")
    is_online = getattr(bpy.app, "online_access", True)
    access = "allowed" if is_online else "not allowed (Preferences > System > Network)"
    return f"{bpy.app.version_string} ({build}), {kind}, online access {access}"


def _library(name: str, use: str) -> str:
    try:
        module = importlib.import_module(name)
    except Exception as error:  # OSError: sounddevice without PortAudio; any for a damaged library
        needed = f"; needed for {use}" if use else ""
        state = "missing" if isinstance(error, ModuleNotFoundError) else "cannot be loaded"
        return f"{state} ({error}){needed}"
    try:
        return version(_DISTRIBUTIONS.get(name, name.replace("_", "-")))
    except PackageNotFoundError:
        return str(getattr(module, "__version__", "of unknown version"))


def _ports() -> Iterator[str]:
    from ..devices.live.discovery import serial_ports

    for port in serial_ports():
        usb = "" if port.usb is None else f" {port.usb[0]:04x}:{port.usb[1]:04x}"
        is_open_to_user = sys.platform == "win32" or os.access(port.name, os.R_OK | os.W_OK)
        access = "" if is_open_to_user else ", no permission (group dialout or uucp)"
        yield f"{port.name} ({port.description}{usb}{access})"


def _sound_cards() -> str:
    try:
        import sounddevice

        cards = [card for card in sounddevice.query_devices() if card["max_output_channels"] > 0]
    except Exception as error:  # PortAudio's own errors, and a system without sound
        return f"none ({error})"
    names = (f"{card['name']} ({card['max_output_channels']} channels)" for card in cards)
    return ", ".join(names) or "none"


def _folder(path: Path) -> str:
    if not path.exists():
        return f"{path} (not there yet)"
    return f"{path}{'' if os.access(path, os.W_OK) else ' (read only)'}"
