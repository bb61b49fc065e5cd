# SPDX-License-Identifier: GPL-3.0-or-later
"""Thread of a device in the output process; a fault affects only this device."""

import logging
import math
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from typing import Final, NamedTuple

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ..workers.script_process import ScriptProcess, ScriptRefusedError
from .clock import SYSTEM, Clock
from .guard import Guard
from .output import PATIENCE_S, Output, OutputLostError, SoundingOutput, chosen_devices
from .pacing import DelayQueue, Pace, Ramp, tick_s
from .time_on import BudgetUse
from .tones import Sounding

STOPS: Final = 3
"""Number of times that stop bytes are sent: a lost or garbled copy must not matter."""

PULSE_S: Final = 0.3
PULSE_SHARE: Final = 0.3
"""Peak strength of a test pulse, as a share of the actuator's limit."""

FREEZE_S: Final = 0.26
"""Time without a sign of life from Blender after which a device falls silent, seconds. The safety
requirement is 0.3 s."""

_LEVELS_S: Final = 0.1
_IDLE_S: Final = 1.0

_log = logging.getLogger(__name__)

Report = Callable[..., None]


class Question(NamedTuple):
    """Request for the values of a device.

    The answer is discarded if a pause, stop or start has raised ``DeviceThread.generation``, or if
    a newer request has been answered.
    """

    generation: int  # of the thread, at the time of the request
    asked_s: float  # time at which Blender's message was read, by the output process's clock
    number: int  # rising


