# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycle of walking in place for the canonical skeleton, by formula.

The standing foot rolls over the ground without sliding (heel, flat, ball), the swinging foot
follows a smooth curve; hips and knees follow from the ankles. Phases and angles are typical for
an adult at a free pace (Perry and Burnfield, Gait Analysis, 2010).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import Avatar, Skeleton
from hfx_blender.engine.body.parts import LEFT, PARTS

from .walk_cycle import WalkCycle

RATE_HZ: Final = 30.0
FRAMES: Final = 32
STRIDE_M: Final = 1.30

_STANCE: Final = 0.62  # share of the cycle with the foot on the ground
# The foot lies flat between these phases.
_FLAT: Final = 0.10
_HEEL_OFF: Final = 0.38
# Pitch of the foot, toes up.
_STRIKE_DEG: Final = 18.0
_TOE_OFF_DEG: Final = -48.0
_TOE_OUT_DEG: Final = 7.0
_TOE_LAG: Final = 0.2  # share of the cycle until the lifted toes are in line again
_LEAVING: Final = 0.5  # speed of the foot at toe-off, relative to the ground's speed
_ARRIVING: Final = 0.6
_CLEARANCE_M: Final = 0.025  # added to the swinging foot
_BEHIND_M: Final = 0.065  # middle of the ground contact, behind the hips
_STEP_WIDTH_M: Final = 0.10
_SWAY_M: Final = 0.018
_BOB_M: Final = 0.023
_LEG_REACH: Final = 0.992  # largest share of the leg's length: the knee is never quite straight
_PELVIS_TURN_DEG: Final = 5.0
_PELVIS_LIST_DEG: Final = 3.0
_CHEST_TURN_DEG: Final = 5.0
_ARM_SWING_DEG: Final = 21.0
_ARM_OUT_DEG: Final = 9.0
_ELBOW_DEG: Final = 20.0
_ELBOW_SWING_DEG: Final = 11.0
_FINGER_CURL_DEG: Final = 11.0


def make(avatar: Avatar) -> WalkCycle:
    """Build one cycle, from left heel strike.

    Rotations are computed in rest space (relative to the body at rest), and converted to Blender's
    bone-local quaternions at the end.
    """
    bones = avatar.skeleton
    turns = np.broadcast_to(np.eye(3), (FRAMES, len(bones.bone_names), 3, 3)).copy()
    offsets = np.zeros((FRAMES, 3))
    feet = {side: _Foot(avatar, side) for side in ("L", "R")}
    for frame in range(FRAMES):
        phase = frame / FRAMES
        offsets[frame], led_turns = _posture(bones, feet, phase)
        turns[frame] = _all_turns(bones, led_turns)
    return WalkCycle(
        rate_hz=RATE_HZ,
        stride_m=STRIDE_M,
        bone_names=bones.bone_names,
        rotations=_local_quaternions(bones, turns).astype(np.float32),
        root_offset_m=offsets.astype(np.float32),
        provenance={"source": "made for this project by formula", "licence": "CC0-1.0"},
    )


