# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of real scenes: parts, clips, skipped finished work, and killed workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest
from hfx_scenes import command, contents_of, environment, names_in

from hfx_blender import cli
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.batch import batch
from hfx_blender.export.batch.batch import ThisProcess
from hfx_blender.export.batch.units import ExportOptions, Unit
from hfx_blender.processes.messages import read_message
from hfx_tools.export_workers.local_workers import LocalWorkers
from hfx_tools.export_workers.unit_messages import encode_unit

bpy = pytest.importorskip("bpy")

FORMATS = ("track", "csv", "npz", "wav", "hjif", "jsonl", "glb", "clip")
FRAMES = 80  # at 25 frames and 100 samples a second: two whole chunks of a track and a bit


def _moving_scene() -> Any:
    """A ball moving through the avatar, a clip and a painted effect."""
    scene = hfx_scenes.small_scene(FRAMES - 1)
    ball, touch = bpy.data.objects["Ball"], bpy.data.objects["Touch"]
    ball.hfx.radius = 0.1
    for frame, x in ((0, -0.4), (30, 0.2), (79, 0.3)):
        ball.location = (x, 0.0, 1.0)
        ball.keyframe_insert("location", frame=frame)
    bpy.context.view_layer.objects.active = touch
    bpy.ops.hfx.add_clip(start=31.0, duration=1.5)  # over the end of the first chunk
    return scene


def _unit(blend: Path, folder: Path, stage: Path, **changes: Any) -> Unit:
    folder.mkdir(exist_ok=True)
    stage.mkdir(exist_ok=True)
    more = {k: changes.pop(k) for k in ("part_frames", "parts") if k in changes}
    options = ExportOptions(**changes)
    return Unit("scene", str(blend), str(folder), blend.stem, str(stage), options, **more)


def _export(unit: Unit, workers: Any = None) -> dict[str, Any]:
    [outcome] = batch.run([unit], workers or ThisProcess())
    assert "error" not in outcome, outcome
    return outcome


def _last_json(text: str) -> Any:
    """Parse the JSON printed by a command after Blender's own output."""
    return json.loads(text[text.index("\n{") :] if "\n{" in text else text)


