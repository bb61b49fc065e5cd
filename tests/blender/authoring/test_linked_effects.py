# SPDX-License-Identifier: GPL-3.0-or-later
"""Duplicates, linked libraries, overrides and excluded collections: as Blender's users expect."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.engine.tolerance import PREVIEW
from hfx_blender.reading.description import scene_description
from hfx_blender.reading.live_scene import LiveScene


def felt() -> set[str]:
    """Names of the effects with contacts at the current frame."""
    scene = bpy.context.scene
    bpy.context.view_layer.update()
    live = LiveScene(scene, bpy.context.view_layer, PREVIEW)
    names = {item.id: item.name for item in live.description.effects}
    return {names[run.stream.effect_id] for run in live.runs() if len(run)}


def ball(name: str, x: float = 0.0) -> Any:
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name=name, radius=0.2, location=(x, 0.0, 1.2)
    )
    return bpy.context.object


@pytest.fixture
def body(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


def test_a_linked_duplicate_shares_the_mesh_until_its_size_is_changed(body: Any) -> None:
    first = ball("Ball", 3.0)
    bpy.ops.object.duplicate(linked=True)
    second = bpy.context.object
    second.location.x = 0.0
    assert second.data == first.data
    assert felt() == {second.name}
    second.hfx.radius = 0.1
    bpy.context.view_layer.update()
    assert (first.dimensions.x, second.dimensions.x) == pytest.approx((0.4, 0.2))


def test_an_excluded_collection_is_not_felt_and_the_eye_makes_no_difference(body: Any) -> None:
    ball("Kept")
    alternative = ball("Other")
    collection = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(collection)
    for owner in alternative.users_collection:
        owner.objects.unlink(alternative)
    collection.objects.link(alternative)
    layer = bpy.context.view_layer.layer_collection.children["Props"]
    layer.exclude = True
    assert felt() == {"Kept"}
    layer.exclude = False
    layer.hide_viewport = True  # the eye
    assert felt() == {"Kept", "Other"}
    collection.hide_viewport = True  # the monitor
    assert felt() == {"Kept"}


@pytest.fixture
def library(scene: Any, tmp_path: Path) -> Path:
    """A file with a ball and a clip of the ball from frame 5 to 10."""
    clips.add_clip(ball("Ball"), 5, 10)
    path = tmp_path / "props.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    return path


def link(path: Path) -> Any:
    with bpy.data.libraries.load(str(path), link=True) as (_inside, expected):
        expected.collections = [effects.COLLECTION]
    (collection,) = expected.collections
    bpy.context.scene.collection.children.link(collection)
    return collection


def test_a_linked_effect_is_felt_with_its_clips(library: Path) -> None:
    link(library)
    bpy.context.scene.frame_set(7)
    assert felt() == {"Ball"}
    bpy.context.scene.frame_set(12)
    assert felt() == set()


def test_an_override_has_values_and_clips_of_its_own_and_survives_saving(
    library: Path, tmp_path: Path
) -> None:
    collection = link(library)
    scene = bpy.context.scene
    collection.override_hierarchy_create(scene, bpy.context.view_layer)
    scene.collection.children.unlink(collection)
    (ours,) = effects.effects_of(scene)
    bpy.context.view_layer.objects.active = ours
    ours.select_set(True)
    scene.frame_set(30)
    assert effects.is_locked(ours), "as Library Override > Make leaves it"
    assert bpy.ops.hfx.make_editable() == {"FINISHED"}
    assert bpy.ops.hfx.add_clip.poll()
    assert not bpy.ops.hfx.make_editable.poll()
    assert bpy.ops.hfx.add_clip() == {"FINISHED"}
    ours.hfx.radius = 0.15
    ours.hfx.amplitude = 3.0
    ours.hfx.falloff = "linear"
    with pytest.raises(RuntimeError, match="linked file"):
        bpy.ops.hfx.remove_clip(name="Clip")
    saved = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    (again,) = effects.effects_of(bpy.context.scene)
    assert again.override_library is not None
    assert (again.hfx.radius, again.hfx.amplitude) == pytest.approx((0.15, 3.0))
    assert again.hfx.falloff == "linear"
    assert again.dimensions.x == pytest.approx(0.3)
    bpy.context.scene.frame_set(31)
    assert felt() == {"Ball"}
    bpy.context.scene.frame_set(7)
    assert felt() == {"Ball"}, "the library's clip is still there"


@pytest.mark.parametrize("is_alone", [True, False])
def test_a_linked_effect_is_locked_until_it_is_made_editable(library: Path, is_alone: bool) -> None:
    """Linked as an object, or with its collection."""
    collection = link(library)
    (linked,) = collection.objects
    if is_alone:
        bpy.context.scene.collection.children.unlink(collection)
        bpy.context.scene.collection.objects.link(linked)
    bpy.context.view_layer.objects.active = linked
    linked.select_set(True)
    assert effects.is_locked(linked)
    for operator in (bpy.ops.hfx.add_clip, bpy.ops.hfx.add_heartbeat, bpy.ops.hfx.remove_clip):
        assert not operator.poll()
    with pytest.raises(RuntimeError, match="linked file"):
        bpy.ops.hfx.remove_effects()
    assert bpy.ops.hfx.make_editable() == {"FINISHED"}
    ours = bpy.context.object
    assert ours.override_library.reference == linked and not effects.is_locked(ours)
    ours.hfx.amplitude = 3.0
    assert ours.hfx.amplitude == 3.0
    assert effects.effects_of(bpy.context.scene) == [ours], "in place of the linked effect"


def test_make_editable_reports_what_stays_linked(
    scene: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("Ball", "Bell"):
        ball(name)
    path = tmp_path / "props.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    collection, scene = link(path), bpy.context.scene
    collection.override_hierarchy_create(scene, bpy.context.view_layer)
    scene.collection.children.unlink(collection)
    for name, report in (
        ("Ball", "'Ball'; linked effects stay unchanged: Bell\n"),
        ("Bell", "'Bell'\n"),
    ):
        bpy.context.view_layer.objects.active = scene.objects[name]
        capfd.readouterr()
        assert bpy.ops.hfx.make_editable() == {"FINISHED"}
        assert f"1 effect can be changed: {report}" in capfd.readouterr().out


def test_an_override_can_be_muted_and_given_another_body(library: Path) -> None:
    (linked,) = link(library).objects
    for name in ("is_muted", "is_solo", "body", "modality", "shape", "temperature_reference"):
        assert linked.hfx.is_property_overridable_library(name), name


def test_a_linked_effect_without_its_body_is_left_out_with_one_warning(
    scene: Any, tmp_path: Path
) -> None:
    bpy.ops.hfx.add_avatar()
    for name in ("Touch", "Squeeze"):
        bpy.ops.hfx.add_painted(modality="pressure", name=name)
        bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    path = tmp_path / "touch.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    ball("Ball")
    link(path)
    bpy.context.view_layer.update()
    actual = scene_description.find(bpy.context.scene, bpy.context.view_layer)
    assert [effect.name for effect in actual.effects] == ["Ball"]
    (warning,) = actual.warnings
    assert warning.startswith(
        "2 effects were left out, as each belongs to body 'Avatar', which is not"
    )
    assert felt() == {"Ball"}


@pytest.fixture
def painted_library(scene: Any, tmp_path: Path) -> Path:
    """A file with two painted effects of a left palm, each with a clip."""
    bpy.ops.hfx.add_avatar()
    for name in ("Touch", "Squeeze"):
        bpy.ops.hfx.add_painted(modality="pressure", name=name)
        bpy.ops.hfx.fill_part(part="hand_palm", side="left")
        bpy.ops.hfx.add_clip(start=5.0)
    path = tmp_path / "touch.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    return path


def select(active: Any, *others: Any) -> None:
    for item in bpy.context.view_layer.objects:
        item.select_set(item == active or item in others)
    bpy.context.view_layer.objects.active = active


def own_effect() -> Any:
    bpy.ops.hfx.add_painted(modality="pressure", name="Own")
    bpy.ops.hfx.fill_part(part="chest")
    bpy.ops.hfx.add_clip(start=9.0)
    return bpy.context.object


def contents(effect: Any) -> tuple[Any, ...]:
    hfx = effect.hfx
    spans = [(strip.frame_start, strip.frame_end) for _, strip in clips.strips_of(effect)]
    return effects.area(effect), spans, hfx.pressure, hfx.body, effects.group_of(effect)


def test_tools_for_several_effects_change_the_editable_ones_and_name_the_linked(
    painted_library: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    link(painted_library)
    scene, own = bpy.context.scene, own_effect()
    linked = [effect for effect in effects.effects_of(scene) if effect.library is not None]
    before = [contents(effect) for effect in linked]
    own.hfx.pressure = 8.0
    ending = "; linked effects stay unchanged: Squeeze, Touch"

    def report(operator: Any, **options: object) -> str:
        capfd.readouterr()
        assert operator(**options) == {"FINISHED"}
        assert [contents(effect) for effect in linked] == before
        return capfd.readouterr().out.strip()

    assert report(bpy.ops.hfx.scale_strength, factor=0.5, scope="ALL").endswith("0.5: 1" + ending)
    assert own.hfx.pressure == 4.0
    assert report(bpy.ops.hfx.scale_frequency, scope="ALL").endswith("by 1" + ending)
    assert report(bpy.ops.hfx.modulate, scope="ALL").endswith("Effects modulated: 1" + ending)
    second = bpy.data.objects["Avatar"].copy()
    second.name = "Second"
    scene.collection.objects.link(second)
    second.hfx.uid = "second"
    moved = report(bpy.ops.hfx.move_to_body, body="Second", which="ALL")
    assert moved.endswith("Moved 1 effects to 'Second'" + ending) and own.hfx.body == second
    select(own, *linked)
    assert report(bpy.ops.hfx.move_to_group, group="NEW").endswith("Effects moved: 1" + ending)
    assert effects.group_of(own) == "Group"
    assert report(bpy.ops.hfx.remove_effects).endswith("Deleted 1 effect" + ending)
    assert effects.effects_of(scene) == linked


def test_a_linked_effect_of_a_missing_body_cannot_be_moved(
    painted_library: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Move to Body is disabled with the reason; a new body does not take the effect."""
    link(painted_library)
    scene = bpy.context.scene
    touch, squeeze = (bpy.data.objects[name] for name in ("Touch", "Squeeze"))
    assert effects.effects_without_body(scene) == [squeeze, touch]
    with bpy.context.temp_override(object=touch):
        assert not bpy.ops.hfx.move_to_body.poll()
    own = own_effect()
    with bpy.context.temp_override(object=own):
        assert bpy.ops.hfx.move_to_body.poll()
    foreign = touch.hfx.body
    bpy.data.objects.remove(bpy.data.objects["Avatar"])
    capfd.readouterr()
    bpy.ops.hfx.add_avatar()
    assert own.hfx.body == bpy.context.object and touch.hfx.body == foreign
    text = capfd.readouterr().out
    assert "deleted bodies: Own" in text and "Touch" not in text


