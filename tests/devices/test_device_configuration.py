# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading device configurations: accepted fields, and a wrong value in every field."""

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hfx_blender.devices.configuration import list_devices, load_device
from hfx_blender.engine.rendering.device_config import (
    BodyPlace,
    RoomPlace,
    Substitution,
    VertexPlace,
)
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_tools.commands.device_faults import faults_of

SCHEMA = json.loads(
    (resources.device_configs() / "schema" / "device.schema.json").read_text(encoding="utf-8")
)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
REMOVE = object()


def changed(document: Any, path: str, value: Any) -> Any:
    """Return ``document`` with the value at ``a.b.0.c`` replaced, added or removed."""
    *keys, last = [int(key) if key.isdigit() else key for key in path.split("/")]
    at = document
    for key in keys:
        at = at[key]
    if value is REMOVE:
        del at[last]
    else:
        at[last] = value
    return document


def test_every_field_is_understood(full, stored):
    device = load_device(stored(full))
    assert (device.id, device.name) == ("test_sleeve_left", "Test sleeve (left)")
    assert device.description == "Every field once."
    assert device.brand is not None
    assert (device.brand.vendor, device.brand.model) == ("Nobody", "None")
    assert device.brand.usb == ((0x2341, 0x0043),)
    assert (device.width_m, device.height_m, device.side) == (0.2, 0.1, "left")
    assert not device.is_mirrored
    motor, lra, peltier = (device.actuator_types[name] for name in ("motor", "lra", "peltier"))
    assert (motor.modality, motor.latency_ms, motor.update_interval_ms) == ("vibration", 30, 20)
    amplitude, frequency = motor.controls
    assert amplitude is motor.strength
    assert (amplitude.minimum, amplitude.maximum) == (0, 15)
    assert (amplitude.lowest, amplitude.highest, amplitude.neutral) == (0, 12, 0)
    assert (frequency.lowest, frequency.highest, frequency.neutral) == (60, 250, 80)
    assert (lra.latency_ms, lra.update_interval_ms) == (0, 10)
    assert (lra.controls[1].lowest, lra.controls[1].highest, lra.controls[1].neutral) == (175,) * 3
    assert (peltier.strength.minimum, peltier.strength.maximum) == (10, 45)
    assert (peltier.strength.lowest, peltier.strength.highest) == (15, 40)
    a, b, c = device.actuators
    assert a.type is motor and a.place == BodyPlace(("forearm",), (0.41, -0.05, 1.2), 0.02, "left")
    assert isinstance(b.place, VertexPlace) and b.place.sets[0].vertices == (1, 5, 9)
    assert c.place == RoomPlace(("head", "torso"), (0.0, -2.0, 1.2), (0.0, 1.0, 0.0), 3.0, 60.0)
    assert device.scheme.statistic == "mean"
    assert device.substitutions == {
        "pressure": Substitution("pressure", "vibration", 1.0, 80.0),
        "wind": Substitution("wind", "temperature", -0.5),
    }
    assert device.gain == 1.5
    VALIDATOR.validate(full)


def test_optional_fields_have_defaults(full, stored):
    for key in "description brand size_m side rendering substitutions defaults".split():
        del full[key]
    device = load_device(stored(full))
    assert (device.id, device.side, device.brand) == ("test_sleeve", None, None)
    assert (device.scheme.statistic, device.substitutions, device.gain) == ("strongest", {}, 1.0)
    VALIDATOR.validate(full)


@pytest.mark.parametrize(
    ("left_out", "own_hz"),
    [([], 175.0), (["resonance_hz"], 80.0), (["resonance_hz", "neutral"], 100.0)],
)
def test_pressure_shown_as_vibration_is_played_at_the_resonance(full, stored, left_out, own_hz):
    del full["substitutions"]["pressure"]["frequency_hz"]
    motor = full["actuator_types"]["motor"]
    for member in left_out:
        owner = motor if member in motor else motor["parameters"]["frequency_hz"]
        del owner[member]
    assert load_device(stored(full)).substitutions["pressure"].frequency_hz == own_hz
    VALIDATOR.validate(full)


def test_heat_is_limited_even_if_the_file_does_not(full, stored):
    del full["actuator_types"]["peltier"]["limits"]
    strength = load_device(stored(full)).actuator_types["peltier"].strength
    assert (strength.maximum, strength.lowest, strength.highest) == (45, 10, 40)


