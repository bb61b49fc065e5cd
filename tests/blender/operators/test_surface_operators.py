# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of haptic surfaces: effect, messages, and data saved in a .blend."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.surfaces import surfaces
from hfx_blender.devices.configurations import surface_calibration
from hfx_blender.engine.texture.haptic_map import SurfaceRenderer
from hfx_blender.engine.texture.surface_names import DRIVE_PER_M
from hfx_blender.errors import InputError
from hfx_blender.formats.pictures import texture_map


@pytest.fixture
def plane(scene: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "user"))
    bpy.ops.mesh.primitive_plane_add(size=0.1)
    return bpy.context.object


@pytest.fixture
def denim(plane: Any) -> Any:
    plane.hfx.surface.resolution = 64
    bpy.ops.hfx.add_surface(source="PROCEDURAL", procedural="fabric-denim")
    return plane


def png16(path: Path, values: np.ndarray) -> Path:
    """A grey picture of 16 bits, top row first."""
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    size = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], 16, 0, 0, 0, 0)
    body = chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    return path


def test_a_library_surface_has_its_own_size_in_mm(denim: Any) -> None:
    field = surfaces.field_of(denim)
    assert denim.hfx.role == "EFFECT" and denim.hfx.kind == "SURFACE" and denim.hfx.uid
    assert field.size_m == pytest.approx((0.03, 0.03)) and field.tiles
    assert not surfaces.has_outdated_settings(denim) and np.ptp(field.heights_m) > 1e-5
    assert tuple(denim.color) == (1, 1, 1, 1) and not denim.hide_render


def test_the_maps_travel_with_the_file(denim: Any, tmp_path: Path) -> None:
    before = surfaces.texture_of(denim)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    obj = bpy.data.objects["Plane"]
    assert not surfaces.has_outdated_settings(obj)
    after = surfaces.texture_of(obj)
    assert np.array_equal(after.height.heights_m, before.height.heights_m)
    assert np.array_equal(after.map.intensity, before.map.intensity)


def test_parameters_make_the_map_stale_and_it_is_made_again(denim: Any) -> None:
    sharp = surfaces.map_of(denim).intensity
    denim.hfx.surface.blur_mm = 0.5
    assert surfaces.has_outdated_settings(denim)
    soft = surfaces.map_of(denim).intensity
    assert not surfaces.has_outdated_settings(denim) and soft.max() < 0.8 * sharp.max()
    denim.hfx.surface.full_slope = 0.5
    assert np.allclose(surfaces.map_of(denim).intensity, np.minimum(2.0 * soft, 1.0), atol=1e-5)


def test_steps_are_whole(denim: Any) -> None:
    denim.hfx.surface.use_steps = True
    haptic_map = surfaces.map_of(denim)
    levels = haptic_map.device.amplitude_m_s2(haptic_map.intensity) / 9.80665 / 0.2
    assert np.allclose(levels, np.rint(levels), atol=1e-3)


def test_a_copy_of_the_object_gets_maps_of_its_own_when_it_changes(denim: Any) -> None:
    copy = denim.copy()
    bpy.context.scene.collection.objects.link(copy)
    before = surfaces.field_of(denim).heights_m
    copy.hfx.surface.procedural = "wood-oak"
    surfaces.make_maps(copy)
    assert copy.hfx.surface.relief_image != denim.hfx.surface.relief_image
    assert np.array_equal(surfaces.field_of(denim).heights_m, before)


def test_an_image_of_16_bits_is_read_exactly(plane: Any, tmp_path: Path) -> None:
    values = np.arange(64 * 32, dtype=np.uint16).reshape(32, 64) * 31
    bpy.ops.hfx.add_surface(source="IMAGE")
    plane.hfx.surface.height_mm = 2.0
    bpy.ops.hfx.load_surface_image(filepath=str(png16(tmp_path / "h.png", values)))
    field = surfaces.field_of(plane)
    assert np.allclose(field.heights_m, values[::-1] / 65535.0 * 0.002, atol=2e-9)
    assert field.size_m == pytest.approx((0.1, 0.1))  # a UV unit of the plane


