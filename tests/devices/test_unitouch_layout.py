# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuator layouts of Unitouch Studio become devices: loading, and fit to the body."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations.imported_layouts import import_layout
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.actuator_vertices import vertices_of
from hfx_blender.errors import InputError
from hfx_tools.commands.device_faults import faults_of

PLACES = [(x, y, z) for z in (0.75, 0.25) for y in (0.8, 0.2) for x in (0.3, 0.7)]


def layout(**others: Any) -> dict[str, Any]:
    """Return a layout of eight actuators in a cube, the first four at the front."""
    return {
        "name": "Cube",
        "visualReference": "Skinetic",
        "views": [
            {"name": "Front", "Indexes": [0, 1, 2, 3]},
            {"name": "Back", "Indexes": [4, 5, 6, 7]},
        ],
        "actuators": [
            {"projectedViewPosition": dict(zip("xyz", position, strict=True))}
            for position in PLACES
        ],
        **others,
    }


@pytest.fixture
def imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HFX_DEVICES", str(tmp_path / "devices"))

    def make(content: Any, name: str = "cube"):
        path = tmp_path / "layout.json"
        path.write_text(json.dumps(content))
        device = import_layout(path, name)
        assert faults_of(device) == []
        return load_device(name, device.parent)

    return make


def test_every_actuator_is_on_the_skin_where_the_picture_shows_it(imported: Any) -> None:
    device = imported(layout())
    model = load_model("hfx-vibration-1")
    for actuator, (x, _, z) in zip(device.actuators, PLACES, strict=True):
        at = np.array(actuator.place.centre_m)
        assert np.linalg.norm(model.vertices - at, axis=1).min() < 1e-3
        assert (at[0] > 0.0) == (x > 0.5), "the wearer's left is on the right of the front view"
        assert (model.normals[np.linalg.norm(model.vertices - at, axis=1).argmin()][1] < 0) == (
            z > 0.5
        )
        assert len(vertices_of(actuator.place, model))
    heights = [a.place.centre_m[2] for a in device.actuators]
    assert min(heights[:2]) > max(heights[2:4]) + 0.2
    assert all(a.type.takes_waveform for a in device.actuators)


def test_views_decide_front_and_back_independent_of_depth(imported: Any) -> None:
    views = [{"name": "Back", "Indexes": [0]}, {"name": "Left", "Indexes": [1]}]
    device = imported(layout(views=views))
    back, front = (device.actuators[k].place.centre_m[1] for k in (0, 1))
    assert back > front


@pytest.mark.parametrize("reference", ["Chair", "Full Body", None])
def test_other_pictures_fit_other_parts(imported: Any, reference: str | None) -> None:
    device = imported(layout(visualReference=reference))
    heights = [a.place.centre_m[2] for a in device.actuators]
    assert (min(heights) < 0.9) == (reference is not None)


def test_one_actuator_or_all_at_one_place_are_in_the_middle(imported: Any) -> None:
    one = layout(actuators=layout()["actuators"][:1], views=[])
    assert abs(imported(one, "one").actuators[0].place.centre_m[0]) < 0.05


@pytest.mark.parametrize(
    ("change", "path"),
    [
        (lambda d: d.update(extra=1), "'extra' is unknown"),
        (lambda d: d.update(actuators=[]), "actuators is"),
        (lambda d: d.update(visualReference="Moon"), "visualReference"),
        (lambda d: d["actuators"][2].clear(), r"actuators\[2\]: 'projectedViewPosition'"),
        (lambda d: d["actuators"].append(3), r"actuators\[8\]"),
        (lambda d: d["actuators"][0]["projectedViewPosition"].pop("z"), "'z' is missing"),
        (lambda d: d["actuators"][0]["projectedViewPosition"].update(x="1"), "x is"),
        (lambda d: d["actuators"][0]["projectedViewPosition"].update(x=1e9), "x is"),
        (lambda d: d["views"][0].update(name="Inside"), r"views\[0\].name"),
        (lambda d: d["views"][0].update(Indexes=[8]), r"Indexes\[0\]"),
        (lambda d: d["views"][0].update(Indexes=[-1]), r"Indexes\[0\]"),
        (lambda d: d.update(views=3), "views is"),
    ],
)
def test_faults_name_their_place_and_nothing_is_written(
    imported: Any, tmp_path: Path, change: Any, path: str
) -> None:
    content = layout()
    change(content)
    with pytest.raises(InputError, match=path) as caught:
        imported(content)
    assert "layout.json" in str(caught.value)
    assert not (tmp_path / "devices").exists()
