# SPDX-License-Identifier: GPL-3.0-or-later
"""Device configurations: a JSON file for each device, found by name and read strictly.

``docs/device-configuration.md`` describes the format. A configuration has no code and no paths.
"""

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..engine.rendering.device_config import DeviceConfig, ScriptFiles
from ..errors import InputError
from ..files import resources
from ..files.json_shapes import read
from .configurations import surface_calibration
from .configurations.configuration_reader import device_from
from .configurations.device_shape import ID, WEARABLE_SIDES

SUFFIX: Final = ".json"


def list_devices(folder: Path | None = None) -> list[str]:
    """Names for :func:`load_device`, sorted: shipped devices and devices of a folder.

    ``folder`` None is the user's own. A device for one side of the body has a name for each side;
    an unreadable file has the stem as name.
    """
    names: set[str] = set()
    for parent in _folders(folder):
        for path in parent.glob("*" + SUFFIX) if parent.is_dir() else ():
            side = None
            with suppress(InputError):
                side = load_device(path).side
            sides = WEARABLE_SIDES if side is not None else ()
            names.update([f"{path.stem}_{name}" for name in sides] or [path.stem])
    return sorted(names)


def _folders(folder: Path | None) -> tuple[Path, Path]:
    """Folders of configurations in search order: ``folder`` (None: the user's), then shipped."""
    return folder or resources.user_devices(), resources.device_configs()


def load_device(name_or_path: str | Path, folder: Path | None = None) -> DeviceConfig:
    """Read a device configuration, with the user's calibration of the device.

    ``name_or_path``: name of :func:`list_devices`, or a file: a ``Path``, or text with a folder or
    with the suffix ``.json``. ``_left`` or ``_right`` after the name, or after the file's stem,
    chooses the side of a device for one side of the body; by default as in the file.
    ``folder``: configurations with precedence over shipped ones of the same name; None: the user's.

    Raises InputError: the device is unknown, or its file is no valid configuration.
    """
    device = _find(name_or_path, folder)
    own = surface_calibration.of_device(str(name_or_path), device.id)
    return device if own is None else replace(device, surface_drive_per_m=own)


def named_in_blend(name: str) -> str:
    """Return a device name of a .blend unchanged; InputError if :func:`load_device` would read
    it as a file, as a .blend must not choose files."""
    if is_file(name):
        raise InputError(
            f"The scene asks for the device file '{name[:100]}': a .blend may name devices only, "
            "it never chooses files. Choose the file with --device."
        )
    return name


def is_file(name_or_path: str | Path) -> bool:
    """Test for an argument that :func:`load_device` reads as a file, not as a name: a ``Path``, or
    text with ``/``, ``\\`` or the suffix ``.json``. The file need not exist."""
    text = str(name_or_path).lower()
    return isinstance(name_or_path, Path) or text.endswith(SUFFIX) or "/" in text or "\\" in text


def _find(name_or_path: str | Path, folder: Path | None) -> DeviceConfig:
    for path in _paths(name_or_path, folder):
        device = _on_side(path)
        if device is not None:
            return device
    text = str(name_or_path)
    if is_file(name_or_path):
        return device_from(read(Path(text)))  # raises: no such file, or no device with sides
    known = ", ".join(list_devices(folder)) or "none"
    if not text:
        raise InputError(f"A device's name is missing; there are: {known}.")
    raise InputError(f"Device '{text[:100]}' is unknown; there are: {known}.")


def _paths(name_or_path: str | Path, folder: Path | None) -> list[Path]:
    """Paths to try, first hit first, which need not exist: a file as given, or ``<name>.json`` in
    each folder; empty for a name with characters outside :data:`ID`."""
    text = str(name_or_path)
    if is_file(name_or_path):
        return [Path(text)]
    is_name = re.fullmatch(ID.pattern, text) is not None
    return [parent / (text + SUFFIX) for parent in _folders(folder) if is_name]


def find_file(name_or_path: str | Path, folder: Path | None = None) -> Path | None:
    """File read by :func:`load_device` for the same arguments; None without a file. A missing file
    with ``_left`` or ``_right`` is tried without this suffix, in each folder."""
    for path in _paths(name_or_path, folder):
        stem, _, side = path.stem.rpartition("_")
        sided = path.with_name(stem + SUFFIX) if stem and side in WEARABLE_SIDES else path
        for candidate in (path, sided):
            if candidate.is_file():
                return candidate
    return None


def _on_side(path: Path) -> DeviceConfig | None:
    """Read ``path`` if it exists; else the file without ``_left`` or ``_right`` for that side,
    mirrored if the file has the opposite side. None without either, or if the device has no side.
    """
    if path.is_file():
        return _with_script(device_from(read(path)), path, path)
    stem, _, side = path.stem.rpartition("_")
    written = path.with_name(stem + SUFFIX) if stem else path
    if side not in WEARABLE_SIDES or not written.is_file():
        return None
    device = _with_script(device_from(read(written)), written, path)
    if device.side is None:
        return None  # a device for both sides cannot be mirrored
    if device.side == side:
        return device
    # Id and name end with the side of the file, as "_left" and " (left)".
    return replace(
        device,
        id=f"{device.id.removesuffix(f'_{device.side}')}_{side}",
        name=f"{device.name.removesuffix(f' ({device.side})')} ({side})",
        side=side,
        is_mirrored=not device.is_mirrored,
    )


def script_beside(configuration: Path) -> Path | None:
    """Script of a device, ``<device>.py`` next to the configuration, or None."""
    script = configuration.with_suffix(".py")
    return script if script.is_file() else None


def _with_script(device: DeviceConfig, configuration: Path, loaded: Path) -> DeviceConfig:
    """Copy of a device with the script next to ``configuration``; ``device`` itself without one.
    ``loaded``: requested path, with the side in its name."""
    script = script_beside(configuration)
    if script is None:
        return device
    files = ScriptFiles(script.absolute(), configuration.absolute(), loaded.absolute())
    return replace(device, script=files)
