# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo's promises: all four tasks of the study give contacts and output, in time."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import bpy
import hfx_scenes
import numpy as np
import pytest
from hfx_scenes import names_in, process

from hfx_blender import cli
from hfx_blender.authoring.effects import effects
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.processes import blender_session
from hfx_tools.demo import avatar_pictures
from hfx_tools.demo.garage import DEVICES, TASKS, Task

SAMPLE_S = 0.01  # the demo's devices are rendered at 100 Hz


@dataclass(frozen=True)
class Played:
    """A CSV of the demo."""

    times_s: np.ndarray  # times of the values
    values: Mapping[str, np.ndarray]  # by column, frequencies left out
    latency_s: float  # latency of the slowest actuator, until the output is perceptible
    update_s: float  # time between two accepted values

    @classmethod
    def read(cls, path: Path) -> Played:
        with open(path, newline="", encoding="utf-8") as file:
            head, *rows = csv.reader(file)
        table = np.array(rows, np.float64)
        strengths = {n: table[:, k] for k, n in enumerate(head) if k and "[Hz]" not in n}
        device = load_device(path.name.split(".")[1])
        kinds = [actuator.type for actuator in device.actuators]
        latency_ms = max(kind.latency_ms for kind in kinds)
        update_ms = max(kind.update_interval_ms for kind in kinds)
        return cls(table[:, 0], strengths, latency_ms / 1000.0, update_ms / 1000.0)

    @property
    def is_on(self) -> np.ndarray:
        """Rows different from the last, silent row."""
        return np.any([value != value[-1] for value in self.values.values()], axis=0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("work") / "new" / "demo"


@pytest.fixture(scope="module")
def demo(folder: Path) -> subprocess.CompletedProcess[str]:
    done = process("demo", "--no-pictures", "-o", folder)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def played(demo: Any, folder: Path) -> dict[str, Played]:
    return {name: Played.read(folder / f"garage.{name}.csv") for name in DEVICES}


def test_it_says_what_happened_and_nothing_else(
    demo: subprocess.CompletedProcess[str], folder: Path
) -> None:
    assert demo.stderr == ""
    for noise in ("Info:", "Read blend", "Warning:", "\r", "\x1b"):
        assert noise not in demo.stdout
    for task in TASKS:
        assert f"{task.name}  {task.title}" in demo.stdout
        assert all(name in demo.stdout for name in task.effects)
    assert "played by      nothing" not in demo.stdout
    assert f"hfx export {folder / 'garage.blend'}" in demo.stdout


def test_it_writes_what_it_names(demo: Any, folder: Path) -> None:
    expected = {"garage.blend", "garage.hfxtrack", "garage.report.json", "chart.svg"}
    expected |= {f"garage.{name}.csv" for name in DEVICES}
    assert expected <= set(names_in(folder))
    assert not [name for name in names_in(folder) if "tmp" in name or name.startswith(".")]
    assert ElementTree.parse(folder / "chart.svg").getroot().tag.endswith("}svg")


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_each_task_is_played_by_a_device(played: dict[str, Played], task: Task) -> None:
    players = [
        name
        for name, item in played.items()
        if item.is_on[(item.times_s >= task.start_s) & (item.times_s < task.end_s)].any()
    ]
    assert players, f"{task.name} is silent on all devices"


def test_nothing_is_played_between_the_tasks(played: dict[str, Played]) -> None:
    for name, item in played.items():
        within = np.zeros(len(item.times_s), np.bool_)
        for task in TASKS:
            # A clip includes the last frame: a single sample. A late actuator gets values early, at
            # the update before.
            begin_s = task.start_s - item.latency_s - item.update_s
            end_s = task.end_s + SAMPLE_S / 2
            within |= (item.times_s >= begin_s) & (item.times_s <= end_s)
        assert not item.is_on[~within].any(), name
        assert item.times_s[-1] > TASKS[-1].end_s  # or the end would prove nothing


def test_the_fire_warms_and_the_wind_blows(played: dict[str, Played]) -> None:
    room = played["fan_heater"]
    [warmth] = [values for name, values in room.values.items() if "degC" in name]
    [wind] = [values for name, values in room.values.items() if "m/s" in name]
    # The heater needs 3 s, and the scene begins by the fire: no earlier command is possible.
    by_the_fire = room.times_s < 1.9
    assert warmth[-1] == 24.0 and (warmth[by_the_fire] > 24.5).all()
    assert warmth.max() == pytest.approx(30.0), "as warm as the paper's sphere"
    assert (wind[by_the_fire] == 0).all()
    gale = (room.times_s >= 5.5 - 0.5) & (room.times_s < 6.5 - 0.5)  # the fan needs 0.5 s
    assert (wind[gale] > 1.0).all() and (warmth[gale] == 24.0).all()


def test_the_arrow_is_felt_on_the_back_only(demo: Any, folder: Path) -> None:
    from hfx_blender.engine.body.model import load_model

    with TrackReader(folder / "garage.hfxtrack") as track:
        names = {effect.id: effect.name for effect in track.header.effects}
        felt_samples = {names[s.stream.effect_id]: s for s in track.samples_at(2.75)}
    assert set(felt_samples) == {"T2 Arrow"}
    model = load_model("hfx-pressure-1")
    arrow = felt_samples["T2 Arrow"].vertices
    assert set(model.part[arrow]) == {PARTS.index("torso")}
    assert (model.normals[arrow, 1] > 0).all()  # the body faces -Y
    # The arrow points to the wearer's right, -X: the tip is narrower than the head behind the tip.
    x, z = model.vertices[arrow, 0], model.vertices[arrow, 2]
    tip, wings = x < x.min() + 0.03, (x > -0.07) & (x < -0.04)
    assert np.ptp(z[tip]) < np.ptp(z[wings]) and len(arrow) > 50


def test_the_heart_beats_twice_a_second_within_its_fades(played: dict[str, Played]) -> None:
    pad = played["back_pad"]
    drive = np.max([v for n, v in pad.values.items() if "amplitude" in n], axis=0)
    felt_s = pad.times_s + pad.latency_s
    at = dict(zip(np.round(felt_s, 3).tolist(), drive.tolist(), strict=True))
    full = at[13.54]  # the second beat's first pulse, after the fade in
    assert full > 1.0
    # Pulses of 1 and 0.6 at 0.04 s and 0.19 s of each half second; fades of 0.5 s at both ends.
    for beat, fade in enumerate((lambda t: t / 0.5, None, None, lambda t: (2.0 - t) / 0.5)):
        for offset, height in ((0.04, 1.0), (0.1, 0.0), (0.19, 0.6), (0.3, 0.0), (0.45, 0.0)):
            t = 0.5 * beat + offset
            expected = height * (1.0 if fade is None else fade(t)) * full
            assert at[round(13.0 + t, 3)] == pytest.approx(expected, abs=0.01 * full), t
    rises = np.flatnonzero(np.diff((drive > 0.05 * full).astype(int)) == 1)
    heartbeat = felt_s[rises] >= 12.9
    assert np.count_nonzero(heartbeat) == 8  # two pulses each


def test_the_track_takes_at_most_a_byte_for_each_entry(demo: Any, folder: Path) -> None:
    path = folder / "garage.hfxtrack"
    with TrackReader(path) as track:
        entries = sum(item.entry_count for item in track.summary())
        assert not track.full_precision
    assert entries > 1_000_000
    assert path.stat().st_size <= entries


def test_the_saved_scene_exports_to_the_same_track_elsewhere(
    demo: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONHASHSEED", "7")
    done = process("export", folder / "garage.blend", "-o", tmp_path, "--device", "insoles")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "garage.hfxtrack").read_bytes() == (folder / "garage.hfxtrack").read_bytes()
    assert (tmp_path / "garage.insoles.csv").read_bytes() == (
        folder / "garage.insoles.csv"
    ).read_bytes()
    # Insoles play nothing of the back, of the air or of the chest.
    lost = {item["effect"]: item["share"] for item in _report(tmp_path)["unrendered"]}
    assert {"T1 Fire", "T2 Arrow", "T3 Wind", "T4 Heartbeat"} <= set(lost)
    assert {lost["T1 Fire"], lost["T2 Arrow"], lost["T4 Heartbeat"]} == {1.0}
    assert "T2 Arrow: 0.49 s of it (100%) felt by Avatar but played by no device" in done.stdout


def _report(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "garage.report.json").read_text())
    return document


