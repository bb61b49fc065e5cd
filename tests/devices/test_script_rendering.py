# SPDX-License-Identifier: GPL-3.0-or-later
"""Device scripts on recorded tracks: input as in live mode, and playback of the returned values."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest
from own_devices import BAND, own_device, own_folder, scripted

from hfx_blender.devices import script_rendering
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.guard import Guard
from hfx_blender.devices.live import approval
from hfx_blender.devices.script_rendering import Rendered, rendering
from hfx_blender.devices.workers.haptics import encode_haptics
from hfx_blender.devices.workers.script_process import ScriptProcess
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.render import render, renderers_of_track
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.stepwise import finish
from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackHeader, TrackModel
from hfx_blender.errors import ScriptError
from hfx_blender.export.batch import journal
from hfx_blender.files import resources
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import clip_rules
from hfx_tools.track_rendering import render_devices

ROOT = Path(__file__).resolve().parents[2]
MODELS = {"vibration": "hfx-vibration-1", "temperature": "hfx-temperature-1"}
FPS, RATE_HZ, FIRST = 24, 48, 36
START = 8  # first frame of the scene: time zero
ROWS = 300  # more than two chunks of a track
BUZZ, WARM = (20, 200), (100, 160)  # rows

COUNTER = """
count = 0


def render(haptics):
    global count
    count += 1
    return [count % 7 * 0.5, 100.0 + count] * 8
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_folder(tmp_path, monkeypatch)


def header(bodies: tuple[str, ...] = ("anna",)) -> TrackHeader:
    last = FIRST + ROWS * FPS // RATE_HZ - 1
    time = TimeBase(Fraction(FPS), Fraction(RATE_HZ), START, FIRST, last)
    models = {modality: load_model(id) for modality, id in MODELS.items()}
    return TrackHeader(
        time=time,
        models=tuple(
            TrackModel(model.id, model.modality, model.content_hash, len(model))
            for model in models.values()
        ),
        bodies=tuple(TrackBody(body, body.title()) for body in bodies),
        effects=(
            TrackEffect("buzz", "Buzz", "vibration", "volume", MODELS["vibration"], True),
            TrackEffect("warm", "Warm", "temperature", "volume", MODELS["temperature"], True),
        ),
        streams=tuple(
            Stream(effect, body, modality, MODELS[modality])
            for effect, modality in (("buzz", "vibration"), ("warm", "temperature"))
            for body in bodies
        ),
    )


def run_of(track_header: TrackHeader, stream: Stream, rows: tuple[int, int]) -> SampleRun:
    """Return samples on the forearms and a few other vertices; the strength differs by row."""
    model = load_model(stream.model_id)
    is_felt = model.part == PARTS.index("forearm")
    is_felt[::50] = True
    vertices = np.flatnonzero(is_felt).astype(np.int32)
    indices = np.arange(*rows)
    swing = 0.5 + 0.5 * np.sin(indices / 9.0)
    second = np.full(len(indices), 90.0) + indices
    if stream.modality == "vibration":
        parameters = np.column_stack((8.0 * swing, second))
    else:
        parameters = (33.0 + 6.0 * swing)[:, None]
    weights = (0.2 + 0.8 * (vertices % 5) / 5.0).astype(np.float32)
    return SampleRun(
        stream=stream,
        indices=indices,
        times_s=track_header.time.times_s(indices),
        levels=np.full(len(indices), 0.75),
        parameters=parameters,
        offsets=np.array([0, len(vertices)]),
        vertices=vertices,
        weights=weights,
        sets=np.zeros(len(indices), np.int64),
    )


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("track") / "x.hfxtrack", header())


def written(path: Path, track_header: TrackHeader) -> Path:
    with TrackWriter(path, track_header, full_precision=True) as writer:
        for first in range(0, ROWS, 128):
            block = []
            for stream in track_header.streams:
                low, high = BUZZ if stream.effect_id == "buzz" else WARM
                rows = max(low, first), min(high, first + 128)
                if rows[0] < rows[1]:
                    block.append(run_of(track_header, stream, rows))
            if block:
                writer.append(block)
    return path


