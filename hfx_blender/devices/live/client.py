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
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, Final, TypeVar

import numpy.typing as npt

from ... import resources
from ...engine.samples import Stream
from ...engine.track.header import TrackHeader
from ...errors import DeviceError
from .messages import EVERY_DEVICE, Kind, json_to, message, values_to
from .moments import Moment, SceneMessage, Worn, moment_to, scene_to

_PACKAGE: Final = Path(__file__).resolve().parents[2]  # its folder; in an extension too
_MAX_EVENTS: Final = 1000
_Taken = TypeVar("_Taken")

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
    configuration: str = ""
    folder: str | None = None
    has_script: bool = False
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
        # Between threads without a lock, which Blender would wait for: each step is atomic.
        self._wake: SimpleQueue[None] = SimpleQueue()
        self._urgent: deque[bytes] = deque()
        self._newest: dict[int, bytes | Moment] = {}
        self._places: dict[Stream, int] = {}  # of the scene that moments are of
        self._silences = 0  # how often everything before became void
        self._is_closing = False
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        self._asked_silence_s: float | None = None
        self._numbers = 0
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
        environment["HFX_BODY_MODELS"] = str(resources.user_body_models())
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
        self._wake, self._urgent, self._newest = SimpleQueue(), deque(), {}
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
        known.configuration, known.has_script = str(configuration), script is not None
        known.folder = None if folder is None else str(folder)
        wish = {
            "configuration": known.configuration,
            "folder": known.folder,
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

    def describe(self, header: TrackHeader, body_id: str) -> None:
        """Moments from now on are of this scene, felt by this body; silent until one comes.

        They are for the devices that are connected now.
        """
        worn = tuple(
            Worn(each.number, each.configuration, each.folder, each.has_script)
            for each in self.devices.values()
        )
        body = scene_to(SceneMessage(header, body_id, worn))
        self._newest.pop(EVERY_DEVICE, None)
        self._silences += 1
        self._places = {stream: k for k, stream in enumerate(header.streams)}
        self._tell(Kind.SCENE, body=body)

    def show(self, moment: Moment) -> None:
        """What is felt now, for every device; what was not sent yet is replaced.

        It is handed over as it is: nothing of it may be changed any more.
        """
        if self._process is None:
            return
        self._newest[EVERY_DEVICE] = moment
        self._nudge()

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
        self._newest.clear()
        self._silences += 1
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
        self._newest.clear()
        self._silences += 1
        self._urgent.appendleft(message(Kind.STOP, EVERY_DEVICE, reason.encode()))
        if self._asked_silence_s is None:
            self._asked_silence_s = time.monotonic()
        self._nudge()

    def close(self) -> None:
        """Stop everything and end the output process; at most a moment, and at any time."""
        process, self._process = self._process, None
        if process is None:
            return
        self._newest.clear()
        self._silences += 1
        self._urgent.clear()
        self._urgent.append(message(Kind.STOP))
        self._is_closing = True
        self._nudge()
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

    def _nudge(self) -> None:
        """There is something to write; who has been told so already is not told again."""
        if self._wake.empty():
            self._wake.put(None)

    def _tell(self, kind: Kind, device: int = EVERY_DEVICE, body: bytes = b"") -> None:
        if not self.is_running:
            return
        if kind is Kind.HEARTBEAT and (self._urgent or self._newest):
            return  # whatever waits is one
        self._urgent.append(message(kind, device, body))
        self._nudge()

    def _feed(self, name: str, kind: Kind, body: bytes) -> None:
        state = self.devices.get(name)
        if state is None or self._process is None:
            return
        self._newest[state.number] = message(kind, state.number, body)
        self._nudge()

    def _kill(self, text: str) -> None:
        if self._process is not None:
            self._process.kill()
        self._asked_silence_s = None
        self._events.append(Event("gone", EVERY_DEVICE, text))

    # Threads: pipes may make them wait.

    def _write(self, process: subprocess.Popen[bytes]) -> None:
        stream, wake = process.stdin, self._wake
        assert stream is not None
        try:
            while True:
                wake.get()
                if process is not self._process and not self._is_closing:
                    return
                # What is new first: whatever is urgent that came before it is then there as well.
                silences, is_last, places = self._silences, self._is_closing, self._places
                newest = list(_taken(self._newest.popitem))[::-1]
                waiting = list(_taken(self._urgent.popleft))
                if waiting:
                    _write_all(stream, b"".join(waiting))
                data = b"".join(self._as_bytes(each, places) for _, each in newest)
                if silences != self._silences and not is_last:
                    continue  # a stop came meanwhile: nothing of before it is felt after it
                _write_all(stream, data)
                if is_last:
                    return
        except (OSError, ValueError):
            pass  # the listener tells
        finally:
            with suppress(OSError):
                stream.close()

    def _as_bytes(self, newest: bytes | Moment, places: Mapping[Stream, int]) -> bytes:
        if not isinstance(newest, Moment):
            return newest
        try:
            return message(Kind.MOMENT, EVERY_DEVICE, moment_to(newest, places))
        except KeyError:
            return b""  # of the scene before
        except Exception as error:
            self.stop_all(f"what is felt cannot be handed over ({error})")
            return b""

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


def _taken(take: Callable[[], _Taken]) -> Iterator[_Taken]:
    """What can be taken until nothing is left; others may add to it meanwhile."""
    with suppress(IndexError, KeyError):
        while True:
            yield take()


def _write_all(stream: IO[bytes], content: bytes) -> None:
    data = memoryview(content)
    while data:
        data = data[stream.write(data) or 0 :]
