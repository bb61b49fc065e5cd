# SPDX-License-Identifier: GPL-3.0-or-later
"""Websocket devices against servers of the same library, and of bytes."""

import json
import re
import socket
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from bench_devices import device, heat, vibration
from hypothesis import given, settings
from hypothesis import strategies as st
from raw_server import RawServer, fault_of
from websockets.sync.server import serve as serve_sync

from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.live import connection_search
from hfx_blender.devices.live.live_settings import LiveSettings
from hfx_blender.devices.transports import buttplug, websocket
from hfx_blender.devices.transports.websocket import WebSocket
from hfx_blender.engine.rendering.device_config import (
    BhapticsEncoder,
    ButtplugEncoder,
    OutputConfig,
    WebsocketTransport,
)

TWO = (vibration(fixed=True), vibration(maximum=20.0))
HALF = np.array([5.0, 175.0, 10.0, 80.0])
SILENT = np.array([0.0, 175.0, 0.0, 80.0])


class Server:
    """Server recording messages; ``answer`` may return replies to each message."""

    def __init__(self, answer=lambda text: (), **settings):
        self.heard = []
        self.paths = []
        self.connections = []
        self._answer = answer
        self._server = serve_sync(self._serve, "127.0.0.1", 0, **settings)
        self.port = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _serve(self, connection):
        self.connections.append(connection)
        self.paths.append(connection.request.path)
        for text in connection:
            self.heard.append(json.loads(text))
            for reply in self._answer(json.loads(text)):
                connection.send(json.dumps(reply))

    def wait(self, is_true, within_s=60.0):
        until = time.monotonic() + within_s
        while not is_true():
            assert time.monotonic() < until, self.heard
            time.sleep(0.002)

    def close(self):
        self._server.shutdown()


@pytest.fixture
def serve():
    servers = []

    def started(*arguments, **settings):
        servers.append(Server(*arguments, **settings))
        return servers[-1]

    yield started
    for server in servers:
        server.close()


@pytest.mark.parametrize("size", [0, 1, 125, 126, 65535, 65536, 200_000])
def test_texts_of_any_length_go_both_ways(serve, size):
    server = serve(lambda text: [text])
    heard = []
    connection = WebSocket("127.0.0.1", server.port, "/x?y=z", heard.append)
    text = json.dumps("ü" * (size // 2) + "a" * (size % 2), ensure_ascii=False)
    connection.send(text)
    server.wait(lambda: heard)
    assert json.loads(heard[0]) == json.loads(text)
    assert server.paths == ["/x?y=z"]
    connection.close()


def test_pings_are_answered_and_fragments_joined(serve):
    server = serve()
    heard = []
    connection = WebSocket("127.0.0.1", server.port, "/", heard.append)
    server.wait(lambda: server.connections)
    assert server.connections[0].ping("hello").wait(2.0)
    server.connections[0].send(["one ", "two ", "three"])
    server.wait(lambda: heard)
    assert heard == ["one two three"]
    connection.close()


def test_a_lost_server_is_reported_at_the_next_message(serve):
    server = serve()
    connection = WebSocket("127.0.0.1", server.port, "/", print)
    server.wait(lambda: server.connections)
    server.connections[0].close()
    with pytest.raises(OutputLostError, match=r"closed|gone"):
        server.wait(lambda: connection.send('"x"'))
    connection.close()


def test_a_server_that_does_not_read_costs_neither_time_nor_memory():
    server = RawServer(reads=False)
    connection = server.connect()
    began = time.monotonic()
    with pytest.raises(OutputLostError, match="does not read"):
        for _ in range(100_000):
            connection.send("x" * 1000)
    assert time.monotonic() - began < 10.0
    assert connection.waiting < 2 * websocket.MAX_WAITING
    connection.close()
    server.close()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"garbage",
        b"HTTP/1.1 200 OK\r\n\r\n",
        b"HTTP/1.1 101 X\r\nUpgrade: websocket\r\nSec-WebSocket-Accept: wrong\r\n\r\n",
        b"x" * 100_000,
    ],
)
def test_a_server_without_websockets_is_refused(answer):
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def reply():
            taken, _ = listener.accept()
            with taken:
                taken.recv(4096)
                taken.sendall(answer)

        threading.Thread(target=reply, daemon=True).start()
        with pytest.raises(OutputLostError):
            WebSocket("127.0.0.1", listener.getsockname()[1], "/", print)


def test_a_missing_server_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(OutputLostError, match="does not answer"):
        WebSocket("127.0.0.1", port, "/", print)


