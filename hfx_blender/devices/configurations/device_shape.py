# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape of device configurations: type, range, unit and allowed values of each field.

Readers check documents by this shape, and ``device_configs/schema/device.schema.json`` is
generated from it (``python docs/regenerate.py schema``). The readers check conditions between
fields.
"""

from collections.abc import Mapping
from typing import Final, get_args

from ...engine.body.parts import PARTS, SIDES
from ...engine.modality import MODALITIES, Modality, Parameter
from ...engine.rendering.conditioning.waveform import WAVEFORMS
from ...engine.rendering.device_config import LAWS, Checksum, SchemeName, Statistic
from ...files.json_shapes import (
    PRINTABLE,
    SHA256,
    Either,
    Flag,
    Items,
    Number,
    Record,
    Row,
    Shape,
    Table,
    Tagged,
    Text,
    numbers,
    strict,
    tagged,
)

SCHEMA: Final = "hfx-device"
VERSION: Final = 1

MAX_ACTUATORS: Final = 1000
MAX_VALUES: Final = 256
"""Largest number of allowed values of a parameter."""
WEARABLE_SIDES: Final = ("left", "right")

BAUDS: Final = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600, 1000000)

BUTTPLUG_OUTPUTS: Final = ("Vibrate", "Rotate", "Oscillate", "Constrict", "Spray", "Temperature")

BHAPTICS_MOTORS: Final = {
    "VestFront": 20,
    "VestBack": 20,
    **dict.fromkeys(("Head", "ForearmL", "ForearmR", "GloveL", "GloveR"), 6),
    **dict.fromkeys(("HandL", "HandR", "FootL", "FootR"), 3),
}
"""Number of motors at each position of the bHaptics Player."""

FULL_SCALES: Final = {"u8": 0xFF, "u16le": 0xFFFF, "u16be": 0xFFFF}

ID: Final = Text(
    pattern=r"[a-z0-9][a-z0-9_-]{0,63}",
    note="1 to 64 of a-z, 0-9, _ and -, the first a letter or digit",
)
USB_ID: Final = Text(pattern=r"0x[0-9a-f]{4}", note='four hexadecimal digits such as "0x2341"')
BODY_PARTS: Final = Items(Text(PARTS), 1, len(PARTS), order="unique")
_FREQUENCY: Final = Number(0.1, 1000.0, "Hz")
_POSITION: Final = numbers(3, -3.0, 3.0, "m")
_DIRECTION: Final = numbers(3, -1.0, 1.0)
_RADIUS: Final = Number(0.0, 1.0, "m")
_SIDE: Final = Text(SIDES)

BRAND: Final = strict(
    {"vendor": PRINTABLE},
    {
        "model": PRINTABLE,
        "usb": Items(strict({"vendor_id": USB_ID, "product_id": USB_ID}), 1, 16),
        "serial": Text(
            pattern=r"[A-Za-z0-9_.:*?-]{1,64}",
            note="1 to 64 of letters, digits, _ . : -, and * and ? for any",
        ),
    },
)
MOUNT: Final = strict(
    {"origin_m": _POSITION, "x_axis": _DIRECTION, "y_axis": _DIRECTION},
    # From the curvature of a fingertip to practically none; negative for a concave surface.
    {"bend_radius_mm": Number(-10_000.0, 10_000.0, "mm", smallest=3.0)},
)

# Options of the rendering schemes with options.
_OPTIONS: Final[Mapping[str, Mapping[str, Shape]]] = {
    "coverage": {"statistic": Text(get_args(Statistic))},
    "barycentric": {"law": Text(LAWS)},
    "surface": {"law": Text(LAWS)},
    "splat": {"sigma_m": Number(0.001, 1.0, "m")},
    "brush": {"duration_ms": Number(40.0, 1000.0, "ms")},
    "saltation": {"interval_ms": Number(20.0, 300.0, "ms"), "tap_ms": Number(1.0, 200.0, "ms")},
}

RENDERING: Final = tagged(
    "scheme",
    {
        name: strict({}, {"options": strict({}, _OPTIONS.get(name, {}))})
        for name in get_args(SchemeName)
    },
)


def _range(modality: Modality, parameter: Parameter) -> Shape:
    """JSON shape of an actuator's range of a parameter: unit, minimum, maximum, optional neutral
    and allowed values, within the range of the modality.
    A strength that is silent at 0 has minimum and neutral 0; of other strengths both are at most
    the device maximum. A parameter that is no strength may have a fixed value instead.
    """
    value = Number(parameter.minimum, parameter.maximum, parameter.unit)
    unit = Text((parameter.unit,))
    values = Items(value, 1, MAX_VALUES, order="ascending")
    if parameter.name != modality.strength:
        range_ = strict(
            {"unit": unit, "minimum": value, "maximum": value}, {"neutral": value, "values": values}
        )
        return Either("fixed", strict({"unit": unit, "fixed": value}), range_)
    if modality.is_silent_at_0:
        silent = Number(0, 0, note="0, at which the actuator is silent")
        return strict(
            {"unit": unit, "minimum": silent, "maximum": value},
            {"neutral": silent, "values": values},
        )
    # Not silent at 0, as a temperature: any value up to the hottest allowed may be neutral.
    highest = f"{parameter.device_maximum:g} {parameter.unit}, the hottest allowed"
    low = Number(
        parameter.minimum,
        parameter.device_maximum,
        note=f"a number from {parameter.minimum:g} to {highest}",
    )
    return strict(
        {"unit": unit, "minimum": low, "maximum": value}, {"neutral": low, "values": values}
    )


_TIMING: Final[Mapping[str, Shape]] = {
    "latency_ms": Number(0.0, 60_000.0, "ms"),
    "update_interval_ms": Number(0.1, 60_000.0, "ms"),
    "slew_per_s": Number(0.001, 1e6),
    "maximum_on_s": Number(0.01, 86_400.0, "s"),
    "rest_s": Number(0.0, 86_400.0, "s"),
}
_VIBRATION: Final[Mapping[str, Shape]] = {
    "takes_waveform": Flag(),
    "waveform": Text(WAVEFORMS),
    "tone_pair": Flag(),
    "resonance_hz": _FREQUENCY,
    "drive": Items(
        strict(
            {
                "frequency_hz": _FREQUENCY,
                "points": Items(Row((Number(0.0, 1.0), Number(0.0, 1000.0))), 2, 256),
            }
        ),
        1,
        32,
    ),
    "detection_thresholds": Items(Row((_FREQUENCY, Number(0.0, 1000.0))), 1, 64, order="ascending"),
}
_NO_VIBRATION: Final[Mapping[str, Shape]] = {
    "takes_waveform": Flag(False, "false: only vibration is played as a waveform")
}

CUSTOM: Final = Table(
    Either(
        "choices",
        strict({"choices": Items(ID, 2, MAX_VALUES, order="unique")}),
        strict(
            {
                "unit": Text(
                    pattern=r"[\x21-\x7e]{1,16}", note="1 to 16 characters without spaces"
                ),
                "minimum": Number(-1e6, 1e6),
                "maximum": Number(-1e6, 1e6),
            },
            {"neutral": Number(-1e6, 1e6)},
        ),
    ),
    1,
    ID,
    "an object with at least one custom control",
)


def _actuator_type(modality: Modality) -> Record:
    """JSON shape of an actuator type of a modality, without the field ``modality``; only vibration
    has waveform, resonance, drive curves and thresholds."""
    is_vibration = modality.name == "vibration"
    limits = {}
    for parameter in modality.controls:
        least = value = Number(parameter.minimum, parameter.maximum, parameter.unit)
        if parameter.name == modality.strength and modality.is_silent_at_0:
            least = Number(0, 0, note="0, at which the actuator is silent")
        limits[parameter.name] = strict({}, {"minimum": least, "maximum": value})
    return strict(
        {"parameters": strict({p.name: _range(modality, p) for p in modality.controls})},
        {
            "limits": strict({}, limits),
            "custom": CUSTOM,
            **_TIMING,
            **(_VIBRATION if is_vibration else _NO_VIBRATION),
        },
        needs=dict.fromkeys(("waveform", "tone_pair"), "takes_waveform") if is_vibration else {},
    )


ACTUATOR_TYPE: Final = tagged(
    "modality", {name: _actuator_type(modality) for name, modality in MODALITIES.items()}
)

PLACEMENT: Final = strict(
    {"parts": BODY_PARTS, "centre_m": _POSITION, "radius_m": _RADIUS},
    {"side": _SIDE, "stroked_by": BODY_PARTS},
)
VERTICES: Final = Items(
    strict(
        {
            "model": ID,
            "hash": SHA256,
            "ids": Items(Number(0, 2**31 - 1, is_whole=True), 1, 100_000, order="ascending"),
        }
    ),
    1,
    8,
)
_ROOM: Final = strict(
    {},
    {
        "reaches": BODY_PARTS,
        "at_m": numbers(3, -100.0, 100.0, "m"),
        "aim": _DIRECTION,
        "range_m": Number(0.01, 100.0, "m"),
        "cone_deg": Number(1.0, 360.0, "deg"),
    },
    needs={"aim": "at_m", "range_m": "at_m", "cone_deg": "aim"},
)
_PAD: Final = strict(
    {"parts": BODY_PARTS, "at_mm": numbers(2, -2000.0, 2000.0, "mm"), "radius_m": _RADIUS},
    {"side": _SIDE},
)
_PLACES: Final[Mapping[str, Shape]] = {
    "placement": PLACEMENT,
    "vertices": VERTICES,
    "room": _ROOM,
    "pad": _PAD,
}
ACTUATOR: Final = strict(
    {"id": ID, "type": ID, "place": strict({}, _PLACES, one_of=tuple(_PLACES))}
)


def _substitution(source: Modality, target: Modality) -> Record:
    """JSON shape of playing one modality as another: scale in units of target per source, and for
    vibration an optional frequency."""
    # A negative scale is useful only for a strength that can be negative, as of cooling wind.
    least = 0.0 if target.is_silent_at_0 else -1000.0
    unit = Text((f"{target.strength_parameter.unit} per {source.strength_parameter.unit}",))
    return strict(
        {"scale": strict({"value": Number(least, 1000.0), "unit": unit})},
        {"frequency_hz": _FREQUENCY} if target.name == "vibration" else {},
    )


SUBSTITUTIONS: Final = strict(
    {},
    {
        source.name: tagged(
            "as",
            {
                target.name: _substitution(source, target)
                for target in MODALITIES.values()
                if target is not source
            },
        )
        for source in MODALITIES.values()
    },
)

_HEX: Final = Text(
    pattern=r"(?:[0-9a-f]{2}){1,32}", note='hexadecimal bytes such as "ff0a", 32 at most'
)
_ASCII: Final = Text(pattern=r"[\x20-\x7e]{0,32}", note="up to 32 printable ASCII characters")
_SEPARATOR: Final = Text(
    pattern=r"[\x20-\x2f\x3a-\x7e]{1,32}", note="1 to 32 printable ASCII characters without digits"
)
_PLACEHOLDERS: Final = r"\{(?:device|actuator|control|number|side|Side)\}"
OSC_ADDRESS: Final = Text(
    pattern=rf"(?:/(?:[A-Za-z0-9_.\-]|{_PLACEHOLDERS})+)+",
    note="an OSC address such as /hfx/{device}/{actuator}/{control}",
)
LOCAL: Final = 'localhost or an address of a private network such as "192.168.0.7"'
_SOCKET: Final = strict(
    {},
    {
        "host": Text(pattern=r"[0-9A-Za-z:.]{1,45}", note=LOCAL),
        "port": Number(1, 65535, is_whole=True),
    },
)
_TRANSPORTS: Final = {
    "serial": strict({"baud": Number(is_whole=True, choices=BAUDS)}),
    "udp": _SOCKET,
    "websocket": _SOCKET,
}

_BYTES: Final = {
    number: strict(
        {},
        {
            **dict.fromkeys(("header", "footer", "stop"), _HEX),
            "full_scale": Number(1, full_scale, is_whole=True),
            "checksum": Text(get_args(Checksum)),
        },
    )
    for number, full_scale in FULL_SCALES.items()
}
_DOTS: Final = {
    position: strict({"index": Number(0, motors - 1, is_whole=True)})
    for position, motors in BHAPTICS_MOTORS.items()
}
# Transport and shape of each encoder.
_ENCODERS: Final[Mapping[str, tuple[str, Shape]]] = {
    "hfx-wire": ("serial", strict({})),
    "bytes": ("serial", tagged("number", _BYTES)),
    "text": (
        "serial",
        strict(
            {"full_scale": Number(1, 65535, is_whole=True)},
            {"start": _ASCII, "separator": _SEPARATOR, "stop": _ASCII},
        ),
    ),
    "osc": (
        "udp",
        strict(
            {},
            {
                "address": OSC_ADDRESS,
                "addresses": Items(OSC_ADDRESS, 1, 2 * MAX_ACTUATORS, order="unique"),
                "values": Text(("fraction", "unit")),
                "send": Text(("bundle", "messages")),
            },
            one_of=("address", "addresses"),
        ),
    ),
    "vrc-haptics": ("udp", strict({})),
    "buttplug": (
        "websocket",
        strict(
            {
                "outputs": Items(
                    strict(
                        {"feature": Number(0, 255, is_whole=True), "output": Text(BUTTPLUG_OUTPUTS)}
                    ),
                    1,
                    MAX_ACTUATORS,
                    order="unique",
                )
            },
            {"device_name": PRINTABLE},
        ),
    ),
    "bhaptics": (
        "websocket",
        strict(
            {"dots": Items(tagged("position", _DOTS), 1, MAX_ACTUATORS, order="unique")},
            {"sdk": Number(is_whole=True, choices=(1, 2))},
        ),
    ),
}

TRANSPORT_OF: Final = {encoder: transport for encoder, (transport, _) in _ENCODERS.items()}


def _with_kind(members: Shape, kind: str) -> Shape:
    """Add the constant field ``kind`` to a shape, or to each alternative of a tagged shape."""
    if isinstance(members, Tagged):
        return Tagged(members.tag, {k: _with_kind(v, kind) for k, v in members.kinds.items()})
    assert isinstance(members, Record)
    return tagged("kind", {kind: members}).kinds[kind]


def _outputs(further: Mapping[str, Shape]) -> Tagged:
    """JSON shape of an output with any encoder, with ``further`` required fields."""
    return Tagged(
        "encoder.kind",
        {
            encoder: strict(
                {"encoder": _with_kind(members, encoder), **further},
                {"transport": tagged("kind", {transport: _TRANSPORTS[transport]})},
            )
            for encoder, (transport, members) in _ENCODERS.items()
        },
    )


OUTPUT: Final = _outputs({})
OUTPUT_PART: Final = _outputs({"actuators": Items(ID, 1, MAX_ACTUATORS, order="unique")})
MAX_OUTPUTS: Final = 16

DEVICE: Final = strict(
    {
        "schema": Text((SCHEMA,)),
        "version": Number(VERSION, VERSION, is_whole=True),
        "id": ID,
        "name": PRINTABLE,
        "actuator_types": Table(ACTUATOR_TYPE, 1, ID, "an object with at least one actuator type"),
        "actuators": Items(ACTUATOR, 1, MAX_ACTUATORS),
    },
    {
        "description": PRINTABLE,
        "brand": BRAND,
        "size_m": strict(dict.fromkeys(("width", "height"), Number(0.001, 10.0, "m"))),
        "mount": MOUNT,
        "side": Text(WEARABLE_SIDES),
        "rendering": RENDERING,
        "substitutions": SUBSTITUTIONS,
        "defaults": strict({}, {"gain": Number(0.0, 10.0)}),
        "output": OUTPUT,
        "outputs": Items(OUTPUT_PART, 1, MAX_OUTPUTS),
    },
)
