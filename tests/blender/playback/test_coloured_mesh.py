# SPDX-License-Identifier: GPL-3.0-or-later
"""Coloured part of a mesh: with modifiers, overrides, and from a timeline record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
import test_overridden_body
from hypothesis import given, settings
from hypothesis import strategies as st
from mathutils.bvhtree import BVHTree

from hfx_blender.authoring import clips
from hfx_blender.engine.colouring import COLOURS, PALETTES, Spread
from hfx_blender.engine.samples import Sample, Stream
from hfx_blender.playback.preview import preview_layers
from hfx_blender.playback.preview.preview_layers import Preview
from hfx_blender.playback.preview.skin_colours import ColouredMesh, DisplayedSkins, Incidence, Layer
from hfx_blender.playback.timeline.timeline_record import TimelineRecord, record

BYTE = 0.51 / 255.0  # colours are kept as bytes


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_entries_of_vertices_are_found_as_by_going_through_all(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 12))
    rows = data.draw(st.integers(0, 20))
    vertex = st.integers(0, count - 1)
    table = np.array(data.draw(st.lists(vertex, min_size=3 * rows, max_size=3 * rows)), int)
    requests = np.array(sorted(data.draw(st.sets(vertex))), int)
    incidence = Incidence(table.reshape(rows, 3), count)
    entries, counts = incidence.of(requests)
    expected = [np.flatnonzero(table == item).tolist() for item in requests]
    assert counts.tolist() == [len(item) for item in expected]
    assert incidence.places[entries].tolist() == [
        position for item in expected for position in item
    ]


def drawn_at(layer: Layer) -> np.ndarray:
    """World positions of the drawn vertices."""
    matrix = np.array(layer.matrix)
    over = layer.positions + layer.normals * layer.above
    actual: np.ndarray = over @ matrix[:3, :3].T + matrix[:3, 3]
    return actual


def test_colours_lie_over_a_surface_that_a_modifier_has_rounded(scene: Any) -> None:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.05)
    ball = bpy.context.object  # edges of 6 cm after scaling
    ball.modifiers.new("Subdivision", "SUBSURF").levels = 3
    ball.scale, ball.location = (2.0, 2.0, 2.0), (0.3, 0.0, 1.0)
    bpy.context.view_layer.update()
    count = len(ball.data.vertices)
    one_by_one = Spread(np.arange(count)[:, None], np.ones((count, 1)))
    coloured = ColouredMesh(ball, {"m": (one_by_one, count)})
    everywhere = Sample(
        0.0,
        Stream("e", "b", "pressure", "m"),
        np.arange(count, dtype=np.int32),
        np.ones(count, np.float32),
        1.0,
        np.array([6.0]),
    )
    shown = coloured.shown([everywhere], frozenset(), PALETTES["PAPER"])
    graph = bpy.context.evaluated_depsgraph_get()
    skin = DisplayedSkins().of(ball, graph)
    assert shown is not None and skin is not None
    assert len(skin.positions) > 10 * count, "Blender has rounded it"
    assert shown.colours / 255.0 == pytest.approx(
        np.tile([*COLOURS["pressure"], 1.0], (count, 1)), abs=BYTE
    )
    layer = coloured.layer(skin, shown, 1.0)
    surface = BVHTree.FromObject(ball, graph)  # in object space
    to_own = np.linalg.inv(np.array(ball.matrix_world))
    at = drawn_at(layer) @ to_own[:3, :3].T + to_own[:3, 3]
    middles = at[shown.triangles].mean(axis=1)
    heights = []
    for point in (*at, *middles):
        nearest, normal, _, _ = surface.find_nearest(point.tolist())
        heights.append(float(np.dot(point - np.array(nearest), np.array(normal))) * 2.0)
    assert min(heights) > 0.0, "also in the middle of a triangle that is straight"
    assert max(heights) < 0.01


def test_a_skin_is_read_after_each_change_into_the_same_memory(scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    cube, skins = bpy.context.object, DisplayedSkins()
    graph = bpy.context.evaluated_depsgraph_get()
    skin = skins.of(cube, graph)
    assert skin is not None
    positions = skin.positions
    assert float(positions[:, 2].max()) == 1.0, "half of the size"
    cube.modifiers.new("Moved", "DISPLACE").strength = 3.0**0.5  # 1 along each axis
    bpy.context.view_layer.update()
    assert skins.of(cube, graph) is skin
    assert float(positions[:, 2].max()) == 1.0, "once between two changes"
    skins.invalidate()
    moved = skins.of(cube, bpy.context.evaluated_depsgraph_get())
    assert moved is not None
    # New memory in each frame costs more than the copy.
    assert moved.positions is positions
    assert float(positions[:, 2].max()) == pytest.approx(1.5, abs=1e-6), "from the middle level"
    cube.modifiers.clear()
    cube.modifiers.new("Finer", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    skins.invalidate()
    finer = skins.of(cube, bpy.context.evaluated_depsgraph_get())
    assert finer is not None
    assert len(finer.positions) == len(finer.normals) == 8 + 12 + 6, "corners, edges, faces"


@pytest.fixture
def touch(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    effect = bpy.context.object
    effect.hfx.pressure = 6.0
    return effect


def now(preview: Preview, *recorded: Any) -> list[Layer]:
    bpy.context.view_layer.update()
    preview.invalidate()
    preview.describe(bpy.context)
    return preview.layers("PAPER", *recorded)


def test_an_avatar_with_a_subdivision_has_the_same_colours_on_its_finer_skin(touch: Any) -> None:
    preview = Preview()
    (before,) = now(preview)
    mesh = touch.hfx.body.hfx.avatar
    mesh.modifiers.new("Subdivision", "SUBSURF").levels = 1
    (after,) = now(preview)
    assert np.array_equal(before.shown.vertices, after.shown.vertices)
    assert np.array_equal(before.shown.colours, after.shown.colours)
    skin = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(skin.vertices) > 3 * len(mesh.data.vertices)
    at = [skin.vertices[k].co[:] for k in after.shown.vertices.tolist()]
    assert after.positions == pytest.approx(np.array(at), abs=1e-6)
    assert after.above > before.above


def test_the_colours_of_an_overridden_body_lie_on_its_own_skin(scene: Any, tmp_path: Path) -> None:
    path = tmp_path / "anna.blend"
    test_overridden_body.character(path)
    body = test_overridden_body.overridden(path)
    body.location.x = 2.0
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.15, location=(2.0, 0.1, 1.2)
    )
    bpy.context.object.hfx.amplitude = 8.0
    preview = Preview()
    (layer,) = now(preview)
    assert preview.fault == ""
    strong = drawn_at(layer)[layer.shown.colours[:, 3] > 200]
    assert len(strong) > 20
    assert np.linalg.norm(strong - [2.0, 0.1, 1.2], axis=1).max() < 0.15 + 0.04
    assert body.hfx.avatar.override_library is not None


def recorded(scene: Any) -> TimelineRecord:
    *_, actual = record(scene, may_step=False)
    assert actual is not None
    return actual


def test_frames_of_a_record_are_worked_out_once_and_look_as_at_that_moment(
    touch: Any, scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clips.add_clip(touch, 3, 6)
    scene.frame_start, scene.frame_end = 1, 8
    scene.render.fps, scene.hfx.rate = 24, 24.0
    preview = Preview()
    actual, live = recorded(scene), {}
    for frame in range(1, 9):
        scene.frame_set(frame)
        live[frame] = [layer.shown for layer in now(preview)]
    assert [bool(live[k]) for k in (1, 2, 3, 4, 5, 7, 8)] == [False] * 2 + [True] * 3 + [False] * 2
    while preview.prepare("PAPER", actual, 1, 8):
        pass

    def asked_again(_self: TimelineRecord, index: int) -> None:
        raise AssertionError(f"sample {index} is known")

    with monkeypatch.context() as patch:
        patch.setattr(TimelineRecord, "runs", asked_again)
        for frame in (1, 2, 3, 4, 5, 7, 8):  # at 6 the clip ends
            scene.frame_set(frame)
            again = [layer.shown for layer in now(preview, actual, frame)]
            assert len(again) == len(live[frame])
            for one, alternative in zip(again, live[frame], strict=True):
                assert np.array_equal(one.vertices, alternative.vertices)
                assert np.array_equal(one.colours, alternative.colours)
    scene.frame_set(4)
    bpy.context.view_layer.update()
    preview.invalidate()
    (alternative,) = preview.layers("COLOUR_BLIND", actual, 4)
    assert not np.array_equal(alternative.shown.colours, live[4][0].colours)
    assert now(preview, recorded(scene), 4)[0].shown is not alternative.shown


def test_colours_of_ones_own_are_taken_when_they_change(
    touch: Any, scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PALETTES["OWN"], "pressure", (1.0, 1.0, 0.0))  # type: ignore[arg-type]
    scene.hfx.devices.add().name = "pressure_vest"
    preview, actual = Preview(), recorded(scene)
    now(preview)
    for colour in ((1.0, 1.0, 0.0), (0.0, 1.0, 1.0)):
        monkeypatch.setitem(PALETTES["OWN"], "pressure", colour)  # type: ignore[arg-type]
        preview.invalidate()
        (layer,) = preview.layers("OWN", actual, 5)
        assert layer.shown.colours[:, :3].max(axis=0).tolist() == [255 * item for item in colour]
        (discs,) = preview.discs("OWN", actual, 5)
        assert discs.looks.colours[0].tolist() == list(colour)


def test_what_does_not_fit_into_memory_is_worked_out_when_it_is_drawn(
    touch: Any, scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preview_layers, "MOST_BYTES", -1)
    preview, actual = Preview(), recorded(scene)
    first = now(preview, actual, 5)
    assert not preview.prepare("PAPER", actual, 1, 8)
    second = now(preview, actual, 5)
    assert first[0].shown is not second[0].shown
    assert np.array_equal(first[0].shown.colours, second[0].shown.colours)


def test_an_avatar_that_was_edited_is_coloured_as_it_is_now(touch: Any) -> None:
    preview = Preview()
    now(preview)
    mesh = touch.hfx.body.hfx.avatar
    import bmesh  # included in bpy

    edited = bmesh.new()
    edited.from_mesh(mesh.data)
    edited.verts.ensure_lookup_table()
    edited.verts.remove(edited.verts[5000])
    edited.to_mesh(mesh.data)
    edited.free()
    (layer,) = now(preview)
    assert preview.fault == ""
    assert len(mesh.data.vertices) == 12439
    at = [mesh.data.vertices[k].co[:] for k in layer.shown.vertices.tolist()]
    assert layer.positions == pytest.approx(np.array(at), abs=1e-6)
