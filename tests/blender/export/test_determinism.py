# SPDX-License-Identifier: GPL-3.0-or-later
"""The same scene is the same track: on every run, however time is cut, on every Blender."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.export import scene_export
from hfx_blender.processes import blender_session
from hfx_blender.reading import scene_reader
from hfx_blender.reading.curves.animation_time import time_base

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

HERE = Path(__file__).resolve().parents[1]
OTHER_PYTHON = "HFX_OTHER_PYTHON"
RATE_HZ = 20


def _child(python: str, *arguments: str, limit_s: int = 300) -> str:
    """Run ``cross_version.py`` in a separate Blender process; return the printed output."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(HERE.parents[1]), str(HERE)]),
        "BLENDER_USER_RESOURCES": tempfile.gettempdir(),
    }
    done = subprocess.run(
        [python, str(HERE / "cross_version.py"), *arguments],
        capture_output=True,
        text=True,
        timeout=limit_s,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def demo(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's .blend."""
    from hfx_tools.demo import garage

    path = tmp_path_factory.mktemp("demo") / "garage.blend"
    garage.build()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def _export(demo: Path, folder: Path, **settings: Any) -> dict[str, bytes]:
    blender_session.open_blend(demo)
    settings.setdefault("rate_hz", RATE_HZ)
    report = scene_export.export_scene(
        bpy.context.scene, folder, "garage", scene_export.ExportSettings(**settings)
    )
    return {path.name: path.read_bytes() for path in report.files}


@pytest.mark.parametrize("full_precision", [False, True])
def test_two_exports_are_byte_identical(demo: Path, tmp_path: Path, full_precision: bool) -> None:
    one = _export(demo, tmp_path / "one", full_precision=full_precision)
    two = _export(demo, tmp_path / "two", full_precision=full_precision)
    assert one.keys() == two.keys() and "garage.hfxtrack" in one
    assert one == two
    assert len(one["garage.hfxtrack"]) > 10_000


@pytest.mark.parametrize("size", [1, 7, 500])
def test_the_size_of_blocks_does_not_matter(
    demo: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    blender_session.open_blend(demo)
    usual = oracle.evaluate(bpy.context.scene, rate_hz=RATE_HZ)
    monkeypatch.setattr(scene_reader, "BLOCK_SIZE", size)
    second = oracle.evaluate(bpy.context.scene, rate_hz=RATE_HZ)
    assert usual.samples.keys() == second.samples.keys()
    for name, samples in usual.samples.items():
        assert samples.keys() == second.samples[name].keys()
        for index, sample in samples.items():
            twin = second.of(name, index)
            assert sample.vertices.tobytes() == twin.vertices.tobytes()
            assert sample.weights.tobytes() == twin.weights.tobytes()
            assert sample.level == twin.level


def test_a_range_is_part_of_the_whole(demo: Path) -> None:
    """Frames 60 to 119 alone give the same samples as within the whole range."""
    blender_session.open_blend(demo)
    whole = oracle.evaluate(bpy.context.scene, rate_hz=RATE_HZ)
    part = oracle.evaluate(bpy.context.scene, rate_hz=RATE_HZ, frames=(60, 119))
    assert {name for name, samples in part.samples.items() if samples} >= {"T1 Fire", "T1 Floor"}
    for name, samples in part.samples.items():
        for index, sample in samples.items():
            twin = whole.of(name, index + RATE_HZ)  # 60 frames later is a second later
            assert sample.time_s == pytest.approx(twin.time_s, abs=1e-12)
            assert sample.vertices.tobytes() == twin.vertices.tobytes()
            assert sample.weights.tobytes() == twin.weights.tobytes()


def _contacts(path: Path) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    actual: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    with np.load(path) as stored:
        for key in stored.files:
            name, index, what = key.split("|")
            actual.setdefault((name, int(index)), {})[what] = stored[key]
    return actual


@pytest.mark.skipif(OTHER_PYTHON not in os.environ, reason=f"{OTHER_PYTHON} names no other Blender")
def test_both_blenders_find_the_same_contacts(demo: Path, tmp_path: Path) -> None:
    """The demo's .blend of the older Blender, in both, outside 1e-5 m of a boundary."""
    import cross_version  # starts Blender

    second = os.environ[OTHER_PYTHON]
    blend, there_path, here_path = (
        tmp_path / name for name in ("garage.blend", "there.npz", "here.npz")
    )
    arguments = (str(demo), str(blend), str(there_path), str(RATE_HZ))
    printed = _child(second, "compare", *map(str, bpy.app.version), *arguments)
    version = tuple(map(int, printed.rpartition("VERSION")[2].split()))
    assert version != bpy.app.version
    cross_version.dump(str(blend), str(here_path), str(RATE_HZ))
    here, there = _contacts(here_path), _contacts(there_path)
    scene = bpy.context.scene
    time = time_base(scene, rate_hz=oracle.Fraction(RATE_HZ))
    (body,) = (obj for obj in scene.objects if obj.hfx.role == "BODY")
    references = {m: oracle.model_object(scene, body, m) for m in ("vibration", "pressure")}
    references["temperature"] = oracle.model_object(scene, body, "temperature")
    total = differing = 0
    worst_value = worst_weight = 0.0
    assert len(here) > 100
    for key in sorted(here.keys() | there.keys()):
        name, index = key
        nothing = {"vertices": np.zeros(0, np.int32), "weights": np.zeros(0)}
        one, two = here.get(key, nothing), there.get(key, nothing)
        total += len(one["vertices"])
        odd = np.setxor1d(one["vertices"], two["vertices"])
        differing += len(odd)
        if len(odd):
            oracle.set_time(scene, time.frame(index))
            effect = scene.objects[name]
            modality = oracle.load_model(f"hfx-{effect.hfx.modality}-1".replace("wind", "pressure"))
            points = oracle.world_vertices(scene, references[modality.modality])
            assert not oracle.judge(scene, effect, points[odd]).clear.any(), (key, odd)
        if "values" in one and "values" in two:
            worst_value = max(worst_value, float(np.abs(one["values"] - two["values"]).max()))
        _, at_one, at_two = np.intersect1d(one["vertices"], two["vertices"], return_indices=True)
        gaps = np.abs(one["weights"][at_one] - two["weights"][at_two])
        worst_weight = max(worst_weight, float(gaps.max(initial=0.0)))
    sys.stdout.write(
        f"\n{bpy.app.version} and {version}: {total} contacts, {differing} differ, all within "
        f"1e-5 m of a boundary; values differ by {worst_value:.1e}, weights by {worst_weight:.1e}\n"
    )
    assert worst_value < 1e-5 and worst_weight < 1e-4


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="tells peak memory on Linux only"
)
def test_a_long_export_is_bounded_in_memory(registered: Any, tmp_path: Path) -> None:
    """10,000 samples in a separate process: peak memory above the memory of the loaded scene."""
    printed = _child(sys.executable, "memory", str(tmp_path), "10000")
    start, short, long = map(int, printed.rpartition("PEAKS")[2].split())
    sys.stdout.write(f"\npeaks: {start / 2**20:.0f}, {short / 2**20:.0f}, {long / 2**20:.0f} MiB\n")
    assert long - start < 2**30
    assert long - short < 100 * 2**20, "it grows with the length of the scene"
