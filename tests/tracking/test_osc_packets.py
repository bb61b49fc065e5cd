# SPDX-License-Identifier: GPL-3.0-or-later
"""OSC datagrams of python-osc's builders are decoded; damaged and hostile ones are ignored."""

from __future__ import annotations

import random
import struct

import pytest
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage as TheirMessage
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.tracking.osc_packets import MAX_DATAGRAM, MAX_MESSAGES, OscMessage, decode


def encoded(address: str, *arguments: tuple[object, str]) -> TheirMessage:
    builder = OscMessageBuilder(address)
    for value, kind in arguments:
        builder.add_arg(value, kind)
    return builder.build()


def bundled(*contents: TheirMessage | OscBundle) -> OscBundle:
    builder = OscBundleBuilder(IMMEDIATELY)
    for content in contents:
        builder.add_content(content)
    return builder.build()


EVERY_TYPE = encoded(
    "/every/type",
    (-7, "i"),
    (0.5, "f"),
    ("größe", "s"),
    (b"\1\2\3\4\5", "b"),
    (True, "T"),
    (False, "F"),
    (0.1, "d"),
    (-(2**40), "h"),
)


def test_every_argument_type_of_python_osc_is_decoded() -> None:
    expected = (-7, 0.5, "größe", b"\1\2\3\4\5", True, False, 0.1, -(2**40))
    assert decode(EVERY_TYPE.dgram) == ([OscMessage("/every/type", expected)], 0)


def test_a_message_written_by_hand() -> None:
    # The example of the OSC 1.0 specification: /oscillator/4/frequency with 440.0.
    datagram = bytes.fromhex("2f6f7363696c6c61746f722f342f6672657175656e6379002c66000043dc0000")
    assert decode(datagram) == ([OscMessage("/oscillator/4/frequency", (440.0,))], 0)


def test_bundles_within_bundles_keep_the_order() -> None:
    first, second, third = (encoded(f"/m/{k}", (k, "i")) for k in (1, 2, 3))
    decoded = decode(bundled(first, bundled(second), third).dgram)
    assert [message.arguments[0] for message in decoded.messages] == [1, 2, 3]
    assert decoded.ignored == 0


def test_bundles_beyond_the_fourth_level_are_ignored() -> None:
    bundle = bundled(encoded("/deep", (1, "i")))
    for _ in range(3):
        bundle = bundled(bundle)
    assert len(decode(bundle.dgram).messages) == 1
    assert decode(bundled(bundle).dgram) == ([], 1)


def test_an_invalid_message_leaves_the_rest_of_its_bundle() -> None:
    good = encoded("/good", (1, "i")).dgram
    bad = b"/bad\0\0\0\0,x\0\0"  # no argument type of OSC 1.0
    elements = b"".join(struct.pack(">i", len(part)) + part for part in (bad, good))
    assert decode(b"#bundle\0" + bytes(8) + elements) == ([OscMessage("/good", (1,))], 1)


def test_at_most_256_messages_of_a_datagram_count() -> None:
    datagram = bundled(*[encoded("/m", (k, "i")) for k in range(300)]).dgram
    decoded = decode(datagram)
    assert len(decoded.messages) == MAX_MESSAGES and decoded.ignored >= 1


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"/",
        b"no/slash\0\0\0\0,\0\0\0",
        b"/no/types\0\0\0",
        b"/cut\0\0\0\0,f\0\0\0\0",
        b"/long\0\0\0,i\0\0\0\0\0\1\0\0\0\2",
        b"/blob\0\0\0,b\0\0\x7f\xff\xff\xff",
        b"/blob\0\0\0,b\0\0\xff\xff\xff\xff",
        b"/\xff\xfe\0,\0\0\0",
        b"/hfx/*\0\0,i\0\0\0\0\0\1",
        b"/hfx/[a]\0\0\0\0,i\0\0\0\0\0\1",
        b"/many\0\0\0," + b"T" * 63 + bytes(4),
        b"#bundle\0",
        b"#bundle\0" + bytes(8) + b"\0\0\0\3abc",
        b"#bundle\0" + bytes(8) + b"\xff\xff\xff\xf0" + bytes(16),
        b"#bundle\0" + bytes(8) + b"\0\0\0\0",
        b"#bundle\0" + bytes(8) + b"\0",
        bytes(MAX_DATAGRAM + 4),
    ],
)
def test_damaged_datagrams_are_ignored_and_counted(datagram: bytes) -> None:
    messages, ignored = decode(datagram)
    assert messages == [] and ignored >= 1


def test_unused_addresses_are_skipped_without_a_count() -> None:
    datagram = bundled(encoded("/a", (1, "i")), encoded("/b", (2, "i"))).dgram
    assert decode(datagram, "/b".__eq__) == ([OscMessage("/b", (2,))], 0)


def test_mutated_datagrams_never_raise() -> None:
    # The small brother of tests/manual/fuzz/fuzz_osc.py.
    generator = random.Random(45)
    seeds = [EVERY_TYPE.dgram, bundled(EVERY_TYPE, bundled(EVERY_TYPE)).dgram]
    for _ in range(5000):
        datagram = bytearray(generator.choice(seeds))
        for _ in range(generator.randint(1, 6)):
            datagram[generator.randrange(len(datagram))] = generator.randrange(256)
        decoded = decode(bytes(datagram[: generator.randint(0, len(datagram))]))
        assert len(decoded.messages) <= MAX_MESSAGES
