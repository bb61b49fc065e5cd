# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic maps as files: two grey PNG layers, and a JSON file with the meaning of their values.

Both layers are linear, 0 to full code: intensity is a share of the amplitude range, sharpness of
the frequency range. The JSON file names the layers in the same folder.
"""

from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ...engine.texture.haptic_map import DeviceRange, HapticMap, NoticeableSteps
from ...errors import InputError
from ...files import kinds
from ...files.json_shapes import Anything, Flag, Number, Text, numbers, strict
from ...files.json_shapes import read as read_json
from ...files.kinds import refuse_another
from ..written import Written, write_json
from . import png

SUFFIX: Final = kinds.TEXTURE_MAP_SUFFIX
_FORMAT: Final = "hfx-texture-map"
_VERSION: Final = 1
_LAYERS: Final = ("intensity", "sharpness")
_MAP: Final = strict(
    {
        "format": Text((_FORMAT,)),
        "version": Number(_VERSION, _VERSION),
        "layers": strict(dict.fromkeys(_LAYERS, Anything())),
        "size_mm": numbers(2, 0.0, 1e6, "mm"),
        "amplitude_g": numbers(2, 0.0, 1e3),
        "frequency_hz": numbers(2, 0.0, 1e5, "Hz"),
    },
    {
        "tiles": Flag(),
        "carrier_hz": Number(0.0, 1e5, "Hz"),
        "update_ms": Number(0.0, 1e6, "ms"),
        "steps": Anything(),
        **dict.fromkeys(("name", "bits", "about"), Anything()),
    },
)
_STEPS: Final = strict(
    {"amplitude_g": Number(0.0, 1e3), "frequency_hz": Number(0.0, 1e5, "Hz")}, into=NoticeableSteps
)


def write(map_: HapticMap, stem: Path, bits: Literal[8, 16] = 16, name: str = "") -> Written:
    """Write ``stem.intensity.png``, ``stem.sharpness.png`` and ``stem.texture.json``.

    ``name`` goes into the JSON file; by default the last part of ``stem``. Returns the paths, JSON
    first, without losses or notes. Raises OutputError for an unwritable file (files already written
    stay), ValueError for ``bits`` other than 8 or 16.
    """
    if bits not in (8, 16):
        raise ValueError(f"bits: expected 8 or 16, got {bits}")
    files = write_layers({layer: getattr(map_, layer) for layer in _LAYERS}, stem, bits)
    device, steps = map_.device, map_.steps
    document: dict[str, Any] = {
        "format": _FORMAT,
        "version": _VERSION,
        "name": name or stem.name,
        "layers": {layer: path.name for layer, path in files.items()},
        "bits": bits,
        "size_mm": [1e3 * s for s in map_.size_m],
        "tiles": map_.tiles,
        "amplitude_g": list(device.amplitude_g),
        "frequency_hz": list(device.frequency_hz),
        "carrier_hz": device.carrier_hz,
        "update_ms": 1e3 * device.update_s,
        "steps": None
        if steps is None
        else {"amplitude_g": steps.amplitude_g, "frequency_hz": steps.frequency_hz},
        "about": "Linear values. Intensity 0 is silent, full code is the highest amplitude "
        "(peak); sharpness 0 is the lowest frequency (rough), full code the highest (smooth).",
    }
    # The JSON file comes last: readers begin with it, and its layers are complete then.
    path = stem.with_name(stem.name + SUFFIX)
    write_json(document, path)
    return Written((path, *files.values()))


def write_layers(
    layers: dict[str, npt.NDArray[np.floating[Any]]], stem: Path, bits: int
) -> dict[str, Path]:
    """Write each layer (H, W), 0..1, bottom row first, as ``stem.<name>.png`` of 8 or 16 ``bits``;
    returns the paths by name. Raises OutputError for an unwritable file."""
    files = {name: stem.with_name(f"{stem.name}.{name}.png") for name in layers}
    for name, path in files.items():
        # PNG has the top row first.
        codes = np.rint(layers[name][::-1].astype(np.float64) * ((1 << bits) - 1))
        png.write(codes.astype(np.uint8 if bits == 8 else np.uint16), path)
    return files


def read(path: Path) -> HapticMap:
    """Read a map by the path of the JSON file; its layers are in the same folder. Raises InputError
    for a missing or damaged file, a layer elsewhere, layers of different sizes, or invalid
    values."""
    document = read_json(path)
    refuse_another(document.value, document.file, _FORMAT)
    members = document.read(_MAP)
    layers: list[npt.NDArray[np.float32]] = []
    for node in (document["layers"][name] for name in _LAYERS):
        # A name with a folder could point to any file of the computer.
        name = node.value
        if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
            node.fail("the name of a picture in the same folder")
        codes, _ = png.read(path.parent / name)
        shares = codes[::-1].astype(np.float64) / np.iinfo(codes.dtype).max
        layers.append(shares.astype(np.float32))
    intensity, sharpness = layers
    width, height = members["size_mm"]
    rows, columns = intensity.shape
    has_steps = members.get("steps") is not None
    try:
        device = DeviceRange(
            members["amplitude_g"],
            members["frequency_hz"],
            members.get("carrier_hz", 160.0),
            1e-3 * members.get("update_ms", 50.0),
        )
        return HapticMap(
            intensity,
            sharpness,
            (1e-3 * width / columns, 1e-3 * height / rows),
            members.get("tiles", True),
            device,
            document["steps"].read(_STEPS) if has_steps else None,
        )
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from error