MOTOR = "actuator_types/motor"
PLACE = "actuators/0/place/placement"
VERTICES = "actuators/1/place/vertices/0"
SEEN_BY_BOTH = [
    ("schema", "hfx-track"),
    ("schema", REMOVE),
    ("version", 2),
    ("version", 0),
    ("version", True),
    ("version", "1"),
    ("version", REMOVE),
    ("id", ""),
    ("id", "../escape"),
    ("id", "Upper"),
    ("id", "a" * 65),
    ("id", 7),
    ("id", REMOVE),
    ("name", ""),
    ("name", "two\nlines"),
    ("name", "x" * 401),
    ("name", None),
    ("name", REMOVE),
    ("description", 3),
    ("unknown", 1),
    ("script", "evil.py"),
    ("brand", []),
    ("brand/vendor", REMOVE),
    ("brand/vendor", 1),
    ("brand/model", ""),
    ("brand/usb", []),
    ("brand/usb/0/vendor_id", 0x2341),
    ("brand/usb/0/vendor_id", "2341"),
    ("brand/usb/0/product_id", "0x12345"),
    ("brand/usb/0/product_id", REMOVE),
    ("size_m/width", 0),
    ("size_m/height", "0.1"),
    ("size_m/height", REMOVE),
    ("size_m/depth", 1),
    ("side", "centre"),
    ("side", "both"),
    ("actuator_types", {}),
    ("actuator_types", []),
    ("actuator_types", REMOVE),
    ("actuator_types/Bad Name", {}),
    (f"{MOTOR}/modality", "smell"),
    (f"{MOTOR}/modality", "wind"),
    (f"{MOTOR}/modality", REMOVE),
    (f"{MOTOR}/parameters", REMOVE),
    (f"{MOTOR}/parameters/frequency_hz", REMOVE),
    (f"{MOTOR}/parameters/duty", {}),
    (f"{MOTOR}/parameters/amplitude_m_s2/unit", "g"),
    (f"{MOTOR}/parameters/amplitude_m_s2/unit", REMOVE),
    (f"{MOTOR}/parameters/amplitude_m_s2/minimum", 1),
    (f"{MOTOR}/parameters/amplitude_m_s2/values", []),
    (f"{MOTOR}/parameters/amplitude_m_s2/values", 5),
    (f"{MOTOR}/parameters/amplitude_m_s2/values", [0, "5"]),
    ("actuator_types/lra/parameters/frequency_hz/values", [175]),
    (f"{MOTOR}/parameters/amplitude_m_s2/minimum", -1),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", -1),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", 1e6),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", True),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", "15"),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", None),
    (f"{MOTOR}/parameters/amplitude_m_s2/maximum", REMOVE),
    (f"{MOTOR}/parameters/amplitude_m_s2/neutral", 1),
    (f"{MOTOR}/parameters/amplitude_m_s2", {"unit": "m/s^2", "fixed": 3}),
    (f"{MOTOR}/parameters/frequency_hz/minimum", 0),
    (f"{MOTOR}/parameters/frequency_hz/fixed", 80),
    (f"{MOTOR}/latency_ms", -1),
    (f"{MOTOR}/latency_ms", [30]),
    (f"{MOTOR}/update_interval_ms", 0),
    (f"{MOTOR}/update_interval_ms", 1e9),
    (f"{MOTOR}/limits/amplitude_m_s2/minimum", 1),
    (f"{MOTOR}/limits/amplitude_m_s2/step", 1),
    (f"{MOTOR}/limits/pressure_kpa", {}),
    ("actuator_types/lra/parameters/frequency_hz/fixed", 0),
    ("actuator_types/peltier/parameters/temperature_c/minimum", 41),
    ("actuator_types/peltier/parameters/temperature_c/maximum", 61),
    ("actuators", []),
    ("actuators", {}),
    ("actuators", REMOVE),
    ("actuators/0", None),
    ("actuators/0/id", "A B"),
    ("actuators/0/id", REMOVE),
    ("actuators/0/type", 0),
    ("actuators/0/place", {}),
    ("actuators/0/place", REMOVE),
    ("actuators/0/place/room", {}),
    ("actuators/0/place/moon", {}),
    (f"{PLACE}/parts", []),
    (f"{PLACE}/parts", ["tail"]),
    (f"{PLACE}/parts", ["forearm", "forearm"]),
    (f"{PLACE}/parts", "forearm"),
    (f"{PLACE}/parts", REMOVE),
    (f"{PLACE}/side", "up"),
    (f"{PLACE}/centre_m", [0, 0]),
    (f"{PLACE}/centre_m", [0, 0, 100]),
    (f"{PLACE}/centre_m/0", True),
    (f"{PLACE}/radius_m", -0.01),
    (f"{PLACE}/radius_m", 2),
    (f"{PLACE}/radius_m", REMOVE),
    (f"{VERTICES}/model", "../body"),
    (f"{VERTICES}/hash", "abc"),
    (f"{VERTICES}/hash", REMOVE),
    (f"{VERTICES}/ids", []),
    (f"{VERTICES}/ids", [1.5]),
    (f"{VERTICES}/ids", [-1]),
    (f"{VERTICES}/ids", [5, 5]),
    (f"{VERTICES}/ids", [2**31]),
    ("actuators/1/place/vertices", []),
    ("actuators/2/place/room", {"reaches": ["moon"]}),
    ("actuators/2/place/room", []),
    ("actuators/2/place/room/at_m", [0, 0]),
    ("actuators/2/place/room/at_m", [0, 0, 101]),
    ("actuators/2/place/room/at_m", REMOVE),
    ("actuators/2/place/room/aim", [0, 0, 2]),
    ("actuators/2/place/room/aim", "up"),
    ("actuators/2/place/room/aim", REMOVE),
    ("actuators/2/place/room/range_m", 0),
    ("actuators/2/place/room/range_m", True),
    ("actuators/2/place/room/cone_deg", 0.5),
    ("actuators/2/place/room/cone_deg", 361),
    ("actuator_types/motor/takes_waveform", "yes"),
    ("actuator_types/motor/takes_waveform", 1),
    ("actuator_types/peltier/takes_waveform", True),
    ("actuator_types/motor/waveform", "sine"),
    ("actuator_types/lra/waveform", "square"),
    ("actuator_types/peltier/waveform", "noise"),
    ("actuator_types/motor/resonance_hz", 0),
    ("actuator_types/motor/resonance_hz", "high"),
    ("actuator_types/peltier/resonance_hz", 100),
    ("actuator_types/motor/drive", []),
    ("actuator_types/motor/drive", {}),
    ("actuator_types/motor/drive/0/frequency_hz", 1001),
    ("actuator_types/motor/drive/0/frequency_hz", REMOVE),
    ("actuator_types/motor/drive/0/points", [[0, 0]]),
    ("actuator_types/motor/drive/0/points", [[0, 0], [2, 1]]),
    ("actuator_types/motor/drive/0/points", [[0, 0], [1, "x"]]),
    ("actuator_types/motor/drive/0/points", [[0, 0], [1, 1, 1]]),
    ("actuator_types/motor/drive/0/phase", 1),
    ("actuator_types/peltier/drive", [{"frequency_hz": 80, "points": [[0, 0], [1, 1]]}]),
    ("actuator_types/motor/detection_thresholds", []),
    ("actuator_types/motor/detection_thresholds", [[80]]),
    ("actuator_types/motor/detection_thresholds", [[80, -1]]),
    ("actuator_types/motor/detection_thresholds", [[0, 1]]),
    ("actuator_types/motor/detection_thresholds", 0.1),
    ("actuator_types/peltier/detection_thresholds", [[80, 1]]),
    ("brand/serial", 7),
    ("brand/serial", "a b"),
    ("brand/serial", ""),
    ("rendering", {}),
    ("rendering/scheme", "magic"),
    ("rendering/options/statistic", "median"),
    ("rendering/options/power", 2),
    ("substitutions/smell", {}),
    ("substitutions/pressure/as", "pressure"),
    ("substitutions/pressure/as", REMOVE),
    ("substitutions/pressure/frequency_hz", 0),
    ("substitutions/pressure/scale", 1),
    ("substitutions/pressure/scale/value", -1),
    ("substitutions/pressure/scale/unit", "m/s^2 per bar"),
    ("substitutions/wind/frequency_hz", 80),
    ("defaults/gain", 11),
    ("defaults/gain", False),
    ("defaults/volume", 1),
]
SEEN_BY_THE_READER = [
    (f"{MOTOR}/parameters/frequency_hz/maximum", 59),
    (f"{MOTOR}/parameters/frequency_hz/neutral", 251),
    (f"{MOTOR}/limits/amplitude_m_s2/maximum", 16),
    ("actuator_types/peltier/parameters/temperature_c/neutral", 12),
    ("actuator_types/peltier/limits/temperature_c/minimum", 41),
    ("actuators/0/type", "buzzer"),
    ("actuators/1/id", "a"),
    ("actuators/2/place/room/aim", [0, 0, 0.05]),
    ("actuator_types/motor/drive/0/frequency_hz", 175),
    ("actuator_types/motor/drive/0/points", [[0.1, 0], [1, 1]]),
    ("actuator_types/motor/drive/0/points", [[0, 0], [1, 1], [1, 2]]),
    ("actuator_types/motor/drive/0/points", [[0, 0], [0.5, 2], [1, 2]]),
    ("actuator_types/motor/detection_thresholds", [[80, 1], [80, 1]]),
    (f"{VERTICES}/ids", [5, 1]),
    ("substitutions/pressure", {"as": "wind", "scale": {"value": 1, "unit": "m/s per kPa"}}),
]


