# SPDX-License-Identifier: GPL-3.0-or-later
"""Approval of device scripts: concurrent approvals, and withdrawal while a script runs."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
from live_process import BAND, is_loud, playing, rows_of, wait

from hfx_blender import cli
from hfx_blender.devices.live import approval
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers.haptics import encode_haptics
from hfx_blender.errors import InputError
from hfx_blender.files import resources

SCRIPT = "def render(haptics):\n    return haptics.values * 0.5\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set up user devices with a script each, without approvals."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data" / "hfx"))
    path = tmp_path / "devices"
    path.mkdir()
    monkeypatch.setenv("HFX_DEVICES", str(path))
    text = (resources.device_configs() / "forearm_band.json").read_text()
    for name in ("one", "two"):
        (path / f"{name}.json").write_text(text.replace('"forearm_band"', f'"{name}"'))
        (path / f"{name}.py").write_text(f"# {name}\n{SCRIPT}")
    return path


def script(name: str) -> approval.DeviceScript:
    device_script = approval.script_of(f"{name}_left")
    assert device_script is not None
    return device_script


def test_a_withdrawal_takes_back_this_approval_only(folder):
    for name in ("one", "two"):
        approval.approve(script(name))
    approval.revoke(script("one"))
    assert not script("one").is_approved and script("two").is_approved


def test_a_withdrawal_covers_approvals_of_other_bytes(folder):
    before = (folder / "one.py").read_text()
    approval.approve(script("one"))
    (folder / "one.py").write_text(before + "# more\n")
    approval.revoke(script("one"))
    (folder / "one.py").write_text(before)
    assert not script("one").is_approved


@pytest.mark.parametrize(
    ("suffix", "content", "fault"),
    [
        (".py", "def render(haptics)\n", "one.py, line 1: is no Python: expected ':'."),
        (".py", "x = 1\0\n", "one.py"),
        (".json", "{", "one.json"),
        (".json", '{"id": "one"}', "one.json"),
    ],
)
def test_a_script_that_cannot_run_is_not_approved(folder, suffix, content, fault):
    (folder / f"one{suffix}").write_text(content)
    with pytest.raises(InputError) as raised:
        approval.approve(script("one"))
    assert fault in str(raised.value) and approval.approved() == {}


def test_concurrent_approvals_lose_nothing(folder):
    text = (folder / "one.json").read_text()
    names = [f"many{k}" for k in range(12)]
    for name in names:
        (folder / f"{name}.json").write_text(text.replace('"one"', f'"{name}"'))
        (folder / f"{name}.py").write_text(f"# {name}\n{SCRIPT}")
    begin = threading.Barrier(len(names))

    def work(name: str) -> None:
        actual = script(name)
        begin.wait()
        approval.approve(actual)

    threads = [threading.Thread(target=work, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(script(name).is_approved for name in names)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b'{"short": "a.py"}', b"[" * 99999])
def test_a_damaged_list_is_reported_and_not_overwritten(folder, content, capsys):
    resources.approved_scripts().parent.mkdir(parents=True, exist_ok=True)
    resources.approved_scripts().write_bytes(content)
    assert str(resources.approved_scripts()) in approval.fault_of_list()
    for work in (approval.approve, approval.revoke):
        with pytest.raises(InputError, match="cannot be read"):
            work(script("one"))
    assert cli.run(["device", "approve", "one_left"]) == 3
    assert cli.run(["device", "scripts"]) == 3
    assert "cannot be read" in capsys.readouterr().err
    assert resources.approved_scripts().read_bytes() == content


@pytest.mark.parametrize("by", ["name", "hash"])
def test_a_script_that_plays_stops_when_its_approval_is_withdrawn(
    folder, log, client: LiveClient, by
):
    """Revoking in another process, such as the command line, silences the running device."""
    approval.approve(script("one"))
    approval.approve(script("two"))
    client.connect(
        "it",
        "one_left",
        {"kind": "simulator", "path": str(log)},
        folder=folder,
        script=script("one").as_request(),
    )
    haptics = encode_haptics(1.5, [], playing())
    wait(
        client,
        lambda: any(map(is_loud, rows_of(log))),
        lambda: client.send_haptics("it", haptics),
    )
    cli.run(["device", "revoke", "two_left"])  # another device's approval: the device plays on
    count = len(rows_of(log))
    wait(
        client,
        lambda: any(map(is_loud, rows_of(log)[count:])),
        lambda: client.send_haptics("it", haptics),
    )
    named = "one_left" if by == "name" else script("one").fingerprint[:12]
    assert cli.run(["device", "revoke", named]) == 0
    wait(client, lambda: "withdrawn" in client.devices["it"].text)
    assert not client.devices["it"].is_armed
    assert not is_loud(rows_of(log)[-1])
    client.arm("it")
    wait(client, lambda: any("withdrawn" in event.text for event in client.events()))
    assert not client.devices["it"].is_armed


# The command line


def hfx(capsys, *arguments: str) -> tuple[int, str, str]:
    code = cli.run(["device", *arguments])
    return code, *capsys.readouterr()


def test_the_command_line_shows_approves_lists_and_withdraws(folder, capsys):
    mark = script("one").fingerprint
    _, out, _ = hfx(capsys, "scripts")
    assert out.count("not approved") == 2 and mark in out
    code, out, _ = hfx(capsys, "approve", "one_left")
    assert code == 0 and str(folder / "one.py") in out and mark in out
    assert script("one").is_approved and not script("two").is_approved
    listed = json.loads(hfx(capsys, "scripts", "--json")[1])["scripts"]
    assert {item["hash"]: item["is_approved"] for item in listed} == {
        mark: True,
        script("two").fingerprint: False,
    }
    assert hfx(capsys, "revoke", "one_left")[0] == 0
    assert not script("one").is_approved


def test_an_approval_whose_files_are_gone_is_withdrawn_by_its_hash(folder, capsys):
    approval.approve(script("one"))
    mark = script("one").fingerprint
    for suffix in (".py", ".json"):
        (folder / f"one{suffix}").unlink()
    assert "gone" in hfx(capsys, "scripts")[1]
    assert hfx(capsys, "revoke", mark)[0] == 0
    assert approval.approved() == {}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("approve", "nobody"), "unknown"),
        (("approve", BAND), "has no script"),
        (("revoke", "nobody"), "unknown"),
        (("revoke", "0" * 64), "unknown"),
        (("approve", "one_left", "--hash", "0" * 64), "read it again"),
    ],
)
def test_a_failed_approval_or_withdrawal_is_reported_in_one_line(
    folder, capsys, arguments, message
):
    code, _, err = hfx(capsys, *arguments)
    assert code == 3 and message in err and err.count("\n") == 1
    assert approval.approved() == {}