def test_an_images_colour_space_does_not_bend_its_heights(plane: Any, tmp_path: Path) -> None:
    values = np.full((16, 16), 32768, np.uint16)
    image = bpy.data.images.load(str(png16(tmp_path / "h.png", values)))
    assert image.colorspace_settings.name == "sRGB"
    bpy.ops.hfx.add_surface(source="IMAGE")
    plane.hfx.surface.image, plane.hfx.surface.height_mm = image, 1.0
    bpy.ops.hfx.bake_surface()
    assert surfaces.field_of(plane).heights_m == pytest.approx(0.0005, abs=1e-7)
    assert image.colorspace_settings.name == "sRGB"


def test_an_8_bit_photograph_is_taken_in_linear_light(plane: Any) -> None:
    image = bpy.data.images.new("Photo", 8, 8)
    image.pixels.foreach_set(np.tile([0.5, 0.5, 0.5, 1.0], 64).astype(np.float32))
    bpy.ops.hfx.add_surface(source="IMAGE")
    settings = plane.hfx.surface
    settings.image, settings.image_kind, settings.height_mm = image, "COLOUR", 1.0
    bpy.ops.hfx.bake_surface()
    # sRGB 0.5 is 0.2140 of linear light (8 bits: 128 / 255, 0.2158).
    assert surfaces.field_of(plane).heights_m == pytest.approx(0.000215, abs=3e-6)


def test_what_an_image_holds_stays_while_its_numbers_are_read(tmp_path: Path) -> None:
    from hfx_blender.authoring.surfaces import image_values

    path = tmp_path / "heights.exr"
    created = bpy.data.images.new("Made", 8, 8, float_buffer=True, is_data=True)
    created.pixels.foreach_set(np.linspace(0.0, 2.0, 256, dtype=np.float32))
    created.filepath_raw, created.file_format = str(path), "OPEN_EXR"
    created.save()
    user = bpy.data.images.load(str(path))
    user.colorspace_settings.name = "ACEScg"
    before = image_values.pixels_of(user)
    stored = np.linspace(0.0, 2.0, 256)[::4].reshape(8, 8)
    np.testing.assert_allclose(image_values.data_of(user), stored, atol=1e-6)
    path.unlink()
    with pytest.raises(InputError, match=r"Image 'heights\.exr'.*missing"):
        image_values.data_of(user)
    np.testing.assert_array_equal(image_values.pixels_of(user), before)


def test_nan_heights_are_holes_that_are_filled_or_refused(plane: Any) -> None:
    image = bpy.data.images.new("Holes", 16, 16, float_buffer=True, is_data=True)
    pixels = np.ones((16, 16, 4), np.float32)
    pixels[4:6, 4:6, :3] = np.nan
    image.pixels.foreach_set(pixels.ravel())
    bpy.ops.hfx.add_surface(source="IMAGE")
    plane.hfx.surface.image = image
    bpy.ops.hfx.bake_surface()
    assert "1.6%" in plane.hfx.surface.note
    assert np.ptp(surfaces.field_of(plane).heights_m) < 1e-9
    pixels[..., :3] = np.nan
    image.pixels.foreach_set(pixels.ravel())
    with pytest.raises(RuntimeError, match="100% of its heights are missing"):
        bpy.ops.hfx.bake_surface()
    assert plane.hfx.surface.is_faulty


def test_a_constant_image_is_silent(plane: Any) -> None:
    image = bpy.data.images.new("Flat", 16, 16)
    bpy.ops.hfx.add_surface(source="IMAGE")
    plane.hfx.surface.image = image
    bpy.ops.hfx.bake_surface()
    assert surfaces.map_of(plane).intensity.max() == 0.0


