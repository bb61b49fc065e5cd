# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of a device script: haptic data of a moment, and the layout of the device.

``docs/device-scripts.md`` is the documentation for authors of scripts.
"""

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

API_VERSION: Final = 1  # version of the interface of scripts; an approval is valid for one version


@dataclass(frozen=True, eq=False)
class Effect:
    """Effect on the wearer's body at a moment."""

    name: str  # id of the effect
    modality: str
    model: str  # id of the perceptual model of the vertices
    level: float  # product of clips and intensity, (0, 1]
    parameters: Mapping[str, float]  # by name, in SI units and degrees Celsius
    vertices: npt.NDArray[np.int32]  # (n,) affected vertices
    weights: npt.NDArray[np.float32]  # (n,) strengths at the vertices, (0, 1]
    gains: F64  # (A,) strengths at the actuators' places, 0..1
    positions: npt.NDArray[np.float32] | None = None  # (n, 3) world space, metres
    velocities: npt.NDArray[np.float32] | None = None  # (n, 3) m/s
    depth_m: npt.NDArray[np.float32] | None = None  # (n,) distances to the volume's boundary
    forces_n: npt.NDArray[np.float32] | None = None  # (n, 3) on the skin, world space, newtons
    label: str = ""  # name in Blender, chosen by the artist; several effects may have one


@dataclass(frozen=True, eq=False)
class Haptics:
    """Haptic data of a moment."""

    time_s: float  # on the scene's clock
    felt: tuple[Effect, ...]  # on the wearer, also of modalities missing on the device
    values: F64  # (columns,) without the script: controls of all actuators, actuator by actuator
    device: DeviceConfig
    jumped: bool = False  # the time does not follow that of the last call
    stopped: bool = False  # first call after a start or stop: the device has been silent

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        return self.device.actuators

    @property
    def columns(self) -> tuple[tuple[str, str], ...]:
        """Actuator id and control name of each value, actuator by actuator."""
        return tuple(
            (actuator.id, control.name)
            for actuator in self.device.actuators
            for control in actuator.type.controls
        )

    @property
    def neutral(self) -> F64:
        """Silent values (columns,); a copy, which may be changed."""
        return self.device.neutral

    def strongest(self, modality: str) -> Effect | None:
        """Effect of a modality with the largest product of level and size of the first parameter;
        the first of equals, None without any."""
        effects = [effect for effect in self.felt if effect.modality == modality]
        # The first parameter is the strength of each modality.
        return max(
            effects, key=lambda x: x.level * abs(next(iter(x.parameters.values()))), default=None
        )


ARRAYS: Final = ("positions", "velocities", "depth_m", "forces_n")
"""Optional arrays of an effect, fields of :class:`Effect` and of ``SampleRun``."""


def encode_haptics(
    time_s: float,
    felt: Sequence[tuple[SampleRun, F64]],
    values: F64,
    labels: Mapping[str, str] | None = None,
) -> bytes:
    """Encode the haptic data of a moment.

    ``felt``: runs of one sample, and their gains (A,) at the actuators.
    ``values``: (columns,) without the script.
    ``labels``: names of the effects in Blender, by id.
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
                "label": (labels or {}).get(run.stream.effect_id, ""),
            }
        )
        # Arrays are named by the number of their effect.
        arrays[f"{k} parameters"] = run.parameters[0]
        arrays[f"{k} vertices"] = run.vertices
        arrays[f"{k} weights"] = run.weights
        arrays[f"{k} gains"] = gains
        for name in ARRAYS:
            array = getattr(run, name)
            if array is not None:
                arrays[f"{k} {name}"] = array
    return encode_arrays({"time_s": time_s, "effects": effects}, arrays)


def decode_haptics(body: bytes, device: DeviceConfig) -> Haptics:
    """Decode bytes of :func:`encode_haptics`; MessageError if invalid."""
    content, arrays = decode_arrays(body)
    try:
        effects = []
        for k, head in enumerate(content["effects"]):
            names = [p.name for p in MODALITIES[head["modality"]].parameters]
            parameters = arrays[f"{k} parameters"].tolist()
            effects.append(
                Effect(
                    head["name"],
                    head["modality"],
                    head["model"],
                    head["level"],
                    dict(zip(names, parameters, strict=True)),
                    arrays[f"{k} vertices"],
                    arrays[f"{k} weights"],
                    arrays[f"{k} gains"],
                    **{name: arrays.get(f"{k} {name}") for name in ARRAYS},
                    label=head["label"],
                )
            )
        return Haptics(float(content["time_s"]), tuple(effects), arrays["values"], device)
    except (KeyError, TypeError, ValueError) as error:
        raise MessageError(f"not haptic data: {error}") from None


def as_values(answer: Any, haptics: Haptics) -> F64:
    """Convert the answer of a script to values (columns,).

    ``answer``: a value for each column; or a mapping from actuator id to a strength or to a mapping
    from control to value, where missing entries are silent. None is silence.

    Raises ValueError: the length is wrong, a value is no number, or an actuator or control is
    unknown.
    """
    if answer is None:
        return haptics.neutral
    columns = haptics.columns
    # A row of numbers names no actuators, so that only its length can be checked.
    if not isinstance(answer, Mapping):
        values = as_row(answer)
        if values.shape != (len(columns),):
            items = np.asarray(answer, object)
            kinds = ", ".join(sorted({type(item).__name__ for item in items.flat})) or "none"
            raise ValueError(
                f"the script returned values of shape {items.shape} and type {kinds}, expected "
                f"({len(columns)},) and float, or int of 64 bits: one number for each control of "
                "each actuator"
            )
        return values
    index = {column: k for k, column in enumerate(columns)}
    controls = haptics.device.controls
    strengths = {a.id: a.type.strength.name for a in haptics.actuators}
    values = haptics.neutral
    for actuator, entry in answer.items():
        if actuator not in strengths:
            raise ValueError(
                f"the script returned the unknown actuator {actuator!r}; "
                f"there are: {', '.join(strengths)}"
            )
        # A single number is the strength.
        by_control = entry if isinstance(entry, Mapping) else {strengths[actuator]: entry}
        for control, value in by_control.items():
            if (actuator, control) not in index:
                raise ValueError(f"actuator '{actuator}' has no control {control!r}")
            column = index[actuator, control]
            choices = controls[column].choices
            try:
                values[column] = choices.index(value) if isinstance(value, str) else float(value)
            except (TypeError, ValueError, OverflowError):
                found = repr(value) if isinstance(value, str) else f"'{type(value).__name__}'"
                raise ValueError(
                    f"the script returned {found} for control '{control}' of actuator "
                    f"'{actuator}'; allowed is {', '.join(choices) or 'a number that fits a float'}"
                ) from None
    return values
