# SPDX-License-Identifier: GPL-3.0-or-later
"""Canonical avatar in the pose and proportions of a target's rest pose.

Each segment of the canonical skeleton has one affine transform: the parent's rotation followed by
the smallest rotation towards the target's next joint (independent rotations would twist the
limbs), scaled along to the target's length and across to the target's girth.
"""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from ..body.model import Avatar
from .bone_regions import REGIONS, region_of
from .joints import Skeletons, dominant
from .target import weight_matrix
from .turns import about, affine, apply, axes_of, extent_of, least_turn, tip_of, twist_about

_GIRTHS: Final = (0.4, 2.5)  # range of plausible changes of girth
_SKULL_M: Final = 0.13  # height of the canonical skull from crown to ears, metres
_UP: Final = np.array([0.0, 0.0, 1.0])


def posed(avatar: Avatar, matrices: F64) -> F64:
    """Avatar vertices (V, 3) of rest space transformed by one matrix (3, 4) each."""
    moved: F64 = (
        np.einsum("vij,vj->vi", matrices[..., :3], avatar.vertices.astype(np.float64))
        + matrices[..., 3]
    )
    return moved


def matrices(avatar: Avatar, bodies: Skeletons, largest_head: float = 2.0) -> F64:
    """Matrices (V, 3, 4) from canonical rest space to the target's rest pose in normalised space.

    Segment transforms are blended by the canonical skin weights. ``largest_head`` is the largest
    plausible scale of a head; larger extents may be hats or hair. Raises InputError: two joints of
    a limb coincide.
    """
    segments = _Segments(avatar, bodies, largest_head)
    bones = np.stack([segments.matrix_of_bone(name) for name in avatar.skeleton.bone_names])
    # Linear blend of the 12 affine entries.
    blended = weight_matrix(avatar.weights, len(bones)) @ bones.reshape(-1, 16)[:, :12]
    if not np.isfinite(blended).all():
        raise InputError("Two joints of the armature lie at one place, so a limb has no direction.")
    return np.asarray(blended).reshape(-1, 3, 4)


