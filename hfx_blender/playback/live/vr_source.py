# SPDX-License-Identifier: GPL-3.0-or-later
"""Head and hands of Blender's VR session: poses of a person, and haptics of the controllers.

Arms reach for the controllers by two bones and the law of cosines; no constraint is added. Lengths
are shares of the eye height, so hands of another build are off by some centimetres.
"""

import math
from typing import Any, Final

import bpy
from bpy.app.handlers import persistent
from mathutils import Matrix, Quaternion, Vector

from ...avatars.tracked_rig import HumanPose
from ...blender.events import add_handlers
from .live import live

ACTIONS: Final = "hfx"
HANDS: Final = ("/user/hand/left", "/user/hand/right")
CONTROLLERS: Final = "oculus_touch"
"""Device whose actuators "left" and "right" are the controllers of the session."""
REQUEST_S: Final = 0.05
"""Duration of a request, renewed while the hand is touched."""

# Blender 5.2 takes 0.1 s for 100 ns: it multiplies seconds by 1000 and the runtime expects
# nanoseconds. In a version without this fault the factor would vibrate for hours, so untested
# versions get no request.
_SECOND: Final = {(5, 2): 1e6}
_PROFILES: Final = (
    "/interaction_profiles/khr/simple_controller",
    "/interaction_profiles/oculus/touch_controller",
    "/interaction_profiles/valve/index_controller",
    "/interaction_profiles/microsoft/motion_controller",
)
# A camera looks along -Z with Y up; a person at rest looks along -Y with Z up.
_LOOK: Final = Matrix(((-1, 0, 0), (0, 0, 1), (0, 1, 0))).to_quaternion()
# Shares of the eye height: hips below the eyes, shoulders from the eyes (to the side, down), bones.
_HIPS, _SIDE, _DOWN, _UPPER, _LOWER = 0.43, 0.11, 0.15, 0.17, 0.16
_EYES_M: Final = (1.0, 2.2)  # plausible eye heights
_AMPLITUDE: Final = 0.0001  # least level of a request


def is_running() -> bool:
    """Test for a VR session of Blender."""
    return bool(bpy.types.XrSessionState.is_running(bpy.context))


class VrSource:
    """Poses of the VR session, as a :class:`.body_tracking.PoseSource`."""

    title = "VR"

    def __init__(self) -> None:
        self._eyes_m = 0.0  # height at the first pose

    def pose(self) -> HumanPose | None:
        """Present pose; None without a session, and before the session has poses. Also sends the
        haptics of the controllers."""
        if not is_running():
            return None
        state = bpy.context.window_manager.xr_session_state
        head = Vector(state.viewer_pose_location)
        hands = [Vector(state.controller_grip_location_get(bpy.context, k)) for k in range(2)]
        if head.length < 1e-6:  # the first frames of a session have no poses
            return None
        apply_haptics(state)
        turn = Quaternion(state.viewer_pose_rotation) @ _LOOK.inverted()
        self._eyes_m = self._eyes_m or eye_height(head.z)
        return pose_of(head, turn, hands, self._eyes_m)

    def close(self) -> None:
        """End the haptics of the controllers."""
        if is_running():
            state = bpy.context.window_manager.xr_session_state
            for hand in HANDS:
                state.haptic_action_stop(bpy.context, ACTIONS, "haptic", hand)


def eye_height(height_m: float) -> float:
    """Eye height of a standing person from the height of the head in the first pose, metres; an
    average one where the head is not at the height of a standing person's."""
    # A session may begin at the place of the viewport, above the ground.
    low, high = _EYES_M
    return height_m if low < height_m < high else sum(_EYES_M) / 2.0


