# SPDX-License-Identifier: GPL-3.0-or-later
"""One device in the output process: a thread of its own, so that its faults are its own."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from ...engine.rendering.device import DeviceConfig
from .guard import Guard
from .output import Output, OutputLostError, SoundingOutput
from .pacing import Pace, Ramp, tick_s
from .time_on import Account
from .tones import Sounding

F64 = npt.NDArray[np.float64]

STOPS: Final = 3
"""How often stop bytes are sent: one that is lost or garbled must not matter."""

PATIENCE_S: Final = 0.1
"""An output that takes longer to hand over values does not answer."""

PULSE_S: Final = 0.3
PULSE_SHARE: Final = 0.3
"""A test pulse is soft: this share of what the actuator may get at most."""

_LEVELS_S: Final = 0.1
_MAX_WAITING: Final = 64  # frames that an offset holds back

_log = logging.getLogger(__name__)

Report = Callable[..., None]


class Script(Protocol):
    """What a lane needs of a device's script."""

    def start(self) -> None: ...

    def ask(self, haptics: bytes) -> None: ...

    def is_overdue(self, now_s: float) -> bool: ...

    def close(self) -> None: ...


class Lane:
    """From a device's newest values to its output.

    Parameters
    ----------
    number : int
        The device's number in messages.
    device : DeviceConfig
    open_output : callable
        Opens the output; called in the lane's thread, as it may take its time.
    report : callable
        ``report(event, device, text="", ...)``; must not block.
    offset_s : float
        How long values are held back, so that they meet sound and picture.
    accounts : callable, optional
        Finds the device's accounts of time on; called in the lane's thread.
    """

    def __init__(
        self,
        number: int,
        device: DeviceConfig,
        open_output: Callable[[], Output],
        report: Report,
        *,
        offset_s: float = 0.0,
        accounts: Callable[[], Sequence[Account]] | None = None,
    ) -> None:
        self.number = number
        self.device = device
        self.script: Script | None = None
        self.offset_s = offset_s
        self._open_output = open_output
        self._report = report
        self._tick_s = tick_s(device)
        self._guard = Guard(device)
        self._accounts = accounts
        self._stepped_s = 0.0  # when values passed the guard last
        self._ramp = Ramp(device, self._tick_s)
        self._pace = Pace(device, self._tick_s)
        self._sounding = Sounding(device)
        self._sent: F64 | None = None  # last
        self._output: Output | None = None
        self._wake = threading.Condition()
        self._port = threading.Lock()  # held while values are handed over
        self._waiting: deque[tuple[float, F64]] = deque(maxlen=_MAX_WAITING)  # due, values
        self._is_armed = False
        self._is_wanted = False  # armed before it was open
        self._is_open = False
        self._is_closed = False
        self._begins = False
        self._sending_since = math.inf
        self._pulse: tuple[int, float] | None = None  # actuator, begun
        self._levels_at = 0.0
        self._levels: list[float] = []
        self._hush, self._is_quiet = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=device.id, daemon=True)

    def start(self) -> None:
        threading.Thread(target=self._run_stops, name="stop", daemon=True).start()
        self._thread.start()

    @property
    def is_armed(self) -> bool:
        """Whether it plays."""
        return self._is_armed

    # What the reader calls: none of these waits for hardware longer than a moment.

    def feed(self, values: F64) -> None:
        """The newest frame; older ones that are due do not matter any more."""
        with self._wake:
            if self._is_armed:
                self._waiting.append((time.monotonic() + self.offset_s, values))
                self._wake.notify()

    def pause(self) -> None:
        """Silence until the next frame, without a stop."""
        with self._wake:
            self._waiting.clear()
            self._pulse = None
            if self._is_armed:
                self._waiting.append((-math.inf, self._guard.neutral.copy()))
                self._wake.notify()

    def pulse(self, actuator: int) -> None:
        """Let one actuator be felt for a moment, softly."""
        with self._wake:
            if self._is_armed and 0 <= actuator < len(self.device.actuators):
                self._pulse = actuator, time.monotonic()
                self._wake.notify()

    def arm(self) -> None:
        """Play from now on, from silence."""
        with self._wake:
            self._is_wanted = True
            if not self._is_open or self._is_armed or self._is_closed:
                return
            if self.script is not None:
                try:
                    self.script.start()
                except ScriptRefusedError as error:
                    self._is_wanted = False
                    self._report("fault", self.number, text=str(error))
                    return
            self._waiting.clear()
            self._pulse = None
            self._begins = True
            self._is_armed = True
            self._wake.notify()
        self._report("armed", self.number)

    def stop(self, reason: str, event: str = "stopped") -> None:
        """Silence now, whatever waits; also when it is silent already."""
        with self._wake:
            was_armed, self._is_armed, self._is_wanted = self._is_armed, False, False
            self._waiting.clear()
            self._pulse = None
        self._silence()
        if was_armed or event != "stopped":
            self._report(event, self.number, text=reason)
        if self.script is not None:
            self.script.close()

    def freeze(self, reason: str) -> None:
        """Stop because nobody answers; what is still being opened plays when it is open.

        It is silent until then, and after it until values come.
        """
        with self._wake:
            is_armed = self._is_armed
        if is_armed:
            self.stop(reason)

    def fault(self, text: str) -> None:
        """Stop because something is wrong."""
        self.stop(text, "fault")

    def close(self, reason: str) -> None:
        """Stop, and give the port back."""
        with self._wake:
            if self._is_closed:
                return
        self.stop(reason)
        with self._wake:
            self._is_closed = True
            self._wake.notify()

    def wait_closed(self) -> None:
        """Give it a moment to stop and to give the port back."""
        self._is_quiet.wait(PATIENCE_S)
        self._thread.join(PATIENCE_S)

    def is_stuck(self, now_s: float) -> bool:
        """Whether its output does not answer; then its own thread cannot tell."""
        return now_s - self._sending_since > PATIENCE_S

    def _silence(self) -> None:
        """Have stop bytes sent, before anything that is sent; nobody waits for them."""
        self._hush.set()
        self._is_quiet.clear()

    def _run_stops(self) -> None:
        """The stop lane: a thread of its own, as a port that stalls may stall a stop as well."""
        while True:
            self._hush.wait()
            self._hush.clear()
            output = self._output
            if output is not None:
                is_ours = self._port.acquire(timeout=0.005)  # past a send that is stuck
                try:
                    for _ in range(STOPS):
                        with suppress(Exception):  # by contract it raises nothing
                            output.stop()
                finally:
                    if is_ours:
                        self._port.release()
            now = time.monotonic()
            self._guard.fell_silent(now - self._stepped_s, now)
            if not self._hush.is_set():
                self._is_quiet.set()

    # The lane's own thread.

    def _run(self) -> None:
        try:
            if self._accounts is not None and self._guard.has_time_limit:
                self._guard.share(self._accounts())
            output = self._open_output()
        except OutputLostError as error:
            self._report("lost", self.number, text=str(error))
            return
        except Exception as error:  # an output of somebody's: its fault is its device's only
            _log.exception("device '%s' cannot be opened", self.device.id)
            self._report("lost", self.number, text=f"cannot be opened: {error}")
            return
        with self._wake:
            self._output = output
        self._silence()
        self._is_quiet.wait(PATIENCE_S)
        with self._wake:
            self._is_open = True
            self._report("connected", self.number)  # before anybody can arm it
            wanted = self._is_wanted and not self._is_closed
        if wanted:
            self.arm()
        try:
            self._play()
        finally:
            self._silence()
            self._is_quiet.wait(PATIENCE_S)
            with suppress(Exception):
                output.close()
            self._report("closed", self.number)

    def _play(self) -> None:
        last = due = time.monotonic()
        sent = -math.inf
        while True:
            with self._wake:
                if self._is_closed:
                    return
                if not self._is_armed:
                    self._wake.wait(1.0)
                    continue
                now = time.monotonic()
                if self._waiting:  # a frame goes out as soon as the device can take it
                    due = min(due, max(self._waiting[0][0], sent + self._tick_s))
                if now < due:
                    self._wake.wait(due - now)
                    continue
                if self._begins:
                    self._begins, last = False, now
                    self._guard.fell_silent(now - self._stepped_s, now)  # if not told yet
                    self._guard.rested(now)
                    self._guard.reset()
                    self._ramp.reset()
                    self._pace.reset()
                    self._sounding.reset()
                    self._sent = None
            if self.script is not None and self.script.is_overdue(now):
                self.fault(f"its script did not answer within {PATIENCE_S * 1000:.0f} ms")
                continue
            is_change = False
            try:
                is_change = self._step(now, now - last)
            except OutputLostError as error:
                self.stop(str(error), "lost")
            except Exception as error:
                _log.exception("device '%s'", self.device.id)
                self.fault(f"{type(error).__name__}: {error}")
            last = now
            if is_change:  # what repeats, for dead-men, keeps no frame waiting
                sent = now
            due = self._ramp.next_s(max(due + self._tick_s, now + 0.5 * self._tick_s), now)

    def _step(self, now: float, step_s: float) -> bool:
        """Send what is due; whether it is anything else than before."""
        newest = None
        with self._wake:
            while self._waiting and self._waiting[0][0] <= now:
                newest = self._waiting.popleft()[1]
        if newest is not None:
            self._ramp.aim(self._sounding.split(newest), now)
        asked = self._ramp.at(now)
        asked = self._sounding.totals(self._ramp.share, asked)
        wanted = self._with_pulse(self._pace.paced(asked, now), now)
        with self._port:
            output = self._output
            if not self._is_armed or output is None:
                return False
            values = self._guard.passed(wanted, step_s)
            self._stepped_s = now
            is_change = self._sent is None or not np.array_equal(values, self._sent)
            self._sent = values
            self._sending_since = now
            try:
                if len(self._sounding) and isinstance(output, SoundingOutput):
                    share = self._ramp.share
                    output.send_tones(values, self._sounding.at(share, asked, values))
                else:
                    output.send(values)
            finally:
                self._sending_since = math.inf
            was_stopped = not self._is_armed
        if was_stopped:  # meanwhile, without waiting for us
            self._silence()
        self._tell_levels(values, now)
        return is_change

    def _with_pulse(self, wanted: F64, now: float) -> F64:
        if self._pulse is None:
            return wanted
        actuator, begun = self._pulse
        share = (now - begun) / PULSE_S
        if share >= 1.0:
            self._pulse = None
            return wanted
        first = sum(len(each.type.controls) for each in self.device.actuators[:actuator])
        strength = self.device.actuators[actuator].type.strength
        reach = strength.highest - strength.neutral
        if reach <= 0.0:
            reach = strength.lowest - strength.neutral
        softly = 0.5 - 0.5 * math.cos(2.0 * math.pi * share)
        wanted = wanted.copy()
        wanted[first] = strength.neutral + PULSE_SHARE * softly * reach
        return wanted

    def _tell_levels(self, values: F64, now: float) -> None:
        """How strongly each actuator plays, 0..1, for who watches; a few times a second."""
        if now < self._levels_at + _LEVELS_S:
            return
        levels = []
        first = 0
        for actuator in self.device.actuators:
            strength = actuator.type.strength
            way = abs(float(values[first]) - strength.neutral)
            reach = max(strength.highest - strength.neutral, strength.neutral - strength.lowest)
            levels.append(round(way / reach, 2) if reach > 0.0 else 0.0)
            first += len(actuator.type.controls)
        if levels != self._levels:
            self._levels, self._levels_at = levels, now
            self._report("levels", self.number, levels=levels)


class ScriptRefusedError(Exception):
    """A device's script may not run: not approved, or faulty too often."""
