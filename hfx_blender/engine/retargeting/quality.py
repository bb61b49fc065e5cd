# SPDX-License-Identifier: GPL-3.0-or-later
"""Quality of the fit of a perceptual model to an avatar by body part, and uncertain places.

Uncertain are hinges where rig, skin weights and proportions differ, places of unusual shape, heels
above thick soles, and the torso of half a body. Factors were chosen on avatars with known answers
(``tests/engine/retargeting/strangers.py``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..body.model import Avatar, PerceptualModel
from ..body.parts import LEFT, PARTS, RIGHT
from .bone_regions import REGIONS, words_of
from .joints import Skeletons, dominant
from .surface import NearestSkin
from .target import vertex_areas

FARTHEST_MM: Final = 15.0  # largest 95th percentile of distances from the skin before projection
IN_PLACE: Final = 0.8  # smallest fraction of vertices on the same part of the avatar
AREA_RATIOS: Final = (0.4, 2.5)
"""Lowest and highest area of a body part, as a multiple of the canonical body's part."""

JOINT_MM: Final = 12.0
"""Largest distance between a joint of the rig and the model's skin around the joint.

Loose trousers shifted a kneecap by twice this distance; a touch at 25 mm misses the knee.
"""

RIGHT_WAY: Final = 0.9  # smallest fraction of limb vertices on a limb of the correct side
_SHOWN: Final = 0.4  # smallest fraction of a part present on the avatar (one hand of two, no stump)
_LOST: Final = 0.5  # smallest ``in_place`` of a carrying part for a fit to the surface
# Parts required for a fit to the surface; hands and feet may be missing
_CARRYING: Final = ("head", "torso", "upper_arm", "forearm", "upper_leg", "lower_leg")

_REGIONS_OF: Final = {
    "head": ("head", "torso"),
    "torso": ("torso", "head", "upperarm", "upperleg"),
    "upper_arm": ("upperarm", "torso", "forearm"),
    "forearm": ("forearm", "upperarm", "hand"),
    "hand_dorsum": ("hand", "forearm", "finger"),
    "hand_palm": ("hand", "forearm", "finger"),
    "fingers": ("finger", "hand"),
    "upper_leg": ("upperleg", "torso", "lowerleg"),
    "lower_leg": ("lowerleg", "upperleg", "foot"),
    "foot_dorsum": ("foot", "lowerleg"),
    "foot_sole": ("foot",),
}

HINGE_MM: Final = 25.0
PLACE_MM: Final = 40.0  # smallest reported uncertainty of a hinge and of other places
# Place to canonical bone, and offset from its head on the left side, metres
_PLACES: Final = {
    "crown": ("head", (0.0, 0.05, 0.17)),
    "face": ("head", (0.0, -0.11, 0.02)),
    "chest": ("spine01", (0.0, -0.13, 0.0)),
    "belly": ("spine04", (0.0, -0.15, 0.03)),
    "upper back": ("spine01", (0.0, 0.1, 0.04)),
    "lower back": ("spine04", (0.0, 0.1, 0.04)),
    "shoulder": ("upperarm01", (0.05, 0.0, 0.05)),
    "wrist": ("wrist", (0.0, 0.0, 0.03)),
    "hip": ("upperleg01", (0.08, 0.0, 0.0)),
    "ankle": ("foot", (0.05, 0.0, 0.0)),
    "heel": ("foot", (0.0, 0.08, -0.05)),
    "toes": ("toe1-1", (0.0, -0.06, 0.0)),
}

_SKIN_OF: Final = {"elbow": ("upperarm", "forearm"), "knee": ("upperleg", "lowerleg")}
_TORSO: Final = ("chest", "belly", "upper back", "lower back")
_AROUND_M: Final = 0.05
_PER_ESTIMATE: Final = 1.25
_PER_SHAPE: Final = 1.5
_PER_PULL: Final = 1.2
_PER_SOLE: Final = 1.0
_HALF_BODY_M: Final = 0.08  # smallest uncertainty of a torso without legs (73 mm observed)


@dataclass(frozen=True)
class PartQuality:
    """Fit of a body part of a model to an avatar; lengths at canonical size (1.8 m)."""

    part: str
    distance_mean_mm: float  # from the avatar's skin before projection
    distance_p95_mm: float  # 95th percentile
    in_place: float  # 0..1, fraction of vertices on the same part of the avatar
    area_ratio: float  # area relative to the canonical body at equal size

    @property
    def faults(self) -> tuple[str, ...]:
        """Predicates of the part ("is up to ...") for distance, fraction in place and area beyond
        the module's limits; empty for a good fit."""
        texts = []
        if self.distance_p95_mm > FARTHEST_MM:
            texts.append(f"is up to {self.distance_p95_mm:.0f} mm from the avatar's surface")
        if self.in_place < IN_PLACE:
            texts.append(f"lies on that part of the avatar only for {100 * self.in_place:.0f} %")
        if not AREA_RATIOS[0] <= self.area_ratio <= AREA_RATIOS[1]:
            texts.append(f"has {self.area_ratio:.2g} times the expected area")
        return tuple(texts)


