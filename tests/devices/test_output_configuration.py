# SPDX-License-Identifier: GPL-3.0-or-later
"""Output section of device configurations, with a wrong value in every field."""

import copy
import json

import jsonschema
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations.configuration_reader import is_local
from hfx_blender.engine.rendering.device_config import (
    BhapticsEncoder,
    ButtplugEncoder,
    BytesEncoder,
    OscEncoder,
    OutputConfig,
    SerialTransport,
    TextEncoder,
    UdpTransport,
    WebsocketTransport,
    WireEncoder,
)
from hfx_blender.errors import InputError
from hfx_blender.files import resources

SCHEMA = json.loads(
    (resources.device_configs() / "schema" / "device.schema.json").read_text(encoding="utf-8")
)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)

DOTS = [{"position": "ForearmL", "index": i} for i in range(3)]
OUTPUTS = [{"feature": i, "output": "Vibrate"} for i in range(3)]
WIRE = {"encoder": {"kind": "hfx-wire"}, "transport": {"kind": "serial", "baud": 57600}}
BYTES = {
    "encoder": {
        "kind": "bytes",
        "header": "ff01",
        "number": "u16be",
        "full_scale": 1000,
        "checksum": "xor",
        "footer": "0a",
        "stop": "ff00",
    }
}
TEXT = {"encoder": {"kind": "text", "start": "S ", "separator": ",", "full_scale": 255}}
OSC = {
    "encoder": {
        "kind": "osc",
        "address": "/hfx/{device}/{actuator}/{control}",
        "values": "unit",
        "send": "messages",
    },
    "transport": {"kind": "udp", "host": "192.168.0.7", "port": 9001},
}
LISTED = {"encoder": {"kind": "osc", "addresses": [f"/a/{i}" for i in range(4)]}}
BUTTPLUG = {"encoder": {"kind": "buttplug", "device_name": "Lovense", "outputs": OUTPUTS}}
BHAPTICS = {
    "encoder": {"kind": "bhaptics", "dots": DOTS},
    "transport": {"kind": "websocket", "port": 15882},
}
SECOND_SDK = {"encoder": {"kind": "bhaptics", "sdk": 2, "dots": DOTS}}
GOOD = {
    "wire": (WIRE, OutputConfig(WireEncoder(), SerialTransport(57600))),
    "bytes": (
        BYTES,
        OutputConfig(
            BytesEncoder(b"\xff\x01", "u16be", 1000, "xor", b"\n", b"\xff\x00"),
            SerialTransport(115200),
        ),
    ),
    "text": (TEXT, OutputConfig(TextEncoder("S ", ",", 255, None), SerialTransport(115200))),
    "osc": (
        OSC,
        OutputConfig(
            OscEncoder(("/hfx/{device}/{actuator}/{control}",), False, False),
            UdpTransport("192.168.0.7", 9001),
        ),
    ),
    "listed": (
        LISTED,
        OutputConfig(
            OscEncoder(("/a/0", "/a/1", "/a/2", "/a/3"), True, True),
            UdpTransport("127.0.0.1", 9000),
        ),
    ),
    "buttplug": (
        BUTTPLUG,
        OutputConfig(
            ButtplugEncoder("Lovense", ((0, "Vibrate"), (1, "Vibrate"), (2, "Vibrate"))),
            WebsocketTransport("127.0.0.1", 12345),
        ),
    ),
    "bhaptics": (
        BHAPTICS,
        OutputConfig(
            BhapticsEncoder((("ForearmL", 0), ("ForearmL", 1), ("ForearmL", 2))),
            WebsocketTransport("127.0.0.1", 15882),
        ),
    ),
    "second sdk": (
        SECOND_SDK,
        OutputConfig(
            BhapticsEncoder((("ForearmL", 0), ("ForearmL", 1), ("ForearmL", 2)), sdk=2),
            WebsocketTransport("127.0.0.1", 15882),
        ),
    ),
}


def with_output(full, document):
    """Return a device with the given output; for the wire encoder all actuators are silent at 0."""
    full["output"] = document
    if document.get("encoder") == WIRE["encoder"]:
        full["actuators"][2]["type"] = "motor"
        del full["substitutions"]["wind"]
    return full


@pytest.mark.parametrize("name", GOOD)
def test_an_output_is_understood(full, stored, name):
    document, expected = GOOD[name]
    with_output(full, document)
    VALIDATOR.validate(full)
    assert load_device(stored(full)).output == expected


def test_a_device_without_output_is_driven_by_nothing(full, stored):
    assert load_device(stored(full)).output is None


