# SPDX-License-Identifier: GPL-3.0-or-later
"""Guards against faults too rare for tests with whole processes, each tested in isolation."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fake_time import Played
from fake_worker import FakeWorker
from live_process import BAND, PATIENCE_S, playing

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host import host as host_module
from hfx_blender.devices.host.device_thread import DeviceThread, Question
from hfx_blender.devices.host.host import Host
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.live import host_pipe
from hfx_blender.devices.live.client import DeviceState, LiveClient
from hfx_blender.devices.live.host_pipe import STOP_PATIENCE_S, HostPipe
from hfx_blender.devices.transports import serial_port
from hfx_blender.devices.transports import wire_board as wire
from hfx_blender.devices.transports.wire_board import WireBoard
from hfx_blender.devices.workers import script_process
from hfx_blender.devices.workers.live_frame import LiveFrame
from hfx_blender.devices.workers.message_bodies import encode_values
from hfx_blender.devices.workers.script_process import ScriptProcess
from hfx_blender.errors import DeviceError
from hfx_blender.processes import start
from hfx_blender.processes.messages import (
    EVERY_DEVICE,
    Message,
    MessageKind,
    encode_json,
    message,
    messages,
)
from hfx_blender.processes.worker import Worker
from hfx_tools import processes

DEVICE = load_device(BAND)


class RecordingOutput:
    """Output recording values."""

    def __init__(self) -> None:
        self.given: list[Any] = []

    def send(self, values: Any) -> None:
        self.given.append(values)

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


def open_device_thread(device: Any) -> tuple[DeviceThread, RecordingOutput]:
    """Return an open device thread, without running threads, and a recording output."""
    output = RecordingOutput()
    thread = DeviceThread(0, device, lambda: output, lambda *_, **__: None)
    thread.output, thread.is_open = output, True
    return thread, output


def test_a_stopped_lane_takes_no_values_and_no_pulse() -> None:
    thread, _ = open_device_thread(DEVICE)
    thread.feed(playing())
    thread.pulse(2)
    assert not thread.waiting and thread.test_pulse is None
    thread.arm()
    thread.feed(playing())
    thread.pulse(2)
    assert len(thread.waiting) == 1 and thread.test_pulse is not None


def test_stop_and_arm_clear_the_queue() -> None:
    thread, _ = open_device_thread(DEVICE)
    thread.arm()
    thread.feed(playing())
    thread.stop("enough")
    assert not thread.waiting
    thread.waiting.add(playing(), 0.0)  # a frame queued in spite of the fault
    thread.arm()
    assert not thread.waiting


def test_a_device_that_is_not_open_yet_is_not_armed_but_will_be() -> None:
    thread, _ = open_device_thread(DEVICE)
    thread.is_open = False
    thread.arm()
    assert not thread.is_armed and thread.is_wanted


@pytest.mark.parametrize(
    ("facts", "expected"),
    [
        ({}, 3.0),  # no ramp from 10
        ({"update_interval_ms": 500.0}, 3.0),  # no room for a ramp within 500 ms
        ({"slew_per_s": 100.0}, 0.5),  # of 3, after the 5 ms between two values
    ],
)
def test_after_a_stop_everything_begins_from_silence(
    facts: dict[str, float], expected: float
) -> None:
    """Guard, ramp and pacing keep the values before the stop as their state."""
    kinds = {n: replace(k, **facts) for n, k in DEVICE.actuator_types.items()}
    actuators = tuple(replace(a, type=kinds[a.type.name]) for a in DEVICE.actuators)
    played = Played(device=replace(DEVICE, actuators=actuators))
    for _ in range(24):
        played.thread.feed(playing())
        played.run(0.05)
    assert played.port.strengths()[-1][1] == 10.0
    played.thread.stop("enough")
    stopped = len(played.port.given)
    played.thread.arm()
    played.thread.feed(playing(3.0))
    played.run(0.05)
    strengths = [strength for _, strength in played.port.strengths()[stopped:]]
    assert next(strength for strength in strengths if strength) == pytest.approx(expected, rel=1e-3)


def test_a_process_that_ends_while_a_device_connects_waits_for_nothing() -> None:
    thread = DeviceThread(0, DEVICE, RecordingOutput, lambda *_, **__: None)
    thread.close("the output process was ended")
    began_s = time.monotonic()
    thread.wait_closed()
    assert time.monotonic() - began_s < PATIENCE_S / 2.0
    thread.start()  # the connecting thread goes on
    thread.wait_closed()


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> LiveClient:
    FakeWorker.replace(monkeypatch, host_pipe)
    live_client = LiveClient()
    live_client.start()
    live_client.devices["band"] = DeviceState(1, "band", "armed")
    return live_client


def test_stop_all_goes_first_and_leaves_no_values_behind(client: LiveClient) -> None:
    worker: Any = client.pipe.worker
    written = client.pipe.outgoing(worker)
    client.arm()
    client.send("band", playing())
    client.stop_all("enough")
    kinds = [item.kind for item in messages(io.BytesIO(next(written)))]
    assert kinds == [MessageKind.ARM, MessageKind.STOP]  # not armed at the end
    assert worker.urged == [Message(MessageKind.STOP, EVERY_DEVICE, b"enough")]
    client.heartbeat()
    assert next(written) == message(MessageKind.HEARTBEAT)  # no values


def beat(pipe: HostPipe, now: list[float], seconds: float) -> None:
    """Pass time on a clock with a heartbeat each 50 ms."""
    for _ in range(round(seconds / 0.05)):
        now[0] += 0.05
        pipe.watch()


def test_a_stop_before_ready_keeps_the_starting_deadline(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pipe = client.pipe
    worker: Any = pipe.worker
    client.stop_all("enough")
    now[0] += 5.0
    pipe.watch()
    assert not worker.is_killed  # still importing numpy, without an open port
    worker.says(MessageKind.JSON, b'{"event": "ready", "device": 0, "text": "1"}')
    beat(pipe, now, STOP_PATIENCE_S + 0.06)
    assert worker.is_killed
    worker.ends()
    client.events()
    assert "did not confirm the stop" in client.devices["band"].text, "the reason of the end"


def test_a_stop_confirmed_before_its_call_returns_is_confirmed(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The threads of the pipe may send a stop and read its confirmation while this one waits."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pipe = client.pipe
    worker: Any = pipe.worker
    worker.says(MessageKind.JSON, b'{"event": "ready", "device": 0, "text": "1"}')

    worker.urge = lambda _: worker.says(MessageKind.JSON, b'{"event": "silent", "device": 0}')
    client.stop_all("enough")
    beat(pipe, now, 5.0)
    assert not worker.is_killed


def test_a_halted_computer_is_no_delay_of_the_output_process(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pipe = client.pipe
    worker: Any = pipe.worker
    worker.says(MessageKind.JSON, b'{"event": "ready", "device": 0, "text": "1"}')
    client.stop_all("enough")
    now[0] += 60.0  # both processes stand still
    pipe.watch()
    assert not worker.is_killed
    beat(pipe, now, STOP_PATIENCE_S)
    assert worker.is_killed


@pytest.mark.parametrize(
    "silence",
    [
        lambda client: client.stop_all("enough"),
        lambda client: client.stop("band"),
        lambda client: client.pause(),
        lambda client: client.set_gains({1: 0.0}),
        lambda client: client.close_port("band"),
    ],
)
def test_a_silence_is_written_though_its_thread_keeps_pythons_lock(
    client: LiveClient, silence: Callable[[LiveClient], None]
) -> None:
    worker: Any = client.pipe.worker
    client.arm()
    silence(client)  # no other thread writes to the second pipe
    [ahead] = worker.urged
    in_order = list(messages(io.BytesIO(next(client.pipe.outgoing(worker)))))
    assert [item.kind for item in in_order[:2]] == [MessageKind.ARM, ahead.kind]
    assert in_order[1] == ahead and ahead.kind in (MessageKind.STOP, MessageKind.PAUSE)


def test_a_moment_that_was_made_into_bytes_during_a_stop_is_not_sent(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipe = client.pipe
    worker: Any = pipe.worker

    def packed(*_: Any) -> bytes:
        client.stop_all("enough")
        return b"a moment"

    monkeypatch.setattr(host_pipe, "encode_live_frame", packed)
    client.show(LiveFrame(0.0, []))
    assert next(pipe.outgoing(worker)) == message(MessageKind.STOP, EVERY_DEVICE, b"enough")


class Interrupted(dict[int, Any]):
    """Dictionary whose ``popitem`` first lets another thread run a given function."""

    def __init__(self, function: Callable[[], None]) -> None:
        super().__init__()
        self._waiting = [function]

    def popitem(self) -> tuple[int, Any]:
        while self._waiting:
            self._waiting.pop()()
        return super().popitem()


def test_a_moment_queued_after_a_pause_is_sent_with_the_places_of_its_scene(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pause, a scene and a moment are queued while the writing thread takes earlier values."""
    pipe = client.pipe
    worker: Any = pipe.worker
    places: list[Any] = []

    def packed(_moment: LiveFrame, used: Any) -> bytes:
        places.append(used)
        return b"a moment"

    def describe() -> None:
        client.pause()
        pipe.places = {("of", "the new scene"): 0}  # type: ignore[dict-item]
        client.show(LiveFrame(1.0, []))

    monkeypatch.setattr(host_pipe, "encode_live_frame", packed)
    pipe.newest = Interrupted(describe)
    written = pipe.outgoing(worker)
    client.heartbeat()
    kinds = [item.kind for item in messages(io.BytesIO(next(written)))]
    assert kinds == [MessageKind.HEARTBEAT, MessageKind.PAUSE]
    client.heartbeat()  # wakes the thread once more
    assert next(written) == message(MessageKind.MOMENT, EVERY_DEVICE, b"a moment")
    assert places == [pipe.places]


