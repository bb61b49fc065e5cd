# SPDX-License-Identifier: GPL-3.0-or-later
"""Stimuli of studies: values by formulas worked out by hand, hashes, and refusals."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.cli import run
from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_tools.study import folder
from hfx_tools.study.plan import plan_of
from hfx_tools.study.stimuli import StimulusLibrary, conditions_of, devices_of
from hfx_tools.study.stimulus_rendering import rendered
from hfx_tools.study.tables import read_table


def _study(tmp_path: Path, **members: Any) -> folder.Study:
    document = {
        "name": "p",
        "design": "rating",
        "scales": [{"id": "a", "text": "A?"}],
        **members,
    }
    if document["design"] != "rating":
        del document["scales"]
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document))
    return folder.make(path, tmp_path / "s")


def _plan(**members: Any) -> Any:
    document = {"name": "p", "design": "rating", "scales": [{"id": "a", "text": "A?"}], **members}
    return plan_of(json.dumps(document).encode(), Path("plan.json"))


@pytest.mark.parametrize(
    ("scheme", "half"), [("linear", 0.5), ("logarithmic", np.log2(1.5)), ("power", np.sqrt(0.5))]
)
def test_a_line_to_the_east_passes_the_middle_row_by_the_law_of_the_scheme(
    scheme: str, half: float
) -> None:
    """Half way between two tactors of Mango's pad both have the share 0.5: gains of the paper."""
    device = load_device("mango_pad")
    plan = _plan(stimulus={"kind": "line", "strength": 1.0})
    conditions = {"direction": "E", "scheme": scheme, "duration_ms": 1005}
    raster = rendered(plan, conditions, device)
    assert raster.values.shape == (100, 20)
    names = [column.actuator for column in raster.columns]
    amplitudes = raster.values[:, [names.index(f"r2c{k}") for k in (1, 2, 3, 4)]] / 15.0
    # 100 rows on 190.5 mm: the middle between row 49 and 50 is the middle of the pad.
    assert amplitudes[49:51, 1:3].mean() == pytest.approx(half, abs=0.01)
    # From left to right: the pad's x axis points to the wearer's right in the configuration.
    order = np.argmax(amplitudes, axis=0)
    assert list(order) == sorted(order) and order[0] == 0 and order[3] == 99
    others = [k for k, name in enumerate(names) if not name.startswith("r2") and k % 2 == 0]
    assert np.abs(raster.values[:, others]).max() < 1e-6


def test_a_steady_stimulus_has_strength_frequency_and_duration() -> None:
    device = load_device("phone_wide_band")
    conditions = {"strength": 0.5, "frequency_hz": 120, "duration_ms": 250}
    raster = rendered(_plan(), conditions, device)
    seconds = len(raster.values) / float(raster.rate_hz)
    assert seconds == pytest.approx(0.25, abs=0.5 / float(raster.rate_hz))
    assert np.all(raster.values == [0.5 * 12.75, 120.0])
    quieter = rendered(_plan(), conditions | {"level_db": -20}, device)
    assert np.allclose(quieter.values[:, 0], 1.275)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"strength": 2}, "strength is 2, allowed is a number from 0 to 1"),
        ({"duration_ms": "long"}, "duration_ms is 'long', allowed is a number from 10 to 60000"),
        ({"actuator": "x"}, "actuator is 'x', allowed is one of "),
        ({"direction": "up"}, "direction is 'up', allowed is one of N, NE, E"),
        ({"direction": "N", "scheme": "best"}, "scheme is 'best', allowed is one of coverage"),
        ({"surface": "silk"}, "surface is 'silk', allowed is one of gravel-fine"),
        ({"effect": "love"}, "effect is 'love', allowed is one of bee"),
        ({"take": "a.mp3"}, "a.mp3: is no take; allowed are .hfxtrack"),
    ],
)
def test_a_bad_value_is_refused_with_the_allowed_ones(
    conditions: dict[str, Any], message: str
) -> None:
    factors = {name: [value] for name, value in conditions.items()}
    with pytest.raises(InputError) as raised:
        rendered(_plan(factors=factors), conditions, load_device("mango_pad"))
    assert message in str(raised.value)


def test_stimuli_are_named_by_their_content_alone(tmp_path: Path) -> None:
    study = _study(
        tmp_path, factors={"strength": [0.2, 0.6]}, random={"square": [1, 2, 3]}, device="back_pad"
    )
    library = StimulusLibrary(study, devices_of(study.plan, ()))
    rows = read_table(study.folder / "stimuli" / "stimuli.tsv")
    assert len(library) == len(rows) == 2  # "square" changes no stimulus
    for row in rows:
        path = study.folder / "stimuli" / f"{row['stimulus']}.csv"
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert digest == row["sha256"] and digest.startswith(row["stimulus"])
    one, two = (library[{"strength": s, "square": 1}] for s in (0.2, 0.6))
    assert np.allclose(two.values[:, 0], 3.0 * one.values[:, 0])


