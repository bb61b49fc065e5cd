# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of one avatar taken together: numbered one after the other, nothing lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import SkinWeights, load_avatar
from hfx_blender.engine.body.rigs.mapping import BoneMapping, RigBone
from hfx_blender.engine.retargeting.skin_parts import joined, ranked, skin_of
from hfx_blender.engine.retargeting.target import TargetAvatar

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
    """The canonical avatar as a mesh of its own rig."""
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


def test_a_layer_over_the_skin_is_not_the_skin_whatever_the_order_and_the_unit() -> None:
    target, mapping = canonical_mesh()
    centre = target.vertices.mean(axis=0)
    suit = replace(target, vertices=centre + 1.05 * (target.vertices - centre))
    nothing = replace(target, triangles=np.zeros((0, 3), np.int64))
    for scale in (1.0, 100.0):
        scaled = [
            replace(
                mesh,
                vertices=scale * mesh.vertices,
                bones=tuple(
                    replace(
                        bone,
                        head=tuple(scale * np.array(bone.head)),
                        tail=tuple(scale * np.array(bone.tail)),
                    )
                    for bone in mesh.bones
                ),
            )
            for mesh in (suit, nothing, target)
        ]
        assert skin_of(load_avatar(), scaled, mapping) == [2]
        assert skin_of(load_avatar(), scaled[::-1], mapping) == [0]
        assert ranked(load_avatar(), scaled, mapping) == [2, 0, 1]
