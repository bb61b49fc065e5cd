# SPDX-License-Identifier: GPL-3.0-or-later
"""Thread of one device in the output process: its faults are its own."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from typing import Final, NamedTuple, Protocol

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device import DeviceConfig
from .clock import SYSTEM, Clock
from .guard import Guard
from .output import Output, OutputLostError, SoundingOutput
from .pacing import Pace, Ramp, tick_s
from .time_on import AccountUse
from .tones import Sounding
from .waiting import Waiting

STOPS: Final = 3
"""Number of times that stop bytes are sent: one that is lost or garbled must not matter."""

PATIENCE_S: Final = 0.1
"""An output that takes longer to hand over values does not answer."""

PULSE_S: Final = 0.3
PULSE_SHARE: Final = 0.3
"""Strength of a test pulse, as a share of the actuator's limit: it is soft."""

FREEZE_S: Final = 0.26
"""Time without a sign that the last values still hold, after which a device is silent, seconds; the
limit is 0.3."""

_LEVELS_S: Final = 0.1
_IDLE_S: Final = 1.0

_log = logging.getLogger(__name__)

Report = Callable[..., None]


class Question(NamedTuple):
    """Request for the values of a device; its answer may come late.

    Attributes
    ----------
    generation : int
        Of the thread, when it was asked: pauses, stops and new beginnings make it void.
    asked_s : float
        When Blender's message was read.
    number : int
        In the order of asking: who is answered later than a newer one is not heard any more.
    """

    generation: int
    asked_s: float
    number: int


class Script(Protocol):
    """Interface of a device's script."""

    def start(self) -> None: ...

    def ask(self, haptics: bytes, answer: Callable[[F64], None]) -> None: ...

    def is_overdue(self, now_s: float) -> bool: ...

    def close(self) -> None: ...


