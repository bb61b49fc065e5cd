# SPDX-License-Identifier: GPL-3.0-or-later
"""Live devices: sends the current samples to connected devices, while Blender plays, scrubs or
drags.

Processes of their own do everything slow, rendering for the devices too; here the open scene is
evaluated once a change and handed over as it is, and a timer gives a sign of life. Nothing listens
until a device is connected.
"""

from __future__ import annotations

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
from .live_sources import Generation, SceneSource, Source, TrackSource

if TYPE_CHECKING:
    from ...devices.live.client import DeviceState, LiveClient
    from ...engine.rendering.device_config import DeviceConfig
    from ...engine.surface.surface_drive import SurfaceDrive

HOLD_S = 2.0
"""Time for which a scene that stands still is felt, seconds; then it is silent until something
moves."""


@dataclass(eq=False)
class Connected:
    """Connected device."""

    device: DeviceConfig
    has_script: bool
    offset_ms: float

    def __post_init__(self) -> None:
        self.latencies_ms = live_settings.latencies_ms(self.device)  # read with every frame


@dataclass(frozen=True)
class Sent:
    """Last message to the devices, which they still play."""

    at_s: float  # of the monotonic clock
    time_s: float = 0.0  # of the scene
    muted: frozenset[str] = frozenset()


class Live:
    """Connected devices of this Blender, and the source of the samples that they play.

    Attributes
    ----------
    handlers : LiveHandlers
        Added while a device is connected.
    tracks : TrackSource
    slow_frames : SlowFrames
    fault : str
        Reason why nothing is played; empty without one.
    unapproved : set of str
        Devices whose scripts are to be approved first.
    approved : dict
        Fingerprints of the user's own scripts, by device.
    client : LiveClient or None
        The output process, once a device was connected.
    connected : dict of Connected
        By name.
    described : Generation or None
        Description that the devices follow.
    sent : Sent or None
        None: the devices have faded.
    """

    def __init__(self) -> None:
        self.handlers = live_handlers.LiveHandlers(self)
        self.tracks = TrackSource()
        self.slow_frames = SlowFrames()
        self.fault = ""
        self.unapproved: set[str] = set()
        self.approved: dict[str, str] = {}
        self._scene = SceneSource()
        self._playback = Playback()
        self.client: LiveClient | None = None
        self.connected: dict[str, Connected] = {}
        self.described: Generation | None = None
        self.sent: Sent | None = None

    @property
    def states(self) -> dict[str, DeviceState]:
        """States of the connected devices, by name."""
        return {} if self.client is None else self.client.devices

    @property
    def is_armed(self) -> bool:
        """Test for any device that plays."""
        return any(each.is_armed for each in self.states.values())

    @property
    def is_frozen(self) -> bool:
        """Test for a device that stopped because Blender took too long."""
        return any(each.state == "frozen" for each in self.states.values())

    @property
    def latencies_ms(self) -> set[float]:
        """Latencies of the connected actuators that are compensated."""
        return {ms for each in self.connected.values() for ms in each.latencies_ms}

    def state(self, name: str) -> DeviceState | None:
        return self.states.get(name) if name in self.connected else None

    def device(self, name: str) -> DeviceConfig | None:
        """Configuration of a connected device."""
        found = self.connected.get(name)
        return None if found is None else found.device

    def connect(self, name: str, settings: live_settings.LiveSettings) -> None:
        """Open a device and let it play.

        Raises
        ------
        InputError
            There is no such device, or its script has not been approved.
        DeviceError
            It is not there, or the output process cannot be started.
        """
        from ...devices.configuration import named_in_blend
        from ...devices.live.approval import is_shipped
        from ...devices.live.client import LiveClient

        try:
            device, script = live_settings.named(named_in_blend(name))
        except live_settings.UnapprovedScriptError:
            self.unapproved.add(name)
            self.approved.pop(name, None)
            raise
        self.approved.pop(name, None)
        if script is not None and not is_shipped(script.path):
            self.approved[name] = script.fingerprint
        if settings.path:
            settings = replace(settings, path=bpy.path.abspath(settings.path))
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
        )
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
        """Stop the devices whose scripts have these fingerprints; they need a new approval."""
        for name, mark in list(self.approved.items()):
            if mark in marks:
                self.disconnect(name)
                del self.approved[name]
                self.unapproved.add(name)

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence all devices now; only :meth:`arm` plays again."""
        if self.client is not None:
            self.client.stop_all(reason)

    def arm(self) -> None:
        """Play again, from silence."""
        if self.client is not None:
            self.client.arm()
            self.fault, self.slow_frames.newest = "", None
            self.handlers.request_update()

    def pulse(self, name: str, actuator: int) -> None:
        """Play one actuator for a moment, softly."""
        if self.client is not None:
            self.client.pulse(name, actuator)

    def offset_ms(self, name: str) -> float:
        """Delay that is added to a connected device, milliseconds."""
        found = self.connected.get(name)
        return 0.0 if found is None else found.offset_ms

    def set_offset(self, name: str, offset_ms: float) -> None:
        """Set the delay that is added to a connected device, milliseconds."""
        found = self.connected.get(name)
        if self.client is not None and found is not None:
            found.offset_ms = offset_ms
            self.client.set_offset(name, offset_ms)

    def send_vibration(
        self, amplitude_m_s2: float, frequency_hz: float, drive: SurfaceDrive | None = None
    ) -> None:
        """Let every vibration actuator play this now, times its device's gain, within its limits.

        For what is tried by hand, without a body. A device that a script drives is left alone.
        What a surface drives (``drive``) is as strong as was calibrated for each device.
        """
        if self.client is None or not self.is_armed:
            return
        self.sent = replace(self.sent or Sent(0.0), at_s=time.monotonic())
        gains = self._gains(bpy.context.scene)
        for name, each in self.connected.items():
            if each.has_script:
                continue
            gain = gains.get(self.client.devices[name].number, 1.0)
            own, played = each.device.surface_drive_per_m, amplitude_m_s2
            if drive is not None:
                played = float(drive.amplitude(amplitude_m_s2, own))
            values = live_settings.vibrating(each.device, gain * played, frequency_hz)
            self.client.send(name, values)

    def close(self) -> None:
        """Silence everything and end the output process."""
        client, self.client = self.client, None
        self.connected.clear()
        recorder.is_wanted_by_devices = False
        self.forget()
        self.handlers.stop_listening()
        if client is not None:
            client.close()

    def invalidate(self) -> None:
        """Note that something moved."""
        evaluation.invalidate()

    def forget(self) -> None:
        """Drop everything: the scene may have become another one."""
        evaluation.forget()
        self.tracks.forget()
        self.described = None

    def fail(self, text: str) -> None:
        """Stop everything and tell the user, after a fault in this process."""
        self.fault = text
        self.stop_all(text)

    def _pause(self) -> None:
        if self.client is not None:
            self.client.pause()

    def _before_describing(self) -> None:
        self._pause()
        if self._source(bpy.context.scene) is self.tracks:
            self.handlers.request_update()  # it is the preview's scene: the track plays on

    def _source(self, scene: bpy.types.Scene) -> Source:
        """Source that devices are to play."""
        return self.tracks if scene.hfx.live_source == "TRACK" else self._scene

    def _choose_schemes(self, scene: bpy.types.Scene) -> None:
        from ...reading.description.scene_devices import scheme_of

        for name, state in self.states.items():
            item = scene.hfx.devices.get(name)
            state.scheme = "" if item is None else scheme_of(item)

    def follow_other(self) -> None:
        """Follow what the user has chosen anew, the scene or a track, from silence."""
        self._pause()
        self.described, self.fault = None, ""
        if self.client is not None:
            self.handlers.request_update()

    def exchange_heartbeat(self) -> bool:
        """Send a heartbeat, and take news from the devices; returns True if there are any."""
        if self.client is None:
            return False
        self.client.heartbeat()
        self.slow_frames.sign()
        news = self.client.events()
        if any(each.event == "armed" for each in news):
            self.handlers.request_update()  # it plays from now on: send it the present samples
        scene = evaluation.scene
        if self.described == self._scene.generation and scene is not None and scene.rings:
            evaluation.invalidate()  # nothing moved, but responses are still ringing
            self.update(scene.objects.scene)
        if self.sent is not None and time.monotonic() - self.sent.at_s > HOLD_S:
            self.fade(self.sent)
            self.sent = None
        return bool(news)

    def fade(self, sent: Sent) -> None:
        """Send neutral values; a script decides by itself how to fade."""
        from ...devices.workers.haptics import encode_haptics

        if self.client is None:
            return
        for name, each in self.connected.items():
            neutral = each.device.neutral
            if each.has_script and name not in sent.muted:
                self.client.send_haptics(name, encode_haptics(sent.time_s, [], neutral))
            else:
                self.client.send(name, neutral)

    def describe(self, context: bpy.types.Context) -> None:
        """Describe what is played anew if it has changed; never from within an update.

        Raises
        ------
        InputError
            The chosen track cannot be read.
        """
        from ...engine.rendering.room import needs_positions

        self._choose_schemes(context.scene)
        evaluation.with_positions = needs_positions(
            [each.device for each in self.connected.values()]
        )
        source = self._source(context.scene)
        source.open(context)
        if self.client is None or source.generation == self.described:
            return
        self.described, self.fault = source.generation, source.fault
        self._pause()  # models may have to be loaded
        if source.is_open:
            source.begin(self.client)

    def update(self, scene: bpy.types.Scene) -> None:
        """Send the current samples; the renderer reports devices that do not fit.

        Raises
        ------
        InputError
            Something of the scene cannot be felt any more, or the track is damaged.
        """
        source = self._source(scene)
        if self.client is None or not self.is_armed or not source.is_open:
            return
        if source.generation != self.described:
            return  # described anew just now; devices will get it soon
        is_playing = live_handlers.is_playing()
        later = self._playback.frames_after(scene, self.latencies_ms, is_playing=is_playing)
        with self.slow_frames.own_work():
            frame = source.frame(scene, self._gains(scene), later)
        states = self.states.items()
        muted = frozenset(name for name, each in states if not frame.gains.get(each.number, 1.0))
        self.sent = Sent(time.monotonic(), frame.time_s, muted)
        self.client.show(frame)

    def apply_mutes(self, scene: bpy.types.Scene) -> None:
        """The user has pressed a mute: that device is silent at once, whatever Blender does."""
        if self.client is not None:
            self.client.set_gains(self._gains(scene))
            self.handlers.request_update()

    def _gains(self, scene: bpy.types.Scene) -> dict[int, float]:
        """Gains that the user has set, by a device's number; 0 is mute."""
        found = {}
        for name, state in self.states.items():
            item = scene.hfx.devices.get(name)
            if item is not None and (item.is_muted or item.gain != 1.0):
                found[state.number] = 0.0 if item.is_muted else item.gain
        return found


live = Live()


_LISTENERS: Final = {
    "live track": live.tracks.chosen.add,
    "live source": live.follow_other,
    "live mutes": live.apply_mutes,
    "live forget": live.forget,
}


def register() -> None:
    """Listen to changes of properties that concern connected devices."""
    for event, function in _LISTENERS.items():
        events.listen(event, function)


def unregister() -> None:
    events.stop_listening(*_LISTENERS)
    live.close()
