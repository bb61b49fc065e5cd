# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a device on a tracked body: factors, fade of a lost sender, and one-sentence faults."""

from __future__ import annotations

import csv
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.cli import run
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model, load_skeleton
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    Clip,
    EffectBlock,
    EffectDescription,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.track import TrackHeader, TrackReader
from hfx_blender.errors import HfxError, InputError, UsageError
from hfx_blender.formats.clip.clip_writer import write
from hfx_blender.formats.clip.spatial_recorder import SpatialRecorder
from hfx_blender.tracking.osc_packets import OscMessage
from hfx_blender.tracking.receiver import OscReceiver, ReceivedMessage
from hfx_tools.commands import feel
from hfx_tools.live_body import player_core
from hfx_tools.live_body.felt_bodies import FeltBodies, placed
from hfx_tools.live_body.live_values import LiveValues
from hfx_tools.live_body.triggered_parts import TriggeredParts, strongest

HIPS = OscMessage("/VMC/Ext/Bone/Pos", ("Hips", *[0.0] * 6, 1.0))
SILENT = [0.0, 160.0, 0.0, 160.0]


class Stage:
    """Bodies of a clip with messages and a clock of the test."""

    def __init__(self, clip: Path, device: str = "oculus_touch", port: str = "") -> None:
        self.now_s = 100.0
        self.news: list[str] = []
        self.sent: dict[str, Any] = {}
        self.pose, self.control = _Messages(), _Messages()
        self.values = LiveValues(self.control)  # type: ignore[arg-type]
        devices = {device: load_device(device)}
        ports: dict[str, OscReceiver] = {port: self.pose}  # type: ignore[dict-item]
        self.bodies = FeltBodies(
            clip, devices, ports, self.values, self.news.append, clock=lambda: self.now_s
        )

    def send(self, name: str, values: Any) -> None:
        self.sent[name] = values

    def step(self, seconds: float = 0.01, *, poses: bool = False, **changes: float) -> list[float]:
        """Step once and return the values of each controller; keywords change the clip's effect."""
        self.now_s += seconds
        if poses:
            self.pose.waiting = [ReceivedMessage(HIPS, self.now_s)]
        for parameter, value in changes.items():
            address = f"/hfx/effect/Hit%20%231/{parameter}"
            if parameter in ("gain", "all_mute"):
                address = f"/hfx/{parameter.removeprefix('all_')}"
            message = OscMessage(address, (value,))
            self.control.waiting.append(ReceivedMessage(message, self.now_s))
        self.bodies.show(self, self.now_s)  # type: ignore[arg-type]
        return [round(value, 6) for value in self.sent["oculus_touch"].tolist()]


class _Messages:
    """Stand-in for a receiver."""

    port = 1
    second: tuple[str, int] | None = None

    def __init__(self) -> None:
        self.waiting: list[ReceivedMessage] = []

    def take(self) -> list[ReceivedMessage]:
        messages, self.waiting = self.waiting, []
        return messages


def test_a_sender_without_tracking_fades_and_comes_back(clip: Path) -> None:
    stage = Stage(clip)
    assert stage.step(poses=True, intensity=0.8)[0] == 4.8
    without = [ReceivedMessage(OscMessage("/VMC/Ext/OK", (0,)), stage.now_s)]
    # Poses go on, as of a program whose model is being changed.
    for k in range(210):
        if not k:
            stage.pose.waiting = without
        else:
            stage.pose.waiting = [ReceivedMessage(HIPS, stage.now_s)]
        values = stage.step()
    assert values == SILENT
    assert stage.news[-1] == "body 'Anna' has no tracking and fades to silence"
    stage.pose.waiting = [ReceivedMessage(OscMessage("/VMC/Ext/OK", (1,)), stage.now_s)]
    stage.step()
    assert stage.step(poses=True)[0] == 4.8


