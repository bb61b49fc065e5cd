# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences: the user's colours and folders, removed without a trace."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

import hfx_blender
from hfx_blender.engine import colouring
from hfx_blender.files import resources
from hfx_blender.properties import preferences


@pytest.fixture
def chosen(scene: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The preferences of the enabled add-on."""
    monkeypatch.setenv(resources.DEVICES_VARIABLE, "/where/it/was")
    monkeypatch.delenv(resources.EFFECTS_VARIABLE, raising=False)
    own = dict(colouring.PALETTES["OWN"])
    addons = bpy.context.preferences.addons
    addon = addons.new()
    addon.module = hfx_blender.__name__
    yield preferences.preferences()
    addons.remove(addon)
    colouring.set_own_palette(own)


def test_without_an_installed_extension_there_are_none(scene: Any) -> None:
    assert preferences.preferences() is None


def test_own_colours_are_a_palette(chosen: Any) -> None:
    chosen.wind = (0.25, 0.5, 0.75)
    assert colouring.PALETTES["OWN"]["wind"] == (0.25, 0.5, 0.75)
    assert colouring.PALETTES["PAPER"] is colouring.COLOURS
    bpy.context.scene.hfx.palette = "OWN"
    defaults = {name: tuple(getattr(chosen, name)) for name in ("vibration", "temperature", "cold")}
    warm_cold = colouring.PALETTES["WARM_COLD"]
    assert defaults == {name: pytest.approx(warm_cold[name]) for name in defaults}


def test_own_folders_are_searched_by_child_processes_too(chosen: Any, tmp_path: Path) -> None:
    chosen.devices_folder = chosen.effects_folder = str(tmp_path)
    assert resources.user_devices() == resources.user_effects() == tmp_path
    assert os.environ[resources.DEVICES_VARIABLE] == str(tmp_path)
    chosen.devices_folder = ""
    assert resources.user_devices() == Path("/where/it/was")
    hfx_blender.unregister()
    try:
        assert resources.EFFECTS_VARIABLE not in os.environ
    finally:
        hfx_blender.register()
    assert resources.user_effects() == tmp_path  # chosen still


def test_folders_are_as_before_once_it_is_off(chosen: Any, tmp_path: Path) -> None:
    chosen.devices_folder = str(tmp_path)
    chosen.devices_folder = chosen.effects_folder = ""
    assert os.environ[resources.DEVICES_VARIABLE] == "/where/it/was"
    assert resources.EFFECTS_VARIABLE not in os.environ
