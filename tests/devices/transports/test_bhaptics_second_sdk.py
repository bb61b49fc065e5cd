# SPDX-License-Identifier: GPL-3.0-or-later
"""Second SDK of bHaptics: secure websocket to a double of the Player.

The double follows the maker's plugin for SimHub (bhaptics/tact-simhub: BhapticsWebsocket.cs,
Sdk2Message.cs), and replaces a frame by the next with the same request id, as a program does that
imitates the Player.
"""

from __future__ import annotations

import json
import shutil
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from bench_devices import device, vibration
from websockets.sync.server import ServerConnection, serve

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations.configuration_reader import output
from hfx_blender.devices.host.duty_budget_store import identities
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports.websocket import WebSocket
from hfx_blender.engine.rendering.device_config import (
    BhapticsEncoder,
    DeviceConfig,
    OutputConfig,
    WebsocketTransport,
)
from hfx_blender.files.json_shapes import Node

TWO = (vibration(), vibration())
HALF = np.array([5.0, 100.0, 5.0, 100.0])
FRONT_ONLY = np.array([10.0, 100.0, 0.0, 100.0])
SILENT = np.array([0.0, 100.0, 0.0, 100.0])


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File with a key and a certificate that it signs itself, as the Player's."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate")
    folder = tmp_path_factory.mktemp("tls")
    key, file = folder / "key.pem", folder / "player.pem"
    curve = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=player"
    command = ["openssl", "req", "-x509", *curve.split(), "-keyout", str(key), "-out", str(file)]
    subprocess.run(command, capture_output=True, check=True)
    file.write_text(file.read_text() + key.read_text())
    return file


