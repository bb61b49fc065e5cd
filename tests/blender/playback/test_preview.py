# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours in the viewport equal the colours of the engine's samples at the same moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_blender.engine.colouring import COLOURS, PALETTES, Spread, overlay
from hfx_blender.engine.native import library
from hfx_blender.engine.samples import Sample, Stream
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.preview.preview import preview
from hfx_blender.playback.preview.preview_layers import Preview
from hfx_blender.playback.preview.skin_colours import Layer, SkinColours
from hfx_blender.playback.timeline.timeline_record import NeedsSteppingError, record
from hfx_blender.ui.panels import effects_panel
from hfx_tools.felt_shares import felt_shares

BYTE = 0.51 / 255.0  # colours are kept as bytes
PALM = PARTS.index("hand_palm")


@pytest.fixture
def shown(scene: Any) -> Preview:
    bpy.ops.hfx.add_avatar()
    return Preview()


@dataclass(frozen=True)
class Whole:
    """A layer with a row for every vertex of the mesh."""

    positions: np.ndarray  # as drawn, in world space
    normals: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray  # 0..1


def now(preview: Preview, palette: str = "PAPER") -> list[Whole]:
    bpy.context.view_layer.update()
    preview.invalidate()
    preview.describe(bpy.context)
    return [whole(layer) for layer in preview.layers(palette)]


def whole(layer: Layer) -> Whole:
    count, shown, matrix = len(load_avatar().vertices), layer.shown, np.array(layer.matrix)

    def spread(values: np.ndarray) -> np.ndarray:
        expected = np.zeros((count, values.shape[1]), np.float32)
        expected[shown.vertices] = values
        return expected

    over = layer.positions + layer.normals * layer.above
    return Whole(
        spread(over @ matrix[:3, :3].T + matrix[:3, 3]),
        spread(layer.normals),
        shown.vertices[shown.triangles],
        spread(shown.colours / 255.0),
    )


def coloured(layers: list[Whole]) -> np.ndarray:
    (layer,) = layers
    return np.flatnonzero(layer.colours[:, 3] > 0.0)


def touch_palm(modality: str = "pressure") -> Any:
    bpy.ops.hfx.add_painted(modality=modality, name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    return bpy.context.object


def test_nothing_is_laid_over_an_avatar_that_feels_nothing(shown: Preview) -> None:
    assert now(shown) == []
    assert shown.fault == "Scene 'Scene' has no haptic effects."


def test_a_painted_palm_is_coloured_and_nothing_far_from_it(shown: Preview) -> None:
    effect = touch_palm()
    effect.hfx.pressure = 6.0  # full colour
    avatar = load_avatar()
    (layer,) = now(shown)
    palm = (avatar.part == PALM) & (avatar.side == LEFT)
    # Well inside the palm every neighbour is painted.
    middle = avatar.vertices[palm].mean(axis=0)
    inner = palm & (np.linalg.norm(avatar.vertices - middle, axis=1) < 0.02)
    assert inner.sum() > 5
    assert layer.colours[inner] == pytest.approx(
        np.tile([*COLOURS["pressure"], 1.0], (inner.sum(), 1)), abs=BYTE
    )
    assert not layer.colours[avatar.side == RIGHT].any()
    assert len(layer.triangles) < 0.1 * len(avatar.faces) * 2, "only what shows is drawn"


def test_colours_are_drawn_just_over_the_posed_skin(shown: Preview) -> None:
    effect = touch_palm()
    effect.hfx.body.location.x = 3.0
    (layer,) = now(shown)
    mesh = effect.hfx.body.hfx.avatar.evaluated_get(bpy.context.evaluated_depsgraph_get())
    skin = np.array([mesh.matrix_world @ v.co for v in mesh.data.vertices])
    drawn = np.unique(layer.triangles)
    height = np.linalg.norm(layer.positions[drawn] - skin[drawn], axis=1)
    assert height == pytest.approx(0.0015, abs=1e-4)


def test_dragging_a_volume_into_the_body_colours_it_at_once(shown: Preview) -> None:
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.2, location=(3, 0, 1.2)
    )
    ball = bpy.context.object
    ball.hfx.amplitude = 8.0
    assert now(shown) == []
    ball.location.x = 0.0
    (layer,) = now(shown)
    torso = load_avatar().part == PARTS.index("torso")
    assert layer.colours[torso, 3].max() == pytest.approx(1.0)
    reach = np.linalg.norm(layer.positions[layer.colours[:, 3] > 0] - [0, 0, 1.2], axis=1)
    assert reach.max() < 0.2 + 0.06  # up to one spacing of the vibration model beyond


def test_clips_decide_when_it_shows(shown: Preview) -> None:
    effect = touch_palm()
    clips.add_clip(effect, 10, 20)
    bpy.context.scene.frame_set(5)
    assert now(shown) == []
    bpy.context.scene.frame_set(15)
    assert len(now(shown)) == 1


