# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture``: written files, output, exit codes."""

from __future__ import annotations

import json
import wave
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.cli import run
from hfx_blender.formats.pictures import png, texture_map


def texture(capsys: Any, *arguments: object) -> tuple[int, Any, str]:
    """Exit code, JSON and messages of a command."""
    capsys.readouterr()  # output of Blender
    code = run(["texture", *map(str, arguments), "--json"])
    captured = capsys.readouterr()
    return code, json.loads(captured.out) if captured.out else None, captured.err


@pytest.fixture
def grating(registered: Any, tmp_path: Path) -> Path:
    """A picture of 20 waves over 50 mm, 400 texels wide."""
    x = (np.arange(400) + 0.5) / 400
    codes = np.rint((0.5 + 0.5 * np.sin(2 * np.pi * 20 * x)) * 65535).astype(np.uint16)
    path = tmp_path / "grating.png"
    png.write(np.repeat(codes[None], 40, axis=0), path)
    return path


def test_a_direct_stroke_over_a_grating_has_its_frequency(
    capsys: Any, grating: Path, tmp_path: Path
) -> None:
    out = tmp_path / "s.wav"
    code, facts, _ = texture(
        capsys, "stroke", grating, "--size", "50,5", "--height", 0.05, "--tiles",
        "--from=-10,2", "--to=90,2", "--speed", 100, "--renderer", "direct", "--drive", 10,
        "-o", out,
    )  # fmt: skip
    assert code == 0 and facts["speed_mm_s"] == pytest.approx(100.0)
    with wave.open(str(out)) as file:
        rate, count = file.getframerate(), file.getnframes()
        samples = np.frombuffer(file.readframes(count), np.int16) / 32767.0
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(count)))
    peak = np.argmax(spectrum) * rate / count
    # 100 mm/s over waves of 2.5 mm; 25 um of height times 10 / mm is a quarter of full scale.
    assert peak == pytest.approx(40.0, rel=0.01)
    assert samples.max() == pytest.approx(0.25, rel=0.02)


def test_a_map_is_built_and_stroked(capsys: Any, tmp_path: Path) -> None:
    stem = tmp_path / "denim"
    code, facts, _ = texture(
        capsys, "build", "fabric-denim", "--resolution", 64, "--bits", 8, "-o", stem
    )
    assert code == 0 and len(facts["files"]) == 3
    created = texture_map.read(tmp_path / "denim.texture.json")
    assert created.size_m == pytest.approx((0.03, 0.03))
    files = [tmp_path / f"s{suffix}" for suffix in (".ahap", ".he", ".haptic", ".csv")]
    outputs = [part for path in files for part in ("-o", path)]
    code, facts, _ = texture(
        capsys, "stroke", tmp_path / "denim.texture.json", "--from", "0,0", "--to", "20,0",
        "--speed", 20, *outputs,
    )  # fmt: skip
    assert code == 0 and all(path.is_file() for path in files)
    assert 0.0 < facts["peak_amplitude_m_s2"] <= 1.3 * 9.81
    rows = (tmp_path / "s.csv").read_text().splitlines()
    assert rows[0].startswith("time_s,x_mm") and len(rows) == 21


def test_a_path_with_times_of_its_own(capsys: Any, tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("time,x,y\n0,0,0\n0.5,10,0\n1.0,10,20\n")
    code, facts, _ = texture(capsys, "stroke", "wood-oak", "--resolution", 64, "--path", path)
    assert code == 0 and facts["length_mm"] == pytest.approx(30.0)
    assert facts["seconds"] == pytest.approx(1.0)


def test_roughness_of_a_grating_is_known(capsys: Any, grating: Path) -> None:
    code, facts, _ = texture(
        capsys, "roughness", grating, "--size", "50,5", "--height", 0.05, "--tiles",
        "--cutoff", 8,
    )  # fmt: skip
    # A sine of amplitude 25 um: Ra is 2 / pi of the amplitude, the depth twice the amplitude.
    assert code == 0 and facts["ra_x"] == pytest.approx(25.0 * 2 / np.pi, rel=0.05)
    assert facts["rz_x"] == pytest.approx(50.0, rel=0.05)
    assert facts["ra_y"] < 0.1


def test_information_and_the_library(capsys: Any) -> None:
    code, facts, _ = texture(capsys, "info", "metal-hammered", "--resolution", 64)
    assert code == 0 and facts["size_mm"] == pytest.approx([60.0, 60.0])
    code, facts, _ = texture(capsys, "list")
    assert code == 0 and len({fact["kind"] for fact in facts.values()}) == 4


def test_an_objects_surface_comes_out_of_a_blend(
    capsys: Any, registered: Any, tmp_path: Path
) -> None:
    bpy = registered
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=0.1)
    bpy.context.object.hfx.surface.resolution = 32
    bpy.ops.hfx.add_surface(source="PROCEDURAL", procedural="wood-oak")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    code, facts, _ = texture(capsys, "build", tmp_path / "a.blend", "-o", tmp_path / "oak")
    assert code == 0 and (tmp_path / "oak.texture.json").is_file()
    code, facts, _ = texture(capsys, "info", tmp_path / "a.blend", "--object", "Nobody")
    assert code == 3 and "no object 'Nobody'" in facts["error"]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("info", "nothing.png"), 3, "no such file"),
        (("info", "velvet"), 3, "no library material"),
        (("info", "wood-oak", "--resolution", 1), 2, "--resolution"),
        (("info", "wood-oak", "--frequency", "300,80"), 3, "low <= high"),
        (("info", "wood-oak", "--frequency", "300"), 2, "two numbers"),
        (("stroke", "wood-oak"), 2, "--from and --to"),
        (("stroke", "wood-oak", "--from", "0,0", "--to", "0,0"), 3, "same"),
        (("stroke", "wood-oak", "--from", "0,0", "--to", "9,0", "--speed", 0), 2, "--speed"),
        (("stroke", "wood-oak", "--from", "0,0", "--to", "0.1,0"), 3, "less than one step"),
        (("stroke", "wood-oak", "--from", "0,0", "--to", "9,0", "-o", "x.mp3"), 2, ".wav"),
        (("stroke", "wood-oak", "--path", "nothing.csv"), 3, "there is no such file"),
        (("build", "wood-oak", "-o", "no/such/folder"), 2, "no folder"),
        (("board", "-o", "board.txt"), 2, ".blend"),
    ],
)
def test_bad_input_is_one_sentence(
    capsys: Any, arguments: tuple[object, ...], code: int, message: str
) -> None:
    actual, facts, said = texture(capsys, *arguments)
    assert actual == code and message in facts["error"] and "Traceback" not in said


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("two.xyz", "0 0 0\n1 0 0\n", "2 points"),
        ("line.xyz", "0 0 0\n1 1 1\n2 2 2\n3 3 3\n", "on a line"),
        ("text.xyz", "a b c\n", "x, y and z"),
        ("short.xyz", "1 2\n3 4\n", "x, y and z"),
        ("no.ply", "solid", "no PLY"),
        ("no.png", "not a picture", "cannot read"),
        ("no.texture.json", "{", "no.texture.json"),
    ],
)
def test_broken_files_are_one_sentence(
    capsys: Any, registered: Any, tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)
    code, facts, said = texture(capsys, "info", tmp_path / name)
    assert code == 3 and message in facts["error"] and "Traceback" not in said