def test_a_scan_comes_in_its_own_millimetres(plane: Any, tmp_path: Path) -> None:
    x, y = np.meshgrid(np.linspace(0, 20, 41), np.linspace(0, 10, 21))
    z = np.cos(2 * np.pi * x / 5.0)
    table = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    np.savetxt(tmp_path / "s.xyz", table)
    bpy.ops.hfx.add_surface(source="SCAN")
    bpy.ops.hfx.load_scan(filepath=str(tmp_path / "s.xyz"))
    field = surfaces.field_of(plane)
    assert field.size_m == pytest.approx((0.02, 0.01), rel=0.02)
    assert field.heights_m.std() == pytest.approx(0.001 / np.sqrt(2.0), rel=0.06)


def test_exported_maps_come_back_the_same(denim: Any, tmp_path: Path) -> None:
    created = surfaces.map_of(denim)
    bpy.ops.hfx.export_texture(filepath=str(tmp_path / "denim.texture.json"), bits="16")
    bpy.ops.hfx.import_texture(filepath=str(tmp_path / "denim.texture.json"))
    settings, back = denim.hfx.surface, surfaces.map_of(denim)
    assert settings.source == "MAP" and "denim.texture.json" in settings.note
    assert np.abs(back.intensity - created.intensity).max() <= 0.51 / 65535
    assert back.size_m == pytest.approx(created.size_m)
    assert texture_map.read(tmp_path / "denim.texture.json").tiles
    settings.renderer = "TEXTILE"
    with pytest.raises(Exception, match="has no heights"):
        surfaces.texture_of(denim)


def test_a_map_with_values_that_are_none_is_refused_with_their_number(
    denim: Any, tmp_path: Path
) -> None:
    bpy.ops.hfx.export_texture(filepath=str(tmp_path / "denim.texture.json"), bits="8")
    bpy.ops.hfx.import_texture(filepath=str(tmp_path / "denim.texture.json"))
    image = denim.hfx.surface.sharpness_image
    pixels = np.array(image.pixels[:], np.float32)
    pixels[[0, 4, 8]] = np.nan, 1.5, 1.0005
    image.pixels.foreach_set(pixels)
    with pytest.raises(InputError, match=rf"2 of {pixels.size // 4} values.*'{image.name}'"):
        surfaces.texture_of(denim)


def test_removing_leaves_an_ordinary_object(denim: Any) -> None:
    bpy.ops.hfx.remove_surface()
    assert denim.hfx.role == "NONE" and not len(bpy.data.images)
    assert not denim.hfx.surface.made_of


def test_a_fault_is_told_and_the_surface_stays_to_be_put_right(plane: Any) -> None:
    plane.data.uv_layers.remove(plane.data.uv_layers[0])
    bpy.ops.hfx.add_surface(source="MATERIAL")
    assert surfaces.is_surface(plane) and plane.hfx.surface.is_faulty
    assert "no UV map" in plane.hfx.surface.note
    with pytest.raises(RuntimeError, match="no UV map"):
        bpy.ops.hfx.bake_surface()


def test_a_material_without_relief_is_felt_by_its_colour_or_told_flat(plane: Any) -> None:
    material = bpy.data.materials.new("Plain")
    if material.node_tree is None:
        material.use_nodes = True
    plane.data.materials.append(material)
    plane.hfx.surface.resolution = 16
    bpy.ops.hfx.add_surface(source="MATERIAL")
    assert "no relief: only its roughness" in plane.hfx.surface.note
    tree = material.node_tree
    checker = tree.nodes.new("ShaderNodeTexChecker")
    position = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(position.outputs["UV"], checker.inputs["Vector"])
    shader = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    tree.links.new(checker.outputs["Color"], shader.inputs["Base Color"])
    bpy.ops.hfx.bake_surface()
    assert "its colour was used" in plane.hfx.surface.note
    assert np.ptp(surfaces.field_of(plane).heights_m) > 1e-5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: bpy.ops.hfx.load_surface_image(filepath="/nowhere/x.png"),
            "there is no such file",
        ),
        (lambda: bpy.ops.hfx.load_scan(filepath="/nowhere/x.ply"), "there is no such file"),
        (lambda: bpy.ops.hfx.load_scan(filepath="/nowhere/x.stl"), "expected a point cloud"),
        (lambda: bpy.ops.hfx.import_texture(filepath="/nowhere/x.texture.json"), "x.texture.json"),
        (lambda: bpy.ops.hfx.export_texture(filepath="/nowhere/x.texture.json"), "cannot be"),
        (lambda: bpy.ops.hfx.add_surface(), "already"),
    ],
)
def test_bad_files_are_told(denim: Any, make: Any, message: str) -> None:
    with pytest.raises(RuntimeError, match=message):
        make()


