# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend of unknown origin with haptic properties outside of the user's limits.

Every property of our groups is broken in turn, in the file, past the property's limits; contacts
of one sound effect stay equal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hfx_scenes
import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.blender import compat
from hfx_blender.engine.track import TrackReader

bpy = pytest.importorskip("bpy")

NUMBERS = {"FLOAT": (math.nan, math.inf, 1e30, -1e30), "INT": (2**31 - 1, -(2**31))}
FLAGS = {"ENUM": (-5, 10**6), "BOOLEAN": ()}


def stored(owner: Any) -> Any:
    """Raw values stored by Blender behind ``owner.hfx``."""
    if hasattr(owner, "bl_system_properties_get"):
        owner = owner.bl_system_properties_get(do_create=True)
    if "hfx" not in owner:
        owner["hfx"] = {}
    return owner["hfx"]


def broken_values(group: Any) -> Iterator[tuple[str, Any]]:
    """Invalid values for each property of a group: (name, stored value)."""
    for definition in group.bl_rna.properties:
        name, kind = definition.identifier, definition.type
        if name == "rna_type":
            continue
        if kind in NUMBERS:
            limits = definition.hard_min, definition.hard_max
            for value in NUMBERS[kind]:
                if limits[0] <= value <= limits[1]:
                    continue
                row = definition.array_length
                yield name, [1.0] * (row - 1) + [value] if row else value
            yield name, "a text"
            if definition.array_length:
                yield name, 5.0
        elif kind in FLAGS:
            for value in (*FLAGS[kind], 1.5):
                yield name, value
        elif kind in ("COLLECTION", "POINTER"):
            yield name, 7


def put(group: Any, name: str, value: Any) -> None:
    if name in group:
        del group[name]
    group[name] = value


def export(path: Path, folder: Path, *more: str) -> int:
    return cli.run(["export", str(path), "-o", str(folder), "--device", "none", *more])


def report_of(folder: Path) -> dict[str, Any]:
    [path] = folder.glob("*.report.json")
    document = json.loads(path.read_text())
    assert isinstance(document, dict)
    return document


def _kinds() -> dict[str, Callable[[], Any]]:
    """An effect of each kind, in a scene with an avatar; ``Sound`` is never broken."""

    def volume(**settings: Any) -> Any:
        bpy.ops.hfx.add_volume(
            modality="vibration", shape="SPHERE", name="V", radius=0.1, location=(0, 0, 1)
        )
        effect = bpy.context.object
        for name, value in settings.items():
            setattr(effect.hfx, name, value)
        effect.hfx.size = (0.1, 0.1, 0.1)
        return effect

    def filtered(kind: str) -> Any:
        from hfx_blender.authoring import responses

        effect = volume(falloff="linear")
        responses.add_filter(effect, kind)
        return effect

    def spot() -> Any:
        from hfx_blender.authoring.paths import paths

        effect = paths.add_spot(bpy.context.scene, "pressure", bpy.data.objects["Avatar"])
        effect[paths.PATH] = paths.skin().on_skin(np.array([[0.0, -0.12, 1.25]])).ravel().tolist()
        return effect

    def actuators() -> Any:
        from hfx_blender.authoring.effects import effects

        effect = effects.add_on_body(
            bpy.context.scene, "vibration", bpy.data.objects["Avatar"], "ACTUATORS", "A"
        )
        effect.hfx.device = "back_pad"
        added = effect.hfx.drive.add()
        added.name, added.value = "1", 0.5
        return effect

    return {
        "SPHERE": volume,
        "CUBOID": lambda: volume(shape="CUBOID", falloff="smooth", modality="wind"),
        "CAPSULE": lambda: volume(shape="CAPSULE", falloff="smooth", modality="temperature"),
        "impact": lambda: filtered("impact"),
        "distance": lambda: filtered("distance"),
        "speed": lambda: filtered("speed"),
        "proximity": lambda: filtered("proximity"),
        "sine": lambda: filtered("sine"),
        "SPOT": spot,
        "ACTUATORS": actuators,
    }


