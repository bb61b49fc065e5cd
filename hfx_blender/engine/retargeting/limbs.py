# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of the skin along limbs and torso, constrained by the joints of the rig.

Distances to a surface determine the girth of a limb, not the position along the limb: loose cloth
lets a model slide. :class:`Limbs` measures the slide of the skin around each joint relative to the
posed position, and undoes the slide.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..body.model import Avatar
from .bone_regions import REGIONS
from .joints import Skeletons, dominant
from .surface import TargetSurface
from .turns import unit

# Joints of a limb from the torso outwards, each with the region after the joint
_CHAINS: Final = (
    (("shoulder", "upperarm"), ("elbow", "forearm"), ("wrist", "hand")),
    (("hip", "upperleg"), ("knee", "lowerleg"), ("ankle", "foot")),
)

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
"""Spread of joint positions among rigs along limb or torso, metres at canonical size (1.8 m).

Measured with the rigs of MakeHuman and SOMA on meshes with known joints."""

_WAIST: Final = 0.3  # height of the navel between hips (0) and shoulders (1)
_RING_M: Final = 0.02  # half the length of a ring of skin, metres

HINGES: Final = ("elbow", "wrist", "knee", "ankle")
"""Joints at the same anatomical place on all rigs."""

_FEWEST_IN_RING: Final = 6
# Largest cosine between the bones of a bent joint: 53 degrees; the canonical arm has 43
_BENT: Final = 0.6
_SECTORS: Final = 8  # number of directions of outlines around a joint
_RING_RADIUS_M: Final = 0.14  # largest distance of ring skin from the joint; excludes the other leg


@dataclass(frozen=True, eq=False)
class Ring:
    """Skin of the canonical avatar around a joint."""

    vertices: npt.NDArray[np.int64]  # (n,)
    joint: F64  # (3,) joint of the rig, normalised space
    axis: F64  # (3,) unit vector along the target's limb, away from the torso
    regions: tuple[int, ...]  # adjacent regions
    carried: F64  # (V,) 0..1, fraction of the joint's slide applied to each vertex
    is_bent: bool = False  # a bent limb: skin of the next bone lies across the axis

    def slide(self, moves: F64) -> F64:
        """Mean displacement along the limb (...,), of displacements (..., V, 3)."""
        return np.asarray(moves[..., self.vertices, :].mean(axis=-2) @ self.axis)


