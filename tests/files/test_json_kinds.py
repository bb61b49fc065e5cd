# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON documents of another kind: every command names the given and the expected kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.cli import run
from hfx_blender.devices import configuration
from hfx_blender.engine.body.rigs import mapping
from hfx_blender.errors import InputError
from hfx_blender.formats.pictures import texture_map
from hfx_blender.generation import generated
from hfx_blender.processes.blender_session import open_blend

DEVICE = {"schema": "hfx-device", "version": 1}
MAP = {"format": "hfx-texture-map", "version": 1}
RECORD = {"format": "hfx-generated-texture", "version": 1}
REPORT = {"scene": "Garage", "files": []}


@pytest.mark.parametrize(
    ("read", "content", "given", "expected"),
    [
        (configuration.load_device, MAP, "a texture map", "a device configuration"),
        (configuration.load_device, REPORT, "the report of an export", "a device configuration"),
        (texture_map.read, RECORD, "the record of a generated surface", "a texture map"),
        (generated.read, MAP, "a texture map", "the record of a generated surface"),
        (generated.read, DEVICE, "a device configuration", "the record of a generated surface"),
    ],
)
def test_a_reader_names_both(
    tmp_path: Path, read: Any, content: Any, given: str, expected: str
) -> None:
    path = tmp_path / "x.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read(path)
    assert f"x.json: is {given}" in str(caught.value) and f"expected {expected}" in str(
        caught.value
    )


@pytest.mark.parametrize(
    "command",
    [
        ["play", "{}", "--device", "tactal_mask"],
        ["validate", "{}"],
        ["convert", "{}", "y.ahap"],
        ["info", "{}"],
    ],
)
def test_a_command_names_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    path = tmp_path / "x.generated.json"
    path.write_text(json.dumps(RECORD))
    assert run([word.format(path) for word in command]) == 3
    said = "".join(capsys.readouterr())
    assert "is the record of a generated surface" in said
    assert "expected a" in said or "known are .hjif" in said
    assert said.count(str(path)) <= 2 and len(said.splitlines()) <= 2


@pytest.mark.parametrize("name", ["x.hjif", "x.wav", "x.raster.npz", "x"])
def test_play_names_a_file_that_it_cannot_play(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(bytes(64))
    assert run(["play", str(path), "--device", "tactal_mask"]) == 3
    kind = f"a {path.suffix} file" if path.suffix else "a file without a suffix"
    assert (
        f"{name}: is {kind}; expected a track (.hfxtrack) or a game clip (.hfxclip)"
        in capsys.readouterr().err
    )


def test_json_in_place_of_a_blend_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text(json.dumps(DEVICE))
    with pytest.raises(InputError, match=r"is a device configuration; expected a \.blend file"):
        open_blend(path)


def test_a_table_of_bones_names_the_given_kind() -> None:
    with pytest.raises(InputError, match=r"not a bone mapping .*hfx-texture-map"):
        mapping.from_json(json.dumps(MAP))