def test_an_effect_that_is_painted_nowhere_does_not_hide_the_others(shown: Preview) -> None:
    touch_palm()
    bpy.ops.hfx.add_painted(modality="vibration", name="Empty")
    assert len(now(shown)) == 1


def test_palettes_change_colours_only(shown: Preview) -> None:
    effect = touch_palm("temperature")
    effect.hfx.temperature = 18.0
    red, safe = now(shown), now(shown, "COLOUR_BLIND")
    assert np.array_equal(coloured(red), coloured(safe))
    strongest = safe[0].colours[:, 3].argmax()
    assert safe[0].colours[strongest, :3] == pytest.approx(
        PALETTES["COLOUR_BLIND"]["cold"], abs=BYTE
    )


def test_a_hidden_avatar_is_not_coloured(shown: Preview) -> None:
    effect = touch_palm()
    effect.hfx.body.hfx.avatar.hide_set(True)
    assert now(shown) == []


def test_repainting_is_noticed(shown: Preview) -> None:
    effect = touch_palm()
    before = coloured(now(shown))
    effects.set_area(effect, [0], [1.0])
    after = coloured(now(shown))
    assert len(after) < len(before)


def test_nothing_is_stored_in_the_users_meshes(shown: Preview) -> None:
    effect = touch_palm()
    mesh = effect.hfx.body.hfx.avatar.data
    before = [attribute.name for attribute in mesh.attributes]
    now(shown)
    assert [attribute.name for attribute in mesh.attributes] == before


def test_colours_of_what_shows_are_those_that_the_engine_gives_to_every_vertex() -> None:
    rng = np.random.default_rng(1)
    spread = Spread.of_neighbours(rng.integers(0, 40, (200, 3)), rng.random((200, 3)))
    spreads, counts = {"a": spread, "b": spread}, {"a": 40, "b": 40}
    samples = []
    for k, (modality, model, values) in enumerate(
        [
            ("pressure", "a", [4.0]),
            ("pressure", "a", [3.0]),
            ("temperature", "b", [18.0]),
            ("temperature", "b", [40.0]),
        ]
    ):
        vertices = np.sort(rng.choice(40, 5, replace=False)).astype(np.int32)
        weights = rng.random(5).astype(np.float32)
        stream = Stream(f"e{k}", "body", modality, model)
        samples.append(Sample(0.0, stream, vertices, weights, 0.7, np.array(values)))
    every = overlay(felt_shares(samples, spreads, counts), PALETTES["WARM_COLD"])
    colours = SkinColours(200, {model: (spread, 40) for model in spreads})
    shown, actual = colours.of(samples, frozenset(), PALETTES["WARM_COLD"])
    assert np.array_equal(shown, np.flatnonzero(every[:, 3]))
    assert actual == pytest.approx(every[shown], abs=1e-5)
    assert 0 < len(shown) < 200


def test_volumes_are_shown_by_the_reference_without_the_compiled_library(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "is_there", lambda: False)
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", radius=0.2)
    ball = bpy.context.object
    ball.location = 0.0, 0.0, 1.2
    shown = preview.content
    shown.describe(bpy.context)
    assert shown.fault == "" and shown.is_slow
    (run,) = evaluation.runs()
    away = np.linalg.norm(load_model("hfx-pressure-1").vertices - ball.location, axis=1)
    expected = np.zeros(len(away), bool)
    expected[run.vertices] = True
    spacing = 0.02
    assert expected[away < 0.2 - spacing].all() and not expected[away > 0.2 + spacing].any()
    assert shown.layers("PAPER"), "the skin is coloured"
    with pytest.raises(NeedsSteppingError, match="compiled part"):
        list(record(scene, may_step=False))
    scene.frame_end, scene.hfx.rate = 2, 24
    assert bpy.ops.hfx.update_values() == {"FINISHED"}


def test_the_list_of_effects_says_why_nothing_is_coloured(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts: list[str] = []
    monkeypatch.setattr(effects_panel, "draw_text", lambda *a: texts.append(a[2]))
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE")
    preview.content.describe(bpy.context)
    effects_panel.draw_preview_state(bpy.context, None)
    assert texts == []
    bpy.context.object.hide_viewport = True
    bpy.context.view_layer.update()
    preview.content.describe(bpy.context)
    effects_panel.draw_preview_state(bpy.context, None)
    assert len(texts) == 1 and "disabled in viewports" in texts[0]
    bpy.context.object.hide_viewport = False
    bpy.context.view_layer.update()
    monkeypatch.setattr(library, "is_there", lambda: False)
    preview.forget()
    preview.content.describe(bpy.context)
    effects_panel.draw_preview_state(bpy.context, None)
    assert "compiled part" in texts[-1] and "Install" in texts[-1]


def test_a_removed_object_is_no_fault_of_the_preview(shown: Preview) -> None:
    bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", location=(0.0, 0.0, 1.2))
    bpy.context.view_layer.update()
    shown.describe(bpy.context)
    bpy.data.objects.remove(bpy.context.object)
    shown.invalidate()
    shown.layers("PAPER")  # drawn before the scene is described again
    assert shown.fault == ""