def test_only_meshes_have_surfaces(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    with pytest.raises(RuntimeError, match="Select a mesh"):
        bpy.ops.hfx.add_surface()
    volume = bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE")
    assert volume == {"FINISHED"}
    with pytest.raises(RuntimeError, match="is a haptic effect already"):
        bpy.ops.hfx.add_surface()


def test_the_calibration_is_the_users_not_the_files(denim: Any) -> None:
    denim.hfx.surface.renderer = "TEXTILE"
    assert surfaces.texture_of(denim).drive_per_m == DRIVE_PER_M
    surface_calibration.store(25_000.0)
    assert surfaces.texture_of(denim).drive_per_m == pytest.approx(25_000.0)
    surface_calibration.store(5_000.0, "phone")
    assert surface_calibration.drive_per_m("phone") == pytest.approx(5_000.0)
    assert surface_calibration.drive_per_m("other") == pytest.approx(25_000.0)
    denim.hfx.surface.drive = 3.0
    actual = surfaces.texture_of(denim)
    assert (
        actual.drive_per_m == pytest.approx(3_000.0) and actual.renderer is SurfaceRenderer.TEXTILE
    )


def test_a_broken_calibration_is_as_if_there_were_none(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (tmp_path / "hfx").mkdir()
    path = tmp_path / "hfx" / "surface_calibration.json"
    for content in ("{", "[]", '{"": -1}', '{"": NaN}', '{"": true}', '{"": "x"}'):
        path.write_text(content)
        assert surface_calibration.drive_per_m() == DRIVE_PER_M


@pytest.mark.parametrize("suffix", [".wav", ".ahap", ".he", ".haptic", ".csv"])
def test_a_stroke_is_exported_in_every_format(
    denim: Any, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.engine.texture.stroke import along
    from hfx_blender.engine.texture.stroke_rendering import render_stroke
    from hfx_blender.operators.surfaces import stroke_pad_operators
    from hfx_blender.playback.stroke_pad import Take

    texture = surfaces.texture_of(denim)
    stroke = along(np.array([[0.0, 0.0], [0.03, 0.005]]), 0.1)
    take = Take(denim.name, texture, stroke, render_stroke(texture, stroke))
    monkeypatch.setattr(stroke_pad_operators, "last_take", take)
    bpy.ops.hfx.export_stroke(filepath=str(tmp_path / f"s{suffix}"))
    assert (tmp_path / f"s{suffix}").stat().st_size > 100


def test_a_stroke_is_asked_for_before_it_is_exported(scene: Any) -> None:
    from hfx_blender.operators.surfaces import stroke_pad_operators

    stroke_pad_operators.last_take = None
    with pytest.raises(RuntimeError, match="Stroke a surface first"):
        bpy.ops.hfx.export_stroke(filepath="x.wav")


def test_a_layer_that_is_the_same_everywhere_is_shown_as_grey_as_it_is(registered: Any) -> None:
    from hfx_blender.authoring.surfaces import image_values

    image = bpy.data.images.new("Even", 4, 4, float_buffer=True, is_data=True)
    for value in (0.0, 0.5, 1.0):
        image_values.set_preview(image, np.full((4, 4), value))
        pixels = np.array(image.preview.image_pixels_float).reshape(-1, 4)
        # A preview keeps bytes.
        np.testing.assert_allclose(pixels[:, :3], value, atol=1 / 255)