class Limbs:
    """Axes of a target's limbs, and rings of skin around the joints."""

    def __init__(self, avatar: Avatar, bodies: Skeletons) -> None:
        self._points = avatar.vertices.astype(np.float64)
        self._shares = bodies.avatar_shares
        self._region = dominant(bodies.avatar_shares)
        self._absent = {REGIONS.index(region) for region in bodies.absent}
        self.axes = np.zeros_like(self._points)
        """(V, 3) direction of the limb, weighted by skin weight; 0 outside of limbs."""
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
        """Add axes and rings of the limb ``chain`` (joint and region after it) on side "L" or "R";
        nothing if the rig lacks a joint, no ring without skin at a joint."""
        names = [f"{joint}.{side}" for joint, _ in chain]
        shares = [self._shares[:, REGIONS.index(f"{region}.{side}")] for _, region in chain]
        along, axes = [], []
        for start, end, share in zip(names, names[1:], shares, strict=False):
            if start not in joints or end not in joints:
                return
            way = canonical[end] - canonical[start]
            # einsum instead of matrix products: threads of BLAS cost more here than they save.
            share_along = np.einsum("vi,i->v", self._points - canonical[start], way / (way @ way))
            along.append(np.clip(share_along, 0.0, 1.0))
            axes.append(unit(joints[end] - joints[start]))
            self.axes += share[:, None] * axes[-1]
        beyond = shares[2].copy()
        # The whole hand follows the wrist; the foot less and less down to the sole on the ground.
        if chain[2][0] == "wrist":
            fingers = [REGIONS.index(f"finger{number}.{side}") for number in range(1, 6)]
            beyond += self._shares[:, fingers].sum(axis=1)
        else:
            beyond *= np.clip(self._points[:, 2] / canonical[names[2]][2], 0.0, 1.0)
        # Weights of the three joints' slides along the limb: hat functions between the joints.
        carried = (
            shares[0] * (1.0 - along[0]),
            shares[0] * along[0] + shares[1] * (1.0 - along[1]),
            shares[1] * along[1] + beyond,
        )
        for number, name in enumerate(names):
            way = canonical[names[max(number, 1)]] - canonical[names[max(number, 1) - 1]]
            regions = [f"{region}.{side}" for _, region in chain[max(number - 1, 0) : number + 1]]
            # Skin of these regions within 2 cm along the limb and 14 cm across of the joint.
            offset, axis = self._points - canonical[name], unit(way)
            off_m = np.einsum("vi,i->v", offset, axis)
            radius = np.linalg.norm(offset - off_m[:, None] * axis, axis=1)
            is_near = (np.abs(off_m) < _RING_M) & (radius < _RING_RADIUS_M)
            is_near &= np.isin(self._region, [REGIONS.index(region) for region in regions])
            ring = np.flatnonzero(is_near)
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
        """Add rings at waist and chest, without bent mark; none where the torso has no vertex."""
        (hips, up), (low, axis) = (
            (low, (at["shoulder.L"] + at["shoulder.R"]) / 2 - low)
            for at in (canonical, joints)
            for low in [(at["hip.L"] + at["hip.R"]) / 2]
        )
        torso = REGIONS.index("torso")
        height = np.einsum("vi,i->v", self._points - hips, up / (up @ up))
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
                self.rings[name] = Ring(ring, middle, unit(axis), (torso,), carried)

    def with_joints_joined(self, points: F64, posed: F64) -> F64:
        """Copy of points (V, 3), moved along limbs so that slides stay within the spread of rigs.
        ``posed`` (V, 3) are the points after posing alone: canonical joints at the rig's joints."""
        moved = points.copy()
        for name, ring in self.rings.items():
            slack = SLACK_M[name.partition(".")[0]]
            slide = float(ring.slide(points - posed))
            # tanh: small slides remain, large slides saturate at the slack.
            correction = slack * np.tanh(slide / slack) - slide
            moved += correction * ring.carried[:, None] * ring.axis
        return moved

    def offsets_m(
        self, nearest: npt.NDArray[np.int64], posed: F64, placed: F64, surface: TargetSurface
    ) -> dict[str, float]:
        """Distance (metres) of a model's skin at each hinge from the joint of the rig.

        Combines the slide along the limb (90th percentile) from ``posed`` to ``placed`` (N, 3), the
        model's vertices after posing and after the fit, and the difference of the outlines across.
        ``nearest`` (N,) is the nearest canonical vertex of each model vertex. Absent regions and
        rings of fewer than 6 vertices are left out.
        """
        offsets = {}
        for name, ring in self.rings.items():
            ring_vertices = np.flatnonzero(np.isin(nearest, ring.vertices))
            is_hinge = name.partition(".")[0] in HINGES and self._absent.isdisjoint(ring.regions)
            if not is_hinge or len(ring_vertices) < _FEWEST_IN_RING:
                continue
            slide = np.percentile(
                np.abs((placed[ring_vertices] - posed[ring_vertices]) @ ring.axis), 90
            )
            # Foot and heel distort the outline at an ankle.
            has_outline = not (name.startswith("ankle") or ring.is_bent)
            girth = _girth_difference(ring, placed[ring_vertices], surface) if has_outline else 0.0
            offsets[name] = float(np.hypot(slide, girth))
        return offsets


def _girth_difference(ring: Ring, placed: F64, surface: TargetSurface) -> float:
    """Difference of the largest radii of target skin and model skin ``placed`` (n, 3) around a
    joint, 80th percentile of eight directions, metres; 0 if no direction has both."""
    around = surface.around(ring.joint, ring.axis, _RING_M, _RING_RADIUS_M, ring.regions)
    side = unit(np.cross(ring.axis, np.eye(3)[np.argmin(np.abs(ring.axis))]))
    outlines = []
    for points in (around, placed):
        offset = points - ring.joint
        x, y = offset @ side, offset @ np.cross(ring.axis, side)
        sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
        outline = np.full(_SECTORS, np.nan)
        np.fmax.at(outline, sector, np.hypot(x, y))
        outlines.append(outline)
    # Sectors without skin of either outline are NaN; the percentile ignores single outliers.
    gaps = np.abs(outlines[0] - outlines[1])
    gaps = gaps[np.isfinite(gaps)]
    return float(np.percentile(gaps, 80)) if len(gaps) else 0.0