class _Segments:
    """Transforms of body segments from canonical to target, computed on first use and cached. A
    transform is a pair: rotation (3, 3) without scale, for the segments that follow, and matrix (4,
    4) with scale and shift. ``_c`` and ``_t`` are the canonical and target joints."""

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
        """Matrix (4, 4) of the segment of a canonical bone: neck, girdle, phalanx, lower forearm,
        else the bone's region."""
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
        """Matrix (4, 4) of the segment ``name``, made at the first request, with its rotation."""
        if name not in self._made:
            stem, _, side = name.partition(".")
            turn, matrix = self._makers.get(stem, self._limb)(name if stem in _ENDS else side)
            self._turns[name], self._made[name] = turn, matrix
        return self._made[name]

    def _turn(self, name: str) -> F64:
        """Rotation (3, 3) of the segment ``name`` without scale, made with its matrix."""
        self._matrix(name)
        return self._turns[name]

    def _skins(self, region: str) -> tuple[F64, F64]:
        """Canonical (n, 3) and target (m, 3) vertices of a region; both empty if n is 0."""
        number = REGIONS.index(region)
        own = self._vertices[self._avatar_region == number]
        target = self._points[(self._target_region == number) & (len(own) > 0)]
        return own, target

    def _torso(self, _side: str) -> tuple[F64, F64]:
        """Rotation and matrix of the torso, hips to shoulders; width and depth scaled by the spread
        of the skin, 0.7 to 1.6, or 1 with 10 or fewer target vertices."""

        def frame(at: Mapping[str, F64]) -> tuple[F64, F64, float]:
            hips = (at["hip.L"] + at["hip.R"]) / 2
            up = (at["shoulder.L"] + at["shoulder.R"]) / 2 - hips
            left = at["hip.L"] - at["hip.R"] + at["shoulder.L"] - at["shoulder.R"]
            z = up / np.linalg.norm(up)
            # Hips and shoulders may lean: the width is made orthogonal to the height
            # (Gram-Schmidt).
            left = left - (left @ z) * z
            x = left / np.linalg.norm(left)
            return np.column_stack((x, np.cross(z, x), z)), hips, float(np.linalg.norm(up))

        (old, old_hips, old_up), (new, new_hips, new_up) = frame(self._c), frame(self._t)
        own, target = self._skins("torso")
        # Width and depth follow the spread of the skin, height the distance of the joints.
        old_size = np.std((own - old_hips) @ old, axis=0)
        new_size = np.std((target - new_hips) @ new, axis=0) if len(target) > 10 else old_size
        scale = np.clip(new_size / old_size, 0.7, 1.6)
        scale[2] = new_up / old_up
        return affine(new @ old.T, new @ np.diag(scale) @ old.T, old_hips, new_hips)

    def _neck(self, _side: str) -> tuple[F64, F64]:
        """Rotation and matrix of the neck from the torso's neck joint to the head's joint, both as
        transformed, scaled across by the mean scale of the head."""
        # Neck joints differ among rigs; the adjacent skin of torso and head is reliable.
        start, end = self._c["neck"], self._c["head"]
        new_start = apply(self._matrix("torso"), start)
        new_end = apply(self._matrix("head"), end)
        # Mean scale of the head: the cube root of the factor of its volume.
        girth = float(np.cbrt(np.linalg.det(self._matrix("head")[:3, :3])))
        return self._stretched(self._turn("torso"), start, end, new_start, new_end, girth)

    def _head(self, _side: str) -> tuple[F64, F64]:
        """Identity and upright matrix of the head; size and position from the skull above the ears.
        With 10 or fewer vertices: the torso's rotation at the head joint, or without the joint the
        torso's rotation and matrix."""
        own, target = self._skins("head")
        if len(target) <= 10:
            has_joint = "head" in self._t
            torso_transform = self._turn("torso"), self._matrix("torso")
            return self._rigid("torso", "head") if has_joint else torso_transform
        top, new_top = own[:, 2].max(), target[:, 2].max()
        skull = own[own[:, 2] > top - _SKULL_M]
        scale = np.ones(2)
        # Fixed point: the skull's height, and so its width, grows with the scale of the head.
        for _ in range(8):
            new_skull = target[target[:, 2] > new_top - _SKULL_M * scale.mean()]
            widths = np.ptp(new_skull[:, :2], axis=0) / np.ptp(skull[:, :2], axis=0)
            scale = np.clip(widths, 0.6, self._largest_head)
        low, high = extent_of(skull)
        new_low, new_high = extent_of(new_skull)
        old, new = (low + high) / 2, (new_low + new_high) / 2
        old[2], new[2] = top, new_top
        return affine(np.eye(3), np.diag([*scale, scale.mean()]), old, new)

    def _girdle(self, side: str) -> tuple[F64, F64]:
        """Rotation and matrix from the clavicle, moved with the torso, to the target's shoulder
        joint; girth unchanged."""
        start = self._c[f"clavicle.{side}"]
        end = self._t[f"shoulder.{side}"]
        new_start = apply(self._matrix("torso"), start)
        old_end = self._c[f"shoulder.{side}"]
        return self._stretched(self._turn("torso"), start, old_end, new_start, end, 1.0)

    def _limb(self, name: str) -> tuple[F64, F64]:
        """Rotation and matrix of a limb bone between its two joints on the target. The parent's
        without a first joint; without a last joint to the tip of the skin (forearm), else rigid."""
        stem, _, side = name.partition(".")
        parent, start, end = _ENDS[stem]
        parent_name = parent if parent == "torso" else f"{parent}.{side}"
        start, end = f"{start}.{side}", f"{end}.{side}"
        if start not in self._t:
            return self._turn(parent_name), self._matrix(parent_name)
        if end not in self._t:
            self._matrix(parent_name)
            # Without a wrist, the tip of the skin ends the forearm; a foot's tip is off the shank.
            if stem == "forearm":
                return self._by_extent(parent_name, start, name)
            return self._rigid(parent_name, start)
        return self._between(parent_name, start, end, self._girth(name, start, end))

    def _hand(self, side: str) -> tuple[F64, F64]:
        """Rotation and matrix of a hand by wrist and two or more knuckles, each scale 0.4 to 2.5;
        by :meth:`_mitten` with fewer knuckles, the forearm's without a wrist."""
        forearm, wrist = f"forearm.{side}", f"wrist.{side}"
        if wrist not in self._t:
            return self._turn(forearm), self._matrix(forearm)
        knuckles = [f"finger{k}-1.{side}" for k in range(2, 6)]
        known = [joint for joint in knuckles if joint in self._t]
        if len(known) < 2:
            return self._mitten(forearm, wrist, f"hand.{side}")
        old_mid = np.mean([self._c[joint] for joint in known], axis=0)
        new_mid = np.mean([self._t[joint] for joint in known], axis=0)
        # Axes of a hand: towards the middle of the knuckles, and across from the first to the last.
        old = axes_of(old_mid - self._c[wrist], self._c[known[0]] - self._c[known[-1]])
        new = axes_of(new_mid - self._t[wrist], self._t[known[0]] - self._t[known[-1]])
        length = np.linalg.norm(new_mid - self._t[wrist]) / np.linalg.norm(old_mid - self._c[wrist])
        across = np.linalg.norm(self._t[known[0]] - self._t[known[-1]]) / np.linalg.norm(
            self._c[known[0]] - self._c[known[-1]]
        )
        scale = np.clip([length, across, np.sqrt(length * across)], *_GIRTHS)
        return affine(new @ old.T, new @ np.diag(scale) @ old.T, self._c[wrist], self._t[wrist])

    def _finger(self, bone: str) -> F64:
        """Matrix (4, 4) of a phalanx, along the line to the next phalanx of the target, the last
        to the tip of the skin; without this phalanx on the target, the matrix of the previous
        phalanx or the hand."""
        if bone not in self._made:
            stem, _, side = bone.partition(".")
            finger, phalanx = stem[:-2], int(stem[-1])
            chain = [
                f"{finger}-{k}.{side}" for k in range(1, 4) if f"{finger}-{k}.{side}" in self._t
            ]
            before = [joint for joint in chain if int(joint[-3]) < phalanx]
            parent = before[-1] if before else f"hand.{side}"
            # The parent's matrices come first: all cases below read them.
            if before:
                self._finger(parent)
            else:
                self._matrix(parent)
            if bone not in self._t:
                transform = self._turns[parent], self._made[parent]
            elif bone == chain[-1]:
                transform = self._by_extent(parent, bone, f"{finger}.{side}")
            else:
                after = chain[chain.index(bone) + 1]
                transform = self._between(parent, bone, after, self._girth(f"{finger}.{side}"))
            self._turns[bone], self._made[bone] = transform
        return self._made[bone]

    def _foot(self, side: str) -> tuple[F64, F64]:
        """Rotation and matrix of a flat foot: rotated about the vertical only, scaled by the sole,
        0.4 to 2.5. The shank's without an ankle; unscaled at the ankle with 10 or fewer
        vertices."""
        ankle, ball, region = f"ankle.{side}", f"ball.{side}", f"foot.{side}"
        leg = f"lowerleg.{side}"
        if ankle not in self._t:
            return self._turn(leg), self._matrix(leg)
        own, target = self._skins(region)
        if len(target) <= 10:
            return self._rigid(leg, ankle)
        if ball in self._t:
            old_way, new_way = self._c[ball] - self._c[ankle], self._t[ball] - self._t[ankle]
        else:
            old_way, new_way = (
                own.mean(axis=0) - self._c[ankle],
                target.mean(axis=0) - self._t[ankle],
            )
        old, new = axes_of(_UP, old_way), axes_of(_UP, new_way)  # up, forward, sideways
        low, high = extent_of((own - self._c[ankle]) @ old)
        low_t, high_t = extent_of((target - self._t[ankle]) @ new)
        scale = np.ones(3)
        scale[0] = low_t[0] / low[0]  # from the ankle to the sole
        scale[1:] = (high_t - low_t)[1:] / (high - low)[1:]
        scale = np.clip(scale, *_GIRTHS)
        linear = new @ np.diag(scale) @ old.T
        shift = np.zeros(3)
        shift[1:] = (high_t - scale * high)[1:]
        return affine(new @ old.T, linear, self._c[ankle], self._t[ankle] + new @ shift)

    def _twisted(self, side: str) -> F64:
        """Matrix (4, 4) of the lower forearm: the forearm's, with half of the hand's twist about
        the axis elbow to wrist; the forearm's own without wrist or elbow."""
        forearm = self._matrix(f"forearm.{side}")
        if f"wrist.{side}" not in self._t or f"elbow.{side}" not in self._t:
            return forearm
        # Radius and ulna cross: the skin halfway along a forearm twists half as far as the hand.
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
        """Rotation (3, 3) of segment ``parent``, and matrix (4, 4) of this rotation that maps the
        canonical to the target ``joint``, unscaled."""
        turn = self._turn(parent)
        return affine(turn, turn, self._c[joint], self._t[joint])

    def _between(self, parent: str, start: str, end: str, girth: float) -> tuple[F64, F64]:
        """Rotation and matrix from the canonical to the target line between joints ``start`` and
        ``end``, by :meth:`_stretched` from the rotation of segment ``parent``; ``girth``: scale
        across."""
        ends = self._c[start], self._c[end], self._t[start], self._t[end]
        return self._stretched(self._turn(parent), *ends, girth)

    def _stretched(
        self, turn: F64, start: F64, end: F64, new_start: F64, new_end: F64, girth: float
    ) -> tuple[F64, F64]:
        """Rotation (3, 3) without scale, and matrix (4, 4), of a segment from the line ``start``,
        ``end`` to ``new_start``, ``new_end``: ``turn``, then the smallest rotation to the new line,
        scaled by the ratio of lengths along and ``girth`` across. A new length below 1 micrometre:
        ``turn`` alone, unscaled. ``start`` and ``end`` must differ."""
        way, new_way = end - start, new_end - new_start
        length, new_length = np.linalg.norm(way), np.linalg.norm(new_way)
        if new_length < 1e-6:
            return affine(turn, turn, start, new_start)
        axis = way / length
        turned = least_turn(turn @ axis, new_way / new_length) @ turn
        along = np.outer(axis, axis)  # projection on the axis; the complement is across
        linear = turned @ (girth * (np.eye(3) - along) + new_length / length * along)
        return affine(turned, linear, start, new_start)

    def _by_extent(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """Rotation and matrix of a limb's last bone, along the line from ``joint`` to the tip of
        the skin of ``region``, by :meth:`_stretched`; by :meth:`_rigid` with 3 or fewer target
        vertices."""
        turn = self._turn(parent)
        own, target = self._skins(region)
        start, new_start = self._c[joint], self._t[joint]
        if len(target) <= 3:
            return self._rigid(parent, joint)
        tip = tip_of(own, start)
        new_tip = tip_of(target, new_start)
        return self._stretched(turn, start, tip, new_start, new_tip, self._girth(region))

    def _mitten(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """Rotation and matrix of a hand without knuckles: axes along the hand and across its broad
        side, each of three axes scaled by 0.4 to 2.5; by :meth:`_rigid` with 10 or fewer target
        vertices."""
        turn, _ = self._by_extent(parent, joint, region)
        own, target = self._skins(region)
        if len(target) <= 10:
            return self._rigid(parent, joint)
        frames: list[F64] = []
        sizes: list[list[float]] = []
        for points, start, guess in ((own, self._c[joint], None), (target, self._t[joint], turn)):
            main = tip_of(points, start) - start
            axis = main / np.linalg.norm(main)
            flat = points - start - np.outer((points - start) @ axis, axis)
            # First principal axis across the hand; the sign follows the guess from the parent.
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
        """Ratio of target to canonical girth of a region, 0.4 to 2.5; 1 with 10 or fewer vertices
        of the target, or of either body between the ends. Around the line between two joints, or
        (without joints) across the region's principal axis."""
        own, target = self._skins(region)
        if len(target) <= 10:
            return 1.0
        if not start:
            spread, new_spread = (
                np.sqrt(
                    np.prod(
                        np.linalg.svd(p - p.mean(axis=0), compute_uv=False)[1:] / np.sqrt(len(p))
                    )
                )
                for p in (own, target)
            )
            return float(np.clip(new_spread / spread, *_GIRTHS))
        # Median distance from the bone's line, without the ends, where other limbs join.
        radii = []
        for points, at in ((own, self._c), (target, self._t)):
            way = at[end] - at[start]
            share = (points - at[start]) @ way / (way @ way)
            is_inner = (share > 0.2) & (share < 0.9)
            if np.count_nonzero(is_inner) <= 10:
                return 1.0
            across = points[is_inner] - at[start] - share[is_inner, None] * way
            radii.append(float(np.median(np.linalg.norm(across, axis=1))))
        return float(np.clip(radii[1] / radii[0], *_GIRTHS))


# Parent, first and last joint of long segments
_ENDS: Final = {
    "upperarm": ("girdle", "shoulder", "elbow"),
    "forearm": ("upperarm", "elbow", "wrist"),
    "upperleg": ("torso", "hip", "knee"),
    "lowerleg": ("upperleg", "knee", "ankle"),
}