class _Foot:
    """Motion of a foot, with the contact points of its rest shape."""

    def __init__(self, avatar: Avatar, side: str) -> None:
        bones = avatar.skeleton
        self.sign = 1.0 if side == "L" else -1.0
        self.hip, self.knee, self.ankle = (
            _head(bones, f"{name}.{side}") for name in ("upperleg01", "lowerleg01", "foot")
        )
        # Both feet use the sole of the left foot, rotated so that the toes point straight ahead.
        sole = avatar.vertices[
            (avatar.part == PARTS.index("foot_sole")) & (avatar.side == LEFT)
        ].astype(float) * (self.sign, 1.0, 1.0)
        toes = np.mean([_head(bones, f"toe{digit}-1.{side}") for digit in range(1, 6)], axis=0)
        ahead = toes - self.ankle
        self.rest_yaw = np.arctan2(ahead[0], -ahead[1])
        straight = (sole - self.ankle) @ _about(2, -self.rest_yaw).T
        ball = (toes - self.ankle) @ _about(2, -self.rest_yaw).T
        bottom = -self.ankle[2]
        self.heel_point = np.array([0.0, straight[:, 1].max() - 0.012, bottom])
        self.ball_point = np.array([0.0, ball[1], ball[2]])  # the toes' joints

    def pitch(self, phase: float) -> float:
        """Pitch about X, radians, positive with the toes up; ``phase`` 0 is the heel strike."""
        knots = (0.0, _FLAT, _HEEL_OFF, 0.52, _STANCE, 0.73, 0.87, 1.0)
        degrees = (_STRIKE_DEG, 0.0, 0.0, -20.0, _TOE_OFF_DEG, -34.0, 6.0, _STRIKE_DEG)
        return float(np.radians(_interpolate(phase, knots, degrees)))

    def turn(self, phase: float) -> F64:
        """Rotation of the foot from its rest shape, (3, 3)."""
        yaw = self.sign * np.radians(_TOE_OUT_DEG)
        return _about(2, yaw) @ _about(0, -self.pitch(phase)) @ _about(2, -self.rest_yaw)

    def toe_turn(self, phase: float) -> F64:
        """Rotation (3, 3) of the toes: flat on the ground with the heel off, then in line again."""
        yaw = self.sign * np.radians(_TOE_OUT_DEG)
        follows = np.clip((phase - _STANCE) / _TOE_LAG, 0.0, 1.0)
        pitch = max(self.pitch(phase), follows * self.pitch(phase))
        return _about(2, yaw) @ _about(0, -pitch) @ _about(2, -self.rest_yaw)

    def ankle_at(self, phase: float) -> F64:
        """Position (3,) of the ankle on the moving ground, x from the midline, y from the hips."""
        if phase < _STANCE:
            return self._standing(phase)
        # A cubic from toe-off to heel strike, close to the ground's speed at both ends, lifted.
        step = 1e-4
        start, end = self._standing(_STANCE - step), self._standing(0.0)
        leave = _LEAVING * (start - self._standing(_STANCE - 2 * step)) / step
        arrive = _ARRIVING * (self._standing(step) - end) / step
        length = 1.0 - _STANCE
        u = (phase - _STANCE) / length
        ankle = (
            (2 * u**3 - 3 * u**2 + 1) * start
            + (u**3 - 2 * u**2 + u) * length * leave
            + (3 * u**2 - 2 * u**3) * end
            + (u**3 - u**2) * length * arrive
        )
        ankle[2] += _CLEARANCE_M * 6.75 * u * (1.0 - u) ** 2  # highest at a third of the way
        return ankle

    def under_hip(self, phase: float) -> F64:
        """Position (3,) of the ankle in rest space."""
        ankle = self.ankle_at(phase)
        ankle[1] += self.hip[1]
        return ankle

    def _standing(self, phase: float) -> F64:
        yaw = _about(2, self.sign * np.radians(_TOE_OUT_DEG))
        tilt = _about(0, -self.pitch(phase))
        # Contact is at the heel until the foot is flat, at the ball from heel-off on.
        pivot = self.heel_point if self.pitch(phase) > 0.0 else self.ball_point
        flat = np.array([self.sign * _STEP_WIDTH_M / 2.0, 0.0, 0.0])
        flat[1] = (phase - _STANCE / 2.0) * STRIDE_M + _BEHIND_M
        flat[2] = -self.heel_point[2]
        return flat + yaw @ (pivot - tilt @ pivot)


def _posture(
    bones: Skeleton, feet: Mapping[str, _Foot], phase: float
) -> tuple[F64, dict[str, F64]]:
    """Offset (3,) of the root, and rest-space rotations (3, 3) of the leading bones by name."""
    around = 2.0 * np.pi * phase
    # At phase 0 the left foot is in front: the left hip moves ahead, the chest counter-rotates.
    pelvis = _about(2, -np.radians(_PELVIS_TURN_DEG) * np.cos(around)) @ _about(
        1, -np.radians(_PELVIS_LIST_DEG) * np.sin(around)
    )
    chest = _about(2, np.radians(_CHEST_TURN_DEG) * np.cos(around)) @ _about(0, np.radians(2.0))
    turns: dict[str, F64] = {"root": pelvis, "neck01": _slerp(np.eye(3), chest, 0.5)}
    for number, share in (("05", 0.1), ("04", 0.35), ("03", 0.6), ("02", 0.85), ("01", 1.0)):
        turns[f"spine{number}"] = _slerp(pelvis, chest, share)
    turns["head"] = np.eye(3)

    root = _head(bones, "root")
    offset = np.array([_SWAY_M * np.sin(around), 0.0, -_BOB_M * np.cos(2.0 * around)])
    offset[0] -= root[0]
    phases = {"L": phase, "R": (phase + 0.5) % 1.0}
    offset[2] += _hip_drop(feet)
    for side, foot in feet.items():
        hip = root + offset + pelvis @ (foot.hip - root)
        ankle = foot.under_hip(phases[side])
        turns |= _leg(foot, side, hip, ankle)
        turns[f"foot.{side}"] = foot.turn(phases[side])
        for digit in range(1, 6):
            turns[f"toe{digit}-1.{side}"] = foot.toe_turn(phases[side])
        turns |= _arm(bones, side, chest, np.cos(around) * foot.sign)
    return offset, turns


