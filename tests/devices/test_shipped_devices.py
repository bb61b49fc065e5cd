# SPDX-License-Identifier: GPL-3.0-or-later
"""Shipped devices are placed as described, on all perceptual models."""

from pathlib import Path

import numpy as np
import pytest

from hfx_blender.devices.configuration import list_devices, load_device
from hfx_blender.devices.host.opening import kind_of
from hfx_blender.devices.live.discovery import FoundPort, found_devices, port_of
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import BodyPlace, SerialTransport
from hfx_blender.engine.rendering.schemes import cells_of
from hfx_blender.files import resources

MODELS = ("hfx-vibration-1", "hfx-pressure-1", "hfx-temperature-1")
EXPECTED = {  # parts, sides, actuators
    "forearm_band_left": ("forearm", {LEFT}, 8),
    "forearm_band_right": ("forearm", {RIGHT}, 8),
    "back_pad": ("torso", None, 20),
    "pressure_vest": ("torso", None, 32),
    "insoles": ("foot_sole", {LEFT, RIGHT}, 8),
    "fan_heater": (None, None, 2),
    "thalmic_myo_left": ("forearm", {LEFT}, 1),
    "thalmic_myo_right": ("forearm", {RIGHT}, 1),
    "subpac_m2": ("torso", None, 1),
    "gamepad_rumble": ("hand_palm fingers", {LEFT, RIGHT}, 2),
    "oculus_touch": ("hand_palm fingers", {LEFT, RIGHT}, 2),
    "dyson_pure_cool_link": (None, None, 2),
    "mango_pad": ("torso", None, 10),
    "waist_belt": ("torso", None, 8),
    "phone_lra": ("hand_palm fingers", {LEFT, RIGHT}, 1),
    "phone_wide_band": ("hand_palm fingers", {LEFT, RIGHT}, 1),
    "bhaptics_tactglove_left": ("fingers hand_dorsum", {LEFT}, 6),
    "bhaptics_tactglove_right": ("fingers hand_dorsum", {RIGHT}, 6),
    "fingertips_left": ("fingers", {LEFT}, 5),
    "fingertips_right": ("fingers", {RIGHT}, 5),
    "bhaptics_tactal": ("head", None, 6),
    "head_band": ("head", None, 8),
    "arm_sleeve_left": ("upper_arm forearm", {LEFT}, 12),
    "arm_sleeve_right": ("upper_arm forearm", {RIGHT}, 12),
    "leg_sleeve_left": ("upper_leg lower_leg", {LEFT}, 12),
    "leg_sleeve_right": ("upper_leg lower_leg", {RIGHT}, 12),
    "bhaptics_tactsuit_x40": ("torso", None, 40),
    "bhaptics_tactosy_left": ("forearm", {LEFT}, 6),
    "bhaptics_tactosy_right": ("forearm", {RIGHT}, 6),
    "arduino_uno_pwm": ("forearm", {LEFT}, 6),
    "vrc_haptics_board_left": ("forearm", {LEFT}, 8),
    "vrc_haptics_board_right": ("forearm", {RIGHT}, 8),
    "thermal_grill": ("forearm", {LEFT}, 6),
    "ultrasound_array": ("hand_palm fingers", {LEFT, RIGHT}, 1),
    "sound_card_8": ("torso", None, 8),
    "peltier_sleeve_left": ("forearm", {LEFT}, 2),
    "peltier_sleeve_right": ("forearm", {RIGHT}, 2),
}
IN_THE_ROOM = {name for name, (part, _, _) in EXPECTED.items() if part is None}
IN_THE_ROOM.add("ultrasound_array")
ALL_ROUND = {"thalmic_myo_left", "thalmic_myo_right"}  # centred in the arm


def cells(name, model_id):
    device, model = load_device(name), load_model(model_id)
    return device, model, cells_of(device, device.actuators, model)


def test_nothing_ships_untested():
    assert set(list_devices()) == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_device_has_usb_ids_or_says_why_not(name):
    device = load_device(name)
    on_serial = any(isinstance(o.transport, SerialTransport) for o in device.outputs)
    if on_serial:
        assert device.brand is not None and device.brand.usb and "USB ids: " in device.description
    elif device.brand is not None:
        assert not device.brand.usb and "No USB ids: " in device.description


