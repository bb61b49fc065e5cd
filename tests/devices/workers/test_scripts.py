# SPDX-License-Identifier: GPL-3.0-or-later
"""Device scripts: returned values are played; a fault stops only the script's device."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import patient_host
import pytest
from live_process import BAND, PATIENCE_S, is_loud, play, playing, rows_of, wait

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import approval
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers.haptics import as_values, decode_haptics, encode_haptics
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.errors import InputError
from hfx_blender.files import resources

DEVICE = load_device(BAND)
NAME = "my_band_left"

HALF = "def render(haptics):\n    return haptics.values * 0.5\n"
ONCE_GOOD = (
    "n = 0\ndef render(haptics):\n    global n\n    n += 1\n    if n > 5: {}\n    return {}\n"
)
HOSTILE = {
    "raises": ONCE_GOOD.format("raise KeyError('oops')", "haptics.values"),
    "hangs": ONCE_GOOD.format("\n        while True: pass", "haptics.values"),
    "sleeps": ONCE_GOOD.format("__import__('time').sleep(99)", "haptics.values"),
    "exits": ONCE_GOOD.format("raise SystemExit", "haptics.values"),
    "dies": ONCE_GOOD.format("__import__('os').abort()", "haptics.values"),
    "returns too few": ONCE_GOOD.format("return [1.0]", "haptics.values"),
    "returns words": ONCE_GOOD.format("return 'full power'", "haptics.values"),
    "names nobody": ONCE_GOOD.format("return {'m99': 1.0}", "haptics.values"),
    "ends at once": "import sys\nsys.exit()\n",
    "has no render": "x = 1\n",
    "is no Python": "def render(:\n",
    "eats memory": ONCE_GOOD.format("x = bytearray(1 << 40)", "haptics.values"),
}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveClient]:
    """Start one output process and one approval list for all tests of the module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path_factory.mktemp("data")))
        live_client = LiveClient()
        yield live_client
        live_client.close()


@pytest.fixture
def folder(client: LiveClient, tmp_path: Path) -> Path:
    """Set up user devices without approvals."""
    resources.approved_scripts().unlink(missing_ok=True)
    path = tmp_path / "devices"
    path.mkdir()
    text = (resources.device_configs() / "forearm_band.json").read_text()
    (path / "my_band.json").write_text(text.replace('"forearm_band"', '"my_band"'))
    return path


def haptics(values: np.ndarray | None = None) -> bytes:
    return encode_haptics(1.5, [], playing() if values is None else values)


def connect(client: LiveClient, folder: Path, source: str, log: Path) -> None:
    (folder / "my_band.py").write_text(source)
    script = approval.script_of(NAME, folder)
    assert script is not None
    approval.approve(script)
    client.disconnect("scripted")
    client.connect(
        "scripted",
        NAME,
        {"kind": "simulator", "path": str(log)},
        folder=folder,
        script=script.as_request(),
    )


def feed_until_loud(client: LiveClient, log: Path) -> None:
    """Send the same moment to the script until its device plays."""
    wait(
        client,
        lambda: any(map(is_loud, rows_of(log))),
        lambda: client.send_haptics("scripted", haptics()),
    )


def test_returned_values_are_played(client: LiveClient, folder: Path, log: Path) -> None:
    connect(client, folder, HALF, log)
    feed_until_loud(client, log)
    assert rows_of(log)[-1]["values"][0] == 5.0


@pytest.mark.parametrize("first_line", ["from __future__ import annotations", ""])
def test_a_script_may_have_dataclasses(
    client: LiveClient, folder: Path, log: Path, first_line: str
) -> None:
    source = f"""{first_line}
from dataclasses import dataclass

@dataclass
class Strength:
    m_s2: float = 5.0

def render(haptics):
    return [Strength().m_s2, 100.0] * 8
"""
    connect(client, folder, source, log)
    feed_until_loud(client, log)
    assert rows_of(log)[-1]["values"][0] == 5.0


