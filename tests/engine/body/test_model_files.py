# SPDX-License-Identifier: GPL-3.0-or-later
"""Model files: round trips, and messages about damaged files."""

from __future__ import annotations

import zipfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.errors import InputError, OutputError
from hfx_tools.body_building import model_file, walk_cycle


def assert_equal(one: Any, second: Any) -> None:
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(second, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype and np.array_equal(a, b), field.name
        elif isinstance(a, model.SkinWeights | model.Skeleton):
            assert_equal(a, b)
        else:
            assert a == b, field.name


@pytest.mark.parametrize(
    "get", (model.load_avatar, walk_cycle.load_walk, lambda: model.load_model("hfx-temperature-1"))
)
def test_models_survive_saving_byte_by_byte(get: Any, tmp_path: Path) -> None:
    item = get()
    model_file.save(item, tmp_path / "one.npz")
    again = model.load(type(item), tmp_path / "one.npz")
    assert_equal(item, again)
    model_file.save(again, tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.npz", "two.npz"]


def test_the_hash_changes_with_one_bit_of_one_vertex() -> None:
    item = model.load_model("hfx-temperature-1")
    vertices = item.vertices.copy()
    vertices[7, 1] = np.nextafter(vertices[7, 1], np.float32(9.0))
    assert replace(item, vertices=vertices).content_hash != item.content_hash
    assert replace(item, id="other").content_hash != item.content_hash
    assert replace(item, provenance={}).content_hash == item.content_hash


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.npz: there is no such file"):
        model.load(model.Avatar, tmp_path / "gone.npz")


@pytest.mark.parametrize("keep", (0, 10, 1000, 20000))
def test_a_cut_file_is_refused(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "cut.npz"
    model_file.save(model.load_model("hfx-temperature-1"), path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"cut\.npz: not a readable body model"):
        model.load(model.PerceptualModel, path)


@pytest.mark.parametrize("content", [b"", bytes(500), b"hello", b"\x93NUMPY"])
def test_a_file_that_is_no_archive_is_said_to_be_none(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "zeros.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"model \(no \.npz archive, or cut short\)\.$"):
        model.load(model.PerceptualModel, path)


def test_a_damaged_byte_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    model_file.save(model.load_model("hfx-temperature-1"), path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"bad\.npz"):
        model.load(model.PerceptualModel, path)


def test_a_dimension_beyond_64_bits_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "huge.npz"
    model_file.save(model.load_model("hfx-temperature-1"), path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    head = f"{{'descr': '<i4', 'fortran_order': False, 'shape': ({10**30},), }}\n".encode()
    members["mirror.npy"] = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(InputError, match=r"huge\.npz: not a readable body model"):
        model.load(model.PerceptualModel, path)


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.npz"
    model_file.save(walk_cycle.load_walk(), path)
    with pytest.raises(InputError, match="expected a PerceptualModel"):
        model.load(model.PerceptualModel, path)


def test_a_plain_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plain.npz"
    np.savez(path, values=np.arange(3))
    with pytest.raises(InputError, match=r"plain\.npz: not a readable body model"):
        model.load(model.PerceptualModel, path)


def test_an_unknown_id_names_those_there_are() -> None:
    with pytest.raises(InputError, match=r"'hfx-wind-1' is unknown\. Available: hfx-pressure-1"):
        model.load_model("hfx-wind-1")


def test_the_skeleton_alone_is_that_of_the_avatar() -> None:
    assert_equal(model.load_skeleton(), model.load_avatar().skeleton)


@pytest.mark.parametrize("where", (0.1, 0.3, 0.5, 0.7, 0.9))
def test_damage_anywhere_in_a_file_is_found(where: float, tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    model_file.save(model.load_model("hfx-temperature-1"), path)
    data = bytearray(path.read_bytes())
    data[int(where * len(data))] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"bad\.npz"):
        model.load(model.PerceptualModel, path)


def test_an_unwritable_place_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        model_file.save(walk_cycle.load_walk(), tmp_path / "no folder" / "walk.npz")