BAD = [
    (WIRE, "encoder", None),
    (WIRE, "encoder", {}),
    (WIRE, "encoder", {"kind": "magic"}),
    (WIRE, "encoder", {"kind": "hfx-wire", "script": "x.py"}),
    (WIRE, "script", "x.py"),
    (WIRE, "transport", {}),
    (WIRE, "transport", {"kind": "serial"}),
    (WIRE, "transport", {"kind": "udp"}),
    (WIRE, "transport", {"kind": "serial", "baud": 115201}),
    (WIRE, "transport", {"kind": "serial", "baud": True}),
    (WIRE, "transport", {"kind": "serial", "baud": 10**30}),
    (WIRE, "transport", {"kind": "serial", "baud": 9600, "port": "spy://x?file=y"}),
    (BYTES, "encoder/number", "f32"),
    (BYTES, "encoder/header", "FF"),
    (BYTES, "encoder/header", "f"),
    (BYTES, "encoder/header", ""),
    (BYTES, "encoder/footer", "00" * 33),
    (BYTES, "encoder/stop", 0),
    (BYTES, "encoder/full_scale", 0),
    (BYTES, "encoder/full_scale", 65536),
    (BYTES, "encoder/checksum", "md5"),
    (BYTES, "encoder", {"kind": "bytes", "number": "u8", "full_scale": 256}),
    (TEXT, "encoder/full_scale", 1.5),
    (TEXT, "encoder/separator", ""),
    (TEXT, "encoder/separator", "0"),
    (TEXT, "encoder/start", "\t"),
    (TEXT, "encoder/stop", "é"),
    (OSC, "encoder/address", "hfx"),
    (OSC, "encoder/address", "/hfx/{file}"),
    (OSC, "encoder/address", "/hfx/*/{number}"),
    (OSC, "encoder/addresses", ["/a"]),
    (OSC, "encoder/values", "raw"),
    (OSC, "encoder/send", 1),
    (OSC, "transport/port", 0),
    (OSC, "transport/port", 65536),
    (OSC, "transport/host", ""),
    (OSC, "transport/host", "a/b"),
    (OSC, "transport/path", "/x"),
    (LISTED, "encoder/addresses", ["/a", "/a", "/b", "/c"]),
    (BUTTPLUG, "encoder/outputs", []),
    (BUTTPLUG, "encoder/outputs", [{"feature": 0, "output": "Vibrate"}] * 3),
    (BUTTPLUG, "encoder/outputs/0", {"feature": 0, "output": "Led"}),
    (BUTTPLUG, "encoder/outputs/0", {"feature": -1, "output": "Vibrate"}),
    (BUTTPLUG, "encoder/outputs/0", {"feature": 0}),
    (BUTTPLUG, "encoder/device_name", ""),
    (BHAPTICS, "encoder/dots/0", {"position": "ForearmL", "index": 6}),
    (BHAPTICS, "encoder/dots/0", {"position": "Tail", "index": 0}),
    (BHAPTICS, "encoder/dots/0", {"position": "ForearmL", "index": 1}),
]
SEEN_BY_THE_READER = [
    (OSC, "encoder/address", "/hfx/{device}"),
    (OSC, "encoder/address", "/hfx/{actuator}"),
    (OSC, "transport/host", "8.8.8.8"),
    (OSC, "transport/host", "example.com"),
    (OSC, "transport/host", "0.0.0.0"),
    (OSC, "transport/host", "224.0.0.1"),
    (LISTED, "encoder/addresses", ["/a", "/b", "/c"]),
    (BUTTPLUG, "encoder/outputs", OUTPUTS[:2]),
    (BHAPTICS, "encoder/dots", [*DOTS, {"position": "Head", "index": 0}]),
]


@pytest.mark.parametrize(("document", "path", "value"), BAD + SEEN_BY_THE_READER)
def test_each_field_of_an_output_wrong_in_turn(full, stored, document, path, value):
    document = copy.deepcopy(document)
    at = document
    *keys, last = [int(key) if key.isdigit() else key for key in path.split("/")]
    for key in keys:
        at = at[key]
    at[last] = value
    with_output(full, document)
    with pytest.raises(InputError) as caught:
        load_device(stored(full))
    message = str(caught.value)
    assert "output" in message and message.endswith(".") and "\n" not in message
    assert VALIDATOR.is_valid(full) == ((path, value) in [case[1:] for case in SEEN_BY_THE_READER])


def test_our_firmware_drives_nothing_that_is_not_silent_at_0(full, stored):
    full["output"] = WIRE  # a Peltier element at 0 would be at the lowest temperature
    with pytest.raises(InputError, match="actuator 'c' is not silent at its minimum"):
        load_device(stored(full))


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("localhost", True),
        ("127.0.0.1", True),
        ("127.8.8.8", True),
        ("::1", True),
        ("10.0.0.2", True),
        ("192.168.1.255", True),
        ("fe80::1", True),
        ("8.8.8.8", False),
        ("255.255.255.255", False),
        ("0.0.0.0", False),
        ("::", False),
        ("224.0.0.1", False),
        ("localhost.example.com", False),
        ("", False),
    ],
)
def test_only_this_computer_and_private_networks_are_local(host, expected):
    assert is_local(host) is expected
