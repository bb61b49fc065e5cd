# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene's volumes as glTF nodes and draft triggers, with positions and times."""

from __future__ import annotations

import io
import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from gltf_validator import gltf_faults

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.response_filters.controls import ContactLaw
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticSurface,
    HapticVolume,
    SceneDescription,
    SurfaceBinding,
    TimeBase,
)
from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff
from hfx_blender.formats.glb import glb, glb_scene
from hfx_blender.formats.pictures import png
from hfx_tools.formats import glb_rules

SCHEMA = Path(__file__).resolve().parents[2] / "docs/formats/scene-volume.schema.json"

TETRAHEDRON = MeshVolume(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32),
    name="corner",
)
COUNT = 12


def turned(angle, axis):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def placed(rotation=None, scale=(1, 1, 1), at=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if rotation is None else rotation) @ np.diag(scale)
    matrix[:3, 3] = at
    return matrix


def recorded(shape, matrices, levels=None, law=None):
    effect = EffectDescription(
        "e", "Wall é", "vibration", "hfx-vibration-1", HapticVolume(Falloff(), law=law)
    )
    time = TimeBase(Fraction(24), Fraction(24), 1, 1, COUNT)
    recorder = glb_scene.VolumeRecorder(SceneDescription(time, (), (effect,)))
    levels = np.ones(COUNT) if levels is None else np.asarray(levels)
    for first in range(0, COUNT, 5):  # each block repeats the row before as history
        rows = np.arange(max(first - 1, 0), min(first + 5, COUNT))
        block = EffectBlock(levels[rows], np.zeros((len(rows), 2)), matrices[rows], (shape,))
        recorder.add(AnimationBlock(rows, (block,), (), history=int(first > 0)))
    return recorder


def written(recorder, folder):
    result = recorder.write([load_model("hfx-temperature-1")], folder / "x", "x.hjif")
    data = result.files[0].read_bytes()
    assert glb_rules.validate(data, "x") == [] and gltf_faults(result.files[0]) == []
    return glb.read_json(data, "x"), data, result


STILL = np.tile(placed(turned(0.5, (1, 2, 3)), (1, 2, 3), (0.5, -1, 2)), (COUNT, 1, 1))


@pytest.mark.parametrize(
    ("shape", "kind", "members"),
    [
        (Cuboid(), 0, {"width": 2.0, "height": 2.0, "length": 2.0}),
        (Sphere(), 4, {"radius": 1.0}),
        (Cylinder(), 2, {"radius": 1.0, "length": 2.0}),
        (Capsule(0.5), 3, {"radius": 1.0, "topCentroid": [0, 0, 0.5]}),
    ],
)
def test_a_shape_is_a_trigger_at_its_position(tmp_path, shape, kind, members):
    actual, _, _ = written(recorded(shape, STILL), tmp_path)
    interactivity = actual["extensions"]["MPEG_interactivity"]
    (trigger,) = interactivity["triggers"]
    (primitive,) = trigger["primitives"]
    assert primitive["type"] == kind and members.items() <= primitive.items()
    matrix = np.array(primitive["transformationMatrix"]).reshape(4, 4).T
    point = STILL[0] @ [0.3, -0.2, 0.9, 1.0]
    np.testing.assert_allclose(matrix @ [0.3, -0.2, 0.9, 1.0], [point[0], point[2], -point[1], 1])
    assert interactivity["actions"][0]["type"] == 7
    assert actual["extensions"]["MPEG_media"]["media"][0]["alternatives"][0]["uri"] == "x.hjif"


def test_extensions_are_used_and_never_required(tmp_path):
    actual, _, _ = written(recorded(Sphere(), STILL), tmp_path)
    assert actual["extensionsUsed"] == ["MPEG_interactivity", "MPEG_media"]
    assert "extensionsRequired" not in actual


def test_a_mesh_is_a_mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    actual, data, _ = written(recorded(TETRAHEDRON, STILL), tmp_path)
    assert "primitives" not in actual["extensions"]["MPEG_interactivity"]["triggers"][0]
    loaded = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
    assert sorted(len(vertices.faces) for vertices in loaded.geometry.values())[0] == 4


