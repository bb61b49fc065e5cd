# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected devices: samples of the open scene or a track, sent during playback, scrubbing,
dragging.

Blender's main thread evaluates the scene once for each change. Rendering and ports are in processes
of their own. Handlers and the heartbeat timer exist only while a device is connected.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import bpy

from ...blender import events
from ...devices.live import live_settings
from ...files import resources
from ..evaluation import evaluation
from ..timeline.timeline_recorder import recorder
from . import live_handlers
from .latency import Playback
from .live_handlers import SlowFrames
from .live_sources import Generation, SceneSource, TrackSource

if TYPE_CHECKING:
    from ...devices.live.client import DeviceState, LiveClient
    from ...engine.arrays import F64
    from ...engine.rendering.device_config import DeviceConfig
    from ...engine.surface.surface_drive import SurfaceDrive

HOLD_S = 2.0
"""Time until devices fade in a scene without motion, seconds."""


@dataclass(eq=False)
class Connected:
    """Connected device."""

    device: DeviceConfig
    has_script: bool
    offset_ms: float  # delay set by the user

    def __post_init__(self) -> None:
        self.latencies_ms = live_settings.latencies_ms(self.device)  # read with every frame


class Live:
    """Connected devices of this Blender, and the source of their samples."""

    def __init__(self) -> None:
        self.handlers = live_handlers.LiveHandlers(self)  # active while a device is connected
        self.tracks = TrackSource()
        self.slow_frames = SlowFrames()
        self.fault = ""  # error that stopped playing; empty without an error
        self.unapproved: set[str] = set()  # names of devices with a script that needs approval
        self.approved: dict[str, str] = {}  # fingerprint of the approved user script, by device
        # Factors of all gains, such as the fade of a lost tracking, by subject; 0 silences.
        self.factors: dict[str, float] = {}
        self._scene = SceneSource()
        self._playback = Playback()
        self.client: LiveClient | None = None  # None before the first connection
        self.connected: dict[str, Connected] = {}  # by device name
        self.described: Generation | None = None  # description sent to the devices
        # Monotonic time of the last message to the devices; None after the devices were faded.
        self.sent_s: float | None = None
        self._held_until_s = 0.0  # monotonic time; no samples until then

    @property
    def states(self) -> dict[str, DeviceState]:
        """States of the connected devices, by name; empty before the first connection."""
        return {} if self.client is None else self.client.devices

    @property
    def is_armed(self) -> bool:
        """Test for any device in state "armed", which plays samples."""
        return any(device.is_armed for device in self.states.values())

    @property
    def latencies_ms(self) -> set[float]:
        """Compensated latencies of all connected actuators, milliseconds."""
        return {ms for device in self.connected.values() for ms in device.latencies_ms}

    def state(self, name: str) -> DeviceState | None:
        return self.states.get(name) if name in self.connected else None

    def device(self, name: str) -> DeviceConfig | None:
        """Configuration of a connected device; otherwise None."""
        connected = self.connected.get(name)
        return None if connected is None else connected.device

    def connect(self, name: str, settings: live_settings.LiveSettings) -> None:
        """Connect a device, start the output process if needed, and arm the device; does not wait
        for the opening, whose failures arrive as events.

        Raises InputError: the device is unknown, or its script is not approved. Raises DeviceError:
        the device is on no port, or the output process does not start.
        """
        from ...devices.configuration import named_in_blend
        from ...devices.live.approval import is_shipped
        from ...devices.live.client import LiveClient

        # A script runs only with an approved fingerprint: the name alone proves nothing.
        try:
            device, script = live_settings.named(named_in_blend(name))
        except live_settings.UnapprovedScriptError:
            self.unapproved.add(name)
            self.approved.pop(name, None)
            raise
        self.approved.pop(name, None)
        if script is not None and not is_shipped(script.path):
            self.approved[name] = script.fingerprint
        # Paths in settings may be relative to the .blend file, which the output process lacks.
        if settings.path:
            settings = replace(settings, path=os.path.abspath(bpy.path.abspath(settings.path)))
        target = live_settings.target_of(device, settings)
        if self.client is None:
            self.client = LiveClient()
        self.client.connect(
            name,
            name,
            target,
            folder=resources.user_devices(),
            script=None if script is None else script.as_request(),
            offset_ms=settings.offset_ms,
            profile=settings.profile,
        )
        # Samples wait for a new description, which has the streams of this device.
        self.connected[name] = Connected(device, script is not None, settings.offset_ms)
        self.described = None
        recorder.is_wanted_by_devices = bool(self.latencies_ms)
        evaluation.before_describing = self._before_describing
        self.handlers.listen()
        self.handlers.request_update()

    def disconnect(self, name: str) -> None:
        self.connected.pop(name, None)
        recorder.is_wanted_by_devices = bool(self.latencies_ms)
        if self.client is not None:
            self.client.disconnect(name)
            if not self.connected:
                self.close()

    def withdraw(self, marks: Collection[str]) -> None:
        """Disconnect devices whose script has one of these fingerprints; mark them unapproved."""
        for name, mark in list(self.approved.items()):
            if mark in marks:
                self.disconnect(name)
                del self.approved[name]
                self.unapproved.add(name)

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence all devices until :meth:`arm`; the panel shows the reason."""
        if self.client is not None:
            self.client.stop_all(reason)

    def arm(self) -> None:
        """Clear the fault and arm all devices; values ramp up from silence. No effect without a
        client."""
        if self.client is not None:
            self.client.arm()
            self.fault, self.slow_frames.newest = "", None
            self.handlers.request_update()

    def pulse(self, name: str, actuator: int) -> None:
        """Play a short, weak test pulse on an actuator, by index; ignored without a client."""
        if self.client is not None:
            self.client.pulse(name, actuator)

    def try_values(self, name: str, values: F64, is_held: bool) -> None:
        """Play values (columns,) on a device; with ``is_held`` no samples of the scene or the track
        replace them for :data:`HOLD_S`. Ignored without a client."""
        if self.client is not None:
            self.sent_s = time.monotonic()
            self._held_until_s = self.sent_s + HOLD_S if is_held else 0.0
            self.client.send(name, values)

    def offset_ms(self, name: str) -> float:
        """User's delay of a connected device, milliseconds; 0 if the device is not connected."""
        connected = self.connected.get(name)
        return 0.0 if connected is None else connected.offset_ms

    def set_offset(self, name: str, offset_ms: float) -> None:
        """Set the user's delay of a connected device, milliseconds; otherwise no effect."""
        connected = self.connected.get(name)
        if self.client is not None and connected is not None:
            connected.offset_ms = offset_ms
            self.client.set_offset(name, offset_ms)

    def send_vibration(
        self, amplitude_m_s2: float, frequency_hz: float, drive: SurfaceDrive | None = None
    ) -> None:
        """Play a vibration on all vibration actuators, scaled by the gain of each device.

        Used by the stroke pad; no body is involved. Devices with a script are skipped. With
        ``drive``, the amplitude follows the surface calibration of each device.
        """
        if self.client is None or not self.is_armed:
            return
        self.sent_s = time.monotonic()
        gains = self._gains(bpy.context.scene)
        for name, connected in self.connected.items():
            if connected.has_script:
                continue
            gain = gains.get(self.client.devices[name].number, 1.0)
            # The device's own calibration replaces that of the surface.
            own, played = connected.device.surface_drive_per_m, amplitude_m_s2
            if drive is not None:
                played = float(drive.amplitude(amplitude_m_s2, own))
            values = live_settings.vibrating(connected.device, gain * played, frequency_hz)
            self.client.send(name, values)

    def close(self) -> None:
        """Discard the description and the open track, remove handlers and timers; then stop all
        devices and end the output process, killed after about a second. May be called again."""
        # Taken out first, so that a handler in between finds no client.
        client, self.client = self.client, None
        self.connected.clear()
        recorder.is_wanted_by_devices = False
        self.forget()
        self.handlers.stop_listening()
        if client is not None:
            client.close()

    def forget(self) -> None:
        """Discard the scene's description and the open track; no samples are sent until the next
        :meth:`describe`."""
        evaluation.forget()
        self.tracks.forget()
        self.described, self.fault = None, ""

    def fail(self, text: str) -> None:
        """Stop all devices and store an error message for the panel."""
        self.fault = text
        self.stop_all(text)

    def _pause(self) -> None:
        if self.client is not None:
            self.client.pause()

    def _before_describing(self) -> None:
        self._pause()
        if self._source(bpy.context.scene) is self.tracks:
            self.handlers.request_update()  # the description is the preview's

    def _source(self, scene: bpy.types.Scene) -> SceneSource | TrackSource:
        """Source selected in the scene: the scene itself, or a track."""
        return self.tracks if scene.hfx.live_source == "TRACK" else self._scene

    def follow_other(self) -> None:
        """Follow a change of the scene's *source* (scene or track): pause all devices, clear the
        fault, and with a client request the description, which is sent later."""
        self._pause()
        self.described, self.fault = None, ""
        if self.client is not None:
            self.handlers.request_update()

    def exchange_heartbeat(self) -> bool:
        """Send a heartbeat and receive device events; returns True after an event, False without a
        client.

        Continues decaying contact responses, and fades the devices :data:`HOLD_S` after the last
        change.
        """
        if self.client is None:
            return False
        # First: a slow evaluation below must not delay the sign of life.
        self.client.heartbeat()
        self.slow_frames.sign()
        news = self.client.events()
        if any(event.event == "armed" for event in news):
            self.handlers.request_update()  # newly armed devices have no samples
        scene = evaluation.scene
        # Decaying responses change without an edit or a frame: evaluate at each heartbeat.
        if self.described == self._scene.generation and scene is not None and scene.rings:
            evaluation.invalidate()  # responses decay without motion
            self.update(scene.objects.scene)
        # A scene without motion would drive actuators for hours: fade after a while.
        if self.sent_s is not None and time.monotonic() - self.sent_s > HOLD_S:
            self.fade()
            self.sent_s = None
        return bool(news)

    def fade(self) -> None:
        """Send neutral values to all devices, past scripts."""
        if self.client is not None:
            for name, connected in self.connected.items():
                self.client.send(name, connected.device.neutral)

    def describe(self, context: bpy.types.Context) -> None:
        """Send the description of the selected source if changed, with the rendering schemes and
        wearers of the scene; never call this during a depsgraph update.

        Raises InputError: the selected track cannot be read.
        """
        from ...engine.rendering.room import needs_positions
        from ...reading.description.scene_settings import scheme_of

        # Before the source opens: positions are part of the description's fingerprint.
        evaluation.with_positions = needs_positions(
            [connected.device for connected in self.connected.values()]
        )
        source = self._source(context.scene)
        source.open(context)
        if self.client is None or source.generation == self.described:
            return
        ids = source.body_ids(context.scene)
        for name, state in self.states.items():
            item = context.scene.hfx.devices.get(name)
            state.scheme = "" if item is None else scheme_of(item)
            wearer = None if item is None else item.body
            # A body that is left out has no id: copies of a body have its uid.
            state.body_id = "" if wearer is None else ids.get(wearer, wearer.name_full)
        self.described, self.fault = source.generation, source.fault
        self._pause()  # models may have to be loaded
        if source.is_open:
            source.begin(self.client)

    def update(self, scene: bpy.types.Scene) -> None:
        """Send the samples of the current frame, and those of later frames for actuators with
        latency.

        No effect while no device is armed, and until the description is sent.

        Raises InputError: an effect or body has a fault, or the track is damaged.
        """
        source = self._source(scene)
        if self.client is None or not self.is_armed or not source.is_open:
            return
        # Samples refer to streams by their number in a description: samples of a new description
        # would drive other effects' streams until a timer has sent it.
        if source.generation != self.described:
            return
        is_playing = live_handlers.is_playing()
        # Called also while nothing plays: the direction is inferred from every frame.
        later = self._playback.frames_after(scene, self.latencies_ms, is_playing=is_playing)
        if time.monotonic() < self._held_until_s:
            return
        if source is self.tracks and self.tracks.is_outside(scene, later):
            self.fade()  # there is no moment of the track that a script could be called with
            return
        begun = time.monotonic()
        try:
            frame = source.frame(scene, self._gains(scene), later)
        finally:
            self.slow_frames.own_s += time.monotonic() - begun
        self.sent_s = time.monotonic()
        self.client.show(frame)

    def apply_mutes(self, scene: bpy.types.Scene) -> None:
        """Send gains and mutes to the output process, which applies mutes without waiting for a
        frame."""
        if self.client is not None:
            self.client.set_gains(self._gains(scene))
            self.handlers.request_update()

    def resend(self, scene: bpy.types.Scene) -> None:
        """Send the current samples again with changed :attr:`factors`."""
        if self.client is not None:
            self.client.set_gains(self._gains(scene))  # 0 silences without waiting for a frame
            self.update(scene)

    def _gains(self, scene: bpy.types.Scene) -> dict[int, float]:
        """Gains other than 1, by device number; 0 for a muted device. Devices missing in the scene
        have the product of :attr:`factors` alone."""
        factor = math.prod(self.factors.values())
        gains = {}
        for name, state in self.states.items():
            item = scene.hfx.devices.get(name)
            gain = factor
            if item is not None:
                gain *= 0.0 if item.is_muted else item.gain
            if gain != 1.0:
                gains[state.number] = gain
        return gains


live = Live()

_LISTENERS: Final = {
    "live track": live.tracks.choose,
    "live source": live.follow_other,
    "live mutes": live.apply_mutes,
    "live forget": live.forget,
}


def register() -> None:
    """Listen to changes of track, source and mutes, and to requests to discard descriptions."""
    for event, function in _LISTENERS.items():
        events.listen(event, function)


def unregister() -> None:
    events.stop_listening(*_LISTENERS)
    live.close()
