# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a board with this project's firmware: configuration, values, stop, reports."""

from __future__ import annotations

import math
import secrets
import time
import zlib
from contextlib import suppress
from typing import Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import DEAD_MAN_MS, DeviceConfig
from ..host import wire
from ..host.encoders import Channels
from ..host.output import OutputLostError, shown
from .serial_port import STOPS, SerialPort

START_S: Final = 5.0
"""Time limit for the first answer, seconds: opening the port restarts an Arduino Uno, and the boot
loader takes two seconds."""

ANSWER_S: Final = 0.5
"""Time limit for later answers to a configuration, seconds."""

_RETRY_S: Final = 0.1
_MOST_NOISE: Final = 100


class WireBoard:
    """Output to a board with this project's firmware; waits for the answer of the board.

    ``port``: open port, closed by :meth:`close`.

    Raises OutputLostError: the board does not answer, or has too few channels for the device.
    """

    def __init__(self, device: DeviceConfig, port: SerialPort) -> None:
        self._name, self._port = port.name, port
        try:
            self._open(device)
        except BaseException:
            port.close()
            raise

    def _open(self, device: DeviceConfig) -> None:
        self._channels = Channels(device, strengths_only=True)
        self._time_limits_ms = _time_limits_ms(device)
        self._receiver = wire.Receiver()
        self._sequence = 0
        self._is_ready = False
        self._is_stopped = True
        self._begin(START_S)
        while not self._is_ready:
            time.sleep(0.005)
            self._listen()
            self._request_again()

    def send(self, values: F64) -> None:
        """Send values (columns,).

        A stopped board is configured again first; values are dropped until the answer.
        """
        if self._is_stopped:
            self._begin(ANSWER_S)
        self._listen()
        if not self._is_ready:
            self._request_again()
            return
        levels = self._channels.whole(self._channels.values(values), wire.FULL_SCALE)
        payload = wire.encode_values(self._crc, levels.tolist())
        self._port.write_newest(self._frame(wire.FrameKind.VALUES, payload))

    def stop(self) -> None:
        """Send stops ahead of unsent frames; the board then ignores values until configured."""
        self._is_stopped, self._is_ready = True, False
        with suppress(OutputLostError):
            frames = [self._frame(wire.FrameKind.STOP) for _ in range(STOPS)]
            self._port.write_first(b"".join(frames))

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _begin(self, patience_s: float) -> None:
        """Start a new session, with a time limit for the answer. The session's random number
        changes the CRC of the configuration, and the board ignores values with the CRC of an
        earlier session.
        """
        self._configuration = wire.encode_configuration(
            secrets.randbits(32), len(self._channels), *self._time_limits_ms
        )
        self._crc = zlib.crc32(self._configuration)
        self._is_stopped, self._is_ready = False, False
        self._patience_ends_s = time.monotonic() + patience_s
        self._asked_s = -math.inf
        self._noise = ""  # text other than frames, since the session began
        self._request_again()

    def _request_again(self) -> None:
        """Send the configuration every 0.1 s; OutputLostError without an answer in time."""
        now = time.monotonic()
        if now > self._patience_ends_s:
            sent = f" It sends {shown(self._noise)}." if self._noise else ""
            raise OutputLostError(
                f"The board at {self._name} does not answer.{sent} Expected are frames of HFX's "
                "firmware: does the board run it?"
            )
        if now >= self._asked_s + _RETRY_S:
            self._asked_s = now
            self._port.write_newest(self._frame(wire.FrameKind.CONFIGURE, self._configuration))

    def _listen(self) -> None:
        """Process received frames: READY, and STOPPED of a ready board, which raises
        OutputLostError. Other bytes are kept for a message, 100 at most.
        """
        content = self._port.read()
        frames = self._receiver.take(content)
        text = content.decode("ascii", "backslashreplace")
        self._noise = "" if frames else (self._noise + text)[:_MOST_NOISE]
        for frame in frames:
            if frame.kind == wire.FrameKind.READY:
                self._check_ready(frame.payload)
            elif frame.kind == wire.FrameKind.STOPPED and self._is_ready:
                if wire.decode_stopped(frame.payload) == wire.Reason.NO_VALUES:
                    reported = f"it received no values for {DEAD_MAN_MS} ms"
                else:
                    reported = "it was restarted or stopped by another program"
                raise OutputLostError(f"The board at {self._name} stopped itself: {reported}.")

    def _check_ready(self, payload: bytes) -> None:
        reported = wire.decode_ready(payload)
        # The CRC of the configuration identifies the session.
        if reported is None or reported[0] != self._crc:
            return  # of an earlier session
        if reported[1] < len(self._channels):
            raise OutputLostError(
                f"The board at {self._name} has {reported[1]} channels; "
                f"the device needs {len(self._channels)}."
            )
        self._is_ready = True

    def _frame(self, kind: wire.FrameKind, payload: bytes = b"") -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return wire.encode_frame(kind, self._sequence, payload)


def _time_limits_ms(device: DeviceConfig) -> tuple[int, int]:
    """Longest time on and following rest, for all channels of a board; 0: the board's own. The time
    on is the shortest of the device's types, and the share of time on the smallest; types without a
    limit do not count.
    """
    kinds = [kind for kind in device.actuator_types.values() if math.isfinite(kind.maximum_on_s)]
    if not kinds:
        return 0, 0
    longest_s = min(kind.maximum_on_s for kind in kinds)
    rest_s = longest_s * max(kind.rest_s / kind.maximum_on_s for kind in kinds)
    return max(int(longest_s * 1000.0), 1), max(math.ceil(rest_s * 1000.0), 1)