# Rows of Arduino's boards.txt (arduino/ArduinoCore-avr, 0428ad8): uno.vid, uno.pid; mega.vid ...
@pytest.mark.parametrize(
    ("name", "products"),
    [
        ("arduino_uno_pwm", "2341:0043 2341:0001 2a03:0043 2341:0243 2341:006a"),
        ("waist_belt", "2341:0010 2341:0042 2a03:0010 2a03:0042 2341:0210 2341:0242"),
    ],
)
def test_every_board_of_the_maker_chooses_the_port(name, products):
    device = load_device(name)
    other = FoundPort("COM1", "modem", (0x1A86, 0x7523))
    for product in products.split():
        vendor, number = (int(text, 16) for text in product.split(":"))
        board = FoundPort("COM7", "board", (vendor, number))
        assert port_of(device, [other, board]) == "COM7"
        matches = found_devices([device], [other, board])
        assert [(match.device, match.port) for match in matches] == [(device.id, "COM7")]


def test_the_strong_motor_of_a_gamepad_is_the_side_that_pages_and_players_take_for_it():
    # phone_page.html and players/web/src/outputs.js: left strong, right weak.
    strong, weak = load_device("gamepad_rumble").actuators
    assert (strong.id, strong.place.side, weak.id, weak.place.side) == (
        "strong",
        "left",
        "weak",
        "right",
    )
    assert strong.type.controls[1].neutral < weak.type.controls[1].neutral  # large, slow mass


@pytest.mark.parametrize("model_id", MODELS)
@pytest.mark.parametrize("name", EXPECTED)
def test_actuators_lie_on_their_part(name, model_id):
    device, model, actual = cells(name, model_id)
    part, sides, count = EXPECTED[name]
    assert len(device.actuators) == count and actual.counts.min() >= 1
    if part is None:
        assert (actual.counts == len(model)).all()
        return
    assert {PARTS[p] for p in model.part[actual.reached]} == set(part.split())
    if sides is not None:
        assert set(model.side[actual.reached]) == sides
    for row in actual.rows:
        assert (np.diff(row) > 0).all()


@pytest.mark.parametrize("name", sorted(set(EXPECTED) - IN_THE_ROOM - ALL_ROUND))
def test_actuators_are_centred_on_the_skin_and_tile_the_skin(name):
    device, model, actual = cells(name, "hfx-pressure-1")
    mirror = np.array([-1.0, 1.0, 1.0]) if device.is_mirrored else np.ones(3)
    for actuator, row in zip(device.actuators, actual.rows, strict=True):
        assert isinstance(actuator.place, BodyPlace)
        centre = np.array(actuator.place.centre_m) * mirror
        # Centres are on the skin: within one vertex spacing (25 mm) of a vertex.
        assert np.linalg.norm(model.vertices[row] - centre, axis=1).min() < 0.0125
    overlaps = np.bincount(np.concatenate(actual.rows), minlength=len(model))
    assert overlaps.max() <= 3
    assert len({row.tobytes() for row in actual.rows}) == len(actual.rows)


@pytest.mark.parametrize("name", ["back_pad", "pressure_vest", "bhaptics_tactsuit_x40"])
def test_a_torso_device_leaves_no_gap_between_its_actuators(name):
    device, model, actual = cells(name, "hfx-pressure-1")
    for is_back in (True, False):
        centres = np.array(
            [a.place.centre_m for a in device.actuators if (a.place.centre_m[1] > 0) == is_back]
        )
        if not len(centres):
            continue
        low, high = centres.min(axis=0), centres.max(axis=0)
        x, y, z = model.vertices.T
        is_inside = (x > low[0]) & (x < high[0]) & (z > low[2]) & (z < high[2])
        is_inside &= (y > 0.0) == is_back
        is_inside &= model.part == PARTS.index("torso")
        is_reached = np.isin(np.flatnonzero(is_inside), actual.reached)
        assert is_reached.mean() > 0.9


def test_left_and_right_bands_mirror_each_other():
    _, model, left = cells("forearm_band_left", "hfx-vibration-1")
    _, _, right = cells("forearm_band_right", "hfx-vibration-1")
    for a, b in zip(left.rows, right.rows, strict=True):
        flipped = model.vertices[a] * np.array([-1.0, 1.0, 1.0])
        gaps = np.linalg.norm(flipped[:, None] - model.vertices[b][None], axis=2).min(axis=1)
        assert gaps.max() < 1e-5


def test_the_band_goes_once_round_the_arm():
    device, model, actual = cells("forearm_band_left", "hfx-pressure-1")
    centres = np.array([model.vertices[row].mean(axis=0) for row in actual.rows])
    steps = np.linalg.norm(np.roll(centres, -1, axis=0) - centres, axis=1)
    assert 0.02 < steps.min() and steps.max() < 0.05  # 8 steps round about 25 cm
    assert np.linalg.norm(centres[0] - centres[4]) > 0.06
    assert np.argmax(centres[:, 0]) in (7, 0, 1)  # the first is on the outer side
    assert device.actuators[0].id == "m1"


