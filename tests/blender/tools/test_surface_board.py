# SPDX-License-Identifier: GPL-3.0-or-later
"""The map paper's board of 4 x 4 squares, from a fingertip's stroke to the output on a phone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.texture.procedural import MATERIALS
from hfx_tools.formats import clip_rules
from hfx_tools.formats.clip_reader import texts_at

KINDS = {"Gravel": "gravel-fine", "Metal": "metal-brushed", "Fabric": "fabric-corduroy",
         "Wood": "wood-oak"}  # fmt: skip
LATIN = ("Gravel Metal Fabric Wood", "Fabric Wood Gravel Metal", "Wood Fabric Metal Gravel",
         "Metal Gravel Wood Fabric")  # fmt: skip


@pytest.fixture(scope="module")
def squares(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("board")
    command = [sys.executable, "-m", "hfx_blender", "demo", "--scene", "surfaces", "--json"]
    done = subprocess.run([*command, "-o", str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for device in ("phone_wide_band", "phone_lra"):
        for suffix in (f"{device}.csv", f"{device}.phone.ahap", f"{device}.phone.he"):
            assert (folder / f"board.{suffix}").stat().st_size > 1000
    result: dict[str, Any] = json.loads(done.stdout)
    return {item["square"]: (item, folder) for item in result["squares"]}


def test_every_square_is_played_by_both_phones_at_its_materials_frequency(squares: Any) -> None:
    names = [
        f"{kind} {row}{column}"
        for row, kinds in enumerate(LATIN, 1)
        for column, kind in enumerate(kinds.split(), 1)
    ]
    assert set(squares) == set(names)
    _, folder = squares[names[0]]
    tables = {
        device: np.genfromtxt(folder / f"board.{device}.csv", delimiter=",", skip_header=1)
        for device in ("phone_wide_band", "phone_lra")
    }
    for name, (square, _) in squares.items():
        # Sharpness is 1 - roughness, over the paper's 80 to 260 Hz; roughness varies by 0.05.
        expected = 80.0 + 180.0 * (1.0 - MATERIALS[KINDS[name.split()[0]]].roughness)
        wide, lra = square["phone_wide_band"], square["phone_lra"]
        assert wide["frequency_hz"] == pytest.approx(expected, abs=18.0), name
        assert lra["frequency_hz"] == 175.0
        for device, table in tables.items():
            inside = (table[:, 0] >= square["begin_s"]) & (table[:, 0] < square["end_s"])
            assert table[inside, 1].max() == pytest.approx(square[device]["amplitude_m_s2"])
            # Brushed metal is 3 micrometres deep; all further materials are several times as
            # strong.
            least = 0.1 if name.startswith("Metal") else 1.0
            assert np.median(table[inside, 1]) > least, f"{name} on {device}"


def test_hands_and_fingers_play_the_stroke(squares: Any, tmp_path: Path) -> None:
    _, folder = next(iter(squares.values()))
    devices = ("oculus_touch", "fingertips_left", "bhaptics_tactglove_left")
    command = [sys.executable, "-m", "hfx_blender", "export", str(folder / "board.blend")]
    command += ["-o", str(tmp_path), "-f", "csv", "--frames", "0:20"]
    command += [part for device in devices for part in ("--device", device)]
    subprocess.run(command, check=True, capture_output=True)
    for device in devices:
        table = np.genfromtxt(tmp_path / f"board.{device}.csv", delimiter=",", skip_header=1)
        assert table[:, 1::2].max() > 1.0, device


def test_a_game_clip_has_the_map_of_each_square(squares: Any, tmp_path: Path) -> None:
    _, folder = next(iter(squares.values()))
    command = [sys.executable, "-m", "hfx_blender", "export", str(folder / "board.blend")]
    command += ["-o", str(tmp_path), "-f", "clip", "--frames", "0:4", "--device", "phone_lra"]
    subprocess.run(command, check=True, capture_output=True)
    sections = clip_rules.read((tmp_path / "board.hfxclip").read_bytes(), "board")
    assert set(texts_at(sections, sections["SURF"]["name"])) == set(squares)
    # Squares of 50 mm, with a UV map each; maps as large as the materials, each stored once.
    assert sections["SURF"]["uv_mm"] == pytest.approx(np.full((16, 2), 50.0))
    sizes = sorted(1e3 * MATERIALS[name].size_m for name in KINDS.values())
    assert sorted(sections["HMAP"]["mm"][:, 0]) == pytest.approx(sizes)
