# SPDX-License-Identifier: GPL-3.0-or-later
"""*Feel on a Phone* connects the phone by a page on the computer's own address."""

import bpy

from hfx_blender.devices.live import live_settings
from hfx_blender.devices.transports import page_output
from hfx_blender.operators.live import connect_operators
from hfx_blender.playback.live.live import live


def test_feel_on_a_phone_adds_the_phone_and_serves_a_page(scene, monkeypatch) -> None:
    monkeypatch.setattr(page_output, "own_address", lambda: "127.0.0.1")
    targets = []
    monkeypatch.setattr(live, "connect", lambda name, how: targets.append((name, how)))
    stored = []
    monkeypatch.setattr(live_settings, "store", lambda name, how: stored.append(name))
    assert bpy.ops.hfx.live_phone() == {"FINISHED"}
    assert "phone_lra" in scene.hfx.devices
    ((name, settings),) = targets
    assert (name, settings.kind, settings.host) == ("phone_lra", "PAGE", "127.0.0.1")
    assert stored == ["phone_lra"]


def test_address_and_code_are_lines_of_the_panel() -> None:
    unit = "http://192.168.1.5:8137 code 042137"
    assert live_settings.page_of(unit) == ("192.168.1.5:8137", "042137")
    assert live_settings.page_of("Lovense Lush (left)")[1] == ""


def test_the_menu_of_devices_fits_above_its_button_in_a_low_window() -> None:
    """In a window of 720 pixels the button is 465 below the top; a row takes 20, a title 30."""
    lengths = []
    for item in connect_operators.device_items(None, None):
        if not item[0]:
            lengths.append(0)
        else:
            lengths[-1] += 1
    assert len(lengths) == 3 and 20 * max(lengths) + 30 < 465


def test_boards_without_a_place_are_listed_last_and_not_by_their_example() -> None:
    items = connect_operators.device_items(None, None)
    names, titles = [item[0] for item in items], [item[1] for item in items if not item[0]]
    assert titles == ["Head and Trunk", "Arms and Legs", "Hands, Room and Other"]
    last = names[[item[1] for item in items].index("Hands, Room and Other") :]
    boards = {"arduino_uno_pwm", "sound_card_8", "vrc_haptics_board_left"}
    assert boards < set(last) and "thermal_grill" not in last