def test_a_changed_stimulus_is_refused(tmp_path: Path) -> None:
    study = _study(tmp_path, factors={"strength": [0.2]}, device="back_pad")
    StimulusLibrary(study, ["back_pad"])
    (path,) = (study.folder / "stimuli").glob("*.csv")
    path.write_bytes(path.read_bytes() + b"\r\n")
    with pytest.raises(InputError, match="was changed after it was rendered"):
        StimulusLibrary(study, ["back_pad"])


def test_a_compared_factor_without_an_effect_is_refused(tmp_path: Path) -> None:
    study = _study(tmp_path, design="paired", compare={"mood": ["a", "b"]})
    with pytest.raises(InputError, match="'mood' is compared, but no stimulus"):
        conditions_of(study.plan)


def test_takes_are_files_next_to_the_plan(tmp_path: Path) -> None:
    """Tables of values as takes: trimmed to their first strength, and cut to the duration."""
    header = "time_s,palm.amplitude_m_s2 [m/s^2],palm.frequency_hz [Hz]\n"
    device = load_device("phone_wide_band")
    names = [f"{c.actuator}.{c.parameter} [{c.unit}]" for c in _columns(device)]
    header = ",".join(["time_s", *names]) + "\n"
    for name, strength in (("soft", 1), ("hard", 4)):
        rows = [f"{0.01 * k:g},{strength if k >= 5 else 0},100\n" for k in range(50)]
        (tmp_path / f"{name}.csv").write_text(header + "".join(rows))
    plan = {
        "name": "takes",
        "design": "paired",
        "compare": {"take": ["soft.csv", "hard.csv"]},
        "factors": {"duration_ms": [200]},
    }
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    target = tmp_path / "s"
    arguments = ["study", "make", str(tmp_path / "plan.json"), "-o", str(target)]
    assert run([*arguments, "--device", "phone_wide_band"]) == 0
    library = StimulusLibrary(folder.Study(target), ["phone_wide_band"])
    stimulus = library[{"take": "hard.csv", "duration_ms": 200}]
    assert stimulus.duration_s == pytest.approx(0.2)
    assert np.all(stimulus.values[:, 0] == 4.0)
    # Takes are not there any more for another device.
    with pytest.raises(InputError, match="make the study again with --device back_pad"):
        StimulusLibrary(folder.Study(target), ["back_pad"])


def test_a_path_with_factors_chooses_files(tmp_path: Path) -> None:
    """Factors of a path have values of their own: "up" is no direction of a line."""
    device = load_device("phone_wide_band")
    names = [f"{c.actuator}.{c.parameter} [{c.unit}]" for c in _columns(device)]
    for name, strength in (("up", 1), ("down", 4)):
        rows = [f"{0.01 * k:g},{strength},100\n" for k in range(9)]
        (tmp_path / f"{name}.csv").write_text(",".join(["time_s", *names]) + "\n" + "".join(rows))
    plan = {
        "name": "takes",
        "design": "paired",
        "compare": {"direction": ["up", "down"]},
        "stimulus": {"path": "{direction}.csv"},
    }
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    target = tmp_path / "s"
    arguments = ["study", "make", str(tmp_path / "plan.json"), "-o", str(target)]
    assert run([*arguments, "--device", "phone_wide_band"]) == 0
    library = StimulusLibrary(folder.Study(target), ["phone_wide_band"])
    assert np.all(library[{"direction": "down"}].values[:, 0] == 4.0)


def test_a_random_device_is_a_device_of_the_session(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(
        json.dumps(
            {
                "name": "p",
                "design": "paired",
                "compare": {"strength": [0.2, 0.6]},
                "random": {"device": ["back_pad", "mango_pad"]},
            }
        )
    )
    target = tmp_path / "s"
    assert run(["study", "make", str(tmp_path / "plan.json"), "-o", str(target)]) == 0
    rows = read_table(target / "stimuli" / "stimuli.tsv")
    assert sorted(row["device"] for row in rows) == ["back_pad"] * 2 + ["mango_pad"] * 2


def test_a_missing_take_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = {"name": "t", "design": "paired", "compare": {"take": ["a.hfxtrack", "b.hfxtrack"]}}
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    arguments = ["study", "make", str(tmp_path / "plan.json"), "-o", str(tmp_path / "s")]
    assert run([*arguments, "--device", "back_pad"]) == 3
    assert "a.hfxtrack: there is no such file" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
    assert run(arguments) == 3
    assert "0 devices, allowed is one device, by --device NAME" in capsys.readouterr().err


def _columns(device: Any) -> Any:
    from hfx_blender.engine.rendering.raster import columns_of

    return columns_of(device)