def test_a_moving_volume_is_animated(tmp_path):
    angles = np.linspace(0.0, 7.0, COUNT)
    matrices = np.stack([placed(turned(a, (0, 0, 1)), (1, 2, 0.5), (a, 0, 1)) for a in angles])
    actual, data, _ = written(recorded(Cuboid(), matrices), tmp_path)
    (animation,) = actual["animations"]
    binary = data[data.index(b"BIN\0") + 4 :]

    def column(index):
        accessor = actual["accessors"][index]
        view = actual["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, "<f4").reshape(-1, width)

    paths = {
        channel["target"]["path"]: column(animation["samplers"][channel["sampler"]]["output"])
        for channel in animation["channels"]
    }
    times = column(animation["samplers"][0]["input"])[:, 0]
    np.testing.assert_allclose(times, np.arange(COUNT) / 24.0, atol=1e-6)
    np.testing.assert_allclose(
        paths["translation"], np.stack([angles, angles * 0 + 1, angles * 0], 1), atol=1e-6
    )
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    for k in range(COUNT):
        x, y, z, w = paths["rotation"][k].astype(float)
        assert np.linalg.norm([x, y, z, w]) == pytest.approx(1.0, abs=1e-6)
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        again = rotation @ np.diag(actual["nodes"][0]["scale"])  # constant scale
        np.testing.assert_allclose(again, turn @ matrices[k][:3, :3], atol=1e-5)
    steps = (paths["rotation"][1:] * paths["rotation"][:-1]).sum(axis=1)
    assert (steps > 0.0).all()  # the short way round


def test_mirrored_and_sheared_volumes(tmp_path):
    mirrored = np.stack([placed(None, (-1, 1, 1), (k, 0, 0)) for k in range(COUNT)])
    actual, _, result = written(recorded(Cuboid(), mirrored), tmp_path)
    assert np.prod(actual["nodes"][0]["scale"]) == pytest.approx(-1.0)
    assert not result.notes
    sheared = mirrored.copy()
    sheared[:, 0, 1] = 0.5
    assert "sheared" in written(recorded(Cuboid(), sheared), tmp_path)[2].notes[0]


def test_a_never_active_volume_is_reported(tmp_path):
    actual, _, result = written(recorded(Sphere(), STILL, np.zeros(COUNT)), tmp_path)
    assert "never active" in result.notes[0] and "extensions" not in actual


def test_rows_without_a_level_are_left_out(tmp_path):
    matrices = STILL.copy()
    matrices[3] = np.nan
    levels = np.ones(COUNT)
    levels[3] = 0.0
    actual, _, _ = written(recorded(Sphere(), matrices, levels), tmp_path)
    assert "animations" not in actual


def test_triggers_without_files_are_reported(tmp_path):
    sheared = STILL.copy()
    sheared[:, 0, 1] += 0.5
    assert written(recorded(Cuboid(), sheared), tmp_path)[2].notes == ()  # a matrix holds shear
    alone = recorded(Cuboid(), STILL).write([load_model("hfx-temperature-1")], tmp_path / "y")
    assert "no HJIF file" in alone.notes[0]


def test_a_body_that_follows_its_mesh_and_was_never_read_stands_at_rest(tmp_path):
    model = load_model("hfx-temperature-1")
    body = BodyDescription("b", "Anna", SurfaceBinding({}, "cloth"))
    time = TimeBase(Fraction(24), Fraction(24), 1, 1, COUNT)
    recorder = glb_scene.VolumeRecorder(SceneDescription(time, (body,), ()))
    actual, _, result = written(recorder, tmp_path)
    assert [node["name"] for node in actual["nodes"]] == ["Anna", f"Anna: {model.id}"]
    assert "skins" not in actual and not result.notes


def test_a_mesh_with_a_contact_law_has_a_haptic_material(tmp_path):
    """Members that the schemas of MPEG_haptic_material (Khronos pull request 2502) require."""
    law = ContactLaw(800.0, 5.0, 0.25)
    plain, _, _ = written(recorded(TETRAHEDRON, STILL), tmp_path)
    assert "MPEG_haptic_material" not in plain["extensions"] and "images" not in plain
    actual, data, _ = written(recorded(TETRAHEDRON, STILL, law=law), tmp_path)
    assert "MPEG_haptic_material" in actual["extensionsUsed"]
    (material,) = actual["extensions"]["MPEG_haptic_material"]["materials"]
    for kind, full_scale in (("stiffness", 800.0), ("friction", 0.25)):
        (texture,) = material[kind]
        assert texture["type"] in ("High_Resolution", "Low_Resolution", "Reference", "Other")
        assert texture["extras"]["full_scale"] == full_scale
        image = actual["images"][actual["textures"][texture["texture"]["index"]]["source"]]
        view = actual["bufferViews"][image["bufferView"]]
        start = data.index(b"BIN\0") + 4 + view["byteOffset"]
        picture, _ = png.decode(data[start : start + view["byteLength"]], "x")
        assert picture.tolist() == [[255]] and image["mimeType"] == "image/png"
    index = next(n["mesh"] for n in actual["nodes"] if "hfx_effect" in n.get("extras", {}))
    mesh = actual["meshes"][index]
    assert mesh["extensions"] == {"MPEG_haptic_material": {"hapticMaterialIndex": 0}}
    assert "TEXCOORD_0" in mesh["primitives"][0]["attributes"]
    # Other shapes have no mesh: their law is in the extras.
    ball, _, _ = written(recorded(Sphere(), STILL, law=law), tmp_path)
    assert "MPEG_haptic_material" not in ball["extensions"]
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    for document in (actual, ball):
        (extras,) = [n["extras"] for n in document["nodes"] if "hfx_effect" in n.get("extras", {})]
        assert extras["contact_law"] == {
            "stiffness_n_m": 800.0,
            "damping_n_s_m": 5.0,
            "friction": 0.25,
        }
        jsonschema = pytest.importorskip("jsonschema")
        jsonschema.Draft7Validator(schema).validate(extras)


def recorded_surface(vertices, triangles, law):
    """Recorder of a surface; ``vertices`` (T or 1, V, 3)."""
    flat = HeightField(np.zeros((2, 2)), (1e-3, 1e-3))
    texture = SurfaceTexture(flat, None, SurfaceRenderer.TEXTILE)
    area = HapticSurface(triangles, np.zeros((len(triangles), 3, 2)), texture, law=law)
    effect = EffectDescription("e", "Table", "vibration", "hfx-vibration-1", area)
    time = TimeBase(Fraction(24), Fraction(24), 1, 1, COUNT)
    recorder = glb_scene.VolumeRecorder(SceneDescription(time, (), (effect,)))
    values = np.tile([9.0, 160.0], (COUNT, 1))
    block = EffectBlock(np.ones(COUNT), values, STILL, vertices=vertices)
    recorder.add(AnimationBlock(np.arange(COUNT), (block,), ()))
    return recorder


def test_a_surface_with_a_contact_law_is_in_the_scene(tmp_path):
    law = ContactLaw(800.0, 5.0, 0.25)
    sheet = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    plain, _, result = written(recorded_surface(sheet[None], triangles, None), tmp_path)
    assert "extensions" not in plain and not result.notes
    actual, data, result = written(recorded_surface(sheet[None], triangles, law), tmp_path)
    (node,) = [n for n in actual["nodes"] if "hfx_effect" in n.get("extras", {})]
    assert node["extras"]["shape"] == "surface" and not result.notes
    # The placement scales the axes by 1, 2 and 3.
    assert node["extras"]["size_m"] == pytest.approx([2.0, 2.0, 0.0])
    assert node["extras"]["contact_law"]["friction"] == 0.25
    materials = actual["extensions"]["MPEG_haptic_material"]["materials"]
    assert materials[0]["stiffness"][0]["extras"]["full_scale"] == 800.0
    trimesh = pytest.importorskip("trimesh")
    loaded = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
    assert sorted(len(mesh.faces) for mesh in loaded.geometry.values())[0] == 2
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    jsonschema.Draft7Validator(schema).validate(node["extras"])
    moving = sheet + np.linspace(0.0, 1.0, COUNT)[:, None, None]
    _, _, result = written(recorded_surface(moving, triangles, law), tmp_path)
    assert "changes its shape" in result.notes[0]