@pytest.mark.parametrize("is_override", [False, True])
def test_tools_for_several_effects_leave_linked_effects_unchanged(
    painted_library: Path, is_override: bool
) -> None:
    """Blender would show the change, and lose the change with the file's next opening."""
    collection = link(painted_library)
    if is_override:
        scene = bpy.context.scene
        collection.override_hierarchy_create(scene, bpy.context.view_layer)
        scene.collection.children.unlink(collection)
    own = own_effect()
    linked = next(e for e in effects.effects_of(bpy.context.scene) if e.name == "Touch")
    before = contents(linked)
    select(own, linked)
    tools = [
        lambda: bpy.ops.hfx.scale_strength(factor=0.5),
        lambda: bpy.ops.hfx.scale_frequency(factor=0.5),
        bpy.ops.hfx.modulate,
        lambda: bpy.ops.hfx.move_to_group(group="NEW"),
        bpy.ops.hfx.remove_effects,
    ]
    of_active = [
        bpy.ops.hfx.area_copy,
        bpy.ops.hfx.copy_clips,
        lambda: bpy.ops.hfx.move_to_body(body="Avatar"),
    ]

    def refused(changes: list[Any]) -> None:
        for change in changes:
            with pytest.raises(
                RuntimeError, match=r"belongs to a linked file. Press Make Editable"
            ):
                change()
            assert contents(linked) == before

    refused(of_active[:2])
    select(linked)
    refused([*tools, of_active[2]])
    # From the linked effect to an effect of the file.
    select(linked, own)
    assert bpy.ops.hfx.area_copy() == {"FINISHED"}
    assert bpy.ops.hfx.copy_clips() == {"FINISHED"}
    assert effects.area(own) == effects.area(linked)
    assert len(clips.strips_of(own)) == 2
    assert contents(linked) == before


