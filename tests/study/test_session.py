# SPDX-License-Identifier: GPL-3.0-or-later
"""Sessions: answers on the disk after each trial, kills, stops, pauses, the page and the port."""

from __future__ import annotations

import http.client
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from study_doubles import eager, make, session_of
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hfx_blender.errors import InputError, UsageError
from hfx_tools.study.answers import AnswerFile
from hfx_tools.study.folder import Study
from hfx_tools.study.page_server import PagePresenter
from hfx_tools.study.session import event_columns
from hfx_tools.study.tables import read_table

PAIRED = {
    "name": "pairs",
    "design": "paired",
    "factors": {"duration_ms": [50, 60]},
    "compare": {"strength": [0.25, 0.5, 0.75]},
    "training": 2,
    "breaks_every": 5,
}


def test_all_trials_of_a_session_are_answered_and_stored(tmp_path: Path) -> None:
    study = make(tmp_path, PAIRED)
    session, player, observer, answers = session_of(study)
    with answers:
        assert not session.is_complete
        assert session.run()
    rows = read_table(study.data_file("01"), event_columns(study.plan))
    assert [row["trial_type"] for row in rows] == ["training"] * 2 + ["trial"] * 12
    listed = read_table(study.folder / "participant-01" / "trials.tsv")
    for row, trial in zip(rows[2:], listed, strict=True):
        names = ("trial", "duration_ms", "strength_first", "strength_second")
        assert [row[name] for name in names] == [trial[name] for name in names]
        assert row["response"] == "first" and row["correct"] == "n/a"
    strengths = [stimulus.values[0, 0] for stimulus in player.played[4:6]]
    shares = [float(listed[0][f"strength_{side}"]) for side in ("first", "second")]
    assert strengths[0] / strengths[1] == pytest.approx(shares[0] / shares[1])
    onsets = [float(row["onset"]) for row in rows]
    assert onsets == sorted(onsets)
    texts = [screen for screen in observer.screens if screen["kind"] == "text"]
    assert len(texts) == 4  # welcome, end of the training, breaks after 5 and 10 trials


def test_a_stop_ends_at_once_and_the_next_session_continues(tmp_path: Path) -> None:
    study = make(tmp_path, PAIRED)
    seen = []

    def stop_at_the_fifth(screen: Any) -> Any:
        seen.append(screen["kind"])
        return {"type": "stop"} if seen.count("choice") == 5 else eager(screen)

    session, player, _, answers = session_of(study, stop_at_the_fifth)
    with answers:
        assert not session.run()
    assert player.stops == ["stopped by the participant"]
    assert len(read_table(study.data_file("01"))) == 4
    session, _, _, answers = session_of(study)
    with answers:
        assert session.run() and session.is_complete
    rows = read_table(study.data_file("01"))
    assert [row["trial"] for row in rows] == ["1", "2", *map(str, range(1, 13))]
    assert [row["session"] for row in rows] == ["1"] * 4 + ["2"] * 10


def test_a_pause_begins_the_trial_again(tmp_path: Path) -> None:
    study = make(tmp_path, PAIRED | {"training": 0})
    kinds = []

    def pause_once(screen: Any) -> Any:
        kinds.append(screen["kind"])
        is_second = screen["kind"] == "choice" and kinds.count("choice") == 2
        return {"type": "pause"} if is_second else eager(screen)

    session, player, observer, answers = session_of(study, pause_once)
    with answers:
        assert session.run()
    assert len(player.played) == 2 * 13
    assert player.played[2:4] == player.played[4:6]
    assert any("Paused" in screen.get("text", "") for screen in observer.screens)
    assert len(read_table(study.data_file("01"))) == 12


