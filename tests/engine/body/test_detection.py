# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection thresholds against the figures of their sources, and strength above them by hand."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body import detection
from hfx_blender.engine.body.parts import PARTS

CSV = Path(detection.__file__).with_name("detection.csv")
PALM, FINGERS, TORSO = (PARTS.index(part) for part in ("hand_palm", "fingers", "torso"))


def displacement_db(hz, part=PALM):
    """Threshold as dB re 1 um peak, from the acceleration by hand: a = (2 pi f)^2 d."""
    acceleration = detection.threshold("vibration", hz)[part]
    return 20.0 * math.log10(acceleration / (2.0 * math.pi * hz) ** 2 / 1e-6)


def test_the_palm_has_the_curve_of_verrillo():
    # Verrillo 1963, contactor of 2.9 cm2: flat below 40 Hz, least near 250 Hz at -20 dB re 1 um.
    assert [displacement_db(hz) for hz in (5, 10, 25, 40)] == pytest.approx([10.0] * 4, abs=0.05)
    assert displacement_db(250) == pytest.approx(-20.0, abs=0.01)
    curve = {hz: displacement_db(hz) for hz in range(20, 600, 10)}
    assert min(curve, key=curve.get) == 250


def test_slopes_of_the_palm_are_published():
    # 12 dB per octave from 40 to 200 Hz (1963); 9 dB per octave above the minimum (1966).
    for low in (40.0, 60.0, 100.0):
        assert displacement_db(2.0 * low) - displacement_db(low) == pytest.approx(-12.0, abs=0.1)
    assert displacement_db(800) - displacement_db(400) == pytest.approx(9.0, abs=0.1)


def test_acceleration_of_the_least_threshold_by_hand():
    # 0.1 um at 250 Hz: (2 pi 250)^2 * 1e-7 = 0.24674 m/s^2
    assert detection.threshold("vibration", 250.0)[PALM] == pytest.approx(0.24674, rel=1e-4)


@pytest.mark.parametrize(
    ("part", "published_db"),
    # Means of 100 to 300 Hz in the source's picture of the body: finger -63, forearm -34 and -31,
    # wrist -33 and -39, shoulder blade -29, ankle -34 dBFS.
    [("forearm", 63 - 32.5), ("hand_dorsum", 63 - 36), ("torso", 63 - 29), ("lower_leg", 63 - 34)],
)
def test_other_parts_differ_from_fingers_by_the_published_means(part, published_db):
    hz = np.array([100.0, 125.0, 150.0, 200.0, 250.0, 300.0])
    thresholds = detection.threshold("vibration", hz)
    above_db = 20.0 * np.log10(thresholds[:, PARTS.index(part)] / thresholds[:, FINGERS])
    assert above_db.mean() == pytest.approx(published_db, abs=0.6)


def test_pressure_and_warmth_have_published_values():
    # 0.13 g/mm2 is 0.13e-3 kg * 9.80665 m/s2 / 1e-6 m2 = 1.275 kPa (Dellon et al. 1992)
    assert detection.threshold("pressure")[FINGERS] == pytest.approx(1.275, abs=5e-4)
    warmth = dict(zip(PARTS, detection.threshold("temperature"), strict=True))
    assert (warmth["torso"], warmth["foot_sole"]) == (0.25, 0.8)  # Kwon et al. 2023
    assert np.isnan(detection.threshold("wind")).all()


def test_every_part_has_a_value_with_a_source_or_names_the_part_of_its_value():
    with CSV.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for modality in ("vibration", "pressure", "temperature"):
        own = [row for row in rows if row["modality"] == modality]
        assert {row["part"] for row in own} == set(PARTS)
        measured = {row["part"] for row in own if row["value"]}
        for row in own:
            assert row["source"]
            assert bool(row["value"]) != bool(row["taken_from"])
            assert not row["taken_from"] or row["taken_from"] in measured


def test_levels_by_hand():
    thresholds = detection.threshold("pressure")
    levels = detection.level_db(12.75, thresholds)
    assert levels == pytest.approx(np.full(len(PARTS), 20.0), abs=0.01)  # ten times the threshold
    assert (detection.level_db(0.0, thresholds) == -np.inf).all()


def test_equal_feel_has_one_level_everywhere():
    hz = np.array([30.0, 100.0, 250.0, 400.0])
    thresholds = detection.threshold("vibration", hz)
    strengths = 7.0 * detection.equal_feel_factors("vibration", thresholds)
    levels = detection.level_db(strengths, thresholds)
    assert np.ptp(levels[:3]) < 1e-9
    # At 400 Hz the torso needs 184 m/s^2, 19 times as much as at 100 Hz: raised by 12 dB at most.
    assert strengths[3, TORSO] == 28.0
    # The reference is the least sensitive part at 100 Hz: its strength stays.
    assert strengths[1].max() == pytest.approx(7.0)
    assert strengths[1, TORSO] == pytest.approx(7.0)
    assert (detection.equal_feel_factors("wind", detection.threshold("wind", hz)) == 1.0).all()
