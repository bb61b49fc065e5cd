# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's side of live devices: starts the output process and talks to it without waiting."""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy.typing as npt

from ...errors import DeviceError
from .messages import EVERY_DEVICE, Kind, json_to, message, values_to

_PACKAGE: Final = Path(__file__).resolve().parents[2]  # its folder; in an extension too
_MAX_EVENTS: Final = 1000

STOP_PATIENCE_S: Final = 0.2
"""If a stop is not confirmed by then, the output process is ended: its ports close with it."""


@dataclass(frozen=True)
class Event:
    """Something that the output process tells."""

    event: str  # ready connected armed stopped silent fault lost closed levels log gone
    device: int
    text: str = ""
    levels: tuple[float, ...] = ()


@dataclass(eq=False)
class DeviceState:
    """What is known of a connected device."""

    number: int
    name: str
    state: str = "connecting"  # connected armed stopped fault lost closed
    text: str = ""
    levels: tuple[float, ...] = field(default_factory=tuple)

    @property
    def is_armed(self) -> bool:
        return self.state == "armed"


class LiveClient:
    """Devices that follow Blender. No method waits for a device or for the output process.

    Whoever uses it calls :meth:`heartbeat` from the thread whose life matters, several times
    within 250 ms; otherwise every device stops.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._wake = threading.Condition()
        self._urgent: deque[bytes] = deque()
        self._newest: dict[int, bytes] = {}
        self._is_closing = False
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        self._asked_silence_s: float | None = None
        self._numbers = 0
        self._is_gathering = False
        self.devices: dict[str, DeviceState] = {}
        atexit.register(self.close)

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int | None:
        """Of the output process."""
        return self._process.pid if self._process is not None else None

    def start(self) -> None:
        """Start the output process, unless it runs.

        Raises
        ------
        DeviceError
            It cannot be started.
        """
        if self.is_running:
            return
        self.close()
        environment = dict(os.environ)
        paths = [str(_PACKAGE.parent), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(each for each in paths if each)
        environment["OPENBLAS_NUM_THREADS"] = "1"  # its values are few
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", f"{_PACKAGE.name}.devices.live.host"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
                bufsize=0,
                start_new_session=True,  # Ctrl-C in Blender's terminal is not meant for it
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise DeviceError(f"The output process cannot be started ({error}).") from None
        self._process, self._is_closing, self._asked_silence_s = process, False, None
        self._urgent, self._newest = deque(), {}
        for target in (self._write, self._listen):
            threading.Thread(target=target, args=(process,), daemon=True).start()

    def connect(
        self,
        name: str,
        configuration: str | Path,
        output: Mapping[str, Any],
        *,
        folder: Path | None = None,
        script: Mapping[str, Any] | None = None,
        offset_ms: float = 0.0,
        is_armed: bool = True,
    ) -> DeviceState:
        """Open a device under a name of the caller's; an open one of that name is replaced.

        Parameters
        ----------
        name : str
        configuration : str or Path
            As :func:`~hfx_blender.devices.configuration.load_device` takes it.
        output : mapping
            As :func:`~hfx_blender.devices.live.outputs.open_output` takes it.
        folder : Path, optional
            Of the user's own configurations.
        script : mapping, optional
            ``{"path": ..., "configuration": ..., "fingerprint": ...}`` of a script that the
            user has approved.
        offset_ms : float
            How long its values are held back.
        is_armed : bool
            Whether it plays as soon as it is open.

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
        wish = {
            "configuration": str(configuration),
            "folder": None if folder is None else str(folder),
            "output": dict(output),
            "script": None if script is None else dict(script),
            "offset_ms": offset_ms,
        }
        self._tell(Kind.CONNECT, known.number, json_to(wish))
        if is_armed:
            self._tell(Kind.ARM, known.number)
        return known

    def disconnect(self, name: str) -> None:
        known = self.devices.pop(name, None)
        if known is not None:
            self._tell(Kind.DISCONNECT, known.number)

    def send(self, name: str, values: npt.ArrayLike) -> None:
        """A device's values (columns,) now; what was not sent yet is replaced."""
        self._feed(name, Kind.VALUES, values_to(values))

    def send_haptics(self, name: str, haptics: bytes) -> None:
        """What a device's script is to be told now."""
        self._feed(name, Kind.HAPTICS, haptics)

    @contextmanager
    def together(self) -> Iterator[None]:
        """What is sent within goes out as one: the writer is woken once."""
        self._is_gathering = True
        try:
            yield
        finally:
            self._is_gathering = False
            with self._wake:
                self._wake.notify()

    def pulse(self, name: str, actuator: int) -> None:
        """Let one actuator be felt for a moment, softly."""
        if name in self.devices:
            self._tell(Kind.PULSE, self.devices[name].number, json_to({"actuator": actuator}))

    def set_offset(self, name: str, offset_ms: float) -> None:
        if name in self.devices:
            number = self.devices[name].number
            self._tell(Kind.SETTINGS, number, json_to({"offset_ms": offset_ms}))

    def heartbeat(self) -> None:
        """A sign of life."""
        self._tell(Kind.HEARTBEAT)
        asked = self._asked_silence_s
        if asked is not None and time.monotonic() - asked > STOP_PATIENCE_S and self.is_running:
            self._kill("the output process did not confirm the stop and was ended")

    def pause(self) -> None:
        """Before work of several 100 ms: devices are silent until the next values, and no sign
        of life is missed meanwhile.
        """
        with self._wake:
            self._newest.clear()
        self._tell(Kind.PAUSE)

    def arm(self, name: str | None = None) -> None:
        """Play again, from silence; all devices, or one."""
        self._command(Kind.ARM, name)

    def stop(self, name: str) -> None:
        """Silence one device."""
        self._command(Kind.STOP, name)

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence now, whatever else waits. If it is not confirmed, :meth:`heartbeat` ends
        the output process.
        """
        if not self.is_running:
            return
        with self._wake:
            self._newest.clear()
            self._urgent.appendleft(message(Kind.STOP, EVERY_DEVICE, reason.encode()))
            if self._asked_silence_s is None:
                self._asked_silence_s = time.monotonic()
            self._wake.notify()

    def close(self) -> None:
        """Stop everything and end the output process; at most a moment, and at any time."""
        process, self._process = self._process, None
        if process is None:
            return
        with self._wake:
            self._newest.clear()
            self._urgent.clear()
            self._urgent.append(message(Kind.STOP))
            self._is_closing = True
            self._wake.notify()
        try:
            process.wait(1.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self.devices.clear()

    def events(self) -> list[Event]:
        """What has been told since the last call; brings :attr:`devices` up to date."""
        found = []
        while self._events:
            event = self._events.popleft()
            found.append(event)
            self._apply(event)
        return found

    def _apply(self, event: Event) -> None:
        if event.event == "gone":
            for state in self.devices.values():
                state.state, state.text, state.levels = "lost", event.text, ()
            return
        for state in self.devices.values():
            if state.number != event.device:
                continue
            if event.event == "levels":
                state.levels = event.levels
            elif event.event == "log":
                state.text = event.text
            elif event.event == "connected" or event.event == "armed":
                state.state, state.text = event.event, ""
            elif event.event == "closed":
                if state.state != "lost":
                    state.state, state.levels = "closed", ()
            else:
                state.state, state.text, state.levels = event.event, event.text, ()

    def _command(self, kind: Kind, name: str | None) -> None:
        if name is None:
            self._tell(kind)
        elif name in self.devices:
            self._tell(kind, self.devices[name].number)

    def _tell(self, kind: Kind, device: int = EVERY_DEVICE, body: bytes = b"") -> None:
        if not self.is_running:
            return
        with self._wake:
            if kind is Kind.HEARTBEAT and (self._urgent or self._newest):
                return  # whatever waits is one
            self._urgent.append(message(kind, device, body))
            self._wake.notify()

    def _feed(self, name: str, kind: Kind, body: bytes) -> None:
        state = self.devices.get(name)
        if state is None or self._process is None:
            return
        content = message(kind, state.number, body)
        with self._wake:
            self._newest[state.number] = content
            if not self._is_gathering:
                self._wake.notify()

    def _kill(self, text: str) -> None:
        if self._process is not None:
            self._process.kill()
        self._asked_silence_s = None
        self._events.append(Event("gone", EVERY_DEVICE, text))

    # Threads: pipes may make them wait.

    def _write(self, process: subprocess.Popen[bytes]) -> None:
        stream = process.stdin
        assert stream is not None
        try:
            while True:
                with self._wake:
                    while not (self._urgent or self._newest or self._is_closing):
                        self._wake.wait()
                    if process is not self._process and not self._is_closing:
                        return
                    waiting = [*self._urgent, *self._newest.values()]
                    self._urgent.clear()
                    self._newest.clear()
                    is_last = self._is_closing
                data = memoryview(b"".join(waiting))
                while data:
                    data = data[stream.write(data) or 0 :]
                if is_last:
                    return
        except (OSError, ValueError):
            pass  # the listener tells
        finally:
            with suppress(OSError):
                stream.close()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout, suppress(OSError, ValueError):
            buffered = os.fdopen(os.dup(process.stdout.fileno()), "rb")
            with buffered:
                for line in buffered:
                    self._hear(line)
        if process is self._process:
            self._events.append(Event("gone", EVERY_DEVICE, "the output process has ended"))

    def _hear(self, line: bytes) -> None:
        try:
            found = json.loads(line)
            event = Event(
                str(found["event"]),
                int(found["device"]),
                str(found.get("text", "")),
                tuple(float(each) for each in found.get("levels", ())),
            )
        except (ValueError, TypeError, KeyError):
            return
        if event.event == "silent":
            self._asked_silence_s = None
        else:
            self._events.append(event)
