# SPDX-License-Identifier: GPL-3.0-or-later
"""VRC Haptics boards, against a double written from the firmware's source (VRCH-Firmware,
``src/wifi/osc.cpp``, ``callbacks.cpp``, ``main.cpp``, ``software_defines.h``, of 2025)."""

import json
import socket
import struct
import threading
import time

import numpy as np
import pytest
from bench_devices import device, vibration

from hfx_blender.devices.host.duty_budget_store import identities
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.live import discovery
from hfx_blender.devices.transports import vrc_haptics
from hfx_blender.engine.rendering.device_config import (
    OutputConfig,
    UdpTransport,
    VrcHapticsEncoder,
)

MAC = "24:6F:28:AA:BB:CC"


def texts(content):
    """OSC texts from the start of a message, each ended by zeros up to a multiple of four."""
    while content:
        end = content.index(b"\0")
        yield content[:end].decode("ascii")
        content = content[end // 4 * 4 + 4 :]


class Board:
    """Board as its firmware behaves: the address /h is subscribed by the first /ping only, and
    motors keep their last values for ever."""

    def __init__(self, motors):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.port = self.socket.getsockname()[1]
        self.motors, self.values = [0] * motors, []
        self.pings, self.is_subscribed = [], False
        self.is_on, self.is_unplugged = True, False
        self.thread = threading.Thread(target=self.loop)
        self.thread.start()

    def loop(self):
        while self.is_on:
            try:
                content, sender = self.socket.recvfrom(2048)
            except TimeoutError:
                continue
            if self.is_unplugged:
                continue
            if content.startswith(b"/ping\0\0\0,i\0\0"):
                (port,) = struct.unpack(">i", content[12:16])
                self.pings.append(port)
                self.is_subscribed = True
                # pushInt32(RECIEVE_PORT), pushString(macAddress): 17 letters, 3 zeros.
                answer = b"/ping\0\0\0,is\0" + struct.pack(">i", self.port)
                # The answer leaves from another port of the board.
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
                    client.bind(("127.0.0.1", 0))
                    client.sendto(answer + MAC.encode() + b"\0\0\0", (sender[0], port))
            elif content.startswith(b"/h\0\0,s\0\0") and self.is_subscribed:
                (digits,) = [t for t in texts(content[8:]) if t]
                for k in range(len(digits) // 4):
                    self.motors[k] = int(digits[4 * k : 4 * k + 4], 16)
                self.values.append(tuple(self.motors))

    def await_motors(self, *wanted):
        until = time.monotonic() + 20.0
        while self.motors != list(wanted) and time.monotonic() < until:
            time.sleep(0.005)
        assert self.motors == list(wanted)


@pytest.fixture
def board():
    double = Board(2)
    yield double
    double.is_on = False
    double.thread.join()
    double.socket.close()


@pytest.fixture
def is_quick(monkeypatch):
    monkeypatch.setattr(vrc_haptics, "ANSWER_S", 0.3)
    monkeypatch.setattr(vrc_haptics, "LOST_S", 0.4)
    monkeypatch.setattr(vrc_haptics, "SEARCH_S", 0.4)


def worn(port):
    output = OutputConfig(VrcHapticsEncoder(), UdpTransport("", port))
    kind = vibration(fixed=True, maximum=10.0)
    return device(kind, kind, outputs=(output,))


def values(first, second):
    """Amplitudes m/s^2 at the fixed frequency of both motors."""
    return np.array([first, 100.0, second, 100.0])


def target(port):
    return {"kind": "udp", "host": "127.0.0.1", "port": port}


def test_values_are_four_hexadecimal_digits_a_motor(board):
    output = open_output(worn(board.port), target(board.port))
    output.send(values(10.0, 2.5))
    board.await_motors(0xFFFF, 16384)  # 65535 / 4, rounded to the nearest
    assert output.chosen_device == MAC
    output.close()
    assert board.motors == [0, 0]


def test_a_stop_is_three_datagrams_of_zeros(board):
    output = open_output(worn(board.port), target(board.port))
    output.send(values(10.0, 10.0))
    board.await_motors(0xFFFF, 0xFFFF)
    before = len(board.values)
    output.stop()
    board.await_motors(0, 0)
    time.sleep(0.05)
    assert board.values[before:] == [(0, 0)] * 3
    output.close()


def test_the_close_waits_for_an_answer_after_the_zeros(board, is_quick):
    output = open_output(worn(board.port), target(board.port))
    board.is_unplugged = True
    with pytest.raises(OutputLostError, match="does not confirm the stop"):
        output.close()
    board.is_unplugged = False
    open_output(worn(board.port), target(board.port)).close()  # the reservation is released


def test_a_silent_board_is_lost(board, is_quick):
    output = open_output(worn(board.port), target(board.port))
    until = time.monotonic() + 0.8
    while time.monotonic() < until:  # answers to pings are signs of life
        output.send(values(1.0, 1.0))
        time.sleep(0.02)
    board.is_unplugged = True
    with pytest.raises(OutputLostError, match="no sign of life"):
        for _ in range(500):
            output.send(values(1.0, 1.0))
            time.sleep(0.02)
    board.is_unplugged = False
    output.close()


def test_without_a_board_the_message_names_the_address_and_the_cure(is_quick):
    with pytest.raises(OutputLostError, match=r"127\.0\.0\.1:9.*does not answer.*Switch the board"):
        open_output(worn(9), target(9))


def test_a_second_device_is_refused(board):
    output = open_output(worn(board.port), target(board.port))
    with pytest.raises(OutputLostError, match="open already"):
        open_output(worn(board.port), target(board.port))
    output.close()


def announcement(**facts):
    return json.dumps({"mac": MAC, "ip": "8.8.8.8", "name": "vest", "port": 1027, **facts}).encode()


@pytest.fixture
def group_port(monkeypatch, is_quick):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    monkeypatch.setattr(vrc_haptics, "GROUP_PORT", port)
    monkeypatch.setattr(discovery, "SEARCH_S", 0.4, raising=False)
    return port


def announce(port, *contents):
    def run():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(20):
                for content in contents:
                    sender.sendto(content, ("127.0.0.1", port))
                time.sleep(0.02)

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_a_board_is_found_by_its_announcement(board, group_port):
    sender = announce(group_port, announcement(port=board.port), b"{", b"[]", b"x" * 2000)
    (match,) = discovery.found_devices([worn(1027)], [])
    sender.join()
    assert (match.unit, match.port) == (f"vest {MAC}", "")
    sender = announce(group_port, announcement(port=board.port))
    output = open_output(worn(1027), {"kind": "udp", "unit": match.unit})
    sender.join()
    output.send(values(10.0, 0.0))
    board.await_motors(0xFFFF, 0)
    output.close()


def test_an_announcement_does_not_choose_the_receiver():
    assert vrc_haptics.board_of(announcement(), "192.168.0.7").host == "192.168.0.7"
    assert vrc_haptics.board_of(announcement(), "8.8.8.8") is None
    for facts in ({"port": 0}, {"port": True}, {"port": "1027"}, {"mac": 5}, {"name": None}):
        assert vrc_haptics.board_of(announcement(**facts), "127.0.0.1") is None


def test_of_several_boards_one_has_to_be_chosen():
    boards = [vrc_haptics.Board("10.0.0.1", 1027, name, name * 2) for name in ("a", "b")]
    with pytest.raises(OutputLostError, match="Several boards fit: a aa, b bb"):
        vrc_haptics.chosen_board(boards, "")
    for unit in ("b", "bb", "b bb"):
        assert vrc_haptics.chosen_board(boards, unit) is boards[1]
    with pytest.raises(OutputLostError, match="No board 'c' announced itself"):
        vrc_haptics.chosen_board(boards, "c")


def test_time_on_is_counted_for_the_board_under_any_address():
    first, second = (
        identities(worn(1027), {"kind": "udp", "host": host}, MAC)
        for host in ("192.168.0.7", "192.168.0.9")
    )
    assert first == second and MAC in first[0].name
