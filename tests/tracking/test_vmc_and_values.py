# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of the VMC protocol and values by OSC, from datagrams of python-osc's builders."""

from __future__ import annotations

import math
import socket
import time

import pytest
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.errors import UsageError
from hfx_blender.tracking import value_addresses
from hfx_blender.tracking.osc_packets import OscMessage
from hfx_blender.tracking.receiver import MAX_KEPT, OscReceiver, ReceivedMessage
from hfx_blender.tracking.value_addresses import ValueChange, address_of, change_of
from hfx_blender.tracking.vmc_body import PARENTS, ROOT, VmcBody

HALF = math.sqrt(0.5)


def datagram(address: str, *arguments: object) -> bytes:
    builder = OscMessageBuilder(address)
    for argument in arguments:
        builder.add_arg(argument, "f" if isinstance(argument, float) else None)
    return builder.build().dgram


def bone(name: str, *numbers: float, at_s: float = 0.0) -> ReceivedMessage:
    return ReceivedMessage(OscMessage("/VMC/Ext/Bone/Pos", (name, *numbers)), at_s)


def send(receiver: OscReceiver, *datagrams: bytes, address: str = "127.0.0.1") -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((address, 0))
        for content in datagrams:
            sender.sendto(content, ("127.0.0.1", receiver.port))


def taken(receiver: OscReceiver, count: int = 1) -> list[ReceivedMessage]:
    messages: list[ReceivedMessage] = []
    deadline = time.monotonic() + 5.0
    while len(messages) < count and time.monotonic() < deadline:
        time.sleep(0.01)
        messages += receiver.take()
    return messages


def test_unitys_axes_become_blenders() -> None:
    body = VmcBody()
    # One metre to the avatar's right, two up, three to its front; Unity: +X, +Y, +Z.
    # Unity turns by a left hand: +90 degrees about Y takes +Z to +X, the front to the right.
    body.update([bone("Hips", 1.0, 2.0, 3.0, 0.0, HALF, 0.0, HALF)])
    pose = body.poses["Hips"]
    # Blender's front is -Y, its right -X. The front (0, -1, 0) turns to the right (-1, 0, 0): by
    # the right hand about +Z that is -90 degrees.
    assert pose.position_m == (-1.0, -3.0, 2.0)
    assert pose.rotation == pytest.approx((HALF, 0.0, 0.0, -HALF))
    # +90 degrees about Unity's X takes up (+Y) to the front (+Z): about Blender's X, up (Z) to -Y.
    body.update([bone("Spine", 0.0, 0.0, 0.0, HALF, 0.0, 0.0, HALF)])
    assert body.poses["Spine"].rotation == pytest.approx((HALF, HALF, 0.0, 0.0))
    # About Unity's Z, right (+X) goes up (+Y): about Blender's Y, -X goes to Z, by +90 degrees.
    body.update([bone("Chest", 0.0, 0.0, 0.0, 0.0, 0.0, HALF, HALF)])
    assert body.poses["Chest"].rotation == pytest.approx((HALF, 0.0, HALF, 0.0))


def test_the_bones_are_those_of_unity() -> None:
    # HumanBodyBones has 55 bones before LastBone; each parent stands before its children.
    assert len(PARENTS) == 55 and PARENTS["LeftThumbProximal"] == "LeftHand"
    names = list(PARENTS)
    assert all(not p or names.index(p) < names.index(b) for b, p in PARENTS.items())


