# SPDX-License-Identifier: GPL-3.0-or-later
"""Height maps as files, and as PNG pictures."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture.haptic_map import DeviceRange, HapticMap
from hfx_blender.errors import InputError
from hfx_blender.formats.pictures import png, texture_map


def _map(rows: int = 6, columns: int = 9) -> HapticMap:
    rng = np.random.default_rng(0)
    layers = rng.uniform(size=(2, rows, columns)).astype(np.float32)
    device = DeviceRange((0.0, 1.1), (70.0, 300.0), 150.0, 0.04)
    return HapticMap(layers[0], layers[1], (2e-4, 3e-4), False, device)


@pytest.mark.parametrize("bits", [8, 16])
def test_height_maps_survive_writing(tmp_path: Path, bits: int) -> None:
    map_ = _map()
    written = texture_map.write(map_, tmp_path / "cloth", bits)  # type: ignore[arg-type]
    assert [path.name for path in written.files] == [
        "cloth.texture.json",
        "cloth.intensity.png",
        "cloth.sharpness.png",
    ]
    back = texture_map.read(written.files[0])
    half_a_code = 0.5001 / (2**bits - 1)
    np.testing.assert_allclose(back.intensity, map_.intensity, atol=half_a_code)
    np.testing.assert_allclose(back.sharpness, map_.sharpness, atol=half_a_code)
    np.testing.assert_allclose(back.texel_m, map_.texel_m)
    assert (back.tiles, back.device, back.steps) == (False, map_.device, None)
    stepped = map_.in_steps()
    assert texture_map.read(texture_map.write(stepped, tmp_path / "s").files[0]).steps is not None


def test_the_first_row_of_the_picture_is_the_top_of_the_map(tmp_path: Path) -> None:
    layer = np.array([[0.0, 0.0], [1.0, 0.5]], np.float32)  # row 0 is below
    texture_map.write(HapticMap(layer, layer, (1e-3, 1e-3)), tmp_path / "m", 8)
    codes, coloured = png.read(tmp_path / "m.intensity.png")
    assert codes.tolist() == [[255, 128], [0, 0]] and not coloured


def _filtered(pixels: np.ndarray, kinds: list[int], depth: int, colour: int) -> bytes:
    """Return a PNG of pixels (H, W, C) after the standard's text, byte by byte."""
    rows, columns, channels = pixels.shape
    unit = channels * depth // 8
    data = pixels.astype(">u2" if depth == 16 else ">u1").tobytes()
    lines = [data[k * columns * unit : (k + 1) * columns * unit] for k in range(rows)]
    raw = b""
    for k, line in enumerate(lines):
        above = lines[k - 1] if k else bytes(len(line))
        raw += bytes([kinds[k]])
        for i, value in enumerate(line):
            a = line[i - unit] if i >= unit else 0
            b, c = above[i], above[i - unit] if i >= unit else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            raw += bytes([(value - [0, a, b, (a + b) // 2, nearest][kinds[k]]) % 256])
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, depth, colour, 0, 0, 0)),
        (b"IDAT", zlib.compress(raw)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in parts
    )


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 6),
    st.integers(1, 6),
    st.sampled_from([8, 16]),
    st.sampled_from([(0, 1), (2, 3), (4, 2), (6, 4)]),
    st.lists(st.integers(0, 4), min_size=6, max_size=6),
)
def test_pictures_of_any_filter_are_read(
    tmp_path_factory: pytest.TempPathFactory,
    rows: int,
    columns: int,
    depth: int,
    kind: tuple[int, int],
    kinds: list[int],
) -> None:
    colour, channels = kind
    rng = np.random.default_rng(rows * 31 + columns)
    pixels = rng.integers(0, 2**depth, (rows, columns, channels))
    path = tmp_path_factory.mktemp("png") / "p.png"
    path.write_bytes(_filtered(pixels, kinds, depth, colour))
    codes, coloured = png.read(path)
    assert coloured == (colour in (2, 6))
    expected = np.rint(pixels[..., :3].mean(axis=2)) if coloured else pixels[..., 0]
    np.testing.assert_array_equal(codes, expected)
    assert codes.dtype == (np.uint16 if depth == 16 else np.uint8)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([np.uint8, np.uint16]))
def test_pictures_that_we_write_are_read_again(
    tmp_path_factory: pytest.TempPathFactory, seed: int, kind: type
) -> None:
    rng = np.random.default_rng(seed)
    values = rng.integers(0, np.iinfo(kind).max + 1, rng.integers(1, 20, 2)).astype(kind)
    path = tmp_path_factory.mktemp("png") / "p.png"
    png.write(values, path)
    np.testing.assert_array_equal(png.read(path)[0], values)


def test_a_damaged_picture_is_refused_at_any_byte(tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    png.write(np.arange(20, dtype=np.uint16).reshape(4, 5), path)
    good = path.read_bytes()
    for k in range(len(good)):
        path.write_bytes(good[:k] + bytes([good[k] ^ 0x55]) + good[k + 1 :])
        with pytest.raises(InputError):
            png.read(path)
        path.write_bytes(good[:k])
        with pytest.raises(InputError):
            png.read(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "other"}, "format"),
        ({"version": 2}, "version"),
        ({"size_mm": [1.0]}, "size_mm"),
        ({"size_mm": [0.0, 1.0]}, "texel"),
        ({"amplitude_g": [1.0, 0.5]}, "amplitude"),
        ({"frequency_hz": "low"}, "frequency_hz"),
        ({"tiles": 1}, "tiles"),
        ({"steps": {"amplitude_g": 0.0, "frequency_hz": 40.0}}, "amplitude_g"),
        ({"layers": {"intensity": "../a.png", "sharpness": "b.png"}}, "same folder"),
        ({"layers": {"intensity": "none.png", "sharpness": "none.png"}}, "there is no such file"),
        ({"unknown": 1}, "unknown"),
    ],
)
def test_a_wrong_description_is_reported(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    path = texture_map.write(_map(), tmp_path / "m").files[0]
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=words) as caught:
        texture_map.read(path)
    assert str(tmp_path) in str(caught.value)


def test_layers_of_different_size_are_refused(tmp_path: Path) -> None:
    path = texture_map.write(_map(), tmp_path / "m").files[0]
    png.write(np.zeros((2, 2), np.uint8), tmp_path / "m.sharpness.png")
    with pytest.raises(InputError, match="differ in size"):
        texture_map.read(path)
