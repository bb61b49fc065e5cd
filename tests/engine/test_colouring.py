# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of contacts."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine import colouring
from hfx_blender.engine.colouring import COLOURS, Spread
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import Sample, Stream
from hfx_tools.felt_shares import SKIN, avatar_colours, felt_shares

# Two avatar vertices, each at one of the two vertices of every model.
SPREADS = {f"hfx-{m}-1": Spread(np.array([[0], [1]]), np.ones((2, 1))) for m in MODALITIES}
COUNTS = dict.fromkeys(SPREADS, 2)

FULL_COLOUR = {"vibration": 8.0, "pressure": 6.0, "temperature": 6.0, "wind": 6.0}
"""Strengths of full colour, in m/s^2, kPa, degrees from neutral and m/s."""


def _sample(
    modality: str, value: float, vertices: tuple[int, ...] = (0,), level: float = 1.0
) -> Sample:
    names = MODALITIES[modality].parameter_names
    parameters = np.zeros(len(names))
    parameters[names.index(MODALITIES[modality].strength)] = value
    return Sample(
        0.0,
        Stream("effect", "body", modality, f"hfx-{modality}-1"),
        np.array(vertices, np.int32),
        np.ones(len(vertices), np.float32),
        level,
        parameters,
    )


def _colours(*samples: Sample, contact: frozenset[str] = frozenset()) -> np.ndarray:
    return avatar_colours(samples, SPREADS, COUNTS, contact)


def test_without_contacts_the_colour_is_skin() -> None:
    assert _colours().tolist() == [list(SKIN)] * 2


def test_each_modality_has_a_full_colour_in_these_tests() -> None:
    assert FULL_COLOUR.keys() == MODALITIES.keys()


@pytest.mark.parametrize(("modality", "channel"), [("vibration", 0), ("pressure", 1)])
def test_full_strength_is_the_papers_colour(modality: str, channel: int) -> None:
    colours, bare = _colours(_sample(modality, FULL_COLOUR[modality]))
    assert colours.tolist() == pytest.approx(COLOURS[modality])
    assert colours.argmax() == channel
    assert bare.tolist() == list(SKIN)


@pytest.mark.parametrize("deviation", [-6.0, 6.0])
def test_temperature_counts_from_its_neutral(deviation: float) -> None:
    ambient = _colours(_sample("temperature", 24.0 + deviation))
    touched = _colours(_sample("temperature", 33.0 + deviation), contact=frozenset({"effect"}))
    for colour in (ambient[0], touched[0]):
        assert colour.tolist() == pytest.approx(COLOURS["temperature"])
        assert colour.argmax() == 2
    assert _colours(_sample("temperature", 24.0)).tolist() == [list(SKIN)] * 2
    neutral = _colours(_sample("temperature", 33.0), contact=frozenset({"effect"}))
    assert neutral.tolist() == [list(SKIN)] * 2


def test_stronger_effects_have_stronger_colours() -> None:
    values = np.linspace(0.0, FULL_COLOUR["pressure"], 9)
    excess = [
        float(np.abs(_colours(_sample("pressure", value))[0] - SKIN).sum()) for value in values
    ]
    assert excess[0] == 0.0 and (np.diff(excess) > 0).all()
    half = _colours(_sample("pressure", FULL_COLOUR["pressure"], level=0.5))
    assert half.tolist() == _colours(_sample("pressure", FULL_COLOUR["pressure"] / 2)).tolist()


def test_colours_combine_where_effects_overlap() -> None:
    both = _colours(
        _sample("vibration", FULL_COLOUR["vibration"], (0, 1)),
        _sample("temperature", 24.0 + FULL_COLOUR["temperature"], (1,)),
    )
    assert both[0].tolist() == pytest.approx(COLOURS["vibration"])
    mixed = np.add(COLOURS["vibration"], COLOURS["temperature"])
    assert both[1].tolist() == pytest.approx(np.clip(mixed, 0.0, 1.0))


@pytest.mark.parametrize("palette", ["WARM_COLD", "COLOUR_BLIND"])
def test_the_strongest_of_overlapping_effects_has_its_colour(palette: str) -> None:
    colours = colouring.PALETTES[palette]
    shares = {"temperature": np.array([1.0, 0.2]), "wind": np.array([0.5, 0.8])}
    assert colouring.overlay(shares, colours).tolist() == [
        [*colours["temperature"], 1.0],
        [*colours["wind"], 0.8],
    ]


