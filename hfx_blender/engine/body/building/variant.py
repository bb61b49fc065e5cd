# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body build --variant``: the canonical models as another person, vertex ids unchanged.

No mesh is made anew: each vertex keeps its place on the dense skin, and the skin is shaped by
other MakeHuman targets. A vertex id means the same spot of the body in every variant.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from .... import resources
from ....atomic_files import atomic_file
from ....errors import OutputError, UsageError
from ..mesh_edit import F64, I64, triangle_normals
from ..model import Avatar, PerceptualModel, load_avatar, load_model, manifest, save
from ..nearest import locate
from ..parts import CENTRE, PARTS, RIGHT
from . import assemble, left_skin, segmentation, skeleton, skin, stats
from . import source as source_data
from .build import MANIFEST_VERSION, Progress, quiet
from .left_skin import U8, LeftSkin
from .skin import Skins

_MACRO: Final = "targets/macrodetails"
_ORIGINS: Final = ("african", "asian", "caucasian")
_AGES: Final = ("baby", "child", "young", "old")
_AGES_YEARS: Final = (1.0, 10.0, 25.0, 90.0)
_ERROR_STRIDE: Final = 41
"""The distance of the skin from the mesh is measured at one sample in so many."""


@dataclass(frozen=True)
class Variant:
    """A person by MakeHuman's macro values; the defaults are the average adult's."""

    gender: float = 0.5  # 0 female, 1 male
    age: float = 25.0  # years
    muscle: float = 0.5  # 0 least, 1 most
    weight: float = 0.5  # 0 least, 1 most
    stature: float = 0.5  # build, 0 of a short, 1 of a tall person: limbs against head
    proportions: float = 0.5  # 0 uncommon, 1 ideal
    height: float | None = None  # metres; None is as tall as the source makes this person

    def __str__(self) -> str:
        return ",".join(f"{name}={value:g}" for name, value in self.values().items())

    def values(self) -> dict[str, float]:
        """What describes the person, by name; no height where the source decides it."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def suffix(self) -> str:
        """What tells its ids from the canonical ones: ``+`` and eight digits of a hash."""
        text = ",".join(f"{name}={value!r}" for name, value in self.values().items())
        return f"+{hashlib.sha256(text.encode()).hexdigest()[:8]}"


RANGES: Final = {field.name: (0.0, 1.0) for field in fields(Variant)} | {
    "age": (_AGES_YEARS[0], _AGES_YEARS[-1]),
    "height": (0.4, 2.6),
}
"""Smallest and largest value of each; age in years, height in metres."""


def parse(text: str) -> Variant:
    """A variant from the command line: ``gender=1,age=70,height=1.72``.

    Raises
    ------
    UsageError
        An unknown or repeated name, or a value that is not a number of its range.
    """
    values: dict[str, float] = {}
    for item in text.split(","):
        name, equals, word = (piece.strip() for piece in item.partition("="))
        if name not in RANGES or not equals:
            raise UsageError(
                f"--variant '{item}': expected NAME=NUMBER with one of {', '.join(RANGES)}."
            )
        if name in values:
            raise UsageError(f"--variant: '{name}' is given twice.")
        lowest, highest = RANGES[name]
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            unit = {"age": " (years)", "height": " (metres)"}.get(name, "")
            raise UsageError(
                f"--variant {name}={word}: allowed are numbers from {lowest:g} to {highest:g}"
                f"{unit}."
            )
        values[name] = value
    return Variant(**values)


def target_shares(variant: Variant) -> dict[str, float]:
    """Shape targets and their shares, combined as MakeHuman does.

    A share is the product over the axes that the target is made for (gender, age, muscle,
    weight), each axis linear between its two nearest targets; the three origins have a third
    each. Ages are those of MakeHuman's: baby 1, child 10, young 25, old 90 years. Babies have
    no targets of proportions.
    """
    shares: dict[str, float] = {}
    genders = {"female": 1.0 - variant.gender, "male": variant.gender}
    ages = _between(variant.age, _AGES, _AGES_YEARS)
    amounts = [
        _between(getattr(variant, axis), (f"min{axis}", f"average{axis}", f"max{axis}"))
        for axis in ("muscle", "weight")
    ]
    statures = _between(variant.stature, ("minheight", "", "maxheight"))
    proportions = _between(variant.proportions, ("uncommonproportions", "", "idealproportions"))
    for (gender, age), share in _products(genders, ages):
        for origin in _ORIGINS:
            shares[f"{_MACRO}/{origin}-{gender}-{age}.target.gz"] = share / len(_ORIGINS)
    for names, share in _products(genders, ages, *amounts):
        person = "-".join(names)
        shares[f"{_MACRO}/universal-{person}.target.gz"] = share
        for stature, part in statures.items():
            if stature:
                shares[f"{_MACRO}/height/{person}-{stature}.target.gz"] = share * part
        for proportion, part in proportions.items():
            if proportion and "baby" not in names:
                shares[f"{_MACRO}/proportions/{person}-{proportion}.target.gz"] = share * part
    return shares


def _between(
    value: float, names: tuple[str, ...], places: tuple[float, ...] = (0.0, 0.5, 1.0)
) -> dict[str, float]:
    """Shares of the names on either side of a value; they sum to 1."""
    shares = np.interp(value, places, np.arange(len(places))) - np.arange(len(places))
    return {
        name: float(1.0 - abs(share))
        for name, share in zip(names, shares, strict=True)
        if abs(share) < 1.0
    }


def _products(*axes: dict[str, float]) -> Iterator[tuple[tuple[str, ...], float]]:
    for choice in itertools.product(*(axis.items() for axis in axes)):
        share = math.prod(part for _, part in choice)
        if share > 0.0:
            yield tuple(name for name, _ in choice), share


@dataclass(frozen=True, eq=False)
class Original:
    """The average adult, that every variant is shaped from."""

    folder: Path
    skins: Skins
    part: U8  # (V,) of the dense skin
    side: U8  # (V,)
    left: LeftSkin


@dataclass(frozen=True, eq=False)
class Person:
    """A variant's avatar and skin; the quads of the skin are the original's."""

    variant: Variant
    avatar: Avatar
    original: LeftSkin
    left: LeftSkin


def original(source: Path | None) -> Original:
    """The skin that the canonical models were made on.

    Parameters
    ----------
    source : Path, optional
        See :func:`.source.locate`.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    """
    folder = source_data.locate(source)
    average = source_data.read(folder)
    skins = skin.make(average, skeleton.bone_order(average.rig))
    bones = skeleton.make(average, skins.scale, skins.ground_m)
    part, side = segmentation.label(skins.dense, bones)
    return Original(folder, skins, part, side, left_skin.left_of(skins, part, side))


def person(adult: Original, variant: Variant) -> Person:
    """Shape skin and skeleton as a variant.

    Raises
    ------
    InputError
        A shape target is missing or cannot be read.
    """
    shaped = source_data.read(adult.folder, target_shares(variant))
    skins = skin.reshape(adult.skins, shaped.vertices, variant.height)
    canonical = load_avatar()
    avatar = replace(
        canonical,
        id=canonical.id + variant.suffix,
        vertices=skins.avatar.vertices.astype(np.float32),
        skeleton=skeleton.make(shaped, skins.scale, skins.ground_m),
        provenance={**canonical.provenance, **_origin(canonical, variant)},
    )
    left = left_skin.left_of(skins, adult.part, adult.side)
    return Person(variant, avatar, adult.left, left)


def _origin(canonical: Avatar | PerceptualModel, variant: Variant) -> dict[str, Any]:
    return {
        "method": "vertices of the canonical one, each at its place on the skin of a variant",
        "canonical": {"id": canonical.id, "hash": canonical.content_hash},
        "variant": variant.values(),
    }


def model(canonical: PerceptualModel, someone: Person) -> PerceptualModel:
    """A canonical perceptual model on the skin of a variant.

    Ids, triangles, parts, sides, mirror table and skin weights are the canonical ones; places,
    normals, areas, the binding to the avatar and the statistics are the variant's.
    """
    points = _both_sides(canonical, _moved(canonical, someone))
    triangles = canonical.triangles.astype(np.int64)
    normals = _both_sides(canonical, assemble.vertex_normals(points, triangles))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places = points.astype(np.float32)
    areas_m2, gaps_m, errors_m = _measured(canonical, places.astype(np.float64), someone.left)
    avatar = someone.avatar
    avatar_triangles = assemble.triangles_of(avatar.faces)
    over, shares, offset_m = locate(points, avatar.vertices.astype(np.float64), avatar_triangles)
    made = replace(
        canonical,
        id=canonical.id + someone.variant.suffix,
        vertices=places,
        normals=normals.astype(np.float32),
        areas_m2=areas_m2.astype(np.float32),
        avatar_vertices=avatar_triangles[over].astype(np.int32),
        avatar_weights=shares.astype(np.float32),
        avatar_offset_m=offset_m.astype(np.float32),
        provenance={**canonical.provenance, **_origin(canonical, someone.variant)},
    )
    made.provenance["statistics"] = stats.statistics(made, gaps_m, errors_m)
    return made


def _moved(canonical: PerceptualModel, someone: Person) -> F64:
    """Places of the vertices on the variant's skin; those of the right side are not set.

    Vertices raised over the skin, so that their triangles lie on it, keep their rise in
    proportion to the size of the skin below.
    """
    here, there = someone.original, someone.left
    chosen = np.flatnonzero(canonical.side != RIGHT)
    at = canonical.vertices[chosen].astype(np.float64)
    triangle, shares, rise_m = locate(at, here.points, here.triangles)
    corners = here.triangles[triangle]
    facing = triangle_normals(there.points, corners)
    size_before, size = (
        np.linalg.norm(each, axis=1) for each in (triangle_normals(here.points, corners), facing)
    )
    rise_m *= np.sqrt(size / size_before)
    points = np.zeros((len(canonical), 3))
    points[chosen] = np.einsum("ij,ijk->ik", shares, there.points[corners])
    points[chosen] += (rise_m / size)[:, None] * facing
    return points


def _both_sides(canonical: PerceptualModel, vectors: F64) -> F64:
    """Vectors of the left side mirrored to the right, those of the midline without x."""
    result = vectors.copy()
    right = canonical.side == RIGHT
    result[right] = vectors[canonical.mirror[right]] * (-1.0, 1.0, 1.0)
    result[canonical.side == CENTRE, 0] = 0.0
    return result


def _measured(canonical: PerceptualModel, points: F64, left: LeftSkin) -> tuple[F64, F64, F64]:
    """Skin of each vertex, then largest gap and mean error for each part.

    A piece of skin belongs to the nearest vertex of its part.
    """
    from scipy.spatial import cKDTree

    target_mm = canonical.provenance["targets_mm"]
    samples = left_skin.sample(left, np.array([target_mm[part] for part in PARTS]) / 1000.0)
    areas_m2 = np.zeros(len(points))
    for number in range(len(PARTS)):
        inside = samples.part == number
        own = np.flatnonzero((canonical.part == number) & (canonical.side != RIGHT))
        nearest = own[cKDTree(points[own]).query(samples.points[inside])[1]]
        areas_m2 += np.bincount(nearest, samples.areas_m2[inside], minlength=len(points))
    areas_m2[canonical.side == CENTRE] *= 2.0
    right = canonical.side == RIGHT
    areas_m2[right] = areas_m2[canonical.mirror[right]]

    gaps_m = np.zeros(len(PARTS))
    np.maximum.at(gaps_m, samples.part, cKDTree(points).query(samples.points)[0])
    triangles = canonical.triangles.astype(np.int64)
    every = slice(None, None, _ERROR_STRIDE)
    errors_m = _distances_m(samples.points[every], points, triangles)
    part, weight = samples.part[every], samples.areas_m2[every]
    total = np.bincount(part, weight, minlength=len(PARTS))
    mean_m = np.bincount(part, weight * errors_m, minlength=len(PARTS)) / total
    return areas_m2, gaps_m, mean_m


def _distances_m(places: F64, points: F64, triangles: I64) -> F64:
    triangle, shares, _ = locate(places, points, triangles)
    nearest = np.einsum("ij,ijk->ik", shares, points[triangles[triangle]])
    distance: F64 = np.linalg.norm(places - nearest, axis=1)
    return distance


def build(
    source: Path | None, destination: Path, variant: Variant, progress: Progress = quiet
) -> dict[str, Any]:
    """Write avatar, perceptual models and manifest of a variant.

    Parameters
    ----------
    source : Path, optional
        See :func:`.source.locate`.
    destination : Path
        Folder; files of the same names are replaced, each when it is complete, the manifest
        last.
    progress : callable
        Given the share that is done, 0..1, and what is being done.

    Returns
    -------
    dict
        The manifest, as written.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    OutputError
        The folder or a file in it cannot be written.
    UsageError
        The folder is that of the canonical models.
    """
    if destination.resolve() == resources.body_models().resolve():
        raise UsageError(
            f"{destination}: holds the canonical models; name another folder for a variant."
        )
    try:
        destination.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{destination}: cannot be made a folder ({error.strerror}).") from error
    progress(0.0, "reading the source")
    adult = original(source)
    progress(0.25, "shaping the skin")
    someone = person(adult, variant)
    avatar = someone.avatar
    origin = {key: avatar.provenance[key] for key in ("source", "licence")}
    heights_m = avatar.vertices[:, 2]
    made: dict[str, Any] = {
        "version": MANIFEST_VERSION,
        "variant": variant.values(),
        "avatar": {
            "id": avatar.id,
            "file": "avatar.npz",
            "hash": avatar.content_hash,
            "vertices": len(avatar.vertices),
            "bones": len(avatar.skeleton.bone_names),
            "canonical": avatar.provenance["canonical"],
            "height_m": round(float(heights_m.max() - heights_m.min()), 4),
            **origin,
        },
        "models": {},
    }
    save(avatar, destination / "avatar.npz")
    canonical_ids = list(manifest()["models"])
    for number, canonical_id in enumerate(canonical_ids):
        progress(0.3 + 0.7 * number / len(canonical_ids), canonical_id)
        each = model(load_model(canonical_id), someone)
        save(each, destination / f"{each.modality}.npz")
        made["models"][each.id] = {
            "file": f"{each.modality}.npz",
            "hash": each.content_hash,
            "canonical": each.provenance["canonical"],
            "modality": each.modality,
            "vertices": len(each),
            **origin,
            "statistics": each.provenance["statistics"],
        }
    with atomic_file(destination / "manifest.json") as file:
        file.write((json.dumps(made, indent=1) + "\n").encode())
    progress(1.0, "done")
    return made