def test_the_area_of_an_override_is_changed_only_after_make_local(
    painted_library: Path, tmp_path: Path
) -> None:
    link(painted_library)
    own = own_effect()
    linked = next(e for e in effects.effects_of(bpy.context.scene) if e.name == "Touch")
    select(linked)
    bpy.ops.hfx.make_editable()
    ours = bpy.context.object
    before = effects.area(ours)
    for operator in (bpy.ops.hfx.paint_begin, bpy.ops.hfx.fill_part, bpy.ops.hfx.area_filter):
        assert not operator.poll()
    select(own, ours)
    with pytest.raises(RuntimeError, match=r"area of .Touch. belongs to a linked file.*Make Local"):
        bpy.ops.hfx.area_copy()
    assert effects.area(ours) == before
    select(ours)
    assert bpy.ops.object.make_local(type="SELECT_OBJECT") == {"FINISHED"}
    assert bpy.ops.hfx.fill_part(part="chest") == {"FINISHED"}
    expected = effects.area(bpy.context.object)
    assert expected != before
    saved = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    again = next(e for e in effects.effects_of(bpy.context.scene) if e.name == "Touch")
    assert effects.area(again) == expected


@pytest.mark.parametrize("is_override", [False, True])
def test_a_mirrored_copy_of_a_linked_effect_is_stored(
    painted_library: Path, tmp_path: Path, is_override: bool
) -> None:
    link(painted_library)
    linked = next(e for e in effects.effects_of(bpy.context.scene) if e.name == "Touch")
    select(linked)
    if is_override:
        bpy.ops.hfx.make_editable()
    before = set(effects.effects_of(bpy.context.scene))
    assert bpy.ops.hfx.effect_mirrored() == {"FINISHED"}
    (copy,) = set(effects.effects_of(bpy.context.scene)) - before
    assert not effects.is_locked(copy)
    uid, expected = copy.hfx.uid, effects.area(copy)
    assert expected[0] != effects.area(bpy.context.object)[0], "of the other hand"
    saved = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    (again,) = (e for e in effects.effects_of(bpy.context.scene) if e.hfx.uid == uid)
    assert effects.area(again) == expected
