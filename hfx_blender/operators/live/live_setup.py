# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds present devices, and aligns touch, sound and picture in time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ...devices.live import live_settings
from ...errors import InputError
from ...files import resources
from ...playback.live.live import live
from ...text import printable
from ..shared import EnumItems, HfxOperator
from .live_operators import title_of

if TYPE_CHECKING:
    from ...devices.live.discovery import Found


class DeviceSearch:
    """Result of the last search for devices.

    Attributes
    ----------
    found : list of Found
    items : list of tuple
        Enum items of ``found``; Blender needs these strings kept alive.
    """

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.items: EnumItems = []

    def run(self) -> list[str]:
        """Replace :attr:`found` and :attr:`items`; returns the names of all serial ports."""
        from ...devices.live.discovery import found_at

        # Adding a device reports errors of its configuration.
        ports, self.found, _ = found_at(resources.user_devices())
        self.items = [
            (
                str(k),
                f"{title_of(device.device)}  {device.port or device.unit}".rstrip(),
                device.description,
            )
            for k, device in enumerate(self.found)
        ]
        return ports


search = DeviceSearch()


def _choices(_self: object, _context: object) -> EnumItems:
    return search.items


class HFX_OT_live_find(HfxOperator):
    """Search for devices: serial ports by USB id, programs on this computer and in the network"""

    bl_idname = "hfx.live_find"
    bl_label = "Find Devices"
    bl_options = {"REGISTER"}  # device actions have no undo
    bl_property = "which"

    which: EnumProperty(name="Device", description="Device to add", items=_choices)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        ports = search.run()
        if not search.found:
            there = ", ".join(ports) or "none"
            self.report(
                {"WARNING"}, printable(f"No known device was found. Serial ports: {there}.")
            )
            return {"CANCELLED"}
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        if not self.which.isdecimal() or int(self.which) >= len(search.found):
            raise InputError("Press Find Devices first, and choose one.")
        device = search.found[int(self.which)]
        settings = live_settings.load().get(device.device, live_settings.LiveSettings())
        settings = replace(settings, kind="DEVICE", port=device.port, unit=device.unit)
        if device.device not in context.scene.hfx.devices:
            context.scene.hfx.devices.add().name = device.device
        live.connect(device.device, settings)
        live_settings.store(device.device, settings)
        return f"{title_of(device.device)}: {device.description}"


class HFX_OT_live_offset(HfxOperator):
    """Delay the values of a device to match sound and picture; the delay is saved"""

    bl_idname = "hfx.live_offset"
    bl_label = "Offset"
    bl_options = {"REGISTER"}

    name: StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    offset_ms: FloatProperty(
        name="Offset (ms)",
        description="Delay of the values; takes effect while you drag it",
        default=0.0,
        min=0.0,
        max=live_settings.MAX_OFFSET_MS,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.offset_ms = live.offset_ms(self.name)
        return context.window_manager.invoke_props_dialog(self)

    def check(self, _context: bpy.types.Context) -> bool:
        live.set_offset(self.name, self.offset_ms)
        return True

    def cancel(self, _context: bpy.types.Context) -> None:
        known = live_settings.load().get(self.name, live_settings.LiveSettings())
        live.set_offset(self.name, known.offset_ms)

    def work(self, _context: bpy.types.Context) -> str:
        if live.state(self.name) is None:
            raise InputError(f"Device '{title_of(self.name)}' is not connected.")
        live.set_offset(self.name, self.offset_ms)
        known = live_settings.load().get(self.name, live_settings.LiveSettings())
        live_settings.store(self.name, replace(known, offset_ms=self.offset_ms))
        return f"{title_of(self.name)} is delayed by {self.offset_ms:g} ms"