@dataclass(frozen=True)
class FitQuality:
    """Fit of a perceptual model to an avatar."""

    model_id: str
    parts: tuple[PartQuality, ...]
    sides: float  # 0..1, fraction of limb vertices not on a limb of the other side
    feet_forward: float  # 0..1, fraction of feet pointing forward
    joints_mm: Mapping[str, float] = field(default_factory=dict)  # joint -> distance of the skin
    absent: Sequence[str] = ()  # regions without skin on the avatar
    uncertain_mm: Mapping[str, float] = field(default_factory=dict)  # place -> possible error

    @property
    def whole_faults(self) -> tuple[str, ...]:
        """Sentences about swapped sides or feet, absent regions and uncertain places, if any."""
        texts = []
        if self.sides < RIGHT_WAY:
            texts.append("left and right are swapped")
        if self.feet_forward < 1.0:
            texts.append("front and back are swapped, or a foot is turned backwards")
        if self.absent:
            texts.append(
                f"the avatar has no skin of {words_of(self.absent)}: there the haptic body has the "
                "standard shape, on the bones of the rig"
            )
        texts += uncertainty_sentence(self.uncertain_mm)
        return tuple(texts)


def joint_faults(qualities: Sequence[FitQuality]) -> list[str]:
    """List of one sentence about joints over 12 mm from the skin, each by the worst model, farthest
    first; empty without any."""
    worst: dict[str, float] = {}
    for quality in qualities:
        for joint, off_mm in quality.joints_mm.items():
            worst[joint] = max(off_mm, worst.get(joint, 0.0))
    texts = [
        f"{'left' if joint.endswith('.L') else 'right'} {joint.partition('.')[0]} {off_mm:.0f} mm"
        for joint, off_mm in sorted(worst.items(), key=lambda item: -item[1])
        if off_mm > JOINT_MM
    ]
    return [f"the skin lies beside joints of the rig: {', '.join(texts)}"] if texts else []


def judge(
    model: PerceptualModel,
    places: NearestSkin,
    target_shares: F64,
    distance_m: F64,
    feet_forward: float,
    joints_m: Mapping[str, float],
    is_there: npt.NDArray[np.bool_],
    absent: Sequence[str],
    uncertain_m: Mapping[str, float],
) -> FitQuality:
    """Measure the fit of a model's projected vertices; parts mostly absent are left out.

    ``places`` are in normalised space; ``target_shares`` (V, R) are skin weights by region of the
    avatar there, ``distance_m`` (V,) the distances of the projection. ``is_there`` (V,) is True if
    the avatar has skin of the vertex's region; other vertices are ignored. ``joints_m`` is the
    distance of the model's skin from each joint, ``absent`` has the regions without skin,
    ``uncertain_m`` is that of :func:`uncertain_places_m`.
    """
    stems = [region.partition(".")[0].rstrip("12345") for region in REGIONS]
    present = {stem for k, stem in enumerate(stems) if target_shares[:, k].any()}
    dominant = np.array(stems)[target_shares.argmax(axis=1)]
    triangles = model.triangles.astype(np.int64)
    own_areas = vertex_areas(model.vertices.astype(np.float64), triangles)
    areas = vertex_areas(places.points, triangles)
    parts = []
    for number, name in enumerate(PARTS):
        in_part = model.part == number
        if is_there[in_part].mean() < _SHOWN:
            continue
        in_part &= is_there
        regions = _REGIONS_OF[name]
        # A rig without bones of a part cannot contradict: its skin counts as in place.
        at_home = np.isin(dominant[in_part], regions) | (regions[0] not in present)
        parts.append(
            PartQuality(
                name,
                1000.0 * float(distance_m[in_part].mean()),
                1000.0 * float(np.percentile(distance_m[in_part], 95)),
                float((places.found[in_part] & at_home).mean()),
                float(areas[in_part].sum() / own_areas[in_part].sum()),
            )
        )
    is_limb = ~np.isin(model.part, [PARTS.index("head"), PARTS.index("torso")])
    is_limb &= np.isin(model.side, (LEFT, RIGHT)) & is_there
    opposite = np.where(model.side == LEFT, "R", "L")
    ends = np.array([region.rpartition(".")[2] for region in REGIONS])
    # Regions of the middle fit both sides.
    is_right_side = (ends[target_shares.argmax(axis=1)] != opposite)[is_limb]
    sides = float(is_right_side.mean()) if is_limb.any() else 1.0
    joints_mm = {joint: 1000.0 * distance for joint, distance in joints_m.items()}
    uncertain_mm = {name: 1000.0 * distance for name, distance in uncertain_m.items()}
    return FitQuality(
        model.id, tuple(parts), sides, feet_forward, joints_mm, tuple(absent), uncertain_mm
    )


