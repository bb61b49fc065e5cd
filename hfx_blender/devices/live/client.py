# SPDX-License-Identifier: GPL-3.0-or-later
"""Client of the output process in Blender, and the states of connected devices."""

import atexit
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from ...engine.track.header import TrackHeader
from ...processes.messages import EVERY_DEVICE, MessageKind, encode_json, message
from ..workers.live_frame import LiveFrame, RenderedDevice, SceneMessage, encode_scene
from ..workers.message_bodies import encode_values
from .host_pipe import Event as Event
from .host_pipe import HostPipe


@dataclass(eq=False)
class DeviceState:
    """State of a connected device, updated by events."""

    number: int
    name: str
    state: str = "connecting"  # connected armed stopped frozen fault lost closed
    configuration: str = ""  # name or file
    folder: str | None = None  # of the user's configurations
    has_script: bool = False
    scheme: str = ""  # rendering scheme; "": as configured
    body_id: str = ""  # wearer; "": the body passed to LiveClient.describe
    profile: str = ""  # of a person; "": none
    text: str = ""  # reason of the state, or the last line of the device's script
    unit: str = ""  # label of the device at a server; "" without
    levels: tuple[float, ...] = ()  # 0..1 by actuator

    @property
    def is_armed(self) -> bool:
        return self.state == "armed"

    def update(self, event: Event) -> None:
        """Apply an event of this device's number, or "gone": lost, without levels. "levels" and
        "log" leave the state; "closed" does not replace "lost"."""
        if event.event == "gone" and self.state != "lost":  # the output process, and all devices
            self.state, self.text, self.levels = "lost", event.text, ()
        elif event.device != self.number:
            return
        elif event.event == "levels":
            self.levels = event.levels
        elif event.event == "log":
            self.text = event.text
        elif event.event in ("connected", "armed"):
            self.state, self.text = event.event, ""
            if event.event == "connected":
                self.unit = event.text
        elif event.event == "closed":
            if self.state != "lost":
                self.state, self.levels = "closed", ()
        else:
            self.state, self.text, self.levels = event.event, event.text, ()


