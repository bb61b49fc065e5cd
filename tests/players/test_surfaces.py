# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of a clip: by hand after the format's page, and against the engine's contacts."""

from __future__ import annotations

import struct
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from check_surfaces import clip_of, compare, surface_of
from core_library import ROOT, Clip, Stroke
from small_clip import write_small_clip
from test_clip import TEXT, TOUCH, by_hand

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.scene import (
    AnimationBlock,
    EffectBlock,
    PoseBlock,
    SceneDescription,
    TimeBase,
)
from hfx_blender.engine.texture.haptic_map import DeviceRange, HapticMap, SurfaceRenderer
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.track import TrackHeader
from hfx_blender.errors import InputError
from hfx_blender.formats.clip.clip_writer import write
from hfx_blender.formats.clip.spatial_recorder import SpatialRecorder
from hfx_tools.formats import clip_rules
from hfx_tools.formats.facts import clip_facts

FULL = 2**24 - 1
NEVER = float("nan")


def texel(intensity: float, sharpness: int) -> int:
    return round(intensity * FULL) << 8 | sharpness


# Rows from the bottom, 40 mm x 20 mm: texels of 10 mm x 10 mm.
TEXELS = (
    *(texel(0.0, 0), texel(0.5, 51), texel(0.25, 102), texel(0.0, 255)),
    *(texel(0.75, 153), texel(0.5, 204), texel(1.0, 255), texel(0.1, 0)),
)
SURFACE = {
    "SURF": struct.pack("<2I6f", TOUCH, 0, 2.0, 10.0, 80.0, 335.0, 80.0, 20.0),
    "HMAP": struct.pack("<2I2f4I", 4, 2, 40.0, 20.0, 1, 0, 8, 0),
    "TEXL": struct.pack("<8I", *TEXELS),
}


def test_a_path_gives_the_strongest_texel_that_it_enters() -> None:
    stroke = Stroke(Clip(by_hand(**SURFACE)))
    assert stroke.feel(0.125, 0.25, 0.01) == (0.0, 80.0)  # a touch begins silent
    # Through columns 0, 1 and 2 of the lower row: 2 + 8 * 0.5 m/s^2, 80 + 255 * 51 / 255 Hz.
    assert stroke.feel(0.625, 0.25, 0.01) == pytest.approx((6.0, 131.0))
    assert stroke.feel(0.625, 0.25, 0.01) == pytest.approx((0.0, 182.0))  # at rest
    # Diagonally to (0.9, 0.95): from column 2, up at u = 0.7232 into 1.0, right into 0.1.
    assert stroke.feel(0.9, 0.95, 0.01) == pytest.approx((10.0, 335.0))
    # Over the right border the map repeats: 0.1, then 0.75 of column 0.
    assert stroke.feel(1.1, 0.95, 0.01) == pytest.approx((8.0, 233.0))
    # Down over the lower border, in column 0: 0 of row 0, 0.75 of row 1, which is row -1.
    stroke.feel(0.1, 0.1, 0.01)
    assert stroke.feel(0.1, -0.1, 0.01) == pytest.approx((8.0, 233.0))
    stroke.feel(0.05, 0.05, 0.01)
    assert stroke.feel(0.2, 0.2, 0.01) == (0.0, 80.0)  # intensity 0 is silent


def test_of_equally_strong_texels_the_lowest_number_counts_in_both_directions() -> None:
    clip = Clip(by_hand(**SURFACE))
    for first, last in ((0.25, 0.75), (0.75, 0.25)):
        stroke = Stroke(clip)
        stroke.feel(0.375, first, 0.01)
        assert stroke.feel(0.375, last, 0.01) == pytest.approx((6.0, 131.0))  # 51, and not 204


def test_the_border_continues_where_the_map_does_not_tile() -> None:
    still = {**SURFACE, "HMAP": struct.pack("<2I2f4I", 4, 2, 40.0, 20.0, 0, 0, 8, 0)}
    stroke = Stroke(Clip(by_hand(**still)))
    stroke.feel(1.5, 0.75, 0.01)
    assert stroke.feel(2.5, 0.75, 0.01) == pytest.approx((2.8, 80.0))  # 2 + 8 * 0.1
    assert stroke.feel(-0.5, 0.75, 0.01)[0] == pytest.approx(10.0)  # through all of it
    assert stroke.feel(-0.5, -2.0, 0.01)[0] == pytest.approx(8.0)  # 0.75 above 0


