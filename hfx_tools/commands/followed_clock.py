# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of another program, followed from messages that arrive late, in steps, or not at all."""

from __future__ import annotations

import time
from collections import deque
from typing import Any, Final

import numpy as np

from hfx_blender.errors import UsageError
from hfx_blender.tracking.receiver import OscReceiver
from hfx_blender.tracking.value_addresses import change_of, is_used

JUMP_S: Final = 0.1
"""Difference from the expected time that is a jump and not jitter, seconds."""

FADE_S: Final = 0.05
"""Silence after a jump, seconds, in which the devices ramp down."""

# Correction of the position by a message: a share of the difference. Messages arrive late, never
# early, so an earlier message tells more about the sender's clock than a later one.
_EARLY, _LATE = 0.3, 0.02

# Time without messages after which the sender is lost, seconds, and without a change of the time
# after which the sender is paused; of slow senders three intervals.
_LOST_S: Final = (0.5, 1.5)
_STILL_S: Final = 0.2
_HISTORY_S: Final = 2.0
_FITTED_S: Final = 0.5  # shortest history of which the speed is estimated again and again
_LINE_S: Final = 0.03  # largest residual of a change of speed, seconds
_NORMAL: Final = 0.01  # speeds that near to 1 are 1: clocks differ by less


class ClockFollower:
    """Position of a sender's clock. All arguments ``now_s`` are of one local monotonic clock."""

    def __init__(self) -> None:
        self._position_s = self._at_s = 0.0  # position at a local time
        self._speed = 1.0
        self._declared: float | None = None  # rate as of the sender
        self._heard_s = self._changed_s = -np.inf
        self._interval_s = 0.0  # between the last two changes
        self._silent_until_s = -np.inf
        self._history: deque[tuple[float, float]] = deque()  # local and sender's time

    def hear_rate(self, rate: float, now_s: float) -> None:
        """Take the sender's speed, 1: normal, 0: paused; below 0 counts as paused."""
        self._position_s, self._at_s = self._expected_s(now_s), now_s
        self._declared = self._speed = max(rate, 0.0)
        self._history.clear()

    def hear_time(self, sender_s: float, now_s: float) -> None:
        """Take the sender's time, in seconds, at its arrival."""
        self._heard_s = now_s
        # A repeated time of a sender with slow frames says nothing new.
        if self._history and self._history[-1][1] == sender_s:
            return
        self._interval_s = min(now_s - self._changed_s, _LOST_S[1])
        is_first = self._changed_s == -np.inf
        self._changed_s = now_s
        expected_s = self._expected_s(now_s)
        self._history.append((now_s, sender_s))
        while now_s - self._history[0][0] > _HISTORY_S:
            self._history.popleft()
        difference_s = sender_s - expected_s
        self._at_s = now_s
        if is_first or abs(difference_s) > JUMP_S:
            self._position_s = sender_s
            if is_first or not self._fit(4, 0.1):
                self._history = deque([(now_s, sender_s)])
                self._silent_until_s = now_s if is_first else now_s + FADE_S
            return
        self._position_s = expected_s + (_EARLY if difference_s > 0.0 else _LATE) * difference_s
        self._fit(8, _FITTED_S)

    def position_s(self, now_s: float) -> float | None:
        """Sender's time; None while it is paused, has just jumped, or is lost."""
        lost_s = float(np.clip(3.0 * self._interval_s, *_LOST_S))
        still_s = max(_STILL_S, min(3.0 * self._interval_s, lost_s))
        if (
            now_s - self._heard_s > lost_s
            or (now_s - self._changed_s > still_s and self._heard_s > self._changed_s)
            or not self._speed
            or now_s < self._silent_until_s
        ):
            return None
        return self._expected_s(now_s)

    def _expected_s(self, now_s: float) -> float:
        return self._position_s + self._speed * (now_s - self._at_s)

    def _fit(self, count: int, shortest_s: float) -> bool:
        """Set the speed by a line through the history, unless the sender declares it; False for a
        short history, one that is no line, and a line that runs backward."""
        local, sender = np.array(self._history).T
        if self._declared is not None or len(local) < count or np.ptp(local) < shortest_s:
            return False
        middle = local.mean()
        slope, height = np.polyfit(local - middle, sender, 1)
        residuals = sender - (slope * (local - middle) + height)
        if slope <= 0.0 or np.abs(residuals).max() > _LINE_S:
            return False
        self._speed = 1.0 if abs(slope - 1.0) < _NORMAL else float(slope)
        return True