class DeviceThread:
    """Thread that carries a device's newest values to its output.

    Parameters
    ----------
    number : int
        The device's number in messages.
    open_output : callable
        Opens the output; called in this thread, as it may take its time.
    report : callable
        ``report(event, device, text="", ...)``; must not block.
    offset_s : float
        How long values are held back, so that they meet sound and picture.
    accounts : callable, optional
        Finds the device's accounts of time on, by the device that a server chose; called in this
        thread, when the output is open.
    """

    def __init__(
        self,
        number: int,
        device: DeviceConfig,
        open_output: Callable[[], Output],
        report: Report,
        *,
        offset_s: float = 0.0,
        clock: Clock = SYSTEM,
        accounts: Callable[[str], AbstractContextManager[Sequence[AccountUse]]] | None = None,
    ) -> None:
        self.number = number
        self.device = device
        self.script: Script | None = None
        self._offset_s = offset_s
        self._clock = clock
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
        self.output: Output | None = None
        self._wake = threading.Condition()
        self._port = threading.Lock()  # held while values are handed over
        self.waiting = Waiting(device, self._tick_s, FREEZE_S)
        self.generation = 0  # raised by everything that voids earlier requests
        self._sign_s = -math.inf  # last time at which the present or waiting values were valid
        self._asked = self._answered = 0  # numbers of the newest questions
        self._is_cut = False  # silent at once, not by a ramp
        self._due_s = self._last_s = self._changed_s = -math.inf  # of turns
        self._is_armed = False
        self.is_wanted = False  # armed before it was open
        self.is_open = False
        self.is_closed = False
        self._begins = False
        self._sending_since = math.inf
        self.test_pulse: tuple[int, float] | None = None  # actuator, begun
        self._levels_at = 0.0
        self._levels: list[float] = []
        self._hush, self._is_quiet = threading.Event(), threading.Event()
        self._has_ended = False
        self._thread = threading.Thread(target=self._run, name=device.id, daemon=True)

    def start(self) -> None:
        threading.Thread(target=self._run_stops, name="stop", daemon=True).start()
        self._thread.start()

    @property
    def is_armed(self) -> bool:
        """Test that the device plays."""
        return self._is_armed

    # Called by the reader: none of these waits for hardware longer than a moment.

    def question(self, asked_s: float) -> Question:
        """Register a request for this device; :meth:`feed` takes its answer."""
        with self._wake:
            self._asked += 1
            return Question(self.generation, asked_s, self._asked)

    def feed(self, values: F64, question: Question | None = None) -> None:
        """Take the newest frame; older ones that are due are dropped.

        Parameters
        ----------
        values : (columns,) or with tones behind, as ``frame_of`` makes it
            Any other number of values is a fault.
        question : Question, optional
            What it answers; nothing is played of what was asked before a pause or a stop.
        """
        now = self._clock.now()
        with self._wake:
            if not self._is_armed:
                return
            if question is None:
                question = Question(self.generation, now, self._asked)
            if question.generation != self.generation:
                return
            if question.number < self._answered:
                return
            fault = self._sounding.fault_of(values)
            if not fault:
                self._answered = question.number
                self._sign_s = max(self._sign_s, question.asked_s)
                self.waiting.add(values, now)
                self._wake.notify()
        if fault:
            self.fault(fault)

    def sign(self, now_s: float) -> None:
        """Take a sign of life from Blender: the last values still hold, unless an answer is
        awaited.
        """
        with self._wake:
            if self._is_armed and self._answered == self._asked:
                self._sign_s = max(self._sign_s, now_s)

    def set_offset(self, offset_s: float) -> None:
        """Change the delay of values, also of those that wait already."""
        with self._wake:
            self._offset_s = offset_s
            self._wake.notify()

    def pause(self) -> None:
        """Silence the device until a frame that is requested from now on, without a stop.

        What waits for its offset is not played any more.
        """
        with self._wake:
            self._void()
            if self._is_armed:
                self._is_cut = True
                self._wake.notify()

    def _void(self) -> None:
        """Discard everything that was asked before."""
        self.generation += 1
        self.waiting.clear()
        self.test_pulse = None
        self._answered = self._asked

    def pulse(self, actuator: int) -> None:
        """Play one actuator for a moment, softly."""
        with self._wake:
            if self._is_armed and 0 <= actuator < len(self.device.actuators):
                self.test_pulse = actuator, self._clock.now()
                self._wake.notify()

    def arm(self) -> None:
        """Play from now on, from silence."""
        with self._wake:
            self.is_wanted = True
            if not self.is_open or self._is_armed or self.is_closed:
                return
            if self.script is not None:
                try:
                    self.script.start()
                except ScriptRefusedError as error:
                    self.is_wanted = False
                    self._report("fault", self.number, text=str(error))
                    return
            self._void()
            self._begins = True
            self._is_armed = True
            self._wake.notify()
        self._report("armed", self.number)

    def stop(self, reason: str, event: str = "stopped") -> None:
        """Silence the device now; also when it is silent already."""
        with self._wake:
            was_armed, self._is_armed, self.is_wanted = self._is_armed, False, False
            self._void()
        self.silence()
        if was_armed or event != "stopped":
            self._report(event, self.number, text=reason)
        if self.script is not None:
            self.script.close()

    def freeze(self, reason: str) -> None:
        """Stop because Blender does not answer; a device that is still opening plays later.

        It is silent until then, and after it until values come.
        """
        with self._wake:
            is_armed = self._is_armed
        if is_armed:
            self.stop(reason, "frozen")

    def fault(self, text: str) -> None:
        """Stop after a fault."""
        self.stop(text, "fault")

    def close(self, reason: str) -> None:
        """Stop, and give the port back."""
        with self._wake:
            if self.is_closed:
                return
        self.stop(reason)
        with self._wake:
            self.is_closed = True
            self._wake.notify()

    def wait_closed(self) -> None:
        """Wait, at most twice :data:`PATIENCE_S`, until the device is silent and its port closed.

        Nothing is waited for where :meth:`start` was not called yet: no port is open.
        """
        if self._thread.ident is None:
            return
        self._is_quiet.wait(PATIENCE_S)
        self._thread.join(PATIENCE_S)

    def is_stuck(self, now_s: float) -> bool:
        """Test for an output that does not answer; its own thread cannot tell."""
        return now_s - self._sending_since > PATIENCE_S

    def silence(self) -> None:
        """Request stop bytes, before anything else that is sent; without waiting."""
        self._is_quiet.clear()
        self._hush.set()
        if self._has_ended:  # and has stopped
            self._is_quiet.set()

    def _run_stops(self) -> None:
        """Run the stop thread: separate, as a stalled port may stall a stop as well."""
        while True:
            self._hush.wait()
            self._hush.clear()
            output = self.output
            if output is not None:
                is_ours = self._port.acquire(timeout=0.005)  # past a send that is stuck
                try:
                    for _ in range(STOPS):
                        with suppress(Exception):  # by contract it raises nothing
                            output.stop()
                finally:
                    if is_ours:
                        self._port.release()
            now = self._clock.now()
            self._guard.record_silence(now - self._stepped_s, now)
            if not self._hush.is_set():
                self._is_quiet.set()
            if self._has_ended:
                return

    # The thread itself.

    def _run(self) -> None:
        try:
            self._open_and_play()
        finally:
            self._has_ended = True
            self._hush.set()

    def _open_and_play(self) -> None:
        uses = ExitStack()
        try:
            output = self._open_output()
            if self._accounts is not None and self._guard.has_time_limit:
                with closing_unless_done(output):
                    there = str(getattr(output, "chosen_device", ""))
                    self._guard.share(uses.enter_context(self._accounts(there)))
        except OutputLostError as error:
            self._report("lost", self.number, text=str(error))
            return
        except Exception as error:  # a foreign output: its fault affects its own device only
            _log.exception("device '%s' cannot be opened", self.device.id)
            self._report("lost", self.number, text=f"cannot be opened: {error}")
            return
        with self._wake:
            self.output = output
        self.silence()
        self._is_quiet.wait(PATIENCE_S)
        with self._wake:
            self.is_open = True
            unit = str(getattr(output, "chosen_device", ""))
            self._report("connected", self.number, text=unit)  # before anybody can arm it
            wanted = self.is_wanted and not self.is_closed
        if wanted:
            self.arm()
        try:
            self._play()
        finally:
            self.silence()
            self._is_quiet.wait(PATIENCE_S)
            self.output = None
            try:
                output.close()
            except OutputLostError as error:
                self._report("lost", self.number, text=str(error))
            except Exception:  # a foreign output; its port is its own affair
                _log.exception("device '%s' cannot be closed", self.device.id)
            uses.close()
            self._report("closed", self.number)

    def _play(self) -> None:
        while True:
            with self._wake:
                if self.is_closed:
                    return
                wait_s = self.due_in_s()
                if wait_s > 0.0:
                    self._clock.wait(self._wake, wait_s)
                    continue
            self.turn()

    def due_in_s(self) -> float:
        """Seconds until :meth:`turn` is due, unless something comes meanwhile; 0 if it is due."""
        with self._wake:
            if not self._is_armed:
                return _IDLE_S
            return max(0.0, self._next_s() - self._clock.now())

    def _next_s(self) -> float:
        if self._begins or self._is_cut:
            return -math.inf
        due = self._due_s
        if self.waiting:  # a frame is sent as soon as the device can take it
            asked_s = self.waiting.due_s(self._offset_s)
            due = min(due, max(asked_s, self._changed_s + self._tick_s))
        if self._ramp.is_going:
            due = min(due, self._holds_until_s())
        return due

    def _holds_until_s(self) -> float:
        """Time from which on it is unknown whether the last values still hold."""
        return self._sign_s + self._offset_s + FREEZE_S

    def turn(self) -> None:
        """Send the values that are due now."""
        with self._wake:
            now = self._clock.now()
            due = self._next_s()
            if self._begins:
                self._begins, self._last_s, self._changed_s = False, now, -math.inf
                self._guard.record_silence(now - self._stepped_s, now)  # if not reported yet
                self._guard.record_rest(now)
                self._guard.reset()
                self._ramp.reset()
                self._pace.reset()
                self._sounding.reset()
                self._sent = None
            if now >= self._holds_until_s():
                self._is_cut = True
                self.waiting.clear()
            generation, is_cut, newest = self.generation, self._is_cut, None
            self._is_cut = False
            if self._ramp.share < 1.0 and self.waiting.due_s(self._offset_s) <= now:
                self._ramp.complete()  # what was asked for is played before what comes next
            else:
                newest = self.waiting.taken(now, self._offset_s)
        if self.script is not None and self.script.is_overdue(now):
            self.fault(f"its script did not answer within {PATIENCE_S * 1000:.0f} ms")
            return
        if is_cut:
            self._ramp.reset()
            self._sounding.reset()
        is_change = False
        try:
            is_change = self.step(now, now - self._last_s, newest, generation)
        except OutputLostError as error:
            self.stop(str(error), "lost")
        except Exception as error:
            _log.exception("device '%s'", self.device.id)
            self.fault(f"{type(error).__name__}: {error}")
        self._last_s = now
        if is_change:  # repetitions for dead-man switches delay no frame
            self._changed_s = now
        due = max(min(due, now) + self._tick_s, now + 0.5 * self._tick_s)
        self._due_s = self._ramp.next_s(due, now)

    def step(self, now: float, step_s: float, newest: F64 | None, generation: int) -> bool:
        """Send the values that are due; returns True if they differ from the last."""
        if newest is not None:
            self._ramp.aim(self._sounding.split(newest), now)
        asked = self._ramp.at(now)
        asked = self._sounding.totals(self._ramp.share, asked)
        wanted = self._with_pulse(self._pace.paced(asked, now), now)
        with self._port:
            output = self.output
            if not self._is_armed or output is None:
                return False
            values = self._guard.limited(wanted, step_s)
            self._stepped_s = now
            # Values computed before a pause, or before the computer slept, are not sent.
            if generation != self.generation or self._clock.now() - now > FREEZE_S:
                return False
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
            self.silence()
        self._report_levels(values, now)
        return is_change

    def _with_pulse(self, wanted: F64, now: float) -> F64:
        if self.test_pulse is None:
            return wanted
        actuator, begun = self.test_pulse
        share = (now - begun) / PULSE_S
        if share >= 1.0:
            self.test_pulse = None
            return wanted
        strength = self.device.actuators[actuator].type.strength
        column = self.device.strength_columns[actuator]
        reach = strength.highest - strength.neutral
        if reach <= 0.0:
            reach = strength.lowest - strength.neutral
        softly = 0.5 - 0.5 * math.cos(2.0 * math.pi * share)
        wanted = wanted.copy()
        wanted[column] = strength.neutral + PULSE_SHARE * softly * reach
        return wanted

    def _report_levels(self, values: F64, now: float) -> None:
        """Report the level of each actuator, 0..1, a few times a second."""
        if now < self._levels_at + _LEVELS_S:
            return
        levels = []
        for actuator, column in zip(
            self.device.actuators, self.device.strength_columns, strict=True
        ):
            strength = actuator.type.strength
            way = abs(float(values[column]) - strength.neutral)
            levels.append(round(way / strength.reach, 2) if strength.reach > 0.0 else 0.0)
        if levels != self._levels:
            self._levels, self._levels_at = levels, now
            self._report("levels", self.number, levels=levels)


@contextmanager
def closing_unless_done(output: Output) -> Iterator[None]:
    """Context that closes an output after an exception."""
    try:
        yield
    except BaseException:
        output.close()
        raise


class ScriptRefusedError(Exception):
    """A device's script may not run: not approved, or faulty too often."""
