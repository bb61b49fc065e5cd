# SPDX-License-Identifier: GPL-3.0-or-later
"""Judges the fit of a perceptual model to an avatar, part by part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..body.model import PerceptualModel
from ..body.parts import LEFT, PARTS, RIGHT
from . import uncertainty
from .bone_regions import REGIONS, words_of
from .surface import Places
from .target import areas_of

FARTHEST_MM: Final = 15.0
"""A part's vertices may be this far from the skin before they land on it (95 of 100)."""

IN_PLACE: Final = 0.8
"""Share of a part's vertices that must lie on skin of that part of the avatar."""

AREA_RATIOS: Final = (0.4, 2.5)
"""Allowed range of a part's area relative to the canonical body of the same size."""

JOINT_MM: Final = 12.0
"""Allowed distance of the model's skin at a joint from where the rig has the joint: under loose
trousers a kneecap was twice as far off as this distance, and at 25 mm a touch is felt beside it."""

RIGHT_WAY: Final = 0.9
"""Share of the limbs' vertices that must not lie on a limb of the other side."""

_SHOWN: Final = 0.4
"""Share of a part that the avatar must have for a judgement: one hand of two, no stump."""

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


@dataclass(frozen=True)
class PartQuality:
    """Fit of one body part of one model on one avatar; lengths as if it were 1.8 m tall."""

    part: str
    distance_mean_mm: float  # to the avatar's skin, before landing on it
    distance_p95_mm: float
    in_place: float  # 0..1, share of its vertices that lie on that part of the avatar
    area_ratio: float  # area against the canonical body's at the same size

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of the fit, as text."""
        found = []
        if self.distance_p95_mm > FARTHEST_MM:
            found.append(f"is up to {self.distance_p95_mm:.0f} mm from the avatar's surface")
        if self.in_place < IN_PLACE:
            found.append(f"lies on that part of the avatar only for {100 * self.in_place:.0f} %")
        if not AREA_RATIOS[0] <= self.area_ratio <= AREA_RATIOS[1]:
            found.append(f"has {self.area_ratio:.2g} times the expected area")
        return tuple(found)


@dataclass(frozen=True)
class Quality:
    """Fit of a perceptual model to an avatar."""

    model_id: str
    parts: tuple[PartQuality, ...]
    sides: float  # 0..1, share of the limbs' vertices that lie on no limb of the other side
    feet_forward: float  # 0..1, share of the feet that point where the body faces
    joints_mm: Mapping[str, float] = field(default_factory=dict)  # joint -> skin's distance from it
    absent: Sequence[str] = ()  # regions that the avatar has no skin of
    uncertain_mm: Mapping[str, float] = field(
        default_factory=dict
    )  # place -> how far it may be off

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: a sentence for each part that fits badly, and for sides that are swapped."""
        parts = [
            f"{part.part.replace('_', ' ')} {fault}" for part in self.parts for fault in part.faults
        ]
        return (*parts, *joint_faults([self]), *self.whole_faults)

    @property
    def whole_faults(self) -> tuple[str, ...]:
        """Faults that are no single part's."""
        found = []
        if self.sides < RIGHT_WAY:
            found.append("left and right are swapped")
        if self.feet_forward < 1.0:
            found.append("front and back are swapped, or a foot is turned backwards")
        if self.absent:
            found.append(
                f"the avatar has no skin of {words_of(self.absent)}: there the haptic body has the "
                "standard shape, on the bones of the rig"
            )
        found += uncertainty.sentence(self.uncertain_mm)
        return tuple(found)


def joint_faults(qualities: Sequence[Quality]) -> list[str]:
    """Joints whose skin lies beside them, as one sentence, each by the model that fits it worst."""
    worst: dict[str, float] = {}
    for quality in qualities:
        for joint, off_mm in quality.joints_mm.items():
            worst[joint] = max(off_mm, worst.get(joint, 0.0))
    found = [
        f"{'left' if joint.endswith('.L') else 'right'} {joint.partition('.')[0]} {off_mm:.0f} mm"
        for joint, off_mm in sorted(worst.items(), key=lambda item: -item[1])
        if off_mm > JOINT_MM
    ]
    return [f"the skin lies beside joints of the rig: {', '.join(found)}"] if found else []


def judge(
    model: PerceptualModel,
    places: Places,
    target_shares: F64,
    distance_m: F64,
    feet_forward: float,
    joints_m: Mapping[str, float],
    is_there: npt.NDArray[np.bool_],
    absent: Sequence[str],
    uncertain_m: Mapping[str, float],
) -> Quality:
    """Judge the fit of a model's placed vertices.

    Parameters
    ----------
    places : Places
        Normalised space: the canonical body's size, facing and upright.
    target_shares : (V, R) float64
        The avatar's own regions at the places.
    distance_m : (V,) float64
        How far each vertex was from the skin.
    feet_forward : float
        Share of the feet that point forwards.
    joints_m : mapping of joint to float
        Distance of the model's skin around it from where the rig has it.
    is_there : (V,) bool
        The avatar has skin of the vertex's region; others are not judged.
    absent : sequence of str
        Regions that the avatar has no skin of.
    uncertain_m : mapping of place to float
        See :func:`.uncertainty.uncertain_m`.
    """
    stems = [region.partition(".")[0].rstrip("12345") for region in REGIONS]
    known = {stem for k, stem in enumerate(stems) if target_shares[:, k].any()}
    dominant = np.array(stems)[target_shares.argmax(axis=1)]
    old, new = (_areas(p.astype(np.float64), model) for p in (model.vertices, places.points))
    parts = []
    for number, name in enumerate(PARTS):
        mine = model.part == number
        if is_there[mine].mean() < _SHOWN:
            continue
        mine &= is_there
        regions = _REGIONS_OF[name]
        at_home = np.isin(dominant[mine], regions) | (regions[0] not in known)
        parts.append(
            PartQuality(
                name,
                1000.0 * float(distance_m[mine].mean()),
                1000.0 * float(np.percentile(distance_m[mine], 95)),
                float((places.found[mine] & at_home).mean()),
                float(new[mine].sum() / old[mine].sum()),
            )
        )
    limb = ~np.isin(model.part, [PARTS.index("head"), PARTS.index("torso")])
    limb &= np.isin(model.side, (LEFT, RIGHT)) & is_there
    other = np.where(model.side == LEFT, "R", "L")
    ends = np.array([region.rpartition(".")[2] for region in REGIONS])
    is_right_side = (ends[target_shares.argmax(axis=1)] != other)[limb]
    sides = float(is_right_side.mean()) if limb.any() else 1.0
    joints_mm = {joint: 1000.0 * off for joint, off in joints_m.items()}
    uncertain_mm = {place: 1000.0 * off for place, off in uncertain_m.items()}
    return Quality(
        model.id, tuple(parts), sides, feet_forward, joints_mm, tuple(absent), uncertain_mm
    )


def _areas(points: F64, model: PerceptualModel) -> F64:
    """Area of each vertex: a third of its triangles, (V,)."""
    triangles = model.triangles.astype(np.int64)
    thirds = np.repeat(areas_of(points, triangles) / 3.0, 3)
    return np.bincount(triangles.ravel(), thirds, minlength=len(points)).astype(np.float64)
