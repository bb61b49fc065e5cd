# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions of the body, against anatomy and third-party device layouts."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.devices.configurations.device_facts import facts_of
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import REGIONS
from hfx_blender.engine.body.regions import finest_masks, region_weights

MODELS = ("hfx-vibration-1", "hfx-pressure-1", "hfx-temperature-1")


@pytest.mark.parametrize("name", MODELS)
def test_each_vertex_has_one_region_and_regions_are_symmetric(name: str) -> None:
    model = load_model(name)
    masks = finest_masks(name)
    assert (sum(mask.astype(int) for mask in masks.values()) == 1).all()
    for region, mask in masks.items():
        assert np.mean(mask == mask[model.mirror]) > 0.999, region
    for region in REGIONS:
        assert region_weights(model, region.id, "left").any(), region  # coarse models, too


def test_regions_lie_as_on_a_person() -> None:
    model = load_model("hfx-vibration-1")
    middle = {
        name: model.vertices[mask].mean(axis=0) for name, mask in finest_masks(model.id).items()
    }
    height = {name: position[2] for name, position in middle.items()}
    for upper, lower in (
        ("face", "neck"),
        ("neck", "shoulders"),
        ("shoulders", "chest"),
        ("chest", "belly"),
        ("upper_back", "lower_back"),
        ("lower_back", "buttocks"),
        ("thigh_front", "shin"),
        ("calf", "top_of_foot"),
        ("top_of_foot", "sole"),
    ):
        assert height[upper] > height[lower], (upper, lower)
    for front, behind in (  # a person looks along -Y
        ("face", "back_of_head"),
        ("chest", "upper_back"),
        ("belly", "lower_back"),
        ("upper_arm_front", "upper_arm_back"),
        ("thigh_front", "thigh_back"),
        ("shin", "calf"),
        ("toes", "sole"),
        ("index_finger", "little_finger"),
    ):
        assert middle[front][1] < middle[behind][1], (front, behind)


@pytest.mark.parametrize(
    ("device", "places"),
    [
        ("insoles", {"Soles"}),
        ("oculus_touch", {"Palms"}),
        ("bhaptics_tactal", {"Face"}),
        ("back_pad", {"Upper Back", "Lower Back"}),
        ("bhaptics_tactsuit_x40", {"Chest", "Belly", "Upper Back", "Lower Back"}),
        (
            "fingertips_left",
            {"Thumbs", "Index Fingers", "Middle Fingers", "Ring Fingers", "Little Fingers"},
        ),
        ("fan_heater", {"In the Room"}),
    ],
)
def test_devices_are_where_their_makers_put_them(device: str, places: set[str]) -> None:
    assert set(facts_of(device).places) == places
