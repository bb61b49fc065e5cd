# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models on avatars of other shapes, poses, meshes, rigs and units."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import retarget_variants as variants
from retarget_report import warnings_of
from retarget_variants import Variant

from hfx_blender.engine.body.model import SkinWeights, load_avatar, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.native.library import library
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting import surface as surface_module
from hfx_blender.engine.retargeting import target as retarget_target
from hfx_blender.engine.retargeting.bone_regions import REGIONS, above
from hfx_blender.engine.retargeting.surface import TargetSurface, cut_triangles
from hfx_blender.errors import InputError

MODEL_ID = "hfx-pressure-1"


def own_names(variant: Variant) -> Any:
    """Return the identity mapping of a rig with canonical bone names."""
    return SimpleNamespace(
        bones={bone.name: bone.name for bone in variant.target.bones}, fallbacks={}
    )


def few_bones(variant: Variant) -> Any:
    """Return a mapping of only the joints common to all game rigs."""
    stems = ("clavicle", "upperarm01", "lowerarm01", "wrist", "upperleg01", "lowerleg01", "foot")
    stems += ("toe3-1", *(f"finger{f}-{k}" for f in range(1, 6) for k in range(1, 4)))
    names = {f"{stem}.{side}" for stem in stems for side in "LR"}
    names |= {"root", "spine03", "spine01", "neck01", "head"}
    return SimpleNamespace(bones={name: name for name in names}, fallbacks={})


def errors_mm(variant: Variant, warped: retarget.Warp) -> dict[str, float]:
    """Return the median distance from the truth, by part."""
    model = load_model(MODEL_ID)
    fitted, quality = retarget.fit(model, warped)
    # Limbs stretched beyond human proportions make the hinges uncertain.
    assert all("knee" in warning for warning in warnings_of(quality)), warnings_of(quality)
    error = np.linalg.norm(fitted.vertices - variant.truth(model), axis=1)
    error *= 1000.0 * variant.target.metres
    return {
        part: float(np.median(error[model.part == number])) for number, part in enumerate(PARTS)
    }


T_POSE = {
    "upperarm01.L": variants.turn(1, -45.0),
    "upperarm01.R": variants.turn(1, 45.0),
}
ARMS_DOWN = {
    "upperarm01.L": variants.turn(1, 30.0),
    "upperarm01.R": variants.turn(1, -30.0),
}
LONG = {
    f"{bone}{half}.{side}": factor
    for side in "LR"
    for half in ("01", "02")
    for bone, factor in (("upperarm", 1.2), ("lowerarm", 1.2), ("upperleg", 1.15))
}


@lru_cache(maxsize=1)
def canonical() -> Variant:
    return variants.canonical()


def warped_by_few_bones(variant: Variant) -> retarget.Warp:
    return variants.warp(load_avatar(), variant.target, few_bones(variant))


@lru_cache(maxsize=2)
def decimated_and_warped(pose: str) -> tuple[Variant, retarget.Warp]:
    """An unknown mesh at rest or in T-pose; a fit takes seconds."""
    turns: Any = {"rest": {}, "T": T_POSE}[pose]
    variant = variants.decimated(variants.posed(canonical(), turns, {}))
    return variant, warped_by_few_bones(variant)


@lru_cache(maxsize=1)
def shipped_and_warped() -> tuple[Variant, retarget.Warp]:
    variant = canonical()
    return variant, variants.warp(load_avatar(), variant.target, own_names(variant))


def test_the_shipped_avatar_is_met_exactly() -> None:
    model = load_model(MODEL_ID)
    _, warped = shipped_and_warped()
    fitted, _ = retarget.fit(model, warped)
    error = np.linalg.norm(fitted.vertices - model.vertices, axis=1)
    # At a few ridges no height over a triangle leads exactly to the vertex.
    assert error.max() < 2e-3
    assert np.percentile(error, 98) < 2e-6
    assert fitted.model_hash == model.content_hash