def test_each_design_stores_its_answers(tmp_path: Path) -> None:
    levels = {"strength": [0.1, 0.2, 0.4]}
    short = {"stimulus": {"duration_ms": 50}, "questionnaire": "nasa-tlx"}
    rating = {"scales": [{"id": "calm", "text": "Calm?"}, {"id": "loud", "text": "Loud?"}]}
    designs: dict[str, dict[str, Any]] = {
        "2afc": {"levels": levels},
        "staircase": {"levels": levels, "trials": 6},
        "adjustment": {"adjust": levels},
        "rating": {**rating, "factors": {"strength": [0.1, 0.2]}},
        "identification": {"identify": "strength", "factors": {"strength": [0.1, 0.2, 0.4]}},
    }
    for design, members in designs.items():
        study = make(tmp_path / design, {"name": "p", "design": design, **short, **members})
        session, _, observer, answers = session_of(study)
        with answers:
            assert session.run(), design
        rows = read_table(study.data_file("01"))
        trials = [row for row in rows if row["trial_type"] == "trial"]
        assert len(rows) == len(trials) + 6
        assert [row["score"] for row in rows[-6:]] == ["0"] * 6
        if design in ("2afc", "staircase"):
            assert all(row["correct"] == str(int(row["target"] == "first")) for row in trials)
        if design == "staircase":
            assert {row["strength"] for row in trials} <= {"0.1", "0.2", "0.4"}
        if design == "adjustment":
            assert [row["response"] for row in trials] == [row["start"] for row in trials]
        if design == "rating":
            assert [row["rating_calm"] + row["rating_loud"] for row in trials] == ["11", "11"]
        if design == "identification":
            assert sum(int(row["correct"]) for row in trials) == 1
            choices = [s["choices"] for s in observer.screens if s["kind"] == "choice"]
            assert choices == [["0.1", "0.2", "0.4"]] * 3


def test_an_adjustment_moves_by_levels_and_stays_within_them(tmp_path: Path) -> None:
    plan = {"name": "p", "design": "adjustment", "adjust": {"strength": [0.1, 0.2, 0.4]}}
    study = make(tmp_path, plan)
    start = read_table(study.folder / "participant-01" / "trials.tsv")[0]["start"]
    away, back = ("up", "down") if start == "0.1" else ("down", "up")
    moves = iter([away, away, away, back, "again", "next"])

    def move(screen: Any) -> Any:
        return eager(screen)

    session, player, observer, answers = session_of(study, move)
    pending: list[Any] = []

    def inputs() -> list[Any]:
        if observer.screens[-1]["kind"] != "adjust":
            return [eager(observer.screens[-1])]
        # One input after each stimulus.
        if len(pending) < len(player.played):
            pending.append(next(moves))
            return [{"type": pending[-1]}]
        return []

    observer.inputs = inputs  # type: ignore[method-assign]
    with answers:
        assert session.run()
    (row,) = read_table(study.data_file("01"))
    assert (row["response"], row["changes"]) == ("0.2", "4")
    assert len(player.played) == 6


_KILLED = """
import sys
sys.path[:0] = {paths!r}
from contextlib import suppress
from pathlib import Path
from study_doubles import session_of
from hfx_tools.study.folder import Study
session, player, observer, answers = session_of(Study(Path({folder!r})))
print("running", flush=True)
with answers:
    session.run()
print("complete", flush=True)
"""


def test_a_kill_loses_at_most_the_running_trial(tmp_path: Path) -> None:
    study = make(tmp_path, PAIRED | {"repetitions": 25})
    folder = str(study.folder)
    path = study.data_file("01")
    code = _KILLED.format(paths=[str(Path(__file__).parent)], folder=folder)
    rng, begun = random.Random(5), []
    for _ in range(5):
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]
        )
        assert process.stdout is not None and process.stdout.readline() == b"running\n"
        before = path.read_bytes()
        while len(path.read_bytes()) < len(before) + rng.randrange(1, 600):
            if process.poll() is not None:
                break
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        begun.append(path.read_bytes())
        assert begun[-1].startswith(before)
    session, _, _, answers = session_of(Study(study.folder))
    with answers:
        assert session.run()
    rows = read_table(path)
    trials = [row["trial"] for row in rows if row["trial_type"] == "trial"]
    assert trials == [str(k) for k in range(1, 301)]  # none is lost, none stands twice
    assert len({row["session"] for row in rows}) >= 2


def test_an_incomplete_last_line_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "sub-01" / "beh" / "a.tsv"
    columns = ["onset", "session", "trial"]
    with AnswerFile(path, columns) as answers:
        answers.append({"onset": 1.5, "session": 1, "trial": 1})
    complete = path.read_bytes()
    path.write_bytes(complete + b"2.5\t1")
    with AnswerFile(path, columns) as answers:
        assert answers.rows == [{"onset": "1.5", "session": "1", "trial": "1"}]
        with pytest.raises(UsageError, match="another session"):
            AnswerFile(path, columns)
    assert path.read_bytes() == complete
    with pytest.raises(InputError, match="no column 'score'"):
        AnswerFile(path, [*columns, "score"])
    path.write_bytes(complete.replace(b"1.5", b"one"))
    with pytest.raises(InputError, match="line 2: onset is 'one', allowed is a number"):
        AnswerFile(path, columns)


