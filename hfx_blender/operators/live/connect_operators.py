# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that add a device to the scene, find devices, and connect a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ...blender.translation import translated
from ...devices.live import live_settings
from ...engine.body.parts import ARMS, HANDS, HEAD, LEGS
from ...errors import InputError
from ...files import resources
from ...playback.live.live import live
from ...text import printable
from ..shared import EnumItems, HfxOperator, MenuOperator, draw_wrapped, kept_items

if TYPE_CHECKING:
    from ...devices.live.connection_search import Choices
    from ...devices.live.discovery import Found
    from ...engine.rendering.device_config import OutputConfig

KINDS = (
    (
        "SIMULATOR",
        "Simulator",
        "No hardware: shows bars in this panel, and writes a log if you choose a file",
    ),
    ("DEVICE", "Device", "The real device, as configured"),
    (
        "AUDIO",
        "Sound Card",
        "One channel for each vibration actuator, starting at the first channel",
    ),
    ("CSV", "Log", "Writes every value into a CSV file"),
    ("PAGE", "Web Page", "A web page for a browser on a phone, or with a gamepad; asks for a code"),
)
_WIDTH, _LETTERS = 420, 62  # of the dialog, pixels; of its lines


class LiveOperator(HfxOperator):
    bl_options = {"REGISTER"}  # device actions have no undo


class OfDevice(LiveOperator):
    bl_options = {"REGISTER", "INTERNAL"}  # Menu Search would name no device

    name: StringProperty(options={"HIDDEN", "SKIP_SAVE"})


def settings_of(name: str) -> live_settings.LiveSettings:
    """Stored connection settings of a device; defaults for a device without any."""
    return live_settings.load().get(name, live_settings.LiveSettings())


def title_of(name: str) -> str:
    """Title of a device in the panel, from its configuration."""
    from ...devices.configurations.device_facts import facts_of

    return facts_of(name).title


@kept_items
def device_items() -> EnumItems:
    """Devices of the user and shipped devices, in three columns by the places where they are
    worn."""
    from ...devices.configuration import list_devices
    from ...devices.configurations.device_facts import ROOM, facts_of

    all_facts = [facts_of(name) for name in list_devices(resources.user_devices())]
    items: EnumItems = []
    # More columns, or rows, would be cut off in a small window.
    for title, groups in (
        (HEAD, (HEAD,)),
        ("Arms and Legs", (ARMS, LEGS)),
        ("Hands, Room and Other", (HANDS, ROOM, "")),
    ):
        column = [facts for group in groups for facts in all_facts if facts.group == group]
        items += [("", title, "")] if column else []
        items += [(facts.id, facts.label, facts.fault or facts.summary) for facts in column]
    return items


class HFX_OT_live_add(MenuOperator):
    """Add a device to this scene, by name"""

    bl_label = "Add Device"
    bl_property = "name"

    name: EnumProperty(name="Device", items=device_items)

    def work(self, context: bpy.types.Context) -> str:
        devices = context.scene.hfx.devices
        if self.name in devices:
            raise InputError(f"Device '{title_of(self.name)}' is in this scene already.")
        item = devices.add()
        item.name, item.is_expanded = self.name, True
        return f"{title_of(self.name)} added"


def _choices(field: str) -> Callable[[object, object, str], Choices]:
    """``search`` function of a port or unit: ``field`` of the connections found for the output."""

    def present(item: object, _context: object, _text: str) -> Choices:
        from ...devices.live.connection_search import search

        outputs = () if search.newest is None else (search.newest, *search.newest.more)
        number = getattr(item, "index", -1) + 1  # the operator itself has the first output
        return getattr(outputs[number], field) if number < len(outputs) else ()

    return present


class HfxOutputPort(bpy.types.PropertyGroup):
    """Connection of an output after the first."""

    index: IntProperty()  # from 0 for the second output
    port: StringProperty(name="Port", search=_choices("ports"), search_options={"SUGGESTION"})
    host: StringProperty(name="Host")
    unit: StringProperty(name="Which One", search=_choices("units"), search_options={"SUGGESTION"})


def _profiles() -> list[str]:
    from ...devices.configurations import person_profile

    return person_profile.names()


