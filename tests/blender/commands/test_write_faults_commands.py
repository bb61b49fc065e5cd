# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk faults while commands write: one message, exit code 3, and nothing is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hfx_scenes
import pytest
from faulty_disk import faulty_disk

from hfx_blender import cli

bpy = pytest.importorskip("bpy")

_MOST_STEPS = 10
COMMANDS = {
    "export": "export SCENE -o OUT -f track,csv,wav,hjif,glb,clip,jsonl --device insoles",
    "piece": "export SCENE -o OUT --device none --piece 1/1",
    "merge": "export SCENE -o OUT --device none --merge",
    "report": "export SCENE -o OUT --device none --report OUT/batch.json",
    "sound": "sound SCENE -o OUT",
    "build": "texture build gravel-fine --resolution 16 -o OUT/map",
    "stroke": "texture stroke gravel-fine --resolution 16 --from 0,0 --to 9,9 -o OUT/s.wav",
    "generate": "texture generate denim --resolution 16 --variations 1 --no-blend -o OUT",
}


@pytest.fixture(scope="module")
def blend(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene(2)
    return hfx_scenes.save(tmp_path_factory.mktemp("scene") / "x.blend")


def _contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("name", COMMANDS)
def test_each_step_of_writing_may_fail(
    blend: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"SCENE": str(blend), "OUT": str(tmp_path)}

    def run(name: str) -> int:
        words = COMMANDS[name].split()
        for word, position in places.items():
            words = [item.replace(word, position) for item in words]
        return cli.run(words)

    if name == "merge":  # merging removes the pieces, so measure the steps in a further run
        assert run("piece") == 0
    with faulty_disk() as disk:
        assert run(name) == 0, capsys.readouterr().err
    if name == "merge":
        assert run("piece") == 0
    before = _contents(tmp_path)
    assert disk.steps >= 4
    for failing in range(0, disk.steps, -(-disk.steps // _MOST_STEPS)):
        capsys.readouterr()
        with faulty_disk(failing):
            code = run(name)
        lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("hfx")]
        assert code == 3 and len(lines) == 1, (failing, code, lines)
        after = _contents(tmp_path)
        if name == "report":  # the export itself may be complete
            after = {item: before[item] for item in after}
        assert after == before, failing
        assert not [path for path in tmp_path.rglob(".*")]
