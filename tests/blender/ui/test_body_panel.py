# SPDX-License-Identifier: GPL-3.0-or-later
"""Sidebar panel of a haptic body, and the perceptual model shown on the avatar."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from mathutils import Vector  # noqa: E402
from own_avatar import opened  # noqa: E402

from hfx_blender.avatars import bodies, body_binding, model_mesh, stored_fits  # noqa: E402
from hfx_blender.engine.body.model import load_avatar, load_model  # noqa: E402
from hfx_blender.engine.retargeting.quality import FitQuality, PartQuality  # noqa: E402
from hfx_blender.properties.objects import BONE_REGIONS  # noqa: E402
from hfx_blender.ui.panels import body_panel  # noqa: E402
from hfx_blender.ui.panels.body_panel import label_of, region_of  # noqa: E402


class Layout:
    """Stand-in for Blender's layout: records drawn items, and checks that each item exists."""

    ICONS = set(bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys())

    def __init__(self) -> None:
        self.shown: list[str] = []

    def row(self, **_options: object) -> Layout:
        return self

    column = split = row

    def label(self, *, text: str, icon: str = "NONE", translate: bool = True) -> None:
        assert icon in self.ICONS, icon
        self.shown.append(text)

    def prop(self, owner: Any, name: str, **_options: object) -> None:
        assert name in owner.bl_rna.properties, name
        self.shown.append(name)

    def prop_search(self, owner: Any, name: str, where: Any, what: str, **_options: object) -> None:
        assert name in owner.bl_rna.properties and what in where.bl_rna.properties
        self.shown.append(getattr(owner, name))

    def operator(self, idname: str, *, icon: str = "NONE", **_options: object) -> None:
        assert icon in self.ICONS and hasattr(bpy.types, f"HFX_OT_{idname[4:]}"), idname
        self.shown.append(idname)

    def operator_menu_enum(self, idname: str, name: str, *, icon: str = "NONE") -> None:
        self.operator(idname, icon=icon)
        properties = getattr(bpy.ops.hfx, idname[4:]).get_rna_type().properties
        assert properties[name].type == "ENUM"

    def template_list(self, kind: str, _id: str, *where: object, **_options: object) -> None:
        assert hasattr(bpy.types, kind)
        self.shown.append(kind)


def drawn(panel: Any) -> list[str]:
    owner = SimpleNamespace(layout=Layout())
    panel.draw(owner, bpy.context)
    return owner.layout.shown


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    return opened(is_fitted=True)


def test_every_canonical_bone_has_a_name_of_its_own() -> None:
    bones = load_avatar().skeleton.bone_names
    assert len({label_of(bone) for bone in bones}) == len(bones)
    assert label_of("upperarm01.L") == "Upper Arm L"
    assert label_of("finger2-3.R") == "Index 3 R"
    assert label_of("spine05") == "Spine 1" and label_of("spine01") == "Spine 5"
    regions = [region_of(bone) for bone in bones]
    assert {region: regions.count(region) for region in ("HANDS", "FEET")} == {
        "HANDS": 2 * (15 + 4),
        "FEET": 2 * 14,
    }
    assert set(regions) == {identifier for identifier, _, _ in BONE_REGIONS}


def test_an_armature_can_become_a_body(scene: Any) -> None:
    assert not body_panel.HFX_PT_body.poll(bpy.context)
    opened()
    assert body_panel.HFX_PT_body.poll(bpy.context)
    assert drawn(body_panel.HFX_PT_body) == ["'Anna' is not a haptic body yet", "hfx.mark_body"]
    assert drawn(body_panel.HFX_PT_bones) == ["hfx.find_bones", "hfx.load_bones"]
    assert not body_panel.HFX_PT_fit.poll(bpy.context)


