# SPDX-License-Identifier: GPL-3.0-or-later
"""Atlas of a model, and the picture that stays linked with a painted area."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import atlas_pictures, painting
from hfx_blender.authoring.effects import effects
from hfx_blender.engine.body import atlas
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS, RIGHT
from hfx_blender.operators.painting import paint_view

MODEL = "hfx-pressure-1"


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    return bpy.context.object


def pixels_of(image: Any) -> np.ndarray:
    pixels = np.array(image.pixels[:], np.float32)
    return pixels.reshape(image.size[1], image.size[0], 4)


def paint(image: Any, cells: np.ndarray, colour: tuple[float, ...]) -> None:
    """A stroke of the Image Editor."""
    pixels = pixels_of(image)
    pixels[cells[:, 1], cells[:, 0], : len(colour)] = colour
    image.pixels[:] = pixels.ravel().tolist()


@pytest.mark.parametrize("model_id", [MODEL, "hfx-vibration-1", "hfx-temperature-1"])
def test_each_vertex_has_a_texel_near_those_of_its_neighbours(model_id: str) -> None:
    model = load_model(model_id)
    cells, (width, height) = atlas.texels(model_id)
    assert len(np.unique(cells @ [1, width])) == len(model)
    assert (cells >= 0).all() and (cells < (width, height)).all()
    edges = model.triangles[:, :2]
    apart = np.abs(cells[edges[:, 0]] - cells[edges[:, 1]]).max(axis=1)
    assert np.median(apart) <= 2


def test_the_charts_of_an_atlas_are_apart_and_hold_all_vertices() -> None:
    model = load_model(MODEL)
    cells, _ = atlas.texels(MODEL)
    charts = list(atlas.charts(model))
    vertices = np.concatenate([chart for _, chart in charts])
    assert np.array_equal(np.sort(vertices), np.arange(len(model)))
    sides = {region.id: [] for region, _ in charts}
    boxes = []
    for region, chart in charts:
        sides[region.id].append(model.side[chart])
        boxes.append((*cells[chart].min(axis=0), *cells[chart].max(axis=0)))
    # The right palm is a chart of its own, left of that of the left palm.
    assert [(side == RIGHT).all() for side in sides["hand_palm"]] == [True, False]
    for k, (left, low, right, high) in enumerate(boxes):
        for left2, low2, right2, high2 in boxes[:k]:
            assert left > right2 or left2 > right or low > high2 or low2 > high


class View:
    """View of a picture with 540 pixels of width, as in half of a window of 1600 pixels."""

    def view_to_region(self, x: float, y: float, clip: bool) -> tuple[float, float]:
        return 540.0 * x, 630.0 * y


@pytest.mark.parametrize("model_id", [MODEL, "hfx-vibration-1"])
def test_names_of_charts_are_whole_and_apart(model_id: str) -> None:
    """A name is cut nowhere; a pair of charts that are too narrow shares the region's name."""
    model = load_model(model_id)
    cells, (width, _) = atlas.texels(model_id)
    paint_view.blf.size(0, 10.0)
    drawn = {}
    for name, x, y, end in paint_view._chart_names(model, View()):
        lines = paint_view._lines(name, end - x)
        assert " ".join(lines) == name, (name, lines, end - x)
        assert all(paint_view.blf.dimensions(0, line)[0] <= end - x for line in lines)
        drawn.setdefault(name, []).append((x, y, end))
    labels = {region.label for region, _ in atlas.charts(model)}
    assert {name.removesuffix(" (left)").removesuffix(" (right)") for name in drawn} == labels
    assert {"Face", "Thumbs (left)", "Thumbs (right)", "Calves"} <= drawn.keys()
    rooms = sorted((y, x, end) for places in drawn.values() for x, y, end in places)
    for (y, _, end), (y2, x2, _) in pairwise(rooms):
        assert y != y2 or end < x2
    # The room of a pair begins at the chart of the right side.
    [(_, chart), (_, other)] = [
        (region, chart) for region, chart in atlas.charts(model) if region.label == "Calves"
    ]
    [(x, _, end)] = drawn["Calves"]
    left, right = cells[chart, 0].min(), cells[other, 0].max()
    assert x == pytest.approx(540.0 * left / width) and end >= 540.0 * right / width - 4.0


@pytest.mark.parametrize("model_id", [MODEL, "hfx-vibration-1", "hfx-temperature-1"])
def test_no_name_of_a_chart_covers_another(model_id: str) -> None:
    """Of charts of one or two texels, in rows closer than the height of a line."""
    paint_view.blf.size(0, 10.0)
    lines = list(paint_view._name_lines(load_model(model_id), View(), 12.0))
    boxes = [(x, y, x + paint_view.blf.dimensions(0, line)[0], y + 12.0) for line, x, y, _ in lines]
    for k, (left, low, right, high) in enumerate(boxes):
        for left2, low2, right2, high2 in boxes[:k]:
            # Lines of one name follow each other without a gap.
            is_apart = low >= high2 - 1e-6 or low2 >= high - 1e-6
            assert left >= right2 or left2 >= right or is_apart
    assert {"Face", "Back of the Head"} <= {line for line, *_ in lines}


