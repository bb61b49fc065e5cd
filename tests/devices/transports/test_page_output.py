# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a phone, driven by a client of another library's kind: raw HTTP and websockets."""

import http.client
import importlib.util
import json
import time
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import page_output

ROOT = Path(__file__).parents[3]


@pytest.fixture
def page(monkeypatch):
    monkeypatch.setattr(page_output, "_WRONG_S", 0.0)
    target = {"kind": "page", "host": "127.0.0.1", "port": 0, "code": "012345"}
    output = open_output(load_device("phone_lra"), target)
    yield output
    output.close()


def address(page):
    return page.chosen_device.split()[0].removeprefix("http://")


def joined(page, code="012345", origin=None):
    where = address(page)
    client = connect(
        f"ws://{where}/feel", origin=origin or f"http://{where}", proxy=None
    )  # closed with the page
    client.send(code)
    return client


def test_values_go_to_a_page_with_the_code_and_a_stop_is_zero(page):
    client = joined(page)
    hello = json.loads(client.recv(timeout=2))
    assert [(x["side"], x["highest"], x["deadManMs"]) for x in hello["vibrations"]] == [
        ("right", 10.0, 250.0)
    ]
    page.send(np.array([2.5, 175.0]))
    assert json.loads(client.recv(timeout=2)) == [2.5]
    page.stop()
    assert json.loads(client.recv(timeout=2)) == [0.0]
    page.close()
    with pytest.raises(ConnectionClosed):
        client.recv(timeout=2)


def test_a_page_that_does_not_answer_gets_no_queue_of_old_values(page):
    client = joined(page)
    client.recv(timeout=2)
    for k in range(50):
        page.send(np.array([k / 10.0, 175.0]))
        time.sleep(0.005)
    received = []
    with pytest.raises(TimeoutError):
        while True:
            received.append(json.loads(client.recv(timeout=0.3))[0])
    assert len(received) == 4  # as many as may be unanswered
    page.stop()
    assert json.loads(client.recv(timeout=0.3)) == [0.0]  # silence does not wait
    page.send(np.array([4.9, 175.0]))
    for _ in range(5):
        client.send("")
    assert json.loads(client.recv(timeout=2)) == [4.9]


def test_ten_wrong_codes_lock_the_page(page):
    for k in range(10):
        client = joined(page, f"{k:06d}")
        with pytest.raises(ConnectionClosed) as closed:
            client.recv(timeout=2)
        assert closed.value.rcvd.code == 4001
    client = joined(page)
    with pytest.raises(ConnectionClosed) as closed:
        client.recv(timeout=2)
    assert closed.value.rcvd.code == 4003


@pytest.mark.parametrize("path", ["/../device.json", "//etc/passwd", "/feel", "/phone_page.html"])
def test_nothing_but_the_page_can_be_fetched(page, path):
    client = http.client.HTTPConnection(address(page), timeout=3)
    client.request("GET", path)
    assert client.getresponse().status == 404


def test_the_page_has_strict_headers_and_needs_its_own_host_and_origin(page):
    client = http.client.HTTPConnection(address(page), timeout=3)
    client.request("GET", "/")
    answer = client.getresponse()
    body = answer.read().decode()
    assert answer.status == 200 and "vibrationActuator" in body
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    client = http.client.HTTPConnection(address(page), timeout=3)
    client.request("GET", "/", headers={"Host": "evil.example"})
    assert client.getresponse().status == 421
    with pytest.raises(InvalidStatus):
        joined(page, origin="http://evil.example")


@pytest.mark.parametrize("host", ["0.0.0.0", "8.8.8.8", "example.org"])
def test_foreign_and_open_addresses_are_refused(host):
    with pytest.raises(OutputLostError):
        open_output(load_device("phone_lra"), {"kind": "page", "host": host, "port": 0})


def test_the_page_equals_its_sources():
    spec = importlib.util.spec_from_file_location("web_build", ROOT / "players/web/build.py")
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    assert build.PHONE_PAGE.read_text(encoding="utf-8") == build.phone_page()