class DeviceThread:
    """Sends a device's newest values to an output in a thread.

    A second thread sends only stop bytes, so that a stop never waits for a stalled send.

    ``number``: the device's number in messages.
    ``open_output``: opens the output; called in this thread, as opening may take seconds.
    ``report``: called as ``report(event, device, text="", ...)``; must not block.
    ``offset_s``: delay of all values, seconds, for synchrony with sound and picture.
    ``budgets``: takes the label of the device that a server chose ("" without a server), for each
    output, and returns a context manager with the device's duty budgets. Called in this thread,
    after the output is open. None: budgets that last as long as this thread.
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
        budgets: Callable[..., AbstractContextManager[Sequence[BudgetUse]]] | None = None,
    ) -> None:
        self.number = number
        self.device = device
        self.script: ScriptProcess | None = None
        self._offset_s = offset_s
        self._clock = clock
        self._open_output = open_output
        self._report = report
        self._tick_s = tick_s(device)
        self._guard = Guard(device)
        self._budgets = budgets
        self._stepped_s = 0.0  # time of the last values that passed the guard
        self._ramp = Ramp(device, self._tick_s)
        self._pace = Pace(device, self._tick_s)
        self._sounding = Sounding(device)
        self._sent: F64 | None = None  # last values
        self.output: Output | None = None
        self._wake = threading.Condition()
        self._port = threading.Lock()  # held while values are handed over
        self.waiting = DelayQueue(device, self._tick_s, FREEZE_S)
        self.generation = 0  # raised by a pause, stop or start: earlier requests are void
        self._sign_s = -math.inf  # last time at which the present or queued values were valid
        self._asked = self._answered = 0  # numbers of the newest request and answer
        self._is_cut = False  # fall silent at once, without a ramp
        # Times of the next turn, the last turn, and the last turn that changed a value.
        self._due_s = self._last_s = self._changed_s = -math.inf
        self.is_armed = False  # plays values: from `arm` with an open output to a stop
        self.is_wanted = False  # to be armed as soon as the output is open
        self.is_open = False
        self.is_closed = False
        self._begins = False
        self._sending_since = math.inf
        self.test_pulse: tuple[int, float] | None = None  # actuator, start time
        self._levels_at = 0.0
        self._levels: list[float] = []
        self._strengths = list(device.strength_columns)
        self._rest = device.neutral[self._strengths]
        self._hush, self._is_quiet = threading.Event(), threading.Event()
        self._has_ended = False
        self._thread = threading.Thread(target=self._run, name=device.id, daemon=True)

    def start(self) -> None:
        """Start both threads; the output is opened in the background."""
        threading.Thread(target=self._run_stops, name="stop", daemon=True).start()
        self._thread.start()

    # Called in the thread of the messages: only :meth:`wait_closed` waits for hardware.

    def question(self, asked_s: float) -> Question:
        """Number a request of time ``asked_s`` with the present generation; for :meth:`feed`."""
        with self._wake:
            self._asked += 1
            return Question(self.generation, asked_s, self._asked)

    def feed(self, values: F64, question: Question | None = None) -> None:
        """Queue the newest frame behind frames that wait for the device's offset; a frame less than
        1 ms after the last one replaces it. Ignored unless the device is armed.

        ``values``: (columns,), or a row of :func:`.tones.frame_of`. A wrong number of entries is a
        fault and stops the device.
        ``question``: request that is answered. The frame is discarded if a pause or stop came after
        the request, or if a newer request has been answered. None: a request of this moment.
        """
        now = self._clock.now()
        with self._wake:
            if not self.is_armed:
                return
            if question is None:
                question = Question(self.generation, now, self._asked)
            if question.generation != self.generation:
                return
            # An older answer after a newer: renderer and script answer in threads of their own.
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
        """Extend the validity of the last values to ``now_s``, unless an answer is outstanding."""
        with self._wake:
            # A message alone proves only that Blender runs. With an answer outstanding, the last
            # values may be those of an earlier moment, and expire.
            if self.is_armed and self._answered == self._asked:
                self._sign_s = max(self._sign_s, now_s)

    def set_offset(self, offset_s: float) -> None:
        """Change the delay of values, seconds, including queued values."""
        with self._wake:
            self._offset_s = offset_s
            self._wake.notify()

    def pause(self) -> None:
        """Silence the device without a stop, until a frame arrives that is requested from now on.
        Queued frames are discarded, also of a device that is not armed."""
        with self._wake:
            self._void()
            if self.is_armed:
                self._is_cut = True
                self._wake.notify()

    def _void(self) -> None:
        """Discard queued frames and the test pulse, and raise the generation: answers to earlier
        requests become void. For callers that hold the lock."""
        self.generation += 1
        self.waiting.clear()
        self.test_pulse = None
        # Void requests get no answer; counted as open they would let all later values expire.
        self._answered = self._asked

    def pulse(self, actuator: int, generation: int | None = None) -> None:
        """Play a test pulse of 0.3 s on an actuator, by index; ignored if unknown or not armed, or
        after a pause since ``generation`` of this thread (None: no such test)."""
        with self._wake:
            is_void = generation not in (None, self.generation)
            if self.is_armed and not is_void and 0 <= actuator < len(self.device.actuators):
                self.test_pulse = actuator, self._clock.now()
                self._wake.notify()

    def arm(self) -> None:
        """Play from now on, or from the opening of the output, starting with silence; no effect if
        armed or closed.

        A script that may not run is reported as a fault, and the device stays silent.
        """
        with self._wake:
            self.is_wanted = True
            # Called twice in any order: by the message, and by the device thread after the opening.
            if not self.is_open or self.is_armed or self.is_closed:
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
            self.is_armed = True
            self._wake.notify()
        self._report("armed", self.number)

    def stop(self, reason: str, event: str = "stopped") -> None:
        """Silence the device now without waiting, and end the script.

        Stop bytes are sent even to a silent device. ``event`` with ``reason`` is reported if the
        device was armed, or if the event is not "stopped".
        """
        with self._wake:
            # The mark first: a turn that has begun tests it again before and after its send.
            was_armed, self.is_armed, self.is_wanted = self.is_armed, False, False
            self._void()
        self.silence()
        if was_armed or event != "stopped":
            self._report(event, self.number, text=reason)
        if self.script is not None:
            self.script.close()

    def freeze(self, reason: str) -> None:
        """Stop an armed device because Blender does not answer; the event is "frozen".

        Without effect on a device that opens: it is armed afterwards, silent until values come.
        """
        with self._wake:
            is_armed = self.is_armed
        if is_armed:
            self.stop(reason, "frozen")

    def fault(self, text: str) -> None:
        """Stop the device and report the event "fault", even if not armed; ``text``: reason."""
        self.stop(text, "fault")

    def close(self, reason: str) -> None:
        """Stop the device for good, reporting ``reason`` if armed; its thread then closes the port.

        Does not wait; no effect on a closed device.
        """
        with self._wake:
            if self.is_closed:
                return
        self.stop(reason)
        with self._wake:
            self.is_closed = True
            self._wake.notify()

    def wait_closed(self) -> None:
        """Wait, at most twice :data:`PATIENCE_S`, until the device is silent and the port closed.

        Returns at once before :meth:`start`: no port is open then.
        """
        if self._thread.ident is None:
            return
        self._is_quiet.wait(PATIENCE_S)
        self._thread.join(PATIENCE_S)

    def is_stuck(self, now_s: float) -> bool:
        """Test for a send in progress for more than 0.1 s at ``now_s``; for a watching thread."""
        return now_s - self._sending_since > PATIENCE_S

    def silence(self) -> None:
        """Request stop bytes from the stop thread, ahead of any values, without waiting."""
        self._is_quiet.clear()
        self._hush.set()
        # The stop thread has ended and sets the event no more; callers would wait in vain.
        if self._has_ended:  # after the last stop
            self._is_quiet.set()

    def _run_stops(self) -> None:
        """Run the stop thread: on request send stop bytes 3 times, without their exceptions, and
        record silence, until the device thread has ended. A stalled port may stall the stop bytes,
        too."""
        while True:
            self._hush.wait()
            self._hush.clear()
            output = self.output
            if output is not None:
                # A send in progress finishes first, so that no value follows the stop. A stuck
                # send may hold the lock for ever: after 5 ms the stop goes without the lock.
                is_ours = self._port.acquire(timeout=0.005)
                try:
                    for _ in range(STOPS):
                        with suppress(Exception):  # an output with a bug may raise
                            output.stop()
                finally:
                    if is_ours:
                        self._port.release()
            # The last values may have played until now, which counts as time on.
            now = self._clock.now()
            self._guard.time_on.end(now - self._stepped_s, now)
            if not self._hush.is_set():
                self._is_quiet.set()
            if self._has_ended:
                return

    # Run in the device thread.

    def _run(self) -> None:
        try:
            self._open_and_play()
        finally:
            # A last stop, after which the stop thread ends as well.
            self._has_ended = True
            self._hush.set()

    def _open_and_play(self) -> None:
        claims = ExitStack()
        try:
            output = self._open_output()
            if self._budgets is not None and self._guard.time_on.is_limited:
                try:
                    labels = chosen_devices(output)
                    self._guard.share(claims.enter_context(self._budgets(*labels)))
                except BaseException:
                    output.close()
                    raise
        except OutputLostError as error:
            self._report("lost", self.number, text=str(error))
            return
        except Exception as error:  # a bug of an output ends only this device
            _log.exception("device '%s' cannot be opened", self.device.id)
            self._report("lost", self.number, text=f"cannot be opened: {error}")
            return
        # Hardware may still play values of an earlier connection.
        with self._wake:
            self.output = output
        self.silence()
        self._is_quiet.wait(PATIENCE_S)
        with self._wake:
            self.is_open = True
            unit = ", ".join(filter(None, chosen_devices(output)))
            # Under the lock, so that "connected" is reported before "armed".
            self._report("connected", self.number, text=unit)
            is_to_play = self.is_wanted and not self.is_closed
        if is_to_play:
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
            except Exception:  # a bug of an output must not keep the budgets claimed
                _log.exception("device '%s' cannot be closed", self.device.id)
            claims.close()
            self._report("closed", self.number)

    def _play(self) -> None:
        while True:
            with self._wake:
                if self.is_closed:
                    return
                # The lock is reentrant here (a Condition's RLock): both read one state.
                wait_s = self.due_in_s()
                if wait_s > 0.0:
                    self._clock.wait(self._wake, wait_s)
                    continue
            self.turn()

    def due_in_s(self) -> float:
        """Seconds until :meth:`turn` is due without new messages; 0 if due now, 1 if not armed."""
        with self._wake:
            if not self.is_armed:
                return _IDLE_S
            return max(0.0, self._next_s() - self._clock.now())

    def _next_s(self) -> float:
        """Time of the clock at which :meth:`turn` is due, the earliest of the next update, the
        oldest queued frame and the end of validity of the values; -inf: at once, after arming or
        for a cut to silence."""
        if self._begins or self._is_cut:
            return -math.inf
        due = self._due_s
        if self.waiting:  # a frame is sent as soon as the device can take a new value
            frame_s = self.waiting.due_s(self._offset_s)
            due = min(due, max(frame_s, self._changed_s + self._tick_s))
        if self._ramp.is_going:
            due = min(due, self._sign_s + self._offset_s + FREEZE_S)
        return due

    def turn(self) -> None:
        """Send the values that are due now, and set the time of the next turn.

        A lost output, an exception or an overdue script stops the device.
        """
        with self._wake:
            now = self._clock.now()
            due = self._next_s()
            if self._begins:
                self._begins, self._last_s, self._changed_s = False, now, -math.inf
                # The stop thread may not have recorded the last silence yet; twice is harmless.
                self._guard.time_on.end(now - self._stepped_s, now)
                self._guard.time_on.record_rest(now)
                self._guard.reset()
                self._ramp.reset()
                self._pace.reset()
                self._sounding.reset()
                self._sent = None
            # 0.26 s plus the delay after the last sign of life, the last values are not valid any
            # more: Blender may hang.
            if now >= self._sign_s + self._offset_s + FREEZE_S:
                self._is_cut = True
                self.waiting.clear()
            generation, is_cut, newest = self.generation, self._is_cut, None
            self._is_cut = False
            # A frame before the end of the ramp waits for a turn, in which the ramp jumps to the
            # target: no frame is skipped.
            if self._ramp.share < 1.0 and self.waiting.due_s(self._offset_s) <= now:
                self._ramp.complete()
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
        if is_change:  # repeated values, for dead-man switches, delay no new frame
            self._changed_s = now
        # Counted from the time that was due, so that late wake-ups do not add up; but at least
        # half a tick from now, so that a late turn is not followed by a burst.
        due = max(min(due, now) + self._tick_s, now + 0.5 * self._tick_s)
        # A repetition gives way to an expected frame.
        self._due_s = self._ramp.next_s(due, now)

    def step(self, now: float, step_s: float, newest: F64 | None, generation: int) -> bool:
        """Send the values of time ``now``, after ramp, pace, test pulse and guard.

        An output with sound gets tones as well. Returns True if the values differ from the last
        values sent. Returns False, with nothing sent, if the device is not armed, has no output,
        was paused or stopped after ``generation``, or if ``now`` is more than 0.26 s ago.

        ``step_s``: time since the last turn, seconds, for the guard: slew rates and rests.
        ``newest``: frame that the ramp starts to approach, control values followed by values of
        tones for actuators driven as sound; None continues the present ramp.
        ``generation``: ``self.generation`` at the start of the turn.
        """
        if newest is not None:
            self._ramp.aim(self._sounding.split(newest), now)
        ramped = self._ramp.at(now)
        # The guard limits plain values, so an actuator with tones counts with their total.
        ramped = self._sounding.totals(self._ramp.share, ramped)
        paced = self._with_pulse(self._pace.paced(ramped, now), now)
        with self._port:
            output = self.output
            if not self.is_armed or output is None:
                return False
            # The guard comes last: no later step changes a value.
            values = self._guard.limited(paced, step_s)
            self._stepped_s = now
            # Values computed before a pause, or before the computer slept, are not sent.
            if generation != self.generation or self._clock.now() - now > FREEZE_S:
                return False
            is_change = self._sent is None or not np.array_equal(values, self._sent)
            previous, self._sent = self._sent, values
            self._sending_since = now
            try:
                if len(self._sounding) and isinstance(output, SoundingOutput):
                    share = self._ramp.share
                    output.send_tones(values, self._sounding.at(share, ramped, values))
                else:
                    output.send(values)
            finally:
                self._sending_since = math.inf
            was_stopped = not self.is_armed
        if was_stopped:  # a stop during the send went past the lock: once more, after the send
            self.silence()
        self._report_levels(values, previous, now)
        return is_change

    def _with_pulse(self, values: F64, now: float) -> F64:
        """Copy of values (columns,) with an actuator's strength replaced by the test pulse: a Hann
        window of 0.3 s with a peak of 30 % of the actuator's range, or its first allowed value.
        Returns ``values`` themselves without a pulse, or after its end, which clears the pulse."""
        if self.test_pulse is None:
            return values
        actuator, began_s = self.test_pulse
        share = (now - began_s) / PULSE_S
        if share >= 1.0:
            self.test_pulse = None
            return values
        strength = self.device.actuators[actuator].type.strength
        column = self.device.strength_columns[actuator]
        # Actuators with a range only below neutral, as for cooling, pulse downwards.
        reach = strength.highest - strength.neutral
        if reach <= 0.0:
            reach = strength.lowest - strength.neutral
        envelope = 0.5 - 0.5 * math.cos(2.0 * math.pi * share)  # Hann window
        peak = PULSE_SHARE * envelope * reach
        # Of a coarse actuator the first step, as the guard would round a weaker pulse to silence.
        steps = [value - strength.neutral for value in strength.values]
        first = min((step for step in steps if step * reach > 0.0), key=abs, default=0.0)
        values = values.copy()
        values[column] = strength.neutral + max(peak, first, key=abs)
        return values

    def _report_levels(self, values: F64, previous: F64 | None, now: float) -> None:
        """Report the event "levels": distance of each strength from neutral, a share of its reach
        rounded to 0.0001. Values after silence are reported at once, as studies log this time;
        other changes 0.1 s after the last report at the earliest."""
        was_silent = previous is None or np.array_equal(previous[self._strengths], self._rest)
        begins = was_silent and not np.array_equal(values[self._strengths], self._rest)
        if not begins and now < self._levels_at + _LEVELS_S:
            return
        levels = []
        for actuator, column in zip(
            self.device.actuators, self.device.strength_columns, strict=True
        ):
            strength = actuator.type.strength
            difference = abs(float(values[column]) - strength.neutral)
            levels.append(round(difference / strength.reach, 4) if strength.reach > 0.0 else 0.0)
        if begins or levels != self._levels:
            self._levels, self._levels_at = levels, now
            self._report("levels", self.number, levels=levels)