@pytest.mark.parametrize(
    ("turns", "stretches"), [(T_POSE, {}), (ARMS_DOWN, {}), ({}, LONG), (T_POSE, LONG)]
)
def test_another_rest_pose_or_proportion_of_the_same_mesh_is_exact(
    turns: Any, stretches: Any
) -> None:
    variant = variants.posed(canonical(), turns, stretches)
    warped = variants.warp(load_avatar(), variant.target, own_names(variant))
    errors = errors_mm(variant, warped)
    # The remaining error is the height of a vertex over the triangle, at most 2.3 mm.
    assert max(errors.values()) < 1.5, errors


@pytest.mark.parametrize(
    ("pose", "stretches"), [("rest", {}), ("T", {}), (ARMS_DOWN, {}), (T_POSE, LONG)]
)
def test_an_unknown_mesh_in_another_rest_pose(pose: Any, stretches: Any) -> None:
    if isinstance(pose, str):
        variant, warped = decimated_and_warped(pose)
    else:
        variant = variants.decimated(variants.posed(canonical(), pose, stretches))
        warped = warped_by_few_bones(variant)
    errors = errors_mm(variant, warped)
    # Human limbs never stretch evenly: the shape prior has a small influence.
    assert max(errors.values()) < (5.0 if stretches else 2.0), errors


def test_centimetres_and_other_axes_change_nothing() -> None:
    plain, warped = decimated_and_warped("T")
    matrix = np.eye(4)
    matrix[:3, :3] = 100.0 * variants.turn(0, -90.0) @ variants.turn(2, 130.0)
    matrix[:3, 3] = (12.0, -30.0, 7.0)
    turned = variants.moved(plain, matrix)
    turned = replace(turned, target=replace(turned.target, metres=0.01))
    first, second = errors_mm(plain, warped), errors_mm(turned, warped_by_few_bones(turned))
    for part in PARTS:
        assert first[part] == pytest.approx(second[part], abs=0.05)


def test_left_fingers_stay_left_and_no_finger_takes_its_neighbours_skin() -> None:
    model = load_model("hfx-vibration-1")
    _, warped = decimated_and_warped("T")
    fitted, quality = retarget.fit(model, warped)
    assert quality.sides == 1.0

    def main_bone(names: Any, weights: SkinWeights) -> Any:
        first = weights.offsets[:-1]
        owners = np.repeat(np.arange(len(first)), np.diff(weights.offsets))
        order = np.lexsort((-weights.values, owners))
        return np.array(names)[weights.bones[order][first]]

    mine = main_bone(model.bone_names, model.weights)
    theirs = main_bone(fitted.bone_names, fitted.weights)
    # Beyond the first joint; up to the joint, fingers share the skin of the web.
    outer = np.array([name.startswith("finger") and name[8] != "1" for name in mine])
    assert np.count_nonzero(outer) > 5000
    pairs = {
        (one[:7] + one[-2:], second[:7] + second[-2:])
        for one, second in zip(mine[outer], theirs[outer], strict=True)
        if second.startswith("finger")
    }
    assert all(one == second for one, second in pairs)
    assert len(pairs) == 10


def test_weights_sum_to_one_and_are_sorted_by_bone() -> None:
    _, warped = decimated_and_warped("rest")
    fitted, _ = retarget.fit(load_model(MODEL_ID), warped)
    weights = fitted.weights
    sums = np.add.reduceat(weights.values.astype(float), weights.offsets[:-1])
    np.testing.assert_allclose(sums, 1.0, atol=1e-6)
    rising = np.diff(weights.bones) > 0
    rising[weights.offsets[1:-1] - 1] = True
    assert rising.all()
    assert (weights.values > 0).all()


