# SPDX-License-Identifier: GPL-3.0-or-later
"""The canonical avatar, posed and proportioned like a target's rest pose.

Each segment of the canonical skeleton gets one affine transform: turned from its parent's
turn by the least that points it at the target's next joint (turns that do not build on the parent's
twist the limbs), stretched along to the target's length and across to the target's girth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from ..body.model import Avatar
from .bone_regions import REGIONS, region_of
from .joints import Skeletons, dominant
from .turns import about, affine, apply, axes_of, extent_of, least_turn, tip_of, twist_about

_GIRTHS: Final = (0.4, 2.5)
"""Smallest and largest change of a girth that is believed."""

_SKULL_M: Final = 0.13
"""Height of the part of the canonical head that is skull, from its top to the ears."""

_UP: Final = np.array([0.0, 0.0, 1.0])


def posed(avatar: Avatar, matrices: F64) -> F64:
    """Vertices moved by a matrix each, (V, 3)."""
    found: F64 = (
        np.einsum("vij,vj->vi", matrices[..., :3], avatar.vertices.astype(np.float64))
        + matrices[..., 3]
    )
    return found


def matrices(avatar: Avatar, bodies: Skeletons, largest_head: float = 2.0) -> F64:
    """Matrices (V, 3, 4) from the canonical avatar's vertices into the target's rest pose.

    Parameters
    ----------
    largest_head : float
        Largest scale of a head that is believed; what looks larger may be a hat or hair.

    Raises
    ------
    InputError
        Joints that need a direction between them lie at one place.
    """
    segments = _Segments(avatar, bodies, largest_head)
    bones = np.stack([segments.matrix_of_bone(name) for name in avatar.skeleton.bone_names])
    weights = avatar.weights
    owners = np.repeat(np.arange(len(avatar.vertices)), np.diff(weights.offsets))
    blended = np.zeros((len(avatar.vertices), 12))
    for entry in range(12):
        blended[:, entry] = np.bincount(
            owners, weights.values * bones[weights.bones].reshape(-1, 16)[:, entry]
        )
    if not np.isfinite(blended).all():
        raise InputError("Two joints of the armature lie at one place, so a limb has no direction.")
    return blended.reshape(-1, 3, 4)


class _Segments:
    """Transforms of the segments, each computed on first use."""

    def __init__(self, avatar: Avatar, bodies: Skeletons, largest_head: float) -> None:
        self._largest_head = largest_head
        self._c, self._t = bodies.canonical, bodies.joints
        self._vertices = avatar.vertices.astype(np.float64)
        self._points = bodies.points
        self._avatar_region = dominant(bodies.avatar_shares)
        self._target_region = dominant(bodies.target_shares)
        self._made: dict[str, F64] = {}
        self._turns: dict[str, F64] = {}
        self._makers: dict[str, Callable[[str], tuple[F64, F64]]] = {
            "torso": self._torso,
            "neck": self._neck,
            "head": self._head,
            "girdle": self._girdle,
            "hand": self._hand,
            "foot": self._foot,
        }

    def matrix_of_bone(self, bone: str) -> F64:
        region = region_of(bone)
        stem, _, side = region.partition(".")
        if bone.startswith("neck"):
            return self._matrix("neck")
        if bone.startswith(("clavicle", "shoulder")):
            return self._matrix(f"girdle.{bone[-1]}")
        if stem.startswith("finger"):
            return self._finger(bone)
        if bone.startswith("lowerarm02"):
            return self._twisted(side)
        return self._matrix(region)

    def _matrix(self, name: str) -> F64:
        if name not in self._made:
            stem, _, side = name.partition(".")
            turn, matrix = self._makers.get(stem, self._limb)(name if stem in _ENDS else side)
            self._turns[name], self._made[name] = turn, matrix
        return self._made[name]

    def _turn(self, name: str) -> F64:
        self._matrix(name)
        return self._turns[name]

    def _skins(self, region: str) -> tuple[F64, F64]:
        """Vertices of both bodies in one region; none of either where the target has a stump."""
        number = REGIONS.index(region)
        mine = self._vertices[self._avatar_region == number]
        theirs = self._points[(self._target_region == number) & (len(mine) > 0)]
        return mine, theirs

    def _torso(self, _side: str) -> tuple[F64, F64]:
        def frame(at: Mapping[str, F64]) -> tuple[F64, F64, float]:
            hips = (at["hip.L"] + at["hip.R"]) / 2
            up = (at["shoulder.L"] + at["shoulder.R"]) / 2 - hips
            left = at["hip.L"] - at["hip.R"] + at["shoulder.L"] - at["shoulder.R"]
            z = up / np.linalg.norm(up)
            left = left - (left @ z) * z
            x = left / np.linalg.norm(left)
            return np.column_stack((x, np.cross(z, x), z)), hips, float(np.linalg.norm(up))

        (old, old_hips, old_up), (new, new_hips, new_up) = frame(self._c), frame(self._t)
        mine, theirs = self._skins("torso")
        old_size = np.std((mine - old_hips) @ old, axis=0)
        new_size = np.std((theirs - new_hips) @ new, axis=0) if len(theirs) > 10 else old_size
        scale = np.clip(new_size / old_size, 0.7, 1.6)
        scale[2] = new_up / old_up
        return affine(new @ old.T, new @ np.diag(scale) @ old.T, old_hips, new_hips)

    def _neck(self, _side: str) -> tuple[F64, F64]:
        # Rigs disagree on where a neck begins and ends; the skin on either side of it does not.
        start, end = self._c["neck"], self._c["head"]
        new_start = apply(self._matrix("torso"), start)
        new_end = apply(self._matrix("head"), end)
        girth = float(np.cbrt(np.linalg.det(self._matrix("head")[:3, :3])))
        return self._stretched(self._turn("torso"), start, end, new_start, new_end, girth)

    def _head(self, _side: str) -> tuple[F64, F64]:
        """Upright transform of the head, its size and place from the skull above the ears."""
        mine, theirs = self._skins("head")
        if len(theirs) <= 10:
            known = "head" in self._t
            above = self._turn("torso"), self._matrix("torso")
            return self._rigid("torso", "head") if known else above
        top, new_top = mine[:, 2].max(), theirs[:, 2].max()
        skull = mine[mine[:, 2] > top - _SKULL_M]
        scale = np.ones(2)
        for _ in range(8):  # the larger the head, the more of it is skull
            new_skull = theirs[theirs[:, 2] > new_top - _SKULL_M * scale.mean()]
            widths = np.ptp(new_skull[:, :2], axis=0) / np.ptp(skull[:, :2], axis=0)
            scale = np.clip(widths, 0.6, self._largest_head)
        low, high = extent_of(skull)
        new_low, new_high = extent_of(new_skull)
        old, new = (low + high) / 2, (new_low + new_high) / 2
        old[2], new[2] = top, new_top
        return affine(np.eye(3), np.diag([*scale, scale.mean()]), old, new)

    def _girdle(self, side: str) -> tuple[F64, F64]:
        start = self._c[f"clavicle.{side}"]
        end = self._t[f"shoulder.{side}"]
        return self._stretched(
            self._turn("torso"),
            start,
            self._c[f"shoulder.{side}"],
            apply(self._matrix("torso"), start),
            end,
            1.0,
        )

    def _limb(self, name: str) -> tuple[F64, F64]:
        stem, _, side = name.partition(".")
        parent, start, end = _ENDS[stem]
        above = parent if parent == "torso" else f"{parent}.{side}"
        start, end = f"{start}.{side}", f"{end}.{side}"
        if start not in self._t:
            return self._turn(above), self._matrix(above)
        if end not in self._t:
            self._matrix(above)
            # The hand's skin tells where a forearm ends; a foot's tip is beside the shank's line.
            is_arm = stem == "forearm"
            return self._by_extent(above, start, name) if is_arm else self._rigid(above, start)
        return self._between(above, start, end, self._girth(name, start, end))

    def _hand(self, side: str) -> tuple[F64, F64]:
        forearm, wrist = f"forearm.{side}", f"wrist.{side}"
        if wrist not in self._t:
            return self._turn(forearm), self._matrix(forearm)
        knuckles = [f"finger{k}-1.{side}" for k in range(2, 6)]
        known = [joint for joint in knuckles if joint in self._t]
        if len(known) < 2:
            return self._mitten(forearm, wrist, f"hand.{side}")
        old_mid = np.mean([self._c[joint] for joint in known], axis=0)
        new_mid = np.mean([self._t[joint] for joint in known], axis=0)
        old = axes_of(old_mid - self._c[wrist], self._c[known[0]] - self._c[known[-1]])
        new = axes_of(new_mid - self._t[wrist], self._t[known[0]] - self._t[known[-1]])
        length = np.linalg.norm(new_mid - self._t[wrist]) / np.linalg.norm(old_mid - self._c[wrist])
        across = np.linalg.norm(self._t[known[0]] - self._t[known[-1]]) / np.linalg.norm(
            self._c[known[0]] - self._c[known[-1]]
        )
        scale = np.clip([length, across, np.sqrt(length * across)], *_GIRTHS)
        return affine(new @ old.T, new @ np.diag(scale) @ old.T, self._c[wrist], self._t[wrist])

    def _finger(self, bone: str) -> F64:
        """Matrix of a phalanx; one that the rig does not have moves with the one before it."""
        if bone not in self._made:
            stem, _, side = bone.partition(".")
            finger, phalanx = stem[:-2], int(stem[-1])
            chain = [
                f"{finger}-{k}.{side}" for k in range(1, 4) if f"{finger}-{k}.{side}" in self._t
            ]
            before = [joint for joint in chain if int(joint[-3]) < phalanx]
            parent = before[-1] if before else f"hand.{side}"
            if before:
                self._finger(parent)
            else:
                self._matrix(parent)
            if bone not in self._t:
                made = self._turns[parent], self._made[parent]
            elif bone == chain[-1]:
                made = self._by_extent(parent, bone, f"{finger}.{side}")
            else:
                after = chain[chain.index(bone) + 1]
                made = self._between(parent, bone, after, self._girth(f"{finger}.{side}"))
            self._turns[bone], self._made[bone] = made
        return self._made[bone]

    def _foot(self, side: str) -> tuple[F64, F64]:
        """Transform of a flat foot: turned about the vertical only, and sized by its sole."""
        ankle, ball, region = f"ankle.{side}", f"ball.{side}", f"foot.{side}"
        leg = f"lowerleg.{side}"
        if ankle not in self._t:
            return self._turn(leg), self._matrix(leg)
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return self._rigid(leg, ankle)
        if ball in self._t:
            old_way, new_way = self._c[ball] - self._c[ankle], self._t[ball] - self._t[ankle]
        else:
            old_way, new_way = (
                mine.mean(axis=0) - self._c[ankle],
                theirs.mean(axis=0) - self._t[ankle],
            )
        old, new = axes_of(_UP, old_way), axes_of(_UP, new_way)  # up, forward, sideways
        low, high = extent_of((mine - self._c[ankle]) @ old)
        low_t, high_t = extent_of((theirs - self._t[ankle]) @ new)
        scale = np.ones(3)
        scale[0] = low_t[0] / low[0]  # from the ankle to the sole
        scale[1:] = (high_t - low_t)[1:] / (high - low)[1:]
        scale = np.clip(scale, *_GIRTHS)
        linear = new @ np.diag(scale) @ old.T
        shift = np.zeros(3)
        shift[1:] = (high_t - scale * high)[1:]
        return affine(new @ old.T, linear, self._c[ankle], self._t[ankle] + new @ shift)

    def _twisted(self, side: str) -> F64:
        """The lower forearm: half of the hand's twist, as the bones of a forearm cross."""
        forearm = self._matrix(f"forearm.{side}")
        if f"wrist.{side}" not in self._t or f"elbow.{side}" not in self._t:
            return forearm
        relative = self._turn(f"hand.{side}") @ self._turn(f"forearm.{side}").T
        axis = self._t[f"wrist.{side}"] - self._t[f"elbow.{side}"]
        axis /= np.linalg.norm(axis)
        twist = twist_about(relative, axis)
        turn = about(axis, twist / 2)
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        matrix[:3, 3] = self._t[f"wrist.{side}"] - turn @ self._t[f"wrist.{side}"]
        return matrix @ forearm

    # Shapes of transforms

    def _rigid(self, parent: str, joint: str) -> tuple[F64, F64]:
        turn = self._turns.get(parent)
        turn = self._turn(parent) if turn is None else turn
        return affine(turn, turn, self._c[joint], self._t[joint])

    def _between(self, parent: str, start: str, end: str, girth: float) -> tuple[F64, F64]:
        turn = self._turns[parent] if parent in self._turns else self._turn(parent)
        return self._stretched(
            turn, self._c[start], self._c[end], self._t[start], self._t[end], girth
        )

    def _stretched(
        self, turn: F64, start: F64, end: F64, new_start: F64, new_end: F64, girth: float
    ) -> tuple[F64, F64]:
        way, new_way = end - start, new_end - new_start
        length, new_length = np.linalg.norm(way), np.linalg.norm(new_way)
        if new_length < 1e-6:
            return affine(turn, turn, start, new_start)
        axis = way / length
        turned = least_turn(turn @ axis, new_way / new_length) @ turn
        along = np.outer(axis, axis)
        linear = turned @ (girth * (np.eye(3) - along) + new_length / length * along)
        return affine(turned, linear, start, new_start)

    def _by_extent(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """The last bone of a limb: as long as the skin beyond its joint reaches."""
        turn = self._turns[parent]
        mine, theirs = self._skins(region)
        start, new_start = self._c[joint], self._t[joint]
        if len(theirs) <= 3:
            return self._rigid(parent, joint)
        # The tip: the mean of the skin farthest from the joint, seen from the parent.
        tip = tip_of(mine, start)
        new_tip = tip_of(theirs, new_start)
        return self._stretched(turn, start, tip, new_start, new_tip, self._girth(region))

    def _mitten(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """Transform of a hand without knuckles, its rotation from its broad side."""
        turn, _ = self._by_extent(parent, joint, region)
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return self._rigid(parent, joint)
        frames: list[F64] = []
        sizes: list[list[float]] = []
        for points, start, guess in (
            (mine, self._c[joint], None),
            (theirs, self._t[joint], turn),
        ):
            main = tip_of(points, start) - start
            axis = main / np.linalg.norm(main)
            flat = points - start - np.outer((points - start) @ axis, axis)
            broad = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][0]
            if guess is not None and broad @ (guess @ frames[0][:, 1]) < 0.0:
                broad = -broad
            frame = axes_of(main, broad)
            frames.append(frame)
            sizes.append([float(np.linalg.norm(main)), *np.std(points @ frame[:, 1:], axis=0)])
        old, new = frames
        scale = np.clip(np.divide(sizes[1], sizes[0]), *_GIRTHS)
        linear = new @ np.diag(scale) @ old.T
        return affine(new @ old.T, linear, self._c[joint], self._t[joint])

    def _girth(self, region: str, start: str = "", end: str = "") -> float:
        """Ratio of how thick a region is about the line between two joints."""
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return 1.0
        if not start:
            spread, new_spread = (
                np.sqrt(
                    np.prod(
                        np.linalg.svd(p - p.mean(axis=0), compute_uv=False)[1:] / np.sqrt(len(p))
                    )
                )
                for p in (mine, theirs)
            )
            return float(np.clip(new_spread / spread, *_GIRTHS))
        radii = []
        for points, at in ((mine, self._c), (theirs, self._t)):
            way = at[end] - at[start]
            share = (points - at[start]) @ way / (way @ way)
            inner = (share > 0.2) & (share < 0.9)
            if np.count_nonzero(inner) <= 10:
                return 1.0
            across = points[inner] - at[start] - share[inner, None] * way
            radii.append(float(np.median(np.linalg.norm(across, axis=1))))
        return float(np.clip(radii[1] / radii[0], *_GIRTHS))


_ENDS: Final = {
    "upperarm": ("girdle", "shoulder", "elbow"),
    "forearm": ("upperarm", "elbow", "wrist"),
    "upperleg": ("torso", "hip", "knee"),
    "lowerleg": ("upperleg", "knee", "ankle"),
}
"""Parent, first and last joint of the long segments."""
