# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on comes and goes without a trace, and every panel and menu can be drawn."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import hfx_scenes
import pytest

import hfx_blender
from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live.client import DeviceState
from hfx_blender.playback.live.live import Connected, live
from hfx_blender.processes import start
from hfx_blender.ui import menus
from hfx_blender.ui.panels import effect_panel, effects_panel, list_rows, live_panel


@pytest.fixture
def unregistered(scene: Any) -> Iterator[None]:
    """The add-on is off at first, and on again afterwards."""
    hfx_blender.unregister()
    try:
        yield
    finally:
        if not hasattr(bpy.types.Object, "hfx"):
            hfx_blender.register()


def _traces() -> dict[str, list[str]]:
    draws = {
        menu.__name__: [item.__name__ for item in getattr(menu.draw, "_draw_funcs", ())]
        for menu in (
            bpy.types.NLA_MT_add,
            bpy.types.OUTLINER_MT_object,
            bpy.types.TOPBAR_MT_file_export,
            bpy.types.TOPBAR_MT_window,
            bpy.types.VIEW3D_MT_add,
            bpy.types.VIEW3D_MT_object_context_menu,
        )
    }
    return {
        "types": sorted(name for name in dir(bpy.types) if "hfx" in name.lower()),
        "operators": sorted(name for name in dir(bpy.ops.hfx)),
        "object": [name for name in bpy.types.Object.bl_rna.properties.keys() if "hfx" in name],
        "scene": [name for name in bpy.types.Scene.bl_rna.properties.keys() if "hfx" in name],
        "handlers": sorted(
            handler.__module__
            for name in dir(bpy.app.handlers)
            if isinstance(handlers := getattr(bpy.app.handlers, name), list)
            for handler in handlers
            if handler.__module__.startswith("hfx_blender")
        ),
        **{
            name: [item for item in actual if "hfx" in item or item.startswith("_")]
            for name, actual in draws.items()
        },
    }


def test_off_is_as_if_it_had_never_been_there(unregistered: None) -> None:
    assert not hasattr(bpy.types.Object, "hfx") and not hasattr(bpy.types.Scene, "hfx")
    traces = _traces()
    assert not any(traces.values()), traces


