# SPDX-License-Identifier: GPL-3.0-or-later
"""A body follows another program's VMC packets, is recorded, and effects take values by OSC."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Iterator
from typing import Any

import bpy
import hands
from mathutils import Vector

VMC, VALUES = 39539, 39600
BELOW = -3  # the panels of values, sound and video are below the panel of input
CROSS = 113  # pixels from the middle of Record Values
FINGER = ("Thumb", "Index", "Middle", "Ring", "Little")
JOINT = ("Proximal", "Intermediate", "Distal")
LIMB = ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes", "Eye")
NAMES = ["Hips", "Spine", "Chest", "UpperChest", "Neck", "Head", "Jaw"]
NAMES += [side + bone for side in ("Left", "Right") for bone in LIMB]
NAMES += [s + f + j for s in ("Left", "Right") for f in FINGER for j in JOINT]


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_painted(modality="vibration", name="Rumble")
        bpy.ops.hfx.fill_part(part="torso", side="both")
    body = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    effect = hands.effect("vibration")
    bpy.context.view_layer.objects.active = None  # panels of the effect would take the place
    h.undo_push()
    yield 1.0
    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 1.0
    h.shot("1_panel.png")
    before = arm(body)
    yield from h.press_button("HFX_OT_track_body")
    yield 1.0
    h.shot("2_port.png")
    yield from h.key("Return")
    tracking = hands.module("playback.live.body_tracking").body_tracking
    yield from h.until(lambda: bool(tracking.trackers), "the body waits for a sender", 20)
    program = Program()
    program.start()
    down = Vector((0, 0, -1))
    yield from h.until(lambda: (arm(body) - down).length < 0.05, "the arm hangs as sent", 30)
    yield 0.5
    h.shot("3_following.png")
    hostile = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for size in range(2000):
        hostile.sendto(bytes(k * size % 256 for k in range(size % 600)), ("127.0.0.1", VMC))
    yield 1.0
    h.check((arm(body) - down).length < 0.05, "hostile packets move nothing")
    cost_ms = cost(tracking, body)
    (h.out / "cost.txt").write_text(f"{cost_ms:.3f} ms of a frame, {len(NAMES)} bones\n")
    h.check(cost_ms < 5.0, f"the tracking takes {cost_ms:.2f} ms of a frame")
    yield from h.press_button("HFX_OT_track_record")
    yield 1.5
    h.shot("4_recording.png")
    program.lowered = 0.0
    yield from h.until(lambda: (arm(body) - Vector((1, 0, 0))).length < 0.05, "T-pose", 30)
    program.is_on = False
    yield from h.until(lambda: tracking.trackers[0].is_lost, "the sender is lost", 30)
    yield 0.5
    h.shot("5_lost.png")
    yield from h.press_button("HFX_OT_track_record")
    yield 1.0
    action = body.animation_data.action
    h.check(not tracking.trackers and action is not None, "the recording is an action")
    with h.context():
        bpy.context.scene.frame_set(int(action.frame_range[0]))
    yield 0.5
    h.check((arm(body) - down).length < 0.1, "it begins with the hanging arm")
    h.shot("6_recorded.png")
    yield from h.press_button("HFX_OT_listen")
    yield 1.0
    yield from h.key("Return")
    listening = hands.module("playback.live.listening").listening
    yield from h.until(lambda: listening.receiver is not None, "Blender listens", 20)
    hostile.sendto(message("/hfx/effect/Rumble/intensity", 0.25), ("127.0.0.1", VALUES))
    yield from h.until(lambda: listening._set == {"Rumble": {"intensity": 0.25}}, "a value", 20)
    yield 0.5
    h.shot("7_listening.png")
    h.check(effect.hfx.intensity == 1.0, "the value of the scene is unchanged")
    buttons = yield from h.op_buttons(h.region("UI"))
    # The driver sees no button of an icon alone: the cross is at the end of the row.
    yield from h.click(buttons[-1][0] + CROSS, buttons[-1][1])
    yield from h.until(lambda: listening.receiver is None, "the cross ends the listening", 20)
    h.check((before - arm(body)).length < 3.0 and not tracking.fault, "without a fault")
    h.shot("8_end.png")


def arm(body: bpy.types.Object) -> Vector:
    bones = body.pose.bones
    return (bones["lowerarm01.L"].head - bones["upperarm01.L"].head).normalized()


def cost(tracking: Any, body: bpy.types.Object) -> float:
    """Milliseconds of the main thread for a pose of all bones, the median of 100."""
    tracker, taken = tracking.trackers[0], []
    pose = tracker.source.pose()
    for _ in range(300):
        if pose is not None:
            break
        time.sleep(0.01)
        pose = tracker.source.pose()
    for _ in range(100):
        begun = time.perf_counter()
        tracker.rig.apply(tracker.rig.bases(pose, body), body)
        taken.append(time.perf_counter() - begun)
    return sorted(taken)[50] * 1000.0


class Program(threading.Thread):
    """Another program: 60 poses a second of all bones, one datagram a bone."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.lowered, self.is_on = math.pi / 2, True

    def run(self) -> None:
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        while self.is_on:
            half = self.lowered / 2.0
            for name in NAMES:
                turn = (0.0, 0.0, math.sin(half), math.cos(half))
                turn = turn if name == "LeftUpperArm" else (0.0, 0.0, 0.0, 1.0)
                bone = message("/VMC/Ext/Bone/Pos", name, 0.0, float(name == "Hips"), 0.0, *turn)
                sender.sendto(bone, ("127.0.0.1", VMC))
            time.sleep(1.0 / 60.0)


def message(address: str, *arguments: str | float) -> bytes:
    """OSC 1.0 message of texts and floats."""

    def text(value: str) -> bytes:
        raw = value.encode() + b"\0"
        return raw + bytes(-len(raw) % 4)

    tags = "," + "".join("s" if isinstance(a, str) else "f" for a in arguments)
    content = (text(a) if isinstance(a, str) else struct.pack(">f", a) for a in arguments)
    return text(address) + text(tags) + b"".join(content)