def test_rest_is_judged_by_the_speed_that_is_given_or_by_the_path() -> None:
    clip = Clip(by_hand(**SURFACE))
    stroke = Stroke(clip)
    stroke.feel(0.3, 0.25, 0.01)
    # 40 mm wide: 0.00002 are 0.0008 mm in 0.01 s, 0.08 mm/s; 0.00003 are 0.12 mm/s.
    assert stroke.feel(0.30002, 0.25, 0.01)[0] == 0.0
    assert stroke.feel(0.30005, 0.25, 0.01)[0] == pytest.approx(6.0)
    assert stroke.feel(0.30005, 0.25, 0.01, 5.0)[0] == pytest.approx(6.0)
    assert stroke.feel(0.4, 0.25, 0.01, 0.1)[0] == 0.0  # an object carries the finger
    assert stroke.feel(0.3, 0.25, 0.0)[0] == pytest.approx(6.0)


def test_a_touch_ends_where_it_is_lifted_or_misses() -> None:
    clip = Clip(by_hand(**SURFACE))
    stroke = Stroke(clip)
    stroke.feel(0.3, 0.25, 0.01)
    stroke.lift()
    assert stroke.feel(0.6, 0.75, 0.01)[0] == 0.0
    for u, v in ((NEVER, 0.5), (0.5, float("inf")), (-2e6, 0.5)):
        assert stroke.feel(u, v, 0.01) == (0.0, 0.0) and stroke.error == 0
        assert stroke.feel(0.6, 0.75, 0.01)[0] == 0.0  # begins again
        assert stroke.feel(0.7, 0.75, 0.01)[0] == pytest.approx(10.0)
    nothing = Stroke(clip, 1)
    assert nothing.feel(0.5, 0.5, 0.01) == (0.0, 0.0) and nothing.error == -6


def test_only_the_end_of_a_path_over_many_tiles_counts() -> None:
    stroke = Stroke(Clip(by_hand(**SURFACE)))
    stroke.feel(-900_000.0, 0.75, 0.01)
    assert stroke.feel(900_000.0, 0.75, 0.01) == pytest.approx((10.0, 335.0))


HOSTILE = {
    "SURF[0].map": {"SURF": struct.pack("<2I6f", TOUCH, 1, 2.0, 10.0, 80.0, 335.0, 0.0, 0.0)},
    "SURF[0].m_s2": {"SURF": struct.pack("<2I6f", TOUCH, 0, 11.0, 10.0, 80.0, 335.0, 0.0, 0.0)},
    "SURF[0].hz": {"SURF": struct.pack("<2I6f", TOUCH, 0, 2.0, 10.0, -1.0, 335.0, 0.0, 0.0)},
    "SURF[0].uv_mm": {"SURF": struct.pack("<2I6f", TOUCH, 0, 2.0, 10.0, 80.0, 335.0, -1.0, 0.0)},
    "SURF[0].name": {"SURF": struct.pack("<2I6f", len(TEXT), 0, 2.0, 10.0, 80.0, 335.0, 0.0, 0.0)},
    "HMAP[0].columns": {"HMAP": struct.pack("<2I2f4I", 0, 2, 40.0, 20.0, 1, 0, 8, 0)},
    "HMAP[0].texels": {"HMAP": struct.pack("<2I2f4I", 4, 3, 40.0, 20.0, 1, 0, 8, 0)},
    "HMAP.texels": {"HMAP": struct.pack("<2I2f4I", 3, 2, 40.0, 20.0, 1, 0, 6, 0)},
    "HMAP[0].mm": {"HMAP": struct.pack("<2I2f4I", 4, 2, 0.0, 20.0, 1, 0, 8, 0)},
    "HMAP[0].tiles": {"HMAP": struct.pack("<2I2f4I", 4, 2, 40.0, 20.0, 2, 0, 8, 0)},
}


@pytest.mark.parametrize("place", HOSTILE)
def test_broken_surfaces_are_refused_by_both_readers(place: str) -> None:
    content = by_hand(**{**SURFACE, **HOSTILE[place]})
    assert Clip(content).error == -5
    with pytest.raises(InputError) as caught:
        clip_rules.read(content, "x")
    assert f"'{place}'" in str(caught.value)


def test_an_earlier_reader_passes_over_surfaces() -> None:
    # The same clip with sections that no reader has in their place.
    content = by_hand(**{name[:3] + "?": records for name, records in SURFACE.items()})
    assert Clip(content).error == 0 and clip_rules.validate(content, "x") == []


@pytest.mark.parametrize("name", ["gravel-sharp", "metal-brushed", "wood-weathered"])
def test_strokes_over_materials_feel_as_contacts_of_the_engine(name: str, tmp_path: Path) -> None:
    counts = compare(surface_of(name, texels=128), tmp_path, strokes=12, seed=5)
    assert counts.moving > 300
    assert counts.amplitudes == counts.frequencies == counts.samples


