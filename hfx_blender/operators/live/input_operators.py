# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of live input: tracked bodies, received values, and recordings of both.

Addresses and ports are stored with the user's settings, never in a .blend.
"""

from typing import Any, Final

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty

from ...authoring.effects import effects
from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json, stored_json
from ...playback.live.body_tracking import body_tracking
from ...playback.live.listening import listening, properties_by_parameter
from ...playback.live.vr_source import VrSource, create_actions_with_session
from ...tracking.receiver import OscReceiver
from ...tracking.value_addresses import address_of, is_used
from ..shared import HfxOperator, active_body, active_effect
from .connect_operators import LiveOperator

VMC_PORT: Final = 39539  # port of the VMC protocol for programs that receive a body
VALUES_PORT: Final = 39600

REACHES = (
    ("127.0.0.1", "This Computer", "Receive from programs on this computer only"),
    ("0.0.0.0", "Local Network", "Receive from private addresses of the local network as well"),
)
"""Addresses to listen on."""

SOURCES = (
    ("VMC", "VMC", "A program that sends the VMC protocol"),
    ("VR", "VR Session", "Head and hands of Blender's VR session, started afterwards"),
)


def input_settings() -> dict[str, Any]:
    """Stored ports and addresses by the name of an operator's field; empty without a valid file."""
    return stored_json(_settings_file()) or {}


def _settings_file() -> Any:
    return resources.live_settings().with_name("live_inputs.json")


def _port(description: str, default: int) -> IntProperty:
    return IntProperty(name="Port", description=description, default=default, min=1, max=65535)


class _Receiving(LiveOperator):
    """Base of operators that open a port."""

    settings: str  # key of the stored port and address

    address: EnumProperty(
        name="Receive From", description="Senders that are accepted", items=REACHES
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        stored = input_settings().get(self.settings)
        stored = stored if isinstance(stored, dict) else {}
        if isinstance(stored.get("port"), int) and 1 <= stored["port"] <= 65535:
            self.port = stored["port"]
        if stored.get("address") in [address for address, _, _ in REACHES]:
            self.address = stored["address"]
        return context.window_manager.invoke_props_dialog(self)

    def store(self) -> None:
        """Store port and address with the user's settings."""
        entry = {"port": self.port, "address": self.address}
        if input_settings().get(self.settings) != entry:
            amend_json(_settings_file(), lambda: {**input_settings(), self.settings: entry})


def body_to_track(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active haptic body, else the first body of the scene; None without a body."""
    bodies = effects.bodies_of(context.scene)
    active = active_body(context)
    return active if active in bodies else next(iter(bodies), None)


class HFX_OT_track_body(_Receiving):
    """Let the active haptic body follow a tracked person, while nothing plays"""

    bl_label = "Track Body"
    settings = "vmc"
    requires = ((lambda context: body_to_track(context), "Add a haptic body first"),)

    source: EnumProperty(name="Source", description="Origin of the poses", items=SOURCES)
    port: _port("Port of the VMC protocol, to which a tracking program sends", VMC_PORT)

    def work(self, context: bpy.types.Context) -> str:
        from ...playback.live.vmc_source import VmcSource

        body = body_to_track(context)
        if self.source == "VR":
            create_actions_with_session()
            body_tracking.start(body, VrSource())
            return f"'{body.name}' follows the VR session"
        body_tracking.start(body, VmcSource(self.address, self.port))
        self.store()
        return f"'{body.name}' follows port {self.port}"

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.prop(self, "source")
        column = column.column()
        column.enabled = self.source == "VMC"
        column.prop(self, "port")
        column.prop(self, "address")


class _OfBody(HfxOperator):
    name: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def tracker(self) -> Any:
        """Tracker of the body with :attr:`name`; InputError if the body is not tracked."""
        body = bpy.data.objects.get(self.name)
        tracker = None if body is None else body_tracking.of(body)
        if tracker is None:
            raise InputError(f"'{self.name}' is not tracked.")
        return tracker


class HFX_OT_track_stop(_OfBody):
    """End the tracking of a body. The pose before the tracking comes back"""

    bl_label = "Stop Tracking"
    bl_options = {"REGISTER"}  # the scene is as before

    def work(self, _context: bpy.types.Context) -> str:
        body_tracking.stop(self.tracker())
        return f"'{self.name}' has the pose before the tracking"


class HFX_OT_track_record(_OfBody):
    """Record the tracked body from the current frame on. Press again to end the tracking and get an
    action with a keyframe at each frame"""

    bl_label = "Record Body"

    def work(self, context: bpy.types.Context) -> str:
        tracker = self.tracker()
        if tracker.recording is None:
            body_tracking.record(tracker, context.scene)
            return f"Recording from frame {context.scene.frame_current} on"
        action = body_tracking.finish_recording(tracker, context.scene)
        first, last = action.frame_range
        return f"'{action.name}' has frames {first:.0f} to {last:.0f}"


class HFX_OT_listen(_Receiving):
    """Receive values of effects, clips and devices from other programs by OSC"""

    bl_label = "Listen"
    settings = "values"

    port: _port("Port to which another program sends OSC messages", VALUES_PORT)

    def work(self, _context: bpy.types.Context) -> str:
        listening.stop()  # may have the same port
        listening.start(OscReceiver(self.address, self.port, is_used=is_used))
        self.store()
        return f"Listening on port {self.port}"


class HFX_OT_listen_stop(LiveOperator):
    """End receiving. Effects have the values of the scene again"""

    bl_label = "Stop Listening"

    def work(self, _context: bpy.types.Context) -> str:
        listening.stop()
        return ""


class HFX_OT_listen_record(HfxOperator):
    """Record received values at the frames of the timeline. Press again to get keyframes and
    clips"""

    bl_label = "Record Values"
    requires = ((lambda _context: listening.receiver is not None, "Press Listen first"),)

    def work(self, context: bpy.types.Context) -> str:
        if not listening.is_recording:
            listening.record()
            return "Recording: play the timeline"
        return listening.finish_recording(context.scene)


class HFX_OT_copy_address(HfxOperator):
    """Copy the OSC address of a value of the active effect, for another program"""

    bl_label = "Copy Address"
    bl_options = {"REGISTER"}
    requires = ((active_effect, "Select an effect"),)

    parameter: StringProperty(
        name="Value", default="intensity", options={"SKIP_SAVE"}, description="Value of the address"
    )

    def work(self, context: bpy.types.Context) -> str:
        effect = active_effect(context)
        parameters = [*properties_by_parameter(effect), "mute"]
        if self.parameter not in parameters:
            raise InputError(
                f"'{effect.name}' has no value '{self.parameter}'; it has: {', '.join(parameters)}."
            )
        address = address_of("effect", effect.name, self.parameter)
        context.window_manager.clipboard = address
        return f"{address} copied"