@pytest.mark.parametrize("palette", ["WARM_COLD", "COLOUR_BLIND", "OWN"])
def test_of_saturated_effects_the_larger_has_its_colour_in_any_order(palette: str) -> None:
    """Compare unclipped strengths, 10 of 8 m/s^2 with 6 of 6 degrees; vibration wins a tie."""
    colours = colouring.PALETTES[palette]
    for vibration, degrees, name in (
        (10.0, 6.0, "vibration"),
        (8.0, 9.0, "temperature"),
        (8.0, 6.0, "vibration"),
        (8.0 - 1e-9, 6.0, "vibration"),
    ):
        samples = [_sample("vibration", vibration), _sample("temperature", 24.0 + degrees)]
        shares = felt_shares(samples, SPREADS, COUNTS)
        for order in (list(shares), list(reversed(shares))):
            actual = colouring.overlay({key: shares[key] for key in order}, colours)[0]
            assert actual.tolist() == pytest.approx([*colours[name], 1.0])


def test_colours_stay_in_range() -> None:
    samples = [_sample(modality, 1e6, (0, 1)) for modality in MODALITIES]
    colours = _colours(*samples, *samples)
    assert (colours >= 0).all() and (colours <= 1).all()


def test_strengths_are_weight_times_level_times_value() -> None:
    sample = _sample("pressure", FULL_COLOUR["pressure"], (1, 3), level=0.5)
    sample.weights[:] = (0.5, 1.0)
    assert colouring.strengths(sample).tolist() == [0.25, 0.5]


def test_spread_weighs_the_nearest_by_inverse_distance() -> None:
    nearest = np.array([[0, 1], [3, 2]])
    spread = Spread.of_neighbours(nearest, np.array([[1.0, 2.0], [0.0, 3.0]]))
    assert spread.nearest.tolist() == nearest.tolist()
    assert spread.shares[0].tolist() == pytest.approx([2 / 3, 1 / 3])
    assert spread.shares[1].tolist() == pytest.approx([1.0, 0.0], abs=1e-5)
    assert spread.shares.sum(axis=1).tolist() == pytest.approx([1.0, 1.0])


def test_an_overlay_ranges_from_clear_to_opaque_with_strength() -> None:
    shares = felt_shares(
        [_sample("pressure", FULL_COLOUR["pressure"])], SPREADS, COUNTS, frozenset()
    )
    colours, bare = colouring.overlay(shares)
    assert colours.tolist() == pytest.approx([*COLOURS["pressure"], 1.0])
    assert bare.tolist() == [0.0, 0.0, 0.0, 0.0]


def test_a_weak_effect_is_more_clear_but_of_the_same_colour() -> None:
    """A quarter of the strength has half the opacity, the square root."""
    quarter = FULL_COLOUR["pressure"] / 4
    shares = felt_shares([_sample("pressure", quarter)], SPREADS, COUNTS)
    assert colouring.overlay(shares)[0].tolist() == pytest.approx([*COLOURS["pressure"], 0.5])


def test_effects_that_overlap_combine_their_colours() -> None:
    samples = [_sample(m, FULL_COLOUR[m]) for m in ("vibration", "pressure")]
    mixed = colouring.overlay(felt_shares(samples, SPREADS, COUNTS))[0]
    assert mixed[0] > 0.8 and mixed[1] > 0.6 and mixed[3] == 1.0


@pytest.mark.parametrize("palette", ["WARM_COLD", "COLOUR_BLIND"])
def test_warm_and_cold_have_different_colours(palette: str) -> None:
    colours = colouring.PALETTES[palette]
    for degrees, name in ((30.0, "temperature"), (18.0, colouring.COLD)):
        shares = felt_shares([_sample("temperature", degrees)], SPREADS, COUNTS)
        actual = colouring.overlay(shares, colours)[0]
        assert actual.tolist() == pytest.approx([*colours[name], 1.0])


def test_every_palette_has_a_colour_of_its_own_for_each_modality() -> None:
    for name, palette in colouring.PALETTES.items():
        assert set(palette) == {*MODALITIES, colouring.COLD}
        assert len({palette[m] for m in MODALITIES}) == len(MODALITIES), name