def bhaptics(server, *types, **facts):
    how = BhapticsEncoder((("ForearmL", 0), ("VestFront", 19)))
    output = OutputConfig(how, WebsocketTransport("127.0.0.1", server.port))
    return open_output(device(*types, outputs=(output,), **facts), {"kind": "websocket"})


def test_the_bhaptics_player_gets_frames_of_dots_and_is_turned_off(serve):
    server = serve()
    output = bhaptics(server, *TWO)
    output.send(HALF)
    server.wait(lambda: server.heard)
    assert server.paths == ["/v2/feedbacks?app_id=hfx_blender&app_name=HFX"]
    first, second = server.heard[0]["Submit"]
    assert first == {
        "Type": "frame",
        "Key": "hfx-bench-ForearmL",
        "Frame": {
            "position": "ForearmL",
            "dotPoints": [{"index": 0, "intensity": 50}],
            "pathPoints": [],
            "durationMillis": 100,
        },
    }
    assert second["Frame"]["dotPoints"] == [{"index": 19, "intensity": 50}]
    output.stop()
    server.wait(lambda: len(server.heard) == 2)
    assert server.heard[1] == {
        "Submit": [
            {"Type": "turnOff", "Key": "hfx-bench-ForearmL"},
            {"Type": "turnOff", "Key": "hfx-bench-VestFront"},
        ]
    }
    output.close()
    output.stop()


def test_silent_positions_are_turned_off_and_then_left_alone(serve):
    server = serve()
    output = bhaptics(server, *TWO)
    for values in (HALF, SILENT, SILENT, HALF):
        output.send(values)
        time.sleep(0.03)
    server.wait(lambda: len(server.heard) == 3)
    kinds = [[item["Type"] for item in message["Submit"]] for message in server.heard]
    assert kinds == [["frame"] * 2, ["turnOff"] * 2, ["frame"] * 2]
    output.close()


def test_a_mirrored_sleeve_is_the_other_arms(serve):
    server = serve()
    output = bhaptics(server, *TWO, is_mirrored=True, side="right")
    output.send(HALF)
    server.wait(lambda: server.heard)
    assert [e["Frame"]["position"] for e in server.heard[0]["Submit"]] == ["ForearmR", "VestFront"]
    output.close()


EDGE = {
    "DeviceName": "Lovense Edge",
    "DeviceIndex": 3,
    "DeviceFeatures": {
        "0": {"FeatureIndex": 0, "Output": {"Vibrate": {"Value": [0, 20]}}},
        "1": {"FeatureIndex": 1, "Output": {"Temperature": {"Value": [-10, 10]}}},
    },
}


def intiface(ping_ms=0, version=4, name="Lovense Edge", devices=None):
    there = {"3": {**EDGE, "DeviceName": name}}

    def answer(messages):
        for message in messages:
            ((kind, content),) = message.items()
            if kind == "RequestServerInfo":
                yield [
                    {
                        "ServerInfo": {
                            "Id": content["Id"],
                            "ServerName": "x",
                            "MaxPingTime": ping_ms,
                            "ProtocolVersionMajor": version,
                            "ProtocolVersionMinor": 0,
                        }
                    }
                ]
            elif kind == "RequestDeviceList":
                actual = there if devices is None else devices
                yield [{"DeviceList": {"Id": content["Id"], "Devices": actual}}]
            else:
                yield [{"Ok": {"Id": content["Id"]}}]

    return answer


def lovense(server, name="Lovense"):
    how = ButtplugEncoder(name, ((0, "Vibrate"), (1, "Temperature")))
    output = OutputConfig(how, WebsocketTransport("127.0.0.1", server.port))
    return open_output(device(TWO[0], heat(), outputs=(output,)), {"kind": "websocket"})


def received_of_kind(server, kind):
    return [item[kind] for message in server.heard for item in message if kind in item]