def rendered(path: Path, *devices: DeviceConfig) -> Rendered:
    with TrackReader(path) as track:
        return finish(rendering(track, renderers_of_track(track, devices)))


def played(path: Path, device: DeviceConfig) -> Raster:
    with TrackReader(path) as track:
        ((_, raster),) = render_devices(track, [device])
    return raster


def without_script(path: Path, device: DeviceConfig) -> Raster:
    with TrackReader(path) as track:
        return render(track.header, track.runs(), device)


def live_messages(path: Path, device: DeviceConfig) -> list[bytes]:
    """Return live messages to a script at each row of a track, with latency compensation."""
    late_ms = device.actuators[0].type.latency_ms
    late = round(late_ms / 1000.0 * RATE_HZ)
    messages = []
    with TrackReader(path) as track:
        moments: list[list[SampleRun]] = [[] for _ in range(ROWS + late)]
        for run in track.runs():
            for k, index in enumerate(run.indices.tolist()):
                moments[index].append(run.one(k))
        live = MomentRenderer(track.header, device)
        for row in range(ROWS):
            later = {late_ms: at_zero(moments[row + late])} if late else {}
            now = at_zero(moments[row])
            values, _ = live.ahead(now, later)
            time_s = (FIRST + row * FPS / RATE_HZ - START) / FPS
            messages.append(encode_haptics(time_s, live.felt(now), values))
    return messages


def at_zero(runs: list[SampleRun]) -> list[SampleRun]:
    return [replace(run, indices=np.zeros(1, np.int64)) for run in runs]


def test_the_device_plays_the_script_output(folder: Path, path: Path) -> None:
    raster = played(path, scripted(folder, COUNTER))
    counts = np.arange(1, ROWS + 1)
    motors = np.column_stack((counts % 7 * 0.5, np.minimum(100.0 + counts, 250.0)))
    expected = np.tile(motors, (1, 8))
    interval = round(load_device(BAND).actuators[0].type.update_interval_ms / 1000 * RATE_HZ)
    assert interval <= 1  # else values were held
    assert raster.values.tolist() == expected.tolist()


def test_limits_come_after_the_script(folder: Path, path: Path) -> None:
    source = "def render(h):\n    return [1e9, float('nan')] + [1e9, 1e9] * 6 + [-5.0, 90.0]\n"
    actual = rendered(path, scripted(folder, source))
    ((_, raster),) = actual.played
    kind = load_device(BAND).actuators[0].type
    highest = [kind.strength.highest, kind.controls[1].highest]
    assert (raster.values[:, :2] == raster.neutral[:2]).all()  # not a number: silent motor
    assert (raster.values[:, 2:14] == highest * 6).all()
    assert (raster.values[:, 14:] == [0.0, 90.0]).all()
    assert f"no number at {ROWS} of {ROWS} times" in actual.warnings[0]


@pytest.mark.parametrize(("latency_ms", "interval_ms"), [(0, 20), (400, 100)])
def test_a_script_without_changes_has_no_effect(
    folder: Path, path: Path, latency_ms: float, interval_ms: float
) -> None:
    kind = {"latency_ms": latency_ms, "update_interval_ms": interval_ms}
    own_device(folder, "forearm_band", "my_band", **kind)
    device = scripted(folder, "def render(haptics):\n    return haptics.values\n")
    alone, raster = without_script(path, device), played(path, device)
    assert alone.values[:, ::2].any()
    assert raster.values.tobytes() == alone.values.tobytes()
    assert raster.shortfalls == alone.shortfalls
    for mine, scriptless in zip(raster.felt, alone.felt, strict=True):
        assert mine.is_rendered.tolist() == scriptless.is_rendered.tolist()


