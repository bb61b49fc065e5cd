# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from words: recognised words, steering, and the written texture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.errors import InputError
from hfx_blender.generation import generated, library_search
from hfx_blender.generation.interpretation import read_words
from hfx_tools.bench.surfaces import words as bench


def kind(words: str, negative: str = "") -> str:
    return read_words(words, negative).choose()[0].kind


def test_nine_of_ten_wishes_find_their_kind() -> None:
    kinds = bench.kinds()
    assert kinds["asked"] == 60
    assert kinds["right"] >= 54, kinds["wrong"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("iron-grey wool", "fabric"),  # a colour before another material
        ("a wooden table covered with linen", "fabric"),  # the top is felt
        ("made of wood but as rough as gravel", "wood"),
        ("not metal, something like cotton", "fabric"),
        ("a wool coat with brass buttons", "fabric"),
        ("loose ballast between railroad ties", "gravel"),
        ("gravle", "gravel"),
        ("an oak gate", "wood"),  # material of the object
        ("a copper dress", "fabric"),  # a colour before a sewn object
        ("stone grey carpet", "fabric"),
        ("pebbled leather", "fabric"),
        ("cobblestone alley", "gravel"),  # spelt nearly like alloy
        ("parquet floor, herringbone, worn", "wood"),  # a pattern
        ("Crêpe de Chine", "fabric"),
    ],
)
def test_the_main_noun_decides_the_material(words: str, expected: str) -> None:
    assert kind(words) == expected


def test_unwanted_kinds_are_left_out_and_unknown_words_are_listed() -> None:
    assert kind("silver birch and steel") == "metal"
    assert kind("silver birch and steel", "steel") == "wood"
    wish = read_words("flurbish gravel, zworp")
    assert wish.unknown == ["flurbish", "zworp"]
    with pytest.raises(InputError, match=r"names a material.*gravel, metal.*zworp"):
        library_search.generate("zworp")


def test_english_words_are_no_misspellings_of_materials() -> None:
    everyday = "stand steep stock paint plane stack plate string banana concert matters".split()
    assert read_words("gravel " + " ".join(everyday)).unknown == everyday
    for slip in ("gravle", "mettal", "corderoy", "aluminimum"):
        assert not read_words(slip).unknown


def test_degrees_and_denials_steer_by_their_sign() -> None:
    scale = {words: read_words(words).scale for words in ("coarse", "coarser", "very coarse")}
    assert 1.0 < scale["coarse"] == scale["coarser"] < scale["very coarse"]
    assert read_words("less coarse").scale < 1.0 < read_words("not fine").scale
    assert read_words("deep blue velvet").depth == 1.0  # a colour
    # A finish naming a material as well.
    assert 1.0 < read_words("scratched steel").depth < read_words("very scratched steel").depth


@pytest.mark.parametrize("row", [0, 6, 11, 16])
def test_comparatives_move_their_measure(row: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "COMPARATIVES", bench.COMPARATIVES[row : row + 1])
    monkeypatch.setattr(bench, "TEXELS", 192)
    (actual,) = bench.comparatives()
    assert actual["is_right"], actual


def waves(texture: generated.Generated) -> tuple[float, float]:
    """Return period in metres and direction in degrees of the strongest wave of a relief."""
    heights = texture.height.heights_m
    power = np.abs(np.fft.rfft2(heights - heights.mean())) ** 2
    j, i = np.unravel_index(np.argmax(power), power.shape)
    count, texel = len(heights), texture.height.texel_m[0]
    j = j - count if j > count // 2 else j
    return count * texel / np.hypot(i, j), float(np.degrees(np.arctan2(j, i)) % 180.0)


@pytest.mark.parametrize(
    ("words", "period_mm", "direction"),
    [
        # 40 mm of the library's tile hold 25 ribs along x, so waves go along y.
        ("corduroy", 1.6, 90.0),
        ("vertical corduroy", 1.6, 0.0),
        ("diagonal corduroy", 1.6, 45.0),
        ("corduroy with ribs of 4 mm", 4.0, 90.0),
    ],
)
def test_direction_and_size_are_those_asked_for(
    words: str, period_mm: float, direction: float
) -> None:
    texture = library_search.generate(words, texels=256)
    period, actual = waves(texture)
    assert 1e3 * period == pytest.approx(period_mm, rel=0.01)
    assert min(abs(actual - direction), abs(actual - direction - 90.0)) < 1.0 or (
        direction != 45.0 and abs(actual - direction) < 1.0
    )


def test_a_turned_tile_has_no_seam() -> None:
    heights = library_search.generate("diagonal weathered wood", texels=128).height.heights_m
    for axis in (0, 1):
        inside = np.abs(np.diff(heights, axis=axis)).mean()
        seam = np.abs(np.take(heights, 0, axis) - np.take(heights, -1, axis)).mean()
        assert seam < 1.5 * inside


def test_the_same_words_and_seed_give_the_same_bytes(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two", "three")]
    for folder, seed in zip(folders, (3, 3, 4), strict=True):
        texture = library_search.generate("worn oak", seed=seed, texels=64)
        generated.write(texture, folder, "1.0")
    one, two, three = (sorted(folder.iterdir()) for folder in folders)
    assert [p.name for p in one] == [p.name for p in two] and len(one) == 7
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(one, two, strict=True))
    assert one[0].read_bytes() != three[0].read_bytes()


def test_a_record_describes_the_texture_and_files_are_readable(tmp_path: Path) -> None:
    texture = library_search.generate("wet gravel", negative="smooth", seed=7, texels=64)
    record = generated.write(texture, tmp_path, "1.0").files[-1]
    document = json.loads(record.read_text())
    assert (document["words"], document["negative_words"], document["seed"]) == (
        "wet gravel",
        "smooth",
        7,
    )
    assert document["back_end"] == "library" and document["searched_not_painted"] is True
    assert document["versions"]["hfx"] == "1.0" and len(document["files"]) == 6
    back = generated.read(record)
    step = np.ptp(texture.height.heights_m) / 65535
    heights = texture.height.heights_m
    np.testing.assert_allclose(back.relief.height.heights_m, heights, atol=0.51 * step)
    assert back.relief.height.size_m == pytest.approx(texture.height.size_m)
    picture = tmp_path / f"{texture.name}.height.png"
    picture.write_bytes(picture.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"height\.png.*hash differs"):
        generated.read(record)


def test_however_often_a_degree_is_said_the_surface_stays_one() -> None:
    wish = read_words("very " * 20_000 + "coarse wood")
    assert 1.0 < wish.scale < 100.0


@pytest.mark.parametrize(
    "words", ["wood 99999999999 mm deep", "pebbles of 0 mm", "wood of 2000 cm"]
)
def test_sizes_that_no_surface_has_are_refused(words: str) -> None:
    with pytest.raises(InputError, match="sizes and depths are"):
        read_words(words)


def test_words_in_other_scripts_are_named() -> None:
    assert read_words("wood \N{CJK UNIFIED IDEOGRAPH-6728} 5 mm").unknown == ["\u6728"]


def test_no_two_wishes_have_one_name() -> None:
    long = "coarse grey gravel with small stones and some moss, "
    wishes = ("wood", "wood \u6728", "Wood!", long + "wet", long + "deep", "\u6728")
    assert len({generated.name_of(effect, "0") for effect in wishes}) == len(wishes)
    assert generated.name_of("coarse grey gravel, wet", "0") == "coarse-grey-gravel-wet-0"