def test_strokes_of_the_conformance_folder() -> None:
    folder = ROOT / "players" / "conformance" / "surfaces"
    clip = Clip((folder / "strokes.hfxclip").read_bytes())
    sections = clip_rules.read((folder / "strokes.hfxclip").read_bytes(), "strokes")
    number, compared = 0, 0
    for line in (folder / "strokes.txt").read_text().splitlines():
        call, _, values = line.partition(" = ")
        word, *numbers = call.split()
        if word == "surface":
            number = int(numbers[0])
            stroke = Stroke(clip, number)
            continue
        actual = stroke.feel(*map(float, numbers))
        expected = [*map(float, values.split())]
        assert abs(actual[0] - expected[0]) <= sections["SURF"]["m_s2"][number][1] / 255.0, line
        assert len(expected) < 2 or abs(actual[1] - expected[1]) <= 1.0, line
        compared += len(expected) > 1
    assert compared > 700


def scene_of(*areas: Any, level: float = 0.5) -> tuple[SceneDescription, SpatialRecorder]:
    """Scene of surfaces with 8 m/s^2 at ``level``, and its recorder."""
    effects = tuple(replace(area, id=f"e{k}", name=f"Pad {k}") for k, area in enumerate(areas))
    scene = SceneDescription(TimeBase(Fraction(50), Fraction(50), 0, 0, 1), (), effects)
    animated = tuple(
        EffectBlock(
            np.array([0.1, level]),
            np.tile([8.0, 90.0], (2, 1)),
            matrices=np.tile(np.eye(4), (2, 1, 1)),
            vertices=np.zeros((1, 3, 3)),
        )
        for _ in effects
    )
    recorder = SpatialRecorder(scene)
    pose: tuple[PoseBlock, ...] = ()
    recorder.add(AnimationBlock(np.arange(2), animated, pose))
    return scene, recorder


def test_an_export_has_each_map_once_with_the_effects_amplitude(tmp_path: Path) -> None:
    device = DeviceRange((0.5, 2.0), (100.0, 200.0))
    layers = np.array([[0.0, 0.2], [0.4, 0.1]], np.float32), np.full((2, 2), 0.6, np.float32)
    haptic_map = HapticMap(*layers, (1e-3, 2e-3), tiles=False, device=device)
    pad = surface_of(haptic_map)
    pad = replace(pad, area=replace(pad.area, uv_m=(0.01, 0.02)))
    height = HeightField(np.zeros((2, 2)), (1e-3, 1e-3))
    textile = replace(
        pad,
        area=replace(
            pad.area,
            texture=replace(pad.area.texture, renderer=SurfaceRenderer.TEXTILE, height=height),
        ),
    )
    scene, recorded = scene_of(pad, pad, textile)
    recorder = SpatialRecorder(scene)
    recorder.replace([recorded.arrays()])  # as an export in parts joins them
    model = load_model(pad.model_id)
    header = TrackHeader.of(scene, {model.id: model}, settings={}, tools={})
    result = write(header, [], tmp_path / "x", recorder)
    assert any("Pad 2" in note and "micro-collisions" in note for note in result.notes)
    (path,) = result.files
    shown = clip_facts(path)["surfaces"]
    assert [item["surface"] for item in shown] == ["Pad 0", "Pad 1"]
    assert shown[1]["size_mm"] == pytest.approx([2.0, 4.0]) and not shown[1]["tiles"]
    sections = clip_rules.read(path.read_bytes(), "x")
    assert sections["SURF"]["map"].tolist() == [0, 0] and len(sections["HMAP"]) == 1
    # Level 0.5 of 8 m/s^2; from 0.5 g of 2 g up, and 0.4 of the way to all of it.
    assert sections["SURF"]["m_s2"][0] == pytest.approx([1.0, 1.0 + 0.4 * 3.0])
    assert sections["SURF"]["hz"][1].tolist() == [100.0, 200.0]
    assert sections["SURF"]["uv_mm"][1] == pytest.approx([10.0, 20.0])
    assert sections["HMAP"]["mm"][0] == pytest.approx([2.0, 4.0])
    assert (sections["TEXL"] >> 8).tolist() == [0, round(FULL / 2), FULL, round(FULL / 4)]
    assert set((sections["TEXL"] & 255).tolist()) == {153}
    stroke = Stroke(Clip(path.read_bytes()))
    stroke.feel(0.75, 0.25, 0.01)
    assert stroke.feel(0.75, 0.3, 0.01) == pytest.approx((1.0 + 0.2 * 3.0, 160.0))


def test_the_clip_that_is_fuzzed_has_surfaces(tmp_path: Path) -> None:
    content = write_small_clip(tmp_path).read_bytes()
    assert Clip(content).error == 0
    assert len(clip_rules.read(content, "x")["SURF"]) == 2
    assert clip_of(surface_of("metal-satin", texels=32), tmp_path).is_file()
