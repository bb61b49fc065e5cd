# SPDX-License-Identifier: GPL-3.0-or-later
"""Landmarks of third-party avatars: rigs with knees and elbows displaced from the skin's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import retarget_variants as variants
from strangers import BIPED, CENTIMETRES, ENGINE, Figure, made

from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.rigs.mapping import map_bones
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.joints import skeletons_of, with_placed_hinges
from hfx_blender.engine.retargeting.quality import HINGE_MM, PLACE_MM, uncertainty_sentence
from hfx_blender.engine.retargeting.turns import apply

T_POSE = {"upperarm01.L": variants.turn(1, -45), "upperarm01.R": variants.turn(1, 45)}
BENT = {
    **{f"upperleg01.{side}": variants.turn(0, -25) for side in "LR"},
    **{f"lowerleg01.{side}": variants.turn(0, 30) for side in "LR"},
}
MUSCLES = {"upper_leg": 1.25, "lower_leg": 1.2, "upper_arm": 1.4, "forearm": 1.25, "torso": 1.15}
CHILD = {"upperleg": 0.7, "lowerleg": 0.75, "upperarm": 0.75, "lowerarm": 0.75}
FIGURES = (
    Figure("engine's mannequin", ENGINE, is_blurred=True, lumps_m=0.01),
    Figure("bent knees", ENGINE, turns=BENT, girths={"lower_leg": 0.8}, seed=2),
    Figure("muscles, T", ENGINE, girths=MUSCLES, turns=T_POSE, lumps_m=0.01, seed=3),
    Figure("crowd, child", BIPED, CHILD, {"head": 1.3}, triangles=0.15, space=CENTIMETRES, seed=4),
    Figure("crowd, trousers", BIPED, clothes=("trousers",), triangles=0.15, space=CENTIMETRES),
)
HINGES = tuple(f"{stem}.{side}" for stem in ("knee", "elbow") for side in "LR")


def _placed_m(figure: Figure) -> dict[str, np.ndarray]:
    """Return detected knees and elbows, in metres of the shipped avatar's space."""
    target = made(figure).target
    avatar = load_avatar()
    bodies = skeletons_of(avatar, target, map_bones(target.bones))  # type: ignore[arg-type]
    quads = avatar.faces.astype(np.int64)
    triangles = np.concatenate((quads[:, :3], quads[:, [0, 2, 3]]))
    points = avatar.vertices.astype(np.float64)
    actual, _ = with_placed_hinges(bodies, points, triangles, target.triangles)
    return {name: apply(bodies.to_target, actual.joints[name]) for name in HINGES}


@pytest.mark.parametrize("beside_m", [0.04, -0.04])
@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_a_joint_off_the_visible_knee(figure: Figure, beside_m: float) -> None:
    """Compares a rig with joints moved along the limb, and the rig with correct joints."""
    unit = 0.01 if figure.rig is BIPED else 1.0
    truth = {bone.name: np.asarray(bone.head) for bone in made(figure).target.bones}
    bones = {"knee": "lowerleg01", "elbow": "lowerarm01"}
    moved = replace(figure, knees_m=beside_m, elbows_m=beside_m)
    for name, joint_m in _placed_m(moved).items():
        stem, side = name.split(".")
        off = np.linalg.norm(joint_m - truth[figure.rig[f"{bones[stem]}.{side}"]]) * unit
        assert off < 0.025, name


def test_a_rig_that_agrees_with_its_skin_keeps_its_joints() -> None:
    for name, joint_m in _placed_m(Figure("plain", lumps_m=0.0)).items():
        bone = {"knee": "lowerleg01", "elbow": "lowerarm01"}[name[:-2]]
        assert np.linalg.norm(joint_m - canonical_heads()[f"{bone}{name[-2:]}"]) < 0.004, name


def test_a_model_lies_at_the_knees_and_elbows_that_are_seen() -> None:
    """Front and back of each joint: 45 mm off with the rig as the only source."""
    figure = Figure("mannequin", ENGINE, is_blurred=True, knees_m=0.045, elbows_m=0.03)
    person, model = made(figure), load_model("hfx-pressure-1")
    mapping = map_bones(person.target.bones)  # type: ignore[arg-type]
    fitted, _ = retarget.fit(model, variants.warp(load_avatar(), person.target, mapping))
    truth, points = person.truth(model), model.vertices.astype(np.float64)
    for side in "LR":
        for bone in ("lowerleg01", "lowerarm01"):
            for ahead in (-0.06, 0.06):
                joint_m = canonical_heads()[f"{bone}.{side}"] + (0.0, ahead, 0.0)
                mark = int(np.linalg.norm(points - joint_m, axis=1).argmin())
                assert np.linalg.norm(fitted.vertices[mark] - truth[mark]) < 0.025, (bone, side)


UNCERTAIN = {
    # Weights made from joints 45 mm too low give no information about the kneecap.
    "knee": (
        Figure("bound anew", ENGINE, knees_m=0.045, is_bound_anew=True),
        ("lowerleg01", (0.0, -0.06, 0.0)),
    ),
    "heel": (
        Figure("platforms", clothes=("platforms", "trousers"), girths=MUSCLES),
        ("foot", (0.0, 0.053, -0.041)),
    ),
    "belly": (
        Figure("half body", clothes=("cut at the waist",), hips_m=0.1),
        ("spine04", (0.0, -0.15, 0.0)),
    ),
}


@pytest.mark.parametrize("landmark", UNCERTAIN)
def test_a_place_that_is_far_off_is_named_with_how_far(landmark: str) -> None:
    figure, (bone, offset) = UNCERTAIN[landmark]
    person, avatar = made(figure), load_avatar()
    mapping = map_bones(person.target.bones)  # type: ignore[arg-type]
    warped = variants.warp(avatar, person.target, mapping)
    off_mm = {}
    for side in "LR" if landmark != "belly" else ("",):
        name = f"{bone}.{side}".rstrip(".")
        near = canonical_heads()[name] + offset
        mark = int(np.linalg.norm(avatar.vertices - near, axis=1).argmin())
        truth = apply(np.linalg.inv(warped.bodies.to_target), person.places[mark])
        off_mm[f"{landmark}.{side}".rstrip(".")] = 1000.0 * np.linalg.norm(
            warped.vertices[mark] - truth
        )
    limit = HINGE_MM if landmark == "knee" else PLACE_MM
    assert max(off_mm.values()) > limit  # else this figure shows nothing
    _, quality = retarget.fit(load_model("hfx-temperature-1"), warped)
    (messages,) = [fault for fault in quality.whole_faults if "uncertain" in fault]
    for name, off in off_mm.items():
        if off > limit:
            assert quality.uncertain_mm[name] >= off, (name, off)
            words = {"L": "left ", "R": "right "}.get(name[-1], "") if "." in name else ""
            assert f"{words}{landmark} {quality.uncertain_mm[name]:.0f} mm" in messages


def test_a_plain_figure_has_no_uncertain_place() -> None:
    person = made(Figure("plain"))
    mapping = map_bones(person.target.bones)  # type: ignore[arg-type]
    warped = variants.warp(load_avatar(), person.target, mapping)
    assert not uncertainty_sentence({p: 1000.0 * u for p, u in warped.uncertain_m.items()})


def test_uncertain_places_are_named_the_worst_first() -> None:
    sentence = uncertainty_sentence(
        {"knee.L": 26.0, "elbow.R": 24.0, "heel.R": 53.4, "belly": 39.0}
    )
    assert sentence == ["these places are uncertain: right heel 53 mm, left knee 26 mm"]
    assert uncertainty_sentence({"knee.L": 25.0, "crown": 40.0}) == []
