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
from ...devices.live import live_settings, live_targets
from ...files import resources
from ..evaluation import evaluation
from . import live_handlers
from .slow_frames import SlowFrames
from .track_source import TrackSource, chosen, is_chosen

if TYPE_CHECKING:
    from ...devices.live.client import DeviceState, LiveClient
    from ...engine.rendering.device import DeviceConfig
    from ...engine.surface.surface_drive import SurfaceDrive
    from .lookahead_scheduler import LookaheadScheduler

HOLD_S = 2.0
"""Time for which a scene that stands still is felt, seconds; then it is silent until something
moves."""


@dataclass(eq=False)
class _Connected:
    """Connected device."""

    device: DeviceConfig
    has_script: bool
    late_ms: tuple[float, ...]  # latencies of its actuators that are compensated
    offset_ms: float


class Live:
    """The devices of this Blender."""

    def __init__(self) -> None:
        self._client: LiveClient | None = None
        self._devices: dict[str, _Connected] = {}
        self._generation: object = None  # of what the devices follow: the evaluation, or a track
        self._is_described = False
        self.tracks = TrackSource()
        self._changed_s = 0.0
        self._time_s = 0.0  # of the scene, at the last message to the devices
        self._muted: set[str] = set()  # then
        self._is_held = False
        self._lookahead: LookaheadScheduler | None = None
        self.slow_frames = SlowFrames()
        self.fault = ""
        self.unapproved: set[str] = set()  # devices whose scripts are to be approved first
        self.approved: dict[str, str] = {}  # fingerprints of the user's own scripts, by device

    @property
    def states(self) -> dict[str, DeviceState]:
        """States of the connected devices, by name."""
        return {} if self._client is None else self._client.devices

    @property
    def is_armed(self) -> bool:
        """Test for any device that plays."""
        return any(each.is_armed for each in self.states.values())

    @property
    def is_frozen(self) -> bool:
        """Test for a device that stopped because Blender took too long."""
        return any(each.state == "frozen" for each in self.states.values())

    @property
    def lookahead(self) -> LookaheadScheduler:
        """Lookahead for actuators with latency."""
        if self._lookahead is None:
            from .lookahead_scheduler import LookaheadScheduler

            self._lookahead = LookaheadScheduler()
        return self._lookahead

    @property
    def lookahead_fault(self) -> str:
        """Reason why the lookahead cannot be read; empty if it can, or if no device needs it."""
        return "" if self._lookahead is None else self._lookahead.reason

    @property
    def is_busy(self) -> bool:
        """Test for work left that should be done soon."""
        return self._lookahead is not None and self._lookahead.has_more

    def state(self, name: str) -> DeviceState | None:
        return self.states.get(name) if name in self._devices else None

    def device(self, name: str) -> DeviceConfig | None:
        """Configuration of a connected device."""
        found = self._devices.get(name)
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
        from ...devices.live.playhead import latencies_ms

        try:
            device, script = live_targets.named(named_in_blend(name))
        except live_targets.UnapprovedScriptError:
            self.unapproved.add(name)
            self.approved.pop(name, None)
            raise
        self.approved.pop(name, None)
        if script is not None and not is_shipped(script.path):
            self.approved[name] = script.fingerprint
        if settings.path:
            settings = replace(settings, path=bpy.path.abspath(settings.path))
        target = live_targets.target_of(device, settings)
        if self._client is None:
            self._client = LiveClient()
        self._client.connect(
            name,
            name,
            target,
            folder=resources.user_devices(),
            script=None if script is None else script.as_request(),
            offset_ms=settings.offset_ms,
        )
        self._devices[name] = _Connected(
            device, script is not None, latencies_ms(device), settings.offset_ms
        )
        self._generation = None
        self._set_latencies()
        evaluation.before_describing = self._before_describing
        live_handlers.listen(self)
        live_handlers.request_update()

    def disconnect(self, name: str) -> None:
        self._devices.pop(name, None)
        self._set_latencies()
        if self._client is not None:
            self._client.disconnect(name)
            if not self._devices:
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
        if self._client is not None:
            self._client.stop_all(reason)

    def arm(self) -> None:
        """Play again, from silence."""
        if self._client is not None:
            self._client.arm()
            self.fault, self.slow_frames.newest = "", None
            live_handlers.request_update()

    def pulse(self, name: str, actuator: int) -> None:
        """Play one actuator for a moment, softly."""
        if self._client is not None:
            self._client.pulse(name, actuator)

    def offset_ms(self, name: str) -> float:
        """Delay that is added to a connected device, milliseconds."""
        found = self._devices.get(name)
        return 0.0 if found is None else found.offset_ms

    def set_offset(self, name: str, offset_ms: float) -> None:
        """Set the delay that is added to a connected device, milliseconds."""
        found = self._devices.get(name)
        if self._client is not None and found is not None:
            found.offset_ms = offset_ms
            self._client.set_offset(name, offset_ms)

    def send_vibration(
        self, amplitude_m_s2: float, frequency_hz: float, drive: SurfaceDrive | None = None
    ) -> None:
        """Let every vibration actuator play this now, times its device's gain, within its limits.

        For what is tried by hand, without a body. A device that a script drives is left alone.
        What a surface drives (``drive``) is as strong as was calibrated for each device.
        """
        if self._client is None or not self.is_armed:
            return
        self._changed_s, self._is_held = time.monotonic(), False
        gains = self._gains(bpy.context.scene)
        for name, each in self._devices.items():
            if each.has_script:
                continue
            gain = gains.get(self._client.devices[name].number, 1.0)
            own, played = each.device.surface_drive_per_m, amplitude_m_s2
            if drive is not None:
                played = float(drive.amplitude(amplitude_m_s2, own))
            values = live_targets.vibrating(each.device, gain * played, frequency_hz)
            self._client.send(name, values)

    def close(self) -> None:
        """Silence everything and end the output process."""
        client, self._client = self._client, None
        self._devices.clear()
        self.forget()
        live_handlers.stop_listening()
        if client is not None:
            client.close()

    def touch(self) -> None:
        """Note that something moved."""
        evaluation.touch()

    def edited(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note that something other than the time has changed."""
        if any(each.late_ms for each in self._devices.values()):
            from .lookahead_scheduler import changed_by

            changed = changed_by(depsgraph)
            if changed:
                self.lookahead.edited(changed)

    def forget(self) -> None:
        """Drop everything: the scene may have become another one."""
        evaluation.forget()
        self.tracks.forget()
        if self._lookahead is not None:
            self._lookahead.forget()
        self._is_described = False

    def fail(self, text: str) -> None:
        """Stop everything and tell the user, after a fault in this process."""
        self.fault = text
        self.stop_all(text)

    def _set_latencies(self) -> None:
        self.lookahead.set_latencies(ms for each in self._devices.values() for ms in each.late_ms)

    def _pause(self) -> None:
        if self._client is not None:
            self._client.pause()

    def _before_describing(self) -> None:
        self._pause()
        if is_chosen(bpy.context.scene):
            live_handlers.request_update()  # it is the preview's scene: the track plays on

    def _choose_schemes(self, scene: bpy.types.Scene) -> None:
        from ...reading.description.scene_devices import scheme_of

        for name, state in self.states.items():
            item = scene.hfx.devices.get(name)
            state.scheme = "" if item is None else scheme_of(item)

    def follow_other(self) -> None:
        """Follow what the user has chosen anew, the scene or a track, from silence."""
        self._pause()
        self._generation, self.fault = None, ""
        if self._client is not None:
            live_handlers.request_update()

    def exchange_heartbeat(self) -> bool:
        """Send a heartbeat, and take news from the devices; returns True if there are any."""
        if self._client is None:
            return False
        self._client.heartbeat()
        self.slow_frames.sign()
        news = self._client.events()
        if any(each.event == "armed" for each in news):
            live_handlers.request_update()  # it plays from now on: send it the present samples
        if self._follows_scene:
            if evaluation.scene is not None and evaluation.scene.rings:
                evaluation.touch()  # nothing moved, but responses are still ringing
                self.update(evaluation.scene.objects.scene)
            self._read_lookahead()
        if not self._is_held and time.monotonic() - self._changed_s > HOLD_S:
            self._is_held = True
            self._fade()
        return bool(news)

    def _fade(self) -> None:
        """Send neutral values; a script decides by itself how to fade."""

        from ...devices.workers.haptics import encode_haptics

        if self._client is None:
            return
        for name, each in self._devices.items():
            neutral = each.device.neutral
            if each.has_script and name not in self._muted:
                self._client.send_haptics(name, encode_haptics(self._time_s, [], neutral))
            else:
                self._client.send(name, neutral)

    def _read_lookahead(self) -> None:
        """Read another slice of the lookahead."""
        client, found = self._client, evaluation.scene
        if client is None or found is None or not self._is_described:
            return
        playhead = self.lookahead.playhead(found.objects.scene, live_handlers.is_playing())
        self.lookahead.work(
            playhead, found, lambda body, is_scene: client.send_lookahead(body, is_scene=is_scene)
        )

    def describe(self, context: bpy.types.Context) -> None:
        """Describe what is played anew if it has changed; never from within an update.

        Raises
        ------
        InputError
            The chosen track cannot be read.
        """
        self._choose_schemes(context.scene)
        if is_chosen(context.scene):
            self._describe_track(context.scene)
        else:
            self._describe_scene(context)

    @property
    def _follows_scene(self) -> bool:
        """Test that devices have been told of the scene as it is described now."""
        return self._generation == evaluation.generation

    def _describe_track(self, scene: bpy.types.Scene) -> None:
        track = self.tracks.open(scene)
        generation = "track", self.tracks.generation
        if self._client is None or generation == self._generation:
            return
        self._generation, self.fault = generation, ""
        self._pause()
        self.lookahead.forget()
        self._client.describe(track.header, track.body_id)
        self._is_described = True

    def _describe_scene(self, context: bpy.types.Context) -> None:
        from ...engine.rendering.moment import moment_header
        from ...engine.rendering.room import needs_positions

        configs = [each.device for each in self._devices.values()]
        evaluation.with_positions = needs_positions(configs)
        evaluation.describe(context)
        if self._follows_scene:
            return
        self._generation, self.fault = evaluation.generation, evaluation.fault
        found = evaluation.scene
        self._pause()  # models may have to be loaded
        self.lookahead.forget()
        self._is_described = found is not None and self._client is not None
        if found is not None and self._client is not None:
            body = found.description.bodies[0].id  # devices are worn by the first body
            self._client.describe(moment_header(found.description), body)

    def update(self, scene: bpy.types.Scene) -> None:
        """Send the current samples; the renderer reports devices that do not fit.

        Raises
        ------
        InputError
            Something of the scene cannot be felt any more, or the track is damaged.
        """
        if self._client is None or not self.is_armed or not self._is_described:
            return
        is_track = is_chosen(scene)
        current = ("track", self.tracks.generation) if is_track else evaluation.generation
        if current != self._generation:
            return  # described anew just now; devices will get it soon
        from .current_live_frame import current_live_frame

        self._changed_s, self._is_held = time.monotonic(), False
        numbers = self._numbers()
        playhead = self.lookahead.playhead(scene, live_handlers.is_playing())
        with self.slow_frames.own_work():
            if is_track:
                late = self.lookahead.latencies_ms
                moment = self.tracks.frame(playhead, self._gains(scene), late)
            else:
                moment = current_live_frame(scene, numbers, self.lookahead.edition, playhead)
        self._time_s = moment.time_s
        self._muted = {name for name, n in numbers.items() if not moment.gains.get(n, 1.0)}
        self._client.show(moment)

    def apply_mutes(self, scene: bpy.types.Scene) -> None:
        """The user has pressed a mute: that device is silent at once, whatever Blender does."""
        if self._client is not None:
            self._client.set_gains(self._gains(scene))
            live_handlers.request_update()

    def _numbers(self) -> dict[str, int]:
        """Numbers of the connected devices."""
        return {name: state.number for name, state in self.states.items()}

    def _gains(self, scene: bpy.types.Scene) -> dict[int, float]:
        from .current_live_frame import gains

        return gains(scene, self._numbers())


live = Live()


_LISTENERS: Final = {
    "live track": chosen.add,
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
