# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of haptic samples on an avatar, after HFX Studio's previsualisation.

Vibration red, pressure green, temperature blue, with opacity by strength; colours of overlapping
effects combine in the paper's palette (Danieau et al. 2018, section 3.3.2). Sums of other palettes
are none of their colours: the strongest sensation has its colour there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from .arrays import F64
from .modality import MODALITIES, Colour, neutral_temperature_c
from .samples import Sample

COLD: Final = "cold"  # palette key of temperatures below neutral
COLOURS: Final[Mapping[str, Colour]] = {
    **{name: modality.colour for name, modality in MODALITIES.items()},
    COLD: MODALITIES["temperature"].colour,
}

_WARM_COLD: Final = {**COLOURS, "temperature": (1.0, 0.45, 0.0), COLD: (0.1, 0.45, 1.0)}

_own: dict[str, Colour] = dict(_WARM_COLD)

PALETTES: Final[Mapping[str, Mapping[str, Colour]]] = {
    "PAPER": COLOURS,
    "WARM_COLD": _WARM_COLD,
    # Okabe and Ito, Color Universal Design (2008): distinct for all common kinds of vision.
    "COLOUR_BLIND": {
        **{name: modality.colour_blind for name, modality in MODALITIES.items()},
        COLD: (0.0, 0.447, 0.698),
    },
    "OWN": _own,
}
"""Palettes: colours by modality and for cold."""


def set_own_palette(colours: Mapping[str, Colour]) -> None:
    """Set the colours of the palette ``OWN``; all keys of ``COLOURS`` are required."""
    _own.update({name: colours[name] for name in COLOURS})


@dataclass(frozen=True, eq=False)
class Spread:
    """Interpolation weights from a perceptual model's vertices to an avatar's."""

    nearest: npt.NDArray[np.int64]  # (A, k) vertices of the model
    shares: F64  # (A, k) weights, rows sum to 1

    @classmethod
    def of_neighbours(cls, nearest: npt.NDArray[np.int64], distances_m: F64) -> "Spread":
        """Inverse-distance weights, rows with sum 1, from the k nearest model vertices (A, k) of A
        avatar vertices and their distances in rest space, at least 1 micrometre."""
        # A vertex on top of a model vertex takes nearly all of the colour, without a division by 0.
        inverse = 1.0 / np.maximum(distances_m, 1e-6)
        return cls(nearest, inverse / inverse.sum(axis=1, keepdims=True))


def strengths(sample: Sample, is_contact: bool = False) -> npt.NDArray[np.float64]:
    """Strength (n,) at a sample's vertices: weight times level times strength parameter over the
    parameter's full-colour value, above 1 for larger values. A temperature counts as distance from
    neutral, of touched objects if ``is_contact``."""
    modality = MODALITIES[sample.stream.modality]
    # Temperatures are relative to neutral; other strengths to 0.
    value = float(sample.parameters[modality.parameter_names.index(modality.strength)])
    if modality.name == "temperature":
        value -= neutral_temperature_c(is_contact)
    scale = sample.level * abs(value) / modality.full_colour
    return np.asarray(np.multiply(sample.weights, scale, dtype=np.float64))


def colour_name(sample: Sample, is_contact: bool) -> str:
    """Palette key of a sample: its modality, or ``COLD`` for a temperature below neutral."""
    modality = sample.stream.modality
    if modality != "temperature":
        return modality
    is_cold = float(sample.parameters[0]) < neutral_temperature_c(is_contact)
    return COLD if is_cold else modality


def overlay(shares: Mapping[str, F64], palette: Mapping[str, Colour] = COLOURS) -> F64:
    """Colour and opacity (A, 4) in 0..1 from strengths (A,) by palette key; straight alpha. Opacity
    is the largest strength, at most 1. Colours of at most 1 add up in the palette ``COLOURS``; in
    others the strongest key has its colour, of strengths equal to three decimals the first."""
    names = [name for name in palette if name in shares]
    every = np.stack([shares[name] for name in names])
    strengths_by_name = np.minimum(every, 1.0)
    opacity = strengths_by_name.max(axis=0)
    colours, table = np.empty((len(opacity), 4)), np.array([palette[name] for name in names])
    if palette is COLOURS:
        # einsum, because a matrix product would start BLAS threads.
        tint = np.einsum("ka,kc->ac", strengths_by_name, table)
        # Divided by opacity: the strongest effect has its full colour.
        colours[:, :3] = np.minimum(tint / np.where(opacity > 0.0, opacity, 1.0)[:, None], 1.0)
    else:
        colours[:, :3] = table[every.round(3).argmax(axis=0)]
    colours[:, 3] = opacity
    return colours
