# SPDX-License-Identifier: GPL-3.0-or-later
"""Firmware protocol as bytes."""

import zlib

from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.devices.transports import wire_board as wire


def test_cobs_of_known_examples():
    # Cheshire and Baker's rules, worked out by hand.
    assert wire.encode_cobs(b"") == b"\x01"
    assert wire.encode_cobs(b"\0") == b"\x01\x01"
    assert wire.encode_cobs(b"\0\0") == b"\x01\x01\x01"
    assert wire.encode_cobs(b"\x11\x22\0\x33") == b"\x03\x11\x22\x02\x33"
    assert wire.encode_cobs(b"\x11\0\0\0") == b"\x02\x11\x01\x01\x01"
    assert wire.encode_cobs(bytes(range(1, 254))) == b"\xfe" + bytes(range(1, 254))


@given(st.binary(max_size=700))
def test_cobs_has_no_zero_and_comes_back(content):
    stuffed = wire.encode_cobs(content)
    assert 0 not in stuffed
    assert len(stuffed) <= len(content) + 2 + len(content) // 254
    assert wire.decode_cobs(stuffed) == content


@given(st.binary(max_size=300))
def test_any_bytes_are_understood_or_dropped(content):
    wire.decode_cobs(content)
    for frame in wire.Receiver().take(content):
        assert zlib.crc32(frame.payload) >= 0


@given(st.integers(0, 255), st.integers(0, 65535), st.binary(max_size=70), st.binary(max_size=40))
def test_a_frame_is_found_behind_any_garbage(kind, sequence, payload, garbage):
    actual = wire.Receiver().take(garbage + wire.encode_frame(kind, sequence, payload))
    assert actual[-1] == wire.Frame(kind, sequence, payload)


@given(st.binary(min_size=1, max_size=70), st.data())
def test_one_changed_bit_is_a_lost_frame(payload, data):
    sent = bytearray(wire.encode_frame(wire.FrameKind.VALUES, 7, payload))
    bit = data.draw(st.integers(8, 8 * len(sent) - 9))  # not of the zeros at both ends
    sent[bit // 8] ^= 1 << bit % 8
    assert wire.Receiver().take(bytes(sent) + b"\0") == []


def test_an_overlong_frame_is_skipped_up_to_the_next_zero():
    receiver = wire.Receiver()
    stop = wire.encode_frame(wire.FrameKind.STOP, 1)
    assert receiver.take(b"\x01" * 10_000 + stop)[0].kind == wire.FrameKind.STOP
    assert len(receiver.unfinished) == 0


def test_payloads_are_these_bytes():
    assert wire.encode_configuration(0x01020304, 6, 5000).hex() == "0403020106fa0088130000"
    assert wire.encode_values(0x01020304, [0, 65535, 256], 250).hex() == "04030201fa000000ffff0001"


def test_the_largest_frame_fits():
    payload = wire.encode_values(0xFFFFFFFF, [0xFFFF] * 32)
    assert len(wire.encode_frame(wire.FrameKind.VALUES, 1, payload)) - 2 <= wire.MAX_FRAME
