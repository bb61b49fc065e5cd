# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a board with this project's firmware, and the frames of its protocol as bytes.

A frame (docs/wire-protocol.md) is ``version, type, sequence (2), payload, CRC-32 (4)``,
little-endian, then COBS (Cheshire and Baker, IEEE/ACM Transactions on Networking 1999), then a
zero byte.
"""

import math
import secrets
import struct
import time
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import DEAD_MAN_MS, DeviceConfig
from ..host.encoders import Channels
from ..host.output import OutputLostError, shown
from .serial_port import STOPS, SerialPort

VERSION: Final = 1
MAX_FRAME: Final = 96  # longest encoded frame, bytes
FULL_SCALE: Final = 0xFFFF  # level of an actuator's maximum
_HEAD: Final = struct.Struct("<BBH")
_CRC: Final = struct.Struct("<I")
_CONFIGURE: Final = struct.Struct("<IBHI")  # session, channels, dead-man ms, maximum on ms
_REST: Final = struct.Struct("<I")  # rest ms; optional, by default the board's own
_VALUES: Final = struct.Struct("<IH")  # CRC of the configuration, time to live ms
_READY: Final = struct.Struct("<IB")  # CRC of the configuration, channels

START_S: Final = 5.0
"""Time limit for the first answer, seconds: opening the port restarts an Arduino Uno, and the boot
loader takes two seconds."""

ANSWER_S: Final = 0.5  # time limit for later answers to a configuration, seconds
_RETRY_S: Final = 0.1
_MOST_NOISE: Final = 100


class FrameKind(IntEnum):
    """Kind of a frame; the highest bit marks replies of the board."""

    CONFIGURE = 0x01
    VALUES = 0x02
    STOP = 0x03
    READY = 0x81
    STOPPED = 0x83


class Reason(IntEnum):
    """Reason of a board's silence, the only byte of STOPPED."""

    ASKED = 0
    NO_VALUES = 1
    REFUSED = 2  # values before a configuration, or for another configuration


@dataclass(frozen=True)
class Frame:
    """Received frame with a valid CRC."""

    kind: int
    sequence: int
    payload: bytes


def encode_cobs(content: bytes) -> bytes:
    """Encode content by COBS, without zero bytes; longer by a byte for each 254 bytes begun."""
    encoded = bytearray()
    for piece in content.split(b"\0"):
        while len(piece) >= 254:  # no zero is implied after a full block
            encoded.append(255)
            encoded += piece[:254]
            piece = piece[254:]
        encoded.append(len(piece) + 1)
        encoded += piece
    return bytes(encoded)


def decode_cobs(content: bytes) -> bytes | None:
    """Decode COBS without the final zero; None if empty, with a zero byte or a cut-off block."""
    decoded = bytearray()
    at = 0
    while at < len(content):
        length = content[at]
        if length == 0 or at + length > len(content):
            return None
        block = content[at + 1 : at + length]
        if 0 in block:
            return None
        decoded += block
        at += length
        # A zero ends all blocks except full blocks and the last block.
        if length < 255 and at < len(content):
            decoded.append(0)
    return bytes(decoded) if content else None


def encode_frame(kind: int, sequence: int, payload: bytes = b"") -> bytes:
    """Encode a frame between two zeros; the first zero ends a frame that was cut off before."""
    content = _HEAD.pack(VERSION, kind, sequence & 0xFFFF) + payload
    return b"\0" + encode_cobs(content + _CRC.pack(zlib.crc32(content))) + b"\0"


def encode_configuration(
    session: int, channels: int, maximum_on_ms: int, rest_ms: int = 0
) -> bytes:
    """Payload of CONFIGURE; values refer to the CRC-32 of this payload.

    ``session``: number of 32 bits, different for each configuration sent.
    ``channels``: 1 to 32.
    ``maximum_on_ms``, ``rest_ms``: longest time on and following rest; 0: the board's own.
    """
    longest = min(maximum_on_ms, 0xFFFFFFFF)
    payload = _CONFIGURE.pack(session, channels, DEAD_MAN_MS, longest)
    return payload + _REST.pack(min(rest_ms, 0xFFFFFFFF)) if rest_ms else payload


def encode_values(
    configuration_crc: int, levels: Sequence[int], live_ms: int = DEAD_MAN_MS
) -> bytes:
    """Payload of VALUES: levels 0..65535 of all channels, valid for ``live_ms`` after arrival."""
    return _VALUES.pack(configuration_crc, live_ms) + struct.pack(f"<{len(levels)}H", *levels)


class Receiver:
    """Decoder of a stream of bytes; anything but intact frames is dropped."""

    def __init__(self) -> None:
        self.unfinished = bytearray()
        self._is_skipping = False

    def take(self, content: bytes) -> list[Frame]:
        """Append received bytes; return intact frames in order. Text before a zero of more than
        :data:`MAX_FRAME` bytes, and damaged frames, are dropped."""
        frames = []
        for byte in content:
            if byte == 0:
                frame = None if self._is_skipping else decode_frame(bytes(self.unfinished))
                if frame is not None:
                    frames.append(frame)
                self.unfinished.clear()
                self._is_skipping = False
            elif len(self.unfinished) >= MAX_FRAME:  # noise: skip to the next zero
                self._is_skipping = True
            else:
                self.unfinished.append(byte)
        return frames


