# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of live devices: import, remove, play, stop, approve scripts, delay."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...devices.live import live_settings
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...files import resources
from ...playback.live.live import live
from ..shared import HfxOperator, KeyBindings
from .connect_operators import LiveOperator, OfDevice, settings_of, title_of

if TYPE_CHECKING:
    from ...devices.live.approval import DeviceScript
    from ...engine.rendering.device_config import DeviceConfig

MARKS = ("first_felt", "strong_enough", "too_strong")
"""Questions of a profile, in rising order."""


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


class HFX_OT_live_disconnect(OfDevice):
    """Silence a device and close the port"""

    bl_label = "Disconnect"

    def work(self, _context: bpy.types.Context) -> str:
        live.disconnect(self.name)
        return f"{title_of(self.name)} disconnected"


class HFX_OT_live_play(LiveOperator):
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


class HFX_OT_live_pulse(OfDevice):
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


def _percent(name: str, default: float) -> object:
    return FloatProperty(
        name=name,
        description="Share of the device's limits",
        subtype="PERCENTAGE",
        default=default,
        min=0.0,
        max=100.0,
    )


class HFX_OT_live_person(OfDevice):
    """Store the strengths that a person first feels, finds strong enough and too strong on this
    device, as a profile. The device plays each strength when you change it"""

    bl_label = "Set Up Person"

    person: StringProperty(name="Profile", description="Name of the profile", default="me")
    first_felt: _percent("First Felt", 5.0)  # type: ignore[valid-type]
    strong_enough: _percent("Strong Enough", 50.0)  # type: ignore[valid-type]
    too_strong: _percent("Too Strong", 100.0)  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._shown = self._marks(self._device())
        return context.window_manager.invoke_props_dialog(self, width=420)

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.label(text="The device plays a strength for two seconds when you change it.")
        column.label(text="OK replaces the values of this device in the profile.")
        for name in ("person", *MARKS):
            column.prop(self, name)

    def check(self, _context: bpy.types.Context) -> bool:
        with suppress(InputError):  # stopped meanwhile, as the panel shows
            shown, self._shown = self._shown, self._marks(self._device())
            for mark in MARKS:
                strengths = {id: marks[mark] for id, marks in self._shown.items()}
                if strengths != {id: marks[mark] for id, marks in shown.items()}:
                    self._play(strengths)
        return True

    def cancel(self, _context: bpy.types.Context) -> None:
        with suppress(InputError):
            self._play({})  # silent at once

    def work(self, _context: bpy.types.Context) -> str:
        from ...devices.configurations import person_profile

        device = self._device()
        if not self.first_felt <= self.strong_enough <= self.too_strong:
            raise InputError("The strengths must not fall from First Felt to Too Strong.")
        person_profile.store(self.person, device.id, self._marks(device))
        self._play({})
        return f"Profile '{self.person}' stored: choose it under Profile when you connect"

    def _device(self) -> DeviceConfig:
        """Configuration of the playing device. InputError if silent, or limited to a person."""
        state, device = live.state(self.name), live.device(self.name)
        if device is None or state is None or not state.is_armed:
            raise InputError(
                f"Device '{title_of(self.name)}' is not playing; connect it and press Play."
            )
        if settings_of(self.name).profile:
            raise InputError(f"Connect '{title_of(self.name)}' without a profile first.")
        return device

    def _marks(self, device: DeviceConfig) -> dict[str, dict[str, float]]:
        """Strengths of the three marks by actuator id, as shares of each actuator's limit, without
        actuators that are not silent at 0; InputError if none is left."""
        actuators = [a for a in device.actuators if MODALITIES[a.type.modality].is_silent_at_0]
        if not actuators:
            raise InputError(f"Device '{title_of(self.name)}' has no strength that begins at 0.")
        return {
            a.id: {mark: a.type.strength.highest * getattr(self, mark) / 100.0 for mark in MARKS}
            for a in actuators
        }

    def _play(self, strengths: dict[str, float]) -> None:
        """Play strengths by actuator until the devices fade, and 0 at all others."""
        device = self._device()
        values = device.neutral
        for k, actuator in enumerate(device.actuators):
            values[device.strength_columns[k]] = strengths.get(
                actuator.id, values[device.strength_columns[k]]
            )
        live.try_values(self.name, values, is_held=bool(strengths))


class HFX_OT_live_approve(OfDevice):
    """Approve the current script of a device"""

    bl_label = "Approve Device Script"

    fingerprint: StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    script: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        script = self._found()
        self.fingerprint, self.script = script.fingerprint, str(script.path)
        return context.window_manager.invoke_props_dialog(self, width=520)

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.label(text=self.script, icon="FILE_SCRIPT")
        column.label(text="The script runs with your rights: files, network, everything.")
        column.label(text="Read the script first. Every change needs a new approval.")

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
        script = replace(script, fingerprint=self.fingerprint or script.fingerprint)
        approval.approve(script)
        live.unapproved.discard(self.name)
        if not approval.is_shipped(script.path):
            live.approved[self.name] = script.fingerprint
        return f"{script.path.name} approved"


class HFX_OT_live_revoke(OfDevice):
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


class HFX_OT_live_offset(OfDevice):
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
        live.set_offset(self.name, settings_of(self.name).offset_ms)

    def work(self, _context: bpy.types.Context) -> str:
        if live.state(self.name) is None:
            raise InputError(f"Device '{title_of(self.name)}' is not connected.")
        live.set_offset(self.name, self.offset_ms)
        settings = replace(settings_of(self.name), offset_ms=self.offset_ms)
        live_settings.store(self.name, settings)
        return f"{title_of(self.name)} is delayed by {self.offset_ms:g} ms"


_keys = KeyBindings(
    "Window",
    ("hfx.live_stop_all", "BACK_SPACE", {"ctrl": True, "shift": True}, {}),
    ("hfx.live_stop_all", "PAUSE", {}, {}),
)
register, unregister = _keys.register, _keys.unregister