def test_a_script_is_told_of_jumps_in_time(client: LiveClient, folder: Path, log: Path) -> None:
    # Counted, as two answers within a sample of the device leave only the second in the log.
    source = """
jumps = stops = 0

def render(haptics):
    global jumps, stops
    jumps += haptics.jumped and not haptics.stopped
    stops += haptics.stopped
    return [1.0 + jumps, 100.0, 1.0 + stops, 100.0] + [1.0, 100.0] * 6
"""
    connect(client, folder, source, log)
    times_s = [1.5]

    def feed() -> None:
        client.send_haptics("scripted", encode_haptics(times_s[-1], [], playing()))

    def is_played(jumps: int) -> bool:
        rows = [row["values"] for row in rows_of(log) if is_loud(row)]
        return len(rows) > 20 and rows[-1][0] == 1.0 + jumps and rows[-1][2] == 2.0

    wait(client, lambda: is_played(0), feed)  # the same moment again and again
    for jumps, time_s in enumerate((0.5, 1.0), 1):  # earlier, then half a second later
        times_s.append(time_s)
        wait(client, lambda jumps=jumps: is_played(jumps), feed)


def test_limits_come_after_the_script(client: LiveClient, folder: Path, log: Path) -> None:
    source = "def render(haptics):\n    return [1e9, float('nan')] + [1e9, 1e9] * 7\n"
    connect(client, folder, source, log)
    feed_until_loud(client, log)
    for row in filter(is_loud, rows_of(log)):
        assert row["values"][:2] == [0.0, 100.0]  # not a number: silent motor
        assert row["values"][2:] == [15.0, 250.0] * 7


