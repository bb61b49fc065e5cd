# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape space of people: stored data, and recovery of a known shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import retarget_variants as variants
from scipy.spatial import cKDTree

from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.mapping import map_bones
from hfx_blender.engine.retargeting import shape_fields
from hfx_blender.engine.retargeting.canonical_pose import matrices, posed
from hfx_blender.engine.retargeting.joints import skeletons_of
from hfx_blender.engine.retargeting.limbs import Limbs
from hfx_blender.engine.retargeting.surface import TargetSurface
from hfx_blender.engine.stepwise import finish
from hfx_blender.errors import InputError
from hfx_tools.body_building.shape_variation import save


def test_the_shipped_fields_are_the_avatars_symmetric_and_largest_first() -> None:
    fields = shape_fields.fields_for(load_avatar())
    assert fields is not None and 8 <= len(fields) <= 64
    vertices = load_avatar().vertices
    mirror = cKDTree(vertices).query(vertices * (-1.0, 1.0, 1.0))[1]
    flipped = fields[:, mirror] * (-1.0, 1.0, 1.0)
    np.testing.assert_allclose(flipped, fields, atol=1e-12)
    energy = np.sum(fields**2, axis=(1, 2))
    assert (np.diff(energy) < 0.02 * energy[:-1]).all()
    # A standard deviation of shape, apart from length and girth, is centimetres.
    assert 0.002 < np.sqrt(energy[0] / len(vertices)) < 0.03


def test_an_avatar_of_another_mesh_has_no_fields() -> None:
    from dataclasses import replace

    avatar = load_avatar()
    assert shape_fields.fields_for(replace(avatar, vertices=avatar.vertices[:-1])) is None


def test_a_shape_is_recovered_from_skin_distances() -> None:
    """Also along the skin, where distances do not determine a vertex's position."""
    avatar, fields = load_avatar(), shape_fields.fields_for(load_avatar())
    rng = np.random.default_rng(1)
    target = variants.canonical().target
    share = rng.normal(size=6)
    truth = target.vertices + np.tensordot(share, fields[:6], 1)
    bodies = skeletons_of(avatar, target, map_bones(target.bones))  # type: ignore[arg-type]
    moved = matrices(avatar, bodies)
    start = posed(avatar, moved)
    surface = TargetSurface(truth, target.triangles, bodies.target_shares)
    limbs = Limbs(avatar, bodies)
    limbs.rings.clear()  # without joints as anchors, as this shape moves joints
    actual = finish(
        shape_fields.shape(fields, moved, start, target.triangles, bodies, surface, limbs)
    )
    flesh = np.isin(avatar.part, [PARTS.index(part) for part in ("torso", "upper_leg")])
    before, after = (np.linalg.norm(p - truth, axis=1)[flesh] for p in (start, actual))
    assert np.median(before) > 0.008
    assert np.median(after) < 0.3 * np.median(before)
    assert np.percentile(after, 95) < 0.5 * np.percentile(before, 95)


def test_nothing_to_hold_on_to_changes_nothing() -> None:
    avatar, fields = load_avatar(), shape_fields.fields_for(load_avatar())
    target = variants.canonical().target
    bodies = skeletons_of(avatar, target, map_bones(target.bones))  # type: ignore[arg-type]
    moved = matrices(avatar, bodies)
    start = posed(avatar, moved)
    far = TargetSurface(target.vertices + 9.0, target.triangles, bodies.target_shares)
    limbs = Limbs(avatar, bodies)
    actual = finish(shape_fields.shape(fields, moved, start, target.triangles, bodies, far, limbs))
    np.testing.assert_array_equal(actual, start)


def test_saved_fields_are_read_again_within_their_eight_bits(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    mirror = np.array([1, 0, 2, 4, 3])
    half = rng.normal(size=(3, 5, 3))
    fields = half + half[:, mirror] * (-1.0, 1.0, 1.0)
    save(fields, mirror, tmp_path / "shapes.npz")
    again = shape_fields.read(tmp_path / "shapes.npz")
    step = np.abs(fields).max(axis=(1, 2), keepdims=True) / 127.0
    assert (np.abs(again - fields) <= 0.5 * step + 1e-6).all()


def test_files_that_are_no_fields_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "shapes.npz"
    with pytest.raises(InputError, match="no such file"):
        shape_fields.read(path)
    path.write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="not readable"):
        shape_fields.read(path)
    np.savez(path, meta=np.frombuffer(b'{"format": "other", "version": 1}', np.uint8))
    with pytest.raises(InputError, match="format 'other'"):
        shape_fields.read(path)
