# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a game reach the output process only with the token, complete, new and in time."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from live_process import BAND

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_tools.commands.game_door import GameDoor

TOKEN = bytes(range(16))
COLUMNS = 16  # amplitude and frequency of eight motors


class Recorder:
    """Client recording sent values."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, list[float]]] = []

    def send(self, name: str, values: np.ndarray) -> None:
        self.sent.append((name, values.tolist()))


class Game:
    """Game sending datagrams to a door on a simulated clock."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.door = GameDoor({"band": load_device(BAND)}, 0, TOKEN, lambda: self.now_s)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def heard(self, datagram: bytes) -> list[list[float]]:
        self.socket.sendto(datagram, ("127.0.0.1", self.door.port))
        client = Recorder()
        self.door.show(client, 0.0)  # type: ignore[arg-type]
        assert all(name == "band" for name, _ in client.sent)
        return [values for _, values in client.sent]


@pytest.fixture
def game() -> Iterator[Game]:
    actual = Game()
    yield actual
    actual.socket.close()
    actual.door.close()


def datagram(number: int, strength: float, token: bytes = TOKEN, count: int = COLUMNS) -> bytes:
    """Return a datagram laid out by hand after docs/players/devices.md."""
    device = BAND.encode()
    head = b"HFX1" + token + struct.pack("<IB", number, len(device)) + device
    return head + struct.pack(f"<{count}f", *([strength] * count))


def test_only_whole_new_values_with_the_token_are_heard(game: Game) -> None:
    assert game.heard(datagram(5, 2.0)) == [[2.0] * COLUMNS]
    game.now_s += 0.1
    for nothing in (
        datagram(6, 3.0, token=bytes(16)),
        datagram(6, 3.0)[:-1],
        datagram(6, 3.0) + b"\0",
        datagram(6, 3.0, count=COLUMNS - 1),
        datagram(5, 3.0),
        datagram(4, 3.0),
        datagram(6, 3.0).replace(BAND.encode(), b"forearm_band_right"),
        b"HFX2" + datagram(6, 3.0)[4:],
        b"",
    ):
        assert game.heard(nothing) == []
    assert game.heard(datagram(6, 3.0)) == [[3.0] * COLUMNS]


def test_a_game_that_is_gone_is_silent_after_the_dead_man_time_and_may_come_back(
    game: Game,
) -> None:
    neutral = [0.0, load_device(BAND).actuators[0].type.controls[1].neutral] * 8
    assert game.heard(b"") == [neutral]  # before the first value
    assert game.heard(datagram(900, 2.0)) == [[2.0] * COLUMNS]
    game.now_s += 0.24
    assert game.heard(b"") == []
    game.now_s += 0.02
    assert game.heard(b"") == [neutral]
    for _ in range(20):  # of a hanging game
        assert game.heard(datagram(900, 4.0)) == [neutral]
        game.now_s += 0.3
    assert game.heard(datagram(7, 4.0)) == [neutral]
    assert game.heard(datagram(8, 4.0)) == [[4.0] * COLUMNS]  # a new game restarts the numbering


def test_the_door_is_on_this_computer_alone_and_its_options_are_checked(
    game: Game, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert game.door.socket.getsockname()[0] == "127.0.0.1"
    assert len(GameDoor({}).token) == 16 and GameDoor({}).token != GameDoor({}).token
    clip = str(Path(__file__).parents[3] / "players/conformance/demo_garage.hfxclip")
    start = ["play", clip, "--device", "insoles", "--to", "simulator", "--listen"]
    monkeypatch.setenv("HFX_TOKEN", "0123")
    assert cli.run(start) == 2 and "HFX_TOKEN: expected 32" in capsys.readouterr().err
    monkeypatch.setenv("HFX_TOKEN", TOKEN.hex())
    assert cli.run([*start, str(game.door.port)]) == 2  # taken
    assert cli.run([*start, "70000"]) == 2 and "expected 1 to 65535" in capsys.readouterr().err
    assert cli.run([*start, "0", "--from", "1"]) == 2
