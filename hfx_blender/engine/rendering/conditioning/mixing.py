# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixing of several effects at actuators, in the actuators' modality."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import F64
from ...modality import MODALITIES
from ..device_config import Substitution


@dataclass(frozen=True, eq=False)
class Contribution:
    """Contribution of one stream at A actuators over R rows of a block; 0 at idle rows."""

    strengths: F64  # (R, A) level times gain of the rendering scheme
    parameters: F64  # (R, P) in the order of the modality's parameters
    neutral_c: float  # of the effect; for temperature only


@dataclass(frozen=True, eq=False)
class Mixed:
    """Strength at A actuators over R rows; for temperature the deviation from neutral."""

    strengths: F64  # (R, A)
    frequencies_hz: F64 | None = None  # (R, A) vibration only; 0 in silence


def mix(modality: str, contributions: Sequence[Contribution]) -> Mixed:
    """Combine one or more contributions by their modality's rule.

    Temperatures add their deviations from each effect's neutral, winds add as vectors (strength:
    length), vibrations by :func:`combine_vibration`, all other strengths add. Raises ValueError for
    an unknown modality.
    """
    strengths = np.stack([c.strengths for c in contributions])
    parameters = np.stack([c.parameters for c in contributions])[:, :, None, :]
    if modality == "temperature":
        neutrals = np.array([c.neutral_c for c in contributions])[:, None, None]
        return Mixed(np.sum(strengths * (parameters[..., 0] - neutrals), axis=0))
    strengths *= parameters[..., 0]
    if modality == "vibration":
        return Mixed(*combine_vibration(strengths, parameters[..., 1]))
    if modality == "wind":
        velocities = np.sum(strengths[..., None] * parameters[..., 1:4], axis=0)
        return Mixed(np.linalg.norm(velocities, axis=-1))
    if modality not in MODALITIES:
        raise ValueError(f"modality: expected one of {', '.join(MODALITIES)}, got '{modality}'")
    return Mixed(np.sum(strengths, axis=0))


def combine_vibration(amplitudes: F64, frequencies_hz: F64) -> tuple[F64, F64]:
    """Amplitude and frequency of several vibrations at each place.

    ``amplitudes`` (n, ...) are peaks, m/s^2; frequencies broadcast against them. Equal frequencies
    (within 1 Hz of the lowest of a group) count as in phase and add; groups add as powers. The
    frequency (...) is the lowest of the strongest group; 0 in silence.
    """
    # Infinite frequencies of silence sort last.
    frequencies = np.where(np.asarray(amplitudes) == 0.0, np.inf, frequencies_hz)
    amplitudes, places = np.broadcast_to(amplitudes, frequencies.shape), frequencies.shape[1:]
    if len(frequencies) > 1:
        order = np.argsort(frequencies, axis=0, kind="stable")
        frequencies = np.take_along_axis(frequencies, order, axis=0)
        amplitudes = np.take_along_axis(amplitudes, order, axis=0)
    group, power, strongest, frequency = np.zeros((4, *places))
    group_hz = np.full(places, -np.inf)
    # Ascending frequencies: a frequency beyond the group's begins the next group.
    for amplitude, hz in zip(amplitudes, frequencies, strict=True):
        begins = hz > group_hz + 1.0
        power = power + np.where(begins, group**2, 0.0)
        group = np.where(begins, 0.0, group) + amplitude
        group_hz = np.where(begins, hz, group_hz)
        frequency = np.where(group > strongest, group_hz, frequency)
        strongest = np.maximum(group, strongest)
    return np.sqrt(power + group**2), frequency


def substituted(mixed: Mixed, substitution: Substitution) -> Mixed:
    """Strengths of ``mixed`` (source modality) times the scale, at the target's fixed frequency.
    Magnitudes, except for temperature as target; frequencies only for vibration."""
    strengths = mixed.strengths
    if substitution.target != "temperature":
        strengths = np.abs(strengths)
    strengths = strengths * substitution.scale
    if substitution.target != "vibration":
        return Mixed(strengths)
    return Mixed(strengths, np.full_like(strengths, substitution.frequency_hz))


def merged(modality: str, mixes: Sequence[Mixed]) -> Mixed:
    """Combine one or more native and substituted outputs of a modality at actuators. Vibrations
    combine by :func:`combine_vibration`, the rest adds; winds add their speeds here."""
    strengths = np.stack([mixed.strengths for mixed in mixes])
    if modality == "vibration":
        hz = [mixed.frequencies_hz for mixed in mixes if mixed.frequencies_hz is not None]
        return Mixed(*combine_vibration(strengths, np.stack(hz)))
    return Mixed(np.sum(strengths, axis=0))