def test_poses_in_centimetres_and_a_second_sender_are_named_once(clip: Path) -> None:
    stage = Stage(clip)
    tall = OscMessage("/VMC/Ext/Bone/Pos", ("Hips", 0.0, 95.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    stage.pose.second = ("127.0.0.1", 4000)
    for _ in range(3):
        stage.pose.waiting = [ReceivedMessage(tall, stage.now_s)]
        stage.step()
    assert stage.news == [
        "body 'Anna' has a bone of 95 m: VMC has metres, set the sender's scale",
        "port 1 gets a second program's poses, from 127.0.0.1 port 4000: these are ignored",
        "body 'Anna' is tracked",
    ]


def test_a_parameter_out_of_its_range_changes_nothing(clip: Path) -> None:
    stage = Stage(clip)
    assert stage.step(poses=True, intensity=0.8, amplitude_m_s2=6.0)[0] == 2.4
    for value in (-5.0, 1e5, float("nan")):
        assert stage.step(poses=True, amplitude_m_s2=value)[0] == 2.4
    assert stage.values.ignored == 3


def test_values_follow_factors_gain_and_mutes(clip: Path) -> None:
    stage = Stage(clip)
    assert stage.step(intensity=0.8) == SILENT, "nobody is tracked"
    # Weight 0.5 * factor 0.8 * 12 m/s^2 = 4.8; the motor has 160 Hz only.
    assert stage.step(poses=True) == [4.8, 160.0, 0.0, 160.0]
    assert stage.step(gain=0.5) == [2.4, 160.0, 0.0, 160.0]
    assert stage.step(all_mute=1.0) == SILENT
    assert stage.step(all_mute=0.0, gain=1.0) == [4.8, 160.0, 0.0, 160.0]
    assert stage.step(mute=1.0) == SILENT
    # 0.5 * 0.8 * 6 m/s^2 = 2.4.
    assert stage.step(mute=0.0, amplitude_m_s2=6.0) == [2.4, 160.0, 0.0, 160.0]
    assert stage.step(intensity=float("nan")) == [2.4, 160.0, 0.0, 160.0]
    assert stage.values.ignored == 1


def test_a_lost_sender_fades_within_two_seconds_and_comes_back(clip: Path) -> None:
    stage = Stage(clip)
    stage.step(poses=True, intensity=0.8)
    assert stage.step(0.5) == [4.8, 160.0, 0.0, 160.0]
    # 0.7 s after the half second, of a fade of 1.4 s: a half.
    assert stage.step(0.7) == [2.4, 160.0, 0.0, 160.0]
    assert stage.step(0.7) == SILENT
    assert stage.step(10.0) == SILENT
    assert stage.step(poses=True) == [4.8, 160.0, 0.0, 160.0]
    assert stage.news == [
        "body 'Anna' is tracked",
        "body 'Anna' lost its sender and fades to silence",
        "body 'Anna' is tracked",
    ]


def test_two_devices_are_on_two_tracked_bodies(tmp_path: Path) -> None:
    """A clip has the values of each device on each of its bodies, in the order of the bodies."""
    belts = {n: replace(load_device("oculus_touch"), id=n) for n in ("belt_a", "belt_b")}
    model = load_model("hfx-vibration-1")
    area = PaintedArea("a", np.array([0], np.int32), np.ones(1, np.float32))
    names = {"a": "Anna", "b": "Ben", "c": "Carl"}
    binding = SkinBinding(load_skeleton().bone_names)
    scene = SceneDescription(
        TimeBase(Fraction(50), Fraction(50), 0, 0, 1),
        tuple(BodyDescription(body, name, binding) for body, name in names.items()),
        (EffectDescription("e", "Hit", "vibration", model.id, area),),
    )
    still = PoseBlock(np.ones(2, np.bool_), np.tile(np.eye(4), (2, 1, 1)))
    recorder = SpatialRecorder(scene)
    block = EffectBlock(np.ones(2), np.tile([12.0, 160.0], (2, 1)))
    recorder.add(AnimationBlock(np.arange(2), (block,), (still,) * 3))
    header = TrackHeader.of(scene, {model.id: model}, settings={}, tools={})
    played = [(d, render(header, [], d, body_id=b)) for b in names for d in belts.values()]
    (path,) = write(header, played, tmp_path / "x", recorder).files

    def wearers(*bodies: str, devices: tuple[str, ...] = ("belt_a", "belt_b")) -> list[str]:
        ports: dict[str, OscReceiver] = {body: _Messages() for body in bodies}  # type: ignore[misc]
        worn = {name: belts[name] for name in devices}
        source = FeltBodies(path, worn, ports, LiveValues(), lambda text: None)
        return list(source.bodies)

    assert wearers("Anna", "Ben") == ["Anna", "Ben"]
    assert wearers("Carl", "Ben") == ["Ben", "Carl"]
    assert wearers("Ben") == ["Ben"], "both devices on the only tracked body"
    assert wearers("Ben", "Carl", devices=("belt_b",)) == ["Ben"]


def test_a_volume_is_placed_turned_and_scaled() -> None:
    # Half edges 1, 2, 3 at (5, 6, 7).
    matrix = np.column_stack([np.diag([1.0, 2.0, 3.0]), [5.0, 6.0, 7.0]])
    quarter = np.pi / 2
    assert placed(matrix, location=(0.0, 0.0, 1.0))[:, 3].tolist() == [0.0, 0.0, 1.0]
    assert placed(matrix, scale=(2.0, 1.0, 1.0))[:, 0].tolist() == [2.0, 0.0, 0.0]
    # About X takes Z to -Y; then about Z takes -Y to X.
    turned = placed(matrix, rotation_euler=(quarter, 0.0, quarter))
    assert turned[:, 2] == pytest.approx([3.0, 0.0, 0.0], abs=1e-12)
    assert turned[:, 3].tolist() == [5.0, 6.0, 7.0]


def test_a_vector_moves_the_volume_of_the_core(clip: Path) -> None:
    stage, moved = Stage(clip), {}
    for body in stage.bodies.bodies.values():
        body.core.set_volume = lambda k, matrix: moved.update({k: matrix[:, 3].tolist()})  # type: ignore[method-assign]
    message = OscMessage("/hfx/effect/Hit%20%231/location", (1.0, 2.0, 3.0))
    stage.control.waiting.append(ReceivedMessage(message, 0.0))
    stage.step()
    assert moved == {0: [1.0, 2.0, 3.0]}


def test_a_triggered_part_is_the_stronger_value_of_an_actuator() -> None:
    device = load_device("oculus_touch")
    rows = [np.array([1.0, 160.0, 5.0, 160.0]), np.array([2.0, 90.0, 4.0, 70.0])]
    assert strongest(rows, device).tolist() == [2.0, 90.0, 5.0, 160.0]


def named_clip(folder: Path) -> Path:
    """Clip of 16 rows, 20 a second from 1 s on, whose left controller has as many m/s^2 as the
    row's number; rows 4 to 7 are named Strike."""
    device = load_device("oculus_touch")
    model = load_model("hfx-vibration-1")
    area = PaintedArea("b", np.array([0], np.int32), np.ones(1, np.float32))
    scene = SceneDescription(
        TimeBase(Fraction(20), Fraction(20), 0, 20, 35),
        (BodyDescription("b", "Anna", SkinBinding(load_skeleton().bone_names)),),
        (EffectDescription("e", "Hit", "vibration", model.id, area),),
    )
    header = TrackHeader.of(scene, {model.id: model}, settings={}, tools={})
    effect = replace(header.effects[0], clips=(Clip("Strike", 24.0, 27.0),))
    values = np.tile(device.neutral, (16, 1))
    values[:, 0] = range(16)
    raster = replace(render(header, [], device), values=values)
    (path,) = write(replace(header, effects=(effect,)), [(device, raster)], folder / "n").files
    return path


def test_a_part_of_the_clip_plays_once_from_its_trigger(tmp_path: Path) -> None:
    """The scene has 0.8 s of 20 rows a second; the part "Strike" is 0.2 to 0.4 s."""
    device = load_device("oculus_touch")
    path = named_clip(tmp_path)
    parts = TriggeredParts(path, {"pad": (device, None)})
    assert parts.update(["Strike", "Nothing"], 50.0) == ["Nothing"]
    assert parts.update(["Nothing"], 50.0) == []  # said before
    shown = []
    for step in range(5):
        parts.update([], 50.0 + 0.05 * step)
        shown.append([row[0] for row in parts.values("pad", 50.0 + 0.05 * step)])
    # Rows 4 to 7 have 4, 5, 6, 7 m/s^2; then the part is over.
    assert shown[:4] == [[pytest.approx(x, abs=1e-3)] for x in (4.0, 5.0, 6.0, 7.0)]
    assert shown[4] == []


def test_a_flood_of_unknown_parts_is_twenty_sentences(tmp_path: Path) -> None:
    parts = TriggeredParts(named_clip(tmp_path), {"pad": (load_device("oculus_touch"), None)})
    sentences = [parts.update([f"part {k}", f"part {k + 1}"], 50.0) for k in range(0, 100, 2)]
    assert sum(map(len, sentences)) == 20


def test_faults_are_one_sentence(clip: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no body 'Ben'|no values for 'oculus_touch' on 'Ben'"):
        Stage(clip, port="Ben")
    with pytest.raises(InputError, match="it has no values for 'insoles'"):
        Stage(clip, "insoles")
    device = load_device("oculus_touch")
    focus = replace(device.actuators[0].type.controls[0], name="focus_x", unit="m")
    kind = replace(device.actuators[0].type, controls=(*device.actuators[0].type.controls, focus))
    actuators = tuple(replace(actuator, type=kind) for actuator in device.actuators)
    with pytest.raises(InputError, match="no custom columns, such as 'focus_x' of 'oculus_touch'"):
        FeltBodies(
            clip,
            {"oculus_touch": replace(device, actuators=actuators)},
            {"": _Messages()},  # type: ignore[dict-item]
            LiveValues(),
            print,
        )
    damaged = tmp_path / "damaged.hfxclip"
    damaged.write_bytes(clip.read_bytes()[:-4])
    with pytest.raises(InputError, match="damaged"):
        Stage(damaged)
    with pytest.raises(HfxError, match=r"core of the players cannot be loaded .*install"):
        player_core.load(tmp_path / "missing.so")


@pytest.fixture
def sender() -> Iterator[Any]:
    """Send the hips 60 times a second until the end of the test, from python-osc's builder."""
    ended = threading.Event()

    def send(port: int) -> None:
        builder = OscMessageBuilder("/VMC/Ext/Bone/Pos")
        builder.add_arg("Hips")
        for number in (0.0, 0.95, 0.0, 0.0, 0.0, 0.0, 1.0):
            builder.add_arg(number, "f")
        intensity = OscMessageBuilder("/hfx/effect/Hit%20%231/intensity")
        intensity.add_arg(0.8, "f")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outgoing:
            while not ended.wait(1 / 60):
                outgoing.sendto(builder.build().dgram, ("127.0.0.1", port))
                outgoing.sendto(intensity.build().dgram, ("127.0.0.1", port + 1))

    threads: list[threading.Thread] = []

    def start(port: int) -> None:
        threads.append(threading.Thread(target=send, args=(port,)))
        threads[-1].start()

    yield start
    ended.set()
    for thread in threads:
        thread.join()


def test_the_command_feels_and_records(
    clip: Path, tmp_path: Path, sender: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_ports()
    sender(port)
    arguments = ["feel", str(clip), "--device", "oculus_touch", "--to", "log"]
    arguments += ["--path", str(tmp_path / "log.csv"), "--record", str(tmp_path / "felt.csv")]
    arguments += ["--vmc", str(port), "--osc", str(port + 1), "--seconds", "1.5", "--json"]
    assert run(arguments) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["seconds"] == 1.5 and result["devices"] == ["oculus_touch"]
    log = (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()
    assert "stop" in log[-1] and any(",4.8" in line for line in log)
    rows = list(csv.reader((tmp_path / "felt.csv").open(encoding="utf-8")))
    assert len(rows[0]) == 5 and rows[0][1].endswith("amplitude_m_s2 [m/s^2]")
    assert float(rows[-1][1]) == pytest.approx(4.8, abs=1e-5)
    assert run(["validate", str(tmp_path / "felt.csv")]) == 0


def test_the_touch_is_recorded_as_a_track_for_any_export(clip: Path, tmp_path: Path) -> None:
    """Levels by hand: the painted palm has the weight .5, felt at factor .8, then .4, then not."""
    stage = Stage(clip)
    recording = stage.bodies.record()
    start_s = stage.now_s
    stage.bodies.show = _from_zero(stage.bodies.show, start_s)  # type: ignore[method-assign]
    for _ in range(10):
        stage.step(poses=True, intensity=0.8)  # at 0.01 to 0.1 s
    for _ in range(10):
        stage.step(poses=True, gain=0.5, amplitude_m_s2=6.0)
    for _ in range(5):
        stage.step(poses=True, all_mute=1.0)
    path = tmp_path / "felt.hfxtrack"
    recording.write(path)
    assert run(["validate", str(path)]) == 0
    model = load_model("hfx-vibration-1")
    palm = np.flatnonzero((model.part == PARTS.index("hand_palm")) & (model.vertices[:, 0] > 0.0))
    with TrackReader(path) as track:
        header = track.header
        assert [(e.name, e.kind) for e in header.effects] == [("Hit #1", "painted")]
        assert [body.name for body in header.bodies] == ["Anna"]
        samples = [sample for run in track.runs() for sample in run]
    assert [round(100 * sample.time_s) for sample in samples] == list(range(1, 21))
    assert [round(sample.level, 6) for sample in samples] == [0.8] * 10 + [0.4] * 10
    assert samples[0].parameters.tolist() == [12.0, 160.0]
    assert samples[-1].parameters.tolist() == [6.0, 160.0]
    # The clip has 43 of these vertices, and each vertex of the model takes the nearest weight.
    assert len(set(samples[0].vertices) & set(palm)) > 0.9 * len(palm)
    assert np.allclose(samples[0].weights, 0.5, atol=1 / 510)
    # 0.5 * 0.8 * 12 m/s^2, as played; the weight is stored in 1/255.
    csv_path = tmp_path / "felt.csv"
    assert run(["convert", str(path), str(csv_path), "--device", "oculus_touch"]) == 0
    rows = list(csv.reader(csv_path.open(encoding="utf-8")))
    assert max(float(row[1]) for row in rows[1:]) == pytest.approx(4.8, rel=0.01)


def _from_zero(show: Any, start_s: float) -> Any:
    return lambda client, time_s: show(client, time_s - start_s)


def test_a_track_without_a_pose_is_silent(clip: Path, tmp_path: Path) -> None:
    stage = Stage(clip)
    recording = stage.bodies.record()
    stage.step(intensity=0.8)
    recording.write(tmp_path / "felt.hfxtrack")
    with TrackReader(tmp_path / "felt.hfxtrack") as track:
        assert len(track.header.streams) == 1 and not [s for run in track.runs() for s in run]


def test_lines_are_recorded_at_their_own_times(tmp_path: Path) -> None:
    """The lines are those of a simulator's log, with seconds from the start of the playback."""
    rows = [(0.0, np.array([4.8, 160.0])), (0.0123456789, np.array([0.0, 160.0]))]
    path = tmp_path / "felt.jsonl"
    feel._RECORDS[".jsonl"](path, rows, load_device("oculus_touch"))
    assert path.read_text(encoding="utf-8").splitlines() == [
        '{"time_s": 0.0, "values": [4.8, 160.0]}',
        '{"time_s": 0.012346, "values": [0.0, 160.0]}',
    ]


def free_ports() -> int:
    """First of two neighbouring free UDP ports."""
    while True:
        first, second = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        with first, second:
            first.bind(("127.0.0.1", 0))
            try:
                second.bind(("127.0.0.1", first.getsockname()[1] + 1))
            except (OSError, OverflowError):
                continue
            return int(first.getsockname()[1])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--vmc", "1", "--body", "A=2"], "--vmc is the port of a single body"),
        (["--body", "A"], "expected NAME=PORT"),
        (["--body", "A=1", "--body", "A=2"], "given twice"),
        (["--vmc", "70000"], "expected 1 to 65535"),
        (["--seconds", "nan"], "--seconds nan: expected more than 0"),
        (["--sender", "everyone"], "expected an address"),
        (["--record", "x.wav"], "--record: expected a name that ends in .hfxtrack"),
    ],
)
def test_wrong_options_are_one_sentence(
    clip: Path, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["feel", str(clip), "--device", "oculus_touch", "--to", "simulator", *options]
    assert run(arguments) == UsageError.exit_code
    assert words in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_is_silence_at_once_and_keeps_the_recording(
    clip: Path, tmp_path: Path, sender: Any
) -> None:
    port, log = free_ports(), tmp_path / "log.csv"
    sender(port)
    command = [sys.executable, "-m", "hfx_blender", "feel", str(clip), "--device", "oculus_touch"]
    command += ["--to", "log", "--path", str(log), "--record", str(tmp_path / "felt.csv")]
    command += ["--vmc", str(port), "--osc", str(port + 1)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert b"receives 'Anna'" in (process.stdout.readline() or process.stderr.read())
        assert b"is tracked" in process.stdout.readline()
        time.sleep(0.3)
        signalled_s = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 130
        # The thread that ends an unanswered command would need a second.
        assert time.monotonic() - signalled_s < 0.9
    assert "stop" in log.read_text(encoding="utf-8").splitlines()[-1]
    assert "4.8" in (tmp_path / "felt.csv").read_text(encoding="utf-8")