def _hip_drop(feet: Mapping[str, _Foot]) -> float:
    """Vertical offset of the hips (0 or negative, metres) that keeps every leg in reach."""
    foot = feet["L"]
    reach = _LEG_REACH * (
        np.linalg.norm(foot.knee - foot.hip) + np.linalg.norm(foot.ankle - foot.knee)
    )
    # Pythagoras per phase: the highest hip from which the leg still reaches the ankle.
    drop = 0.0
    for phase in np.linspace(0.0, 1.0, 65)[:-1]:
        ankle = foot.under_hip(float(phase))
        bob = -_BOB_M * np.cos(4.0 * np.pi * phase)
        turn = np.radians(_PELVIS_TURN_DEG) * np.cos(2.0 * np.pi * phase)
        across = ankle[0] - foot.hip[0] - _SWAY_M * np.sin(2.0 * np.pi * phase)
        along = ankle[1] - (foot.hip[1] - np.sin(turn) * foot.hip[0])
        height = np.sqrt(max(reach**2 - across**2 - along**2, 0.0))
        drop = min(drop, ankle[2] + height - foot.hip[2] - bob)
    return drop


def _leg(foot: _Foot, side: str, hip: F64, ankle: F64) -> dict[str, F64]:
    """Rotations of thigh and shank by two-bone inverse kinematics, knee to the front."""
    thigh, shank = foot.knee - foot.hip, foot.ankle - foot.knee
    upper, lower = float(np.linalg.norm(thigh)), float(np.linalg.norm(shank))
    hip_to_ankle = ankle - hip
    distance = min(float(np.linalg.norm(hip_to_ankle)), 0.9999 * (upper + lower))
    along = hip_to_ankle / np.linalg.norm(hip_to_ankle)
    ahead = np.array([foot.sign * np.sin(np.radians(_TOE_OUT_DEG)), -1.0, 0.0])
    ahead -= along * (along @ ahead)
    ahead /= np.linalg.norm(ahead)
    cosine = (upper**2 + distance**2 - lower**2) / (2.0 * upper * distance)
    sine = np.sqrt(max(1.0 - cosine**2, 0.0))
    knee = hip + upper * (cosine * along + sine * ahead)
    front = np.array([np.sin(foot.rest_yaw), -np.cos(foot.rest_yaw), 0.0])
    return {
        f"upperleg01.{side}": _frame(knee - hip, ahead) @ _frame(thigh, front).T,
        f"lowerleg01.{side}": _frame(ankle - knee, ahead) @ _frame(shank, front).T,
    }


def _arm(bones: Skeleton, side: str, chest: F64, swing: float) -> dict[str, F64]:
    """Rotations of arm and fingers; ``swing`` is 1 with the arm behind, -1 in front."""
    sign = 1.0 if side == "L" else -1.0
    shoulder, elbow, wrist = (
        _head(bones, f"{name}.{side}") for name in ("upperarm01", "lowerarm01", "wrist")
    )
    hang = np.array(
        [sign * np.sin(np.radians(_ARM_OUT_DEG)), 0.0, -np.cos(np.radians(_ARM_OUT_DEG))]
    )
    lower = _shortest_turn(elbow - shoulder, hang)
    swung = _about(0, np.radians(_ARM_SWING_DEG * swing + 2.0))
    upper = chest @ swung @ lower
    straight = _shortest_turn(lower @ (wrist - elbow), hang + np.array([0.0, 0.0, -0.05]))
    bend = np.radians(_ELBOW_DEG - _ELBOW_SWING_DEG * swing)
    fore = chest @ swung @ _about(0, -bend) @ straight @ lower
    turns = {f"upperarm01.{side}": upper, f"lowerarm01.{side}": fore, f"wrist.{side}": fore}
    knuckles = _head(bones, f"finger2-1.{side}") - _head(bones, f"finger5-1.{side}")
    axis = sign * knuckles / np.linalg.norm(knuckles)
    for digit in range(2, 6):
        for joint in range(1, 4):
            curl = _about_axis(axis, np.radians(_FINGER_CURL_DEG * joint))
            turns[f"finger{digit}-{joint}.{side}"] = fore @ curl
    return turns


