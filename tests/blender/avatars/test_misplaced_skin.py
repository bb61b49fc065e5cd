# SPDX-License-Identifier: GPL-3.0-or-later
"""A skin that is moved, scaled, edited or keyed against its armature is followed where it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.scene import SkinBinding, SurfaceBinding

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
from mathutils import Matrix  # noqa: E402
from own_avatar import mark, opened  # noqa: E402
from test_body_meshes import cut_out, is_hand  # noqa: E402

from hfx_blender.avatars import body_binding, stored_fits  # noqa: E402
from hfx_blender.reading.live_scene import signature_of  # noqa: E402
from hfx_blender.ui.panels import body_panel  # noqa: E402

Figure = tuple[Any, Any, np.ndarray]
"""Armature, skin, and vertices of the pressure model in rest pose, metres."""


@pytest.fixture(params=["built-in", "own"])
def figure(scene: Any, request: pytest.FixtureRequest) -> Figure:
    if request.param == "built-in":
        rig = oracle.add_avatar()
        places = oracle.load_model("hfx-pressure-1").vertices
    else:
        rig, _ = opened(is_fitted=True)
        places = stored_fits.fitted_model(rig, "hfx-pressure-1").vertices
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.frame_current = 1, 12, 1
    oracle.add_painted("Felt", "pressure", rig)
    return rig, rig.hfx.avatar, places


def exported(index: int = -1) -> tuple[np.ndarray, str]:
    """Positions at a sample, and all warnings."""
    bpy.context.view_layer.update()
    evaluation = oracle.evaluate(bpy.context.scene, record=("positions",), rate_hz=10)
    number = evaluation.reader.sample_indices.tolist()[index]
    warnings = "\n".join(evaluation.reader.description.warnings)
    return evaluation.of("Felt", number).positions, warnings


def move(rig: Any, skin: Any) -> None:
    skin.location.x = 1.0


def scale(rig: Any, skin: Any) -> None:
    skin.scale = (1.2,) * 3


def move_and_apply(rig: Any, skin: Any) -> None:
    skin.data.transform(Matrix.Translation((1.0, 0.0, 0.0)))


def enlarge_vertices(rig: Any, skin: Any) -> None:
    skin.data.transform(Matrix.Scale(1.1, 4))


def move_without_modifier(rig: Any, skin: Any) -> None:
    skin.modifiers.clear()
    skin.location.x = 1.0


def move_armature_alone(rig: Any, skin: Any) -> None:
    skin.parent = None
    rig.location.y = 0.5


def move_by_constraint(rig: Any, skin: Any) -> None:
    skin.constraints.new("COPY_LOCATION").target = oracle.empty(bpy.context.scene)
    skin.constraints[0].target.location.z = 0.25


SHIFTS: dict[Callable[[Any, Any], None], tuple[Matrix, str]] = {
    move: (Matrix.Translation((1.0, 0.0, 0.0)), "is up to 1000 mm off its place"),
    scale: (Matrix.Scale(1.2, 4), " mm off its place on the armature"),
    move_and_apply: (Matrix.Translation((1.0, 0.0, 0.0)), "is up to 1000 mm off its place"),
    enlarge_vertices: (Matrix.Scale(1.1, 4), " mm off its place on the armature"),
    move_without_modifier: (Matrix.Translation((1.0, 0.0, 0.0)), "no enabled armature modifier"),
    move_armature_alone: (Matrix(), "is up to 500 mm off its place"),
    move_by_constraint: (Matrix.Translation((0.0, 0.0, 0.25)), "is up to 250 mm off its place"),
}


@pytest.mark.parametrize("misplace", SHIFTS, ids=lambda misplace: misplace.__name__)
def test_the_body_is_where_the_skin_is_and_the_export_says_why(
    figure: Figure, misplace: Callable[[Any, Any], None]
) -> None:
    rig, skin, places = figure
    misplace(rig, skin)
    matrix, text = SHIFTS[misplace]
    positions, warnings = exported()
    expected = places @ np.array(matrix)[:3, :3].T + np.array(matrix)[:3, 3]
    # Heights of up to 3 mm above the faces keep their size when the skin is scaled.
    assert np.linalg.norm(positions - expected, axis=1).max() < 1e-3
    assert text in warnings
    assert f"'{skin.name}'" in warnings
    assert f"body '{rig.name}' follows its avatar's evaluated surface" in warnings


def test_a_moved_skin_is_followed_in_a_pose(figure: Figure) -> None:
    """In a pose the skin moves about the bones' joints, which it has left."""
    rig, skin, _ = figure
    reference = skin.copy()
    bpy.context.scene.collection.objects.link(reference)
    oracle.bend(rig, 3)
    skin.location.x = reference.location.x = 0.1
    positions, _ = exported()
    surface = oracle.world_vertices(bpy.context.scene, reference)
    distances = np.array(
        [np.linalg.norm(surface - point, axis=1).min() for point in positions[::100]]
    )
    assert distances.max() < 0.03  # half an edge of the coarsest faces
    assert distances.mean() < 0.008