def test_the_atlas_stands_as_the_body_seen_from_outside() -> None:
    """On the chest the wearer's left is at the right, and higher skin is higher."""
    model = load_model(MODEL)
    cells, _ = atlas.texels(MODEL)
    chest = (model.part == PARTS.index("torso")) & (model.normals[:, 1] < -0.9)
    chest &= (model.vertices[:, 2] > 1.2) & (model.vertices[:, 2] < 1.3)
    assert np.corrcoef(model.vertices[chest, 0], cells[chest, 0])[0, 1] > 0.9
    assert np.corrcoef(model.vertices[chest, 2], cells[chest, 1])[0, 1] > 0.9
    head, foot = (model.part == PARTS.index(part) for part in ("head", "foot_sole"))
    assert cells[head, 1].min() > cells[foot, 1].max()


@pytest.mark.parametrize("while_painting", [False, True])
def test_weights_and_texels_follow_one_another(effect: Any, while_painting: bool) -> None:
    if while_painting:
        bpy.ops.hfx.paint_begin()
    effects.set_area(effect, [], [])
    painting.set_weights(effect, np.eye(1, len(load_model(MODEL)), 3)[0] * 0.123456)
    bpy.ops.hfx.area_atlas()
    (image,) = atlas_pictures.pictures()
    cells, size = atlas.texels(MODEL)
    assert tuple(image.size) == size
    red, green, blue, alpha = pixels_of(image)[cells[3, 1], cells[3, 0]]
    # Pressure is green in the palette of the paper: 0.123456 is 31 of 255.
    assert (round(float(green) * 255), red < green, blue < green, alpha) == (31, True, True, 1.0)
    paint(image, cells[[7, 9]], (1.0, 1.0, 1.0, 1.0))
    atlas_pictures.sync(image)
    weights = painting.weights_of(effect)
    # Untouched weights keep all of their digits.
    assert np.flatnonzero(weights).tolist() == [3, 7, 9]
    assert weights[3] == pytest.approx(0.123456, abs=1e-6) and weights[7] == 1.0
    painting.set_weights(effect, np.zeros(len(weights)))
    atlas_pictures.sync(image)
    assert pixels_of(image)[..., :3].max() == 0.0
    if while_painting:
        bpy.ops.hfx.paint_end()
    assert effects.area(effect) == ([], [])


@pytest.mark.parametrize("side", ["picture", "weights"])
def test_after_undo_the_weights_are_shown(effect: Any, side: str) -> None:
    """Undo changes the picture, the weights, or both; the picture is no stroke then."""
    bpy.ops.hfx.area_atlas()
    (image,) = atlas_pictures.pictures()
    cells, _ = atlas.texels(MODEL)
    weights = np.eye(1, len(load_model(MODEL)), 3)[0]
    painting.set_weights(effect, weights)
    atlas_pictures.sync(image)
    if side == "picture":  # black, as Blender makes an image that it restores
        paint(image, cells, (0.0, 0.0, 0.0, 1.0))
    else:
        weights[7] = 1.0
        painting.set_weights(effect, weights)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        assert atlas_pictures.show_undone in handlers
    atlas_pictures.show_undone()
    assert not atlas_pictures.sync(image)
    assert np.array_equal(painting.weights_of(effect), weights)
    shown = pixels_of(image)[cells[:, 1], cells[:, 0], :3].max(axis=1)
    assert np.array_equal(shown, weights)
    paint(image, cells[[9]], (1.0, 1.0, 1.0, 1.0))  # a stroke after the undo counts
    assert atlas_pictures.sync(image)
    assert painting.weights_of(effect)[9] == 1.0


def test_the_picture_is_saved_with_the_file_and_stays_linked(effect: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.area_atlas()
    (image,) = atlas_pictures.pictures()
    cells, _ = atlas.texels(MODEL)
    paint(image, cells[[5]], (1.0, 1.0, 1.0))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    assert effects.area(effect) == ([5], [1.0])  # painted just before saving
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    (image,) = atlas_pictures.pictures()
    paint(image, cells[[6]], (0.2, 0.6, 0.2))
    atlas_pictures.sync(image)
    vertices, weights = effects.area(image[atlas_pictures.EFFECT])
    assert vertices == [5, 6] and weights == pytest.approx([1.0, 0.6], abs=1e-6)


def test_a_picture_with_the_layout_of_an_earlier_version_changes_no_weights(
    effect: Any, tmp_path: Path
) -> None:
    """Texels at the places of the present layout are those of other vertices."""
    weights = np.eye(1, len(load_model(MODEL)), 3)[0]
    painting.set_weights(effect, weights)
    bpy.ops.hfx.area_atlas()
    (image,) = atlas_pictures.pictures()
    cells, _ = atlas.texels(MODEL)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    (image,) = atlas_pictures.pictures()
    image.pixels[:] = np.roll(pixels_of(image), 1, axis=1).ravel().tolist()
    del image["hfx_atlas_layout"]
    assert not atlas_pictures.sync(image)
    assert np.array_equal(painting.weights_of(image[atlas_pictures.EFFECT]), weights)
    shown = pixels_of(image)[cells[:, 1], cells[:, 0], :3].max(axis=1)
    assert np.array_equal(shown, weights)
    paint(image, cells[[9]], (1.0, 1.0, 1.0, 1.0))
    assert atlas_pictures.sync(image)


def test_another_modality_has_another_picture(effect: Any) -> None:
    bpy.ops.hfx.area_atlas()
    (image,) = atlas_pictures.pictures()
    effect.hfx.modality = "temperature"
    atlas_pictures.sync(image)  # of the model before: nothing
    bpy.ops.hfx.area_atlas()
    assert atlas_pictures.pictures() == [image]
    assert tuple(image.size) == atlas.texels("hfx-temperature-1")[1]