@pytest.mark.parametrize(("path", "value"), SEEN_BY_BOTH + SEEN_BY_THE_READER)
def test_each_field_wrong_in_turn(full, stored, path, value):
    document = changed(full, path, value)
    file = stored(document)
    with pytest.raises(InputError) as caught:
        load_device(file)
    message = str(caught.value)
    assert message.startswith(str(file)) and message.endswith(".") and "\n" not in message
    # The message names the field, or the enclosing object or list.
    keys = [key for key in path.split("/") if not key.isdigit()]
    assert any(key in message for key in keys[-2:])
    assert faults_of(file) == [message]
    assert VALIDATOR.is_valid(document) == ((path, value) in SEEN_BY_THE_READER)


def test_allowed_values_within_limits(full, stored):
    motor = full["actuator_types"]["motor"]
    motor["parameters"]["amplitude_m_s2"]["values"] = [0, 5, 12, 15]
    motor["parameters"]["frequency_hz"] |= {"values": [80, 175]}
    amplitude, frequency = load_device(stored(full)).actuator_types["motor"].controls
    assert amplitude.values == (0, 5, 12)  # the limit is 12
    assert frequency.values == (80, 175) and frequency.neutral == 80
    # The default neutral frequency of 100 Hz is not allowed: the next one below.
    del motor["parameters"]["frequency_hz"]["neutral"]
    assert load_device(stored(full)).actuator_types["motor"].controls[1].neutral == 80
    motor["parameters"]["frequency_hz"]["values"] = [175]
    assert load_device(stored(full)).actuator_types["motor"].controls[1].neutral == 175