@pytest.fixture(scope="module")
def moving(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    _moving_scene()
    return hfx_scenes.save(tmp_path_factory.mktemp("moving") / "moving.blend")


# Parts


@pytest.mark.parametrize(
    "options",
    [
        {"formats": FORMATS, "devices": ("back_pad", "insoles")},
        {"full_precision": True, "record": ("positions", "velocities", "depth")},
        {"tolerance": "preview", "rate": "1000/7", "frames": (3, 60)},
    ],
    ids=["formats", "recorded", "preview"],
)
def test_parts_are_put_together_to_the_same_bytes(
    moving: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    whole = _export(_unit(moving, tmp_path / "whole", tmp_path / "s", **options))
    parts = _export(_unit(moving, tmp_path / "parts", tmp_path / "s", part_frames=20, **options))
    assert len(list((tmp_path / "s").glob("0*"))) >= 3  # the parts
    assert whole["report"] == parts["report"]
    assert contents_of(tmp_path / "whole") == contents_of(tmp_path / "parts")


def test_what_rings_on_rings_over_the_end_of_a_part(registered: Any, tmp_path: Path) -> None:
    from hfx_blender.authoring import responses

    _moving_scene()
    impact = responses.add_filter(bpy.data.objects["Ball"], "impact")
    impact.decay = 0.8
    bpy.data.objects["Ball"].animation_data_clear()
    ball = bpy.data.objects["Ball"]
    for frame, x in ((0, -0.6), (29, -0.6), (31, 0.0), (32, -0.6)):  # touches before sample 128
        ball.location = (x, 0.0, 1.0)
        ball.keyframe_insert("location", frame=frame)
    blend = hfx_scenes.save(tmp_path / "ringing.blend")
    whole = _export(_unit(blend, tmp_path / "whole", tmp_path / "s"))
    assert whole["report"]["felt"][0]["last_s"] > 1.28  # contacts in the second part, too
    _export(_unit(blend, tmp_path / "parts", tmp_path / "s", part_frames=20))
    assert contents_of(tmp_path / "whole") == contents_of(tmp_path / "parts")


def test_scenes_of_a_file_that_are_not_exported_are_named(registered: Any, tmp_path: Path) -> None:
    scene = _moving_scene()
    ball = bpy.data.objects["Ball"]
    bpy.data.scenes.new("Empty")
    bpy.data.scenes.new("Same effect").collection.objects.link(ball)
    own = ball.copy()
    for name in ("Behind", "Night"):
        bpy.data.scenes.new(name).collection.objects.link(own)
        own = own.copy()
    scene.background_set = bpy.data.scenes["Behind"]
    name = scene.name
    blend = hfx_scenes.save(tmp_path / "four.blend")
    day = _export(_unit(blend, tmp_path / "day", tmp_path / "s"))
    assert day["remarks"] == ["effects of other scenes need --scene NAME: Night"]
    chosen = _export(_unit(blend, tmp_path / "chosen", tmp_path / "s", scene=name))
    assert chosen["remarks"] == []


def test_physics_is_exported_in_one_go_and_that_is_said(registered: Any, tmp_path: Path) -> None:
    _moving_scene()
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(0, 0, 1.6))
    bpy.ops.rigidbody.object_add()
    bpy.ops.hfx.volume_from_mesh(modality="vibration", name="Falling")
    falling = bpy.context.object
    falling.name = "Falling"
    # Only the source is simulated: a rigid body below another is a dependency cycle.
    assert falling.rigid_body is None and falling.parent.rigid_body is not None
    blend = hfx_scenes.save(tmp_path / "falling.blend")
    whole = _export(_unit(blend, tmp_path / "whole", tmp_path / "s"))
    parts = _export(_unit(blend, tmp_path / "parts", tmp_path / "s", part_frames=20))
    assert whole["remarks"] == []
    [remark] = parts["remarks"]
    assert "in one go" in remark and "physics" in remark
    assert contents_of(tmp_path / "whole") == contents_of(tmp_path / "parts")


# Clips


def test_each_named_clip_is_a_file_of_its_own_from_time_0(moving: Path, tmp_path: Path) -> None:
    unit = _unit(
        moving, tmp_path / "o", tmp_path / "s",
        formats=("track", "csv", "hjif"), devices=("insoles",), per_clip=True,
    )  # fmt: skip
    outcome = _export(unit)
    assert names_in(tmp_path / "o") == [
        "moving.Clip.hfx-pressure-1.glb",
        "moving.Clip.hfxtrack",
        "moving.Clip.hjif",
        "moving.Clip.insoles.csv",
        "moving.report.json",
    ]
    with TrackReader(tmp_path / "o" / "moving.Clip.hfxtrack") as track:
        [stream] = track.summary()
        assert (stream.first_s, stream.last_s) == (0.0, 1.5)
        assert [effect.name for effect in track.header.effects] == ["Touch"]
    assert [item["effect"] for item in outcome["report"]["felt"]] == ["Touch"]


def test_a_scene_without_clips_has_none_to_write(registered: Any, tmp_path: Path) -> None:
    hfx_scenes.small_scene()
    blend = hfx_scenes.save(tmp_path / "small.blend")
    unit = _unit(blend, tmp_path / "o", tmp_path / "s", per_clip=True)
    [outcome] = batch.run([unit], ThisProcess())
    assert outcome["exit_code"] == 3 and "no effect has a clip" in outcome["error"]
    assert names_in(tmp_path / "o") == []


# Skipping finished work


def test_only_what_changed_is_done_again(
    registered: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hfx_scenes.small_scene()
    blend, out = hfx_scenes.save(tmp_path / "small.blend"), tmp_path / "out"

    def is_left_out(*options: str) -> bool:
        assert cli.run(["export", str(blend), "-o", str(out), "--resume", "--json", *options]) == 0
        document = _last_json(capsys.readouterr().out)
        assert (out / "small.hfxtrack").is_file() or options
        return bool(document.get("unchanged"))

    assert not is_left_out()
    first = contents_of(out)
    assert is_left_out() and contents_of(out) == first
    (out / "small.hfxtrack").write_bytes(first["small.hfxtrack"][:-1] + b"x")
    assert not is_left_out() and contents_of(out) == first
    (out / "small.hfxtrack").unlink()
    assert not is_left_out() and contents_of(out) == first
    for torn in (first["small.report.json"][:300], b'{"made_from": {}, "files": 3}'):
        (out / "small.report.json").write_bytes(torn)
        assert not is_left_out() and contents_of(out) == first
    assert not is_left_out("--frames", "0:3") and not is_left_out()
    assert not is_left_out("--device", "back_pad", "-f", "track,csv")
    assert is_left_out("--device", "back_pad", "-f", "track,csv")
    blend_bytes = blend.read_bytes()
    bpy.data.objects["Ball"].location.x += 0.1
    hfx_scenes.save(blend)
    assert not is_left_out("--device", "back_pad", "-f", "track,csv")
    blend.write_bytes(blend_bytes)
    assert not is_left_out()


def test_a_changed_library_or_device_is_a_change(
    registered: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hfx_scenes.small_scene()
    library = hfx_scenes.save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, expected):
        expected.scenes = ["Scene"]
    bpy.data.libraries[0].filepath = "//library.blend"
    [linked] = [scene for scene in bpy.data.scenes if scene.library is not None]
    bpy.context.window.scene = linked
    user = tmp_path / "user.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(user))
    device = tmp_path / "mine.json"
    shipped = (hfx_scenes.ROOT / "device_configs" / "back_pad.json").read_text()
    device.write_text(shipped.replace('"back_pad"', '"mine"'))

    def is_left_out() -> bool:
        arguments = ["export", str(user), "-o", str(tmp_path / "out"), "--resume", "--json"]
        assert cli.run([*arguments, "--device", str(device)]) == 0
        return bool(_last_json(capsys.readouterr().out).get("unchanged"))

    assert not is_left_out() and is_left_out()
    device.write_text(device.read_text() + "\n")
    assert not is_left_out() and is_left_out()
    hfx_scenes.small_scene()
    bpy.data.objects["Ball"].location.x = 0.1
    hfx_scenes.save(library)
    assert not is_left_out() and is_left_out()


# Workers


def _copies(blend: Path, folder: Path, count: int) -> list[Path]:
    paths = [folder / f"copy{k}.blend" for k in range(count)]
    for path in paths:
        path.write_bytes(blend.read_bytes())
    return paths


def test_workers_that_are_killed_cost_no_result(moving: Path, tmp_path: Path) -> None:
    _export(_unit(moving, tmp_path / "one", tmp_path / "s"))
    workers = LocalWorkers(2)
    killed: list[int] = []

    def kill(share: float) -> None:
        if share > 0.0 and not killed:
            killed.append(workers.pids[0])
            os.kill(killed[0], signal.SIGKILL)

    units = [_unit(moving, tmp_path / "out", tmp_path / "s", part_frames=20)]
    try:
        [outcome] = batch.run(units, workers, progress=kill)
        pids = workers.pids
    finally:
        workers.close()
    assert "error" not in outcome and killed and killed[0] not in pids
    assert contents_of(tmp_path / "out") == contents_of(tmp_path / "one")


def test_an_interrupted_batch_goes_on_where_it_was(
    moving: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenes = _copies(moving, tmp_path, 4)
    arguments = ["export", *scenes, "-o", tmp_path / "out", "--jobs", 2]
    started = subprocess.Popen(
        command(*arguments), env=environment(), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert started.stdout is not None
    assert "2 files" in started.stdout.readline()
    started.send_signal(signal.SIGINT)
    _, err = started.communicate(timeout=60)
    assert started.returncode == 130
    assert "--resume goes on" in err
    complete = {path.stem.split(".")[0] for path in (tmp_path / "out").glob("*.report.json")}
    assert 1 <= len(complete) < 4
    assert all(not name.startswith(".") for name in names_in(tmp_path / "out"))
    report = tmp_path / "batch.json"
    assert cli.run([*map(str, arguments), "--resume", "--json", "--report", str(report)]) == 0
    document = _last_json(capsys.readouterr().out)
    assert {Path(item["input"]).stem for item in document if item.get("unchanged")} == complete
    summary = json.loads(report.read_text())
    assert summary["complete"] == 4 and summary["unchanged"] == len(complete)
    assert len(names_in(tmp_path / "out")) == 2 * len(scenes)


def test_a_worker_whose_master_has_gone_ends(moving: Path, tmp_path: Path) -> None:
    unit = _unit(moving, tmp_path / "o", tmp_path / "s", frames=(0, 1_000_000))
    worker = subprocess.Popen(
        [sys.executable, "-m", "hfx_tools.export_workers.unit_process"],
        env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert worker.stdin is not None and worker.stdout is not None
    try:
        assert json.loads(read_message(worker.stdout).body) == {"ready": True}
        worker.stdin.write(encode_unit(unit))
        worker.stdin.flush()
        assert "progress" in json.loads(read_message(worker.stdout).body)
        threading.Thread(target=worker.stdout.read, daemon=True).start()
        worker.stdin.close()
        assert worker.wait(30) == 0
    finally:
        worker.kill()
    assert names_in(tmp_path / "o") == []


def test_a_scene_that_takes_too_long_is_given_up(
    moving: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["export", str(moving), "-o", str(tmp_path / "out")]
    assert cli.run([*arguments, "--frames", "0:100000", "--time-limit", "1"]) == 3
    assert "time limit of 1 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