class HFX_OT_live_connect(OfDevice):
    """Connect a device and play the effects"""

    bl_label = "Connect"
    bl_translation_context = "HFX"  # Blender's own "Connect" has another meaning

    kind: EnumProperty(
        name="Connect To",
        description="The device itself, or a substitute",
        items=KINDS,
        translation_context="HFX",
    )
    port: StringProperty(
        name="Port",
        description="Serial port, network port, or part of a sound card's name; "
        "empty: found or as configured",
        search=_choices("ports"),
        search_options={"SUGGESTION"},
    )
    host: StringProperty(
        name="Host", description="Host on this computer or network; empty: as configured"
    )
    unit: StringProperty(
        name="Which One",
        description="Which of several devices of one server: its name there, or # and its number; "
        "empty: the first that no other device has",
        search=_choices("units"),
        search_options={"SUGGESTION"},
    )
    more: CollectionProperty(type=HfxOutputPort, options={"HIDDEN", "SKIP_SAVE"})
    path: StringProperty(
        name="Log", description="File to write", subtype="FILE_PATH", translation_context="HFX"
    )
    profile: StringProperty(
        name="Profile",
        description="Strengths that a person felt on this device, measured by hfx profile make; "
        "empty: none",
        search=lambda _self, _context, _text: _profiles(),
    )
    offset_ms: FloatProperty(
        name="Offset (ms)",
        description="Delay of the values, to be in time with sound and picture",
        default=0.0,
        min=0.0,
        max=live_settings.MAX_OFFSET_MS,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        from ...devices.configurations.device_facts import facts_of
        from ...devices.live.connection_search import why_not

        facts = facts_of(self.name)
        if facts.device is None:
            self.report({"ERROR"}, translated(facts.fault))
            return {"CANCELLED"}
        stored = settings_of(self.name)
        for field in ("kind", "port", "host", "unit", "path", "offset_ms", "profile"):
            setattr(self, field, getattr(stored, field))
        self.more.clear()
        for index in range(len(facts.device.outputs) - 1):
            item, output = self.more.add(), stored.of_output(index + 1)
            item.index, item.port, item.host = index, output.port, output.host
            item.unit = output.unit
        if why_not(facts.device, self.kind):
            self.kind = "SIMULATOR"
        try:
            live_settings.named(self.name)
        except live_settings.UnapprovedScriptError:
            live.unapproved.add(self.name)
        self.check(context)
        return context.window_manager.invoke_props_dialog(
            self, width=_WIDTH, title=translated(f"Connect '{facts.title}'"), confirm_text="Connect"
        )

    def check(self, _context: bpy.types.Context) -> bool:
        from ...devices.configurations.device_facts import facts_of
        from ...devices.live.connection_search import search

        search.start(facts_of(self.name).device, self._settings(self.unit))
        return True

    def cancel(self, _context: bpy.types.Context) -> None:
        from ...devices.live.connection_search import search

        search.end()

    def _settings(self, unit: str) -> live_settings.LiveSettings:
        more = tuple(live_settings.PortSettings(x.port, x.host, x.unit) for x in self.more)
        return live_settings.LiveSettings(
            self.kind, self.port, self.host, self.path, self.offset_ms, unit, more, self.profile
        )

    def draw(self, _context: bpy.types.Context) -> None:
        from ...devices.configurations.device_facts import facts_of
        from ...devices.live.connection_search import search, why_not

        layout, device = self.layout, facts_of(self.name).device
        reasons = {kind: why_not(device, kind) for kind, _, _ in KINDS}
        row = layout.row(align=True)
        for kind, reason in reasons.items():
            column = row.column(align=True)
            column.enabled = not reason
            column.prop_enum(self, "kind", kind)
        for reason in filter(None, reasons.values()):
            draw_wrapped(layout.column(align=True), reason, _LETTERS, "INFO")
        layout.use_property_split = True
        column = layout.column()
        if self.kind == "AUDIO":
            column.prop(self, "port", text="Sound Card", placeholder="Default")
        elif self.kind == "PAGE":
            column.prop(self, "host", placeholder="127.0.0.1")
        elif self.kind == "DEVICE":
            for item, output in zip((self, *self.more), device.outputs, strict=False):
                if len(device.outputs) > 1:
                    ids = ", ".join(device.actuators[k].id for k in output.actuators)
                    column.label(text=ids, icon="PLUGIN", translate=False)
                self._draw_connection(column, item, output)
        else:
            column.prop(self, "path")
        column.prop(self, "profile")
        column.prop(self, "offset_ms")
        newest = search.newest
        if self.name in live.unapproved:
            layout.label(text="The device has a script: approve it first", icon="ERROR")
            layout.operator("hfx.live_approve", icon="FILE_SCRIPT").name = self.name
        if newest is None:
            layout.label(text="Searching...", icon="SORTTIME")
        elif newest.hint:
            draw_wrapped(layout.column(align=True), newest.hint, _LETTERS, "ERROR")
        elif self.kind == "DEVICE":
            layout.label(text="Ready to connect", icon="CHECKMARK")

    def _draw_connection(
        self, column: bpy.types.UILayout, item: object, output: OutputConfig
    ) -> None:
        """Draw the fields of a serial port or network address, and of a server's devices."""
        from ...engine.rendering.device_config import (
            ButtplugEncoder,
            SerialTransport,
            VrcHapticsEncoder,
        )

        if isinstance(output.transport, SerialTransport):
            column.prop(item, "port", text="Serial Port", placeholder="Found by USB")
        else:
            column.prop(item, "host", placeholder=output.transport.host or "Found by announcement")
            column.prop(item, "port", placeholder=str(output.transport.port))
        if isinstance(output.encoder, VrcHapticsEncoder):
            column.prop(item, "unit", placeholder="The only board")
        elif isinstance(output.encoder, ButtplugEncoder) or item.unit:
            column.prop(item, "unit", placeholder="First free device")

    def work(self, _context: bpy.types.Context) -> str:
        from ...devices.live.connection_search import search
        from ...devices.live.discovery import serial_number_of, serial_ports

        search.end()  # a server may accept one client only
        known = settings_of(self.name)
        unit = self.unit
        if self.port != known.port and unit == known.unit:  # the port was changed
            unit = serial_number_of(self.port, serial_ports())
        settings = self._settings(unit)
        live.connect(self.name, settings)
        # After connecting: settings that raise an error are not kept.
        live_settings.store(self.name, settings)
        return ""


class HFX_OT_live_phone(LiveOperator):
    """Open a web page in the local network that vibrates a phone; the panel shows its address and
    code. The page is not encrypted: use it in a network that you trust"""

    bl_label = "Feel on a Phone"

    def work(self, context: bpy.types.Context) -> str:
        from ...devices.transports.page_output import own_address

        if "phone_lra" not in context.scene.hfx.devices:
            context.scene.hfx.devices.add().name = "phone_lra"
        settings = replace(settings_of("phone_lra"), kind="PAGE", host=own_address())
        live.connect("phone_lra", settings)
        live_settings.store("phone_lra", settings)
        return ""


found: list[Found] = []
"""Result of the last search for devices."""


def find_devices() -> list[str]:
    """Search for devices, for about three seconds, in which devices are silent; replaces
    :data:`found`, and returns the names of all serial ports. Faulty configurations are left out."""
    from ...devices.live.discovery import found_at

    # Adding a device reports errors of its configuration.
    # The search takes some seconds, in which Blender sends no signs of life.
    if live.client is not None:
        live.client.pause()
    ports, found[:], _ = found_at(resources.user_devices())
    return ports


@kept_items
def _found_items() -> EnumItems:
    return [
        (str(k), f"{title_of(d.device)}  {d.port or d.unit}".rstrip(), d.description)
        for k, d in enumerate(found)
    ]


class HFX_OT_live_find(MenuOperator, LiveOperator):
    """Search for devices: serial ports by USB id, programs on this computer and in the network"""

    bl_label = "Find Devices"
    bl_property = "which"

    which: EnumProperty(name="Device", description="Device to add", items=_found_items)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("which"):
            ports = find_devices()
            if not found:
                there = ", ".join(ports) or "none"
                text = printable(f"No known device was found. Serial ports: {there}.")
                self.report({"WARNING"}, translated(text))
                return {"CANCELLED"}
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str:
        if not self.which.isdecimal() or int(self.which) >= len(found):
            raise InputError("Press Find Devices first, and choose one.")
        device = found[int(self.which)]
        more = tuple(live_settings.PortSettings(port, "", unit) for port, unit in device.more)
        settings = replace(
            settings_of(device.device), kind="DEVICE", port=device.port, unit=device.unit, more=more
        )
        if device.device not in context.scene.hfx.devices:
            context.scene.hfx.devices.add().name = device.device
        live.connect(device.device, settings)
        live_settings.store(device.device, settings)
        return f"{title_of(device.device)}: {device.description}"