def test_anchors_lead_to_the_vertices() -> None:
    for variant, warped in (shipped_and_warped(), decimated_and_warped("rest")):
        fitted, _ = retarget.fit(load_model(MODEL_ID), warped)
        anchors = fitted.anchors
        corners = variant.target.vertices[anchors.corners]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        products = np.einsum("vc,vci->vi", anchors.weights, corners)
        products += across * anchors.offset_m[:, None]
        np.testing.assert_allclose(fitted.vertices, products, atol=1e-5)


def test_skin_that_follows_no_bone_gets_the_canonical_weights() -> None:
    variant = variants.decimated(canonical())
    target = variant.target
    bare = target.vertices[:, 2] > 1.7  # the crown
    counts = np.where(bare, 0, np.diff(target.weights.offsets))
    entries = ~np.repeat(bare, np.diff(target.weights.offsets))
    weights = SkinWeights(
        np.append(0, np.cumsum(counts)).astype(np.int32),
        target.weights.bones[entries],
        target.weights.values[entries],
    )
    target = replace(target, weights=weights)
    warped = variants.warp(load_avatar(), target, own_names(variant))
    model = load_model(MODEL_ID)
    fitted, _ = retarget.fit(model, warped)
    top = int(model.vertices[:, 2].argmax())
    row = slice(*fitted.weights.offsets[top : top + 2])
    own = slice(*model.weights.offsets[top : top + 2])
    assert {fitted.bone_names[b] for b in fitted.weights.bones[row]} <= {
        model.bone_names[b] for b in model.weights.bones[own]
    }


def test_the_same_input_gives_the_same_bytes() -> None:
    model = load_model("hfx-temperature-1")
    both = decimated_and_warped("rest"), decimated_and_warped.__wrapped__("rest")
    first, second = (retarget.fit(model, warped)[0] for _, warped in both)
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.weights.values.tobytes() == second.weights.values.tobytes()


# FitQuality: a poor fit names the part


def test_a_warning_names_a_missing_limb() -> None:
    variant = variants.shuffled(canonical())
    target = variant.target
    keep = ~(target.vertices[target.triangles][:, :, 2] < 0.4).any(axis=1)
    target = replace(target, triangles=target.triangles[keep])
    warped = variants.warp(load_avatar(), target, few_bones(variant))
    _, quality = retarget.fit(load_model(MODEL_ID), warped)
    assert any("no skin of" in warning and "feet" in warning for warning in warnings_of(quality))
    assert not any(warning.startswith("foot") for warning in warnings_of(quality))  # told only once
    assert not any(warning.startswith("fingers") for warning in warnings_of(quality))


def test_swapped_sides_are_a_warning() -> None:
    variant = variants.shuffled(canonical())
    second = {"L": "R", "R": "L"}
    mapping = few_bones(variant)
    mapping.bones = {
        name: name[:-1] + second[name[-1]] if name[-2:-1] == "." else name for name in mapping.bones
    }
    warped = variants.warp(load_avatar(), variant.target, mapping)
    _, quality = retarget.fit(load_model(MODEL_ID), warped)
    assert any("front and back" in warning for warning in warnings_of(quality))


# The search


def test_cut_triangles_cover_their_parent() -> None:
    corners = np.array(
        [[[0.0, 0, 0], [0.3, 0, 0], [0, 0.05, 0]], [[0, 0, 1], [0.01, 0, 1], [0, 0.01, 1]]]
    )
    pieces, parent, places = cut_triangles(corners)
    assert np.count_nonzero(parent == 1) == 1
    areas = retarget_target.areas_of(
        pieces.reshape(-1, 3), np.arange(len(pieces) * 3).reshape(-1, 3)
    )
    np.testing.assert_allclose(np.bincount(parent, areas), [0.0075, 0.00005])
    np.testing.assert_allclose(
        np.einsum("nkc,nci->nki", places, corners[parent]), pieces, atol=1e-12
    )
    edges = np.linalg.norm(pieces - np.roll(pieces, 1, axis=1), axis=2)
    assert edges.max() <= 0.02


