# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters of stimuli: names by kind of stimulus, and the values allowed for every device."""

from __future__ import annotations

from typing import Any, Final, get_args

from hfx_blender.engine.rendering.device_config import SchemeName
from hfx_blender.files.json_shapes import Number

COMPASS: Final = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
LAWS: Final = {"linear": "linear", "log": "log", "logarithmic": "log", "power": "power"}
"""Law of the barycentric scheme by the name in plans."""

SCHEMES: Final = get_args(SchemeName)
STRENGTHS: Final = ("strength", "amplitude", "intensity")
_COMMON: Final = frozenset({"device", "duration_ms", *STRENGTHS, "level_db"})
PARAMETERS: Final = {
    "line": _COMMON | {"scheme", "direction", "frequency_hz"},
    "steady": _COMMON | {"actuator", "frequency_hz"},
    "stroke": _COMMON | {"surface", "speed_mm_s"},
    "file": _COMMON | {"scheme", "take", "effect"},
}
"""Factors with an effect on the stimulus, by kind."""

RANGES: Final = {
    "duration_ms": Number(10, 60_000, "ms"),
    "frequency_hz": Number(1, 1000, "Hz"),
    "speed_mm_s": Number(1, 1000, "mm/s"),
    "level_db": Number(-120, 0, "dB"),
    **dict.fromkeys(STRENGTHS, Number(0, 1)),
}
"""Shape of each parameter that is a number."""

_DEGREES: Final = Number(-360, 360)


def allowed_instead(name: str, value: Any) -> str:
    """Allowed values of a parameter as text, for a value that no device can have. Empty for an
    allowed value, and for a parameter whose values depend on devices or files."""
    if name in RANGES:
        return "" if _is_in(RANGES[name], value) else RANGES[name].allowed
    if name == "direction":
        if value in COMPASS or _is_in(_DEGREES, value):
            return ""
        return f"one of {', '.join(COMPASS)}, or degrees from north, {_DEGREES.allowed}"
    names: tuple[str, ...]
    if name == "scheme":
        names = (*SCHEMES, *LAWS)
    elif name == "surface":
        from hfx_blender.engine.texture.procedural import MATERIALS

        names = tuple(MATERIALS)
    else:
        return ""
    return "" if value in names else f"one of {', '.join(names)}"


def _is_in(shape: Number, value: Any) -> bool:
    return not isinstance(value, str) and shape.lowest <= value <= shape.highest
