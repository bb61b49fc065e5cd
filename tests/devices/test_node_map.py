# SPDX-License-Identifier: GPL-3.0-or-later
"""VRChat node maps become devices: loading, fit to the body, and driving."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations.imported_layouts import EYE_HEIGHT_M, import_layout
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import LEFT, SIDES
from hfx_blender.engine.rendering.actuator_vertices import vertices_of
from hfx_blender.errors import InputError
from hfx_tools.commands.device_faults import faults_of


def node(bone: str, x: float, y: float, z: float, address: str | None = None) -> dict[str, Any]:
    actual = {"node_data": {"x": x, "y": y, "z": z, "groups": ["A"]}, "radius": 0.03}
    actual |= {"target_bone": bone, "is_external_address": False}
    return actual if address is None else {**actual, "address": address}


# Unity: Y up, the avatar faces +Z with -X on the left.
NODES = [
    node("Chest", -0.08, 1.3, 0.1, "/avatar/parameters/h/VestFront_0"),
    node("Chest", 0.08, 1.3, -0.1, "/avatar/parameters/h/VestBack_3"),
    node("LeftLowerArm", -0.4, 1.2, 0.0),
    node("Head", 0.0, 1.7, 0.1),
]


@pytest.fixture(autouse=True)
def users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HFX_DEVICES", str(tmp_path / "devices"))


@pytest.fixture
def written(tmp_path: Path):
    def write(nodes: Any, **others: Any) -> Path:
        path = tmp_path / "map.json"
        path.write_text(json.dumps({"nodes": nodes, "meta": {"map_name": "Vest"}, **others}))
        return path

    return write


def test_a_node_map_becomes_a_device_that_fits(written: Any) -> None:
    layout = import_layout(written(NODES), "my_vest")
    assert faults_of(layout) == []
    device = load_device("my_vest")
    assert [actuator.id for actuator in device.actuators] == [
        "node_1",
        "node_2",
        "node_3",
        "node_4",
    ]
    front, back, arm, head = (actuator.place for actuator in device.actuators)
    assert front.centre_m[0] > 0.0 > front.centre_m[1], "the wearer's left, in front"
    assert back.centre_m[0] < 0.0 < back.centre_m[1], "the wearer's right, behind"
    assert (arm.parts, arm.side, head.parts) == (("forearm",), "left", ("head",))
    model = load_model("hfx-vibration-1")
    assert set(model.side[vertices_of(arm, model)].tolist()) == {LEFT} and SIDES[LEFT] == "left"
    assert np.linalg.norm(np.array(front.centre_m) - [0.085, -0.106, 1.382]) < 0.07
    assert device.output is not None
    assert device.output.encoder.addresses == (
        "/avatar/parameters/h/VestFront_0",
        "/avatar/parameters/h/VestBack_3",
        "/avatar/parameters/hfx_3",
        "/avatar/parameters/hfx_4",
    )


def test_a_node_map_is_scaled_from_its_eye_height_to_that_of_the_model(written: Any) -> None:
    """Scale 1.685 m / 1.585 m = 1.0631: the crown of the map's avatar, 1.692 m, becomes 1.799 m."""
    nodes = [
        node("Head", 0.0, 1.692, 0.04),
        node("Head", -0.0634, 1.585, 0.0846),
        node("Chest", 0.0, 1.2716, 0.12),
    ]
    import_layout(written(nodes), "heights")
    places = [actuator.place for actuator in load_device("heights").actuators]
    assert [position.centre_m[2] for position in places] == pytest.approx(
        [1.799, 1.685, 1.352], abs=6e-3
    )
    assert [position.radius_m for position in places] == pytest.approx([0.0319] * 3)
    assert places[0].centre_m[1] == pytest.approx(-0.0425, abs=5e-3)


def test_the_eyes_of_the_model_are_where_the_scale_assumes_them() -> None:
    avatar = load_avatar()
    eyes = [avatar.skeleton.bone_names.index(f"eye.{side}") for side in "LR"]
    heights = avatar.skeleton.rest[eyes, 2, 3]
    assert heights == pytest.approx([EYE_HEIGHT_M] * 2, abs=2e-3)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ([], "nodes"),
        ("x", "nodes"),
        ([1], r"nodes\[0\]"),
        ([{**NODES[0], "target_bone": "Tail"}], r"nodes\[0\]\.target_bone"),
        ([{**NODES[0], "target_bone": None}], r"nodes\[0\]\.target_bone"),
        ([{**NODES[0], "radius": -1}], r"nodes\[0\]\.radius"),
        ([{**NODES[0], "radius": True}], r"nodes\[0\]\.radius"),
        ([{**NODES[0], "node_data": {"x": 0, "y": 99, "z": 0}}], r"nodes\[0\]\.node_data\.y is 99"),
        ([{**NODES[0], "node_data": {"x": 0, "y": "1", "z": 0}}], r"nodes\[0\]\.node_data\.y"),
        ([{**NODES[0], "node_data": {"x": 0, "y": 1}}], r"nodes\[0\]\.node_data: 'z' is missing"),
        ([{**NODES[0], "node_data": []}], "node_data"),
        ([{**NODES[0], "address": "no address"}], r"nodes\[0\]\.address"),
        ([NODES[0], NODES[0]], "same address"),
        ([NODES[2]] * 1001, "1000"),
    ],
)
def test_an_invalid_node_map_is_refused_without_output(
    written: Any, tmp_path: Path, wrong: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        import_layout(written(wrong), "x")
    assert not (tmp_path / "devices").exists()


def test_names_are_checked_and_nothing_is_overwritten(written: Any) -> None:
    path = written(NODES)
    for name in ("", "../x", "A", "a b"):
        with pytest.raises(InputError, match="no name"):
            import_layout(path, name)
    import_layout(path, "one")
    with pytest.raises(InputError, match="exists already"):
        import_layout(path, "one")
