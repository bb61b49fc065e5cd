# SPDX-License-Identifier: GPL-3.0-or-later
"""Serial ports, through pseudo-terminals: stalls, garbage, vanishing, double opening."""

import os
import time

import numpy as np
import pytest
from bench_devices import device, vibration

from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports.serial_port import SerialPort, is_port_name
from hfx_blender.engine.rendering.device_config import (
    BytesEncoder,
    OutputConfig,
    SerialTransport,
)

pytest.importorskip("serial")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

FRAMES = BytesEncoder(b"\xaa\x55", "u8", 200, "none", b"", b"\xaa\x55\xff")
MOTOR = device(vibration(fixed=True), outputs=(OutputConfig(FRAMES, SerialTransport(115200)),))
STOPS = b"\xaa\x55\xff" * 3


def values(share):
    return np.array([10.0 * share, 175.0])


def opened(terminal):
    return open_output(MOTOR, {"kind": "serial", "port": terminal.name})


def test_values_and_stops_arrive_as_bytes(terminal):
    output = opened(terminal)
    output.send(values(0.5))
    assert terminal.read(least=3) == b"\xaa\x55\x64"
    output.stop()
    assert terminal.read(least=9) == STOPS
    output.close()
    output.close()
    output.stop()  # never raises


@pytest.mark.parametrize(
    "name",
    [
        "",
        "/etc/passwd",
        "/dev/null",
        "/dev/ttyS0/../null",
        "/dev/serial/by-id/../../null",
        "/dev/sda",
        "spy:///dev/ttyS0?file=/tmp/x",
        "socket://localhost:1",
        "loop://",
        "COM0",
        "COM1\n",
        "/dev/tty",
        None,
    ],
)
def test_an_invalid_port_name_is_refused(name):
    assert not is_port_name(str(name))
    with pytest.raises(OutputLostError, match="not a serial port"):
        open_output(MOTOR, {"kind": "serial", "port": name})


@pytest.mark.parametrize(
    "name",
    ["COM3", "COM12", "/dev/ttyACM0", "/dev/cu.usbmodem1", "/dev/serial/by-id/usb-Arduino-if00"],
)
def test_names_of_ports_are_known(name):
    assert is_port_name(name)


def test_a_port_opens_once_and_again_after_closing(terminal):
    output = opened(terminal)
    with pytest.raises(OutputLostError, match="open already"):
        opened(terminal)
    output.close()
    opened(terminal).close()


def test_a_port_that_is_not_there_says_so():
    with pytest.raises(OutputLostError, match="not there"):
        open_output(MOTOR, {"kind": "serial", "port": "/dev/ttyHFX_missing"})


def test_a_stalled_port_costs_no_time_and_stop_overtakes_the_queue(terminal):
    output = opened(terminal)
    began = time.monotonic()
    for _ in range(8_000):  # 24 kB, more than a terminal holds
        output.send(values(1.0))
    assert time.monotonic() - began < 5.0  # no wait for the reader, as no reader exists
    output.stop()
    content = terminal.read(wait_s=0.1, least=1 << 20)
    assert content.endswith(STOPS)
    assert len(content) < 12_000
    output.send(values(0.25))
    assert terminal.read(least=3) == b"\xaa\x55\x32"


def test_a_frame_is_finished_before_the_newest_one_follows(terminal):
    port = SerialPort(terminal.name, 115200)
    frames = [bytes([i]) * 1000 for i in range(1, 60)]
    for frame in frames:
        port.write_newest(frame)
    content = terminal.read(wait_s=0.1, least=1 << 20)
    port.write_newest(b"Z")
    content += terminal.read(wait_s=0.1, least=1 << 20)
    assert content.endswith(b"Z")
    body = content[:-1]
    assert all(body.count(byte) in (0, 1000) for byte in {bytes([b]) for b in body})
    port.close()


def test_a_port_that_vanishes_is_lost_not_a_crash(terminal):
    output = opened(terminal)
    terminal.vanish()
    with pytest.raises(OutputLostError, match="is lost"):
        for _ in range(3):
            output.send(values(1.0))
    output.stop()
    output.close()


def test_garbage_from_a_board_does_no_harm(terminal):
    output = opened(terminal)
    for _ in range(50):
        os.write(terminal.master, os.urandom(200))
        output.send(values(0.5))
    assert terminal.read(least=150) == b"\xaa\x55\x64" * 50


@pytest.mark.parametrize("kind", ["udp", "websocket", "spy", None, 3])
def test_a_device_is_not_connected_by_another_way(kind):
    with pytest.raises(OutputLostError):
        open_output(MOTOR, {"kind": kind, "port": 9000})
