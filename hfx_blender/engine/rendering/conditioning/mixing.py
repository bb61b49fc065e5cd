# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixes several effects for actuators, in the actuators' own modality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import F64
from ...modality import MODALITIES
from ..device_config import Substitution


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
    """Combine the contributions of one modality, at least one, by the modality's own rule.

    Deviations from each effect's own neutral temperature add, winds add as vectors, vibrations by
    :func:`combine_vibration`, all others as they are.
    """
    strengths = np.stack([each.strengths for each in contributions])
    parameters = np.stack([each.parameters for each in contributions])[:, :, None, :]
    if modality == "temperature":
        neutrals = np.array([each.neutral_c for each in contributions])[:, None, None]
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

    Equal frequencies (within 1 Hz of the lowest of their group) are taken to be in phase and
    add; groups of unequal frequency add as powers. The frequency is that of the strongest group.

    Parameters
    ----------
    amplitudes : (n, ...) float64
        Peak acceleration of each of n vibrations at each place, m/s^2.
    frequencies_hz : (n, ...) float64
        Broadcast against ``amplitudes``.

    Returns
    -------
    amplitude : (...) float64
        m/s^2.
    frequency_hz : (...) float64
        The lowest of the strongest group; 0 where nothing vibrates.
    """
    frequencies = np.where(np.asarray(amplitudes) == 0.0, np.inf, frequencies_hz)  # silent: last
    amplitudes, places = np.broadcast_to(amplitudes, frequencies.shape), frequencies.shape[1:]
    if len(frequencies) > 1:
        order = np.argsort(frequencies, axis=0, kind="stable")
        frequencies = np.take_along_axis(frequencies, order, axis=0)
        amplitudes = np.take_along_axis(amplitudes, order, axis=0)
    group, power, strongest, frequency = np.zeros((4, *places))
    group_hz = np.full(places, -np.inf)
    for amplitude, each_hz in zip(amplitudes, frequencies, strict=True):
        begins = each_hz > group_hz + 1.0
        power = power + np.where(begins, group**2, 0.0)
        group = np.where(begins, 0.0, group) + amplitude
        group_hz = np.where(begins, each_hz, group_hz)
        frequency = np.where(group > strongest, group_hz, frequency)
        strongest = np.maximum(group, strongest)
    return np.sqrt(power + group**2), frequency


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
    return Mixed(np.sum(strengths, axis=0))