def test_buttplug_gets_whole_numbers_of_each_features_range(serve):
    server = serve(intiface())
    output = lovense(server)
    assert received_of_kind(server, "RequestServerInfo") == [
        {"Id": 1, "ClientName": "HFX", "ProtocolVersionMajor": 4, "ProtocolVersionMinor": 0}
    ]
    output.send(np.array([5.0, 175.0, 29.0]))
    time.sleep(0.03)
    output.send(np.array([5.0, 175.0, 21.5]))  # half way from 29 down to 14
    server.wait(lambda: len(received_of_kind(server, "OutputCmd")) == 3)
    commands = [
        (e["DeviceIndex"], e["FeatureIndex"], e["Command"])
        for e in received_of_kind(server, "OutputCmd")
    ]
    assert commands == [
        (3, 0, {"Vibrate": {"Value": 10}}),
        (3, 1, {"Temperature": {"Value": 0}}),
        (3, 1, {"Temperature": {"Value": -5}}),
    ]
    output.stop()
    server.wait(lambda: received_of_kind(server, "StopCmd"))
    assert received_of_kind(server, "StopCmd")[0]["DeviceIndex"] == 3
    ids = [content["Id"] for message in server.heard for e in message for content in e.values()]
    assert len(set(ids)) == len(ids) and min(ids) >= 1
    time.sleep(0.03)
    output.send(np.array([5.0, 175.0, 29.0]))  # after a stop every value is sent again
    server.wait(lambda: len(received_of_kind(server, "OutputCmd")) == 5)
    output.close()


LUSH = {"0": {"FeatureIndex": 0, "Output": {"Vibrate": {"Value": [0, 20]}}}}


def lushes(*displays, first=0):
    """Return devices with the name Lush, given display names, and ascending indices."""
    return {
        str(index): {
            **{"DeviceIndex": index, "DeviceName": "Lush", "DeviceFeatures": LUSH},
            **({"DeviceDisplayName": display} if display else {}),
        }
        for index, display in enumerate(displays, first)
    }


def lush(server, device_id="a", name="Lush", unit=""):
    how = ButtplugEncoder(name, ((0, "Vibrate"),))
    output = OutputConfig(how, WebsocketTransport("127.0.0.1", server.port))
    target = {"kind": "websocket", **({"unit": unit} if unit else {})}
    return open_output(replace(device(TWO[0], outputs=(output,)), id=device_id), target)


def levels(server):
    return {
        item["DeviceIndex"]: item["Command"]["Vibrate"]["Value"]
        for item in received_of_kind(server, "OutputCmd")
    }


def test_a_server_scans_for_toys_until_the_search_ends(serve, monkeypatch):
    answers = intiface(devices={})

    def scanning(messages):
        yield from answers(messages)
        if "StartScanning" in str(messages):  # a toy is switched on
            yield [{"DeviceList": {"Id": 0, "Devices": lushes("left")}}]

    server = serve(scanning)
    monkeypatch.setattr(connection_search, "_REPEAT_S", 0.05)
    output = OutputConfig(ButtplugEncoder("Lush", ((0, "Vibrate"),)), WebsocketTransport("x", 1))
    address = LiveSettings("DEVICE", host="127.0.0.1", port=str(server.port))
    search = connection_search.ConnectionSearch()
    search.start(device(vibration(), outputs=(output,)), address)
    toys = (("Lush (left)", ""),)
    server.wait(lambda: search.newest is not None and search.newest.units == toys)
    assert search.newest.hint == ""
    search.end()
    assert search.newest is None
    server.wait(lambda: received_of_kind(server, "StopScanning"))
    assert len(received_of_kind(server, "StartScanning")) == 1


def test_two_devices_of_one_name_are_each_driven_by_one_of_ours(serve):
    server = serve(intiface(devices=lushes("left", "right")))
    first, second = lush(server, "one"), lush(server, "other")
    assert (first.chosen_device, second.chosen_device) == ("Lush (left)", "Lush (right)")
    first.send(np.array([5.0, 175.0]))
    second.send(np.array([10.0, 175.0]))
    server.wait(lambda: len(levels(server)) == 2)
    assert levels(server) == {0: 10, 1: 20}
    assert len(server.connections) == 1, "many servers take one client only"
    with pytest.raises(OutputLostError, match=r"'Lush \(left\)' of the server is open already"):
        lush(server, "third")
    first.close()
    second.send(np.array([5.0, 175.0]))
    lush(server, "third").close()
    second.close()


@pytest.mark.parametrize(
    ("displays", "name", "unit", "index"),
    [
        (("left", "right"), "Lush", "right", 1),
        (("left", "right"), "Lush", "Lush (right)", 1),
        (("left", "right"), "right", "", 1),  # the configuration has the display name
        (("", ""), "Lush", "Lush #1", 1),
        (("", ""), "", "#1", 1),
        (("x", "x"), "Lush", "Lush (x) #1", 1),
        (("", "", "wide"), "Lush", "wide", 2),
    ],
)
def test_one_of_several_is_chosen_by_its_names_or_its_index(serve, displays, name, unit, index):
    server = serve(intiface(devices=lushes(*displays)))
    output = lush(server, name=name, unit=unit)
    output.send(np.array([10.0, 175.0]))
    server.wait(lambda: levels(server))
    assert levels(server) == {index: 20}
    output.close()


