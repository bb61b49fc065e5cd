# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints of a rig hold the model along the limbs, against sliding on loose cloth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import retarget_variants as variants

from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.mapping import BoneMapping, map_bones
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.canonical_pose import matrices, posed
from hfx_blender.engine.retargeting.joints import skeletons_of
from hfx_blender.engine.retargeting.limbs import Limbs
from hfx_blender.engine.retargeting.turns import apply
from hfx_blender.errors import InputError

MODEL_ID = "hfx-pressure-1"


def in_trousers(variant: variants.Variant) -> variants.Variant:
    """Return the avatar in wide trousers, wider downwards, with a fold at the shin."""
    points = variant.target.vertices.copy()
    heads = {bone.name: np.asarray(bone.head) for bone in variant.target.bones}
    for side in "LR":
        hip, ankle = heads[f"upperleg01.{side}"], heads[f"foot.{side}"]
        down = (hip[2] - points[:, 2]) / (hip[2] - ankle[2])
        axis = hip + np.clip(down, 0.0, 1.0)[:, None] * (ankle - hip)
        out = (points - axis) * (1.0, 1.0, 0.0)
        off = np.linalg.norm(out, axis=1)
        leg = (down > 0.15) & (down < 1.0) & (off < 0.14)
        fold = np.exp(-(((down - 0.72) / 0.06) ** 2))
        thick = 0.05 * np.clip(down - 0.15, 0.0, 1.0) + 0.03 * fold
        points += (leg * thick / np.maximum(off, 1e-9))[:, None] * out
    return replace(variant, target=replace(variant.target, vertices=points))


def test_trousers_do_not_pull_the_knees_down() -> None:
    target = variants.decimated(in_trousers(variants.canonical())).target
    warped = variants.warp(load_avatar(), target, map_bones(target.bones))  # type: ignore[arg-type]
    _, quality = retarget.fit(load_model(MODEL_ID), warped)
    heads = {bone.name: np.asarray(bone.head) for bone in target.bones}
    rest = load_avatar().vertices
    for side in "LR":
        knee = heads[f"lowerleg01.{side}"]
        # The kneecap of the canonical avatar, in front of the joint; the rig is canonical as well.
        near = np.linalg.norm((rest - knee)[:, [0, 2]], axis=1) < 0.015
        cap = np.flatnonzero(near & (rest[:, 1] < knee[1]))
        assert abs(np.median(warped.vertices[cap, 2] - rest[cap, 2])) < 0.015, side
    assert all(off < 20.0 for off in quality.joints_mm.values()), quality.joints_mm


def test_a_model_off_a_joint_is_named() -> None:
    target = variants.canonical().target
    model = load_model(MODEL_ID)
    warped = variants.warp(load_avatar(), target, map_bones(target.bones))  # type: ignore[arg-type]
    nearest = model.avatar_vertices[:, 0]
    rest, _ = retarget.carried(model, warped.posed, warped.normals)
    low = rest - (0.0, 0.0, 0.03) * (model.part == 8)[:, None] * (model.side == 1)[:, None]
    offsets_m = warped.limbs.offsets_m(nearest, rest, low, warped.surface)
    assert 0.02 < max(offsets_m["knee.L"], offsets_m["knee.R"]) < 0.04
    assert min(offsets_m["knee.L"], offsets_m["knee.R"]) < 0.01


def test_a_sitting_avatar_is_neither_tilted_nor_enlarged() -> None:
    """The trunk of the shipped avatar keeps position and size; one leg may stay stretched."""
    legs = {"upperleg01.L": variants.turn(0, -85.0), "lowerleg01.L": variants.turn(0, 85.0)}
    both = legs | {"upperleg01.R": variants.turn(0, -70.0), "lowerleg01.R": variants.turn(0, 80.0)}
    for turns in (legs, both):
        seated = variants.posed(variants.canonical(), turns, {}).target
        bodies = skeletons_of(load_avatar(), seated, map_bones(seated.bones))
        np.testing.assert_allclose(bodies.to_target[:3, :3], np.eye(3), atol=0.03)
        np.testing.assert_allclose(
            bodies.joints["head"], canonical_heads()["head"], rtol=0.0, atol=0.03
        )


def test_a_quadruped_whose_legs_are_bent_as_a_sitters_is_refused() -> None:
    sitting = {f"upperleg01.{side}": variants.turn(0, -85.0) for side in "LR"}
    sitting |= {f"lowerleg01.{side}": variants.turn(0, 60.0) for side in "LR"}
    seated = variants.posed(variants.canonical(), sitting, {}).target
    narrow = [
        replace(bone, head=(0.3 * bone.head[0], *bone.head[1:])) if bone.head[2] > 1.0 else bone
        for bone in seated.bones
    ]
    mapping = BoneMapping("plain", {bone.name: bone.name for bone in seated.bones}, {}, ())
    skeletons_of(load_avatar(), seated, mapping)
    with pytest.raises(InputError, match="four legs"):
        skeletons_of(load_avatar(), replace(seated, bones=tuple(narrow)), mapping)


def test_a_forearm_without_a_wrist_points_at_its_hand() -> None:
    bend = {"lowerarm01.L": variants.turn(1, 40), "lowerarm01.R": variants.turn(1, -40)}
    variant, avatar = variants.posed(variants.canonical(), bend, {}), load_avatar()
    stems = ("upperarm01", "lowerarm01", "upperleg01", "lowerleg01", "foot")
    names = {"root", "spine01", "head", *(f"{stem}.{side}" for stem in stems for side in "LR")}
    mapping = BoneMapping("plain", {name: name for name in names}, {}, ())
    bodies = skeletons_of(avatar, variant.target, mapping)
    moved = apply(bodies.to_target, posed(avatar, matrices(avatar, bodies)))
    hands = np.isin(avatar.part, [PARTS.index("hand_palm"), PARTS.index("fingers")])
    off_m = np.linalg.norm(moved - variant.places, axis=1)[hands]
    assert np.median(off_m) < 0.03  # 0.20 where the upper arm's direction goes on


def test_a_bent_knee_has_no_outline_across_the_thigh() -> None:
    sitting = {f"upperleg01.{side}": variants.turn(0, -80) for side in "LR"}
    sitting |= {f"lowerleg01.{side}": variants.turn(0, 80) for side in "LR"}
    target = variants.posed(variants.canonical(), sitting, {}).target
    mapping = BoneMapping("plain", {bone.name: bone.name for bone in target.bones}, {}, ())
    rings = Limbs(load_avatar(), skeletons_of(load_avatar(), target, mapping)).rings
    bent = {name for name, ring in rings.items() if ring.is_bent}
    assert bent == {"knee.L", "knee.R"}