def test_nearest_places_keep_to_their_region_and_their_side_of_the_skin() -> None:
    # Two sheets 1 cm apart, of two regions, facing each other.
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    points = np.concatenate((sheet, np.add(sheet, (0, 0, 0.01))))
    triangles = np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]])
    shares = np.repeat(np.eye(2), 4, axis=0)
    surface = TargetSurface(points, triangles, shares)
    queries = np.array([[0.4, 0.5, 0.009]] * 3)
    up, down = [0.0, 0, 1], [0.0, 0, -1]
    places = surface.nearest(
        queries, np.array([up, down, up]), np.array([[1.0, 0], [0, 1], [0, 1]]), 0.05
    )
    assert places.found.tolist() == [True, True, False]
    np.testing.assert_allclose(places.points[:2], [[0.4, 0.5, 0], [0.4, 0.5, 0.01]], atol=1e-12)


@pytest.mark.skipif(library() is None, reason="fewer triangles are compared: docs/native.md")
def test_a_place_is_nearest_also_if_many_centres_are_nearer() -> None:
    """The corner of a triangle of 2 cm lies 1 mm from the point, its centre 11 mm; the centres of
    twelve small triangles lie 6 mm away."""
    large = np.array([[0.001, 0, 0], [0.018, 0.009, 0], [0.018, -0.009, 0]])
    angles = np.linspace(np.pi / 2, 3 * np.pi / 2, 12)
    middles = 0.006 * np.column_stack((np.cos(angles), np.sin(angles), np.zeros(12)))
    small = middles[:, None] + 1e-4 * np.array([[1, 0, 0], [-1, 1, 0], [-1, -1, 0]])
    points = np.concatenate((large[None, [0, 2, 1]], small)).reshape(-1, 3)
    surface = TargetSurface(points, np.arange(39).reshape(-1, 3), np.ones((39, 1)))
    facing = np.sign(surface.normals[:1, 2:]) * [[0.0, 0.0, 1.0]]
    places = surface.nearest(np.zeros((1, 3)), facing, np.ones((1, 1)), 0.05, -1.0)
    np.testing.assert_allclose(places.points, [[0.001, 0, 0]], atol=1e-12)
    assert places.triangle.tolist() == [0]


def test_a_place_behind_a_nearer_one_that_faces_away_is_found() -> None:
    """Two sheets of one region, 2 mm apart, that face each other's way out, as an ear's sides."""
    sheet = [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.01, 0.01, 0]]
    points = np.concatenate((sheet, np.add(sheet, (0, 0, -0.002))))
    triangles = np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]])
    surface = TargetSurface(points, triangles, np.ones((8, 1)))
    queries, down = np.array([[0.004, 0.003, 0.0005]]), np.array([[0.0, 0, -1]])
    places = surface.nearest(queries, down, np.ones((1, 1)), 0.05)
    np.testing.assert_allclose(places.points, [[0.004, 0.003, -0.002]], atol=1e-12)


def test_few_triangles_are_compared_for_a_nearest_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """1 mm above a grid of 1 cm, the place is below the point; half the candidates are far off."""
    x, y = np.meshgrid(np.arange(40) * 0.01, np.arange(40) * 0.01, indexing="ij")
    grid = np.column_stack([x.ravel(), y.ravel(), np.zeros(1600)])
    first = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    corners = [(first, first + 40, first + 41), (first, first + 41, first + 1)]
    triangles = np.concatenate([np.column_stack(columns) for columns in corners])
    surface = TargetSurface(grid, triangles, np.ones((1600, 1)))
    counts: list[int] = []
    improve = TargetSurface._improve

    def counted(self: TargetSurface, best: Any, smallest: Any, point: Any, *more: Any) -> Any:
        counts.append(len(point))
        return improve(self, best, smallest, point, *more)

    monkeypatch.setattr(TargetSurface, "_improve", counted)
    queries = np.random.default_rng(1).uniform((0.02, 0.02, 0.001), (0.37, 0.37, 0.001), (500, 3))
    up = np.tile([0.0, 0.0, 1.0], (500, 1))
    places = surface.nearest(queries, up, np.ones((500, 1)), 0.05)
    np.testing.assert_allclose(places.points, queries * [1, 1, 0], atol=1e-12)
    assert sum(counts) <= 5 * 500
    # Beyond reach nothing is compared.
    counts.clear()
    far = surface.nearest(np.add(queries, [0, 0, 0.1]), up, np.ones((500, 1)), 0.05)
    assert not far.found.any() and not sum(counts)


