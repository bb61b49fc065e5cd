# SPDX-License-Identifier: GPL-3.0-or-later
"""Live devices: their cost in Blender per frame, and the delay from a frame to the port.

*Handing over* is all work of Blender's main thread for devices after the evaluation of a frame,
also during playback with late actuators: their values come from the recorded timeline.
*Made into bytes* is the serialization in a second thread, under Python's global lock, so a frame
may wait for this at worst. *At the port* is the time from an evaluated frame to its first
datagram received on loopback: serialized, handed on, rendered, guarded, encoded, sent.
"""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers.live_frame import LiveFrame, encode_live_frame
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.moment import moment_header
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackHeader, TrackModel
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.processes import blender_session

from ..command_process.temporary_folder import temporary_folder

if TYPE_CHECKING:
    from hfx_blender.playback.evaluation import Evaluation

HANDING_OVER_MS: Final = 0.5
AT_PORT_P99_MS: Final = 10.0

_MODEL: Final = "hfx-vibration-1"
_RATE_HZ: Final = 60.0
_PATIENCE_S: Final = 10.0
_INTERVALS_MS: Final = (5, 10)

Progress = Callable[[float], None]
_Times = tuple[list[float], list[float]]  # of the clock, and of this thread's processor time


def measure(
    *, short: bool = False, frames: int = 1000, progress: Progress = lambda share: None
) -> dict[str, Any]:
    """Measure the live output over ``frames`` frames per row (100 if short); plain data.

    Raises
    ------
    InputError
        Devices do not play on this computer.
    """
    frames = min(frames, 100) if short else frames
    rows: dict[str, Any] = {}
    for k, interval_ms in enumerate(_INTERVALS_MS):
        rows[f"at the port, a device that is updated every {interval_ms} ms"] = _row(
            _at_port(interval_ms, frames), "p99_ms", AT_PORT_P99_MS
        )
        progress((k + 1) / (len(_INTERVALS_MS) + 1))
    (evaluated, worked), packed, handed = _in_blender(frames)
    row = _row(evaluated) | _of_processor(worked)
    rows["evaluating the demo, once for preview and devices"] = row
    for name, (times, worked) in handed.items():
        row = _row(times, "median_ms", HANDING_OVER_MS) | _of_processor(worked)
        rows[f"handing over to {name}"] = row
    rows["made into bytes, in a thread"] = _row(packed)
    progress(1.0)
    return rows


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` as a table for a terminal."""
    lines = [f"{'each frame':<76}{'trials':>8}{'median':>11}{'p99':>11}{'max':>11}  limit"]
    for name, row in result.items():
        figures = "".join(f"{row[key]:>8.3f} ms" for key in ("median_ms", "p99_ms", "max_ms"))
        limit = ""
        if "limit_ms" in row:
            over = "" if row[row["of"]] <= row["limit_ms"] else "  over"
            limit = f"  {row['of'].removesuffix('_ms')} {row['limit_ms']:g} ms{over}"
        if "processor_median_ms" in row:
            median, p99 = row["processor_median_ms"], row["processor_p99_ms"]
            limit += f" (of the processor {median:.3f} ms, p99 {p99:.3f} ms)"
        lines.append(f"{name:<76}{row['trials']:>8}{figures}{limit}")
    return "\n".join(lines)


def _row(times_s: list[float], of: str = "", limit_ms: float = 0.0) -> dict[str, Any]:
    times = 1000.0 * np.array(times_s)
    return {
        "trials": len(times),
        "median_ms": round(float(np.median(times)), 4),
        "p99_ms": round(float(np.percentile(times, 99)), 4),
        "max_ms": round(float(times.max()), 4),
        **({"of": of, "limit_ms": limit_ms} if of else {}),
    }


def _of_processor(worked_s: list[float]) -> dict[str, float]:
    """Median and 99th percentile of the processor time of this thread, in milliseconds."""
    row = _row(worked_s)
    return {f"processor_{name}": row[name] for name in ("median_ms", "p99_ms")}


class _Receiver:
    """UDP port on loopback; records the first arrival time of each strength."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.5)
        self.port = int(self._socket.getsockname()[1])
        self.arrived: dict[int, float] = {}  # monotonic seconds by 1000 x strength
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._is_closed = True
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._is_closed:
            try:
                content = self._socket.recv(2048)
            except TimeoutError:
                continue
            now = time.monotonic()
            # A message of one float.
            (strength,) = struct.unpack(">f", content[-4:])
            self.arrived.setdefault(round(strength * 1000.0), now)


def _at_port(interval_ms: int, frames: int) -> list[float]:
    """Seconds from an evaluated frame to its bytes at a port on loopback, 60 frames a second.

    At this rate a device updated every 10 ms receives each frame unchanged; a device updated
    every 5 ms begins to interpolate toward the frame at once.
    """
    receiver = _Receiver()
    client = LiveClient()
    delays_s = []
    try:
        with temporary_folder() as folder:
            _write_device(Path(folder), interval_ms)
            output = {"kind": "udp", "port": receiver.port}
            client.connect("one", "one", output, folder=Path(folder))
            header, moment_of = _vibrating_skin()
            client.describe(header, header.bodies[0].id)
            end = time.monotonic() + _PATIENCE_S
            while not (client.devices["one"].is_armed and receiver.arrived):
                client.events()
                client.show(moment_of(1.0))
                client.heartbeat()
                time.sleep(0.005)
                if time.monotonic() > end:
                    raise InputError(f"The device does not play: {client.devices['one'].text}")
            due = time.monotonic()
            before = 0.0
            for k in range(frames):
                client.events()
                if not client.devices["one"].is_armed:  # this process was late with a heartbeat
                    client.arm()
                receiver.arrived.clear()
                amplitude = _level(k)
                moment = moment_of(amplitude)
                begun = time.monotonic()
                client.show(moment)
                client.heartbeat()
                due = max(due + 1.0 / _RATE_HZ, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))
                # A level other than the previous frame's can only come from this frame: on the way
                # to the new level a device passes values in between.
                times = [
                    at
                    for level, at in list(receiver.arrived.items())
                    if abs(level / 1000.0 - before) > 1e-3 and at >= begun
                ]
                if times:
                    delays_s.append(min(times) - begun)
                elif k:
                    delays_s.append(1.0 / _RATE_HZ)  # late or lost: a whole frame is counted
                before = amplitude
    finally:
        client.close()
        receiver.close()
    return delays_s


def _vibrating_skin() -> tuple[TrackHeader, Callable[[float], LiveFrame]]:
    """Header of a scene with one effect on all skin, and a function from amplitude to a frame."""
    model = load_model(_MODEL)
    stream = Stream("skin", "body", "vibration", model.id)
    header = TrackHeader(
        time=TimeBase(Fraction(1), Fraction(1), 0, 0, 0),
        models=(TrackModel(model.id, "vibration", model.content_hash, len(model)),),
        bodies=(TrackBody("body", "Body"),),
        effects=(TrackEffect("skin", "Skin", "vibration", "volume", model.id),),
        streams=(stream,),
    )
    vertices = np.arange(len(model), dtype=np.int32)
    weights = np.ones(len(model), np.float32)

    def moment(amplitude_m_s2: float) -> LiveFrame:
        run = SampleRun(
            stream,
            np.zeros(1, np.int64),
            np.zeros(1),
            np.ones(1),
            np.array([[amplitude_m_s2, 100.0]]),
            np.array([0, len(model)]),
            vertices,
            weights,
        )
        return LiveFrame(0.0, [run])

    return header, moment


def _level(frame: int) -> float:
    return 2.0 + frame * 37 % 100 / 10.0


def _write_device(folder: Path, interval_ms: int) -> None:
    text = (resources.device_configs() / "arduino_uno_pwm.json").read_text(encoding="utf-8")
    content = json.loads(text)
    content["id"] = "one"
    content.pop("side", None)
    content["actuators"] = content["actuators"][:1]
    content.pop("rendering", None)
    for kind in content["actuator_types"].values():
        kind["update_interval_ms"] = interval_ms
        for limit in ("slew_per_s", "maximum_on_s", "rest_s", "limits"):
            kind.pop(limit, None)
        kind["parameters"]["amplitude_m_s2"]["maximum"] = 15
    content["output"] = {
        "encoder": {
            "kind": "osc",
            "address": "/bench/{actuator}",
            "values": "unit",
            "send": "messages",
        }
    }
    (folder / "one.json").write_text(json.dumps(content))


def _in_blender(
    frames: int,
) -> tuple[_Times, list[float], dict[str, _Times]]:
    """Seconds for evaluating, serializing and, by name of the receiver, handing over each frame of
    the demo."""
    bpy = blender_session.start()

    from hfx_blender.devices.live.live_settings import LiveSettings
    from hfx_blender.playback.evaluation import evaluation
    from hfx_blender.playback.live import live_handlers
    from hfx_blender.playback.live.live import Live
    from hfx_blender.playback.timeline.timeline_recorder import recorder

    from ..demo import garage
    from . import scenes

    with temporary_folder() as folder:
        blender_session.open_blend(scenes.build("demo", Path(folder) / "demo.blend"))
    scene = bpy.context.scene
    evaluated: _Times = [], []
    packed: list[float] = []
    handed: dict[str, _Times] = {}
    every = f"all {len(garage.DEVICES)} devices of the demo"
    late = "answering late, while it plays"
    ways = (
        (garage.DEVICES[0], garage.DEVICES[:1], False),
        (every, garage.DEVICES, False),
        (f"{garage.DEVICES[0]}, {late}", garage.DEVICES[:1], True),
        (f"{every}, {late}", garage.DEVICES, True),
    )
    was_playing = live_handlers.is_playing
    for name, devices, plays in ways:
        live = Live()
        live_handlers.is_playing = lambda plays=plays: plays
        times: list[float] = []
        work: list[float] = []
        try:
            for device in devices:
                live.connect(device, LiveSettings())
            live.handlers.stop_listening()  # this loop calls the handlers' methods directly
            end = time.monotonic() + _PATIENCE_S
            while sum(state.is_armed for state in live.states.values()) < len(devices):
                live.exchange_heartbeat()
                time.sleep(0.005)
                if time.monotonic() > end:
                    raise InputError("The demo's devices do not play.")
            if plays:
                live.describe(bpy.context)
                recorder.update_now(scene)
                live.arm()  # the recording took longer than the devices' timeout
            for k in range(frames):
                scene.frame_set(scene.frame_start + k % (scene.frame_end - scene.frame_start))
                live.describe(bpy.context)
                evaluation.invalidate()
                begun, worked = time.perf_counter(), time.thread_time()
                evaluation.runs()
                between, worked_between = time.perf_counter(), time.thread_time()
                live.update(scene)
                work.append(time.thread_time() - worked_between)
                ended = time.perf_counter()
                live.exchange_heartbeat()
                if not all(state.is_armed for state in live.states.values()):
                    live.arm()
                evaluated[0].append(between - begun)
                evaluated[1].append(worked_between - worked)
                times.append(ended - between)
                packed.append(_packing(evaluation))
        finally:
            live.close()
            live_handlers.is_playing = was_playing
        handed[name] = times, work
    return evaluated, packed, handed


def _packing(evaluation: Evaluation) -> float:
    """Seconds for serializing the current frame."""
    assert evaluation.scene is not None
    streams = moment_header(evaluation.scene.description).streams
    places = {stream: k for k, stream in enumerate(streams)}
    runs = evaluation.runs()
    begun = time.perf_counter()
    encode_live_frame(LiveFrame(0.0, runs), places)
    return time.perf_counter() - begun
