# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of a scene, each exported by a separate command as on a render farm, and merging."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest
from hfx_scenes import contents_of, environment

from hfx_blender import cli

bpy = pytest.importorskip("bpy")

FRAMES = 80  # at 25 frames and 100 samples a second: two whole chunks of a track and a bit
OPTIONS = ("-f", "track,csv,hjif,glb", "--device", "insoles")


@pytest.fixture(scope="module")
def moving(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene(FRAMES - 1)
    ball = bpy.data.objects["Ball"]
    ball.hfx.radius, ball.hfx.falloff = 0.3, "smooth"
    # Skin of the first volume is cached for the second, so work depends on what was done before.
    bpy.ops.hfx.add_volume(modality="vibration", shape="CUBOID", name="Box", radius=0.4)
    box = bpy.data.objects["Box"]
    box.hfx.falloff = "none"
    for obj in (ball, box):
        for frame, x in ((0, -0.4), (30, 0.2), (79, 0.3)):
            obj.location = (x, 0.0, 1.0)
            obj.keyframe_insert("location", frame=frame)
    return hfx_scenes.save(tmp_path_factory.mktemp("farm") / "moving.blend")


@pytest.fixture(scope="module")
def whole(moving: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of a plain export."""
    folder = tmp_path_factory.mktemp("whole")
    assert cli.run(["export", str(moving), "-o", str(folder), *OPTIONS]) == 0
    return contents_of(folder)


def _run(blend: Path, out: Path, *arguments: str) -> int:
    return cli.run(["export", str(blend), "-o", str(out), *OPTIONS, *arguments])


# The process kills itself at a fixed place of the code. A kill from outside may come before the
# lock exists, and a folder without lock counts as new for a minute; or may come after the end.
KILLED = """
import os, signal
from hfx_blender.engine.track.writer import TrackWriter
end = getattr(signal, "SIGKILL", signal.SIGTERM)
TrackWriter.stored = lambda *_: os.kill(os.getpid(), end)
from hfx_blender.__main__ import main
main()
"""


def test_pieces_in_any_order_one_of_them_killed_make_the_same_bytes(
    moving: Path, whole: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["export", moving, "-o", out, *OPTIONS, "--piece", "2/3"]
    subprocess.run([sys.executable, "-c", KILLED, *words], env=environment(), check=False)
    assert [*(out / "moving.pieces").glob(".*/*.tmp")]  # writing had begun
    assert _run(moving, out, "--piece", "3/3") == 0
    assert _run(moving, out, "--piece", "1/3") == 0
    capsys.readouterr()
    assert _run(moving, out, "--merge") == 3
    assert "of 3 pieces, 2 is not there" in capsys.readouterr().err
    assert _run(moving, out, "--piece", "2/3") == 0
    assert _run(moving, out, "--merge") == 0
    assert contents_of(out) == whole  # without left-overs of the killed export


def test_a_piece_is_done_again_only_if_something_changed(
    moving: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"

    def is_left_out(*options: str) -> bool:
        capsys.readouterr()
        assert _run(moving, out, "--piece", "1/2", "--resume", "--json", *options) == 0
        return bool(json.loads(capsys.readouterr().out).get("unchanged"))

    assert not is_left_out()
    assert is_left_out()
    track = out / "moving.pieces" / "1-of-2.hfxtrack"
    track.write_bytes(track.read_bytes()[:-1] + b"x")
    assert not is_left_out()
    assert not is_left_out("--tolerance", "preview")
    assert _run(moving, out, "--piece", "2/2") == 0
    assert _run(moving, out, "--merge") == 3  # the first was recorded with another tolerance
    assert "1 is made from another state" in capsys.readouterr().err
    assert not is_left_out()
    assert _run(moving, out, "--merge") == 0
    assert not (out / "moving.pieces").exists()
    assert is_left_out()  # the scene is complete: so is each piece


def test_a_short_scene_has_nothing_for_the_last_pieces(
    moving: Path, whole: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for piece in ("5/5", "3/5", "1/5", "4/5", "2/5"):
        assert _run(moving, out, "--piece", piece) == 0
    assert "piece 5 of 5: nothing to record" in capsys.readouterr().out
    assert _run(moving, out, "--merge") == 0
    assert contents_of(out) == whole


def test_a_piece_that_became_empty_leaves_no_earlier_track(
    moving: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert _run(moving, out, "--piece", "5/5", "--rate", "300") == 0
    assert (out / "moving.pieces" / "5-of-5.hfxtrack").is_file()
    log = out / "moving.pieces" / "5-of-5.log"
    log.write_text("of the farm")
    for k in range(5, 0, -1):
        assert _run(moving, out, "--piece", f"{k}/5") == 0
    assert _run(moving, out, "--merge") == 0
    assert list(log.parent.iterdir()) == [log]
    log.unlink()
    log.parent.rmdir()
    assert contents_of(out) == whole


def test_a_merge_names_all_faulty_pieces_and_one_cure(
    moving: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _run(moving, out, "--piece", "2/3", "--tolerance", "preview") == 0
    capsys.readouterr()
    assert _run(moving, out, "--merge") == 3
    assert (
        "of 3 pieces, 1, 3 are not there, or damaged; 2 is made from another state of the scene, "
        "or with other options; export each of them with --piece K/3 and the same options."
    ) in capsys.readouterr().err


@pytest.mark.parametrize("options", [("--per-clip",), ("--frames", "7:60", "--rate", "300")])
def test_parts_of_a_scene_with_faults_have_the_report_of_the_whole(
    registered: Any, tmp_path: Path, options: tuple[str, ...]
) -> None:
    hfx_scenes.small_scene(FRAMES - 1)
    for name, expression in (("Failing", "sqrt(50 - frame)"), ("Late", "max(frame - 60, 0)")):
        bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", name=name, location=(0, 0, 1))
        driver = bpy.data.objects[name].driver_add("hfx.pressure").driver
        driver.type, driver.expression = "SCRIPTED", expression
    flat = bpy.data.objects["Ball"]
    for frame, size in ((0, 1.0), (40, 0.0), (55, 0.0), (70, 1.0)):
        flat.scale[2] = size
        flat.keyframe_insert("scale", frame=frame)
    bpy.context.view_layer.objects.active = flat
    bpy.context.scene.frame_set(20)
    bpy.ops.hfx.add_clip()
    scene = hfx_scenes.save(tmp_path / "faults.blend")
    pieces, whole, split = tmp_path / "pieces", tmp_path / "whole", tmp_path / "split"
    for k in (1, 2, 3):
        assert _run(scene, pieces, *options, "--piece", f"{k}/3") == 0
    assert _run(scene, pieces, *options, "--merge") == 0
    assert _run(scene, whole, *options) == _run(scene, split, *options, "--split", "11") == 0
    assert json.loads((whole / "faults.report.json").read_text())["warnings"]
    assert contents_of(pieces) == contents_of(split) == contents_of(whole)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--piece", "0/3"), "K from 1 to N"),
        (("--piece", "4/3"), "K from 1 to N"),
        (("--piece", "1"), "K from 1 to N"),
        (("--piece", "1/3", "--merge"), "comes after all pieces"),
        (("--merge", "--split", "100"), "--split"),
    ],
)
def test_what_makes_no_sense_is_wrong_usage(
    moving: Path, tmp_path: Path, arguments: tuple[str, ...], message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert _run(moving, tmp_path / "out", *arguments) == 2
    assert message in capsys.readouterr().err


def test_without_pieces_there_is_nothing_to_merge(
    moving: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(moving, tmp_path / "out", "--merge") == 3
    assert "has no pieces of moving.blend" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