@pytest.mark.parametrize(
    "numbers",
    [
        (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        (0.0, math.inf, 0.0, 0.0, 0.0, 0.0, 1.0),
        (0.0, 0.0, 1001.0, 0.0, 0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0),
        (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
    ],
)
def test_poses_that_are_none_are_refused(numbers: tuple[float, ...]) -> None:
    body = VmcBody()
    body.update([bone("Hips", *numbers), bone("Tail", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)])
    assert body.poses == {} and body.ignored == 2 and body.age_s(1.0) == math.inf


def test_the_age_is_that_of_the_newest_pose() -> None:
    body = VmcBody()
    body.update([bone("Hips", *[0.0] * 6, 1.0, at_s=10.0)])
    body.update([ReceivedMessage(OscMessage("/VMC/Ext/T", (3.5,)), 11.0)])
    assert body.age_s(12.0) == 2.0 and body.time_s == 3.5
    for numbers, is_ready in (((0,), False), ((1,), True), ((1, 3, 0, 0), False)):
        body.update([ReceivedMessage(OscMessage("/VMC/Ext/OK", numbers), 12.0)])
        assert body.is_ready is is_ready


def test_limbs_and_trackers_alone_bring_no_body_back() -> None:
    still = (*[0.0] * 6, 1.0)
    body = VmcBody()
    body.update([bone("Hips", *still, at_s=10.0), bone("LeftHand", *still, at_s=10.0)])
    tracker = OscMessage("/VMC/Ext/Tra/Pos", ("LHR-2", *still))
    body.update([ReceivedMessage(tracker, 20.0), bone("LeftIndexProximal", *still, at_s=20.0)])
    assert body.age_s(20.0) == 10.0
    # The head comes back: hips and hand of ten seconds ago are void, the finger is not.
    body.update([bone("Head", *still, at_s=20.5)])
    assert body.age_s(20.5) == 0.0
    assert set(body.poses) == {"Head", "LeftIndexProximal"}
    # A dropout of less than two seconds keeps all.
    body.update([bone("Hips", *still, at_s=22.0)])
    assert set(body.poses) == {"Head", "LeftIndexProximal", "Hips"}


def test_poses_of_a_sender_without_tracking_do_not_count() -> None:
    body = VmcBody()
    state = OscMessage("/VMC/Ext/OK", (1, 3, 0, 0))  # loaded, calibrated, no tracking
    body.update([ReceivedMessage(state, 10.0), bone("Hips", *[0.0] * 6, 1.0, at_s=10.0)])
    assert body.age_s(10.0) == math.inf


def test_only_one_of_two_steady_senders_is_heard() -> None:
    receiver = OscReceiver(is_single=True)
    ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    try:
        for end in ends:
            end.bind(("127.0.0.1", 0))
        ports = [end.getsockname()[1] for end in ends]
        for _ in range(20):
            for end, port in zip(ends, ports, strict=True):
                end.sendto(datagram("/a", port), ("127.0.0.1", receiver.port))
            time.sleep(0.002)
        receiver.take()
        for end, port in zip(ends, ports, strict=True):
            end.sendto(datagram(f"/{ports.index(port)}", port), ("127.0.0.1", receiver.port))
        assert [m.message.address for m in taken(receiver)] == ["/0"]
        assert receiver.second == ("127.0.0.1", ports[1])
        # The first ends: the second takes over after half a second.
        time.sleep(0.6)
        ends[1].sendto(datagram("/b", 1), ("127.0.0.1", receiver.port))
        assert [m.message.address for m in taken(receiver)] == ["/b"]
        assert receiver.second is None
    finally:
        receiver.close()
        for end in ends:
            end.close()


def test_datagrams_of_new_sockets_are_those_of_one_program() -> None:
    receiver = OscReceiver(is_single=True)
    try:
        for k in range(30):
            send(receiver, datagram(f"/{k}", 1))
        assert len(taken(receiver, 30)) == 30 and receiver.second is None
    finally:
        receiver.close()


def test_a_bundle_of_python_osc_arrives() -> None:
    receiver, body = OscReceiver(is_used=VmcBody.is_used), VmcBody()
    try:
        builder = OscBundleBuilder(IMMEDIATELY)
        for address, name in (("Root", "root"), ("Bone", "Head"), ("Hmd", "LHR-1")):
            message = OscMessageBuilder(f"/VMC/Ext/{address}/Pos")
            message.add_arg(name)
            for number in (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0):
                message.add_arg(number, "f")
            builder.add_content(message.build())
        send(receiver, datagram("/VMC/Ext/Blend/Val", "Joy", 1.0), builder.build().dgram)
        body.update(taken(receiver, 3))
        assert set(body.poses) == {ROOT, "Head"} and set(body.devices) == {("Hmd", "LHR-1")}
        assert body.age_s() < 5.0 and receiver.ignored == 0
    finally:
        receiver.close()


def test_senders_outside_the_allowed_networks_are_ignored() -> None:
    receiver = OscReceiver(allowed=("127.0.0.2",))
    try:
        send(receiver, datagram("/a", 1))
        send(receiver, datagram("/b", 1), address="127.0.0.2")
        messages = taken(receiver)
        assert [m.message.address for m in messages] == ["/b"] and receiver.ignored == 1
    finally:
        receiver.close()


def test_a_flood_is_bounded_and_the_newest_state_wins() -> None:
    receiver = OscReceiver()
    try:
        for k in range(2000):
            send(receiver, datagram("/same", k), datagram(f"/name/{k}", k))
        time.sleep(0.1)
        messages = receiver.take()
        assert 0 < len(messages) <= MAX_KEPT
        same = [m.message.arguments[0] for m in messages if m.message.address == "/same"]
        assert len(same) == 1 and same[0] > 100
        begun = time.perf_counter()
    finally:
        receiver.close()
    assert time.perf_counter() - begun < 2.0  # the thread ends


@pytest.mark.parametrize(
    ("address", "port", "words"),
    [("127.0.0.1", 65536, "expected 1 to 65535"), ("example.org", 1, "expected a number")],
)
def test_an_unusable_address_is_one_sentence(address: str, port: int, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        OscReceiver(address, port)


@pytest.mark.parametrize(
    ("address", "arguments", "change"),
    [
        ("/hfx/effect/Rain/intensity", (0.5,), ValueChange("effect", "Rain", "intensity", 0.5)),
        ("/hfx/effect/Rain%20%231/frequency_hz", (80,), ("effect", "Rain #1", "frequency_hz", 80)),
        ("/hfx/effect/Rain/mute", (True,), ("effect", "Rain", "mute", 1.0)),
        ("/hfx/clip/Hit/trigger", (), ("clip", "Hit", "trigger", 1.0)),
        ("/hfx/clip/Hit/trigger", (0.0,), ("clip", "Hit", "trigger", 0.0)),
        ("/hfx/gain", (1.0,), ("all", "", "gain", 1.0)),
        ("/hfx/mute", (0,), ("all", "", "mute", 0.0)),
        ("/hfx/effect/A/location", (1, 2.5, -3.0), ("effect", "A", "location", 1.0, (1, 2.5, -3))),
        ("/hfx/effect/A/response/0/decay", (0.5,), ("effect", "A", "response/0/decay", 0.5)),
        ("/time", (12.25,), ("time", "", "time", 12.25)),
        ("/rate", (-1.0,), ("time", "", "rate", -1.0)),
    ],
)
def test_addresses_become_changes(
    address: str, arguments: tuple[object, ...], change: tuple[object, ...]
) -> None:
    assert value_addresses.is_used(address)
    actual = change_of(OscMessage(address, arguments))  # type: ignore[arg-type]
    assert actual == ValueChange(*change)  # type: ignore[arg-type]
    if address.startswith("/hfx") or actual is not None:
        assert actual is not None and address_of(*actual[:3]) == address


@pytest.mark.parametrize(
    ("address", "arguments"),
    [
        ("/hfx/gain", (math.nan,)),
        ("/hfx/gain", (0.5, 0.5, 0.5)),
        ("/hfx/effect/A/location", (1.0, 2.0)),
        ("/hfx/effect/A/location", (1.0, math.inf, 2.0)),
        ("/hfx/effect/A/response/0", (1.0,)),
        ("/hfx/clip/A/response/0/trigger", (1.0,)),
        ("/hfx/gain", (1.5,)),
        ("/hfx/gain", ()),
        ("/hfx/gain", ("1",)),
        ("/hfx/effect/Rain/intensity", (-0.1,)),
        ("/hfx/effect/Rain/intensity", (0.1, 0.2)),
        ("/hfx/effect/Rain/frequency_hz", (math.inf,)),
        ("/hfx/effect/Rain/__class__", (1.0,)),
        ("/hfx/effect//intensity", (1.0,)),
        ("/hfx/effect/%FF/intensity", (1.0,)),
        ("/hfx/effect/Rain/trigger", (1.0,)),
        ("/hfx/clip/Hit/intensity", (1.0,)),
        ("/hfx/clip/Hit/trigger", (math.nan,)),
        ("/rate", (17.0,)),
        ("/other", (1.0,)),
    ],
)
def test_other_messages_change_nothing(address: str, arguments: tuple[object, ...]) -> None:
    assert change_of(OscMessage(address, arguments)) is None  # type: ignore[arg-type]