def _screens(address: str, stop_after: int | None = None) -> list[dict[str, Any]]:
    """Answer a session's page like a participant; returns its screens."""
    host = address.removeprefix("http://").split("/")[0]
    screens = []
    socket = connect(address.replace("http", "ws") + "/answers", origin=f"http://{host}")  # type: ignore[arg-type]
    with socket:
        try:
            for message in socket:
                screen = json.loads(message)
                screens.append(screen)
                if screen["kind"] in ("text", "choice", "scale", "adjust"):
                    socket.send(json.dumps(eager(screen)))
                if len(screens) == stop_after:
                    socket.send(json.dumps({"type": "stop"}))
        except ConnectionClosed:
            pass
    return screens


def _run(
    folder: Path, *options: str, device: str = "back_pad"
) -> tuple[subprocess.Popen[str], str]:
    """Start ``hfx study run``; returns the process and the address of its page."""
    command = [sys.executable, "-m", "hfx_blender", "study", "run", str(folder), "--no-browser"]
    process = subprocess.Popen(
        [*command, "--device", device, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    address = re.search(r"http://\S+", line)
    assert address is not None, line
    return process, address[0]


@pytest.fixture
def blind_study(tmp_path: Path) -> Study:
    """Study whose conditions have conspicuous names."""
    for name in ("zebra", "giraffe"):
        (tmp_path / f"{name}.csv").write_bytes(b"")
    return make(
        tmp_path,
        {
            "name": "blind",
            "title": "giraffe against zebra",
            "design": "paired",
            "factors": {"duration_ms": [30], "frequency_hz": [101, 202]},
            "compare": {"scheme": ["nearest", "vbap"]},
            "stimulus": {"kind": "line"},
            "random": {"direction": ["NE", "SW"]},
            "gap_ms": 10,
        },
    )


def test_a_session_on_a_simulator_shows_no_condition(blind_study: Study, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    process, address = _run(blind_study.folder, "--to", "simulator", "--path", str(log))
    with urllib.request.urlopen(address) as page:
        html = page.read().decode()
    screens = _screens(address)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 0 and "4 answers, complete" in output
    assert screens[-1]["kind"] == "end"
    # Neither page, screens nor names of files hold a condition.
    shown = html + json.dumps(screens) + " ".join(p.name for p in blind_study.folder.rglob("*.csv"))
    for condition in ("nearest", "vbap", "giraffe", "zebra", "SW"):
        assert condition not in shown
    assert not re.search("101|202", json.dumps(screens))
    values = [json.loads(line) for line in log.read_text().splitlines()]
    strong = [k for k, line in enumerate(values) if any(v > 0 for v in line.get("values", [])[::2])]
    onsets = [k for k in strong if k - 1 not in strong]
    assert len(onsets) >= 4  # stimuli reached the port; on a busy computer two may join
    assert values[-1].get("stop")
    sidecar = json.loads(blind_study.data_file("01", "_events.json").read_text())
    assert sidecar["Sessions"][0]["Output"] == "simulator"
    assert set(sidecar["Sessions"][0]["StimulusHashes"]) == {
        path.name for path in (blind_study.folder / "stimuli").glob("*.csv")
    }
    assert read_table(blind_study.folder / "participants.tsv") == [{"participant_id": "sub-01"}]


def test_the_page_stops_a_session(blind_study: Study) -> None:
    process, address = _run(blind_study.folder, "--to", "simulator")
    with pytest.raises(urllib.error.HTTPError):
        urllib.request.urlopen(address.rsplit("/", 1)[0] + "/")
    foreign = address.replace("http", "ws") + "/answers"
    with pytest.raises(InvalidStatus), connect(foreign, origin="http://example.org"):  # type: ignore[arg-type]
        pass
    screens = _screens(address, stop_after=6)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 0 and "stopped; the same command continues" in output
    assert screens[-1] == {"kind": "end", "text": "The session was stopped."}


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on Windows")
def test_an_unplugged_device_ends_the_session_and_answers_stay(
    blind_study: Study, tmp_path: Path
) -> None:
    import tty

    from hfx_blender.files import resources

    document = json.loads((resources.device_configs() / "waist_belt.json").read_text())
    document["output"] = {
        "encoder": {
            "kind": "text",
            "full_scale": 1000,
            "start": "m ",
            "separator": " ",
            "stop": "off",
        },
        "transport": {"kind": "serial", "baud": 115200},
    }
    device = tmp_path / "belt.json"
    device.write_text(json.dumps(document))
    ends = os.openpty()
    tty.setraw(ends[1])
    process, address = _run(blind_study.folder, "--port", os.ttyname(ends[1]), device=str(device))
    host = address.removeprefix("http://").split("/")[0]
    socket = connect(address.replace("http", "ws") + "/answers", origin=f"http://{host}")  # type: ignore[arg-type]
    with socket:
        screens = []
        for message in socket:
            screens.append(json.loads(message))
            if [screen["kind"] for screen in screens].count("choice") == 3:
                for descriptor in ends:
                    os.close(descriptor)
                break
            if screens[-1]["kind"] in ("text", "choice"):
                socket.send(json.dumps(eager(screens[-1])))
        rest = [json.loads(message) for message in socket]
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 4 and "belt" in output
    assert rest[-1]["kind"] == "end" and "A device failed" in rest[-1]["text"]
    assert len(read_table(blind_study.data_file("01"))) == 2


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no SIGSTOP on Windows")
def test_a_standstill_of_the_computer_repeats_the_trial(blind_study: Study, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    process, address = _run(blind_study.folder, "--to", "simulator", "--path", str(log))
    host = address.removeprefix("http://").split("/")[0]
    socket = connect(address.replace("http", "ws") + "/answers", origin=f"http://{host}")  # type: ignore[arg-type]
    texts, choices = [], 0
    with socket, suppress(ConnectionClosed):
        for message in socket:
            screen = json.loads(message)
            if screen["kind"] == "text":
                texts.append(screen["text"])
            choices += screen["kind"] == "choice"
            if choices == 2:  # 250 ms without a sign of life freeze the devices
                process.send_signal(signal.SIGSTOP)
                time.sleep(0.8)
                process.send_signal(signal.SIGCONT)
                choices += 1
            if screen["kind"] in ("text", "choice"):
                socket.send(json.dumps(eager(screen)))
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    assert [text for text in texts if "stood still" in text]
    trials = read_table(blind_study.data_file("01"))
    assert [row["trial"] for row in trials] == ["1", "2", "3", "4"]


def test_a_device_without_an_output_is_refused(blind_study: Study) -> None:
    from hfx_blender.cli import run

    assert run(["study", "run", str(blind_study.folder), "--device", "back_pad"]) == 4


def test_other_origins_and_names_cannot_take_the_page() -> None:
    presenter = PagePresenter()
    try:
        host, token = presenter.address.removeprefix("http://").split("/")
        answers = []
        for path, name in ((f"/{token}", host), ("/", host), (f"/{token}", "evil.example")):
            client = http.client.HTTPConnection(host, timeout=3)
            client.request("GET", path, headers={"Host": name})
            answers.append(client.getresponse())
        assert [answer.status for answer in answers] == [200, 404, 421]
        assert answers[0].headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert b"<script" in answers[0].read()
    finally:
        presenter.close()


def test_a_page_that_connects_later_gets_the_present_screen() -> None:
    presenter = PagePresenter()
    try:
        presenter.show({"kind": "text", "text": "Hello"})
        host = presenter.address.removeprefix("http://").split("/")[0]
        address = presenter.address.replace("http", "ws") + "/answers"
        with connect(address, origin=f"http://{host}") as socket:  # type: ignore[arg-type]
            assert [json.loads(socket.recv())["kind"] for _ in range(2)] == ["settings", "text"]
            for message in ('{"type": "next"}', "{", "[]", '{"type": "format"}'):
                socket.send(message)
        until_s = time.monotonic() + 5.0
        inputs: list[Any] = []
        while len(inputs) < 2 and time.monotonic() < until_s:
            inputs += presenter.inputs()
            time.sleep(0.01)
        assert inputs == [{"type": "next"}, {"type": "left"}]
    finally:
        presenter.close()
