# SPDX-License-Identifier: GPL-3.0-or-later
"""Moments are rendered in a separate process: equal to an export, and silent after a failure."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_time import FakeClock
from fake_worker import FakeWorker
from live_process import BAND, PATIENCE_S, is_loud, rows_of, wait

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.device_thread import Question
from hfx_blender.devices.host.tones import frame_of, of_partials
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.live.host_pipe import Unsent
from hfx_blender.devices.workers import render_process
from hfx_blender.devices.workers.live_frame import (
    LiveFrame,
    RenderedDevice,
    SceneMessage,
    decode_live_frame,
    decode_scene,
    encode_live_frame,
    encode_scene,
)
from hfx_blender.devices.workers.message_bodies import decode_values, encode_arrays
from hfx_blender.devices.workers.render_process import RenderProcess
from hfx_blender.devices.workers.render_worker import Renderers
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.samples import Drive, SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackHeader, TrackModel
from hfx_blender.files import resources
from hfx_blender.processes.messages import (
    EVERY_DEVICE,
    Message,
    MessageError,
    MessageKind,
    encode_json,
    message,
)
from hfx_blender.processes.worker import Worker

MODEL = load_model("hfx-vibration-1")
BODY = "someone"
STREAMS = tuple(Stream(name, BODY, "vibration", MODEL.id) for name in ("low", "high"))
HEADER = TrackHeader(
    time=TimeBase(Fraction(1), Fraction(1), 0, 0, 0),
    models=(TrackModel(MODEL.id, "vibration", MODEL.content_hash, len(MODEL)),),
    bodies=(TrackBody(BODY, "Someone"),),
    effects=tuple(
        TrackEffect(s.effect_id, s.effect_id, "vibration", "volume", MODEL.id) for s in STREAMS
    ),
    streams=STREAMS,
)


def vibration(stream: Stream, amplitude: float, hz: float, **more: object) -> SampleRun:
    """Return a vibration of all skin."""
    count = len(MODEL)
    return SampleRun(
        stream,
        np.zeros(1, np.int64),
        np.zeros(1),
        np.ones(1),
        np.array([[amplitude, hz]]),
        np.array([0, count]),
        np.arange(count, dtype=np.int32),
        np.ones(count, np.float32),
        **more,  # type: ignore[arg-type]
    )


def moment(low: float = 3.0, high: float = 0.0, **more: object) -> LiveFrame:
    runs = [vibration(STREAMS[0], low, 80.0)]
    if high:
        runs.append(vibration(STREAMS[1], high, 250.0))
    return LiveFrame(1.0, runs, **more)  # type: ignore[arg-type]


def places() -> dict[Stream, int]:
    return {stream: k for k, stream in enumerate(STREAMS)}


def worn(
    name: str, number: int = 1, *, folder: Path | None = None, script: bool = False
) -> RenderedDevice:
    return RenderedDevice(number, name, None if folder is None else str(folder), script)


def test_a_scene_and_a_moment_arrive_as_they_were():
    scene = decode_scene(encode_scene(SceneMessage(HEADER, BODY, (worn(BAND),))))
    assert scene.header.streams == STREAMS and scene.devices == (worn(BAND),)
    drive = Drive("band", ("a", "b"), np.float32([[0.5, 0.25]]))
    runs = [
        vibration(STREAMS[0], 3.0, 80.0, positions=np.ones((len(MODEL), 3), np.float32)),
        vibration(STREAMS[1], 2.0, 250.0, focus=np.float32([[1, 2, 3, 4]]), drive=drive),
    ]
    later = {30.0: [vibration(STREAMS[1], 1.0, 90.0)], 100.0: []}
    sent = LiveFrame(2.5, runs, {7: 0.5}, np.eye(4), later)
    live_frame = decode_live_frame(encode_live_frame(sent, places()), STREAMS)
    assert (live_frame.time_s, live_frame.gains) == (2.5, {7: 0.5})
    assert (
        live_frame.play_space is not None and live_frame.play_space.tolist() == np.eye(4).tolist()
    )
    assert [len(live_frame.later[ms]) for ms in (30.0, 100.0)] == [1, 0]
    assert live_frame.later[30.0][0].parameters.tolist() == [[1.0, 90.0]]
    for before, after in zip(runs, live_frame.runs, strict=True):
        assert after.stream == before.stream
        names = "levels parameters offsets vertices weights positions focus"
        for name in names.split():
            first, second = getattr(before, name), getattr(after, name)
            assert (first is None) == (second is None)
            if first is not None:
                assert second.tolist() == first.tolist(), name
    got = live_frame.runs[1].drive
    assert got is not None and (got.device_id, got.actuators) == ("band", ("a", "b"))
    assert got.values.tolist() == [[0.5, 0.25]]
    empty = decode_live_frame(encode_live_frame(LiveFrame(0.0, []), places()), STREAMS)
    assert list(empty.runs) == []


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"nonsense",
        encode_json({}),
        encode_arrays({}, {}),
        encode_arrays({"time_s": 1.0, "later": [1]}, {}),
    ],
)
def test_a_malformed_moment_is_reported(body: bytes) -> None:
    with pytest.raises(MessageError):
        decode_live_frame(body, STREAMS)
    with pytest.raises(MessageError):
        decode_scene(body)


def answered(devices: tuple[RenderedDevice, ...], shown: LiveFrame) -> dict[int, bytes]:
    """Return the bytes of values that a render worker answers to a frame, by device number."""
    renderers = Renderers(SceneMessage(HEADER, BODY, devices))
    assert not renderers.faults
    values_by_device = {}
    for answer in renderers.answers(encode_live_frame(shown, places())):
        length = int.from_bytes(answer[:4], "little")
        values_by_device[int.from_bytes(answer[5:7], "little")] = answer[7:]
        assert len(answer) == 7 + length
    return values_by_device


def test_rendered_values_and_tones_equal_the_engine():
    devices = worn(BAND, 1), worn("mango_pad", 2)
    shown = moment(3.0, 2.0)
    actual = answered(devices, shown)
    for device_config in devices:
        device = load_device(device_config.configuration)
        renderer = MomentRenderer(HEADER, device)
        expected = renderer.values(shown.runs)
        width = sum(a.type.takes_waveform for a in device.actuators)
        tones = of_partials(renderer.tones(), {"low": 0, "high": 1}, width)
        assert expected.any()
        assert len(tones.numbers) == (2 if width else 0)
        assert (
            decode_values(actual[device_config.number]).tolist()
            == frame_of(expected, tones).tolist()
        )


def test_gain_and_mute_are_of_one_device():
    devices = worn(BAND, 1), worn(BAND, 2), worn("mango_pad", 3), worn("mango_pad", 4)
    actual = answered(devices, moment(4.0, gains={2: 0.5, 4: 0.0}))
    whole, half = decode_values(actual[1])[::2], decode_values(actual[2])[::2]
    assert whole.any() and half.tolist() == (0.5 * whole).tolist()
    columns = 2 * len(load_device("mango_pad").actuators)
    assert decode_values(actual[3])[:columns:2].any()
    muted = decode_values(actual[4])
    assert not muted[:columns:2].any()
    assert not muted[columns + 1 : columns + 1 + columns // 2].any()  # strengths of the tone


def test_devices_on_several_bodies_play_the_samples_of_their_wearer():
    other = replace(STREAMS[0], body_id="second")
    header = replace(
        HEADER,
        bodies=(*HEADER.bodies, TrackBody("second", "Somebody else")),
        streams=(*STREAMS, other),
    )
    devices = (
        worn(BAND, 1),
        replace(worn(BAND, 2), body_id="second"),
        replace(worn(BAND, 3), body_id="gone"),
    )
    renderers = Renderers(decode_scene(encode_scene(SceneMessage(header, BODY, devices))))
    # The wearer that the scene lacks is named; the device plays nothing of another body.
    assert len(renderers.faults) == 1 and b"gone" in renderers.faults[0]
    indices = {stream: k for k, stream in enumerate(header.streams)}
    runs = LiveFrame(1.0, [vibration(other, 3.0, 80.0)])
    first, second = renderers.answers(encode_live_frame(runs, indices))
    assert not decode_values(first[7:])[::2].any()
    assert decode_values(second[7:])[::2].max() == pytest.approx(3.0)


def test_late_actuators_get_later_samples(tmp_path: Path) -> None:
    content = json.loads((resources.device_configs() / "mango_pad.json").read_text())
    content["id"] = "late"
    for kind in content["actuator_types"].values():
        kind["latency_ms"] = 30
    (tmp_path / "late.json").write_text(json.dumps(content))
    later = [vibration(STREAMS[1], 2.0, 250.0)]
    device = worn("late", folder=tmp_path)
    now = decode_values(answered((device,), moment(3.0))[1])
    alone = decode_values(answered((device,), LiveFrame(1.0, later))[1])
    ahead = answered((device,), replace(moment(3.0), later={30.0: later}))[1]
    assert decode_values(ahead).tolist() == alone.tolist() != now.tolist()


def test_a_misfit_device_is_reported_and_the_rest_are_rendered(tmp_path: Path) -> None:
    devices = worn("not_there", 1, folder=tmp_path), worn(BAND, 2)
    renderers = Renderers(SceneMessage(HEADER, BODY, devices))
    assert len(renderers.faults) == 1 and b"not_there" in renderers.faults[0]
    assert len(renderers.answers(encode_live_frame(moment(), places()))) == 1


def test_a_device_failing_in_a_moment_is_reported_and_the_rest_are_rendered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    renderers = Renderers(SceneMessage(HEADER, BODY, (worn(BAND, 1), worn(BAND, 2))))

    def broken(*_: object) -> None:
        raise RuntimeError("of somebody's")

    monkeypatch.setattr(renderers.rendered[1].renderer, "ahead", broken)
    first, second = renderers.answers(encode_live_frame(moment(), places()))
    assert first[4] == MessageKind.FAULT and first[7:] == b"of somebody's"
    assert second[4] == MessageKind.ANSWER


def test_the_renderer_ends_with_the_output_process():
    worker = subprocess.Popen(
        [sys.executable, "-m", "hfx_blender.devices.workers.render_worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert worker.stdin is not None and worker.stdout is not None
    with worker.stdout:
        worker.stdin.close()
        assert worker.wait(PATIENCE_S) == 0


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[FakeWorker]:
    """Replace the workers by scripted workers; the newest is the last in the list."""
    return FakeWorker.replace(monkeypatch, render_process)


def test_one_question_at_a_time_and_the_newest_moment_only(played: list[FakeWorker]) -> None:
    process = RenderProcess(lambda *_: None, lambda text: None)
    process.describe(b"scene")
    for content in (b"early", b"newer"):
        process.show(content, {})
    worker = played[-1]
    assert [item.body for item in worker.sent] == [b"scene"]
    worker.says(MessageKind.READY)
    worker.says(MessageKind.READY)
    process.show(b"now", {})
    assert [item.body for item in worker.sent] == [b"scene", b"newer", b"now"]
    process.close()
    assert worker.is_killed
    process.restart()
    assert [item.body for item in played[-1].sent] == [b"scene"] and played[-1] is not worker


def test_nothing_is_rendered_before_a_scene_is_described() -> None:
    worker = Worker("devices.workers.render_worker")
    worker.start()
    try:
        worker.send(message(MessageKind.MOMENT))
        answer = worker.receive(60.0)
        assert answer is not None and answer.kind is MessageKind.READY
        assert answer.body == b""
    finally:
        worker.kill()
        worker.wait()


def loud(log: Path) -> bool:
    rows = rows_of(log)
    return bool(rows) and is_loud(rows[-1])


def follow(client: LiveClient, log: Path) -> None:
    client.connect("band", BAND, {"kind": "simulator", "path": str(log)})
    client.describe(HEADER, BODY)
    wait(client, lambda: loud(log), lambda: client.show(moment()))
    client.events()


def test_a_device_plays_moments_and_a_stop_is_not_followed_by_one(
    client: LiveClient, log: Path
) -> None:
    follow(client, log)
    for _ in range(20):
        client.show(moment())
    client.stop_all()
    for _ in range(20):
        client.show(moment())
        client.heartbeat()
        time.sleep(0.005)
    wait(client, lambda: client.devices["band"].state == "stopped")
    assert "stop" in rows_of(log)[-1]
    client.arm()
    wait(client, lambda: loud(log), lambda: client.show(moment()))


def _worker(client: LiveClient) -> int:
    """Return the process id of the renderer, a child of the output process."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                is_ours = b"render_worker" in (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if parent == client.pipe.pid and is_ours:
                return int(entry.name)
    raise AssertionError("there is none")


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds a child by /proc")
def test_devices_stop_at_the_end_of_the_renderer_and_play_restarts(
    client: LiveClient, log: Path
) -> None:
    follow(client, log)
    before = _worker(client)
    os.kill(before, signal.SIGKILL)
    wait(
        client,
        lambda: client.devices["band"].state == "fault",
        lambda: client.show(moment()),
    )
    assert "has ended" in client.devices["band"].text
    wait(client, lambda: "stop" in rows_of(log)[-1])
    client.arm()
    wait(client, lambda: loud(log), lambda: client.show(moment()))
    assert _worker(client) != before