class LiveClient:
    """Devices connected to Blender; no method waits for a device or for the output process. Stops,
    pauses and mutes reach the process past all other messages.

    :meth:`heartbeat` has to be called several times within 250 ms, from the thread to be watched;
    otherwise all devices stop. ``devices`` has the states of the connected devices by name, which
    :meth:`events` updates.
    """

    def __init__(self) -> None:
        self.pipe = HostPipe()
        self._numbers = 0
        self._gains: Mapping[int, float] = {}  # by device number, of the newest moment
        self.devices: dict[str, DeviceState] = {}
        # Devices stop when Blender quits.
        atexit.register(self.close)

    def start(self) -> None:
        """Start the output process unless running, without waiting until it is ready; the devices
        of an ended process are forgotten. DeviceError if no process can be started."""
        if not self.pipe.is_running:
            self.close()
            self.pipe.start()

    def connect(
        self,
        name: str,
        configuration: str | Path,
        output: Mapping[str, Any],
        *,
        folder: Path | None = None,
        script: Mapping[str, Any] | None = None,
        offset_ms: float = 0.0,
        profile: str = "",
    ) -> DeviceState:
        """Open and arm a device under a name; a device of the same name is closed first. Return the
        state, "connecting"; failures of the opening arrive as events.

        ``configuration``: as for :func:`~hfx_blender.devices.configuration.load_device`.
        ``output``: target as for :func:`~hfx_blender.devices.host.opening.open_output`.
        ``folder``: the user's configurations.
        ``script``: ``{"path": ..., "configuration": ..., "fingerprint": ...}`` of the device's
        script. A script with unapproved bytes is not run, and the device has a fault.
        ``offset_ms``: delay of the values.
        ``profile``: name of a person's profile, whose "too strong" limits the device.

        Raises DeviceError: the output process cannot be started.
        """
        self.start()
        state = self.devices.get(name)
        if state is None:
            self._numbers += 1
            state = self.devices[name] = DeviceState(self._numbers, name)
        state.state, state.text, state.levels = "connecting", "", ()
        state.configuration, state.has_script = str(configuration), script is not None
        state.folder, state.profile = None if folder is None else str(folder), profile
        request = {
            "configuration": state.configuration,
            "folder": state.folder,
            "output": dict(output),
            "script": None if script is None else dict(script),
            "offset_ms": offset_ms,
            "profile": profile,
        }
        # A CONNECT with a known number closes the earlier device first.
        self.pipe.send(MessageKind.CONNECT, state.number, encode_json(request))
        self.pipe.send(MessageKind.ARM, state.number)
        return state

    def disconnect(self, name: str) -> None:
        """Request stop and closing of a device's port, without waiting, and forget the state;
        unknown names are ignored."""
        self.close_port(name)
        self.devices.pop(name, None)

    def close_port(self, name: str) -> None:
        """Request stop and closing of a device's port, without waiting; the state becomes "closed",
        or "lost" without a confirmed stop. Unknown names are ignored."""
        self.stop(name, "disconnected")
        self._command(MessageKind.DISCONNECT, name)

    def send(self, name: str, values: npt.ArrayLike) -> None:
        """Send values (columns,) in place of unsent values; an unknown name is ignored."""
        self._feed(name, MessageKind.VALUES, encode_values(values))

    def send_haptics(self, name: str, haptics: bytes) -> None:
        """Send haptic data, as of :func:`.haptics.encode_haptics`, to a device's script."""
        self._feed(name, MessageKind.HAPTICS, haptics)

    def describe(self, header: TrackHeader, body_id: str) -> None:
        """Send the scene of later moments, for the devices connected now. ``body_id`` wears all
        devices without a wearer of their own. A wearer missing in ``header`` becomes a fault of
        the device. Unsent moments are discarded, and all devices are silent until the next
        moment."""
        rendered = tuple(
            RenderedDevice(
                state.number,
                state.configuration,
                state.folder,
                state.has_script,
                state.scheme,
                state.body_id,
                state.profile,
            )
            for state in self.devices.values()
        )
        body = encode_scene(SceneMessage(header, body_id, rendered))
        # Unsent moments refer to the streams of the earlier scene.
        self.pipe.void(EVERY_DEVICE)
        self.pipe.places = {stream: k for k, stream in enumerate(header.streams)}
        self.pipe.send(MessageKind.SCENE, body=body)

    def show(self, moment: LiveFrame) -> None:
        """Send the current samples to all devices, in place of unsent samples.

        ``moment`` is encoded later in a thread: no changes after the call. A device
        with gain 0 is silent at once.
        """
        self.set_gains(moment.gains)
        self.pipe.replace(EVERY_DEVICE, moment)

    def set_gains(self, gains: Mapping[int, float]) -> None:
        """Set the gains of later moments, by device number; 0 silences a device at once.

        Muting a device discards unsent moments: call :meth:`show` again.
        """
        for number, gain in gains.items():
            # Newly muted: unsent values are void, and a pause silences the device at once.
            if not gain and self._gains.get(number, 1.0):
                self.pipe.void(EVERY_DEVICE)
                self.pipe.silence(MessageKind.PAUSE, number)
        self._gains = gains

    def pulse(self, name: str, actuator: int) -> None:
        """Play a soft test pulse on an actuator, by index; ignored for an unknown name."""
        self._command(MessageKind.PULSE, name, encode_json({"actuator": actuator}))

    def set_offset(self, name: str, offset_ms: float) -> None:
        """Change the delay of a device's values; ignored for an unknown name."""
        self._command(MessageKind.SETTINGS, name, encode_json({"offset_ms": offset_ms}))

    def heartbeat(self) -> None:
        """Send a sign of life, and end an output process that has not confirmed a stop in time."""
        self.pipe.send(MessageKind.HEARTBEAT)
        self.pipe.watch()

    def pause(self) -> None:
        """Silence all devices until the next values, during up to 10 s without heartbeats."""
        self.pipe.silence(MessageKind.PAUSE)

    def arm(self, name: str | None = None) -> None:
        """Let a device, or all devices (None), play again after a stop, from silence."""
        self._command(MessageKind.ARM, name)

    def stop(self, name: str, reason: str = "") -> None:
        """Discard a device's unsent values and send a stop; ignored for an unknown name."""
        if name in self.devices:
            self.pipe.silence(MessageKind.STOP, self.devices[name].number, reason)

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence all devices now, ahead of unsent messages.

        :meth:`heartbeat` ends the output process if the stop is not confirmed within 0.2 s.
        """
        self.pipe.silence(MessageKind.STOP, reason=reason)

    def close(self) -> None:
        """Stop all devices, end the output process within about a second, and clear
        :attr:`devices`; no effect without a process."""
        if self.pipe.close():
            self.devices.clear()

    def events(self) -> list[Event]:
        """Events since the last call, in order; updates the states in :attr:`devices`."""
        events = list(self.pipe.events())
        for event in events:
            for state in self.devices.values():
                state.update(event)
        return events

    def _command(self, kind: MessageKind, name: str | None, body: bytes = b"") -> None:
        """Send a message about a device, or for None about all; an unknown name is ignored."""
        if name is None:
            self.pipe.send(kind)
        elif name in self.devices:
            self.pipe.send(kind, self.devices[name].number, body)

    def _feed(self, name: str, kind: MessageKind, body: bytes) -> None:
        if name in self.devices:
            number = self.devices[name].number
            self.pipe.replace(number, message(kind, number, body))
