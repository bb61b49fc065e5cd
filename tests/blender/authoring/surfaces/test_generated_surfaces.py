# SPDX-License-Identifier: GPL-3.0-or-later
"""Generated surfaces in Blender: material, relief as rendered by Cycles, and .blend file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.authoring.surfaces import generated_surfaces, surfaces
from hfx_blender.cli import run
from hfx_blender.formats.pictures import png
from hfx_blender.generation import generated, library_search
from hfx_blender.generation.generation_process import GenerationProcess
from hfx_blender.operators.surfaces import generation_operators


@pytest.fixture
def record(tmp_path: Path) -> Path:
    created = library_search.generate("deep corduroy, red", texels=128)
    return generated.write(created, tmp_path, "1.0").files[-1]


def plane(bpy: Any, size: float) -> Any:
    bpy.ops.mesh.primitive_plane_add(size=size)
    return bpy.context.object


def test_a_material_is_felt_and_baked_alike(registered: Any, scene: Any, record: Path) -> None:
    bpy = registered
    # The library's tile of 40 mm repeats twice across the plane, at true size.
    obj = plane(bpy, 0.08)
    material = generated_surfaces.apply_generated(obj, record)
    assert obj.active_material == material
    mapping = next(node for node in material.node_tree.nodes if node.type == "MAPPING")
    np.testing.assert_allclose(mapping.inputs["Scale"].default_value[:2], 2.0, rtol=1e-5)
    samples = surfaces.map_of(obj)
    written = generated.read(record)
    assert samples.size_m == pytest.approx((0.04, 0.04))
    np.testing.assert_allclose(samples.intensity, written.map.intensity, atol=2e-3)
    assert surfaces.texture_of(obj).height is not None  # the stroke pad has all renderers

    # Cycles, independent of the generator, bakes the same relief from the material's nodes.
    second = plane(bpy, 0.08)
    second.data.materials.append(material)
    surfaces.add_surface(second, "MATERIAL")
    second.hfx.surface.resolution = 256
    surfaces.make_maps(second)
    baked = surfaces.field_of(second).heights_m[:128, :128]
    truth = written.relief.height.heights_m
    assert np.corrcoef(baked.ravel(), truth.ravel())[0, 1] > 0.99
    assert np.ptp(baked) == pytest.approx(np.ptp(truth), rel=0.05)


def test_a_blend_and_pictures_come_from_words(
    registered: Any, scene: Any, tmp_path: Path, capsys: Any
) -> None:
    bpy = registered
    out = tmp_path / "made"
    arguments = ["texture", "generate", "red silk", "-o", str(out), "--resolution", "32"]
    assert run([*arguments, "--steps"]) == 0
    assert "nothing was painted" in capsys.readouterr().err
    (path,) = out.glob("*.blend")
    bpy.ops.wm.open_mainfile(filepath=str(path))
    swatch = bpy.data.objects["Swatch"]
    assert surfaces.is_surface(swatch) and swatch.active_material.asset_data is not None
    created = surfaces.map_of(swatch)
    assert set(np.rint(created.intensity * 6.5).ravel() / 6.5) <= {k / 6.5 for k in range(7)}
    # Blender's own image reader returns the written colours in their rows: red above green and
    # blue.
    image = bpy.data.images.load(str(next(out.glob("*.colour.png"))))
    red, green, blue = np.array(image.pixels[:]).reshape(-1, 4)[:, :3].mean(axis=0)
    assert red > 3.0 * max(green, blue)
    assert run(["texture", "generate", "qwertyx", "-o", str(out)]) == 3
    assert run(["texture", "generate", "", "-o", str(out)]) == 2


@pytest.fixture
def wanted(registered: Any, scene: Any) -> Iterator[Any]:
    """Set the panel to quick settings; restore the previous settings at the end."""
    settings = registered.context.window_manager.hfx_generation
    settings.words, settings.variations, settings.resolution = "oak", 2, 64
    yield settings
    for name in ("words", "variations", "resolution", "source", "picture"):
        settings.property_unset(name)
    generation_operators.results.clear()


def test_words_and_pictures_become_the_active_objects_material(
    registered: Any, wanted: Any, tmp_path: Path
) -> None:
    bpy = registered
    obj = plane(bpy, 0.1)
    assert bpy.ops.hfx.generate_surface() == {"FINISHED"}
    first = obj.active_material
    assert obj.hfx.surface.source == "GENERATED" and "Oak" in obj.hfx.surface.note
    assert '"words":"oak"' in first["hfx_generated"]
    assert len(generation_operators.results) == 2 and generation_operators.running is None
    relief = surfaces.field_of(obj).heights_m
    assert bpy.ops.hfx.use_generated(number=1) == {"FINISHED"}
    assert obj.active_material != first
    assert not np.array_equal(surfaces.field_of(obj).heights_m, relief)

    wanted.source, wanted.picture = "PICTURE", str(tmp_path / "p.png")
    codes = np.rint(np.tile(np.linspace(0, 255, 32), (32, 1))).astype(np.uint8)
    png.write(np.repeat(codes[:, :, None], 3, axis=2), tmp_path / "p.png")
    assert bpy.ops.hfx.generate_surface() == {"FINISHED"}
    field = surfaces.field_of(obj)
    assert field.size_m == pytest.approx((0.1, 0.1))
    # Brightness rises along x; whichever way of conversion there is, the rise is along x, too.
    assert np.ptp(field.heights_m.mean(axis=0)) > 2.0 * np.ptp(field.heights_m.mean(axis=1))


def test_a_wish_that_cannot_be_met_changes_nothing(registered: Any, wanted: Any) -> None:
    obj = plane(registered, 0.1)
    for words in ("qwertyx", " "):
        wanted.words = words
        with pytest.raises(RuntimeError, match=r"names a material|Describe the material"):
            registered.ops.hfx.generate_surface()
    assert obj.active_material is None and not surfaces.is_surface(obj)
    assert generation_operators.running is None and not generation_operators.results


def test_generation_is_cancelled_at_once(tmp_path: Path) -> None:
    job = {"back_end": "library", "words": "gravel", "negative": "", "seed": 0, "texels": 4096}
    child = GenerationProcess(
        {**job, "variations": 8, "use_steps": False, "folder": str(tmp_path), "version": "1"}
    )
    assert child.is_running
    child.cancel()
    assert not child.records and not list(tmp_path.iterdir())


def test_a_material_is_undone_and_redone(registered: Any, wanted: Any) -> None:
    bpy = registered
    wanted.variations = 1
    name = plane(bpy, 0.1).name
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.hfx.generate_surface() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="made")
    bpy.ops.ed.undo()
    obj = bpy.data.objects[name]
    assert obj.active_material is None and not surfaces.is_surface(obj)
    bpy.ops.ed.redo()
    obj = bpy.data.objects[name]
    assert obj.active_material.name == "oak"
    assert surfaces.map_of(obj).intensity.max() > 0.0
