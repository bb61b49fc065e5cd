# SPDX-License-Identifier: GPL-3.0-or-later
"""OSC over UDP, read as the specification of OSC 1.0 says."""

import socket
import struct

import numpy as np
import pytest
from bench_devices import device, heat, vibration

from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports.osc import MAX_DATAGRAM, bundles, message
from hfx_blender.engine.rendering.device_config import OscEncoder, OutputConfig, UdpTransport


def read(content):
    """Return addresses and float32 values of a message, or of a bundle due at once.

    Written from Wright, "The Open Sound Control 1.0 Specification" (2002), without python-osc, the
    library under test.
    """
    if content.startswith(b"#bundle\0"):
        assert content[8:16] == bytes(7) + b"\1"  # "immediately"
        actual, at = [], 16
        while at < len(content):
            size = int.from_bytes(content[at : at + 4], "big")
            actual += read(content[at + 4 : at + 4 + size])
            at += 4 + size
        assert at == len(content)
        return actual
    address, at = read_string(content, 0)
    types, at = read_string(content, at)
    assert types == ",f" and len(content) == at + 4 and len(content) % 4 == 0
    return [(address, list(struct.unpack(">f", content[at:])))]


def read_string(content, at):
    """Return a text ended by 1 to 4 zeros, up to a multiple of 4 bytes, and the offset after the
    zeros.
    """
    end = content.index(b"\0", at)
    after = at + (end - at) // 4 * 4 + 4
    assert content[end:after] == bytes(after - end)
    return content[at:end].decode("ascii"), after


@pytest.fixture
def listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60.0)
        yield receiver


def opened(listener, how, *types, **facts):
    output = OutputConfig(how, UdpTransport("127.0.0.1", listener.getsockname()[1]))
    return open_output(device(*types, outputs=(output,), **facts), {"kind": "udp"})


def received(listener, datagrams=1):
    packets = []
    for _ in range(datagrams):
        packets += read(listener.recv(65536))
    return packets


def test_a_message_is_these_bytes():  # after the examples of the specification
    assert message("/oscillator/4/frequency", 440.0).hex() == (
        "2f6f7363696c6c61746f722f342f6672657175656e637900" + "2c660000" + "43dc0000"
    )


@pytest.mark.parametrize("name", ["/a", "/ab", "/abc", "/abcd"])
def test_addresses_of_any_length_end_with_one_to_four_zeros(name):
    zeros = 4 - len(name) % 4
    assert message(name, -1.5) == name.encode() + bytes(zeros) + b",f\0\0" + b"\xbf\xc0\0\0"


def test_a_bundle_is_these_bytes():
    first, second = message("/a", 1.0), message("/abcd", 1.0)
    assert bundles([first, second]) == [
        b"#bundle\0" + bytes(7) + b"\1" + b"\0\0\0\x0c" + first + b"\0\0\0\x10" + second
    ]


def test_own_addresses_carry_each_control(listener):
    how = OscEncoder(("/hfx/{device}/{actuator}/{control}",), False, True)
    output = opened(listener, how, vibration(), heat())
    output.send(np.array([2.5, 80.0, 33.0]))
    assert received(listener) == [
        ("/hfx/bench/a0/amplitude_m_s2", [2.5]),
        ("/hfx/bench/a0/frequency_hz", [80.0]),
        ("/hfx/bench/a1/temperature_c", [33.0]),
    ]
    output.close()


def test_vrchat_parameters_are_fractions_counted_from_1(listener):
    how = OscEncoder(("/avatar/parameters/bHapticsOSC_Arm_{Side}_{number}",), True, False)
    output = opened(listener, how, *[vibration(fixed=True)] * 2, side="left")
    output.send(np.array([2.5, 175.0, 99.0, 175.0]))
    assert received(listener, 2) == [
        ("/avatar/parameters/bHapticsOSC_Arm_Left_1", [0.25]),
        ("/avatar/parameters/bHapticsOSC_Arm_Left_2", [1.0]),
    ]
    output.close()


def test_stop_is_silence_three_times(listener):
    output = opened(listener, OscEncoder(("/{actuator}",), False, True), heat())
    output.stop()
    assert received(listener, 3) == [("/a0", [29.0])] * 3
    output.close()


def test_a_large_device_goes_in_datagrams_that_pass_a_network(listener):
    count = 200
    how = OscEncoder(("/hfx/{device}/{actuator}",), True, True)
    output = opened(listener, how, *[vibration(fixed=True)] * count)
    output.send(np.tile([5.0, 175.0], count))
    actual = {}
    while len(actual) < count:
        content = listener.recv(65536)
        assert len(content) <= MAX_DATAGRAM
        actual.update(read(content))
    assert actual == {f"/hfx/bench/a{i}": [0.5] for i in range(count)}
    output.close()


def test_a_missing_listener_is_no_fault_and_a_closed_socket_is_lost(listener):
    output = opened(listener, OscEncoder(("/{actuator}",), True, True), heat())
    port = listener.getsockname()[1]
    listener.close()
    for _ in range(5):
        output.send(np.array([29.0]))
    output.close()
    with pytest.raises(OutputLostError, match=f"127.0.0.1:{port}: a datagram cannot be sent"):
        output.send(np.array([29.0]))
    output.stop()


@pytest.mark.parametrize(
    "target",
    [
        {"host": "8.8.8.8"},
        {"host": "example.com"},
        {"host": None},
        {"port": 0},
        {"port": "9000"},
        {"port": True},
    ],
)
def test_a_target_outside_the_private_network_is_refused(listener, target):
    output = OutputConfig(OscEncoder(("/a",), True, True), UdpTransport("127.0.0.1", 9000))
    with pytest.raises(OutputLostError):
        open_output(device(heat(), outputs=(output,)), {"kind": "udp", **target})