def test_a_keyed_skin_is_followed_at_each_time(figure: Figure) -> None:
    _, skin, places = figure
    oracle.key(skin, "location", [(1, (0.0, 0.0, 0.0)), (12, (0.2, 0.0, 0.0))])
    for point in (key for curve in _curves(skin) for key in curve.keyframe_points):
        point.interpolation = "LINEAR"
    bpy.context.scene.frame_set(1)
    first, warnings = exported(0)
    second, _ = exported(1)
    assert np.abs(first - places).max() < 2e-4
    # 10 samples a second, 24 frames a second, and 0.2 m in 11 frames.
    fps = bpy.context.scene.render.fps
    assert np.abs(second - places - (0.2 * 0.1 * fps / 11, 0.0, 0.0)).max() < 2e-4
    assert f"'{skin.name}' does not move with" in warnings


def _curves(obj: Any) -> list[Any]:
    from hfx_blender.blender import compat

    return compat.all_fcurves(obj)


def test_an_armature_that_is_keyed_without_its_skin_is_told(figure: Figure) -> None:
    rig, skin, places = figure
    skin.parent = None
    oracle.key(rig, "location", [(1, (0.0, 0.0, 0.0)), (12, (0.2, 0.0, 0.0))])
    bpy.context.scene.frame_set(1)
    positions, warnings = exported()
    assert np.abs(positions - places).max() < 2e-4
    assert f"'{skin.name}' does not move with '{rig.name}'" in warnings


def test_a_driven_skin_is_told(figure: Figure) -> None:
    rig, skin, _ = figure
    skin.driver_add("location", 2).driver.expression = "frame / 100"
    assert "does not move with" in str(body_binding.warning_of(rig))


def test_bones_by_choice_are_told_too(figure: Figure) -> None:
    rig, skin, places = figure
    rig.hfx.follow = "BONES"
    skin.location.x = 1.0
    positions, warnings = exported()
    assert np.abs(positions - places).max() < 1e-5
    assert f"although '{skin.name}' is up to 1000 mm off its place" in warnings


def whole_moved(rig: Any, skin: Any) -> None:
    rig.location, rig.rotation_euler, rig.scale = (3.0, -2.0, 900.0), (0.1, 0.2, 2.0), (1.7,) * 3


def whole_keyed(rig: Any, skin: Any) -> None:
    oracle.key(rig, "location", [(1, (0.0, 0.0, 0.0)), (12, (5.0, 0.0, 0.0))])


def whole_constrained(rig: Any, skin: Any) -> None:
    target = oracle.empty(bpy.context.scene)
    oracle.key(target, "location", [(1, (0.0, 0.0, 0.0)), (12, (5.0, 0.0, 0.0))])
    rig.constraints.new("COPY_LOCATION").target = target


def scaled_to_nothing(rig: Any, skin: Any) -> None:
    oracle.key(rig, "scale", [(1, (0.0, 0.0, 0.0)), (12, (1.0, 1.0, 1.0))])
    bpy.context.scene.frame_set(1)


def siblings(rig: Any, skin: Any) -> None:
    """Armature and skin below a keyed object, as importers make them."""
    parent = oracle.empty(bpy.context.scene)
    oracle.key(parent, "location", [(1, (0.0, 0.0, 0.0)), (12, (5.0, 0.0, 0.0))])
    skin.parent = rig.parent = parent


def constant_keys(rig: Any, skin: Any) -> None:
    oracle.key(skin, "location", [(1, (0.0, 0.0, 0.0)), (12, (0.0, 0.0, 0.0))])
    oracle.key(skin, "hide_render", [(1, False), (12, True)])


def held_by_the_armature(rig: Any, skin: Any) -> None:
    skin.parent = None
    skin.constraints.new("COPY_TRANSFORMS").target = rig
    oracle.key(rig, "location", [(1, (0.0, 0.0, 0.0)), (12, (5.0, 0.0, 0.0))])


