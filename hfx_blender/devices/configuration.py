# SPDX-License-Identifier: GPL-3.0-or-later
"""Device configurations: one JSON file a device, read strictly.

``docs/device-configuration.md`` describes the format. A configuration holds facts only: no
code, no path, nothing to open.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..engine.body.model import PerceptualModel, load_model, manifest
from ..engine.modality import MODALITIES
from ..engine.rendering.actuator_vertices import vertices_of
from ..engine.rendering.device_config import Actuator, DeviceConfig, ScriptFiles, VertexPlace
from ..errors import InputError
from ..files import resources
from ..files.json_shapes import read
from .configurations import surface_calibration
from .configurations.configuration_reader import device_from
from .configurations.device_shape import ID, WEARABLE_SIDES

SUFFIX: Final = ".json"
SCRIPT_SUFFIX: Final = ".py"
_OTHER_SIDE: Final = {"left": "right", "right": "left"}


def list_devices(folder: Path | None = None) -> list[str]:
    """Names that :func:`load_device` takes: the shipped devices and those of a folder.

    A device for one side of the body is listed once for each side, a file that cannot be
    read by its own name.
    """
    names: set[str] = set()
    for each in _folders(folder):
        for path in each.glob("*" + SUFFIX) if each.is_dir() else ():
            names.update(_names(path))
    return sorted(names)


def _folders(folder: Path | None) -> tuple[Path, Path]:
    """Folders to search for a device: the user's own, or another; then the shipped one."""
    return folder or resources.user_devices(), resources.device_configs()


def _names(path: Path) -> list[str]:
    try:
        side = load_device(path).side
    except InputError:
        return [path.stem]
    return [path.stem] if side is None else [f"{path.stem}_{each}" for each in WEARABLE_SIDES]


def load_device(name_or_path: str | Path, folder: Path | None = None) -> DeviceConfig:
    """Read a device configuration.

    Parameters
    ----------
    name_or_path : str or Path
        A name of :func:`list_devices`, or a file (a ``Path``, or text with a folder in it or
        ending in ``.json``). A device that can be worn on either side takes ``_left`` or
        ``_right`` after its name, and after its file's name; alone it is as it was written.
    folder : Path, optional
        Configurations that go before shipped ones of the same name; without, the user's own.

    What the user has calibrated for it comes along.

    Raises
    ------
    InputError
        There is no such device, or its file is not a valid configuration.
    """
    device = _found(name_or_path, folder)
    own = surface_calibration.of_device(str(name_or_path), device.id)
    return device if own is None else replace(device, surface_drive_per_m=own)


def named_in_blend(name: str) -> str:
    """Return the name of a device that a .blend gives, for :func:`load_device`.

    Raises
    ------
    InputError
        :func:`load_device` would take it for a file: a .blend never chooses files.
    """
    if is_file(name):
        raise InputError(
            f"The scene asks for the device file '{name[:100]}': a .blend may name devices only, "
            "it never chooses files. Choose the file with --device."
        )
    return name


def is_file(name_or_path: str | Path) -> bool:
    text = str(name_or_path)
    return isinstance(name_or_path, Path) or text.endswith(SUFFIX) or "/" in text or "\\" in text


def _found(name_or_path: str | Path, folder: Path | None) -> DeviceConfig:
    text = str(name_or_path)
    if is_file(name_or_path):
        return _on_side(Path(text)) or _read(Path(text))
    for each in _folders(folder) if re.fullmatch(ID.pattern, text) else ():
        device = _on_side(each / (text + SUFFIX))
        if device is not None:
            return device
    known = ", ".join(list_devices(folder)) or "none"
    raise InputError(f"Device '{text[:100]}' is unknown; there are: {known}.")


def find_file(name_or_path: str | Path, folder: Path | None = None) -> Path | None:
    """File that :func:`load_device` reads for the same arguments; None if there is none."""
    text = str(name_or_path)
    if is_file(name_or_path):
        paths = [Path(text)]
    else:
        paths = [each / (text + SUFFIX) for each in _folders(folder)]
    for path in paths:
        stem, _, side = path.stem.rpartition("_")
        written = path.with_name(stem + SUFFIX) if stem and side in WEARABLE_SIDES else path
        for found in (path, written):
            if found.is_file():
                return found
    return None


def _on_side(path: Path) -> DeviceConfig | None:
    """The device of a file, or of the file without ``_left`` or ``_right``; None: neither."""
    if path.is_file():
        return _with_script(_read(path), path, path)
    stem, _, side = path.stem.rpartition("_")
    written = path.with_name(stem + SUFFIX) if stem else path
    if side not in WEARABLE_SIDES or not written.is_file():
        return None
    device = _with_script(_read(written), written, path)
    if device.side is None:
        return None
    return device if device.side == side else _mirrored(device)


def script_beside(configuration: Path) -> Path | None:
    """The script of a device, ``<device>.py`` beside its configuration; None: it has none."""
    script = configuration.with_suffix(SCRIPT_SUFFIX)
    return script if script.is_file() else None


def _with_script(device: DeviceConfig, configuration: Path, loaded: Path) -> DeviceConfig:
    script = script_beside(configuration)
    if script is None:
        return device
    files = ScriptFiles(script.absolute(), configuration.absolute(), loaded.absolute())
    return replace(device, script=files)


def check(path: Path, models: Callable[[str], PerceptualModel] | None = load_model) -> list[str]:
    """Faults of a configuration file, each one sentence; empty if it can be used.

    Reading stops at the first fault. What can be read is then placed on the shipped
    perceptual models (``models`` None: is not), and every actuator that does not fit is told.
    """
    try:
        device = _read(path)
    except InputError as error:
        return [str(error)]
    return _placing_faults(device, path, models) if models is not None else []


def _placing_faults(
    device: DeviceConfig, path: Path, models: Callable[[str], PerceptualModel]
) -> list[str]:
    faults = []
    for i, actuator in enumerate(device.actuators):
        sources = [s.source for s in device.substitutions.values()]
        felt = [each for each in sources if _shows(device, each, actuator)]
        used = {MODALITIES[each].model for each in [actuator.type.modality, *felt]}
        ids = {id for id, each in manifest()["models"].items() if each["modality"] in used}
        if isinstance(actuator.place, VertexPlace):
            ids = {each.model_id for each in actuator.place.sets}
        for model_id in sorted(ids):
            try:
                vertices_of(actuator.place, models(model_id))
            except InputError as error:
                faults.append(f"{path}: actuators[{i}].place: {error}")
                break
    return faults


def _shows(device: DeviceConfig, source: str, actuator: Actuator) -> bool:
    return device.substitutions[source].target == actuator.type.modality


def _mirrored(device: DeviceConfig) -> DeviceConfig:
    side = _OTHER_SIDE[str(device.side)]
    return replace(
        device,
        id=device.id.removesuffix(f"_{device.side}") + f"_{side}",
        name=device.name.removesuffix(f" ({device.side})") + f" ({side})",
        side=side,
        is_mirrored=not device.is_mirrored,
    )


def _read(path: Path) -> DeviceConfig:
    return device_from(read(path))