@pytest.mark.skipif(library() is None, reason="no library was built")
def test_places_are_the_same_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates in random order on triangles large and small, thin, and of no area: the compiled
    comparison enters the same triangles at the same distances as numpy's."""
    rng = np.random.default_rng(3)
    centres = rng.uniform(-0.1, 0.1, (300, 1, 3))
    corners = centres + rng.normal(0.0, 1.0, (300, 3, 3)) * rng.choice([1e-4, 0.004], (300, 1, 1))
    corners[:20, 2] = corners[:20, 1]  # edges
    corners[20:30] = corners[20:30, :1]  # points
    corners[30:60, 2] = corners[30:60, 0] + 0.3 * (corners[30:60, 1] - corners[30:60, 0]) + 1e-9
    surface = TargetSurface(
        corners.reshape(-1, 3), np.arange(900).reshape(-1, 3), np.ones((900, 1))
    )
    points, normals = rng.uniform(-0.12, 0.12, (200, 3)), rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Places on corners, edges and faces, too.
    points[:60] = surface._pieces[:60, 0]
    points[60:120] = surface._pieces[60:120].mean(axis=1)
    point, piece = rng.integers(200, size=9000), rng.integers(len(surface._pieces), size=9000)
    results = []
    for compiled in (library, lambda: None):
        monkeypatch.setattr(surface_module, "library", compiled)
        best, smallest = np.full(200, -1), np.full(200, 0.06)
        faces = surface._improve(best, smallest, point, piece, points, normals, 0.3)
        results.append((best, smallest, np.isin(np.arange(200), point[faces])))
    assert 50 < np.count_nonzero(results[0][0] >= 0) < 190
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(results[0][2], results[1][2])


def test_every_region_hangs_on_the_torso() -> None:
    for region in REGIONS:
        steps = 0
        while region != "torso":
            region, steps = above(region), steps + 1
            assert region in REGIONS
            assert steps < 5


# Bad input: one sentence


def _message(target: retarget_target.TargetAvatar) -> str:
    with pytest.raises(InputError) as caught:
        retarget_target.check(target, "Anna")
    return str(caught.value)


def test_a_good_avatar_passes() -> None:
    assert retarget_target.check(canonical().target, "Anna") is None


def test_unusable_meshes_are_refused_or_reported() -> None:
    target = canonical().target
    assert "no faces" in _message(replace(target, triangles=np.zeros((0, 3), np.int64)))
    assert "no size" in _message(replace(target, vertices=target.vertices * 0.0))
    broken = target.vertices.copy()
    broken[7, 1] = np.nan
    assert "vertex 7" in _message(replace(target, vertices=broken))
    broken[7] = (0.0, 0.0, 1e7)
    stray = replace(target, vertices=broken, metres=0.01)
    assert "vertex 7 of 'Anna' lies 1e+05 m away" in str(retarget_target.check(stray, "Anna"))
    none = SkinWeights(
        np.zeros(len(target.vertices) + 1, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32)
    )
    assert "follow no bone" in _message(replace(target, weights=none))
    loose = np.arange(len(target.triangles) * 3).reshape(-1, 3)
    shifted = target.vertices[target.triangles] + np.arange(len(loose))[:, None, None] * 0.01
    rows = target.triangles.ravel()
    shattered = replace(
        target,
        vertices=shifted.reshape(-1, 3),
        triangles=loose,
        weights=variants.rows_of(target.weights, rows),
    )
    assert "pieces" in str(retarget_target.check(shattered, "Anna"))
    doubled = np.concatenate((target.triangles, target.triangles[:, ::-1]))
    pinched = replace(target, triangles=doubled)
    assert "non-manifold" in str(retarget_target.check(pinched, "Anna"))