@pytest.mark.parametrize(
    ("displays", "unit", "message"),
    [
        (("left", "right"), "Lush", "no single device 'Lush'"),  # two have this name
        (("left", "right"), "middle", r"it has: Lush \(left\) #0, Lush \(right\) #1"),
        (("", ""), "Lush #7", "no single device 'Lush #7'"),
    ],
)
def test_a_choice_that_means_no_device_or_several_is_refused(serve, displays, unit, message):
    with pytest.raises(OutputLostError, match=message):
        lush(serve(intiface(devices=lushes(*displays))), unit=unit)


def test_after_a_reconnection_devices_are_found_by_name(serve):
    devices = lushes("left", "right")
    server = serve(intiface(devices=devices))
    lush(server, "one").close()  # left, index 0
    devices.clear()
    devices.update(lushes("right", "left", first=3))
    output = lush(server, "one")
    output.send(np.array([10.0, 175.0]))
    server.wait(lambda: levels(server))
    assert levels(server) == {4: 20}
    output.close()


def test_after_a_reconnection_no_other_device_is_taken_for_the_one_that_is_gone(serve):
    devices = lushes("", "")
    server = serve(intiface(devices=devices))
    lush(server, "one").close()  # index 0
    devices.clear()
    devices.update(lushes("", first=1))
    with pytest.raises(OutputLostError, match=r"no single device 'Lush #0' .* it has: Lush #1"):
        lush(server, "one")


def test_another_device_at_the_same_index_is_not_played_on(serve):
    server = serve(intiface(devices=lushes("left", "right")))
    output = lush(server)
    output.send(np.array([5.0, 175.0]))
    devices = lushes("right", "left")
    server.connections[0].send(json.dumps([{"DeviceList": {"Id": 0, "Devices": devices}}]))
    with pytest.raises(OutputLostError, match="disconnected from the server"):
        server.wait(lambda: output.send(np.array([10.0, 175.0])))
    output.close()


def test_one_actuator_of_the_bhaptics_player_is_one_devices(serve):
    server = serve()
    output = bhaptics(server, *TWO)
    with pytest.raises(OutputLostError, match=r"'ForearmL and VestFront' .* is open already"):
        bhaptics(server, *TWO)
    output.close()
    bhaptics(server, *TWO).close()


def test_buttplug_pings_while_nothing_is_sent(serve):
    server = serve(intiface(ping_ms=200))
    output = lovense(server)
    server.wait(lambda: len(received_of_kind(server, "Ping")) >= 3)
    output.close()


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (intiface(version=3), "version 4"),
        (intiface(name="Other"), "no device 'Lovense' that fits; it has: Other"),
        (intiface(devices={}), "it has: none"),
        (intiface(devices={"0": {"DeviceName": "Lovense"}}), "that fits"),
        (intiface(devices={"0": [], "1": None}), "it has: none"),
        (intiface(devices={"3": {**EDGE, "DeviceIndex": "x"}}), "that fits"),
        (intiface(devices={"3": {**EDGE, "DeviceIndex": float("inf")}}), "that fits"),
        (lambda text: [["nonsense"]], r"sent '\[\"nonsense\"\]'. Expected .* Intiface Central"),
        (lambda text: [{"a": 1}], r"sent '{\"a\": 1}'. Expected .* JSON list of messages"),
        (lambda text: [[{"Ok": 5}]], r"sent '\[{\"Ok\": 5}\]'. Expected"),
        (lambda text: [[{"ServerInfo": None}]], "Expected is what a Buttplug server"),
        (lambda text: [[]], "does not answer. Expected is what a Buttplug server"),
        (lambda text: [[{"Error": {"Id": 1, "ErrorMessage": "bad"}}]], "reports a fault: bad"),
    ],
)
def test_a_buttplug_server_that_does_not_fit_is_refused(serve, monkeypatch, answer, expected):
    monkeypatch.setattr(buttplug, "ANSWER_S", 0.3)
    with pytest.raises(OutputLostError, match=expected):
        lovense(serve(answer))
    left = [thread for thread in threading.enumerate() if thread.name.startswith("ws://")]
    for message in left:
        message.join(10.0)
    assert not any(message.is_alive() for message in left)


