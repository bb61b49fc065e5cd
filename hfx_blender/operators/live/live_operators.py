# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of live devices: add, connect, play, stop, approve scripts."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...devices.live import live_settings
from ...errors import InputError
from ...files import resources
from ...playback.live.live import live
from ...text import printable
from ..shared import EnumItems, HfxOperator, KeyBindings, kept_items

if TYPE_CHECKING:
    from ...devices.live.approval import DeviceScript
    from ...devices.live.discovery import Found

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
)


class _LiveOperator(HfxOperator):
    bl_options = {"REGISTER"}  # device actions have no undo


class _OfDevice(_LiveOperator):
    name: StringProperty(options={"HIDDEN", "SKIP_SAVE"})


def _settings_of(name: str) -> live_settings.LiveSettings:
    """Stored connection settings of a device; defaults for a device without any."""
    return live_settings.load().get(name, live_settings.LiveSettings())


def title_of(name: str) -> str:
    """Title of a device in the panel, from its configuration."""
    from ...devices.configurations.device_facts import facts_of

    return facts_of(name).title


@kept_items
def _known() -> EnumItems:
    from ...devices.configuration import list_devices
    from ...devices.configurations.device_facts import ROOM, facts_of
    from ...engine.body.parts import GROUPS

    all_facts = [facts_of(name) for name in list_devices(resources.user_devices())]
    items: EnumItems = []
    for group in (*GROUPS, ROOM, ""):  # columns, by where devices are worn
        part = [facts for facts in all_facts if facts.group == group]
        items += [("", group or "Other", "")] if part else []
        items += [(facts.id, facts.label, facts.fault or facts.summary) for facts in part]
    return items


class HFX_OT_live_add(HfxOperator):
    """Add a device to this scene, by name"""

    bl_label = "Add Device"
    bl_property = "name"

    name: EnumProperty(name="Device", items=_known)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        devices = context.scene.hfx.devices
        if self.name in devices:
            raise InputError(f"Device '{title_of(self.name)}' is in this scene already.")
        item = devices.add()
        item.name, item.is_expanded = self.name, True
        return f"{title_of(self.name)} added"


class HFX_OT_live_import(HfxOperator, ImportHelper):
    """Create a device from a VRChat node map or a Unitouch layout, and add it to the scene"""

    bl_label = "Import Node Map or Layout"

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    name: StringProperty(name="Name", description="Name of the device; empty: the name of the file")

    def work(self, context: bpy.types.Context) -> str:
        from ...devices.configurations.imported_layouts import import_layout

        path = Path(self.filepath)
        imported = import_layout(path, self.name or path.stem.lower().replace(" ", "_"))
        if imported.stem not in context.scene.hfx.devices:
            context.scene.hfx.devices.add().name = imported.stem
        return f"{imported.stem} imported"


class HFX_OT_live_remove(HfxOperator):
    """Disconnect a device and remove the device from the scene"""

    bl_label = "Remove Device"

    name: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> str:
        # First, as a device without a row in the panel could not be stopped there.
        live.disconnect(self.name)
        devices = context.scene.hfx.devices
        index = devices.find(self.name)
        if index >= 0:
            devices.remove(index)
        return f"{title_of(self.name)} removed"


class HFX_OT_live_connect(_OfDevice):
    """Connect a device and play the effects"""

    bl_label = "Connect"

    kind: EnumProperty(
        name="Connect To", description="The device itself, or a substitute", items=KINDS
    )
    port: StringProperty(
        name="Port",
        description="Serial port, network port, or part of a sound card's name; "
        "empty: found or as configured",
    )
    host: StringProperty(
        name="Host", description="Host on this computer or network; empty: as configured"
    )
    unit: StringProperty(
        name="Which One",
        description="Which of several devices of one server: its name there, or # and its number; "
        "empty: the first that no other device has",
    )
    path: StringProperty(name="Log", description="File to write", subtype="FILE_PATH")
    offset_ms: FloatProperty(
        name="Offset (ms)",
        description="Delay of the values, to be in time with sound and picture",
        default=0.0,
        min=0.0,
        max=live_settings.MAX_OFFSET_MS,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        for field, value in asdict(_settings_of(self.name)).items():
            setattr(self, field, value)
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "kind")
        if self.kind == "AUDIO":
            layout.prop(self, "port", text="Sound Card")
        elif self.kind == "DEVICE":
            layout.prop(self, "port")
            layout.prop(self, "host")
            layout.prop(self, "unit")
        else:
            layout.prop(self, "path")
        layout.prop(self, "offset_ms")

    def work(self, _context: bpy.types.Context) -> str:
        from ...devices.live.discovery import serial_number_of, serial_ports

        known = _settings_of(self.name)
        unit = self.unit
        if self.port != known.port and unit == known.unit:  # the port was changed
            unit = serial_number_of(self.port, serial_ports())
        settings = live_settings.LiveSettings(
            self.kind, self.port, self.host, self.path, self.offset_ms, unit
        )
        live.connect(self.name, settings)
        # After connecting: settings that raise an error are not kept.
        live_settings.store(self.name, settings)
        return ""


class HFX_OT_live_disconnect(_OfDevice):
    """Silence a device and close the port"""

    bl_label = "Disconnect"

    def work(self, _context: bpy.types.Context) -> str:
        live.disconnect(self.name)
        return f"{title_of(self.name)} disconnected"