class RecordingRenderer:
    """Render process with records of messages, answers and faults."""

    def __init__(self) -> None:
        self.told: list[Message] = []
        self.answered: list[Any] = []  # questions with answers
        self.faults: list[str] = []
        self.process = RenderProcess(self._receive, self.faults.append)

    def _receive(self, found: Message, questions: Any) -> None:
        self.told.append(found)
        self.answered.append(questions)

    def until(self, happened: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not happened():
            assert time.monotonic() < end, f"never happened: {self.told} {self.faults}"
            time.sleep(0.002)


@pytest.fixture
def asked() -> Iterator[RecordingRenderer]:
    actual = RecordingRenderer()
    yield actual
    actual.process.close()


def test_each_answer_holds_the_question(asked: RecordingRenderer) -> None:
    asked.process.describe(encode_scene(SceneMessage(HEADER, BODY, (worn(BAND),))))
    for k in range(25):
        asked.process.show(encode_live_frame(moment(), places()), {1: Question(k, 0.0, k)})
        asked.until(lambda k=k: asked.answered and asked.answered[-1][1].generation == k)
    assert [item[1].generation for item in asked.answered] == list(range(25))


@pytest.mark.parametrize("is_forgotten", [False, True])
def test_the_newest_waiting_moment_is_rendered_unless_forgotten(
    is_forgotten: bool, played: list[FakeWorker]
) -> None:
    answered: list[Any] = []
    process = RenderProcess(lambda _, questions: answered.append(questions), lambda text: None)
    process.describe(b"scene")
    worker = played[-1]
    worker.says(MessageKind.READY)
    for k in range(3):
        process.show(b"moment %d" % k, {1: Question(k, 0.0, k)})
    if is_forgotten:
        process.forget()
    for _ in range(3):
        worker.says(MessageKind.ANSWER, b"", 1)
        worker.says(MessageKind.READY)
    bodies = [item.body for item in worker.sent]
    assert bodies == [b"scene", b"moment 0", *([] if is_forgotten else [b"moment 2"])]
    expected = [0] if is_forgotten else [0, 2]
    assert [item[1].generation for item in answered if item][: len(expected)] == expected


def test_a_scene_that_is_none_is_everybodys_fault(asked: RecordingRenderer) -> None:
    asked.process.describe(b"nonsense")
    asked.until(lambda: asked.told)
    assert asked.told[0].kind is MessageKind.FAULT and asked.told[0].device == EVERY_DEVICE


@pytest.mark.parametrize(
    ("kind", "after_s"), [(MessageKind.SCENE, 60.0), (MessageKind.MOMENT, 0.25)]
)
def test_one_that_does_not_answer_in_time_is_ended(
    kind: MessageKind, after_s: float, played: list[FakeWorker]
) -> None:
    clock = FakeClock()
    process = RenderProcess(lambda *_: None, lambda text: None, clock)
    process.describe(b"scene")
    worker = played[-1]
    if kind is MessageKind.MOMENT:
        worker.says(MessageKind.READY)
        process.show(b"moment", {})
    assert worker.sent[-1].kind == kind
    clock.now_s += after_s - 0.001
    assert not process.is_overdue(clock.now())
    clock.now_s += 0.002
    assert process.is_overdue(clock.now()) and worker.is_killed
    assert not process.is_overdue(clock.now())


def test_a_moment_of_too_much_is_silence(client: LiveClient) -> None:
    huge = replace(vibration(STREAMS[0], 1.0, 80.0), weights=np.ones(1 << 23, np.float32))
    stopped: list[str] = []
    pipe = client.pipe
    pipe.silence = lambda _kind, reason: stopped.append(reason)  # type: ignore[assignment]
    assert pipe.encoded(Unsent(LiveFrame(0.0, [huge]), 0, places())) == b""
    assert "cannot be handed over" in stopped[0]
    assert pipe.encoded(Unsent(moment(), 0, {})) == b""  # of the scene before: no fault
    assert len(stopped) == 1
