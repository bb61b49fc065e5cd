# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints of a rig hold the skin along limbs and torso.

Distances to a surface tell how thick a limb is, not where along it a place lies: loose cloth lets
a model slide along the limb. A rig's joints tell that. :class:`Limbs` measures how far the skin
around a joint has slid along the limb from where posing put it, and takes the slide back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..body.model import Avatar
from .joints import Skeletons, dominant
from .regions import REGIONS
from .surface import TargetSurface

_CHAINS: Final = (
    (("shoulder", "upperarm"), ("elbow", "forearm"), ("wrist", "hand")),
    (("hip", "upperleg"), ("knee", "lowerleg"), ("ankle", "foot")),
)
"""Joints of a limb from the torso outwards, each with the region that begins there."""

SLACK_M: Final = {
    "shoulder": 0.012,
    "elbow": 0.005,
    "wrist": 0.004,
    "hip": 0.012,
    "waist": 0.010,
    "chest": 0.010,
    "knee": 0.008,
    "ankle": 0.005,
}
"""Distance along limb or torso by which rigs place a joint differently on the same body (of a body
1.8 m tall): the spread of MakeHuman's rigs and SOMA's on meshes with known answers."""

_WAIST: Final = 0.3
"""Height of the navel between the hips (0) and the shoulders (1)."""

_RING_M: Final = 0.02
"""Half the length of the ring of skin around a joint."""

HINGES: Final = ("elbow", "wrist", "knee", "ankle")
"""Joints that any rig has at the same place of the body."""

_FEWEST_IN_RING: Final = 6
_BENT: Final = 0.6
"""Cosine between the bones of a joint below which it is bent: 53 degrees; ours hangs with 43."""

_SECTORS: Final = 8
"""Directions in which outlines around a joint are compared."""

_RING_RADIUS_M: Final = 0.14
"""Farthest that the skin of a ring is from its joint: not the other leg."""


@dataclass(frozen=True, eq=False)
class Ring:
    """Skin of the canonical avatar around a joint."""

    vertices: npt.NDArray[np.int64]  # (n,)
    joint: F64  # (3,) where the rig has the joint
    axis: F64  # (3,) unit vector along the target's limb, away from the torso
    regions: tuple[int, ...]  # whose skin meets there
    carried: F64  # (V,) 0..1, share of a slide at this joint that each vertex takes part in
    is_bent: bool = False  # the limb turns here, so that across its axis lies the next bone's skin

    def slide(self, moves: F64) -> F64:
        """Mean displacement along the limb, of displacements (..., V, 3)."""
        mean: F64 = moves[..., self.vertices, :].mean(axis=-2) @ self.axis
        return mean


