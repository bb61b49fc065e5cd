# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief of a photograph: from the command line, and by the button on a material."""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.surfaces import image_values, surfaces
from hfx_blender.cli import run
from hfx_blender.engine.texture.relief.relief_estimate import estimate
from hfx_blender.formats.pictures import png, texture_map
from hfx_blender.operators.shared import HfxOperator, ModalTimer
from hfx_blender.operators.surfaces.surface_operators import HFX_OT_estimate_relief


@pytest.fixture
def photograph(registered: Any, tmp_path: Path) -> Path:
    """A grey picture of lit ribs, 64 x 32."""
    x = np.arange(64)
    light = np.rint(128 + 60 * np.cos(2 * np.pi * x / 16)).astype(np.uint8)
    path = tmp_path / "ribs.png"
    png.write(np.repeat(light[None], 32, axis=0), path)
    return path


@pytest.fixture
def painted(scene: Any, photograph: Path) -> Any:
    """A plane with a material that shows the photograph."""
    bpy.ops.mesh.primitive_plane_add(size=0.1)
    obj = bpy.context.object
    material = bpy.data.materials.new("Ribs")
    material.use_nodes = True
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(photograph))
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    obj.data.materials.append(material)
    return obj


def built(capsys: Any, *arguments: object) -> tuple[int, Any, str]:
    capsys.readouterr()
    code = run(["texture", "build", *map(str, arguments), "--json"])
    output = capsys.readouterr()
    return code, json.loads(output.out) if output.out else None, output.err


def test_a_photograph_gives_height_roughness_and_a_map(
    capsys: Any, photograph: Path, tmp_path: Path
) -> None:
    code, facts, _ = built(
        capsys, photograph, "--from", "relief", "--size", "20,10", "--tiles", "-o", tmp_path / "a"
    )
    names = {Path(name).name for name in facts["files"]}
    layers = {f"a.{layer}.png" for layer in ("height", "roughness", "intensity", "sharpness")}
    assert code == 0 and names == {"a.texture.json", *layers}
    heights, _ = png.read(tmp_path / "a.height.png")
    assert (heights.min(), heights.max()) == (0, 65535) and heights.shape == (32, 64)
    created = texture_map.read(tmp_path / "a.texture.json")
    assert created.tiles and created.size_m == pytest.approx((0.02, 0.01))
    assert facts["height_mm"] > 0.0 and "an estimate" in facts["notes"][0]

    code, taller, _ = built(
        capsys, photograph, "--from", "relief", "--size", "20,10", "--tiles", "-o", tmp_path / "b",
        "--height", facts["height_mm"] / 2,
    )  # fmt: skip
    assert taller["height_mm"] == pytest.approx(facts["height_mm"] / 2)
    half = texture_map.read(tmp_path / "b.texture.json").intensity
    assert np.allclose(half, created.intensity / 2, atol=2e-5)


def test_the_size_is_asked_for(capsys: Any, photograph: Path) -> None:
    code, _, messages = built(capsys, photograph, "--from", "relief")
    assert code == 2 and "--size" in messages and "ribs.png" in messages


def test_sobel_is_the_old_colours(capsys: Any, photograph: Path, tmp_path: Path) -> None:
    assert built(capsys, photograph, "--from", "sobel", "-o", tmp_path / "new")[0] == 0
    assert built(capsys, photograph, "--colours", "-o", tmp_path / "old")[0] == 0
    old, new = (texture_map.read(tmp_path / f"{n}.texture.json") for n in ("old", "new"))
    assert np.array_equal(old.intensity, new.intensity) and old.intensity.max() > 0.0


def test_the_button_makes_a_surface_of_the_material_s_picture(painted: Any) -> None:
    assert bpy.ops.hfx.estimate_relief(size_mm=(20.0, 10.0), tiles=True) == {"FINISHED"}
    picture = painted.active_material.node_tree.nodes["Image Texture"].image
    truth = estimate(image_values.colours_of(picture), (0.02, 0.01), tiles=True)
    settings, field = painted.hfx.surface, surfaces.field_of(painted)
    assert (settings.source, settings.image_kind) == ("IMAGE", "ESTIMATE")
    assert np.allclose(field.heights_m, truth.field.heights_m, atol=1e-9)
    created = surfaces.map_of(painted)
    assert created.size_m == pytest.approx((0.02, 0.01))
    # A texel of 0.31 mm is larger than the blur, so the slope is rendered as estimated.
    assert np.allclose(created.intensity, np.minimum(truth.slope, 1.0), atol=1e-5)
    assert np.allclose(1.0 - created.sharpness, truth.roughness, atol=1e-5)

    settings.height_mm *= 0.5
    assert np.allclose(surfaces.map_of(painted).intensity, 0.5 * created.intensity, atol=1e-5)


def test_without_a_picture_the_button_is_off(painted: Any) -> None:
    tree = painted.active_material.node_tree
    tree.links.remove(tree.nodes["Principled BSDF"].inputs["Base Color"].links[0])
    assert not bpy.ops.hfx.estimate_relief.poll()


class Window:
    """Stand-in for a window: counts timers and stores reports of the dialog's operator."""

    def __init__(self) -> None:
        self.object, self.scene = bpy.context.object, bpy.context.scene
        self.window, self.workspace, self.window_manager = None, self, self
        self.timers, self.reports = 0, []

    def event_timer_add(self, _pause: float, window: object) -> int:
        self.timers += 1
        return self.timers

    def event_timer_remove(self, _timer: int) -> None:
        self.timers -= 1

    def modal_handler_add(self, _operator: object) -> None: ...
    def status_text_set(self, _text: object) -> None: ...


def dialog(window: Window) -> Any:
    """The operator after the start of the dialog, without Blender's dialog itself."""
    bases = (HfxOperator, ModalTimer, HFX_OT_estimate_relief)
    methods = {name: member for base in bases for name, member in base.__dict__.items()}
    keep = ("begin", "_started", "modal", "cancel", "reported", "estimation")
    keep += ("_timer", "start_modal", "stop_timer")
    operator = type("Dialog", (), {name: methods[name] for name in keep})()
    operator.size_mm, operator.tiles = (20.0, 10.0), True
    operator.report = lambda level, text: window.reports.append((level, text))
    assert operator.reported(lambda: operator.begin(window)) == {"FINISHED"}
    return operator


def test_blender_goes_on_while_the_relief_is_estimated(painted: Any) -> None:
    window = Window()
    operator = dialog(window)
    assert operator.estimation.is_running
    moved, tick = SimpleNamespace(type="MOUSEMOVE"), SimpleNamespace(type="TIMER")
    assert operator.modal(window, moved) == {"PASS_THROUGH"}
    # The dialog was opened for the object active before.
    bpy.context.view_layer.objects.active = None
    until = time.monotonic() + 120.0
    while (state := operator.modal(window, tick)) == {"PASS_THROUGH"} and time.monotonic() < until:
        time.sleep(0.05)
    assert state == {"FINISHED"} and window.timers == 0
    assert painted.hfx.surface.image_kind == "ESTIMATE" and not surfaces.has_outdated_settings(
        painted
    )


def test_esc_ends_the_process_and_leaves_the_object_alone(painted: Any) -> None:
    window = Window()
    operator = dialog(window)
    estimation = operator.estimation
    esc = SimpleNamespace(type="ESC", value="PRESS")
    assert operator.modal(window, esc) == {"CANCELLED"}
    assert not estimation.is_running and window.timers == 0
    assert not surfaces.is_surface(painted)