class MidiTimeCode:
    """Decoder of MIDI time code: quarter frames, and full frames after a jump."""

    _FRAMES = (24.0, 25.0, 30000.0 / 1001.0, 30.0)  # the third is drop-frame

    def __init__(self) -> None:
        self._pieces = [0] * 8
        self._next = 0

    def seconds(self, message: bytes) -> float | None:
        """Time of a MIDI message at its arrival, seconds; None for other messages, and until all
        eight quarter frames have come in their order."""
        if len(message) == 10 and message[:2] == b"\xf0\x7f" and message[3:5] == b"\x01\x01":
            self._next = 0
            return self._time(message[5], message[6], message[7], message[8])
        if len(message) != 2 or message[0] != 0xF1:
            return None
        piece, value = message[1] >> 4, message[1] & 15
        if piece != self._next:
            self._next = 0
            if piece:
                return None
        self._pieces[piece] = value
        self._next = (piece + 1) % 8
        if piece != 7:
            return None
        low, high = self._pieces[::2], self._pieces[1::2]
        frames, seconds, minutes, hours = (a | b << 4 for a, b in zip(low, high, strict=True))
        # The code is the time of the first piece; the eighth comes 7/4 frames later.
        return self._time(hours, minutes, seconds, frames & 31, 1.75)

    def _time(
        self, hours: int, minutes: int, seconds: int, frames: int, later: float = 0.0
    ) -> float | None:
        """Seconds of a time code, ``later`` frames later; bits 5 and 6 of ``hours`` are the rate.
        None for numbers out of range."""
        kind, hours = hours >> 5 & 3, hours & 31
        rate = self._FRAMES[kind]
        nominal = round(rate)
        if hours > 23 or minutes > 59 or seconds > 59 or frames >= nominal:
            return None
        count = ((hours * 60 + minutes) * 60 + seconds) * nominal + frames
        if kind == 2:  # the first two frames of each minute are left out, but of each tenth
            total = hours * 60 + minutes
            count -= 2 * (total - total // 10)
        return (count + later) / rate


class FollowedClock:
    """Clock of another program: ``/time`` and ``/rate`` by OSC, or MIDI time code.

    ``source``: a UDP port, or ``midi:NAME`` with a part of the name of a MIDI input.
    ``address``: own address of the UDP port.

    Raises UsageError: the port cannot be opened, or ``python-rtmidi`` is missing.
    """

    def __init__(self, source: str, address: str = "127.0.0.1") -> None:
        self._follower = ClockFollower()
        self._receiver: OscReceiver | None = None
        self._input: Any = None
        self._code = MidiTimeCode()
        kind, _, name = source.partition(":")
        if kind == "midi":
            self._input = _midi_input(name)
            self.name = f"MIDI time code of '{name}'"
        elif source.isdecimal():
            self._receiver = OscReceiver(address, int(source), is_used=is_used)
            self.name = f"{address}:{self._receiver.port}"
        else:
            raise UsageError(f"--follow '{source[:60]}': expected a UDP port, or midi:NAME")

    def __call__(self) -> float | None:
        """Sender's time now, seconds; None while there is none."""
        for received in self._receiver.take() if self._receiver is not None else ():
            change = change_of(received.message)
            if change is not None and change.parameter == "time" and change.target == "time":
                self._follower.hear_time(change.value, received.arrived_s)
            elif change is not None and change.target == "time":
                self._follower.hear_rate(change.value, received.arrived_s)
        while self._input is not None and (message := self._input.get_message()):
            seconds = self._code.seconds(bytes(message[0]))
            if seconds is not None:
                self._follower.hear_time(seconds, time.monotonic())
        return self._follower.position_s(time.monotonic())

    def close(self) -> None:
        """Close the port."""
        if self._receiver is not None:
            self._receiver.close()
        if self._input is not None:
            self._input.close_port()


def _midi_input(name: str) -> Any:
    """Open the first MIDI input with a part of a name; UsageError without one."""
    try:
        import rtmidi
    except ImportError:
        raise UsageError("--follow midi: install 'hfx-blender[midi]' with pip first") from None
    midi = rtmidi.MidiIn()
    names = midi.get_ports()
    fitting = [k for k, known in enumerate(names) if name.lower() in known.lower()]
    if not fitting:
        raise UsageError(f"--follow midi:{name}: no such input; there are: {', '.join(names)}")
    midi.open_port(fitting[0])
    midi.ignore_types(timing=False, sysex=False)  # rtmidi drops time code otherwise
    return midi
