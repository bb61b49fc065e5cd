# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects of the way that sound takes through air: gains over distance, absorption, Doppler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..body.model import PerceptualModel
from ..body.parts import PARTS
from ..scene import PoseBlock, SkinBinding

SPEED_OF_SOUND_M_S: Final = 343.2  # in air of 20 degC

_FADE: Final = 0.1  # of the audible radius, over which a source fades in
FARTHEST_M: Final = 1000.0
_THICKEST: Final = 1e6  # as a multiple of air: silences all but the lowest at once

_HUMIDITY: Final = 50.0  # per cent
_FASTEST: Final = 0.5  # of the speed of sound; what is faster jumps, and is no movement

# Rest space faces -Y, left is +X, up is +Z; the listener's front is X, left Y, up Z.
_FROM_REST: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Hearing:
    """Distance model of the listener.

    Politis, Pugliese, Takala: beyond a reference distance a sound is wet, at it dry and wet are
    equal, very close it is dry; beyond a radius of visibility it is silent. Made one continuous
    crossfade of constant power: dry at the listener, wet from twice the reference on.
    """

    reference_m: float = 2.0
    audible_m: float = 8.0  # silence from here on
    spread_m: float = 0.5  # nearer than this, a source comes from more and more loudspeakers
    air: float = 0.0  # absorption of high frequencies, as a multiple of that of air
    with_doppler: bool = False

    def __post_init__(self) -> None:
        for name in ("reference_m", "audible_m", "spread_m"):
            if not 1.0 / FARTHEST_M <= getattr(self, name) <= FARTHEST_M:
                raise ValueError(
                    f"{name}: expected {1.0 / FARTHEST_M:g} to {FARTHEST_M:g}, "
                    f"got {getattr(self, name):g}"
                )
        if not 0.0 <= self.air <= _THICKEST:
            raise ValueError(f"air: expected 0 to {_THICKEST:g}, got {self.air:g}")

    def gains(self, distances_m: F64) -> tuple[F64, F64]:
        """Gains (n,) of the dry and the wet part; the sum of their squares is 1 where audible."""
        angle = 0.25 * np.pi * np.minimum(distances_m / self.reference_m, 2.0)
        audible = (self.audible_m - distances_m) / (_FADE * self.audible_m)
        audible = np.clip(np.nan_to_num(audible), 0.0, 1.0)
        return np.cos(angle) * audible, np.sin(angle) * audible


def absorption_db_m(frequencies_hz: F64) -> F64:
    """Absorption of pure tones in air of 20 degC, 50 % humidity and 101.325 kPa, dB a metre.

    ISO 9613-1, equations 3 to 5 and B.3.
    """
    temperature = 293.15
    vapour = _HUMIDITY * 10.0 ** (4.6151 - 6.8346 * (273.16 / temperature) ** 1.261)  # per cent
    oxygen_hz = 24.0 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour)
    nitrogen_hz = 9.0 + 280.0 * vapour
    squared = np.square(frequencies_hz)
    oxygen = 0.01275 * np.exp(-2239.1 / temperature) / (oxygen_hz + squared / oxygen_hz)
    nitrogen = 0.1068 * np.exp(-3352.0 / temperature) / (nitrogen_hz + squared / nitrogen_hz)
    loss: F64 = 8.686 * squared * (1.84e-11 + oxygen + nitrogen)
    return loss


def doppler_hz(frequencies_hz: F64, distances_m: F64, rate_hz: float) -> F64:
    """Frequencies (n,) as they are heard at distances (n,) at even times; higher coming nearer."""
    if len(distances_m) < 2:
        return frequencies_hz
    away = np.gradient(distances_m) * rate_hz / SPEED_OF_SOUND_M_S
    away = np.where(np.abs(away) <= _FASTEST, away, 0.0)
    return np.asarray(frequencies_hz / (1.0 + away))


class ListenerFrame:
    """Listener on one body.

    Parameters
    ----------
    model : PerceptualModel
        Whose torso is the listener; the bone that moves most of it counts.
    """

    def __init__(self, binding: SkinBinding, model: PerceptualModel) -> None:
        fitted = binding.fitted.get(model.id)
        placed = model if fitted is None else fitted.of(model)
        torso = np.flatnonzero(placed.part == PARTS.index("torso"))
        weights = placed.weights
        shares = np.zeros(len(placed.bone_names))
        for vertex in torso.tolist():
            mine = slice(int(weights.offsets[vertex]), int(weights.offsets[vertex + 1]))
            np.add.at(shares, weights.bones[mine], weights.values[mine])
        self._bone = binding.bone_names.index(placed.bone_names[int(np.argmax(shares))])
        self._middle = placed.vertices[torso].astype(np.float64).mean(axis=0)

    def frames(self, pose: PoseBlock, rows: I64) -> F64:
        """World to listener space, (n, 4, 4), metres; only turned, never scaled."""
        assert pose.bones is not None
        posed = np.zeros((len(rows), 4, 4))
        posed[:, :3] = pose.bones[rows, self._bone]
        posed[:, 3, 3] = 1.0
        world = pose.to_world[rows] @ posed
        places = world[:, :3, :3] @ self._middle + world[:, :3, 3]
        u, _, vt = np.linalg.svd(world[:, :3, :3])
        turns = u @ vt
        frames = np.zeros((len(rows), 4, 4))
        frames[:, :3, :3] = _FROM_REST @ turns.transpose(0, 2, 1)
        frames[:, :3, 3] = -np.einsum("nij,nj->ni", frames[:, :3, :3], places)
        frames[:, 3, 3] = 1.0
        return frames