@pytest.mark.parametrize("name", ["hangs", "sleeps"])
def test_a_script_that_does_not_answer_stops_its_device_and_no_other(
    folder: Path, log: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(patient_host.VARIABLE, "2.0")
    live_client = LiveClient()
    try:
        _stops_only_its_device(live_client, folder, log, tmp_path, name)
    finally:
        live_client.close()


@pytest.mark.parametrize("name", [item for item in HOSTILE if item not in ("hangs", "sleeps")])
def test_a_faulty_script_stops_its_device_and_no_other(
    client: LiveClient,
    folder: Path,
    log: Path,
    tmp_path: Path,
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Another version of Python may have approved a script that this version does not compile.
    monkeypatch.setattr(approval, "compiled", lambda *_: None)
    _stops_only_its_device(client, folder, log, tmp_path, name)


def _stops_only_its_device(
    client: LiveClient, folder: Path, log: Path, tmp_path: Path, name: str
) -> None:
    second = tmp_path / "other.jsonl"
    play(client, "other", second)
    connect(client, folder, HOSTILE[name], log)

    def feed() -> None:
        client.send_haptics("scripted", haptics())
        client.send("other", playing())

    wait(client, lambda: client.devices["scripted"].state == "fault", feed)
    assert "script" in client.devices["scripted"].text
    wait(client, lambda: "stop" in rows_of(log)[-1])
    count = len(rows_of(second))
    wait(
        client,
        lambda: len(rows_of(second)) > count + 5 and is_loud(rows_of(second)[-1]),
        feed,
    )
    assert "stop" in rows_of(log)[-1]


def test_messages_name_fault_and_line(client: LiveClient, folder: Path, log: Path) -> None:
    connect(client, folder, "def render(haptics):\n    return 1 / 0\n", log)
    wait(
        client,
        lambda: client.devices["scripted"].state == "fault",
        lambda: client.send_haptics("scripted", haptics()),
    )
    text = client.devices["scripted"].text
    assert "ZeroDivisionError: division by zero (my_band.py, line 2)" in text


def test_a_script_without_its_function_says_so_before_anything_is_asked(
    client: LiveClient, folder: Path, log: Path
) -> None:
    connect(client, folder, "render = 3\n", log)
    wait(client, lambda: client.devices["scripted"].state == "fault")
    assert "my_band.py has no function render(haptics)" in client.devices["scripted"].text


@pytest.mark.parametrize("flood", ["print('x' * 100)", "__import__('os').write(1, b'x' * 100)"])
def test_a_script_that_floods_cannot_reach_the_protocol(
    client: LiveClient, folder: Path, log: Path, flood: str
) -> None:
    source = f"def render(h):\n    for _ in range(500): {flood}\n    return h.values\n"
    connect(client, folder, source, log)
    wait(
        client,
        lambda: sum(map(is_loud, rows_of(log))) > 20,
        lambda: client.send_haptics("scripted", haptics()),
    )
    assert len(client.events()) < 50


def test_after_three_faults_a_script_stays_off(client: LiveClient, folder: Path, log: Path) -> None:
    connect(client, folder, "def render(haptics):\n    raise ValueError('no')\n", log)
    state = client.devices["scripted"]
    for _ in range(3):
        wait(
            client,
            lambda: state.state == "fault",
            lambda: client.send_haptics("scripted", haptics()),
        )
        state.state = "asked"
        client.arm("scripted")
    wait(client, lambda: state.state == "fault")
    assert "stays off" in state.text


def test_a_script_changed_after_approval_is_not_run(
    client: LiveClient, folder: Path, log: Path, tmp_path: Path
) -> None:
    path = folder / "my_band.py"
    path.write_text(HALF)
    script = approval.script_of(NAME, folder)
    assert script is not None
    approval.approve(script)
    path.write_text(f"open({str(tmp_path / 'was_run')!r}, 'w')\n" + HALF)
    client.disconnect("scripted")
    client.connect(
        "scripted", NAME, {"kind": "simulator"}, folder=folder, script=script.as_request()
    )
    wait(client, lambda: client.devices["scripted"].state == "fault")
    assert "has changed since it was approved" in client.devices["scripted"].text
    assert not (tmp_path / "was_run").exists()


@pytest.mark.parametrize("name", ["my_band.py", "../data/my_band.py"])
def test_an_unapproved_script_is_never_run(
    client: LiveClient, folder: Path, tmp_path: Path, name: str
) -> None:
    path, configuration = folder / name, folder / "my_band.json"
    path.parent.resolve().mkdir(exist_ok=True)
    path.write_text(f"open({str(tmp_path / 'was_run')!r}, 'w')\n" + HALF)
    wish = {
        "path": str(path),
        "configuration": str(configuration),
        "fingerprint": approval.fingerprint(path, configuration),
    }
    client.disconnect("scripted")
    client.connect("scripted", NAME, {"kind": "simulator"}, folder=folder, script=wish)
    wait(client, lambda: client.devices["scripted"].state == "fault")
    assert "my_band.py is not approved; read it" in client.devices["scripted"].text
    assert not (tmp_path / "was_run").exists()


def test_no_worker_is_left_behind(client: LiveClient, folder: Path, log: Path) -> None:
    mark = folder / "pid"
    source = f"import os\nopen({str(mark)!r}, 'w').write(str(os.getpid()))\n" + HOSTILE["hangs"]
    connect(client, folder, source, log)
    wait(client, lambda: mark.exists() and mark.read_text())
    os.kill(client.pipe.pid or 0, 9)
    end = time.monotonic() + PATIENCE_S
    while Path(f"/proc/{mark.read_text()}").exists():
        if Path(f"/proc/{mark.read_text()}/stat").read_text().split()[2] == "Z":
            break
        assert time.monotonic() < end, "it lives on"
        time.sleep(0.01)


# Approval


def test_every_changed_byte_asks_again(folder: Path) -> None:
    path, configuration = folder / "my_band.py", folder / "my_band.json"
    path.write_text(HALF)
    first = approval.script_of(NAME, folder)
    assert first is not None and not first.is_approved
    approval.approve(first)
    assert approval.script_of(NAME, folder).is_approved
    for changed in (path, configuration):
        before = changed.read_bytes()
        changed.write_bytes(before + b"\n")
        assert not approval.script_of(NAME, folder).is_approved
        changed.write_bytes(before)
        assert approval.script_of(NAME, folder).is_approved
    approval.revoke(first)
    assert not approval.script_of(NAME, folder).is_approved


def test_another_version_of_the_interface_asks_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "my_band.py").write_text(HALF)
    approval.approve(approval.script_of(NAME, folder))
    monkeypatch.setattr(approval, "API_VERSION", 999)
    assert not approval.script_of(NAME, folder).is_approved


def test_bytes_cannot_move_between_script_and_configuration() -> None:
    assert approval.fingerprint_of(b"ab", b"c") != approval.fingerprint_of(b"a", b"bc")


def test_a_script_changed_during_review_is_not_approved(folder: Path) -> None:
    path = folder / "my_band.py"
    path.write_text(HALF)
    seen = approval.script_of(NAME, folder)
    path.write_text(HALF + "# more\n")
    with pytest.raises(InputError, match="has just changed"):
        approval.approve(seen)


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff", b"{", b'"all"', b"[" * 99999])
def test_a_damaged_list_of_approvals_approves_nothing(folder: Path, content: bytes) -> None:
    (folder / "my_band.py").write_text(HALF)
    resources.approved_scripts().parent.mkdir(parents=True, exist_ok=True)
    resources.approved_scripts().write_bytes(content)
    assert not approval.script_of(NAME, folder).is_approved


def test_a_copy_of_a_shipped_configuration_does_not_make_its_script_shipped(
    folder: Path,
) -> None:
    shutil.copy(resources.device_configs() / "back_pad.json", folder)
    (folder / "back_pad.py").write_text(HALF)
    assert not approval.script_of("back_pad", folder).is_approved


# Input and output of a script.


def run_of(vertices: list[int], weights: list[float]) -> SampleRun:
    return SampleRun(
        stream=Stream("rain", "anna", "wind", "hfx-pressure-1"),
        indices=np.array([0]),
        times_s=np.array([1.5]),
        levels=np.array([0.5]),
        parameters=np.array([[4.0, 0.0, 1.0, 0.0]]),
        offsets=np.array([0, len(vertices)]),
        vertices=np.array(vertices, np.int32),
        weights=np.array(weights, np.float32),
        positions=np.ones((len(vertices), 3), np.float32),
    )


def test_haptic_data_come_through_whole() -> None:
    gains = np.linspace(0.0, 1.0, 8)
    body = encode_haptics(1.5, [(run_of([3, 7], [0.25, 1.0]), gains)], playing())
    actual = decode_haptics(body, DEVICE)
    (effect,) = actual.felt
    assert (actual.time_s, effect.name, effect.modality, effect.level) == (1.5, "rain", "wind", 0.5)
    assert effect.parameters == {
        "speed_m_s": 4.0,
        "direction_x": 0.0,
        "direction_y": 1.0,
        "direction_z": 0.0,
    }
    assert effect.vertices.tolist() == [3, 7]
    assert effect.weights.tolist() == [0.25, 1.0]
    assert effect.gains.tolist() == gains.tolist()
    assert effect.positions.shape == (2, 3)
    assert effect.depth_m is None
    assert actual.values.tolist() == playing().tolist()
    assert actual.strongest("wind") is effect
    assert actual.strongest("pressure") is None


def test_answers_are_columns_or_names_or_nothing() -> None:
    decoded = decode_haptics(haptics(), DEVICE)
    assert as_values(None, decoded).tolist() == [0.0, 100.0] * 8
    assert as_values(tuple(playing(3.0)), decoded).tolist() == [3.0, 100.0] * 8
    by_name = as_values({"m1": 2, "m3": {"frequency_hz": 80}}, decoded)
    assert by_name[:6].tolist() == [2.0, 100.0, 0.0, 100.0, 0.0, 80.0]


@pytest.mark.parametrize(
    "answer", [[1.0], "loud", {"m9": 1}, {"m1": {"colour": 1}}, {"m1": "loud"}, object()]
)
def test_other_answers_are_faults(answer: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        as_values(answer, decode_haptics(haptics(), DEVICE))
