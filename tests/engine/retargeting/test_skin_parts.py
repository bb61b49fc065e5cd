# SPDX-License-Identifier: GPL-3.0-or-later
"""Several meshes of an avatar combined: consecutive numbering, no loss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import retarget_variants as variants
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import SkinWeights, load_avatar, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.mapping import BoneMapping, RigBone
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.joints import skeletons_of
from hfx_blender.engine.retargeting.layers import joined, skin_of
from hfx_blender.engine.retargeting.surface import vertex_normals
from hfx_blender.engine.retargeting.target import TargetAvatar
from hfx_blender.engine.stepwise import finish
from hfx_blender.errors import InputError

BONES = ("root", "spine01", "head", "wrist.L", "wrist.R")


def _mesh(seed: int, vertices: int, names: tuple[str, ...]) -> TargetAvatar:
    generator = np.random.default_rng(seed)
    counts = generator.integers(0, len(names) + 1, vertices)
    offsets = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
    bones = [generator.permutation(len(names))[:count] for count in counts]
    return TargetAvatar(
        vertices=generator.normal(size=(vertices, 3)),
        triangles=generator.integers(0, vertices, (vertices, 3)),
        weights=SkinWeights(
            offsets,
            np.concatenate([*bones, np.zeros(0, int)]).astype(np.int32),
            generator.random(offsets[-1]).astype(np.float32),
        ),
        bone_names=names,
        bones=(),
    )


def _row(target: TargetAvatar, vertex: int) -> dict[str, float]:
    start, end = target.weights.offsets[vertex : vertex + 2]
    names = [target.bone_names[bone] for bone in target.weights.bones[start:end]]
    return dict(zip(names, target.weights.values[start:end].tolist(), strict=True))


_meshes = st.lists(
    st.tuples(
        st.integers(0, 2**32 - 1),
        st.integers(1, 7),
        st.permutations(BONES).flatmap(
            lambda names: st.integers(1, len(names)).map(lambda count: tuple(names[:count]))
        ),
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=60, deadline=None)
@given(_meshes)
def test_every_vertex_triangle_and_weight_is_found_again(
    meshes: list[tuple[int, int, tuple[str, ...]]],
) -> None:
    targets = [_mesh(*mesh) for mesh in meshes]
    union = joined(targets)
    assert len(union.vertices) == sum(len(target.vertices) for target in targets)
    vertex = face = 0
    for target in targets:
        for k in range(len(target.vertices)):
            assert np.array_equal(union.vertices[vertex + k], target.vertices[k])
            assert _row(union, vertex + k) == _row(target, k)
        for k, triangle in enumerate(target.triangles):
            assert np.array_equal(
                union.vertices[union.triangles[face + k]], target.vertices[triangle]
            )
        vertex, face = vertex + len(target.vertices), face + len(target.triangles)


def canonical_mesh() -> tuple[TargetAvatar, BoneMapping]:
    """Return the canonical avatar as a mesh with a rig."""
    avatar = load_avatar()
    skeleton = avatar.skeleton
    heads = skeleton.rest[:, :3, 3]
    tails = heads + skeleton.rest[:, :3, 1] * np.reshape(skeleton.lengths_m, (-1, 1))
    bones = tuple(
        RigBone(name, None if parent < 0 else skeleton.bone_names[parent], tuple(head), tuple(tail))
        for name, parent, head, tail in zip(
            skeleton.bone_names, skeleton.parents, heads.tolist(), tails.tolist(), strict=True
        )
    )
    faces = avatar.faces.astype(np.int64)
    target = TargetAvatar(
        avatar.vertices.astype(np.float64),
        np.concatenate((faces[:, [0, 1, 2]], faces[:, [0, 2, 3]])),
        avatar.weights,
        tuple(skeleton.bone_names),
        bones,
    )
    own = {name: name for name in skeleton.bone_names}
    return target, BoneMapping("plain", own, {}, ())


def _part(target: TargetAvatar, is_chosen: np.ndarray, out_m: float = 0.0) -> TargetAvatar:
    """Return triangles with all corners in the mask, moved outwards."""
    normals = vertex_normals(target.vertices, target.triangles)
    is_inside = is_chosen[target.triangles].all(axis=1)
    return replace(
        target,
        vertices=target.vertices + out_m * normals,
        triangles=target.triangles[is_inside],
    )


def test_visible_meshes_are_chosen_in_any_order_and_unit() -> None:
    target, mapping = canonical_mesh()
    parts = load_avatar().part
    height = target.vertices[:, 2]
    is_of = {name: parts == PARTS.index(name) for name in PARTS}
    legs = is_of["upper_leg"] | is_of["lower_leg"]
    meshes = {
        "body": _part(target, height > 0.06),  # ankle stubs
        "shoes": _part(target, height < 0.14, 0.008),
        "trousers": _part(target, legs & (height < 0.8), 0.015),
        "hair": _part(target, is_of["head"] & (target.vertices[:, 1] > -0.02), 0.02),
        "underwear": _part(target, is_of["torso"] & (height > 1.2), -0.01),
        "nothing": replace(target, triangles=np.zeros((0, 3), np.int64)),
    }
    for scale, order in ((1.0, 1), (100.0, -1)):
        names = list(meshes)[::order]
        scaled = [
            replace(
                meshes[name],
                vertices=scale * target.vertices
                + scale * (meshes[name].vertices - target.vertices),
                bones=tuple(
                    replace(
                        bone,
                        head=tuple(scale * np.array(bone.head)),
                        tail=tuple(scale * np.array(bone.tail)),
                    )
                    for bone in target.bones
                ),
            )
            for name in names
        ]
        seen = [names[k] for k in finish(skin_of(load_avatar(), scaled, mapping))]
        assert seen[0] == "body" and set(seen) == {"body", "shoes", "trousers"}
    skin = {names[k] for k in finish(skin_of(load_avatar(), scaled, mapping, "skin"))}
    assert skin == {"body", "shoes", "underwear"}  # no foot is under the shoes


def test_the_outer_layer_is_chosen() -> None:
    target, mapping = canonical_mesh()
    parts = load_avatar().part
    shins = parts == PARTS.index("lower_leg")
    both = joined([target, _part(target, shins, 0.015)])
    model = load_model("hfx-pressure-1")
    mine = model.part == PARTS.index("lower_leg")
    inner = len(target.vertices)
    for layer, share in (("visible", 1.0), ("skin", 0.0)):
        warped = variants.warp(load_avatar(), both, mapping, layer)  # type: ignore[arg-type]
        fitted, _ = retarget.fit(model, replace(warped, same=None))
        on_cloth = (fitted.anchors.corners[mine] >= inner).all(axis=1)
        assert abs(on_cloth.mean() - share) < 0.15, layer


def _ball(target: TargetAvatar, middle: tuple[float, float, float], radius: float) -> TargetAvatar:
    """Return a sphere parented to the head."""
    from trimesh.creation import icosphere

    ball = icosphere(4, radius)
    count, head = len(ball.vertices), target.bone_names.index("head")
    return replace(
        target,
        vertices=ball.vertices + middle,
        triangles=np.array(ball.faces, np.int64),
        weights=SkinWeights(
            np.arange(count + 1, dtype=np.int32),
            np.full(count, head, np.int32),
            np.ones(count, np.float32),
        ),
    )


def test_a_hat_that_is_wider_than_the_head_is_no_head() -> None:
    target, mapping = canonical_mesh()
    hat = _ball(target, (0.0, -0.06, 1.80), 0.16)
    assert finish(skin_of(load_avatar(), [hat, target], mapping)) == [1]


def test_a_solid_inside_the_head_is_no_face() -> None:
    target, mapping = canonical_mesh()
    hair = _ball(target, (0.0, 0.0, 1.74), 0.115)
    assert finish(skin_of(load_avatar(), [hair, target], mapping)) == [1]


def test_a_hand_alone_is_no_body() -> None:
    target, mapping = canonical_mesh()
    hand = _part(target, target.vertices[:, 0] > 0.62)
    with pytest.raises(InputError, match="show no torso"):
        skeletons_of(load_avatar(), hand, mapping)