class Player:
    """Double of the Player: levels of 40 motors by device number, until frames run out."""

    def __init__(self, certificate: Path) -> None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate)
        self.heard: list[dict[str, Any]] = []
        self.paths: list[str] = []
        self.connections: list[ServerConnection] = []
        self._frames: dict[int, tuple[float, int, list[int]]] = {}
        self._lock = threading.Lock()
        self._server = serve(self._serve, "127.0.0.1", 0, ssl=context)
        self.port = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _serve(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        self.connections.append(connection)
        self.paths.append(connection.request.path)
        is_known = False
        for text in connection:
            message = json.loads(text)
            kind, content = message["Type"], json.loads(message["Message"] or "null")
            with self._lock:
                self.heard.append({kind: content})
                if kind == "SdkRequestAuth":
                    is_known = bool(content["applicationId"])
                    connection.send(json.dumps({"Type": "ServerReady", "Message": ""}))
                    connection.send(
                        json.dumps({"Type": "ServerEventList", "Message": "e" * 70_000})
                    )
                elif kind == "SdkPlayDotMode" and is_known:
                    until_s = time.monotonic() + content["durationMillis"] / 1000.0
                    frame = until_s, content["position"], content["motorValues"]
                    self._frames[content["requestId"]] = frame
                elif kind == "SdkStopAll":
                    self._frames.clear()

    def levels(self, number: int) -> list[int]:
        """Levels 0..100 of a device's 40 motors now."""
        now = time.monotonic()
        with self._lock:
            rows = [v for until_s, n, v in self._frames.values() if n == number and now < until_s]
        return np.max([[0] * 40, *rows], axis=0).tolist()

    def wait(self, is_true: Any, within_s: float = 20.0) -> None:
        until_s = time.monotonic() + within_s
        while not is_true():
            assert time.monotonic() < until_s, self.heard
            time.sleep(0.001)

    def close(self) -> None:
        self._server.shutdown()


@pytest.fixture
def player(certificate: Path) -> Iterator[Player]:
    actual = Player(certificate)
    yield actual
    actual.close()


def bench(port: int, *places: tuple[str, int], **facts: Any) -> DeviceConfig:
    how = BhapticsEncoder(places or (("VestFront", 1), ("VestBack", 19)), sdk=2)
    outputs = (OutputConfig(how, WebsocketTransport("127.0.0.1", port)),)
    return device(*TWO, outputs=outputs, **facts)


def opened(port: int, *places: tuple[str, int], **facts: Any) -> Any:
    return open_output(bench(port, *places, **facts), {"kind": "websocket"})


def test_the_login_comes_first_with_id_and_key_of_the_environment(player, monkeypatch):
    monkeypatch.setenv("HFX_BHAPTICS_APP_ID", "an id&")
    monkeypatch.setenv("HFX_BHAPTICS_API_KEY", "a/key")
    out = opened(player.port)
    player.wait(lambda: player.heard)
    address = urlsplit(player.paths[0])
    assert address.path == "/v3/feedback"
    query = parse_qs(address.query)
    assert (query["workspace_id"], query["api_key"]) == (["an id&"], ["a/key"])
    login = player.heard[0]["SdkRequestAuth"]
    assert (login["applicationId"], login["sdkApiKey"]) == ("an id&", "a/key")
    out.close()


def test_front_and_back_are_one_vest_of_40_motors(player):
    out = opened(player.port)
    out.send(HALF)
    player.wait(lambda: any(player.levels(0)))
    assert np.flatnonzero(player.levels(0)).tolist() == [1, 39]
    assert set(player.levels(0)) == {0, 50}
    frame = player.heard[1]["SdkPlayDotMode"]
    assert frame["durationMillis"] == 100 and len(frame["motorValues"]) == 40
    time.sleep(0.03)
    out.send(FRONT_ONLY)
    player.wait(lambda: np.flatnonzero(player.levels(0)).tolist() == [1])
    assert max(player.levels(0)) == 100
    time.sleep(0.03)
    count = len(player.heard)
    out.send(SILENT)
    player.wait(lambda: len(player.heard) == count + 1)
    assert not any(player.levels(0))
    for _ in range(3):  # silence is sent once
        time.sleep(0.03)
        out.send(SILENT)
    assert len(player.heard) == count + 1
    out.close()


# Numbers of the maker's enumeration (bhaptics/tact-python: class Position).
@pytest.mark.parametrize(
    ("number", "position"),
    [*enumerate("ForearmL ForearmR Head HandL HandR FootL FootR GloveL GloveR".split(), 1)],
)
def test_positions_have_the_numbers_of_the_maker(player, number, position):
    out = opened(player.port, (position, 0), (position, 2))
    out.send(HALF)
    player.wait(lambda: any(player.levels(number)))
    assert np.flatnonzero(player.levels(number)).tolist() == [0, 2]
    out.close()


def test_a_stop_is_silence_within_50_ms(player):
    out = opened(player.port)
    for _ in range(20):
        time.sleep(0.025)
        out.send(HALF)
        player.wait(lambda: any(player.levels(0)))
        began_s = time.monotonic()
        out.stop()
        player.wait(lambda: player.heard[-1] == {"SdkStopAll": None}, 0.05)
        assert not any(player.levels(0)) and time.monotonic() - began_s < 0.05
    out.close()


def test_a_killed_program_is_silence_when_the_frame_ends(player):
    out = opened(player.port)
    out.send(HALF)
    player.wait(lambda: any(player.levels(0)))
    out._socket._socket.close()  # no stop, no close frame
    time.sleep(0.12)
    assert not any(player.levels(0))


def test_a_player_that_ends_is_reported(player):
    out = opened(player.port)
    player.wait(lambda: player.connections)
    player.connections[0].close()
    with pytest.raises(OutputLostError, match="closed"):
        for _ in range(1000):
            out.send(HALF)
            time.sleep(0.01)


def test_long_messages_are_read_whole(player):
    heard: list[str] = []
    connection = WebSocket("127.0.0.1", player.port, "/v3/feedback", heard.append, tls=True)
    login = json.dumps({"applicationId": "x"})
    connection.send(json.dumps({"Type": "SdkRequestAuth", "Message": login}))
    player.wait(lambda: len(heard) == 2)
    assert len(json.loads(heard[1])["Message"]) == 70_000
    connection.close()


def test_a_server_without_encryption_is_refused():
    with serve(lambda _connection: None, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]
        with pytest.raises(OutputLostError, match=f"wss://127.0.0.1:{port} does not answer"):
            opened(port)
        server.shutdown()


def test_both_sdks_are_of_one_player():
    suit = load_device("bhaptics_tactsuit_x40")
    document = {"encoder": {"kind": "bhaptics", "sdk": 2, "dots": []}}
    document["encoder"]["dots"] = [
        {"position": position, "index": index} for position, index in suit.outputs[0].encoder.dots
    ]
    second = output(Node(document, "x.json"), suit.actuators)
    assert second.transport == WebsocketTransport("127.0.0.1", 15882)
    assert suit.outputs[0].transport == WebsocketTransport("127.0.0.1", 15881)
    accounts = [
        identities(bench_device, {"kind": "websocket"}, "")
        for bench_device in (suit, device(*TWO, outputs=(second,)))
    ]
    assert accounts[0][0].name == accounts[1][0].name