def test_a_script_has_the_same_input_as_live(folder: Path, path: Path) -> None:
    latency_ms = 125
    own_device(folder, "forearm_band", "my_band", latency_ms=latency_ms)
    log = folder / "told"
    source = (
        "from hashlib import sha256\n"
        f"log = open({str(log)!r}, 'w')\n"
        "def render(h):\n"
        "    told = [h.time_s, h.values.tolist(), h.device.id, [\n"
        "        [e.name, e.modality, e.model, e.level, dict(e.parameters), e.positions]\n"
        "        + [(x.dtype.str, x.shape, sha256(x).hexdigest())\n"
        "           for x in (e.vertices, e.weights, e.gains)] for e in h.felt]]\n"
        "    log.write(repr(told) + '\\n')\n"
        "    log.flush()\n"
        "    return h.values\n"
    )
    device = scripted(folder, source)
    played(path, device)
    exported = log.read_text().splitlines()
    log.unlink()
    answers_live(device, live_messages(path, device))
    live = log.read_text().splitlines()
    assert len(exported) == len(live) == ROWS
    assert "'buzz'" in exported[BUZZ[0]] and "'warm'" in exported[WARM[0]]
    late = round(latency_ms / 1000 * RATE_HZ)
    begins = range(BUZZ[0])  # an export has no time before the track's start
    for row in range(ROWS):
        if row not in begins or row >= late:
            assert exported[row] == live[row], row


def answers_live(device: DeviceConfig, moments: list[bytes]) -> np.ndarray:
    """Return a script's answers to consecutive moments, through the process of live playback."""
    assert device.script is not None
    script = approval.script_of(device.script.configuration)
    assert script is not None
    heard: SimpleQueue[Any] = SimpleQueue()
    wish = {**script.as_request(), "device": str(device.script.device), "folder": None}
    process = ScriptProcess(wish, heard.put, heard.put)
    process.start()
    actual = []
    try:
        for moment in moments:
            process.ask(moment, heard.put)
            actual.append(heard.get(timeout=60.0))
            assert isinstance(actual[-1], np.ndarray), actual[-1]
    finally:
        process.close()
    return np.array(actual)


def test_the_shipped_script_plays_the_same_live_and_in_an_export(folder: Path, path: Path) -> None:
    own_device(folder, "peltier_sleeve", "my_sleeve", latency_ms=0, update_interval_ms=20)
    source = (resources.device_configs() / "peltier_sleeve.py").read_text()
    device = scripted(folder, source, "my_sleeve_left")
    live = answers_live(device, live_messages(path, device))
    raster = played(path, device)
    assert raster.values.max() > raster.neutral[0] + 1.0
    assert raster.values.tolist() == live.tolist()


def test_the_shipped_script_is_trusted_and_makes_ramps(path: Path) -> None:
    device = load_device("peltier_sleeve_right")
    assert device.script is not None and device.side == "right"
    raster, alone = played(path, device), without_script(path, device)
    interval_s = device.actuators[0].type.update_interval_ms / 1000.0
    steps, jumps = np.diff(raster.values, axis=0), np.diff(alone.values, axis=0)
    assert jumps.max() > 1.5 * interval_s + 0.1  # else there is nothing to show
    assert 0.0 < steps.max() <= 1.5 * interval_s + 1e-9
    assert 0.0 > steps.min() >= -1.0 * interval_s - 1e-9


def test_a_script_that_is_not_approved_leaves_its_device_out_and_no_other(
    folder: Path, path: Path
) -> None:
    device = scripted(folder, COUNTER, is_approved=False)
    insoles = load_device("insoles")
    actual = rendered(path, device, insoles)
    assert [item.id for item, _ in actual.played] == ["insoles"]
    assert str(folder / "my_band.py") in actual.silent[BAND]
    assert "not approved" in actual.silent[BAND]
    with pytest.raises(ScriptError, match="not approved"):
        played(path, device)
    assert ScriptError.exit_code == 5