def test_a_few_faces_that_lie_there_twice_are_no_fault() -> None:
    target = canonical().target
    lashes = target.triangles[:1500, ::-1]
    both = replace(target, triangles=np.concatenate((target.triangles, lashes)))
    assert retarget_target.check(both, "Anna") is None


def test_split_seams_are_one_piece() -> None:
    target = canonical().target
    rows = target.triangles.ravel()
    split = replace(
        target,
        vertices=target.vertices[rows],
        triangles=np.arange(len(rows)).reshape(-1, 3),
        weights=variants.rows_of(target.weights, rows),
    )
    assert retarget_target.check(split, "Anna") is None


@pytest.mark.parametrize("which", ["none", "all", "every second", "the left"])
def test_faces_that_look_inwards_are_turned(which: str) -> None:
    target = canonical().target
    count = len(target.triangles)
    inwards = {
        "none": np.zeros(count, bool),
        "all": np.ones(count, bool),
        "every second": np.arange(count) % 2 == 0,
        "the left": target.vertices[target.triangles[:, 0], 0] > 0.0,
    }[which]
    spoilt = np.where(inwards[:, None], target.triangles[:, ::-1], target.triangles)
    actual, share = retarget_target.faced_out(replace(target, triangles=spoilt))
    areas = retarget_target.areas_of(target.vertices, target.triangles)
    assert abs(share - areas[inwards].sum() / areas.sum()) < 1e-9
    np.testing.assert_array_equal(actual.triangles, target.triangles)


def test_sheets_of_two_sides_are_left_alone() -> None:
    target = canonical().target
    both = np.concatenate((target.triangles, target.triangles[:, ::-1]))
    assert retarget_target.faced_out(replace(target, triangles=both))[1] == 0.0


def test_something_that_is_not_human_is_refused() -> None:
    variant = canonical()
    bones = tuple(
        replace(bone, head=np.asarray(bone.head)[[1, 2, 0]] * (1, 1, 3))
        if bone.name.startswith(("lowerleg", "foot", "toe"))
        else bone
        for bone in variant.target.bones
    )
    with pytest.raises(InputError, match="human"):
        variants.warp(load_avatar(), replace(variant.target, bones=bones), own_names(variant))


def test_bones_at_one_place_are_refused() -> None:
    variant = canonical()
    bones = tuple(replace(bone, head=np.ones(3)) for bone in variant.target.bones)
    with pytest.raises(InputError, match="one place"):
        variants.warp(load_avatar(), replace(variant.target, bones=bones), own_names(variant))


def test_a_rig_with_hardly_any_bones_still_gets_a_fit() -> None:
    variant = variants.decimated(canonical())
    stems = ("upperarm01", "upperleg01")
    names = ["root", *(f"{stem}.{side}" for stem in stems for side in "LR")]
    mapping = SimpleNamespace(bones={name: name for name in names}, fallbacks={})
    warped = variants.warp(load_avatar(), variant.target, mapping)
    fitted, _ = retarget.fit(load_model(MODEL_ID), warped)
    assert np.isfinite(fitted.vertices).all()


def test_a_mapping_to_a_bone_that_is_not_there_is_refused() -> None:
    variant = canonical()
    mapping = few_bones(variant)
    mapping.bones["wrist.L"] = "Hook"
    with pytest.raises(InputError, match="no bone 'Hook'"):
        variants.warp(load_avatar(), variant.target, mapping)


def test_missing_joints_are_named() -> None:
    variant = canonical()
    mapping = few_bones(variant)
    del mapping.bones["upperarm01.R"]
    with pytest.raises(InputError, match=r"shoulder\.R"):
        variants.warp(load_avatar(), variant.target, mapping)
