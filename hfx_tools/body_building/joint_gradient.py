# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer spacing toward the joints of arm and leg, as an option of body building.

Two-point thresholds of touch fall toward the mobile end of a limb (Vierordt's law of mobility;
Mancini et al., Annals of Neurology 2014). No published rate along a limb was found: the factor at
the joints is the user's, and the linear shape an assumption.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import Skeleton
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.errors import InputError

from .thresholds import SMALLEST_MM, Targets

FACTORS: Final = (0.5, 1.0)
"""Smallest and largest allowed factor."""

MODALITIES: Final = ("pressure", "vibration")
"""Modalities with a gradient: the law is one of touch."""

_JOINTS: Final = {
    "upper_arm": ("upperarm01.L", "lowerarm01.L"),
    "forearm": ("lowerarm01.L", "wrist.L"),
    "upper_leg": ("upperleg01.L", "lowerleg01.L"),
    "lower_leg": ("lowerleg01.L", "foot.L"),
}
"""Part to the two bones whose heads are its joints, the joint nearer to the torso first."""

_DECIMALS: Final = 6
"""Decimals of the stored joint positions in metres."""

_KEY: Final = "joint_gradient"


@dataclass(frozen=True)
class JointGradient:
    """Spacing along the limbs, relative to the spacing of the part.

    Relative spacing is ``factor`` at both joints of a part and 1 in the middle between them, linear
    in the position along the straight line from joint to joint. Skin beyond a joint has the
    joint's value. Parts without an entry in ``joints_m`` have 1 everywhere.
    """

    factor: float
    joints_m: Mapping[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    """Part to its two joints on the left side of the body, rest space."""

    def relative(self, points: F64, part: npt.NDArray[Any]) -> F64:
        """Relative spacing (N,) at points (N, 3) of either side, ``part`` (N,) indices of parts."""
        result = np.ones(len(points))
        for name, (start, end) in self.joints_m.items():
            own = np.flatnonzero(part == PARTS.index(name))
            along = np.subtract(end, start)
            left = points[own] * np.where(points[own, :1] < 0.0, (-1.0, 1.0, 1.0), 1.0)
            position = np.clip((left - start) @ along / (along @ along), 0.0, 1.0)
            to_middle = 1.0 - np.abs(2.0 * position - 1.0)  # 0 at a joint, 1 in the middle
            result[own] = self.factor + (1.0 - self.factor) * to_middle
        return result

    def provenance(self) -> dict[str, Any]:
        """Entry of a model's provenance; empty without a gradient."""
        if not self.joints_m:
            return {}
        return {_KEY: {"factor": self.factor, "joints_m": dict(self.joints_m)}}


UNIFORM: Final = JointGradient(1.0)
"""Gradient with one spacing all over a part."""


def make(skeleton: Skeleton, factor: float) -> JointGradient:
    """Gradient with the joints of a skeleton in rest space; uniform for a factor of 1."""
    if factor == 1.0:
        return UNIFORM
    heads = dict(zip(skeleton.bone_names, skeleton.rest[:, :3, 3].astype(float), strict=True))
    joints = {
        part: (_rounded(heads[first]), _rounded(heads[second]))
        for part, (first, second) in _JOINTS.items()
    }
    return JointGradient(factor, joints)


def _rounded(point: F64) -> list[float]:
    return [round(value, _DECIMALS) for value in point.tolist()]


def of(provenance: Mapping[str, Any]) -> JointGradient:
    """Gradient of a model with this provenance; uniform without an entry."""
    stored = provenance.get(_KEY)
    return JointGradient(**stored) if stored else UNIFORM


def check(factor: float, targets: Targets) -> None:
    """Refuse a factor outside of :data:`FACTORS`, or one that does not suit the targets.

    Raises
    ------
    InputError
        The factor is not allowed, leads to a spacing below :data:`~.thresholds.SMALLEST_MM` at a
        joint, or has no effect because the targets have neither pressure nor vibration.
    """
    smallest, largest = FACTORS
    if not smallest <= factor <= largest:
        raise InputError(f"--joint-gradient {factor:g}: allowed are {smallest:g} to {largest:g}.")
    if factor == 1.0:
        return
    rows = {name: row for name, row in targets.items() if name in MODALITIES}
    if not rows:
        raise InputError(
            f"--joint-gradient {factor:g}: the targets have {', '.join(targets)} only; allowed are "
            f"targets with {' or '.join(MODALITIES)}."
        )
    for modality, row in rows.items():
        for part in _JOINTS:
            spacing_mm = factor * row[PARTS.index(part)]
            if spacing_mm < SMALLEST_MM:
                raise InputError(
                    f"--joint-gradient {factor:g}: '{modality}.{part}' has {spacing_mm:g} mm at "
                    f"the joints; allowed are {SMALLEST_MM:g} mm and more."
                )
