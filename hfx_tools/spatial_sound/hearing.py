# SPDX-License-Identifier: GPL-3.0-or-later
"""Listener on a body: listener space, distance model, air absorption, Doppler shift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64, expand
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.scene import PoseBlock, SkinBinding

SPEED_OF_SOUND_M_S: Final = 343.2  # in air of 20 degC

_FADE: Final = 0.1  # share of the audible radius over which a source fades in
FARTHEST_M: Final = 1000.0
_THICKEST: Final = 1e6  # multiple of air that silences all but the lowest frequencies

_HUMIDITY: Final = 50.0  # per cent
_FASTEST: Final = 0.5  # largest share of the speed of sound; faster motion counts as a jump

# Rest space faces -Y, left is +X, up is +Z; the listener's front is X, left Y, up Z.
_FROM_REST: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Hearing:
    """Distance model of a listener.

    Politis, Pugliese, Takala: sound is dry at the listener, dry and wet in equal parts at a
    reference distance, wet beyond, and silent beyond an audible radius. Here one crossfade of
    constant power, fully wet from twice the reference distance.
    """

    reference_m: float = 2.0
    audible_m: float = 8.0  # silence beyond
    spread_m: float = 0.5  # sources nearer than this spread over all loudspeakers
    air: float = 0.0  # absorption of high frequencies, multiple of air's
    with_doppler: bool = False

    def __post_init__(self) -> None:
        least_m = 1.0 / FARTHEST_M
        for name in ("reference_m", "audible_m", "spread_m"):
            value = getattr(self, name)
            if not least_m <= value <= FARTHEST_M:
                raise ValueError(f"{name}: expected {least_m:g} to {FARTHEST_M:g}, got {value:g}")
        if not 0.0 <= self.air <= _THICKEST:
            raise ValueError(f"air: expected 0 to {_THICKEST:g}, got {self.air:g}")

    def gains(self, distances_m: F64) -> tuple[F64, F64]:
        """Gains (n,) of the dry and the wet part at distances (n,); 0 beyond the audible radius.
        Their squares sum to 1 up to the fade-out over the last tenth of the radius."""
        # 45 degrees at the reference distance, where cosine and sine are equal.
        angle = 0.25 * np.pi * np.minimum(distances_m / self.reference_m, 2.0)
        audible = (self.audible_m - distances_m) / (_FADE * self.audible_m)
        audible = np.clip(np.nan_to_num(audible), 0.0, 1.0)
        return np.cos(angle) * audible, np.sin(angle) * audible


def absorption_db_m(frequencies_hz: F64) -> F64:
    """Absorption of pure tones (n,) in air, dB/m, at 20 degC, 50 % humidity and 101.325 kPa. ISO
    9613-1, equations 3 to 5 and B.3."""
    temperature = 293.15  # kelvins
    # Relaxation of oxygen and nitrogen depends on the share of water vapour.
    vapour = _HUMIDITY * 10.0 ** (4.6151 - 6.8346 * (273.16 / temperature) ** 1.261)  # per cent
    oxygen_hz = 24.0 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour)
    nitrogen_hz = 9.0 + 280.0 * vapour
    squared = np.square(frequencies_hz)
    oxygen = 0.01275 * np.exp(-2239.1 / temperature) / (oxygen_hz + squared / oxygen_hz)
    nitrogen = 0.1068 * np.exp(-3352.0 / temperature) / (nitrogen_hz + squared / nitrogen_hz)
    loss: F64 = 8.686 * squared * (1.84e-11 + oxygen + nitrogen)
    return loss


def doppler_hz(frequencies_hz: F64, distances_m: F64, rate_hz: float) -> F64:
    """Heard frequencies (n,) of a source at distances (n,), m; higher while approaching.

    ``rate_hz`` is the rate of the rows. Jumps (above half the speed of sound) and a single row are
    not shifted.
    """
    if len(distances_m) < 2:
        return frequencies_hz
    away = np.gradient(distances_m) * rate_hz / SPEED_OF_SOUND_M_S
    away = np.where(np.abs(away) <= _FASTEST, away, 0.0)
    return np.asarray(frequencies_hz / (1.0 + away))


class ListenerFrame:
    """Listener space of a body: moves with the torso bone of the largest sum of weights."""

    def __init__(self, binding: SkinBinding, model: PerceptualModel) -> None:
        fitted = binding.fitted.get(model.id)
        placed = model if fitted is None else fitted.of(model)
        torso = np.flatnonzero(placed.part == PARTS.index("torso"))
        weights, shares = placed.weights, np.zeros(len(placed.bone_names))
        entries, _ = expand(weights.offsets.astype(np.int64), torso)
        np.add.at(shares, weights.bones[entries], weights.values[entries])
        self._bone = binding.bone_names.index(placed.bone_names[int(np.argmax(shares))])
        self._middle = placed.vertices[torso].astype(np.float64).mean(axis=0)

    def frames(self, pose: PoseBlock, rows: I64) -> F64:
        """World to listener space at rows of a pose, (n, 4, 4), m; never scaled or sheared. The
        origin is the mean of the torso's vertices on the bone."""
        assert pose.bones is not None
        posed = np.zeros((len(rows), 4, 4))
        posed[:, :3] = pose.bones[rows, self._bone]
        posed[:, 3, 3] = 1.0
        world = pose.to_world[rows] @ posed
        places = world[:, :3, :3] @ self._middle + world[:, :3, 3]
        # The nearest rotation (polar decomposition) drops the bone's scale and shear.
        u, _, vt = np.linalg.svd(world[:, :3, :3])
        turns = u @ vt
        frames = np.zeros((len(rows), 4, 4))
        frames[:, :3, :3] = _FROM_REST @ turns.transpose(0, 2, 1)
        frames[:, :3, 3] = -np.einsum("nij,nj->ni", frames[:, :3, :3], places)
        frames[:, 3, 3] = 1.0
        return frames