@pytest.fixture(scope="module")
def sound_file(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene(1)
    bpy.data.objects.remove(bpy.data.objects["Touch"])
    bpy.data.objects["Ball"].name = "Sound"
    return hfx_scenes.save(tmp_path_factory.mktemp("sound") / "sound.blend")


@pytest.fixture
def sound_scene(sound_file: Path) -> Any:
    """An avatar, and a ball around the avatar with contacts."""
    bpy.ops.wm.open_mainfile(filepath=str(sound_file))
    return bpy.context.scene


def _exported(tmp_path: Path) -> dict[str, Any]:
    path = hfx_scenes.save(tmp_path / "hostile.blend")
    assert export(path, tmp_path / "out", "--rate", "25", "--tolerance", "paper") == 0
    report = report_of(tmp_path / "out")
    assert all(item["seconds"] == 0.08 for item in report["felt"] if item["effect"] == "Sound")
    assert any(item["effect"] == "Sound" for item in report["felt"])
    with TrackReader(tmp_path / "out" / "hostile.hfxtrack") as track:
        for run in track.runs():
            for name in ("levels", "parameters", "weights"):
                values = getattr(run, name)
                assert values is None or np.isfinite(values).all(), (run.stream, name)
    return report


@pytest.mark.parametrize("kind", [*_kinds()])
def test_every_property_of_an_effect(sound_scene: Any, tmp_path: Path, kind: str) -> None:
    """One effect for each property and each value: no broken effect harms the rest."""
    make = _kinds()[kind]
    model, broken = make(), {}
    groups: list[tuple[str, Any, Callable[[Any], Any]]] = [
        ("", model.hfx, lambda obj: stored(obj)),
    ]
    if len(model.hfx.response):
        groups = [("response[0].", model.hfx.response[0], lambda obj: stored(obj)["response"][0])]
    elif len(model.hfx.drive):
        groups.append(("drive[0].", model.hfx.drive[0], lambda obj: stored(obj)["drive"][0]))
    names = []
    for above, group, position in groups:
        for k, (name, value) in enumerate(broken_values(group)):
            effect = model.copy()
            effect.name = f"{kind} {above}{name} {k}"
            effect.hfx.uid = effect.name
            model.users_collection[0].objects.link(effect)
            names.append((effect.name, above + name, value))
            broken[effect.name] = position, name, value
    bpy.data.objects.remove(model)
    for title, (position, name, value) in broken.items():
        put(position(bpy.data.objects[title]), name, value)
    report = _exported(tmp_path)
    for title, path, value in names:
        if path.split(".")[-1] in ("role", "name"):
            continue  # an object without a role has no haptics; Blender keeps names in its own way
        messages = [text for text in report["warnings"] if f"'{title}'" in text]
        assert any(f"hfx.{path} is" in text for text in messages), (title, value, messages)


def test_every_property_of_a_body(sound_scene: Any, tmp_path: Path) -> None:
    body = bpy.data.objects["Avatar"]
    count = 0
    for name, value in broken_values(body.hfx):
        if name not in ("follow", "avatar_parts") and not (name == "radius" and value != value):
            continue  # a body takes time
        count += 1
        second = body.copy()
        second.name = second.hfx.uid = f"Other {name} {value}"
        body.users_collection[0].objects.link(second)
        put(stored(second), name, value)
    assert count >= 5
    report = _exported(tmp_path)
    for item in ("follow -5", "follow 1000000", "radius nan"):
        assert any(f"'Other {item}'" in text for text in report["warnings"]), item
    assert not any(item["body"] == "Other follow -5" for item in report["felt"])


def test_a_role_that_there_is_not(sound_scene: Any, tmp_path: Path) -> None:
    lost = bpy.data.objects["Sound"].copy()
    lost.name = "Lost"
    sound_scene.collection.objects.link(lost)
    put(stored(lost), "role", 77)
    assert any("'Lost'" in text and "role" in text for text in _exported(tmp_path)["warnings"])


@pytest.mark.parametrize("name", ["rate", "tolerance"])
def test_what_a_whole_scene_needs(
    sound_scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    values = [value for key, value in broken_values(sound_scene.hfx) if key == name]
    assert len(values) >= 3
    for k, value in enumerate(values):
        put(stored(bpy.context.scene), name, value)
        path = hfx_scenes.save(tmp_path / f"scene{k}.blend")
        capsys.readouterr()
        assert export(path, tmp_path / "out") == 3
        _, err = capsys.readouterr()
        line = err.strip().splitlines()[-1]
        assert f"scene{k}.blend" in line and f"hfx.{name} is" in line and "allowed" in line
        given = ("--rate", "50") if name == "rate" else ("--tolerance", "paper")
        assert export(path, tmp_path / f"given{k}", *given) == 0, "it is not asked for"


def test_other_settings_of_a_scene(sound_scene: Any, tmp_path: Path) -> None:
    for name, value in broken_values(sound_scene.hfx):
        if name not in ("rate", "tolerance", "name"):
            put(stored(sound_scene), name, value)
    _exported(tmp_path)


def test_a_frame_rate_that_is_none(
    sound_scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for fps, base in ((30, 1e-5), (1, 1e6), (32767, 1e-5), (24, 1e5), (30, math.nan)):
        bpy.context.scene.render.fps, bpy.context.scene.render.fps_base = fps, base
        path = hfx_scenes.save(tmp_path / "rate.blend")
        capsys.readouterr()
        assert export(path, tmp_path / "out") == 3, (fps, base)
        _, err = capsys.readouterr()
        assert "rate.blend" in err and "Frame Rate" in err and "allowed is" in err


def test_more_samples_than_there_may_be(
    sound_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for frames in ("0:1000000000", "-1000000000:5", "0:16777216"):
        capsys.readouterr()
        assert export(sound_file, tmp_path / "out", f"--frames={frames}") == 3
        _, err = capsys.readouterr()
        assert "samples, at most 16777216 are allowed" in err


def test_thousands_of_filters(sound_scene: Any, tmp_path: Path) -> None:
    second = bpy.data.objects["Sound"].copy()
    second.name = "Many"
    sound_scene.collection.objects.link(second)
    for _ in range(2000):
        second.hfx.response.add()
    [messages] = [text for text in _exported(tmp_path)["warnings"] if "'Many'" in text]
    assert "2000 filters" in messages and "left out" in messages


def test_ids_that_look_like_derived_ones(sound_scene: Any, tmp_path: Path) -> None:
    ball = bpy.data.objects["Sound"]
    ball.hfx.uid = "x"
    for name, uid in (("B", "x"), ("C", "x-2"), ("D", "x-2"), ("E", "x")):
        second = ball.copy()
        second.name, second.hfx.uid = name, uid
        sound_scene.collection.objects.link(second)
    _exported(tmp_path)
    with TrackReader(tmp_path / "out" / "hostile.hfxtrack") as track:
        assert len({effect.id for effect in track.header.effects}) == 5


# Animated


FLOATS = ("activation", "intensity", "radius", "amplitude", "frequency")


def _animated_ball(scene: Any, name: str) -> Any:
    second = bpy.data.objects["Sound"].copy()
    second.name, second.hfx.uid, second.hfx.falloff = name, name, "linear"
    scene.collection.objects.link(second)
    return second


def test_drivers_that_give_no_numbers(sound_scene: Any, tmp_path: Path) -> None:
    source = bpy.data.objects.new("Source", None)
    sound_scene.collection.objects.link(source)
    for title, value in (("nan", math.nan), ("inf", math.inf), ("-inf", -math.inf)):
        source[title] = value
        for name in FLOATS:
            ball = _animated_ball(sound_scene, f"{name} {title}")
            driver = ball.driver_add(f"hfx.{name}").driver
            driver.type = "SUM"
            target = driver.variables.new().targets[0]
            target.id, target.data_path = source, f'["{title}"]'
    _exported(tmp_path)


def test_keys_beyond_a_limit_are_told(sound_scene: Any, tmp_path: Path) -> None:
    for name, value in (("intensity", 5.0), ("frequency", 1e9), ("radius", -2.0)):
        ball = _animated_ball(sound_scene, f"Keyed {name}")
        action = ball.animation_data_create()
        action.action = bpy.data.actions.new(name)
        curve = compat.new_fcurve(ball, action.action, f"hfx.{name}")
        compat.set_keys(curve, [(0, 1.0), (1, value)])
    warnings = _exported(tmp_path)["warnings"]
    for name, value in (("intensity", "5"), ("frequency", "1e+09"), ("radius", "-2")):
        [messages] = [t for t in warnings if f"'Keyed {name}'" in t and "a key of" in t]
        assert f"a key of hfx.{name} is {value}, allowed is" in messages and "is taken" in messages


ANIMATED = {
    "modality": ((0, 2), True),
    "kind": ((1, 0), True),
    "response[0].is_muted": ((0, 1), True),
    "response[0].kind": ((0, 1), True),
    "falloff": ((0, 2), False),
    "falloff_share": ((0.1, 0.9), False),
    "is_muted": ((0, 1), False),
}


def test_blender_offers_no_keyframes_that_nothing_follows(sound_scene: Any) -> None:
    ball = _animated_ball(sound_scene, "Ball")
    ball.hfx.response.add()
    others = ("is_solo", "role", "temperature_reference", "surface.height_mm", "surface.renderer")
    for path in (*ANIMATED, *others, "response[0].operation"):
        with pytest.raises(TypeError, match="not animatable"):
            ball.keyframe_insert(f"hfx.{path}")
    for path in ("radius", "intensity", "response[0].influence"):
        assert ball.keyframe_insert(f"hfx.{path}")


def test_animation_that_nothing_follows_is_told(sound_scene: Any, tmp_path: Path) -> None:
    """Files of earlier versions may have such F-curves."""
    for path, (values, _) in ANIMATED.items():
        ball = _animated_ball(sound_scene, f"Animated {path}")
        ball.hfx.response.add().kind = "speed"
        ball.animation_data_create().action = bpy.data.actions.new("A")
        curve = compat.new_fcurve(ball, ball.animation_data.action, f"hfx.{path}")
        compat.set_keys(curve, [(0, values[0]), (1, values[1])])
    warnings = _exported(tmp_path)["warnings"]
    for path, (_, is_left_out) in ANIMATED.items():
        messages = [
            warning
            for warning in warnings
            if f"'Animated {path}'" in warning and f".{path}" in warning
        ]
        assert len(messages) == 1, path
        assert ("was left out" in messages[0]) == is_left_out, messages


def test_faults_of_objects_with_other_settings_alike(registered: Any) -> None:
    """Check each object of six by its own stored value, also next to equal ones."""
    from hfx_blender.blender.stored_values import bad_values

    hfx_scenes.small_scene(1)
    first = bpy.data.objects["Ball"]
    copies = [first.copy() for _ in range(5)]
    values = (math.nan, math.nan, "one", "another", first.hfx.radius)
    for k, (copy, value) in enumerate(zip(copies, values, strict=True)):
        copy.hfx.uid = f"id {k}"
        put(stored(copy), "radius", value)
    number, text = "hfx.radius is {}, allowed is", "hfx.radius is the text '{}', allowed is"
    expected = (number.format("nan"), number.format("nan"), text.format("one"))
    expected = (*expected, text.format("another"), "")
    for copy, start in zip(copies, expected, strict=True):
        found = [str(bad) for bad in bad_values(copy)]
        assert len(found) == bool(start) and all(one.startswith(start) for one in found)
    put(stored(copies[4]), "uid", 3)
    assert [bad.path for bad in bad_values(copies[4])] == ["uid"]