def _all_turns(bones: Skeleton, given: Mapping[str, F64]) -> F64:
    """Rotations (B, 3, 3) of all bones: the given rotation, or the parent's."""
    turns = np.zeros((len(bones.bone_names), 3, 3))
    for number, (name, parent) in enumerate(
        zip(bones.bone_names, bones.parents.tolist(), strict=True)
    ):
        turns[number] = given[name] if name in given else turns[parent]
    return turns


def _local_quaternions(bones: Skeleton, turns: F64) -> F64:
    """Convert rest-space rotations to ``rotation_quaternion``, (T, B, 4), without sign jumps."""
    rest = bones.rest[:, :3, :3].astype(float)
    before = np.concatenate((turns, np.broadcast_to(np.eye(3), turns[:, :1].shape)), axis=1)
    relative = np.swapaxes(before[:, bones.parents], -1, -2) @ turns
    local = np.swapaxes(rest, -1, -2) @ relative @ rest
    quaternions = _quaternions(local)
    for frame in range(1, len(quaternions)):
        flipped = np.einsum("bk,bk->b", quaternions[frame], quaternions[frame - 1]) < 0.0
        quaternions[frame, flipped] *= -1.0
    return quaternions


def _quaternions(matrices: F64) -> F64:
    """Unit quaternions (w, x, y, z), w positive, of rotations by less than pi."""
    m = matrices
    w = np.sqrt(np.maximum(1.0 + np.trace(m, axis1=-2, axis2=-1), 1e-12)) / 2.0
    xyz = np.stack(
        (
            m[..., 2, 1] - m[..., 1, 2],
            m[..., 0, 2] - m[..., 2, 0],
            m[..., 1, 0] - m[..., 0, 1],
        ),
        axis=-1,
    ) / (4.0 * w[..., None])
    wxyz = np.concatenate((w[..., None], xyz), axis=-1)
    return wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)


def _head(bones: Skeleton, name: str) -> F64:
    return bones.rest[bones.bone_names.index(name), :3, 3].astype(float)


def _about(axis: int, angle: float) -> F64:
    return _about_axis(np.eye(3)[axis], angle)


def _about_axis(axis: F64, angle: float) -> F64:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _shortest_turn(start: F64, end: F64) -> F64:
    """Shortest rotation (3, 3) from a direction to another; identity for opposite directions."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return _about_axis(axis / sine, float(np.arctan2(sine, start @ end)))


def _slerp(start: F64, end: F64, share: float) -> F64:
    """Interpolate two rotations along the shortest path."""
    w, *xyz = _quaternions((start.T @ end)[None])[0]
    sine = float(np.linalg.norm(xyz))
    if sine < 1e-9:
        return start
    angle = 2.0 * float(np.arctan2(sine, w))
    return start @ _about_axis(np.array(xyz) / sine, share * angle)


def _frame(along: F64, ahead: F64) -> F64:
    """Orthonormal columns: ``along``, the part of ``ahead`` normal to it, and their product."""
    first = along / np.linalg.norm(along)
    second = ahead - first * (first @ ahead)
    second = second / np.linalg.norm(second)
    return np.column_stack((first, second, np.cross(first, second)))


def _interpolate(phase: float, knots: tuple[float, ...], values: tuple[float, ...]) -> float:
    """Evaluate a periodic monotone cubic through knots, flat at extreme knots."""
    from_knot = int(np.searchsorted(knots, phase, side="right")) - 1
    from_knot = min(max(from_knot, 0), len(knots) - 2)
    slopes = _monotone_slopes(np.array(knots), np.array(values))
    length = knots[from_knot + 1] - knots[from_knot]
    u = (phase - knots[from_knot]) / length
    return float(
        (2 * u**3 - 3 * u**2 + 1) * values[from_knot]
        + (u**3 - 2 * u**2 + u) * length * slopes[from_knot]
        + (3 * u**2 - 2 * u**3) * values[from_knot + 1]
        + (u**3 - u**2) * length * slopes[from_knot + 1]
    )


def _monotone_slopes(knots: F64, values: F64) -> F64:
    """Slopes for a periodic cubic without overshoot (Fritsch and Butland 1984)."""
    secants = np.diff(values) / np.diff(knots)
    before, after = np.roll(secants, 1), secants
    product = before * after
    inner = np.where(
        product > 0.0, 2.0 * product / np.where(before + after == 0, 1, before + after), 0.0
    )
    return np.append(inner, inner[0])
