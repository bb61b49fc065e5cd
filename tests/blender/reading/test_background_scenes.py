# SPDX-License-Identifier: GPL-3.0-or-later
"""Background scenes give contacts as shown by Blender, with nested background scenes."""

from __future__ import annotations

from typing import Any

import pytest

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
shown = pytest.importorskip("shown")


def _move(obj: Any, scene: Any) -> Any:
    for used in list(obj.users_collection):
        used.objects.unlink(obj)
    scene.collection.objects.link(obj)
    return obj


def _ball(name: str, place: Any, home: Any) -> Any:
    return _move(oracle.add_volume(name, "vibration", "SPHERE", place, radius=0.15), home)


def test_volumes_of_background_scenes_are_felt_where_they_are_shown(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 3
    oracle.add_avatar()
    near, far = bpy.data.scenes.new("Near"), bpy.data.scenes.new("Far")
    scene.background_set, near.background_set = near, far
    keyed = _ball("keyed", (0, 0, 1.3), near)
    oracle.key(keyed, "location", [(1, (0.3, 0, 1.3)), (3, (-0.3, 0, 1.3))])
    follows = _ball("follows", (0, 0, 0), far)
    follows.constraints.new("COPY_LOCATION").target = keyed  # only stepping can tell
    source = bpy.data.collections.new("Source")
    source.objects.link(_ball("source", (0, 0, 0), bpy.data.scenes.new("Elsewhere")))
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", source
    instancer.location = (0, 0, 0.9)
    far.collection.objects.link(instancer)
    both = _ball("both", (0, 0, 0.3), near)
    scene.collection.objects.link(both)
    closed = bpy.data.collections.new("Closed")
    far.collection.children.link(closed)
    closed.objects.link(_ball("excluded", (0, 0, 1.1), far))
    far.collection.objects.unlink(closed.objects[0])
    far.view_layers[0].layer_collection.children[0].exclude = True
    _ball("disabled", (0, 0, 1.1), far).hide_viewport = True
    actual = shown.assert_felt(scene, 24)
    assert set(actual.samples) == {"keyed", "follows", "both", "source 0"}
    (warning,) = actual.reader.description.warnings
    assert warning.endswith(": 'disabled', 'excluded'")


def test_a_body_of_a_background_scene_feels(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 2
    behind = bpy.data.scenes.new("Behind")
    _ball("ball", (0, 0, 1.2), scene)
    for obj in oracle.add_avatar(), *bpy.data.objects:
        if obj.hfx.role != "EFFECT":
            _move(obj, behind)
    scene.background_set = behind
    assert oracle.evaluate(scene).of("ball", 0) is not None
