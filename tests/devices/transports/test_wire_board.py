# SPDX-License-Identifier: GPL-3.0-or-later
"""Host side of the firmware protocol, against the firmware's core behind a pseudo-terminal."""

import os
import threading
import time

import numpy as np
import pytest
from bench_devices import device, vibration

from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import wire_board
from hfx_blender.devices.transports import wire_board as wire
from hfx_blender.engine.rendering.device_config import (
    DEAD_MAN_MS,
    OutputConfig,
    SerialTransport,
    WireEncoder,
)
from hfx_tools.bench.safety.firmware_core import PluggedBoard, built, compiler

pytest.importorskip("serial")
pytestmark = pytest.mark.skipif(
    os.name != "posix" or compiler() is None, reason="needs a pseudo-terminal and a C compiler"
)

OUTPUT = OutputConfig(WireEncoder(), SerialTransport(115200))
TWO = device(vibration(fixed=True), vibration(maximum=20.0), outputs=(OUTPUT,))
HALF = np.array([5.0, 175.0, 10.0, 80.0])


class LiveBoard(PluggedBoard):
    """Firmware core on a terminal, with a clock advanced by the test only."""

    def __init__(self, library, terminal, channels=6):
        self.clock_ms = 1
        super().__init__(library, terminal.master, channels)

    def clock(self):
        return self.clock_ms


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return built(tmp_path_factory.mktemp("core"))


@pytest.fixture
def board(library, terminal):
    live_board = LiveBoard(library, terminal)
    yield live_board
    live_board.close()


def opened(terminal):
    return open_output(TWO, {"kind": "serial", "port": terminal.name})


def eventually(is_true, within_s=60.0):
    until = time.monotonic() + within_s
    while not is_true():
        assert time.monotonic() < until
        time.sleep(0.002)


def keep_sending(output, is_true):
    def tried():
        output.send(HALF)
        return is_true()

    eventually(tried)


def test_values_reach_the_pins_and_stop_silences_them(board, terminal):
    output = opened(terminal)
    output.send(HALF)
    eventually(lambda: board.levels[:3] == [32768, 32768, 0])
    output.stop()
    eventually(lambda: board.levels[:2] == [0, 0])
    output.close()


def test_after_a_stop_the_next_values_begin_a_new_session(board, terminal):
    output = opened(terminal)
    for _ in range(3):
        keep_sending(output, lambda: board.levels[0] == 32768)
        output.stop()
        eventually(lambda: board.levels[0] == 0)
    output.close()


def test_a_silent_host_hears_of_the_stop_of_the_board(board, terminal):
    output = opened(terminal)
    output.send(HALF)
    eventually(lambda: board.levels[0] == 32768)
    board.clock_ms += DEAD_MAN_MS + 1
    eventually(lambda: board.levels[0] == 0)
    with pytest.raises(OutputLostError, match="no values for 250 ms"):
        keep_sending(output, lambda: False)
    output.close()


def test_a_board_that_restarts_is_noticed(board, terminal):
    output = opened(terminal)
    keep_sending(output, lambda: board.levels[0] == 32768)
    board.restart()
    with pytest.raises(OutputLostError, match="restarted"):
        keep_sending(output, lambda: False)
    assert board.levels[0] == 0
    output.close()


def test_a_board_that_does_not_answer_is_refused_and_its_port_is_free_again(
    board, terminal, monkeypatch
):
    board.is_deaf = True
    monkeypatch.setattr(wire_board, "START_S", 0.3)
    for _ in range(2):
        with pytest.raises(OutputLostError, match=r"not answer\. Expected are frames of HFX"):
            opened(terminal)
    board.is_deaf = False
    opened(terminal).close()


def test_output_of_another_firmware_is_quoted(board, terminal, monkeypatch):
    board.is_deaf = True
    monkeypatch.setattr(wire_board, "START_S", 0.5)
    printing = threading.Timer(0.1, lambda: os.write(terminal.master, b"Ready.\r\n\x1b[1m\xff"))
    printing.start()
    with pytest.raises(OutputLostError) as lost:
        opened(terminal)
    printing.join()
    assert r"It sends 'Ready.\r\n\x1b[1m\xff'. Expected are frames of HFX" in str(lost.value)


def test_a_board_that_starts_slowly_is_waited_for(board, terminal):
    board.is_deaf = True
    threading.Timer(0.4, lambda: setattr(board, "is_deaf", False)).start()
    opened(terminal).close()


def test_a_board_with_too_few_channels_is_refused(library, terminal):
    board = LiveBoard(library, terminal, channels=1)
    try:
        with pytest.raises(OutputLostError, match="has 1 channels; the device needs 2"):
            opened(terminal)
    finally:
        board.close()


def test_a_stalled_port_stops_once_read_again(board, terminal):
    output = opened(terminal)
    keep_sending(output, lambda: board.levels[0] == 32768)
    board.close()  # without a reader from here on
    for _ in range(3_000):
        output.send(HALF)
    output.stop()
    actual = wire.Receiver().take(terminal.read(wait_s=0.1, least=1 << 20))
    assert [entry.kind for entry in actual[-3:]] == [wire.FrameKind.STOP] * 3
    output.close()