def test_the_report_holds_what_was_felt(demo: Any, folder: Path) -> None:
    felt_samples = {item["effect"]: item for item in _report(folder)["felt"]}
    assert set(felt_samples) == {name for task in TASKS for name in task.effects}
    for task in TASKS:
        for name in task.effects:
            assert felt_samples[name]["seconds"] > 0.0
            assert felt_samples[name]["first_s"] >= task.start_s
            assert felt_samples[name]["last_s"] <= task.end_s
    assert felt_samples["T3 Lightning"]["seconds"] == pytest.approx(3 * 0.15, abs=2 * SAMPLE_S)


def test_json_and_a_second_run_over_the_first(
    registered: Any, demo: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = Path(shutil.copytree(folder, tmp_path / "again"))
    (again / "garage.hfxtrack").write_bytes(b"another")
    assert cli.run(["demo", "--no-pictures", "--json", "-o", str(again)]) == 0
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert err == "" and document["pictures"] is None and document["scene"] == "Garage"
    with TrackReader(again / "garage.hfxtrack") as track:
        assert len(track.header.effects) == sum(len(task.effects) for task in TASKS)


def test_a_folder_that_cannot_be_made_is_one_line(
    registered: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    assert cli.run(["demo", "--no-pictures", "-o", str(tmp_path / "file" / "x")]) == 3
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and str(tmp_path / "file") in err


def test_without_pictures_the_rest_is_there(
    registered: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def crashed(*arguments: object, **_settings: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(["draw"], -6, stdout="", stderr="")

    monkeypatch.setattr("hfx_tools.processes.run", crashed)
    assert cli.run(["demo", "-o", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert err.splitlines() == [
        "hfx: no pictures: this machine could not draw them "
        "(the drawing process ended with code -6)"
    ]
    assert "felt.png" not in out and (tmp_path / "garage.hfxtrack").exists()


def test_the_saved_scene_does_not_name_the_users_folder(
    demo: Any, folder: Path, registered: Any
) -> None:
    blender_session.open_blend(folder / "garage.blend")
    spaces = [s for screen in bpy.data.screens for area in screen.areas for s in area.spaces]
    browsers = [s.params for s in spaces if s.type == "FILE_BROWSER" and s.params is not None]
    assert {browser.directory for browser in browsers} == {b"//"}


# The pictures' parts


def test_what_is_felt_colours_the_picture(
    registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = hfx_scenes.small_scene(frame_end=1)
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    touch = bpy.data.objects["Touch"]
    bpy.context.view_layer.objects.active = touch
    touch.hfx.pressure = 20.0
    bpy.ops.hfx.fill_part(part="torso")
    export_scene(scene, tmp_path, "x", ExportSettings())
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    scene.collection.objects.link(lamp)
    lamp.rotation_euler = (1.2, 0.0, 0.0)
    monkeypatch.setattr(avatar_pictures, "SIZE", (32, 40))
    avatar_pictures.set_up_rendering(scene)
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    body = effects.bodies_of(scene)[0]
    avatar_pictures.show_felt_colours(body.hfx.avatar)
    avatar_pictures.aim(scene, body, TASKS[0])
    shown = {}
    with TrackReader(tmp_path / "x.hfxtrack") as track:
        objects = avatar_pictures.effects_by_id(scene)
        named = {effect.id: effect.name for effect in track.header.effects}
        assert {uid: obj.name for uid, obj in objects.items()} == named
        felt_samples = track.samples_at(0.0)
        calm = [] if not felt_samples else [_faint(felt_samples[0])]
        for name, samples in (("calm", calm), ("felt", felt_samples)):
            avatar_pictures.colour_by_samples(body.hfx.avatar, samples, track.header)
            shown[name] = _vertex_colours(body.hfx.avatar)
            scene.render.filepath = str(tmp_path / f"{name}.png")
            bpy.ops.render.render(write_still=True)
    # The torso's middle turns green (pressure), the head stays unchanged.
    rest = load_avatar().vertices
    chest = np.argmin(((rest - (0.0, -0.1, 1.25)) ** 2).sum(axis=1))
    top = np.argmax(rest[:, 2])
    assert np.allclose(shown["felt"][top], shown["calm"][top], atol=0.02)
    red, green, _ = shown["felt"][chest]
    assert green > 2 * red and not np.allclose(shown["felt"][chest], shown["calm"][chest])
    calm_picture, felt_picture = (_pixels(tmp_path / f"{n}.png") for n in ("calm", "felt"))
    assert calm_picture.shape == (40, 32, 3)
    content = (tmp_path / "felt.png").read_bytes()
    assert b"tEXtFile" not in content and b"tEXtDate" not in content, "no place and time"
    greener = _greenness(felt_picture) - _greenness(calm_picture)
    assert np.count_nonzero(greener > 0.05) >= 10  # area of the torso in pixels


def _faint(sample: Any) -> Any:
    from dataclasses import replace

    return replace(sample, level=1e-6)


def _vertex_colours(avatar: Any) -> np.ndarray:
    flat = np.zeros(len(avatar.data.vertices) * 4, np.float32)
    avatar.data.attributes[avatar_pictures.FELT].data.foreach_get("color", flat)
    return flat.reshape(-1, 4)[:, :3]


def _pixels(path: Path) -> np.ndarray:
    picture = bpy.data.images.load(str(path))
    flat = np.zeros(len(picture.pixels), np.float32)
    picture.pixels.foreach_get(flat)
    return flat.reshape(picture.size[1], picture.size[0], -1)[..., :3]


def _greenness(pixels: np.ndarray) -> np.ndarray:
    return pixels[..., 1] - (pixels[..., 0] + pixels[..., 2]) / 2
