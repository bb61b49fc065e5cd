# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixes several effects for actuators, in the actuators' own modality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import F64
from ...modality import (
    MODALITIES,
    combine_pressure,
    combine_temperature,
    combine_vibration,
    combine_wind,
)
from ..device import Substitution


@dataclass(frozen=True, eq=False)
class Contribution:
    """Contribution of one stream at A actuators over R times of a block; 0 where it does
    nothing.
    """

    strengths: F64  # (R, A) level times gain of the rendering scheme
    parameters: F64  # (R, P) in the order of the modality's parameters
    neutral_c: float  # of the effect; only temperature uses it


@dataclass(frozen=True, eq=False)
class Mixed:
    """Strength at A actuators over R times; for temperature the deviation from neutral."""

    strengths: F64  # (R, A)
    frequencies_hz: F64 | None = None  # (R, A) vibration only; 0 where nothing vibrates


def mix(modality: str, contributions: Sequence[Contribution]) -> Mixed:
    """Combine the contributions of one modality, at least one, by the modality's own rule."""
    strengths = np.stack([each.strengths for each in contributions])
    parameters = np.stack([each.parameters for each in contributions])[:, :, None, :]
    if modality == "temperature":
        neutrals = np.array([each.neutral_c for each in contributions])[:, None, None]
        return Mixed(combine_temperature(parameters[..., 0], strengths, neutrals))
    strengths *= parameters[..., 0]
    if modality == "vibration":
        return Mixed(*combine_vibration(strengths, parameters[..., 1]))
    if modality == "wind":
        return Mixed(combine_wind(strengths, parameters[..., 1:4])[0])
    if modality not in MODALITIES:
        raise ValueError(f"modality: expected one of {', '.join(MODALITIES)}, got '{modality}'")
    return Mixed(combine_pressure(strengths))


def substituted(mixed: Mixed, substitution: Substitution) -> Mixed:
    """Output in place of ``mixed``, which is of the substitution's source modality."""
    strengths = mixed.strengths
    if substitution.target != "temperature":
        strengths = np.abs(strengths)
    strengths = strengths * substitution.scale
    if substitution.target != "vibration":
        return Mixed(strengths)
    return Mixed(strengths, np.full_like(strengths, substitution.frequency_hz))


def merged(modality: str, mixes: Sequence[Mixed]) -> Mixed:
    """Combine native output with substitutions for other modalities, at least one.

    A substitute has no direction, so wind adds by its speed here.
    """
    strengths = np.stack([each.strengths for each in mixes])
    if modality == "vibration":
        every = [each.frequencies_hz for each in mixes if each.frequencies_hz is not None]
        return Mixed(*combine_vibration(strengths, np.stack(every)))
    return Mixed(np.asarray(np.sum(strengths, axis=0)))