@pytest.mark.parametrize(
    ("kind", "name", "values", "allowed"),
    [
        ("motor", "amplitude_m_s2", [5, 12], "a list with 0, the neutral value"),
        ("motor", "amplitude_m_s2", [0, 16], "a number from 0 to 15 m/s^2"),
        ("motor", "frequency_hz", [100, 175], "a list with 80, the neutral value"),
        ("motor", "frequency_hz", [50, 80], "a number from 60 to 250 Hz"),
        ("peltier", "temperature_c", [20, 38], "a list with 33, the neutral value"),
        ("peltier", "temperature_c", [41, 45], "a list with a value from 15 to 40 degC"),
        ("peltier", "temperature_c", [33, 33], "a number above 33"),
    ],
)
def test_allowed_values_that_are_refused(full, stored, kind, name, values, allowed):
    full["actuator_types"][kind]["parameters"][name]["values"] = values
    file = stored(full)
    (message,) = faults_of(file)
    assert message.startswith(f"{file}: actuator_types.{kind}.parameters.{name}.values")
    assert allowed in message


def test_actuators_that_take_a_waveform_have_no_allowed_values(full, stored):
    motor = full["actuator_types"]["motor"]
    motor["takes_waveform"] = True
    for name, values in (("amplitude_m_s2", [0, 15]), ("frequency_hz", [80])):
        document = copy.deepcopy(full)
        document["actuator_types"]["motor"]["parameters"][name]["values"] = values
        (message,) = faults_of(stored(document))
        assert f"parameters.{name}.values is {values}" in message
        assert "actuators that take a waveform have a range only" in message