def centres_of(device):
    return np.array([item.place.centre_m for item in device.actuators])


def test_the_mango_pad_is_ten_tactors_in_triangles_of_63_5_mm_seen_and_felt_on_one_side():
    device = load_device("mango_pad")
    rows = [
        [i for i, a in enumerate(device.actuators) if a.id.startswith(f"r{k}")] for k in (1, 2, 3)
    ]
    assert [len(row) for row in rows] == [3, 4, 3]
    centres = centres_of(device)
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    np.testing.assert_allclose(gaps.min(axis=1), 0.0635, atol=1e-5)
    assert (np.isclose(gaps, 0.0635, atol=1e-5).sum(axis=1) >= 3).all()
    for row in rows:
        assert (np.diff(centres[row, 0]) < 0.0).all()  # to the right on the screen: wearer's right
    assert centres[rows[0], 2].min() > centres[rows[1], 2].max() > centres[rows[2], 2].max()
    assert (device.scheme.name, device.scheme.law) == ("barycentric", "log")
    assert (device.width_m, device.height_m) == (0.29, 0.21)


def test_the_belt_goes_once_round_the_waist_in_equal_arcs():
    device = load_device("waist_belt")
    centres = centres_of(device)
    assert np.ptp(centres[:, 2]) < 1e-3
    x, y = centres[:, 0], centres[:, 1] - centres[:, 1].mean()
    angles = np.unwrap(np.arctan2(x, -y))
    assert (np.diff(angles) > 0.0).all() and angles[-1] - angles[0] < 2.0 * np.pi
    assert device.actuators[0].id == "front" and y[0] == y.min() and abs(x[0]) < 0.005
    assert x[2] == x.max() and device.actuators[2].id == "left"
    chords = np.linalg.norm(np.roll(centres, -1, axis=0) - centres, axis=1)
    assert np.ptp(chords) < 0.015  # equal along the skin, nearly so in the air
    assert device.scheme.name == "ring"


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_small_peltier_between_temperature_vertices_still_fires(side):
    device, model, actual = cells(f"peltier_sleeve_{side}", "hfx-temperature-1")
    mirror = np.array([1.0 if side == "left" else -1.0, 1.0, 1.0])
    gaps = np.linalg.norm(model.vertices[None] - (centres_of(device) * mirror)[:, None], axis=2)
    assert gaps.min(axis=1).max() > 0.02  # at least one element has no vertex within 20 mm
    assert (actual.counts >= 1).all()
    highest = MODALITIES["temperature"].strength_parameter.device_maximum
    assert device.actuator_types["element"].strength.highest <= highest


def test_the_first_motors_of_the_x40_are_at_the_wearers_upper_left():
    device = load_device("bhaptics_tactsuit_x40")
    for block, is_back in ((slice(0, 20), False), (slice(20, 40), True)):
        x, y, z = centres_of(device)[block].T
        assert ((y > 0.0) == is_back).all()
        grid = x.reshape(5, 4)
        assert (np.diff(grid, axis=1) < 0.0).all() and grid[0, 0] > 0.0
        assert (np.diff(z.reshape(5, 4), axis=0) < 0.0).all()
    dots = device.output.encoder.dots
    assert dots == tuple((p, i) for p in ("VestFront", "VestBack") for i in range(20))


def test_phones_and_known_figures_are_as_published():
    lra = load_device("phone_lra").actuator_types["lra"]
    assert lra.update_interval_ms == 50.0 and lra.controls[1].minimum == lra.controls[1].maximum
    wide = load_device("phone_wide_band").actuator_types["actuator"]
    assert (wide.controls[1].minimum, wide.controls[1].maximum) == (80.0, 260.0)
    assert wide.strength.maximum == pytest.approx(1.3 * 9.80665, abs=0.01)


@pytest.mark.parametrize("name", EXPECTED)
def test_each_device_page_names_the_driver(name):
    page = (Path(__file__).parents[2] / "docs" / "devices.md").read_text(encoding="utf-8")
    device = load_device(name)
    stem = name.removesuffix(f"_{device.side}")
    row, picture = (line for line in page.splitlines() if line.startswith(f"| `{stem}`"))
    *_, route, _ = row.split("|")
    kinds = {None: "none live", "serial": "serial port", "websocket": "websocket", "udp": "OSC"}
    played = "sound card" if "sound card" in route else kinds[kind_of(device)]
    assert played in route
    assert played != "sound card" or any(a.type.takes_waveform for a in device.actuators)
    assert f"device_configs/pictures/{stem}.png" in picture
    assert (resources.device_configs() / "pictures" / f"{stem}.png").stat().st_size > 0
