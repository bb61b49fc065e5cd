# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx validate`` on damaged files of each format: cut, doubled, zeroed, with more bytes."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from format_cases import raster_for
from test_hjif import BEAT, track_of

from hfx_blender import cli
from hfx_blender.authoring.paths import path_file
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.render import renderers_of_track
from hfx_blender.engine.texture.haptic_map import DeviceRange, HapticMap
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.formats import writing
from hfx_blender.formats.pictures import texture_map
from hfx_blender.formats.registry import FORMATS
from hfx_tools.formats.csv_reader import read
from hfx_tools.formats.validation import validate

CUTS = 20
JUNK = bytes(range(1, 65))
OF_RASTERS = tuple(id for id, info in FORMATS.items() if info.write_raster or info.is_of_device)


@pytest.fixture(scope="module")
def valid_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A valid file of each format by id; ``.blend`` files have tests with Blender."""
    folder = tmp_path_factory.mktemp("valid")
    device = load_device("forearm_band_left")
    raster = raster_for(device)
    files = {id: writing.write(id, raster, device, folder / "a").files[0] for id in OF_RASTERS}
    files["channels"] = folder / "a.wav.channels.json"
    with track_of(folder, "vibration", "painted", BEAT) as track:
        files["track"] = track.path
        (files["jsonl"],) = writing.write_all(("jsonl",), (), track, (), folder / "b").files
        controllers = load_device("oculus_touch")
        played = [(id, one.raster()) for id, one in renderers_of_track(track, [controllers])]
        write_clip = FORMATS["clip"].function("write_played")
        (files["clip"],) = write_clip(track.header, played, folder / "b", None).files
        writing.write_all(("hjif",), (), track, (), folder / "b")
        files["glb"] = folder / "b.hfx-vibration-1.glb"
    layers = np.random.default_rng(0).uniform(size=(2, 40, 50)).astype(np.float32)
    surface = HapticMap(layers[0], layers[1], (2e-4, 3e-4), False, DeviceRange())
    files["texture"], files["picture"], _ = texture_map.write(surface, folder / "m").files
    files["chart"] = folder / "x.svg"
    files["chart"].write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0"/></svg>\n')
    return files


def damaged(content: bytes) -> dict[str, bytes]:
    """Versions of a file by the name of the damage."""
    cuts = {f"cut {k}": content[: len(content) * k // CUTS] for k in range(CUTS)}
    added = {"junk": content + JUNK, "zeros": content + bytes(64), "words": content + b"junk " * 12}
    return {**cuts, **added, "doubled": content + content, "preceded": JUNK + content}


def verdict(path: Path) -> str:
    """Strongest severity of the findings of a file, "error" if it is refused; else empty."""
    try:
        severities = {finding.severity for finding in validate(path)[1]}
    except InputError:  # JSON whose kind cannot be told
        return "error"
    return "error" if "error" in severities else "".join(severities)


def test_there_is_a_file_of_each_format(valid_files: dict[str, Path]) -> None:
    assert set(valid_files) | {"scene"} == set(FORMATS)
    for id, path in valid_files.items():
        info, findings = validate(path)
        assert (findings, info.id) == ([], "he" if id == "he1" else id)


@pytest.mark.parametrize("id", [id for id in FORMATS if id != "scene"])
def test_no_damage_of_a_file_passes(id: str, valid_files: dict[str, Path], tmp_path: Path) -> None:
    path = valid_files[id]
    if id == "texture":  # its layers are found beside it
        for layer in path.parent.glob("m.*.png"):
            (tmp_path / layer.name).write_bytes(layer.read_bytes())
    changed = tmp_path / path.name
    passed = []
    for damage, content in damaged(path.read_bytes()).items():
        changed.write_bytes(content)
        found = verdict(changed)
        # Bytes after a picture are no error for a reader of PNG, nor are two streams in succession;
        # a table may end within its last number.
        is_warning = (id in ("picture", "hmpg") and not damage.startswith("cut")) or id == "csv"
        if not found or (found == "warning" and not is_warning):
            passed.append(damage)
    assert passed == []


@pytest.mark.parametrize("id", ["npz", "track"])
def test_bytes_around_an_archive_are_named(
    id: str, valid_files: dict[str, Path], tmp_path: Path
) -> None:
    content = valid_files[id].read_bytes()
    changed = tmp_path / valid_files[id].name
    for damage, clause in (
        (content + JUNK, "further bytes follow its end"),
        (JUNK + content, "64 bytes come before it"),
        (content + content, f"{len(content):,} bytes come before it"),
    ):
        changed.write_bytes(damage)
        (finding,) = validate(changed)[1]
        assert clause in finding.message
    with zipfile.ZipFile(valid_files[id]) as archive, zipfile.ZipFile(changed, "w") as commented:
        for entry in archive.infolist():
            commented.writestr(entry, archive.read(entry))
        commented.comment = b"from another archiver"
    assert validate(changed)[1] == []


def test_a_table_without_a_last_line_end_is_read_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    lines = "time_s,a.amplitude_m_s2 [m/s^2]\n0.00,1.25\n0.01,2.75"
    path.write_text(lines)
    (finding,) = validate(path)[1]
    assert (finding.code, finding.severity) == ("CSV-END", "warning")
    assert read(path).values.tolist() == [[1.25], [2.75]]
    assert cli.run(["validate", str(path)]) == 0
    assert cli.run(["validate", "--strict", str(path)]) == 3
    for end in "\n", "\r\n", "\r":
        path.write_text(lines + end, newline="")
        assert validate(path)[1] == []


def test_zeros_in_a_packed_file_are_found(valid_files: dict[str, Path], tmp_path: Path) -> None:
    """Checksums (ZIP, PNG) and characters outside of a text tell them. A sound may hold silence."""
    for id in ("npz", "track", "picture", "csv", "he", "ahap", "jsonl", "clip", "tact"):
        content = valid_files[id].read_bytes()
        middle = len(content) // 2
        changed = tmp_path / valid_files[id].name
        changed.write_bytes(content[:middle] + bytes(64) + content[middle + 64 :])
        assert verdict(changed) == "error", id


@pytest.mark.parametrize("id", [id for id in FORMATS if id not in ("scene", "channels")])
def test_suffixes_are_read_in_any_case(
    id: str, valid_files: dict[str, Path], tmp_path: Path
) -> None:
    path = valid_files[id]
    for layer in path.parent.glob("m.*.png"):
        (tmp_path / layer.name).write_bytes(layer.read_bytes())
    suffix = FORMATS[id].read_suffix or FORMATS[id].suffix
    stem = path.name[: -len(suffix)]
    upper = tmp_path / (stem + suffix.upper())
    upper.write_bytes(path.read_bytes())
    assert cli.run(["validate", str(upper)]) == 0
    if id not in ("texture", "picture", "chart"):
        assert cli.run(["info", str(upper)]) == 0


def test_effects_and_paths_are_read_in_any_case(tmp_path: Path) -> None:
    effect = sorted(resources.effect_library().glob("*.hfxeffect"))[0]
    (tmp_path / "X.HFXEFFECT").write_bytes(effect.read_bytes())
    (tmp_path / "X.HFXPATH").write_bytes(next(iter(path_file.library().values())).read_bytes())
    for name in ("X.HFXEFFECT", "X.HFXPATH"):
        for command in ("validate", "info"):
            assert cli.run([command, str(tmp_path / name)]) == 0