def lost_part(qualities: Sequence[FitQuality]) -> PartQuality | None:
    """Part of head, trunk, arms or legs with the smallest fraction in place, if below one half;
    else None."""
    parts = [part for quality in qualities for part in quality.parts if part.part in _CARRYING]
    worst = min(parts, key=lambda part: part.in_place, default=None)
    return worst if worst is not None and worst.in_place < _LOST else None


def uncertain_places_m(
    avatar: Avatar,
    bodies: Skeletons,
    estimates_m: Mapping[str, F64],
    posed: F64,
    shaped: F64,
    pulled: F64,
) -> dict[str, float]:
    """Uncertainty by place ("belly", "heel.L"), metres at canonical size (1.8 m).

    ``estimates_m`` has the estimates of each hinge along the limb, of
    :func:`.joints.with_placed_hinges`; ``posed``, ``shaped`` and ``pulled`` (V, 3) are the
    canonical avatar after posing, after the shape fit, and on the target's skin. Absent hinges and
    places without skin are left out.
    """
    uncertainties = {
        name: _PER_ESTIMATE * float(np.abs(estimates - np.median(estimates)).max())
        for name, estimates in estimates_m.items()
        if not {f"{region}.{name[-1]}" for region in _SKIN_OF[name[:-2]]} & {*bodies.absent}
    }
    by_shape = np.linalg.norm(shaped - posed, axis=1)
    by_pull = np.linalg.norm(pulled - shaped, axis=1)
    points, heads = avatar.vertices.astype(np.float64), avatar.skeleton.heads
    parts = {
        **{f"heel.{side}": _PER_SOLE * _extra_sole_m(bodies, side) for side in "LR"},
        **dict.fromkeys(_TORSO, _half_body_m(bodies)),
    }
    for place, (bone, offset) in _PLACES.items():
        for side in ("",) if bone in heads else (".L", ".R"):
            if bone + side not in heads:
                continue
            # Offsets are for the left side.
            middle = heads[bone + side] + offset * np.array([-1.0 if side == ".R" else 1.0, 1, 1])
            # Mean error of the skin around the vertex nearest to the place.
            distances = np.linalg.norm(points - middle, axis=1)
            is_near = np.linalg.norm(points - points[distances.argmin()], axis=1) < _AROUND_M
            is_near &= bodies.avatar_shares.any(axis=1)
            if not is_near.any():
                continue
            error_m = max(
                _PER_SHAPE * by_shape[is_near].mean(), _PER_PULL * by_pull[is_near].mean()
            )
            uncertainties[place + side] = max(float(error_m), parts.get(place + side, 0.0))
    return uncertainties


def _extra_sole_m(bodies: Skeletons, side: str) -> float:
    """Depth of the skin below the ankle beyond the canonical depth, metres; 0 without foot."""
    ankle = f"ankle.{side}"
    foot = bodies.points[dominant(bodies.target_shares) == REGIONS.index(f"foot.{side}")]
    if ankle not in bodies.joints or not len(foot):
        return 0.0
    depth = float(bodies.joints[ankle][2] - foot[:, 2].min())
    return max(depth - float(bodies.canonical[ankle][2]), 0.0)


def _half_body_m(bodies: Skeletons) -> float:
    """Uncertainty of a torso if both thighs are absent, at least 80 mm: difference of the trunk
    from that expected by the arms; else 0, metres."""
    if not {"upperleg.L", "upperleg.R"} <= {*bodies.absent}:
        return 0.0
    sizes = []
    for at in (bodies.canonical, bodies.joints):
        hips, chest = ((at[f"{joint}.L"] + at[f"{joint}.R"]) / 2 for joint in ("hip", "shoulder"))
        # Upper arms and forearms of the target, whichever have both joints.
        arm_bones = [
            float(np.linalg.norm(at[f"{first}.{side}"] - at[f"{last}.{side}"]))
            for side in "LR"
            for first, last in (("shoulder", "elbow"), ("elbow", "wrist"))
            if {f"{first}.{side}", f"{last}.{side}"} <= bodies.joints.keys()
        ]
        sizes.append((float(np.linalg.norm(chest - hips)), sum(arm_bones)))
    (own_trunk, own_arms), (trunk, arms) = sizes
    expected = own_trunk * arms / own_arms if own_arms > 0.0 else trunk
    return max(_HALF_BODY_M, abs(trunk - expected))


def uncertainty_sentence(uncertain_mm: Mapping[str, float]) -> list[str]:
    """List of one sentence with places uncertain by over 40 mm (knees, elbows 25 mm), most
    uncertain first; empty without any."""
    parts = []
    for name, error_mm in sorted(uncertain_mm.items(), key=lambda item: -item[1]):
        stem, _, side = name.partition(".")
        if error_mm > (HINGE_MM if stem in ("knee", "elbow") else PLACE_MM):
            words = {"L": "left ", "R": "right ", "": ""}[side]
            parts.append(f"{words}{stem} {error_mm:.0f} mm")
    return [f"these places are uncertain: {', '.join(parts)}"] if parts else []