def test_a_changed_byte_asks_again(folder: Path, path: Path) -> None:
    device = scripted(folder, COUNTER)
    assert not rendered(path, device).silent
    (folder / "my_band.py").write_text(COUNTER + "#")
    assert "not approved" in rendered(path, device).silent[BAND]


LATER = "n = 0\ndef render(haptics):\n    global n\n    n += 1\n    if n > 150: {}\n    return {}\n"
WHEN = f"at {(FIRST + 150 / 2 - START) / FPS:.3f} s (frame {FIRST + 75})"
FAULTS = {
    "raises": (LATER.format("1 / 0", "haptics.values"), "division by zero (my_band.py, line 5)"),
    "exits": (LATER.format("raise SystemExit(3)", "haptics.values"), "SystemExit"),
    "dies": (LATER.format("__import__('os').abort()", "haptics.values"), "ended itself"),
    "hangs": (
        LATER.format("\n        while True: pass", "haptics.values"),
        "did not answer within 1 s",
    ),
    "returns too few": (LATER.format("return [1.0]", "haptics.values"), "shape (1,)"),
    "names nobody": (LATER.format("return {'m99': 1.0}", "haptics.values"), "'m99'"),
    "speaks for itself": (
        LATER.format("[__import__('os').write(n, b'x' * 9999) for n in (3, 4, 5)]", "None"),
        "",
    ),
    "floods and hangs": (
        LATER.format("\n        while True: print('x' * 9999)", "haptics.values"),
        "did not answer within 1 s",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_script_that_fails_leaves_its_device_out(
    folder: Path, path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(script_rendering, "ROW_S", 1.0)
    source, reason = FAULTS[name]
    actual = rendered(path, scripted(folder, source))
    assert not actual.played
    sentence = actual.silent[BAND]
    assert str(folder / "my_band.py") in sentence and reason in sentence
    assert name == "speaks for itself" or WHEN in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import sys\nsys.exit()\n", "cannot be started: SystemExit"),
        ("x = 1\n", "cannot be started: TypeError: my_band.py has no function render(haptics)"),
        ("def render(:\n", "cannot be started: SyntaxError"),
        ("import time\ntime.sleep(600)\n", "did not start within 1 s"),
    ],
)
def test_a_script_that_does_not_start_says_so(
    folder: Path, path: Path, monkeypatch: pytest.MonkeyPatch, source: str, reason: str
) -> None:
    if "within" in reason:
        monkeypatch.setattr(script_rendering, "START_S", 1.0)
    # Another version of Python may have approved a script that this version does not compile.
    monkeypatch.setattr(approval, "compiled", lambda *_: None)
    assert reason in rendered(path, scripted(folder, source)).silent[BAND]


def test_a_slow_script_may_take_longer_than_live_but_not_for_ever(
    folder: Path, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = "import time\nt = 0\ndef render(h):\n    time.sleep(0.15 if h.time_s < 1.6 else 0)\n"
    device = scripted(folder, slow)
    assert not rendered(path, device).silent
    monkeypatch.setattr(script_rendering, "SUM_S", 0.2)
    monkeypatch.setattr(script_rendering, "SUM_ROW_S", 0.0)
    assert "longer than 0.2 s for 300 rows" in rendered(path, device).silent[BAND]


def test_a_script_that_prints_a_lot_is_not_in_its_own_way(folder: Path, path: Path) -> None:
    source = (
        "import os\ndef render(h):\n"
        "    os.write(1, b'x' * 9999)\n    print('x' * 9999)\n    return [1.0, 100.0] * 8\n"
    )
    assert (played(path, scripted(folder, source)).values[:, ::2] == 1.0).all()


def test_the_same_track_gives_the_same_bytes(folder: Path, path: Path) -> None:
    # The order of a set of strings differs between processes unless the hash seed is fixed.
    source = (
        "def render(h):\n"
        "    order = list({'a', 'b', 'c', 'd', 'e', 'f'})\n"
        "    return [1.0 + order.index('a'), 100.0 + order.index('b')] * 8\n"
    )
    device = scripted(folder, source)
    several = {played(path, device).values.tobytes() for _ in range(3)}
    assert len(several) == 1


def test_each_wearer_has_a_script_of_its_own(folder: Path, tmp_path: Path) -> None:
    both = written(tmp_path / "two.hfxtrack", header(("anna", "bert")))
    device = scripted(folder, COUNTER)
    actual = rendered(both, device)
    assert [raster.body_id for _, raster in actual.played] == ["anna", "bert"]
    first, second = (raster.values for _, raster in actual.played)
    assert first.any() and first.tobytes() == second.tobytes()


def test_substitution_by_a_script_counts_as_played(folder: Path, path: Path) -> None:
    """For a band of motors without temperature, the script plays warmth as vibration."""
    source = (
        "def render(h):\n"
        "    warm = h.strongest('temperature')\n"
        "    if warm is None:\n"
        "        return h.values\n"
        "    return [3.0, 100.0] * 8\n"
    )
    device = scripted(folder, source)
    missing = {
        (shortfall.effect_id, shortfall.reason)
        for shortfall in without_script(path, device).shortfalls
    }
    assert ("warm", "modality") in missing
    raster = played(path, device)
    assert not [shortfall for shortfall in raster.shortfalls if shortfall.effect_id == "warm"]
    silence = scripted(folder, "def render(h):\n    return None\n")
    lost = {shortfall.effect_id: shortfall.share for shortfall in played(path, silence).shortfalls}
    assert lost == {"buzz": 1.0, "warm": 1.0}


def test_scripts_run_where_a_track_is_converted(folder: Path, path: Path, tmp_path: Path) -> None:
    device = scripted(folder, "def render(h):\n    return [2.0, 100.0] * 8\n")
    target = tmp_path / "x.csv"
    convert(path, target, device=str(folder / "my_band.json"))
    lines = [line for line in target.read_text().splitlines() if line[:1].isdigit()]
    assert len(lines) == ROWS and all(line.split(",")[1] == "2" for line in lines)
    target.unlink()
    (folder / "my_band.py").write_text("def render(h): return 1\n")
    with pytest.raises(ScriptError, match="not approved"):
        convert(path, target, device=device.id)
    assert not target.exists()


@pytest.fixture
def of_device() -> Callable[[], str]:
    return lambda: journal.device_hash(BAND)


def test_an_export_is_made_from_the_script_and_its_approval(
    folder: Path, of_device: Callable[[], str]
) -> None:
    actual = [of_device()]
    scripted(folder, COUNTER, is_approved=False)
    actual.append(of_device())
    scripted(folder, COUNTER)
    actual.append(of_device())
    assert of_device() == actual[-1]
    (folder / "my_band.py").write_text(COUNTER + "\n")
    actual.append(of_device())
    scripted(folder, COUNTER + "\n")
    actual.append(of_device())
    assert len(set(actual)) == 5


def test_the_shipped_script_is_in_the_wheel_and_the_extension(monkeypatch: Any) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    import build_addon

    assert "device_configs/peltier_sleeve.py" in build_addon.files()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["force-include"]["device_configs"] == "hfx_blender/device_configs"
    assert not any("py" in pattern for pattern in wheel["exclude"])


def test_names_of_artists_and_jumps_reach_the_script(folder: Path, path: Path) -> None:
    source = """
calls = 0


def render(h):
    global calls
    calls += 1
    if calls in (1, 2):
        print(calls, h.jumped, h.stopped)
    if h.felt and calls < 30:
        assert [(e.name, e.label) for e in h.felt] == [("buzz", "Buzz")], h.felt
    return None
"""
    notes = rendered(path, scripted(folder, source)).notes
    printed = [note for note in notes if "printed" in note]
    assert printed == [
        f"device '{BAND}': its script printed: 1 True True",
        f"device '{BAND}': its script printed: 2 False False",
    ]


def test_printed_lines_of_all_rows_are_counted(folder: Path, path: Path) -> None:
    source = """
calls = 0


def render(h):
    global calls
    calls += 1
    for k in range(4 if calls <= 10 else 0):
        print(calls, k)
"""
    notes = rendered(path, scripted(folder, source)).notes
    name = f"device '{BAND}': its script printed"
    # Of 40 lines in the first 10 rows the report has 20, those of 5 rows.
    lines = [f"{name}: {row} {k}" for row in range(1, 6) for k in range(4)]
    assert [note for note in notes if "printed" in note] == [*lines, f"{name} 20 more lines"]


def test_many_printed_lines_are_counted(folder: Path, path: Path) -> None:
    source = """
print("\\n".join(f"line {k}" for k in range(33)))


def render(h):
    raise ValueError("no")
"""
    actual = rendered(path, scripted(folder, source))
    assert actual.silent
    printed = [note for note in actual.notes if "printed" in note]
    assert len(printed) == 21
    assert printed[0].endswith("printed: line 0") and printed[19].endswith("printed: line 19")
    assert printed[20] == f"device '{BAND}': its script printed 13 more lines"


CUSTOM = {
    "focus_x": {"unit": "m", "minimum": -0.1, "maximum": 0.1},
    "pattern": {"choices": ["off", "sweep", "burst"]},
}


def test_a_script_sets_custom_columns_within_their_ranges(
    folder: Path, path: Path, tmp_path: Path
) -> None:
    own_device(folder, "forearm_band", "my_band", custom=CUSTOM)
    source = """
def render(h):
    assert h.columns[2:4] == (("m1", "focus_x"), ("m1", "pattern")), h.columns
    if h.time_s < 2.0:
        return {"m1": {"amplitude_m_s2": 3.0, "focus_x": 9.0, "pattern": "burst"}, "m2": 1.0}
    return None
"""
    device = scripted(folder, source)
    raster = played(path, device)
    row = raster.values[0]
    assert row[:4].tolist() == [3.0, 100.0, 0.1, 2.0]
    assert row[4:8].tolist() == [1.0, 100.0, 0.0, 0.0]
    assert raster.values[-1].tolist() == device.neutral.tolist()
    assert [(c.parameter, c.unit) for c in raster.columns[2:4]] == [
        ("focus_x", "m"),
        ("pattern", "choice"),
    ]
    # The guard has the same ranges in live playback; a number that is none silences the actuator.
    limited = Guard(device).limited([3.0, 100.0, -9.0, 1.9, 3.0, 100.0, math.nan, 1.0] * 4, 1.0)
    assert limited[:8].tolist() == [3.0, 100.0, -0.1, 1.0, 0.0, 100.0, 0.0, 0.0]
    convert(path, tmp_path / "x.csv", device=BAND)
    head = (tmp_path / "x.csv").read_text().splitlines()[0].split(",")
    assert head[3:5] == ["m1.focus_x [m]", "m1.pattern [choice]"]


@pytest.mark.parametrize(
    ("answer", "share"),
    [("{'focus_x': 0.05}", None), ("{'pattern': 'burst'}", None), ("{'frequency_hz': 150}", 1.0)],
)
def test_custom_columns_alone_count_as_playing(
    folder: Path, path: Path, answer: str, share: float | None
) -> None:
    """A force device has no strength, only columns of its own; a frequency alone plays nothing."""
    own_device(folder, "forearm_band", "my_band", custom=CUSTOM)
    source = f"def render(h):\n    return {{'m1': {answer}}} if h.felt else None\n"
    lost = {s.effect_id: s.share for s in played(path, scripted(folder, source)).shortfalls}
    assert lost == ({} if share is None else {"buzz": share, "warm": share})


def test_a_choice_that_does_not_exist_is_named(folder: Path, path: Path) -> None:
    own_device(folder, "forearm_band", "my_band", custom=CUSTOM)
    source = "def render(h):\n    return {'m1': {'pattern': 'wave'}}\n"
    (reason,) = rendered(path, scripted(folder, source)).silent.values()
    assert "'wave' for control 'pattern' of actuator 'm1'; allowed is off, sweep, burst" in reason


def test_a_clip_leaves_custom_columns_out(folder: Path, path: Path, tmp_path: Path) -> None:
    own_device(folder, "forearm_band", "my_band", custom=CUSTOM)
    scripted(folder, "def render(h):\n    return {'m1': {'pattern': 'sweep'}, 'm2': 2.0}\n")
    convert(path, tmp_path / "x.hfxclip", device=BAND)
    content = (tmp_path / "x.hfxclip").read_bytes()
    assert not clip_rules.validate(content, "x")
    sections = clip_rules.read(content, "x")
    assert len(sections["COLM"]) == 16  # two for each of eight motors
    _, values = clip_rules.values_of(sections, 1)
    assert values.max(axis=0).tolist() == pytest.approx([2.0, 100.0], abs=0.01)


def test_the_thermal_grill_warms_and_cools_neighbours(path: Path) -> None:
    raster = played(path, load_device("thermal_grill"))
    assert raster.actuators == ("warm1", "cool1", "warm2", "cool2", "warm3", "cool3")
    warm, cool = raster.values[:, ::2] - 33.0, 33.0 - raster.values[:, 1::2]
    assert (warm >= 0.0).all() and (cool >= 0.0).all()
    # Craig and Bushnell 1994: bars of 40 and 20 degC, so 7 and 13 from the skin at 33.
    assert warm.max() <= 7.0 and cool.max() <= 13.0 and warm.max() > 1.0
    assert cool[:, 0] == pytest.approx(warm[:, :2].max(axis=1) * 13.0 / 7.0)  # between two bars
    together = warm.any(axis=1)
    assert together.any() and (together == cool.any(axis=1)).all()
    assert raster.values[-1].tolist() == [33.0] * 6


def test_the_ultrasound_array_focuses_on_the_middle_of_the_palm(tmp_path: Path) -> None:
    """The focal point is the weighted mean of the touched places, from the array's centre."""
    track_header = header()
    stream = next(s for s in track_header.streams if s.modality == "vibration")
    palm = np.flatnonzero(load_model(stream.model_id).part == PARTS.index("hand_palm"))[:3]
    places = np.array([[0.0, -0.5, 1.2], [0.04, -0.5, 1.2], [0.02, -0.44, 1.2]], np.float32)
    run = SampleRun(
        stream=stream,
        indices=np.arange(20, 30),
        times_s=track_header.time.times_s(np.arange(20, 30)),
        levels=np.ones(10),
        parameters=np.tile([4.0, 150.0], (10, 1)),
        offsets=3 * np.arange(11),
        vertices=np.tile(palm.astype(np.int32), 10),
        weights=np.tile(np.float32([1.0, 1.0, 0.5]), 10),
        positions=np.tile(places, (10, 1)),
    )
    with TrackWriter(tmp_path / "x.hfxtrack", track_header, full_precision=True) as writer:
        writer.append([run])
    raster = played(tmp_path / "x.hfxtrack", load_device("ultrasound_array"))
    names = [column.parameter for column in raster.columns]
    assert names == ["amplitude_m_s2", "frequency_hz", "focus_x", "focus_y", "focus_z"]
    middle = (places[0] + places[1] + 0.5 * places[2]) / 2.5 - [0.0, -0.5, 1.0]
    assert raster.values[25] == pytest.approx([4.0, 150.0, *middle], abs=1e-6)
    assert raster.values[200].tolist() == [0.0, 200.0, 0.0, 0.0, 0.2]