class Limbs:
    """Axes of a target's limbs, and the rings of skin around its joints."""

    def __init__(self, avatar: Avatar, bodies: Skeletons) -> None:
        self._points = avatar.vertices.astype(np.float64)
        self._shares = bodies.avatar_shares
        self._region = dominant(bodies.avatar_shares)
        self._absent = {REGIONS.index(region) for region in bodies.absent}
        self.axes = np.zeros_like(self._points)
        """(V, 3) direction of the limb at each vertex; shorter where a limb ends, 0 outside."""
        self.rings: dict[str, Ring] = {}
        for chain in _CHAINS:
            for side in "LR":
                self._add(chain, side, bodies.canonical, bodies.joints)
        self._add_torso(bodies.canonical, bodies.joints)

    def _add(
        self,
        chain: tuple[tuple[str, str], ...],
        side: str,
        canonical: Mapping[str, F64],
        joints: Mapping[str, F64],
    ) -> None:
        names = [f"{joint}.{side}" for joint, _ in chain]
        shares = [self._shares[:, REGIONS.index(f"{region}.{side}")] for _, region in chain]
        along, axes = [], []
        for start, end, share in zip(names, names[1:], shares, strict=False):
            if start not in joints or end not in joints:
                return
            way = canonical[end] - canonical[start]
            along.append(np.clip((self._points - canonical[start]) @ way / (way @ way), 0.0, 1.0))
            axes.append(_unit(joints[end] - joints[start]))
            self.axes += share[:, None] * axes[-1]
        beyond = shares[2].copy()
        if chain[2][0] == "wrist":  # the hand hangs on the wrist, the sole stands on the ground
            fingers = [REGIONS.index(f"finger{number}.{side}") for number in range(1, 6)]
            beyond += self._shares[:, fingers].sum(axis=1)
        else:
            beyond *= np.clip(self._points[:, 2] / canonical[names[2]][2], 0.0, 1.0)
        carried = (
            shares[0] * (1.0 - along[0]),
            shares[0] * along[0] + shares[1] * (1.0 - along[1]),
            shares[1] * along[1] + beyond,
        )
        for number, name in enumerate(names):
            way = canonical[names[max(number, 1)]] - canonical[names[max(number, 1) - 1]]
            regions = [f"{region}.{side}" for _, region in chain[max(number - 1, 0) : number + 1]]
            ring = self._ring(canonical[name], _unit(way), regions)
            if len(ring):
                self.rings[name] = Ring(
                    ring,
                    joints[name],
                    axes[max(number, 1) - 1],
                    tuple(REGIONS.index(region) for region in regions),
                    carried[number],
                    number == 1 and float(axes[0] @ axes[1]) < _BENT,
                )

    def _add_torso(self, canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> None:
        (hips, up), (low, axis) = (
            (low, (at["shoulder.L"] + at["shoulder.R"]) / 2 - low)
            for at in (canonical, joints)
            for low in [(at["hip.L"] + at["hip.R"]) / 2]
        )
        torso = REGIONS.index("torso")
        height = (self._points - hips) @ up / (up @ up)
        for name, level, heights in (
            ("waist", _WAIST, (0.0, _WAIST, 1.0)),
            ("chest", 1.0, (_WAIST, 1.0, 2.0)),
        ):
            near = np.abs(height - level) * np.linalg.norm(up) < _RING_M
            ring = np.flatnonzero(near & (self._region == torso))
            hat = np.interp(height, heights, (0.0, 1.0, 0.0 if name == "waist" else 1.0))
            if len(ring):
                carried = self._shares[:, torso] * hat
                middle = low + level * axis
                self.rings[name] = Ring(ring, middle, _unit(axis), (torso,), carried)

    def _ring(self, joint: F64, axis: F64, regions: list[str]) -> npt.NDArray[np.int64]:
        offset = self._points - joint
        along = offset @ axis
        off = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        near = (np.abs(along) < _RING_M) & (off < _RING_RADIUS_M)
        near &= np.isin(self._region, [REGIONS.index(region) for region in regions])
        return np.flatnonzero(near)

    def with_joints_joined(self, points: F64, posed: F64) -> F64:
        """Points (V, 3) moved along the limbs until no joint has slid farther than rigs differ.

        Parameters
        ----------
        posed : (V, 3) float64
            Where posing put them: the canonical joints lie at the rig's.
        """
        moved = points.copy()
        for name, ring in self.rings.items():
            slack = SLACK_M[name.partition(".")[0]]
            slide = float(ring.slide(points - posed))
            back = slack * np.tanh(slide / slack) - slide
            moved += back * ring.carried[:, None] * ring.axis
        return moved

    def offsets_m(
        self, nearest: npt.NDArray[np.int64], posed: F64, placed: F64, surface: TargetSurface
    ) -> dict[str, float]:
        """Distance of a model's skin at each hinge from where the rig has the joint.

        Along the limb that is the slide from the posed place, across it the difference from the
        outermost surface; of both, what nine of ten places of the ring keep.

        Parameters
        ----------
        nearest : (N,) int64
            Canonical vertex beside each vertex of the model.
        posed, placed : (N, 3) float64
            Where posing put the model's vertices, and where they are at last.
        """
        found = {}
        for name, ring in self.rings.items():
            mine = np.flatnonzero(np.isin(nearest, ring.vertices))
            is_hinge = name.partition(".")[0] in HINGES and self._absent.isdisjoint(ring.regions)
            if not is_hinge or len(mine) < _FEWEST_IN_RING:
                continue
            slide = np.percentile(np.abs((placed[mine] - posed[mine]) @ ring.axis), 90)
            # Around an ankle the foot and the heel are no outline of the limb.
            has_outline = not (name.startswith("ankle") or ring.is_bent)
            girth = _girth_difference(ring, placed[mine], surface) if has_outline else 0.0
            found[name] = float(np.hypot(slide, girth))
        return found


def _girth_difference(ring: Ring, placed: F64, surface: TargetSurface) -> float:
    """Difference of a model's outline around a joint from the surface's, in most directions."""
    around = surface.around(ring.joint, ring.axis, _RING_M, _RING_RADIUS_M, ring.regions)
    side = _unit(np.cross(ring.axis, np.eye(3)[np.argmin(np.abs(ring.axis))]))
    outlines = []
    for points in (around, placed):
        offset = points - ring.joint
        x, y = offset @ side, offset @ np.cross(ring.axis, side)
        sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
        outline = np.full(_SECTORS, np.nan)
        np.fmax.at(outline, sector, np.hypot(x, y))
        outlines.append(outline)
    gaps = np.abs(outlines[0] - outlines[1])
    gaps = gaps[np.isfinite(gaps)]
    return float(np.percentile(gaps, 80)) if len(gaps) else 0.0


def _unit(way: F64) -> F64:
    found: F64 = way / max(float(np.linalg.norm(way)), 1e-12)
    return found
