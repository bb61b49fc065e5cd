# SPDX-License-Identifier: GPL-3.0-or-later
"""Client of the output process, for use in Blender."""

from __future__ import annotations

import atexit
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

from ...engine.track.header import TrackHeader
from ...processes.messages import EVERY_DEVICE, MessageKind, encode_json, message
from ..host.device_state import DeviceState as DeviceState
from ..host.device_state import Event as Event
from ..workers.live_frame import LiveFrame, RenderedDevice, SceneMessage, encode_scene
from ..workers.message_bodies import encode_values
from .host_pipe import HostPipe


class LiveClient:
    """Devices that follow Blender. No method waits for a device or for the output process.

    Whoever uses it calls :meth:`heartbeat` from the thread whose life matters, several times
    within 250 ms; otherwise every device stops.
    """

    def __init__(self) -> None:
        self.pipe = HostPipe()  # to the output process
        self._numbers = 0
        self._gains: Mapping[int, float] = {}  # of the newest moment
        self.devices: dict[str, DeviceState] = {}
        atexit.register(self.close)

    @property
    def is_running(self) -> bool:
        return self.pipe.is_running

    @property
    def pid(self) -> int | None:
        """Process id of the output process, or None."""
        return self.pipe.pid

    def start(self) -> None:
        """Start the output process, unless it runs.

        Raises
        ------
        DeviceError
            It cannot be started.
        """
        if not self.is_running:
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
    ) -> DeviceState:
        """Open a device under a given name, to play at once; replaces an open one of that name.

        Parameters
        ----------
        configuration : str or Path
            As :func:`~hfx_blender.devices.configuration.load_device` takes it.
        output : mapping
            As :func:`~hfx_blender.devices.host.opening.open_output` takes it.
        folder : Path, optional
            Of the user's own configurations.
        script : mapping, optional
            ``{"path": ..., "configuration": ..., "fingerprint": ...}`` of the device's script. If
            the user has not approved these bytes, it is not run and the device has a fault.
        offset_ms : float
            How long its values are held back.

        Raises
        ------
        DeviceError
            The output process cannot be started.
        """
        self.start()
        known = self.devices.get(name)
        if known is None:
            self._numbers += 1
            known = self.devices[name] = DeviceState(self._numbers, name)
        known.state, known.text, known.levels = "connecting", "", ()
        known.configuration, known.has_script = str(configuration), script is not None
        known.folder = None if folder is None else str(folder)
        request = {
            "configuration": known.configuration,
            "folder": known.folder,
            "output": dict(output),
            "script": None if script is None else dict(script),
            "offset_ms": offset_ms,
        }
        self.pipe.send(MessageKind.CONNECT, known.number, encode_json(request))
        self.pipe.send(MessageKind.ARM, known.number)
        return known

    def disconnect(self, name: str) -> None:
        known = self.devices.pop(name, None)
        if known is not None:
            self.pipe.send(MessageKind.DISCONNECT, known.number)

    def give_back(self, name: str) -> None:
        """Stop a device and give its port back. Its state remains known: it becomes "closed", or
        "lost" where the stop did not arrive.
        """
        self._command(MessageKind.DISCONNECT, name)

    def send(self, name: str, values: npt.ArrayLike) -> None:
        """Send a device's values (columns,); replaces unsent ones."""
        self._feed(name, MessageKind.VALUES, encode_values(values))

    def send_haptics(self, name: str, haptics: bytes) -> None:
        """Send the haptic data for a device's script."""
        self._feed(name, MessageKind.HAPTICS, haptics)

    def describe(self, header: TrackHeader, body_id: str) -> None:
        """Set the scene and the body of later moments; silent until one comes.

        They are for the devices that are connected now.
        """
        rendered = tuple(
            RenderedDevice(
                each.number, each.configuration, each.folder, each.has_script, each.scheme
            )
            for each in self.devices.values()
        )
        body = encode_scene(SceneMessage(header, body_id, rendered))
        self.pipe.void(EVERY_DEVICE)
        self.pipe.places = {stream: k for k, stream in enumerate(header.streams)}
        self.pipe.send(MessageKind.SCENE, body=body)

    def show(self, moment: LiveFrame) -> None:
        """Send the current samples for every device; replaces what was not sent yet.

        It is handed over as it is: nothing of it may be changed any more. A device that is muted
        by it is silent at once.
        """
        self.set_gains(moment.gains)
        self.pipe.replace(EVERY_DEVICE, moment)

    def set_gains(self, gains: Mapping[int, float]) -> None:
        """Turn devices down, by their numbers, in moments from now on; 0 is mute, and silence at
        once. What was not sent yet is void where one is muted: show it anew.
        """
        for number, gain in gains.items():
            if not gain and self._gains.get(number, 1.0):
                self.pipe.void(EVERY_DEVICE)
                self.pipe.void(number)
                self.pipe.send(MessageKind.PAUSE, number)
        self._gains = gains

    def pulse(self, name: str, actuator: int) -> None:
        """Play one actuator for a moment, softly."""
        if name in self.devices:
            self.pipe.send(
                MessageKind.PULSE, self.devices[name].number, encode_json({"actuator": actuator})
            )

    def set_offset(self, name: str, offset_ms: float) -> None:
        if name in self.devices:
            number = self.devices[name].number
            self.pipe.send(MessageKind.SETTINGS, number, encode_json({"offset_ms": offset_ms}))

    def heartbeat(self) -> None:
        """A sign of life."""
        self.pipe.send(MessageKind.HEARTBEAT)
        self.pipe.watch()

    def pause(self) -> None:
        """Announce work of several 100 ms: devices are silent until the next values, and no
        heartbeat is missed.
        """
        self.pipe.void()
        self.pipe.send(MessageKind.PAUSE)

    def arm(self, name: str | None = None) -> None:
        """Resume playing, from silence; all devices, or one."""
        self._command(MessageKind.ARM, name)

    def stop(self, name: str) -> None:
        """Silence one device."""
        if name in self.devices:
            self.pipe.void(self.devices[name].number)
        self._command(MessageKind.STOP, name)

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence all devices now, before anything that waits. If it is not confirmed,
        :meth:`heartbeat` ends the output process.
        """
        self.pipe.stop(reason)

    def close(self) -> None:
        """Stop everything and end the output process, in at most a moment."""
        if self.pipe.close():
            self.devices.clear()

    def events(self) -> list[Event]:
        """Events since the last call; brings :attr:`devices` up to date."""
        found = list(self.pipe.events())
        for event in found:
            for state in self.devices.values():
                state.update(event)
        return found

    def _command(self, kind: MessageKind, name: str | None) -> None:
        if name is None:
            self.pipe.send(kind)
        elif name in self.devices:
            self.pipe.send(kind, self.devices[name].number)

    def _feed(self, name: str, kind: MessageKind, body: bytes) -> None:
        state = self.devices.get(name)
        if state is not None and self.pipe.is_open:
            self.pipe.replace(state.number, message(kind, state.number, body))