def decode_frame(content: bytes) -> Frame | None:
    """Decode a frame without the zeros; None for another version or a damaged frame."""
    plain = decode_cobs(content)
    if plain is None or len(plain) < _HEAD.size + _CRC.size:
        return None
    # The CRC-32 covers everything before it.
    body, (crc,) = plain[: -_CRC.size], _CRC.unpack(plain[-_CRC.size :])
    version, kind, sequence = _HEAD.unpack(body[: _HEAD.size])
    if version != VERSION or zlib.crc32(body) != crc:
        return None
    return Frame(kind, sequence, body[_HEAD.size :])


class WireBoard:
    """Output to a board with this project's firmware; waits for the answer of the board.

    ``port``: open port, closed by :meth:`close`.

    Raises OutputLostError: the board does not answer, or has too few channels for the device.
    """

    def __init__(self, device: DeviceConfig, port: SerialPort) -> None:
        self._name, self._port = port.name, port
        self._receiver = Receiver()
        self._sequence = 0
        self._is_ready = False
        self._is_stopped = True
        try:
            self._channels = Channels(device, strengths_only=True)
            self._time_limits_ms = _time_limits_ms(device)
            self._begin(START_S)
            # A board that restarts drops the first configurations, so it gets one every 0.1 s.
            while not self._is_ready:
                time.sleep(0.005)
                self._listen()
                self._request_again()
        except BaseException:
            port.close()
            raise

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
        levels = self._channels.whole(self._channels.values(values), FULL_SCALE)
        payload = encode_values(self._crc, levels.tolist())
        self._port.write_newest(self._frame(FrameKind.VALUES, payload))

    def stop(self) -> None:
        """Send three stops in place of unsent frames; the board then ignores values until
        configured. Never raises OutputLostError."""
        self._is_stopped, self._is_ready = True, False
        with suppress(OutputLostError):
            frames = [self._frame(FrameKind.STOP) for _ in range(STOPS)]
            self._port.write_first(b"".join(frames))

    def close(self) -> None:
        """Close the port without a stop; may be called again."""
        self._port.close()

    def _begin(self, patience_s: float) -> None:
        """Start a new session, with a time limit for the answer. The session's random number
        changes the CRC of the configuration, and the board ignores values with the CRC of an
        earlier session."""
        self._configuration = encode_configuration(
            secrets.randbits(32), len(self._channels), *self._time_limits_ms
        )
        # READY and VALUES carry this CRC, so frames of two sessions cannot be confused.
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
            self._port.write_newest(self._frame(FrameKind.CONFIGURE, self._configuration))

    def _listen(self) -> None:
        """Process received frames: READY of the present session, and STOPPED of a ready board.
        Other bytes are kept for a message, 100 at most. OutputLostError for STOPPED, or if the
        board has fewer channels than the device."""
        content = self._port.read()
        frames = self._receiver.take(content)
        text = content.decode("ascii", "backslashreplace")
        self._noise = "" if frames else (self._noise + text)[:_MOST_NOISE]
        for frame in frames:
            if frame.kind == FrameKind.READY:
                is_whole = len(frame.payload) == _READY.size
                crc, channels = _READY.unpack(frame.payload) if is_whole else (None, 0)
                # The CRC of the configuration identifies the session: answers to earlier sessions
                # are ignored.
                if crc != self._crc:
                    continue
                if channels < len(self._channels):
                    raise OutputLostError(
                        f"The board at {self._name} has {channels} channels; "
                        f"the device needs {len(self._channels)}."
                    )
                self._is_ready = True
            elif frame.kind == FrameKind.STOPPED and self._is_ready:
                if frame.payload == bytes([Reason.NO_VALUES]):
                    reported = f"it received no values for {DEAD_MAN_MS} ms"
                else:
                    reported = "it was restarted or stopped by another program"
                raise OutputLostError(f"The board at {self._name} stopped itself: {reported}.")

    def _frame(self, kind: FrameKind, payload: bytes = b"") -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return encode_frame(kind, self._sequence, payload)


def _time_limits_ms(device: DeviceConfig) -> tuple[int, int]:
    """Longest time on and following rest, for all channels of a board; 0: the board's own. The time
    on is the shortest of the device's types, and the share of time on the smallest; types without a
    limit do not count."""
    kinds = [kind for kind in device.actuator_types.values() if math.isfinite(kind.maximum_on_s)]
    if not kinds:
        return 0, 0
    longest_s = min(kind.maximum_on_s for kind in kinds)
    # The smallest share of time on is the largest ratio of rest to time on.
    rest_s = longest_s * max(kind.rest_s / kind.maximum_on_s for kind in kinds)
    return max(int(longest_s * 1000.0), 1), max(math.ceil(rest_s * 1000.0), 1)
