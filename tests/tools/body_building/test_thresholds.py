# SPDX-License-Identifier: GPL-3.0-or-later
"""Threshold tables: from the paper, and from users."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.errors import InputError
from hfx_tools.body_building import correspondence, thresholds


def test_the_literature_is_the_papers_text() -> None:
    # Danieau et al. 2018, section 3.1, sentence by sentence.
    pressure = dict(zip(PARTS, thresholds.LITERATURE_MM["pressure"], strict=True))
    assert pressure["head"] == 7.5 and pressure["torso"] == 12.5 and pressure["fingers"] == 2.5
    vibration = dict(zip(PARTS, thresholds.LITERATURE_MM["vibration"], strict=True))
    assert vibration["upper_arm"] == 50.0 and vibration["foot_sole"] == 10.0
    temperature = dict(zip(PARTS, thresholds.LITERATURE_MM["temperature"], strict=True))
    hand = {temperature[part] for part in ("hand_dorsum", "hand_palm", "fingers")}
    assert hand == {19.0}


def test_table_1_has_10_where_the_paper_repeats_a_row() -> None:
    sole = PARTS.index("foot_sole")
    assert thresholds.read("table1")["vibration"][sole] == 10.0
    assert thresholds.TABLE_1_SD_MM["vibration"][sole] == 10.7


def test_spacings_of_touch_rise_by_a_percent_each_year() -> None:
    # Stevens and Patterson 1995: about 1 % per annum between ages 20 and 80.
    young, old = thresholds.LITERATURE_MM, thresholds.aged(thresholds.LITERATURE_MM, 80.0)
    assert thresholds.aged(young, 20.0) == young
    fingers = PARTS.index("fingers")
    assert (old["pressure"][fingers], old["vibration"][fingers]) == (4.0, 3.2)  # 2.5, 2 times 1.6
    assert old["temperature"] == young["temperature"]
    assert thresholds.aged(young, 45.0)["pressure"][0] == 9.375  # 7.5 * 1.25
    wide = {"vibration": (250.0,) * len(PARTS)}
    assert thresholds.aged(wide, 80.0)["vibration"] == (300.0,) * len(PARTS)
    for years in (19.9, 80.1, float("nan")):
        with pytest.raises(InputError, match="allowed are 20 to 80 years"):
            thresholds.aged(young, years)


def test_canonical_ids_belong_to_the_literature_alone() -> None:
    for modality, row in thresholds.LITERATURE_MM.items():
        assert thresholds.model_id(modality, row) == f"hfx-{modality}-1"
        model_id = thresholds.model_id(modality, thresholds.TABLE_1_MM[modality])
        assert model_id.startswith(f"hfx-{modality}-1-") and len(model_id.rpartition("-")[2]) == 8


def test_a_file_changes_only_named_thresholds(tmp_path: Path) -> None:
    path = tmp_path / "old age.json"
    path.write_text(json.dumps({"pressure": {"fingers": 4, "foot_sole": 15.5}}))
    table = thresholds.read(str(path))
    assert list(table) == ["pressure"]
    row = dict(zip(PARTS, table["pressure"], strict=True))
    assert (row["fingers"], row["foot_sole"], row["head"]) == (4.0, 15.5, 7.5)


@pytest.mark.parametrize(
    ("content", "message"),
    (
        ("{", "cannot be read as a table"),
        ("[]", "expected an object of modalities"),
        ('{"smell": {}}', "modality 'smell' is unknown; there are: pressure"),
        ('{"pressure": 3}', "'pressure' must be an object"),
        ('{"pressure": {"nose": 3}}', "part 'nose' of 'pressure' is unknown; there are: head"),
        (
            '{"pressure": {"head": "3"}}',
            "'pressure.head' is '3'; allowed are numbers from 1 to 300",
        ),
        ('{"pressure": {"head": 0.5}}', "is 0.5; allowed"),
        ('{"pressure": {"head": NaN}}', "is nan; allowed"),
        ('{"pressure": {"head": true}}', "is True; allowed"),
    ),
)
def test_a_faulty_file_names_the_fault(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "table.json"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        thresholds.read(str(path))
    assert message in str(caught.value) and "table.json" in str(caught.value)


def test_a_model_of_other_thresholds_leads_to_the_canonical_ids_and_back(tmp_path: Path) -> None:
    canonical = model.load_model("hfx-temperature-1")
    second = replace(
        canonical,
        id=thresholds.model_id("temperature", thresholds.TABLE_1_MM["temperature"]),
        vertices=canonical.vertices + np.float32(1e-3),
    )
    correspondence.save(second, canonical, tmp_path / "temperature-map.npz")
    with np.load(tmp_path / "temperature-map.npz") as stored:
        assert stored["model"].tolist() == [second.id, second.content_hash]
        assert stored["canonical"].tolist() == [canonical.id, canonical.content_hash]
        for name in ("to_canonical", "from_canonical"):
            assert np.array_equal(stored[name], np.arange(len(canonical)))
