# SPDX-License-Identifier: GPL-3.0-or-later
"""Values by OSC reach the evaluation, not the file; messages are those of python-osc."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from mathutils import Vector
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.authoring import clips, responses
from hfx_blender.blender import compat
from hfx_blender.files import resources
from hfx_blender.operators.live import input_operators
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.live import listening as module
from hfx_blender.playback.live.body_tracking import body_tracking
from hfx_blender.playback.live.listening import listening
from hfx_blender.playback.live.live import live
from hfx_blender.playback.timeline.timeline_recorder import recorder
from hfx_blender.reading.stepped.stepped_reading import OverriddenProperties

oracle = pytest.importorskip("oracle")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def port(scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Port on which Blender listens, with a painted effect "Rain Drops" in the scene."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="vibration", name="Rain Drops")
    bpy.ops.hfx.fill_part(part="torso", side="both")
    bpy.context.object.hfx.amplitude = 5.0
    number = free_port()
    bpy.ops.hfx.listen(port=number)
    evaluation.describe(bpy.context)
    yield number
    listening.stop()
    body_tracking.stop_all()
    live.factors.clear()


def send(port: int, address: str, *values: Any) -> None:
    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(builder.build().dgram, ("127.0.0.1", port))


def until(happened: Callable[[], object], step: Callable[[], object] = listening.step) -> None:
    end = time.monotonic() + 20.0
    while not happened():
        assert time.monotonic() < end
        step()
        time.sleep(0.005)


def levels() -> list[tuple[float, float]]:
    """Level and amplitude of the runs of the present frame."""
    return [(float(r.levels[0]), float(r.parameters[0, 0])) for r in evaluation.runs()]


def test_values_are_shown_at_once(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []
    monkeypatch.setattr("hfx_blender.playback.live.listening.redraw", drawn.append)
    send(port, "/hfx/effect/Rain%20Drops/intensity", 0.25)
    recorder.update_now(bpy.context.scene)
    until(lambda: drawn == ["VIEW_3D"])
    assert recorder.valid is None  # the record has the values of the scene
    listening.stop()
    assert recorder.valid is not None


def test_values_replace_those_of_the_scene_without_a_change_of_the_file(port: int) -> None:
    effect = bpy.context.object
    assert levels() == [(1.0, 5.0)]
    send(port, "/hfx/effect/Rain%20Drops/intensity", 0.25)
    until(lambda: levels() == [(0.25, 5.0)])
    send(port, "/hfx/effect/Rain%20Drops/amplitude_m_s2", 2.0)
    until(lambda: levels() == [(0.25, 2.0)])
    assert effect.hfx.intensity == 1.0 and effect.hfx.amplitude == 5.0
    effect.hfx.keyframe_insert("intensity", frame=1)  # an animation does not overwrite values
    bpy.context.scene.frame_set(3)
    evaluation.invalidate()
    assert levels() == [(0.25, 2.0)]
    assert len(compat.fcurves(effect)[0].keyframe_points) == 1
    send(port, "/hfx/effect/Rain%20Drops/mute", 1)
    until(lambda: levels() == [])
    send(port, "/hfx/effect/Rain%20Drops/mute", 0)
    until(lambda: levels() == [(0.25, 2.0)])
    listening.stop()
    assert levels() == [(1.0, 5.0)]


def test_a_volume_is_moved_turned_and_resized(port: int) -> None:
    ball = oracle.add_volume("Ball", "vibration", "CYLINDER", (5.0, 0.0, 1.0), radius=0.3)
    ball.parent = bpy.data.objects.new("Hand", None)
    bpy.context.collection.objects.link(ball.parent)
    ball.parent.location.z = 0.25
    responses.add_filter(ball, "sine")
    evaluation.describe(bpy.context)
    send(port, "/hfx/effect/Ball/location", 0.0, 0.0, 1.0)
    send(port, "/hfx/effect/Ball/rotation_euler", 0.0, math.pi / 2, 0.0)
    send(port, "/hfx/effect/Ball/radius", 0.5)
    send(port, "/hfx/effect/Ball/height", -4.0)  # below the limit of 0
    send(port, "/hfx/effect/Ball/response/0/depth", 0.75)
    until(lambda: len(listening._set.get("Ball", {})) == 5)
    reading = evaluation.scene._reading  # type: ignore[union-attr]
    evaluated = ball.evaluated_get(bpy.context.evaluated_depsgraph_get())
    hfx = reading.properties_of(ball, evaluated)
    assert (hfx.radius, hfx.height, hfx.response[0].depth) == (0.5, 0.0, 0.75)
    # A quarter turn about Y takes Z to X; the parent raises by 0.25.
    matrix = reading._world_matrix(ball, evaluated)
    assert matrix[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert matrix[:3, 3] == pytest.approx([0.0, 0.0, 1.25])
    send(port, "/hfx/effect/Ball/height", 2.0)
    until(lambda: len(levels()) == 2)  # the painted effect, and the ball that reaches the body
    assert ball.location.x == 5.0 and ball.hfx.radius == pytest.approx(0.3)
    for address, *numbers in (
        ("/hfx/effect/Ball/location", 1.0),
        ("/hfx/effect/Ball/radius", 1.0, 1.0, 1.0),
        ("/hfx/effect/Ball/response/1/depth", 1.0),
        ("/hfx/effect/Ball/uid", 1.0),
        ("/hfx/effect/Rain%20Drops/location", 1.0, 1.0, 1.0),
    ):
        send(port, address, *numbers)
        until(lambda address=address: listening.newest.get(address) == "no such value")


def test_falloff_and_menus_of_a_volume_are_set_by_name_and_number(port: int) -> None:
    """Weights of a linear falloff are min((1 - g) / share, 1), with the gauge g of a sphere."""
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (0.0, 0.0, 1.0), radius=1.0)
    ball.hfx.falloff, ball.hfx.falloff_share = "none", 1.0

    def weights() -> dict[int, float]:
        evaluation.describe(bpy.context)  # in Blender by the timer that listening has requested
        [run] = [r for r in evaluation.runs() if r.stream.effect_id == ball.hfx.uid]
        return dict(zip(run.vertices.tolist(), run.weights.tolist(), strict=True))

    flat = weights()
    assert sum(flat.values()) > 0.99 * len(flat)  # but at the border
    send(port, "/hfx/effect/Ball/falloff", "Linear")
    until(lambda: listening._set.get("Ball") == {"falloff": "linear"})
    assert evaluation.is_outdated
    linear = weights()
    assert not evaluation.is_outdated
    send(port, "/hfx/effect/Ball/falloff_share", 0.5)
    until(lambda: "falloff_share" in listening._set["Ball"])
    half = weights()
    inner = [vertex for vertex, weight in linear.items() if weight > 0.1]
    assert len(inner) > 100
    assert [half[v] for v in inner] == pytest.approx([min(2.0 * linear[v], 1.0) for v in inner])
    send(port, "/hfx/effect/Ball/falloff", 0)  # the first entry
    until(lambda: listening._set["Ball"]["falloff"] == "none")
    assert weights() == flat
    send(port, "/hfx/effect/Ball/shape", "CUBOID")
    until(lambda: "shape" in listening._set["Ball"])
    assert evaluation.runs()
    address = "/hfx/effect/Ball/shape"
    for value, reason in (("MESH", "stays"), ("ball", "expected"), (9, "expected"), (1.5, "expec")):
        listening.newest.clear()
        send(port, address, value)
        until(lambda: address in listening.newest)
        assert reason in listening.newest[address]
    assert listening._set["Ball"]["shape"] == "CUBOID"
    assert (ball.hfx.falloff, ball.hfx.shape) == ("none", "SPHERE")
    listening.stop()
    assert weights() == flat


def test_a_temperature_becomes_that_of_a_touched_object(port: int) -> None:
    oracle.add_volume("Stove", "temperature", "SPHERE", (0.0, 0.0, 1.0), radius=1.0)
    send(port, "/hfx/effect/Stove/temperature_reference", "contact")
    until(lambda: "Stove" in listening._set)
    evaluation.describe(bpy.context)
    described = evaluation.scene.description.effects  # type: ignore[union-attr]
    assert {e.name: e.is_contact for e in described} == {"Rain Drops": False, "Stove": True}


def test_the_strength_of_an_actuator_is_set(port: int) -> None:
    effect = bpy.context.object
    effect.hfx.kind, effect.hfx.device = "ACTUATORS", "waist_belt"
    for name in ("front", "back"):
        effect.hfx.drive.add().name = name
    send(port, "/hfx/effect/Rain%20Drops/drive/1/value", 0.75)
    send(port, "/hfx/effect/Rain%20Drops/drive/2/value", 0.5)
    until(lambda: len(listening.newest) == 2)
    assert listening.newest["/hfx/effect/Rain%20Drops/drive/2/value"] == "no such value"
    effect.update_tag()
    bpy.context.view_layer.update()
    evaluated = effect.evaluated_get(bpy.context.evaluated_depsgraph_get())
    properties = OverriddenProperties(evaluated.hfx, listening._set["Rain Drops"])
    assert [item.value for item in properties.drive] == [evaluated.hfx.drive[0].value, 0.75]


def test_a_moved_volume_is_recorded_as_keyframes(port: int) -> None:
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (5.0, 0.0, 1.0))
    bpy.context.scene.frame_set(7)
    bpy.ops.hfx.listen_record()
    send(port, "/hfx/effect/Ball/location", 1.0, 2.0, 3.0)
    until(lambda: listening._keys)
    bpy.ops.hfx.listen_record()
    keys = {c.array_index: tuple(c.keyframe_points[0].co) for c in compat.fcurves(ball)}
    assert keys == {0: (7.0, 1.0), 1: (7.0, 2.0), 2: (7.0, 3.0)}


def test_a_trigger_plays_a_clip_with_its_fades(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = bpy.context.object
    bpy.context.scene.render.fps = 24
    clips.add_clip(effect, 100, 148, name="Shower", fade_in=24)  # 2 s, fades in for 1 s
    evaluation.describe(bpy.context)
    assert levels() == []
    clock = [1000.0]
    patched = SimpleNamespace(monotonic=lambda: clock[0])
    monkeypatch.setattr("hfx_blender.playback.live.listening.time", patched)
    send(port, "/hfx/clip/Shower/trigger")
    until(lambda: listening._triggers)
    for passed_s, level in ((0.5, 0.5), (1.5, 1.0), (0.25, 0.25)):
        clock[0] = 1000.0 + passed_s
        listening.step()
        assert [x for x, _ in levels()] == [pytest.approx(level)]
    clock[0] = 1002.01
    listening.step()
    assert levels() == [] and not listening._triggers


def test_gain_and_mute_scale_all_devices(port: int) -> None:
    send(port, "/hfx/gain", 0.5)
    until(lambda: live.factors.get("gain") == 0.5)
    send(port, "/hfx/mute", True)
    until(lambda: live.factors.get("mute") == 0.0)
    listening.stop()
    assert math.prod(live.factors.values()) == 1.0


def test_unknown_names_and_hostile_values_change_nothing(port: int) -> None:
    for address, value in (
        ("/hfx/effect/Nobody/intensity", 0.5),
        ("/hfx/effect/Rain%20Drops/is_muted", 1.0),
        ("/hfx/effect/Rain%20Drops/intensity", math.nan),
        ("/hfx/effect/*/intensity", 0.1),
        ("/hfx/clip/None/trigger", 1),
    ):
        send(port, address, value)
    until(lambda: "/hfx/clip/None/trigger" in listening.newest)
    assert listening.newest == {
        "/hfx/effect/Nobody/intensity": "no such effect",
        "/hfx/effect/Rain%20Drops/is_muted": "no such value",
        "/hfx/clip/None/trigger": "no such clip",
    }
    evaluation.invalidate()
    assert levels() == [(1.0, 5.0)]


def test_a_recording_keys_the_newest_value_of_each_frame(port: int) -> None:
    effect, scene = bpy.context.object, bpy.context.scene
    clips.add_clip(effect, 100, 110, name="Shower", fade_out=4)
    bpy.ops.hfx.listen_record()
    for frame, value in ((4, 0.5), (4, 0.75), (6, 0.25)):
        scene.frame_set(frame)
        send(port, "/hfx/effect/Rain%20Drops/intensity", value)
        until(lambda value=value: listening._set.get("Rain Drops") == {"intensity": value})
    send(port, "/hfx/clip/Shower/trigger", 1)
    until(lambda: listening._clips)
    bpy.ops.hfx.listen_record()
    curve = compat.fcurve_of(effect, "hfx.intensity")
    assert curve is not None
    assert [tuple(p.co) for p in curve.keyframe_points] == [(4.0, 0.75), (6.0, 0.25)]
    spans = [(s.frame_start, s.frame_end, s.blend_out) for _, s in clips.strips_of(effect)]
    assert sorted(spans) == [(6.0, 16.0, 4.0), (100.0, 110.0, 4.0)]


@pytest.mark.parametrize("ending", ["undo_pre", "load_pre"])
def test_undo_and_another_file_end_the_listening(port: int, ending: str) -> None:
    send(port, "/hfx/effect/Rain%20Drops/intensity", 0.25)
    until(lambda: levels() == [(0.25, 5.0)])
    for handler in list(getattr(bpy.app.handlers, ending)):
        handler(bpy.context.scene, None)
    assert listening.receiver is None and evaluation.overrides == {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))  # the port is free again


def test_an_error_stops_the_devices_before_anything_that_waits(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    receiver: Any = listening.receiver
    close = receiver.close
    monkeypatch.setattr(receiver, "take", lambda: 1 // 0)
    monkeypatch.setattr(receiver, "close", lambda: (order.append("closed"), close()))
    monkeypatch.setattr(live, "stop_all", lambda reason: order.append("stopped"))
    monkeypatch.setattr(module._log, "error", lambda *_, **__: order.append("logged"))
    assert listening.step() is None and "ZeroDivisionError" in listening.fault
    assert order == ["stopped", "closed", "logged"]


def test_addresses_are_copied_for_the_active_effect(port: int) -> None:
    manager = bpy.context.window_manager
    bpy.ops.hfx.copy_address(parameter="frequency_hz")
    if manager.clipboard:  # background mode may have none
        assert manager.clipboard == "/hfx/effect/Rain%20Drops/frequency_hz"
    with pytest.raises(RuntimeError, match="has no value 'kpa'; it has: intensity, amplitude_m_s2"):
        bpy.ops.hfx.copy_address(parameter="kpa")


def test_a_sender_of_the_vmc_protocol_moves_the_body(port: int) -> None:
    """Unity's axes: a turn about Z by 90 degrees lowers the left arm; Y is up."""
    body = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    bpy.context.view_layer.objects.active = body
    vmc = free_port()
    bpy.ops.hfx.track_body(port=vmc)
    assert input_operators.input_settings()["vmc"] == {"port": vmc, "address": "127.0.0.1"}
    half = math.sqrt(0.5)
    send(vmc, "/VMC/Ext/Bone/Pos", "Hips", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    send(vmc, "/VMC/Ext/Bone/Pos", "LeftUpperArm", 0.0, 0.0, 0.0, 0.0, 0.0, half, half)

    def arm() -> Vector:
        bpy.context.view_layer.update()
        bones = body.pose.bones
        return (bones["lowerarm01.L"].head - bones["upperarm01.L"].head).normalized()

    until(lambda: (arm() - Vector((0, 0, -1))).length < 1e-3, body_tracking.step)
    bpy.ops.hfx.track_stop(name=body.name)
    with pytest.raises(RuntimeError, match="is not tracked"):
        bpy.ops.hfx.track_stop(name=body.name)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", vmc))
        with pytest.raises(RuntimeError, match=f"port {vmc} of 127.0.0.1"):
            bpy.ops.hfx.track_body(port=vmc)
    assert not body_tracking.trackers