def test_a_failing_registration_leaves_no_trace(
    unregistered: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Classes that stay registered hang a process of Blender 4.5's Python module at its end."""

    def fail() -> None:
        raise ZeroDivisionError

    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(cli, "register", fail)  # of the last module
        hfx_blender.register()
    traces = _traces()
    assert not any(traces.values()), traces


def test_a_blender_without_numpy_is_refused_with_the_package_to_install(
    unregistered: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = _traces()
    with monkeypatch.context() as without_numpy:
        without_numpy.setitem(sys.modules, "numpy", None)
        with pytest.raises(ModuleNotFoundError, match=r"NumPy, .* apt install python3-numpy$"):
            hfx_blender.register()
    assert _traces() == before


def test_on_again_is_as_before(scene: Any) -> None:
    before = _traces()
    assert before["types"] and before["operators"]
    for _ in range(2):
        hfx_blender.unregister()
        hfx_blender.register()
    assert _traces() == before
    assert hfx_scenes.small_scene().objects["Ball"].hfx.role == "EFFECT"


def test_scenes_keep_what_is_stored_while_it_is_off(scene: Any) -> None:
    hfx_scenes.small_scene()
    bpy.data.objects["Ball"].hfx.radius = 0.125
    hfx_blender.unregister()
    hfx_blender.register()
    assert bpy.data.objects["Ball"].hfx.radius == 0.125


def test_what_is_not_used_yet_is_not_imported() -> None:
    """Blender waits for all modules imported at the start."""
    heavy = (
        "hfx_blender.formats.hjif",
        "hfx_blender.formats.clip",
        "hfx_blender.engine.body.model",
        "hfx_blender.engine.evaluate",
        "hfx_blender.engine.rendering",
        "hfx_blender.engine.texture.height_field",
        "hfx_blender.engine.track",
        "hfx_blender.avatars.stored_fits",
        "hfx_blender.devices.live.client",
        "numpy",
        "scipy",
        "trimesh",
    )
    code = (
        "import bpy, os, sys; from hfx_blender.processes import blender_session; "
        "sys.modules.pop('numpy', None); "  # imported by the wheel, but not by Blender
        "blender_session.start(); "
        f"print('found:', *[name for name in {heavy} if name in sys.modules], flush=True); "
        "os._exit(0)"
    )
    fresh = subprocess.run(
        [sys.executable, "-c", code],
        env=start.environment(),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "found:" in fresh.stdout, fresh.stderr
    actual = next(line for line in fresh.stdout.splitlines() if line.startswith("found:"))
    assert actual.split()[1:] == []


# Drawing, with a layout checking the drawn items


class Layout:
    """Stand-in for Blender's layout, available only with a window."""

    ICONS = set(bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys())

    def __init__(self) -> None:
        self.shown: list[str] = []
        self.operators: list[tuple[str, Properties]] = []

    def label(self, *, text: str, icon: str = "NONE", translate: bool = True) -> None:
        self._show(text, icon)

    def prop(self, owner: Any, name: str, **options: str) -> None:
        assert name in owner.bl_rna.properties, name
        self._show(name, options.get("icon", "NONE"))

    def operator(self, idname: str, *, icon: str = "NONE", **_options: str) -> Any:
        return self._operator(idname, icon)

    def operator_menu_enum(
        self, idname: str, name: str, *, icon: str = "NONE", **_options: str
    ) -> Any:
        properties = self._operator(idname, icon)
        assert properties.bl_rna.properties[name].type == "ENUM"
        return properties

    def template_icon(self, icon_value: int, *, scale: float) -> None:
        self.shown.append("template_icon")

    def menu(self, idname: str, *, icon: str = "NONE", **_options: str) -> None:
        assert hasattr(bpy.types, idname)
        self._show(idname, icon)

    def template_list(self, kind: str, _name: str, *places: Any, **_options: int) -> None:
        owner, listed, active, index = places
        assert hasattr(bpy.types, kind)
        assert listed in owner.bl_rna.properties and index in active.bl_rna.properties
        self.shown.append(listed)

    def row(self, **_options: float) -> Layout:
        return self

    column = box = split = row

    def prop_enum(self, owner: Any, name: str, value: str, **_options: str) -> None:
        assert value in owner.bl_rna.properties[name].enum_items
        self.shown.append(name)

    def prop_decorator(self, owner: Any, name: str) -> None:
        assert name in owner.bl_rna.properties, name

    def separator(self) -> None:
        pass

    def context_pointer_set(self, name: str, _data: object) -> None:
        assert hasattr(bpy.context, name)

    def _operator(self, idname: str, icon: str) -> Any:
        module, _, name = idname.partition(".")
        actual = getattr(getattr(bpy.ops, module), name).get_rna_type()
        self._show(idname, icon)
        self.operators.append((idname, Properties(actual)))
        return self.operators[-1][1]

    def _show(self, what: str, icon: str) -> None:
        assert icon in self.ICONS, icon
        self.shown.append(what)


class Properties:
    """Accept only existing properties of the operator."""

    def __init__(self, bl_rna: Any) -> None:
        self.__dict__["bl_rna"] = bl_rna

    def __setattr__(self, name: str, value: object) -> None:
        actual = self.bl_rna.properties[name]
        if actual.type == "ENUM":
            assert value in actual.enum_items.keys()
        self.__dict__[name] = value


def drawn(draw: Callable[..., None], context: Any) -> list[str]:
    layout = Layout()
    draw(SimpleNamespace(layout=layout), context)
    return layout.shown


def test_the_panel_says_what_to_do_in_an_empty_scene(scene: Any) -> None:
    assert not effect_panel.HFX_PT_effect.poll(bpy.context)
    shown = drawn(effects_panel.HFX_PT_effects.draw, bpy.context)
    assert "First choose a body" in " ".join(shown)
    assert shown[-2:] == ["hfx.add_avatar", "HFX_MT_add"]
    bpy.ops.hfx.add_avatar()
    shown = drawn(effects_panel.HFX_PT_effects.draw, bpy.context)
    assert "Add an effect" in " ".join(shown)
    assert shown[-2:] == ["hfx.add_painted", "HFX_MT_add"]
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE")
    shown = " ".join(drawn(effects_panel.HFX_PT_effects.draw, bpy.context))
    assert "First" not in shown and "Next" not in shown


def test_painting_a_further_effect_is_as_near_as_the_first(scene: Any) -> None:
    """All three menus add an effect and start painting."""
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    for draw in (
        menus.draw_header,
        effects_panel.HFX_PT_effects.draw,
        menus.HFX_MT_add.draw,
    ):
        layout = Layout()
        draw(SimpleNamespace(layout=layout), bpy.context)
        added = [item for name, item in layout.operators if name == "hfx.add_painted"]
        assert [item.paint for item in added] == [True]


@pytest.mark.parametrize(
    ("modality", "own"),
    [
        ("vibration", {"amplitude", "frequency"}),
        ("pressure", {"pressure"}),
        ("temperature", {"temperature", "temperature_reference"}),
        ("wind", {"wind_speed"}),
    ],
)
@pytest.mark.parametrize(
    ("shape", "dimensions"),
    [
        ("CUBOID", {"size"}),
        ("SPHERE", {"radius"}),
        ("CYLINDER", {"radius", "height"}),
        ("CAPSULE", {"radius", "height"}),
    ],
)
def test_the_panel_shows_what_the_effect_has(
    scene: Any, modality: str, own: set[str], shape: str, dimensions: set[str]
) -> None:
    bpy.ops.hfx.add_volume(modality=modality, shape=shape)
    shown = drawn(effect_panel.HFX_PT_effect.draw, bpy.context)
    always = {"name", "modality", "intensity", "shape", "falloff"}
    assert always | own | dimensions <= set(shown)
    others = {"amplitude", "pressure", "temperature", "wind_speed", "size", "radius", "height"}
    assert not (others - own - dimensions) & set(shown)
    bpy.context.object.hfx.falloff = "linear"
    assert "falloff_share" in drawn(effect_panel.HFX_PT_effect.draw, bpy.context)


def test_the_panel_of_a_painted_effect_and_while_it_is_painted(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    effect = bpy.context.object
    assert "body" not in drawn(effect_panel.HFX_PT_effect.draw, bpy.context)
    bpy.ops.hfx.add_avatar()
    bpy.context.view_layer.objects.active = effect
    assert "body" in drawn(effect_panel.HFX_PT_effect.draw, bpy.context)  # a choice
    area = drawn(effect_panel.HFX_PT_area.draw, bpy.context)
    assert {"hfx.paint_begin", "hfx.fill_part"} <= set(area)
    more = drawn(effect_panel.HFX_PT_area_transfer.draw, bpy.context)
    assert more.count("hfx.area_filter") == 5 and "hfx.area_copy" in more
    bpy.ops.hfx.paint_begin()
    assert drawn(effect_panel.HFX_PT_effect.draw, bpy.context) == ["Painting 'Painted Pressure'"]
    area = drawn(effect_panel.HFX_PT_area.draw, bpy.context)
    assert {"hfx.paint_end", "hfx.add_clip"} <= set(area) and "hfx.paint_begin" not in area
    assert drawn(menus.draw_header, bpy.context) == ["hfx.paint_end", "hfx.add_clip"]


@pytest.mark.parametrize(("width", "shown"), [(1400, 2), (1050, 1), (950, 0)])
def test_buttons_in_a_narrow_header_yield_to_those_of_blender(
    scene: Any, monkeypatch: pytest.MonkeyPatch, width: int, shown: int
) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE")
    scale = bpy.context.preferences.system.ui_scale or 1.0
    context = SimpleNamespace(
        object=bpy.context.object,
        scene=scene,
        preferences=bpy.context.preferences,
        region=SimpleNamespace(width=width * scale),
    )
    assert drawn(menus.draw_header, context) == ["hfx.add_painted", "hfx.add_clip"][2 - shown :]


def test_the_list_of_effects_and_the_clips_of_the_active_one(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Gust")
    rows = drawn(effects_panel.HFX_PT_effects.draw, bpy.context)
    assert {"hfx_preview", "palette", "hfx_rows"} <= set(rows)
    shown = drawn(effects_panel.HFX_PT_clips.draw, bpy.context)
    assert "No clips: on for the whole timeline" in shown
    assert drawn(effects_panel.HFX_PT_clips.draw_header_preset, bpy.context) == ["time_unit"]
    bpy.ops.hfx.add_clip()
    shown = drawn(effects_panel.HFX_PT_clips.draw, bpy.context)
    assert "hfx.copy_clips" in shown and "repeat" not in shown
    list_rows.refresh()
    shown = drawn(effects_panel.HFX_PT_clips.draw, bpy.context)
    assert {"start", "end", "fade_in", "fade_out", "repeat", "hfx.remove_clip"} <= set(shown)
    assert shown.count("template_icon") == 1


def test_a_row_names_the_body_of_its_effect_among_several(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    anna = bpy.context.object
    anna.name = "Anna"
    bpy.ops.hfx.add_on_part(modality="vibration", part="torso")
    effect = bpy.context.object
    for name in ("Anna", "Ben"):
        list_rows.refresh()
        row = bpy.context.window_manager.hfx_rows[effect.name]
        layout = Layout()
        draw = list_rows.HFX_UL_effects.draw_item
        draw(None, bpy.context, layout, None, row, 0, None, "")
        assert layout.shown[:2] == ["is_selected", "name"]
        assert layout.shown[-2:] == ["is_solo", "is_muted"]
        assert ("Anna" in layout.shown) == (name == "Ben"), layout.shown
        bpy.ops.hfx.add_avatar()
        bpy.context.object.name = "Ben"


def test_the_export_panel_and_the_menus(scene: Any) -> None:
    bpy.context.scene.hfx.devices.add().name = "back_pad"
    shown = drawn(effects_panel.HFX_PT_export.draw, bpy.context)
    assert shown[:3] == ["is_exported", "hfx.live_add", "hfx.export"]
    assert drawn(effects_panel.HFX_PT_sampling.draw, bpy.context) == ["rate", "tolerance"]
    assert "hfx.volume_from_mesh" in drawn(menus.HFX_MT_add.draw, bpy.context)
    assert drawn(menus.draw_add_menu, bpy.context) == ["HFX_MT_add"]
    assert drawn(menus._ENTRIES["TOPBAR_MT_file_export"], bpy.context) == ["hfx.export"]


def test_the_context_menu_is_that_of_the_active_object(scene: Any) -> None:
    assert (
        drawn(menus.draw_object_menu, bpy.context) == drawn(menus.draw_nla_menu, bpy.context) == []
    )
    bpy.ops.hfx.add_avatar()
    assert drawn(menus.draw_object_menu, bpy.context) == ["HFX_MT_object"]
    shown = drawn(menus.HFX_MT_object.draw, bpy.context)
    assert shown == ["hfx.add_painted", "hfx.paste_effects"]
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE")
    shown = drawn(menus.HFX_MT_object.draw, bpy.context)
    assert {"hfx.add_clip", "is_muted", "is_solo", "hfx.copy_effects"} <= set(shown)
    assert "hfx.paint_begin" not in shown
    assert drawn(menus.draw_nla_menu, bpy.context) == ["hfx.add_clip", "hfx.add_heartbeat"]
    bpy.ops.hfx.add_painted(modality="wind")
    shown = drawn(menus.HFX_MT_object.draw, bpy.context)
    assert {"hfx.paint_begin", "hfx.effect_mirrored"} <= set(shown)


def test_the_command_line_within_blender(scene: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run_in_blender(["--version"]) == 0
    assert cli.run_in_blender(["--help"]) == 0
    assert "blender --command hfx" in capsys.readouterr().out
    assert cli.run_in_blender(["dance"]) == 2


def test_address_and_code_of_a_page_are_above_every_notice(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    phone = "phone_lra"
    scene.hfx.devices.add().name = phone
    state = DeviceState(0, phone, "frozen", unit="http://192.168.1.5:8137 code 042137")
    connected = Connected(load_device(phone), has_script=False, offset_ms=0.0)
    monkeypatch.setattr(live, "client", SimpleNamespace(devices={phone: state}))
    monkeypatch.setattr(live, "connected", {phone: connected})
    shown = drawn(live_panel.HFX_PT_live.draw, bpy.context)
    address, code = shown.index("192.168.1.5:8137"), shown.index("042137")
    notice = next(k for k, text in enumerate(shown) if text.startswith("Devices stopped"))
    assert address < code < notice
    assert shown.count("042137") == 1


def test_the_panel_shows_clips_in_the_order_of_time_and_times_of_the_selected(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Gust")
    for frame in (50.0, 1.0, 100.0):
        bpy.ops.hfx.add_clip(start=frame)
    list_rows.refresh()
    layout = Layout()
    drawn_props = []
    monkeypatch.setattr(layout, "prop", lambda owner, name, **_: drawn_props.append((owner, name)))
    effects_panel.HFX_PT_clips.draw(SimpleNamespace(layout=layout), bpy.context)
    names = [owner.frame_start for owner, name in drawn_props if name == "name"]
    assert names == [1.0, 50.0, 100.0]
    starts = [owner.start for owner, name in drawn_props if name == "start"]
    assert starts == [100.0], "the clip just added"


def test_switches_of_a_linked_effect_are_those_of_the_object(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blender greys them out, and says in the tooltip that the data-block is linked."""
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Gust")
    path = tmp_path / "gust.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, expected):
        expected.objects = ["Gust"]
    bpy.context.scene.collection.objects.link(expected.objects[0])
    list_rows.refresh()
    owners = {}
    layout = Layout()
    monkeypatch.setattr(layout, "prop", lambda owner, name, **_: owners.update({name: owner}))
    row = bpy.context.window_manager.hfx_rows["Gust"]
    list_rows.HFX_UL_effects.draw_item(None, bpy.context, layout, None, row, 0, None, "")
    assert owners["is_muted"] == owners["is_solo"] == expected.objects[0].hfx
    assert owners["is_selected"] == row