def test_the_panel_of_a_body_and_of_its_mesh_is_the_same(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    expected = [
        *("Anna", "Anna Skin", "follow", "felt_layer", "Follows the bones"),
        *("hfx.fit_body", "hfx.show_model"),
    ]
    for active in (rig, skin):
        bpy.context.view_layer.objects.active = active
        assert drawn(body_panel.HFX_PT_body) == expected


def test_the_panel_says_what_poses_the_body_and_why(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    skin.modifiers["Armature"].use_deform_preserve_volume = True
    assert "is measured during" in body_panel.how_followed(rig)
    body_binding.surface_reason(rig)
    said = body_panel.how_followed(rig)
    assert said == "Follows the evaluated surface, because Preserve Volume is on"
    rig.hfx.follow = "BONES"
    body_binding.warning_of(rig)
    assert (
        body_panel.how_followed(rig)
        == "Follows the bones, although other modifiers deform the avatar"
    )
    rig.hfx.follow, rig.hfx.avatar = "SURFACE", None
    assert "has no mesh" in body_panel.how_followed(rig)


def test_the_built_in_avatar_needs_no_fit(scene: Any) -> None:
    bodies.add_avatar(bpy.context)
    shown = drawn(body_panel.HFX_PT_body)
    assert "hfx.fit_body" not in shown and "hfx.show_model" in shown
    assert not body_panel.HFX_PT_fit.poll(bpy.context)


def test_the_bone_table_says_how_each_joint_came_to_its_bone(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    rows = rig.hfx.bone_map
    rig.hfx.bone_map_active = rows.find("jaw")
    shown = drawn(body_panel.HFX_PT_bones)
    assert "HFX_UL_bones" in shown and "hfx.save_bones" in shown and "hfx.reset_bones" in shown
    assert "Jaw: no bone found; follows" in " ".join(shown)
    rows["wrist.R"].bone = "Paw"
    rows["wrist.L"].bone = ""
    rows["neck01"].bone = "mixamorig:Spine2"
    icons = {
        name: body_panel.icon_of(rows[name], rig)
        for name in ("head", "jaw", "wrist.R", "wrist.L", "neck01")
    }
    assert icons == {
        "head": "CHECKMARK",
        "jaw": "FILE_PARENT",
        "wrist.R": "ERROR",
        "wrist.L": "GREASEPENCIL",
        "neck01": "GREASEPENCIL",
    }
    sentence = body_panel.sentence_of(rows["wrist.L"], rig)
    assert sentence == (
        "Hand L: none, by hand (found: 'mixamorig:LeftHand'); follows 'mixamorig:LeftForeArm'"
    )


def test_the_list_shows_a_region_and_searches_all(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    owner = SimpleNamespace(filter_name="", bitflag_filter_item=1 << 30)
    counts = {}
    for region in ("BODY", "HANDS", "FEET", "FACE"):
        rig.hfx.bone_map_region = region
        flags, order = body_panel.HFX_UL_bones.filter_items(owner, bpy.context, rig.hfx, "bone_map")
        counts[region] = sum(map(bool, flags))
        assert order == [] and len(flags) == 163
    assert sum(counts.values()) == 163 and counts["HANDS"] == 38 and counts["BODY"] == 38
    owner.filter_name = "index 2"
    flags, _ = body_panel.HFX_UL_bones.filter_items(owner, bpy.context, rig.hfx, "bone_map")
    assert sum(map(bool, flags)) == 2
    layout = Layout()
    row = rig.hfx.bone_map["head"]
    body_panel.HFX_UL_bones.draw_item(None, bpy.context, layout, rig.hfx, row, 0, rig.hfx, "")
    assert layout.shown == ["Head", "mixamorig:Head"]


def test_the_quality_of_the_fit_is_kept_and_shown(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    qualities = stored_fits.quality_of(rig)
    assert [quality.model_id for quality in qualities] == stored_fits.model_ids(rig)
    assert all(len(quality.parts) == 11 and quality.sides > 0.95 for quality in qualities)
    shown = drawn(body_panel.HFX_PT_fit)
    assert {"Head", "Trunk", "Soles with Toes"} <= set(shown)
    assert any(text.startswith("On its own side: ") for text in shown)
    # Warnings of the fit stay readable later.
    text = " ".join(shown)
    assert "single toes of the left" in text


def test_the_worst_part_comes_first() -> None:
    def quality(model: str, head: tuple[float, float, float]) -> FitQuality:
        distance, in_place, area = head
        parts = (
            PartQuality("torso", 1.0, 3.0, 1.0, 1.0),
            PartQuality("head", 1.0, distance, in_place, area),
            PartQuality("foot_sole", 1.0, 12.0, 1.0, 1.0),
        )
        return FitQuality(model, parts, 1.0, 1.0)

    def order(*heads: tuple[float, float, float]) -> list[str]:
        worst_first = stored_fits.worst_first([quality("m", head) for head in heads])
        return [part.part for part in worst_first]

    assert order((1.0, 1.0, 1.0)) == ["foot_sole", "torso", "head"]
    assert order((1.0, 0.7, 1.0)) == ["head", "foot_sole", "torso"]
    assert order((1.0, 1.0, 3.0)) == ["head", "foot_sole", "torso"]
    assert order((1.0, 1.0, 1.0), (20.0, 1.0, 1.0)) == ["head", "foot_sole", "torso"]


@pytest.mark.parametrize("model", ["pressure", "temperature"])
def test_a_model_is_shown_on_the_avatar_and_removed_without_a_trace(
    anna: tuple[Any, Any], model: str
) -> None:
    rig, skin = anna

    def state() -> dict[str, list[str]]:
        kinds = ("objects", "meshes", "materials", "collections")
        return {kind: [block.name for block in getattr(bpy.data, kind)] for kind in kinds}

    before = state()
    bone = rig.pose.bones["mixamorig:LeftForeArm"]
    bone.rotation_mode, bone.rotation_euler = "XYZ", (0.7, 0.0, 0.3)
    bpy.ops.hfx.show_model(model=model)
    (obj,) = model_mesh.shown_meshes(rig)
    assert obj.hide_render and len(obj.data.vertices) == len(load_model(f"hfx-{model}-1"))
    graph = bpy.context.evaluated_depsgraph_get()
    posed = obj.evaluated_get(graph)
    world = np.array([posed.matrix_world @ vertex.co for vertex in posed.data.vertices])
    avatar = skin.evaluated_get(graph)
    to_skin = avatar.matrix_world.inverted()
    scale = avatar.matrix_world.to_scale()[0]
    height = [
        scale * (avatar.closest_point_on_mesh(to_skin @ position)[1] - to_skin @ position).length
        for position in map(Vector, world[:: max(len(world) // 200, 1)].tolist())
    ]
    # 2 mm over the skin, plus the coarseness of the avatar.
    assert np.median(height) == pytest.approx(0.002, abs=0.001)
    bpy.ops.hfx.show_model(model=model)
    assert state() == before and bpy.context.object == rig


def test_another_model_takes_the_place_of_the_one_shown(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    bpy.ops.hfx.show_model(model="pressure")
    bpy.ops.hfx.show_model(model="temperature")
    assert [obj[model_mesh.MODEL] for obj in model_mesh.shown_meshes(rig)] == ["hfx-temperature-1"]
    bpy.ops.hfx.fit_body()  # a shown model is updated by a new fit
    assert [obj[model_mesh.MODEL] for obj in model_mesh.shown_meshes(rig)] == ["hfx-temperature-1"]