def test_a_stop_of_one_device_leaves_the_values_of_further_devices(
    client: LiveClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.devices["belt"] = DeviceState(2, "belt", "armed")
    pipe = client.pipe
    worker: Any = pipe.worker

    def packed(*_: Any) -> bytes:
        client.stop("band")
        return b"a moment"

    monkeypatch.setattr(host_pipe, "encode_live_frame", packed)
    client.send("band", playing())
    client.send("belt", playing())
    client.show(LiveFrame(0.0, []))
    devices = [item.device for item in messages(io.BytesIO(next(pipe.outgoing(worker))))]
    assert devices == [2, EVERY_DEVICE]


@pytest.mark.parametrize(
    "body",
    [b"\xff", b"nonsense", b"[]", b"3", b'{"event": "armed"}', b'{"event": 1, "device": "x"}'],
)
def test_a_body_that_is_no_event_is_not_heard(client: LiveClient, body: bytes) -> None:
    worker: Any = client.pipe.worker
    worker.says(MessageKind.JSON, body)
    assert client.events() == []


def test_the_output_process_finds_packages_that_an_extension_brings(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    brought = tmp_path / "site-packages"  # with pyserial
    monkeypatch.syspath_prepend(str(brought))
    commands: list[list[str]] = []

    def popen(command: list[str], **_: Any) -> None:
        commands.append(command)
        raise OSError("not here")

    monkeypatch.setattr(subprocess, "Popen", popen)
    with pytest.raises(DeviceError, match="cannot be started"):
        HostPipe().start()
    assert any(str(brought) in part.split(os.pathsep) for part in commands[0])


def test_an_output_process_that_does_not_end_is_ended(client: LiveClient) -> None:
    worker: Any = client.pipe.worker
    client.close()
    assert worker.is_killed
    assert next(client.pipe.outgoing(worker)) == message(MessageKind.STOP)


def test_there_are_only_so_many_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_module, "MAX_DEVICES", 2)
    reported: list[tuple[str, int, str]] = []
    host = Host(lambda event, number, text="", **_: reported.append((event, number, text)))  # type: ignore[arg-type]
    wish = encode_json({"configuration": BAND, "output": {"kind": "simulator"}})
    for number in (1, 2, 3):
        host.receive(Message(MessageKind.CONNECT, number, wish))
    host.silence("the test is over")
    assert ("lost", 3, "more than 2 devices") in reported
    assert not any(event == "lost" for event, number, _ in reported if number < 3)


def test_a_port_that_leads_elsewhere_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "file"
    elsewhere.touch()
    monkeypatch.setattr(serial_port.os.path, "realpath", lambda name: str(elsewhere))
    with pytest.raises(OutputLostError, match="leads to"):
        serial_port.reserve_port("/dev/ttyACM0")


def test_an_invalid_port_name_is_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[str] = []
    monkeypatch.setattr(serial_port, "reserve_port", looked.append)
    for name in ("spy:///dev/ttyS0?file=x", "socket://1.2.3.4:5", "/tmp/x", "/dev/tty/../sda", ""):
        with pytest.raises(OutputLostError, match="not a serial port"):
            serial_port.SerialPort(name, 9600)
    assert not looked


@pytest.mark.parametrize("fault", [OSError("busy"), ValueError("baud"), RuntimeError("termios")])
def test_a_port_that_cannot_be_opened_may_be_tried_again(
    monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    serial = pytest.importorskip("serial")

    def refuse(*_: Any, **__: Any) -> None:
        raise fault

    released: list[Any] = []
    monkeypatch.setattr(serial, "Serial", refuse)
    monkeypatch.setattr(serial_port, "reserve_port", lambda name: frozenset({(name, 7)}))
    monkeypatch.setattr(serial_port, "release", released.append)
    with pytest.raises(OutputLostError, match="cannot be opened"):
        serial_port.SerialPort("/dev/ttyACM0", 9600)
    assert released == [frozenset({("/dev/ttyACM0", 7)})]


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_urgent_frames_do_not_wait_for_a_begun_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master, slave = os.openpty()
    port = serial_port.SerialPort(os.ttyname(slave), 115200)
    room = [4, 0, 100]  # bytes accepted by the system, call by call
    written: list[bytes] = []

    def write(_descriptor: int, content: bytes) -> int:
        count = room.pop(0)
        if not count:
            raise BlockingIOError
        written.append(content[:count])
        return len(written[-1])

    with monkeypatch.context() as patch:
        patch.setattr(serial_port.os, "write", write)
        port.write_newest(b"a frame")
        port.write_first(b"stop")
    assert written == [b"a fr", b"stop"]
    port.close()
    os.close(slave)
    os.close(master)


def test_a_script_that_answers_without_being_asked_is_not_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    workers = FakeWorker.replace(monkeypatch, script_process)
    answers: list[Any] = []
    faults: list[str] = []
    script = ScriptProcess({}, faults.append, lambda text: None)
    script.start()
    workers[0].says(MessageKind.READY)
    script.ask(b"", answers.append)
    workers[0].says(MessageKind.ANSWER, encode_values(playing()), 1)
    assert len(answers) == 1 and not faults
    workers[0].says(MessageKind.ANSWER, encode_values(playing()), 1)
    assert len(answers) == 1
    assert faults == ["its script sent an answer without a question"]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems limit it otherwise or not")
def test_a_script_can_only_take_so_much_memory() -> None:
    source = (
        "import os, resource\n"
        "from hfx_blender.devices.workers import script_worker\n"
        "before = os.nice(0)\n"
        "script_worker._limit_resources()\n"
        "print(resource.getrlimit(resource.RLIMIT_AS)[0] == script_worker.MAX_MEMORY,"
        " resource.getrlimit(resource.RLIMIT_CORE)[0], os.nice(0) > before)"
    )
    completed = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert completed.stdout.split() == ["True", "0", "True"], completed.stderr


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes by /proc")
def test_child_processes_of_a_script_end_with_the_script(monkeypatch: pytest.MonkeyPatch) -> None:
    source = (
        "import os, time\n"
        "from hfx_blender.processes.messages import json_message\n"
        "child = os.fork()\n"
        "if child:\n"
        "    os.write(1, json_message(child))\n"
        "time.sleep(60)\n"
    )
    monkeypatch.setattr(start, "command", lambda _: processes.program(source))
    worker = Worker("a script")
    worker.start()
    said = worker.receive(PATIENCE_S)
    assert said is not None
    child = Path("/proc", said.body.decode(), "stat")
    assert child.exists()
    worker.kill()
    worker.wait(PATIENCE_S)
    end = time.monotonic() + PATIENCE_S
    while child.exists() and child.read_text().rsplit(")", 1)[1].split()[0] != "Z":
        assert time.monotonic() < end, "it lives on"
        time.sleep(0.01)


class ForgetfulBoard:
    """Port of a board with a first answer from the session before."""

    name = "/dev/ttyACM0"

    def __init__(self) -> None:
        self.questions = 0
        self._reply = b""

    def write_newest(self, content: bytes) -> None:
        (frame,) = wire.Receiver().take(content)
        assert frame.kind == wire.FrameKind.CONFIGURE
        crc = zlib.crc32(frame.payload) ^ (self.questions == 0)
        self.questions += 1
        self._reply = wire.encode_frame(wire.FrameKind.READY, 1, struct.pack("<IB", crc, 8))

    def read(self) -> bytes:
        reply, self._reply = self._reply, b""
        return reply

    def close(self) -> None: ...


def test_a_board_that_is_ready_for_another_session_is_not_ready() -> None:
    port = ForgetfulBoard()
    WireBoard(DEVICE, port)  # type: ignore[arg-type]
    assert port.questions == 2


@pytest.mark.skipif(os.name != "posix", reason="descriptors")
def test_a_port_never_blocks_for_any_kind_of_file(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = os.openpty()

    class Serial:
        def __init__(self, *_: object, **__: object) -> None:
            os.set_blocking(slave, True)

        def fileno(self) -> int:
            return slave

        def close(self) -> None: ...

    monkeypatch.setattr("serial.Serial", Serial)
    port = serial_port.SerialPort(os.ttyname(slave), 115200)
    try:
        assert not os.get_blocking(slave)
    finally:
        port.close()
        os.close(slave)
        os.close(master)


@pytest.mark.parametrize("actuator", [-1, 8, 10**6])
def test_a_pulse_of_an_actuator_that_is_not_there_is_none(actuator: int) -> None:
    thread, _ = open_device_thread(DEVICE)
    thread.arm()
    thread.pulse(actuator)
    assert thread.test_pulse is None


def test_an_output_that_fails_to_open_is_its_devices_fault_only() -> None:
    def broken() -> Any:
        raise RuntimeError("of somebody's")

    reported: list[tuple[str, str]] = []
    thread = DeviceThread(
        0, DEVICE, broken, lambda event, _, text="", **__: reported.append((event, text))
    )
    thread.start()
    end = time.monotonic() + PATIENCE_S
    while not reported:
        assert time.monotonic() < end
        time.sleep(0.002)
    assert reported == [("lost", "cannot be opened: of somebody's")]


def test_a_device_thread_stops_before_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    thread, _ = open_device_thread(DEVICE)
    reported: list[tuple[str, bool]] = []
    monkeypatch.setattr(thread, "stop", lambda reason: reported.append((reason, thread.is_closed)))
    thread.close("bye")
    assert reported == [("bye", False)] and thread.is_closed
    thread.close("again")
    assert len(reported) == 1


class RecordingScript:
    """Device script or device thread recording method calls."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.number, self.is_armed, self.generation = 1, True, 0

    def start(self) -> None:
        self.told.append("start")

    def is_overdue(self, now_s: float) -> bool:
        return True

    def close(self, reason: str = "") -> None:
        self.told.append("close")

    def stop(self, reason: str) -> None:
        self.told.append(f"stop: {reason}")

    def pause(self) -> None:
        self.told.append("pause")

    def question(self, asked_s: float) -> Question:
        return Question(0, asked_s, 1)

    def feed(self, values: Any, question: Any = None) -> None:
        self.told.append("feed")

    def sign(self, now_s: float) -> None: ...

    def pulse(self, actuator: int) -> None:
        self.told.append("pulse")

    def fault(self, text: str) -> None:
        self.told.append(f"fault: {text}")

    def freeze(self, text: str) -> None:
        self.told.append(f"freeze: {text}")

    def is_stuck(self, now_s: float) -> bool:
        return False


def test_stop_ends_and_arm_starts_the_script() -> None:
    thread, _ = open_device_thread(DEVICE)
    thread.script = script = RecordingScript()  # type: ignore[assignment]
    thread.arm()
    thread.stop("enough")
    assert script.told == ["start", "close"]


def test_a_script_that_is_overdue_stops_its_device_before_anything_is_sent() -> None:
    thread, output = open_device_thread(DEVICE)
    thread.script = RecordingScript()  # type: ignore[assignment]
    thread.arm()
    thread.feed(playing())
    reported: list[str] = []

    thread.fault = reported.append  # type: ignore[method-assign]
    thread.turn()
    assert reported == ["its script did not answer within 100 ms"] and not output.given


def host_of(monkeypatch: pytest.MonkeyPatch) -> tuple[Host, RecordingScript]:
    """Return an output process without threads, and the only device thread."""
    host, thread = Host(lambda *_, **__: None), RecordingScript()  # type: ignore[arg-type]
    host.device_threads[1] = thread  # type: ignore[assignment]
    return host, thread


def test_the_end_of_messages_stops_every_lane_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    host, thread = host_of(monkeypatch)
    host.read(io.BytesIO(b""))
    assert thread.told == ["stop: Blender has gone"]
    assert host.end_reason == "Blender has gone"


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"\xff" * 7, "Blender sent a message of"),
        (message(MessageKind.PULSE, 1, encode_json({"actuator": "x"})), "ValueError"),
        (message(MessageKind.CONNECT, 1, b"[]"), "Blender sent not a JSON object"),
    ],
)
def test_messages_that_are_none_stop_every_lane(
    monkeypatch: pytest.MonkeyPatch, content: bytes, reported: str
) -> None:
    host, thread = host_of(monkeypatch)
    host.read(io.BytesIO(content))
    assert thread.told[-1].startswith(f"stop: {reported}")
    assert host.end_reason.startswith(reported)


def test_a_send_that_takes_long_names_both_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    host, thread = host_of(monkeypatch)
    monkeypatch.setattr(thread, "is_stuck", lambda now_s: True)
    host.check_deadlines()
    (fault,) = thread.told
    assert "port stalls" in fault and "computer is busy" in fault


def test_only_a_pause_buys_time_and_only_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    host, _ = host_of(monkeypatch)
    seen: list[float] = []
    monkeypatch.setattr(host, "take", lambda *_: seen.append(host.patience_s))
    kinds = MessageKind.PAUSE, MessageKind.HEARTBEAT, MessageKind.PAUSE
    host.read(io.BytesIO(b"".join(map(message, kinds)) + message(MessageKind.PAUSE, 1)))
    assert seen == [
        host_module.PAUSE_S,
        host_module.HEARTBEAT_S,
        host_module.PAUSE_S,
        host_module.HEARTBEAT_S,  # without a heartbeat from Blender
    ]
    assert host_module.PAUSE_S <= 10.0


def test_reconnecting_closes_the_old_device_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    host, thread = host_of(monkeypatch)
    monkeypatch.setattr(host_module.DeviceThread, "start", lambda self: None)
    wish = encode_json({"configuration": BAND, "output": {"kind": "simulator"}})
    host.receive(Message(MessageKind.CONNECT, 1, wish))
    assert thread.told == ["close"] and host.device_threads[1] is not thread


def test_a_device_with_a_wrong_configuration_is_reported_as_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reported: list[tuple[str, int, str]] = []
    host = Host(lambda event, number, text="", **_: reported.append((event, number, text)))  # type: ignore[arg-type]
    host.receive(Message(MessageKind.CONNECT, 5, encode_json({"configuration": "none_such"})))
    assert (
        reported[0][:2] == ("lost", 5) and "none_such" in reported[0][2] and not host.device_threads
    )


def test_rendered_values_go_to_playing_devices_only(monkeypatch: pytest.MonkeyPatch) -> None:
    host, thread = host_of(monkeypatch)
    questions = {1: Question(0, 0.0, 1), 2: Question(0, 0.0, 1)}
    for kind in (MessageKind.ANSWER, MessageKind.FAULT):
        host.take_rendered(Message(kind, 1, encode_values(playing())), questions)
        host.take_rendered(Message(kind, 2, encode_values(playing())), questions)
    assert [item.split(":")[0] for item in thread.told] == ["feed", "fault"]
    thread.told.clear()
    thread.is_armed = False
    for kind in (MessageKind.ANSWER, MessageKind.FAULT):
        host.take_rendered(Message(kind, 1, encode_values(playing())), questions)
    host.fail_rendering("it has ended")
    assert not thread.told
    thread.is_armed = True
    host.fail_rendering("it has ended")
    assert thread.told == ["fault: it has ended"]


def test_a_new_scene_is_silent_until_the_first_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    host, thread = host_of(monkeypatch)
    done: list[str] = []
    for name in ("describe", "forget", "show", "restart"):
        monkeypatch.setattr(host.rendering, name, lambda *_, name=name: done.append(name))
    host.receive(Message(MessageKind.SCENE, EVERY_DEVICE, b"{}"))
    assert thread.told == ["pause"] and done == ["forget", "describe"]
    host.receive(Message(MessageKind.MOMENT, EVERY_DEVICE, b""))
    host.receive(Message(MessageKind.STOP, EVERY_DEVICE, b"enough"))
    host.receive(Message(MessageKind.PAUSE, EVERY_DEVICE, b""))
    assert done[2:] == ["show", "forget", "forget"]
    assert thread.told == ["pause", "stop: enough", "pause"]


def test_unread_events_take_bounded_memory() -> None:
    is_read = threading.Event()

    class Unread(io.BytesIO):
        def write(self, content: Any) -> int:
            is_read.wait(PATIENCE_S)
            return super().write(content)

    stream = Unread()
    reporter = host_module.Reporter(stream)
    for _ in range(5000):
        reporter("levels", 1)
    reporter("last", 1)
    is_read.set()
    end = time.monotonic() + PATIENCE_S
    while b"last" not in stream.getvalue():
        assert time.monotonic() < end
        time.sleep(0.002)
    assert stream.getvalue().count(b"levels") <= 2000  # 1000 written and 1000 queued