def test_custom_columns_follow_the_parameters(full, stored):
    full["actuator_types"]["motor"]["custom"] = {
        "focus_x": {"unit": "m", "minimum": 0.05, "maximum": 0.1},
        "pattern": {"choices": ["off", "sweep", "burst"]},
    }
    device = load_device(stored(full))
    kind = device.actuator_types["motor"]
    assert [c.name for c in kind.controls] == [
        "amplitude_m_s2",
        "frequency_hz",
        "focus_x",
        "pattern",
    ]
    _, _, focus, pattern = kind.controls
    assert (focus.lowest, focus.highest, focus.neutral, kind.unit(focus)) == (0.05, 0.1, 0.05, "m")
    assert (pattern.values, pattern.neutral, pattern.choices[1]) == ((0, 1, 2), 0, "sweep")
    assert [c.name for c in kind.modality_controls] == ["amplitude_m_s2", "frequency_hz"]
    assert kind.unit(kind.strength) == "m/s^2"


@pytest.mark.parametrize(
    ("name", "column", "allowed"),
    [
        ("frequency_hz", {"unit": "Hz", "minimum": 0, "maximum": 1}, "a name other than those"),
        ("duty", {"unit": "%", "minimum": 5, "maximum": 1}, "a number from 5 to 1000000 %"),
        ("duty", {"unit": "%", "minimum": 0, "maximum": 1, "neutral": 2}, "a number from 0 to 1 %"),
        ("pattern", {"choices": ["off"]}, "a list of 2 to 256 items"),
        ("pattern", {"choices": ["off", "off"]}, "off"),
        ("Duty", {"choices": ["off", "on"]}, "1 to 64 of a-z"),
    ],
)
def test_custom_columns_that_are_refused(full, stored, name, column, allowed):
    full["actuator_types"]["motor"]["custom"] = {name: column}
    (message,) = faults_of(stored(full))
    assert "custom" in message and allowed in message


def test_a_type_of_actuators_has_a_name_like_any_other(full, stored):
    full["actuator_types"]["The Motor"] = full["actuator_types"]["motor"]
    with pytest.raises(InputError, match='the name is "The Motor", allowed is 1 to 64'):
        load_device(stored(full))


@pytest.mark.parametrize("waveform", ["sine", "square", "noise"])
def test_an_actuator_that_is_driven_as_sound_has_a_waveform(full, stored, waveform):
    motor = full["actuator_types"]["motor"]
    assert load_device(stored(full)).actuators[0].type.waveform == "sine"
    motor |= {"takes_waveform": True, "waveform": waveform}
    assert load_device(stored(full)).actuators[0].type.waveform == waveform
    motor["waveform"] = "saw"
    with pytest.raises(
        InputError, match=r'motor\.waveform is "saw", allowed is one of sine, square, noise\.$'
    ):
        load_device(stored(full))
    motor |= {"takes_waveform": False, "waveform": waveform}
    with pytest.raises(InputError, match='allowed is left out: it needs "takes_waveform": true'):
        load_device(stored(full))


def test_a_model_is_named_once(full, stored):
    sets = full["actuators"][1]["place"]["vertices"]
    sets.append(dict(sets[0]))
    with pytest.raises(InputError, match="each model once"):
        load_device(stored(full))