def test_a_stroke_is_as_strong_as_the_device_was_calibrated(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.devices.configurations import surface_calibration

    monkeypatch.setattr(
        "hfx_blender.files.resources.surface_calibration", lambda: tmp_path / "c_v.json"
    )
    surface_calibration.store(4_000.0)
    surface_calibration.store(1_000.0, "phone_lra")
    amplitudes_m_s2 = [
        texture(
            capsys, "stroke", "fabric-denim", "--resolution", 64, "--from", "0,0", "--to", "20,0",
            "--renderer", "textile", *more,
        )[1]["mean_amplitude_m_s2"]
        for more in ([], ["--device", "phone_lra"], ["--device", "phone_lra", "--drive", 4])
    ]  # fmt: skip
    assert amplitudes_m_s2[0] == pytest.approx(4.0 * amplitudes_m_s2[1]) and amplitudes_m_s2[
        2
    ] == pytest.approx(amplitudes_m_s2[0])


def test_a_stroke_is_played_within_the_facts_of_its_device(capsys: Any, tmp_path: Path) -> None:
    """A phone with one frequency and 10 m/s2, and a phone with 80 to 260 Hz and 1.3 g."""
    way = ("stroke", "gravel-fine", "--resolution", 256, "--from", "0,0", "--to", "50,0")
    _, plain, _ = texture(capsys, *way)
    _, lra, _ = texture(capsys, *way, "--device", "phone_lra", "-o", tmp_path / "s.csv")
    assert plain["peak_amplitude_m_s2"] > 11.0
    assert lra["peak_amplitude_m_s2"] == 10.0 and lra["mean_frequency_hz"] == 175.0
    _, wide, _ = texture(capsys, *way, "--device", "phone_wide_band")
    # The material's own: sharpness 1 - 0.85, over 80 to 260 Hz.
    assert wide["mean_frequency_hz"] == pytest.approx(80.0 + 180.0 * 0.15, abs=18.0)
    assert wide["peak_amplitude_m_s2"] == plain["peak_amplitude_m_s2"], "12.75 is enough"
    code, said, _ = texture(capsys, *way, "--device", "fan_heater")
    assert code == 3 and "no actuator of it vibrates" in said["error"]


def test_a_scan_of_an_unlikely_size_is_asked_about(
    capsys: Any, registered: Any, tmp_path: Path
) -> None:
    path = tmp_path / "small.xyz"
    points = [(x, y, 0.01 * (x % 3)) for x in range(20) for y in range(20)]
    path.write_text("\n".join(f"{x} {y} {z}" for x, y, z in points))
    _, facts, _ = texture(capsys, "info", path, "--unit", 0.001)
    assert "unit" in " ".join(facts["notes"])
    _, facts, _ = texture(capsys, "info", path)
    assert "unit" not in " ".join(facts["notes"])


def test_a_stroke_that_is_hardly_felt_says_so(capsys: Any, registered: Any, tmp_path: Path) -> None:
    path = tmp_path / "smooth.xyz"
    path.write_text("\n".join(f"{x} {y} {1e-6 * (x % 2)}" for x in range(30) for y in range(30)))
    _, facts, _ = texture(capsys, "stroke", path, "--from", "5,5", "--to", "25,5")
    assert "hardly anything" in " ".join(facts["notes"])


def test_a_json_that_is_no_map_is_named(registered: Any, capsys: Any, tmp_path: Path) -> None:
    path = tmp_path / "x.generated.json"
    path.write_text('{"format": "hfx-generated-texture"}')
    code, _, messages = texture(capsys, "roughness", path)
    assert code == 3 and "is the record of a generated surface" in messages
    assert "expected a map (.texture.json)" in messages
