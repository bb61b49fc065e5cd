# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigs of another project: Rigify's human metarig, and the rig generated from the metarig."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.mapping import map_bones
from hfx_blender.engine.body.rigs.rig import canonical_heads, canonical_parents

bpy = pytest.importorskip("bpy")
import rigify_avatar  # noqa: E402
from mathutils import Quaternion, Vector  # noqa: E402

from hfx_blender.avatars import avatar_meshes, bodies, stored_fits  # noqa: E402
from hfx_blender.avatars.tracked_rig import HumanPose, TrackedRig, keep_pose  # noqa: E402
from hfx_blender.engine.stepwise import finish  # noqa: E402

MODEL_ID = "hfx-pressure-1"
MAIN = ("clavicle", "upperarm01", "lowerarm01", "wrist", "upperleg01", "lowerleg01", "foot")


@pytest.fixture
def rigify(scene: Any) -> None:
    if not rigify_avatar.enabled():
        pytest.skip("this Blender comes without Rigify")


def _main_bones() -> list[str]:
    fingers = [f"finger{f}-{p}" for f in range(1, 6) for p in range(1, 4)]
    sided = [f"{bone}.{side}" for bone in (*MAIN, *fingers, "toe2-1") for side in "LR"]
    return [*sided, "root", "neck01", "head"]


def test_the_human_metarig_is_mapped_whole(rigify: None) -> None:
    meta = rigify_avatar.metarig()
    mapping = map_bones(avatar_meshes.read_bones(meta))
    assert mapping.convention == "rigify"
    assert set(_main_bones()) <= mapping.bones.keys()
    assert mapping.bones["upperleg01.L"] == "thigh.L"
    assert mapping.bones["finger3-2.R"] == "f_middle.02.R"


def test_a_generated_rig_is_followed_by_its_deforming_bones(rigify: None) -> None:
    meta = rigify_avatar.metarig()
    rigify_avatar.fit(meta)
    rig = rigify_avatar.generated(meta)
    kinds = {bone.name.split("-")[0] for bone in rig.data.bones if "-" in bone.name}
    assert {"DEF", "ORG", "MCH"} <= kinds
    skin = rigify_avatar.bound(rig)

    mapping = map_bones(avatar_meshes.read_bones(rig))
    assert set(_main_bones()) <= mapping.bones.keys()
    assert all(rig.data.bones[name].use_deform for name in mapping.bones.values())
    heads = canonical_heads()
    for bone in _main_bones()[:-3]:
        head_local = np.array(rig.data.bones[mapping.bones[bone]].head_local)
        assert np.linalg.norm(head_local - heads[bone]) < 0.002, bone

    warnings = finish(bodies.adding_body(rig, skin))
    assert not [text for text in warnings if "surface" in text or "area" in text], warnings
    model = load_model(MODEL_ID)
    fitted = stored_fits.fitted_model(rig, MODEL_ID)
    corners = load_avatar().vertices[model.avatar_vertices].astype(np.float64)
    truth = np.einsum("vc,vci->vi", model.avatar_weights.astype(np.float64), corners)
    error_m = np.linalg.norm(fitted.vertices - truth, axis=1)
    for number, part in enumerate(PARTS):
        assert np.median(error_m[model.part == number]) < 0.005, part
    # The skin is bound to the bones moved by Rigify's controls.
    assert all(name.startswith("DEF-") for name in fitted.bone_names)
    assert canonical_parents().keys() == mapping.bones.keys() | mapping.fallbacks.keys()


def test_a_generated_rig_follows_a_tracked_person(rigify: None) -> None:
    """A T-pose turned by 90 degrees about Y points the left arm down, segments included."""
    meta = rigify_avatar.metarig()
    rigify_avatar.fit(meta)
    rig = rigify_avatar.generated(meta)
    tracked = TrackedRig(rig)
    keep_pose(rig, tracked.names)
    pose = HumanPose({"LeftUpperArm": Quaternion((0, 1, 0), math.pi / 2)})
    tracked.apply(tracked.bases(pose, rig), rig)
    bpy.context.view_layer.update()
    heads = [
        rig.pose.bones[name].head for name in ("DEF-upper_arm.L", "DEF-forearm.L", "DEF-hand.L")
    ]
    for first, second in pairwise(heads):
        assert ((second - first).normalized() - Vector((0, 0, -1))).length < 1e-3