def pose_of(head: Vector, turn: Quaternion, hands: list[Vector], eyes_m: float) -> HumanPose:
    """Pose of a person of an eye height in metres, from the head's place and turn, and the places
    of the left and right hand; a hand at (0, 0, 0) is not tracked."""
    yaw = turn.to_swing_twist("Z")
    heading = Quaternion((0.0, 0.0, 1.0), yaw[1])
    back = heading.inverted()
    rotations = {"Hips": heading, "Head": back @ turn}
    for side, sign, hand in zip(("Left", "Right"), (1.0, -1.0), hands, strict=True):
        if hand.length < 1e-6:
            continue
        outwards = Vector((sign, 0.0, 0.0))
        shoulder = Vector((sign * _SIDE, 0.0, -_DOWN)) * eyes_m
        upper, lower = _reach(back @ (hand - head) - shoulder, _UPPER * eyes_m, _LOWER * eyes_m)
        first = outwards.rotation_difference(upper)
        rotations[f"{side}UpperArm"] = first
        rotations[f"{side}LowerArm"] = first.inverted() @ outwards.rotation_difference(lower)
    return HumanPose(rotations, head - Vector((0.0, 0.0, _HIPS * eyes_m)))


def _reach(target: Vector, upper_m: float, lower_m: float) -> tuple[Vector, Vector]:
    """Unit directions of upper arm and forearm from the shoulder to a target, elbow down; straight
    for a target out of reach."""
    distance = min(max(target.length, abs(upper_m - lower_m) + 1e-4), upper_m + lower_m - 1e-4)
    along = target.normalized() if target.length > 1e-6 else Vector((0.0, -1.0, 0.0))
    down = Vector((0.0, 0.3, -1.0))
    elbow = (down - along * down.dot(along)).normalized()
    # Law of cosines: angle at the shoulder between the upper arm and the way to the hand.
    cosine = (upper_m**2 + distance**2 - lower_m**2) / (2.0 * upper_m * distance)
    upper = along * cosine + elbow * math.sqrt(max(1.0 - cosine**2, 0.0))
    return upper, (along * distance - upper * upper_m).normalized()


def apply_haptics(state: Any) -> None:
    """Request the present levels of the connected device :data:`CONTROLLERS` from the controllers,
    each for 50 ms, after the guard and all gains; nothing in untested versions of Blender."""
    second = _SECOND.get(bpy.app.version[:2])
    device, shown = live.device(CONTROLLERS), live.state(CONTROLLERS)
    if second is None or device is None or shown is None or not shown.is_armed:
        return
    levels = dict(zip((actuator.id for actuator in device.actuators), shown.levels, strict=False))
    for hand, name in zip(HANDS, ("left", "right"), strict=True):
        level = min(levels.get(name, 0.0), 1.0)
        if level >= _AMPLITUDE:
            duration = REQUEST_S * second
            state.haptic_action_apply(bpy.context, ACTIONS, "haptic", hand, duration, 160.0, level)


@persistent
def create_actions(*_: object) -> None:
    """Create poses and haptics of the controllers; Blender allows this before a session only."""
    context = bpy.context
    state = context.window_manager.xr_session_state
    actions = state.actionmaps.new(state, ACTIONS, True)
    items = []
    for name, kind, path in (
        ("grip", "POSE", "/input/grip/pose"),
        ("aim", "POSE", "/input/aim/pose"),
        ("haptic", "VIBRATION", "/output/haptic"),
    ):
        item = actions.actionmap_items.new(name, True)
        item.type = kind
        for hand in HANDS:
            item.user_paths.new(hand)
        for profile in _PROFILES:
            binding = item.bindings.new(profile.rsplit("/", 1)[1], True)
            binding.profile = profile
            for _ in HANDS:
                binding.component_paths.new(path)
        if kind == "POSE":
            item.pose_is_controller_grip = name == "grip"
            item.pose_is_controller_aim = name == "aim"
        items.append(item)
    state.action_set_create(context, actions)
    for item in items:
        state.action_create(context, actions, item)
        for binding in item.bindings:
            state.action_binding_create(context, actions, item, binding)
    state.controller_pose_actions_set(context, ACTIONS, "grip", "aim")
    state.active_action_set_set(context, ACTIONS)


def create_actions_with_session() -> None:
    """Let the next VR session have the actions of :func:`create_actions`."""
    add_handlers({"xr_session_start_pre": create_actions})