def test_an_element_that_is_always_hotter_than_allowed_is_refused(full, stored):
    peltier = full["actuator_types"]["peltier"]
    del peltier["limits"]
    peltier["parameters"]["temperature_c"] |= {"minimum": 41, "neutral": 42}
    with pytest.raises(InputError, match="from -20 to 40 degC, the hottest allowed"):
        load_device(stored(full))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not valid JSON"),
        (b"{", "not valid JSON"),
        (b"[]", "allowed is an object"),
        (b"\xff\xfe{}", "not UTF-8"),
        (b"\xef\xbb\xbf\xef\xbb\xbf{}", "not valid JSON"),  # only the first mark is skipped
        (b'{"a": NaN}', "not finite"),
        (b'{"a": -Infinity}', "not finite"),
        (b'{"a": 1e999}', "not finite"),
        (b'{"a": ' + b"9" * 5000 + b"}", "too long"),
        (b'{"id": "a", "id": "b"}', "'id' is there twice"),
        (b"[" * 100_000, "nested deeper"),
        (b'{"a":' * 17 + b"1" + b"}" * 17, "nested deeper"),
        (b'"' + b" " * (1 << 20) + b'"', "larger than"),
    ],
    ids=lambda value: value[:12] if isinstance(value, bytes) else None,
)
def test_files_that_are_not_configurations(stored, content, message):
    with pytest.raises(InputError, match=message):
        load_device(stored(content))


def test_brackets_in_text_do_not_count_as_nesting(full, stored):
    full["description"] = "[" * 40 + '\\"{' * 20
    assert load_device(stored(full)).description == full["description"]


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_device(tmp_path / "nothing.json")
    with pytest.raises(InputError, match="it is a folder"):
        load_device(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load_device(Path("a\0b.json"))
    with pytest.raises(InputError, match="no such file"):
        load_device("back_pad_left.json")


@pytest.mark.parametrize(
    "name", ["", "..", "nothing", "back_pad_left", "schema", "a" * 300, "a\0b"]
)
def test_unknown_names_list_the_known(name):
    fault = "is unknown" if name else "A device's name is missing"
    with pytest.raises(InputError, match=rf"{fault}; there are: .*back_pad, .*fan_heater"):
        load_device(name)


def test_names_in_a_folder_of_the_user(full, stored, tmp_path):
    stored(full, "test_sleeve.json")
    stored("{", "broken.json")
    names = list_devices(tmp_path)
    assert {"test_sleeve_left", "test_sleeve_right", "broken", "back_pad"} <= set(names)
    assert load_device("test_sleeve", tmp_path).side == "left"
    assert load_device("test_sleeve_left", tmp_path).is_mirrored is False
    right = load_device("test_sleeve_right", tmp_path)
    assert (right.id, right.name) == ("test_sleeve_right", "Test sleeve (right)")
    assert (right.side, right.is_mirrored) == ("right", True)
    by_path = load_device(tmp_path / "test_sleeve_right.json")
    assert (by_path.id, by_path.is_mirrored) == (right.id, True)


def test_a_folder_of_the_user_goes_first(full, stored, tmp_path):
    full["id"] = "back_pad"
    del full["side"]
    stored(full, "back_pad.json")
    assert load_device("back_pad", tmp_path).name == "Test sleeve"
    assert load_device("back_pad").name == "Back pad"


def test_check_finds_places_off_the_body(full, stored):
    (fault,) = faults_of(stored(full))
    assert "actuators[1].place" in fault and "another 'hfx-vibration-1'" in fault
    full["actuators"][0]["place"]["placement"]["centre_m"] = [0, 0, 2.9]
    first, second = faults_of(stored(full))
    assert "actuators[0].place" in first and "nearest vertex" in first
    assert second == fault
    assert faults_of(stored(full), models=None) == []


def test_the_schema_is_itself_valid_and_not_a_device():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    path = resources.device_configs() / "schema" / "device.schema.json"
    assert not any("schema" in name for name in list_devices())
    with pytest.raises(InputError):
        load_device(path)


@pytest.mark.parametrize(
    "path", sorted(resources.device_configs().glob("*.json")), ids=lambda path: path.stem
)
def test_shipped_configurations_are_valid(path: Path):
    document = json.loads(path.read_text(encoding="utf-8"))
    VALIDATOR.validate(document)
    assert document["id"] == path.stem
    assert faults_of(path) == []


def test_the_example_of_the_documentation_is_valid(stored):
    page = Path(__file__).parents[2] / "docs" / "device-configuration.md"
    example = page.read_text(encoding="utf-8").split("```json\n")[1].split("```")[0]
    VALIDATOR.validate(json.loads(example))
    file = stored(example, "warm_sleeve.json")
    assert faults_of(file) == []
    device = load_device(file)
    assert [actuator.id for actuator in device.actuators] == ["inner", "outer"]
    assert device.actuator_types["element"].strength.highest == 38