class HFX_OT_live_play(_LiveOperator):
    """Resume the output to connected devices after a stop, from silence"""

    bl_label = "Play"
    requires = ((lambda _context: live.states, "Connect a device first"),)

    def work(self, _context: bpy.types.Context) -> str:
        live.arm()
        return ""


class HFX_OT_live_stop_all(bpy.types.Operator):
    """Silence every device at once (Ctrl Shift Backspace, or Pause)"""

    bl_idname = "hfx.live_stop_all"
    bl_label = "Stop All"
    bl_options = {"REGISTER"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        # No question and no check: a stop works in every mode.
        live.stop_all()
        return {"FINISHED"}


class HFX_OT_live_pulse(_OfDevice):
    """Play a short, weak pulse on one actuator"""

    bl_label = "Test Pulse"

    actuator: IntProperty(options={"HIDDEN", "SKIP_SAVE"}, min=0)

    def work(self, _context: bpy.types.Context) -> str:
        state = live.state(self.name)
        if state is None or not state.is_armed:
            raise InputError(
                f"Device '{title_of(self.name)}' is not playing; connect it and press Play."
            )
        live.pulse(self.name, self.actuator)
        return ""


class HFX_OT_live_approve(_OfDevice):
    """Approve the current script of a device"""

    bl_label = "Approve Device Script"

    fingerprint: StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    script: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        shown = self.reported(self._show)
        if shown != {"FINISHED"}:
            return shown
        return context.window_manager.invoke_props_dialog(self, width=520)

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.label(text=self.script, icon="FILE_SCRIPT")
        column.label(text="The script runs with your rights: files, network, everything.")
        column.label(text="Read the script first. Every change needs a new approval.")

    def _show(self) -> None:
        script = self._found()
        self.fingerprint, self.script = script.fingerprint, str(script.path)

    def _found(self) -> DeviceScript:
        """Script of the device with its present fingerprint; InputError without a script."""
        from ...devices.live import approval

        script = approval.script_of(self.name, resources.user_devices())
        if script is None:
            raise InputError(f"Device '{title_of(self.name)}' has no script.")
        return script

    def work(self, _context: bpy.types.Context) -> str:
        from ...devices.live import approval

        script = self._found()
        # The dialog may be open for long: only the version that was shown is approved.
        if self.fingerprint and script.fingerprint != self.fingerprint:
            raise InputError(f"{script.path}: has just changed; read it again.")
        approval.approve(script)
        live.unapproved.discard(self.name)
        if not approval.is_shipped(script.path):
            live.approved[self.name] = script.fingerprint
        return f"{script.path.name} approved"


class HFX_OT_live_revoke(_OfDevice):
    """Revoke the approval of a device's script, and stop it if running"""

    bl_label = "Withdraw Approval"

    fingerprint: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def work(self, _context: bpy.types.Context) -> str:
        from ...devices.live import approval

        if self.fingerprint:  # from the preferences, also without the script's files
            live.withdraw({self.fingerprint})
            approval.revoke_fingerprint(self.fingerprint)
            return "Approval withdrawn"
        running = live.approved.get(self.name)  # the files may have changed since
        # The running script first: its files may be unreadable by now.
        live.withdraw(set() if running is None else {running})
        script = approval.script_of(self.name, resources.user_devices())
        if script is not None:
            approval.revoke(script)
        if running is not None and running in approval.approved():
            approval.revoke_fingerprint(running)
        if script is None and running is None:
            raise InputError(f"Device '{title_of(self.name)}' has no script.")
        return f"{title_of(self.name)}: approval withdrawn"


class DeviceSearch:
    """Result of the last search for devices."""

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.items: EnumItems = []  # of `found`; Blender needs these strings kept alive

    def run(self) -> list[str]:
        """Search for devices, for some tenths of a second; replace :attr:`found` and :attr:`items`;
        returns the names of all serial ports. Faulty configurations are left out."""
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


# A function of the module: Blender evaluates annotations without this module's names in lambdas.
def _choices(_self: object, _context: object) -> EnumItems:
    return search.items


class HFX_OT_live_find(_LiveOperator):
    """Search for devices: serial ports by USB id, programs on this computer and in the network"""

    bl_label = "Find Devices"
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
        settings = replace(
            _settings_of(device.device), kind="DEVICE", port=device.port, unit=device.unit
        )
        if device.device not in context.scene.hfx.devices:
            context.scene.hfx.devices.add().name = device.device
        live.connect(device.device, settings)
        live_settings.store(device.device, settings)
        return f"{title_of(device.device)}: {device.description}"


class HFX_OT_live_offset(_OfDevice):
    """Delay the values of a device to match sound and picture; the delay is saved"""

    bl_label = "Offset"

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
        # Dragging has changed the offset already: back to the stored value.
        live.set_offset(self.name, _settings_of(self.name).offset_ms)

    def work(self, _context: bpy.types.Context) -> str:
        if live.state(self.name) is None:
            raise InputError(f"Device '{title_of(self.name)}' is not connected.")
        live.set_offset(self.name, self.offset_ms)
        settings = replace(_settings_of(self.name), offset_ms=self.offset_ms)
        live_settings.store(self.name, settings)
        return f"{title_of(self.name)} is delayed by {self.offset_ms:g} ms"


_keys = KeyBindings(
    "Window",
    ("hfx.live_stop_all", "BACK_SPACE", {"ctrl": True, "shift": True}),
    ("hfx.live_stop_all", "PAUSE", {}),
)
register, unregister = _keys.register, _keys.unregister
