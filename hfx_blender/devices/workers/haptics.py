# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of a device script: the haptic data of one moment, and the device's layout.

``docs/device-scripts.md`` describes it for those who write scripts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.rendering.device_config import Actuator, DeviceConfig
from ...engine.samples import SampleRun
from ...processes.messages import MessageError
from .message_bodies import Array, as_row, decode_arrays, encode_arrays

API_VERSION: Final = 1
"""Changes whenever a script could notice; an approval is for one version."""


@dataclass(frozen=True, eq=False)
class Effect:
    """Effect that is felt now by the wearer."""

    name: str  # the effect's id
    modality: str
    model: str  # perceptual model that vertices belong to
    level: float  # of its clips and intensity, in (0, 1]
    parameters: Mapping[str, float]  # of the modality, in SI units and degrees Celsius
    vertices: npt.NDArray[np.int32]  # (n,) where it is felt
    weights: npt.NDArray[np.float32]  # (n,) how strongly, in (0, 1]
    gains: F64  # (A,) how strongly it reaches each actuator where that is, in 0..1
    positions: npt.NDArray[np.float32] | None = None  # (n, 3) world space, metres
    velocities: npt.NDArray[np.float32] | None = None  # (n, 3) m/s
    depth_m: npt.NDArray[np.float32] | None = None  # (n,) to the volume's boundary


@dataclass(frozen=True, eq=False)
class Haptics:
    """Haptic data of one moment.

    Attributes
    ----------
    time_s : float
        On the scene's clock.
    felt : tuple of Effect
        By the wearer of the device; also of modalities that the device does not have.
    values : (columns,) float64
        What is sent without a script: controls of all actuators, one after the other.
    device : DeviceConfig
        As its configuration has it.
    """

    time_s: float
    felt: tuple[Effect, ...]
    values: F64
    device: DeviceConfig

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        return self.device.actuators

    @property
    def columns(self) -> tuple[tuple[str, str], ...]:
        """Actuator and control of each value."""
        return tuple(
            (actuator.id, control.name)
            for actuator in self.device.actuators
            for control in actuator.type.controls
        )

    @property
    def neutral(self) -> F64:
        """Silence, (columns,); a copy that may be changed."""
        return self.device.neutral

    def strongest(self, modality: str) -> Effect | None:
        """Strongest effect of a modality; None without any."""
        found = [each for each in self.felt if each.modality == modality]
        return max(found, key=_strength, default=None)


def _strength(effect: Effect) -> float:
    return effect.level * abs(next(iter(effect.parameters.values())))


ARRAYS: Final = ("positions", "velocities", "depth_m")


def encode_haptics(time_s: float, felt: Sequence[tuple[SampleRun, F64]], values: F64) -> bytes:
    """Haptic data as bytes.

    Parameters
    ----------
    felt : sequence of (run, gains)
        A run of one sample, and how strongly it reaches each actuator (A,).
    values : (columns,)
    """
    effects: list[dict[str, Any]] = []
    arrays: dict[str, Array] = {"values": values}
    for k, (run, gains) in enumerate(felt):
        effects.append(
            {
                "name": run.stream.effect_id,
                "modality": run.stream.modality,
                "model": run.stream.model_id,
                "level": float(run.levels[0]),
            }
        )
        arrays[f"{k} parameters"] = run.parameters[0]
        arrays[f"{k} vertices"] = run.vertices
        arrays[f"{k} weights"] = run.weights
        arrays[f"{k} gains"] = gains
        for name in ARRAYS:
            found = getattr(run, name)
            if found is not None:
                arrays[f"{k} {name}"] = found
    return encode_arrays({"time_s": time_s, "effects": effects}, arrays)


def decode_haptics(body: bytes, device: DeviceConfig) -> Haptics:
    """Restore haptic data from :func:`encode_haptics` bytes.

    Raises
    ------
    MessageError
        The body is not such a one.
    """
    content, arrays = decode_arrays(body)
    try:
        felt = []
        for k, each in enumerate(content["effects"]):
            names = [p.name for p in MODALITIES[each["modality"]].parameters]
            parameters = arrays[f"{k} parameters"].tolist()
            felt.append(
                Effect(
                    each["name"],
                    each["modality"],
                    each["model"],
                    each["level"],
                    dict(zip(names, parameters, strict=True)),
                    arrays[f"{k} vertices"],
                    arrays[f"{k} weights"],
                    arrays[f"{k} gains"],
                    *(arrays.get(f"{k} {name}") for name in ARRAYS),
                )
            )
        return Haptics(float(content["time_s"]), tuple(felt), arrays["values"], device)
    except (KeyError, TypeError, ValueError) as error:
        raise MessageError(f"not haptic data: {error}") from None


def as_values(answer: Any, haptics: Haptics) -> F64:
    """A script's answer as values (columns,).

    Parameters
    ----------
    answer : sequence of float, or mapping
        One value for each column; or by actuator a number, its strength, or by control a
        number. What a mapping leaves out is silent. None is silence.

    Raises
    ------
    ValueError
        It is neither.
    """
    if answer is None:
        return haptics.neutral
    columns = haptics.columns
    if not isinstance(answer, Mapping):
        values = as_row(answer)
        if values.shape != (len(columns),):
            raise ValueError(
                f"the script returned values of shape {np.shape(answer)}, expected "
                f"({len(columns)},): one number for each control of each actuator"
            )
        return values
    place = {column: k for k, column in enumerate(columns)}
    strengths = {a.id: a.type.strength.name for a in haptics.actuators}
    values = haptics.neutral
    for actuator, wanted in answer.items():
        if actuator not in strengths:
            raise ValueError(
                f"the script returned the unknown actuator {actuator!r}; "
                f"there are: {', '.join(strengths)}"
            )
        by_control = wanted if isinstance(wanted, Mapping) else {strengths[actuator]: wanted}
        for control, value in by_control.items():
            if (actuator, control) not in place:
                raise ValueError(f"actuator '{actuator}' has no control {control!r}")
            values[place[actuator, control]] = float(value)
    return values