def other_frame(rig: Any, skin: Any) -> None:
    """Undeformed vertices in another frame: the same place in the armature."""
    skin.data.transform(Matrix.Scale(100.0, 4))
    skin.matrix_parent_inverse = Matrix.Scale(0.01, 4)


def posed(rig: Any, skin: Any) -> None:
    oracle.bend(rig, 3)
    skin.hide_set(True)


@pytest.mark.parametrize(
    "change",
    [
        *(whole_moved, whole_keyed, whole_constrained, scaled_to_nothing, siblings),
        *(constant_keys, held_by_the_armature, other_frame, posed),
    ],
)
def test_a_skin_in_its_place_follows_the_bones(
    figure: Figure, change: Callable[[Any, Any], None]
) -> None:
    rig, skin, _ = figure
    change(rig, skin)
    bpy.context.view_layer.update()
    assert body_binding.warning_of(rig) is None
    assert isinstance(body_binding.binding_of(rig, ["hfx-pressure-1"]), SkinBinding)
    assert body_panel.how_followed(rig) == "Follows the bones"


def test_shape_keys_of_the_fit_are_no_displacement(scene: Any) -> None:
    rig, skin = opened()
    skin.shape_key_add(name="Basis")
    for name in ("Fat", "Smile"):
        key = skin.shape_key_add(name=name)
        for point, vertex in zip(key.data, skin.data.vertices, strict=True):
            point.co = vertex.co + 0.02 * vertex.normal
        key.value = 0.0  # 1 in Blender 5.2
    skin.data.shape_keys.key_blocks["Fat"].value = 0.5
    mark(rig, skin)
    assert stored_fits.shape_of(rig, skin) == {"Fat": 0.5}
    assert body_binding.surface_reason(rig) is None
    skin.location.z = 0.1
    bpy.context.view_layer.update()
    assert "is up to 100 mm off its place" in str(body_binding.surface_reason(rig))


def test_a_part_that_is_moved_is_named(scene: Any) -> None:
    rig, skin = opened()
    hands = cut_out(skin, "Hands", is_hand)
    rest = cut_out(skin, "Rest", lambda bone: not is_hand(bone))
    bpy.data.objects.remove(skin)
    mark(rig, rest, hands)
    assert {part.name for part in (rest, hands)} == {"Rest", "Hands"}
    assert body_binding.surface_reason(rig) is None
    hands.location.y = 0.3
    bpy.context.view_layer.update()
    assert str(body_binding.surface_reason(rig)).startswith("'Hands' is up to 300 mm off")


def test_the_panel_tells_it_without_measuring(figure: Figure) -> None:
    rig, skin, _ = figure
    skin.location.x = 1.0
    bpy.context.view_layer.update()
    assert "is measured during playback" in body_panel.how_followed(rig)
    binding = body_binding.binding_of(rig, ["hfx-pressure-1"])
    assert isinstance(binding, SurfaceBinding)
    assert "is up to 1000 mm off its place" in body_panel.how_followed(rig)
    skin.location.x = 0.0
    bpy.context.view_layer.update()
    assert body_panel.how_followed(rig) == "Follows the bones"


def test_a_subdivided_skin_that_is_moved_is_followed(figure: Figure) -> None:
    """Subdivision leaves the skin with the bones, so only the move makes its surface followed."""
    rig, skin, places = figure
    skin.modifiers.new("Subdivision", "SUBSURF").levels = 1
    assert body_binding.surface_reason(rig) is None
    skin.location.x = 1.0
    positions, warnings = exported()
    assert "is up to 1000 mm off its place" in warnings
    # Subdivision smooths the skin by a few millimetres.
    assert np.linalg.norm(positions - places - (1.0, 0.0, 0.0), axis=1).max() < 0.02


def test_a_live_scene_is_described_again_for_a_moved_skin_but_not_for_the_armature(
    figure: Figure,
) -> None:
    rig, skin, _ = figure
    before = signature_of(bpy.context.scene)
    rig.location.x = 2.0
    bpy.context.view_layer.update()
    assert signature_of(bpy.context.scene) == before
    skin.location.x = 0.5
    bpy.context.view_layer.update()
    moved = signature_of(bpy.context.scene)
    assert moved != before
    skin.keyframe_insert("location", frame=1)
    animated = signature_of(bpy.context.scene)
    skin.location.x = 0.6  # as Blender does at the next frame
    assert signature_of(bpy.context.scene) == animated != moved