@pytest.mark.parametrize(
    "sent",
    ["{'a': 1}", "\x1b[31mHTTP", "[" * 100_000, "", '[{"Ok": {"Id": {}}}]', '{"a": NaN'],
    ids=["no JSON", "escape", "deep", "nothing", "unhashable", "cut off"],
)
def test_a_message_quotes_an_answer_other_than_buttplug_json(sent):
    server = RawServer(text_frame(sent))
    with pytest.raises(OutputLostError) as lost:
        buttplug.devices_at("127.0.0.1", server.port)
    server.close()
    text = str(lost.value)
    assert f"ws://127.0.0.1:{server.port}: the server sent '" in text
    assert "Expected is what a Buttplug server such as Intiface Central sends" in text
    assert text.isprintable() and len(text) < 300
    assert not re.search("property name|recursion|unhashable|object", text)


def text_frame(text):
    """Return a server's websocket frame (RFC 6455): final, text, unmasked, length of 64 bits."""
    content = text.encode()
    return b"\x81\x7f" + len(content).to_bytes(8, "big") + content


@pytest.mark.parametrize("gap", [1e9, float("inf"), float("nan"), -5, True, "x", None])
def test_no_server_can_keep_a_device_from_falling_silent(serve, gap):
    server = serve(intiface(devices={"3": {**EDGE, "DeviceMessageTimingGap": gap}}))
    output = lovense(server)
    assert 0.0 < output.command_interval_s <= 0.25
    output.send(np.array([5.0, 175.0, 29.0]))
    output.send(np.array([0.0, 175.0, 29.0]))  # at once
    server.wait(lambda: len(received_of_kind(server, "OutputCmd")) == 3)
    assert received_of_kind(server, "OutputCmd")[-1]["Command"] == {"Vibrate": {"Value": 0}}
    output.close()


def test_a_device_that_leaves_the_server_is_lost(serve):
    server = serve(intiface())
    output = lovense(server)
    server.connections[0].send(json.dumps([{"DeviceList": {"Id": 0, "Devices": {}}}]))
    with pytest.raises(OutputLostError, match="disconnected from the server"):
        server.wait(lambda: output.send(np.array([5.0, 175.0, 29.0])))
    output.close()


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_of_a_server_end_the_connection_and_nothing_else(content):
    server = RawServer(content, ends=True)
    heard = []
    connection = server.connect(heard.append)
    assert re.search("closed|not a frame|too long|binary|UTF-8", fault_of(connection))
    connection.close()
    server.close()
    assert all(isinstance(message, str) for message in heard)


def deaf_intiface():
    """Return a Buttplug server, silent after the first stop."""
    answer = intiface()

    def until_a_stop(messages):
        return () if "StopCmd" in messages[0] else answer(messages)

    return until_a_stop


def test_an_unconfirmed_stop_of_buttplug_is_reported_in_time(serve, monkeypatch):
    monkeypatch.setattr(buttplug, "ANSWER_S", 0.3)
    server = serve(deaf_intiface())
    output = lovense(server)
    output.stop()
    began = time.monotonic()
    with pytest.raises(OutputLostError, match="does not confirm the stop"):
        output.close()
    assert 0.25 < time.monotonic() - began < 2.0
    lovense(server).close()  # nothing is held any more, and no stop is awaited


def test_a_confirmed_stop_is_closed_without_a_word(serve):
    output = lovense(serve(intiface()))
    output.stop()
    output.close()


def bhaptics_at(port):
    how = BhapticsEncoder((("VestFront", 0), ("VestFront", 1)))
    output = OutputConfig(how, WebsocketTransport("127.0.0.1", port))
    return open_output(device(*TWO, outputs=(output,)), {"kind": "websocket"})


def test_an_unread_stop_of_the_bhaptics_player_is_reported(monkeypatch):
    monkeypatch.setattr(websocket, "STALLED_S", 0.3)
    server = RawServer(reads=False)
    output = bhaptics_at(server.port)
    output.stop()
    began = time.monotonic()
    with pytest.raises(OutputLostError, match="does not read any more"):
        output.close()
    assert 0.25 < time.monotonic() - began < 2.0
    server.close()


def test_a_stop_that_the_bhaptics_player_reads_is_closed_without_a_word(serve):
    server = serve()
    output = bhaptics_at(server.port)
    output.stop()
    output.close()
    # The server's library confirms the close before the test's handler gets the message.
    server.wait(lambda: server.heard)
    assert server.heard[-1]["Submit"][0]["Type"] == "turnOff"
