# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages: exact round trips, and refusal of malformed bytes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.devices.workers.message_bodies import (
    decode_arrays,
    decode_values,
    encode_arrays,
    encode_values,
)
from hfx_blender.processes.messages import (
    MAX_BODY,
    Message,
    MessageError,
    MessageKind,
    decode_json,
    encode_json,
    message,
    read_message,
)


@given(
    st.lists(
        st.tuples(st.sampled_from(MessageKind), st.integers(0, 65535), st.binary(max_size=300)),
        max_size=5,
    )
)
def test_messages_come_out_of_a_stream_as_they_went_in(sent):
    stream = io.BytesIO(b"".join(message(*item) for item in sent))
    messages = [read_message(stream) for _ in sent]
    assert messages == [Message(*item) for item in sent]
    assert read_message(stream) is None


@given(st.binary(max_size=200))
def test_any_bytes_are_messages_or_refused(data):
    stream = io.BytesIO(data)
    try:
        while read_message(stream) is not None:
            pass
    except MessageError:
        pass


def test_a_message_that_breaks_off_is_the_end():
    whole = message(MessageKind.VALUES, 1, b"12345678")
    for length in range(len(whole)):
        assert read_message(io.BytesIO(whole[:length])) is None


def test_a_length_beyond_the_bound_is_refused_before_anything_is_read():
    head = (MAX_BODY + 1).to_bytes(4, "little") + b"\x05\x00\x00"
    with pytest.raises(MessageError, match="allowed are"):
        read_message(io.BytesIO(head))
    with pytest.raises(MessageError):
        message(MessageKind.VALUES, 0, bytes(MAX_BODY + 1))


def test_an_unknown_kind_is_refused():
    assert 200 not in list(MessageKind)
    with pytest.raises(MessageError, match="unknown kind 200"):
        read_message(io.BytesIO(b"\0\0\0\0\xc8\0\0"))


@pytest.mark.parametrize("dtype", ["<c16", "|O", "<U4", "|V8", "<f16"])
def test_arrays_are_of_few_types(dtype):
    head = encode_json({"content": {}, "arrays": [["x", dtype, [0]]]})
    with pytest.raises(MessageError, match="of type"):
        decode_arrays(len(head).to_bytes(4, "little") + head)


def test_a_partial_value_is_no_value():
    assert decode_values(encode_values([1.0, 2.5])).tolist() == [1.0, 2.5]
    assert decode_values(b"1234567").shape == (0,)


@pytest.mark.parametrize(
    "wrong",
    [
        "hello",
        ["5"] * 16,
        [True] * 16,
        [1j],
        [[1.0, 2.0]] * 8,
        {"a": 1},
        [10**400],
        [object()],
        3.0,
    ],
)
def test_malformed_values_are_no_value(wrong):
    """Malformed values decode as an empty array: a fault and silence for the device."""
    assert not len(decode_values(encode_values(wrong)))


def test_arrays_keep_their_names_types_and_shapes():
    arrays = {
        "a": np.arange(6, dtype=np.int32).reshape(2, 3),
        "b": np.zeros((0, 3), np.float32),
        "c": np.array([1.5, np.nan]),
    }
    content, actual = decode_arrays(encode_arrays({"x": [1, "y"]}, arrays))
    assert content == {"x": [1, "y"]}
    for name, array in arrays.items():
        assert actual[name].dtype == array.dtype
        assert np.array_equal(actual[name], array, equal_nan=name == "c")


@given(st.binary(max_size=120), st.integers(0, 60))
def test_damaged_arrays_are_refused(noise, offset):
    whole = bytearray(encode_arrays({"a": 1}, {"x": np.arange(3.0)}))
    whole[offset : offset + len(noise)] = noise
    try:
        decode_arrays(bytes(whole))
    except MessageError:
        pass


@pytest.mark.parametrize("body", [b"", b"[1]", b"{", b"\xff", b"[" * 100000])
def test_only_json_objects_are_accepted(body):
    with pytest.raises(MessageError):
        decode_json(body)
