# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders: exact frames written by hand, and no value outside the limits for any input."""

import numpy as np
import pytest
from bench_devices import device, heat, vibration
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.devices.host.encoders import Channels, FrameEncoder
from hfx_blender.engine.rendering.device_config import BytesEncoder, TextEncoder

PAIR = device(vibration(fixed=True), heat())  # columns: amplitude, 175 Hz, temperature


def framed(how, *values):
    return FrameEncoder(PAIR, how).frame(np.array(values, float))


def test_a_channel_is_a_control_that_can_be_set():
    assert Channels(PAIR).names == [("a0", "amplitude_m_s2"), ("a1", "temperature_c")]
    both = device(vibration(), heat())
    assert [name for _, name in Channels(both).names][1] == "frequency_hz"
    assert [name for _, name in Channels(both, strengths_only=True).names] == [
        "amplitude_m_s2",
        "temperature_c",
    ]


@pytest.mark.parametrize(
    ("how", "expected"),
    [  # 5 of 0..10 is half, 29 of 14..44 is half; 0.5 * 255 = 127.5 rounds to even
        (BytesEncoder(b"", "u8", 255, "none", b"", None), "8080"),
        (BytesEncoder(b"\xaa", "u8", 100, "none", b"\n", None), "aa32320a"),
        (BytesEncoder(b"", "u16be", 1000, "none", b"", None), "01f401f4"),
        (BytesEncoder(b"", "u16le", 1000, "none", b"", None), "f401f401"),
        (BytesEncoder(b"\xaa", "u8", 100, "xor", b"", None), "aa323200"),
        (BytesEncoder(b"\xaa", "u8", 100, "sum", b"", None), "aa323264"),
        (TextEncoder("S ", ",", 1000, None), b"S 500,500\n".hex()),
    ],
)
def test_frames_are_these_bytes(how, expected):
    assert framed(how, 5, 175, 29).hex() == expected


def test_stop_is_the_configured_bytes_or_the_neutral_frame():
    plain = BytesEncoder(b"\xaa", "u8", 100, "none", b"", None)
    assert FrameEncoder(PAIR, plain).stop.hex() == "aa0032"  # heat is silent at 29 of 14..44
    own = BytesEncoder(b"\xaa", "u8", 100, "none", b"", b"\xff\x00")
    assert FrameEncoder(PAIR, own).stop == b"\xff\x00"
    assert FrameEncoder(PAIR, TextEncoder("", " ", 100, "X")).stop == b"X\n"
    assert FrameEncoder(PAIR, TextEncoder("", " ", 100, None)).stop == b"0 50\n"


def test_limits_hold_in_the_bytes():
    weak = device(vibration(maximum=10.0, highest=4.0, fixed=True))
    encoder = FrameEncoder(weak, BytesEncoder(b"", "u8", 100, "none", b"", None))
    assert encoder.frame(np.array([9.0, 175.0])) == bytes([40])


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=3, max_size=3))
def test_nothing_leaves_the_limits(values):
    motor, element = framed(BytesEncoder(b"", "u8", 240, "none", b"", None), *values)
    assert 0 <= motor <= 240
    assert 8 <= element <= 208  # 15..40 of 14..44
    if not np.isfinite(values[0]):
        assert motor == 0
    if not np.isfinite(values[2]):
        assert element == 120


def test_the_wrong_number_of_values_is_refused():
    with pytest.raises(ValueError, match=r"expected \(3,\)"):
        framed(BytesEncoder(b"", "u8", 255, "none", b"", None), 1, 2)
