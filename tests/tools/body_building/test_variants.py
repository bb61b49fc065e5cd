# SPDX-License-Identifier: GPL-3.0-or-later
"""Variants: other body shapes with the same vertex ids."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import CENTRE, PARTS, RIGHT
from hfx_blender.errors import UsageError
from hfx_tools.body_building import model_file, outer_skin, source, stats, variant, variant_models
from hfx_tools.body_building.assemble import mirrored_bones, triangles_of
from hfx_tools.body_building.variant import Variant
from hfx_tools.body_building.variant_models import Person

FLIP = np.array((-1.0, 1.0, 1.0), np.float32)
PEOPLE = {
    "neutral": Variant(height=1.8),
    "child": Variant(gender=0.0, age=6.0),
    "heavy": Variant(weight=1.0, height=1.8),
    "elder": Variant(gender=1.0, age=80.0, muscle=0.8, stature=0.7, proportions=1.0),
}


@pytest.fixture(scope="module")
def folder() -> Path:
    named = os.environ.get("HFX_MAKEHUMAN_DATA")
    try:
        return source.locate(Path(named) if named else None)
    except source.InputError as error:
        pytest.skip(f"the source of the body models is not installed: {error}")


@pytest.fixture(scope="module")
def people(folder: Path) -> dict[str, Person]:
    adult = variant_models.original(folder)
    return {name: variant_models.person(adult, who) for name, who in PEOPLE.items()}


@pytest.fixture(scope="module")
def models(people: dict[str, Person]) -> dict[str, model.PerceptualModel]:
    canonical = model.load_model("hfx-pressure-1")
    return {name: variant_models.model(canonical, who) for name, who in people.items()}


def cage(folder: Path, who: Variant) -> F64:
    """Return the body of the base mesh, metres."""
    data = source.read(folder, variant.target_shares(who))
    return data.vertices[np.unique(data.faces)]


def height_m(points: np.ndarray) -> float:
    return float(points[:, 2].max() - points[:, 2].min())


# -- definition of a variant --------------------------------------------------------------------


def test_the_defaults_are_the_average_adult() -> None:
    assert variant.target_shares(Variant()) == pytest.approx(source.AVERAGE_ADULT)


def test_shares_by_hand() -> None:
    # A quarter of the way from child (10) to young (25), three quarters female, halfway to heavy.
    shares = variant.target_shares(Variant(gender=0.25, age=13.75, weight=0.75, stature=1.0))
    path = "targets/macrodetails"
    assert shares[f"{path}/asian-female-child.target.gz"] == pytest.approx(0.75 * 0.75 / 3.0)
    assert shares[
        f"{path}/universal-male-young-averagemuscle-maxweight.target.gz"
    ] == pytest.approx(0.25 * 0.25 * 0.5)
    assert shares[
        f"{path}/height/female-child-averagemuscle-averageweight-maxheight.target.gz"
    ] == pytest.approx(0.75 * 0.75 * 0.5)
    assert not any("proportions" in name for name in shares)


@given(
    st.builds(
        Variant,
        **{
            name: st.floats(lowest, highest)
            for name, (lowest, highest) in variant.RANGES.items()
            if name not in ("height", "stature", "proportions")
        },
    )
)
def test_shares_sum_to_one_person(who: Variant) -> None:
    shares = variant.target_shares(who)
    universal = sum(share for name, share in shares.items() if "/universal-" in name)
    assert universal == pytest.approx(1.0)
    assert sum(shares.values()) == pytest.approx(2.0)
    assert min(shares.values()) >= 0.0


def test_every_target_of_the_corners_is_in_the_source(folder: Path) -> None:
    for age in (1.0, 10.0, 25.0, 90.0):
        for extreme in (0.0, 0.5, 1.0):
            who = Variant(extreme, age, extreme, 1.0 - extreme, extreme, extreme)
            for name in variant.target_shares(who):
                assert (folder / name).is_file(), name


def test_a_spelling_is_read_and_names_its_own_ids() -> None:
    who = variant.parse("gender=1, age=70,height=1.72")
    assert who == Variant(gender=1.0, age=70.0, height=1.72)
    assert variant.parse("gender=0.5").suffix == Variant().suffix
    others = [Variant(), who, Variant(height=1.8), Variant(weight=0.6), Variant(muscle=0.6)]
    assert len({item.suffix for item in others}) == len(others)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected NAME=NUMBER with one of gender, age, muscle, weight"),
        ("size=2", "--variant 'size=2': expected NAME=NUMBER"),
        ("age", "--variant 'age': expected NAME=NUMBER"),
        ("age=old", r"--variant age=old: allowed are numbers from 1 to 90 \(years\)"),
        ("age=0", r"age=0: allowed are numbers from 1 to 90 \(years\)"),
        ("gender=1.5", "gender=1.5: allowed are numbers from 0 to 1"),
        ("weight=nan", "weight=nan: allowed are numbers from 0 to 1"),
        ("height=180", r"height=180: allowed are numbers from 0.4 to 2.6 \(metres\)"),
        ("age=5,age=6", "'age' is given twice"),
    ],
)
def test_bad_values_are_named(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        variant.parse(text)


def test_a_variant_does_not_replace_the_canonical_models() -> None:
    from hfx_blender.files import resources

    with pytest.raises(UsageError, match="holds the canonical models"):
        variant_models.build(None, resources.body_models(), Variant())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("build", "--variant", "age=9"), "add -o DIR"),
        (("build", "--variant", "age=9", "--targets", "table1", "-o", "x"), "--targets"),
        (("build", "--variant", "age=999", "-o", "x"), "from 1 to 90"),
        (("stats", "."), "holds no body model"),
        (("stats", ".", "--compare"), "remove the folder"),
    ],
)
def test_the_command_refuses_in_one_sentence(
    arguments: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from hfx_blender.__main__ import main; main()", "body", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in (2, 3)
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# -- the body ---------------------------------------------------------------------------------


def test_the_neutral_variant_is_the_canonical_body(
    people: dict[str, Person], models: dict[str, model.PerceptualModel]
) -> None:
    avatar, canonical = people["neutral"].avatar, model.load_avatar()
    assert np.abs(avatar.vertices - canonical.vertices).max() < 1e-6
    assert np.abs(avatar.skeleton.rest - canonical.skeleton.rest).max() < 1e-6
    variant_model, shipped = models["neutral"], model.load_model("hfx-pressure-1")
    assert np.linalg.norm(variant_model.vertices - shipped.vertices, axis=1).max() < 1e-4
    assert np.abs(variant_model.normals - shipped.normals).max() < 2e-3
    assert np.corrcoef(variant_model.areas_m2, shipped.areas_m2)[0, 1] > 0.999
    for part in PARTS:
        here, there = (item.provenance["statistics"][part] for item in (variant_model, shipped))
        assert here["mean_mm"] == pytest.approx(there["mean_mm"], abs=0.002)
        assert here["gap_mm"] == pytest.approx(there["gap_mm"], rel=0.01)
        assert here["error_mm"] == pytest.approx(there["error_mm"], rel=0.2)


@pytest.mark.parametrize("name", PEOPLE)
def test_ids_mean_the_same_spot(name: str, models: dict[str, model.PerceptualModel]) -> None:
    variant_model, shipped = models[name], model.load_model("hfx-pressure-1")
    for field in ("triangles", "part", "side", "mirror"):
        assert np.array_equal(getattr(variant_model, field), getattr(shipped, field))
    assert np.array_equal(variant_model.weights.values, shipped.weights.values)
    assert variant_model.bone_names == shipped.bone_names
    assert variant_model.id == shipped.id + PEOPLE[name].suffix
    assert variant_model.content_hash != shipped.content_hash
    assert variant_model.provenance["canonical"] == {"id": shipped.id, "hash": shipped.content_hash}
    assert variant_model.provenance["variant"] == PEOPLE[name].values()
    assert "canonical" not in shipped.provenance


@pytest.mark.parametrize("name", PEOPLE)
def test_left_and_right_are_mirror_images_to_the_bit(
    name: str, people: dict[str, Person], models: dict[str, model.PerceptualModel]
) -> None:
    variant_model, avatar = models[name], people[name].avatar
    assert np.array_equal(
        variant_model.vertices[variant_model.mirror] * FLIP, variant_model.vertices
    )
    assert np.array_equal(variant_model.areas_m2[variant_model.mirror], variant_model.areas_m2)
    assert np.array_equal(variant_model.normals[variant_model.mirror] * FLIP, variant_model.normals)
    assert (variant_model.vertices[variant_model.side == CENTRE, 0] == 0.0).all()
    assert (variant_model.vertices[variant_model.side == RIGHT, 0] < 0.0).all()
    places = {point.tobytes() for point in avatar.vertices + np.float32(0.0)}
    assert places == {point.tobytes() for point in avatar.vertices * FLIP + np.float32(0.0)}
    # The source has four joints of neck and tongue a little off the middle.
    assert (_off_middle_m(avatar.skeleton) < 1e-6).sum() == len(avatar.skeleton.bone_names) - 5
    assert _off_middle_m(avatar.skeleton).max() < 0.006


def _off_middle_m(skeleton: model.Skeleton) -> np.ndarray:
    heads = skeleton.rest[:, :3, 3]
    return np.abs(heads[mirrored_bones(skeleton)] * FLIP - heads).max(axis=1)


@pytest.mark.parametrize("name", PEOPLE)
def test_the_model_lies_on_the_person(
    name: str, people: dict[str, Person], models: dict[str, model.PerceptualModel]
) -> None:
    variant_model, avatar = models[name], people[name].avatar
    assert avatar.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    corners = avatar.vertices[variant_model.avatar_vertices]
    bound = np.einsum("vc,vcd->vd", variant_model.avatar_weights, corners)
    bare = np.linalg.norm(variant_model.vertices - bound, axis=1)
    assert bare.max() < 0.012
    assert np.linalg.norm(variant_model.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    skin_m2 = 2.0 * _area_m2(people[name].left)
    assert variant_model.areas_m2.sum() == pytest.approx(skin_m2, rel=1e-3)
    assert (variant_model.areas_m2 > 0.0).all()
    # Outward: the mesh holds about the volume of the avatar, with a positive sign.
    volumes = [
        _volume_m3(variant_model.vertices, variant_model.triangles),
        _volume_m3(avatar.vertices, triangles_of(avatar.faces)),
    ]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.02)


def _area_m2(half: variant_models.LeftSkin) -> float:
    corners = half.points[half.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(across, axis=1).sum())


def _volume_m3(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(points[triangles].astype(np.float64), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def _inside(places: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Test for points inside a closed mesh, by solid angle (van Oosterom and Strackee 1983)."""
    inside = []
    for point in places:
        a, b, c = np.moveaxis(points[triangles].astype(np.float64) - point, 1, 0)
        la, lb, lc = (np.linalg.norm(item, axis=1) for item in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc
        for first, second, length in ((a, b, lc), (b, c, la), (c, a, lb)):
            below = below + np.einsum("ij,ij->i", first, second) * length
        inside.append(np.arctan2(top, below).sum() > np.pi)  # half the angle: 2 pi inside
    return np.array(inside)


def test_joints_are_inside_the_body(people: dict[str, Person]) -> None:
    names, parents = (
        getattr(model.load_avatar().skeleton, key) for key in ("bone_names", "parents")
    )
    in_head = np.zeros(len(names), bool)  # bones of the face begin on or before the skin
    for bone, parent in enumerate(parents):
        in_head[bone] = parent >= 0 and (in_head[parent] or names[parent] == "head")
    assert 90 < (~in_head).sum() < len(names)
    for who in people.values():
        heads = who.avatar.skeleton.rest[~in_head, :3, 3]
        assert _inside(heads, who.avatar.vertices, triangles_of(who.avatar.faces)).all()
    outside = np.array([[0.0, 0.0, 0.2], [0.0, -1.0, 1.0]])  # between the legs, before the body
    avatar = people["neutral"].avatar
    assert not _inside(outside, avatar.vertices, triangles_of(avatar.faces)).any()


def test_a_heavier_person_has_more_girth(people: dict[str, Person]) -> None:
    from scipy.spatial import ConvexHull

    girths_m = []
    for name in ("neutral", "heavy"):
        avatar = people[name].avatar
        assert height_m(avatar.vertices) == pytest.approx(1.8, abs=1e-6)
        around = np.abs(avatar.vertices[:, 2] - 1.08) < 0.02
        trunk = avatar.vertices[around & (avatar.part == PARTS.index("torso"))]
        girths_m.append(ConvexHull(trunk[:, :2]).area)  # perimeter of a plane hull
    assert 0.6 < girths_m[0] < 1.0
    assert girths_m[1] > 1.05 * girths_m[0]


def test_height_grows_with_age_and_stature(folder: Path) -> None:
    ages = [height_m(cage(folder, Variant(age=age))) for age in (1.0, 8.0, 10.0, 25.0)]
    assert np.all(np.diff(ages) > 0.02)
    builds = [height_m(cage(folder, Variant(stature=value))) for value in (0.0, 0.4, 1.0)]
    assert np.all(np.diff(builds) > 0.02)
    assert 1.6 < ages[-1] < 1.72


def test_a_child_is_shorter_and_finer_spaced(
    people: dict[str, Person], models: dict[str, model.PerceptualModel]
) -> None:
    assert height_m(people["child"].avatar.vertices) < 1.3
    child, adult = (stats.spacing_m(models[name])[0] for name in ("child", "neutral"))
    assert (child < 0.9 * adult).all()
    # A child's head is larger relative to the body.
    assert child[0] / adult[0] > 1.1 * child[1] / adult[1]


def test_height_only_scales(folder: Path) -> None:
    average = source.read(folder)
    skins = outer_skin.make(average, ("root",))
    tall, short = (outer_skin.reshape(skins, average.vertices, metres) for metres in (2.0, 1.0))
    assert tall.avatar.vertices == pytest.approx(2.0 * short.avatar.vertices)
    own = outer_skin.reshape(skins, average.vertices, None)
    assert (own.scale, own.avatar.vertices[:, 2].min()) == (1.0, 0.0)


def test_a_variant_is_stored_and_tabled(people: dict[str, Person], tmp_path: Path) -> None:
    variant_model = variant_models.model(model.load_model("hfx-temperature-1"), people["child"])
    model_file.save(variant_model, tmp_path / "temperature.npz")
    back = model.load(model.PerceptualModel, tmp_path / "temperature.npz")
    assert (back.id, back.content_hash) == (variant_model.id, variant_model.content_hash)
    assert back.provenance == variant_model.provenance
    rows = stats.table([back])
    assert rows[0].mean_mm == pytest.approx(
        variant_model.provenance["statistics"]["head"]["mean_mm"]
    )
    avatar = people["child"].avatar
    model_file.save(avatar, tmp_path / "avatar.npz")
    assert model.load(model.Avatar, tmp_path / "avatar.npz").content_hash == avatar.content_hash
