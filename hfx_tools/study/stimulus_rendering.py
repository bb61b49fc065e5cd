# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of the conditions of a trial as a raster of a device.

Kinds: a straight line over the device (Schneider et al., UIST 2015), a steady strength, a stroke
over a material, and a file or sensation.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final, get_args

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import BodyPlace, DeviceConfig, Scheme, SchemeName
from hfx_blender.engine.rendering.panning.bursts import Bursts, rhythm_s
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.schemes import panned_layout
from hfx_blender.errors import InputError

from .plan import Conditions, Plan, Value, as_text
from .stimulus_files import file_raster, raster_of

COMPASS: Final = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_LAWS: Final = {"linear": "linear", "log": "log", "logarithmic": "log", "power": "power"}
_SCHEMES: Final = get_args(SchemeName)
_STRENGTHS: Final = ("strength", "amplitude", "intensity")
_COMMON: Final = frozenset({"device", "duration_ms", *_STRENGTHS, "level_db"})
PARAMETERS: Final = {
    "line": _COMMON | {"scheme", "direction", "frequency_hz"},
    "steady": _COMMON | {"actuator", "frequency_hz"},
    "stroke": _COMMON | {"surface", "speed_mm_s"},
    "file": _COMMON | {"scheme", "take", "effect"},
}
"""Factors with an effect on the stimulus, by kind."""

_DEFAULTS: Final[dict[str, Value]] = {"strength": 0.5, "duration_ms": 500.0, "speed_mm_s": 100.0}
_STROKE_TEXELS: Final = 512


def kind_of(plan: Plan) -> str:
    """Kind of a plan's stimuli, a key of ``PARAMETERS``."""
    kind = str(plan.stimulus.get("kind", "auto"))
    if kind != "auto":
        return kind
    names = {*plan.factors, *plan.compare, *plan.random, plan.level_factor}
    for kind, sign in (("file", {"take", "effect"}), ("stroke", {"surface"})):
        if names & sign:
            return kind
    return "line" if "direction" in names else "steady"


def relevant_factors(plan: Plan) -> frozenset[str]:
    """Factors that the stimuli depend on. InputError for a compared, identified or varied factor
    without an effect, as all of its stimuli would be equal."""
    kind = kind_of(plan)
    known = PARAMETERS[kind] | set(re.findall(r"\{(\w+)\}", str(plan.stimulus.get("path", ""))))
    varied = {*plan.compare, plan.identify, plan.level_factor} - {""}
    for name in sorted(varied - known):
        raise InputError(
            f"{plan.path}: '{name}' is compared, but no stimulus of the kind {kind} depends on it; "
            f"allowed are {', '.join(sorted(known))}."
        )
    return known & {*plan.factors, *plan.random, *plan.compare, *varied}


def rendered(plan: Plan, conditions: Conditions, device: DeviceConfig) -> Raster:
    """Raster of a stimulus, from its first row with strength on. InputError for a value that the
    device or kind cannot have."""
    settings = {**_DEFAULTS, **plan.stimulus, **conditions}
    check = _Checked(plan, settings)
    device = _with_scheme(device, settings.get("scheme"), plan)
    kind = kind_of(plan)
    if kind == "file":
        is_cut = "duration_ms" in {**plan.stimulus, **conditions}
        has_strength = not _COMMON.isdisjoint(
            {**plan.stimulus, **conditions}.keys() - {"device", "duration_ms"}
        )
        raster = file_raster(plan, conditions, device)
        if is_cut:
            count = max(round(check.seconds * float(raster.rate_hz)), 1)
            raster = replace(raster, values=raster.values[:count], times_s=raster.times_s[:count])
        if has_strength:
            raster = replace(raster, values=_scaled(device, raster.values, check.strength))
        return raster
    rate_hz = _rate_hz(device)
    count = max(round(check.seconds * rate_hz), 1)
    values = {"line": _line, "steady": _steady, "stroke": _stroke}[kind](
        device, check, count, rate_hz
    )
    return raster_of(device, values, Fraction(rate_hz).limit_denominator(1001))


class _Checked:
    """Parameters of a stimulus with their ranges; InputError for a value outside."""

    def __init__(self, plan: Plan, settings: dict[str, Any]) -> None:
        self._plan, self._settings = plan, settings

    def number(self, name: str, lowest: float, highest: float) -> float:
        value = self._settings[name]
        if isinstance(value, str) or not lowest <= value <= highest:
            self.fail(name, f"a number from {lowest:g} to {highest:g}")
        return float(value)

    def fail(self, name: str, allowed: str) -> None:
        value = as_text(self._settings[name])[:60]
        raise InputError(f"{self._plan.path}: {name} is '{value}', allowed is {allowed}.")

    def __contains__(self, name: str) -> bool:
        return name in self._settings

    @property
    def seconds(self) -> float:
        return self.number("duration_ms", 10, 60_000) / 1000.0

    @property
    def strength(self) -> float:
        """Share of the actuators' range, 0..1."""
        strength = self.number("strength", 0, 1)
        for name in _STRENGTHS[1:]:
            if name in self:
                strength = self.number(name, 0, 1)
        if "level_db" in self:
            strength = 10.0 ** (self.number("level_db", -120, 0) / 20.0)
        return strength

    @property
    def angle_rad(self) -> float:
        """Direction, counted from the right against the clock: compass, or degrees from north."""
        value = self._settings["direction"]
        if value in COMPASS:
            degrees = 45.0 * COMPASS.index(value)
        else:
            if isinstance(value, str):
                self.fail("direction", f"one of {', '.join(COMPASS)}, or degrees from north")
            degrees = self.number("direction", -360, 360)
        return math.radians(90.0 - degrees)

    def text(self, name: str) -> str:
        return as_text(self._settings[name])


def _rate_hz(device: DeviceConfig) -> int:
    """Rows a second: updates of the fastest actuator, at most 200."""
    fastest = min(actuator.type.update_interval_ms for actuator in device.actuators)
    return round(min(max(1000.0 / fastest, 20.0), 200.0))


def _with_scheme(device: DeviceConfig, scheme: Value | None, plan: Plan) -> DeviceConfig:
    """Device with a rendering scheme, or a law of the barycentric scheme; None: as configured."""
    if scheme is None:
        return device
    if scheme in _LAWS:
        name = device.scheme.name if device.scheme.name == "surface" else "barycentric"
        law: Any = _LAWS[str(scheme)]
        return replace(device, scheme=Scheme(name, law=law))
    if scheme not in _SCHEMES:
        allowed = ", ".join((*_SCHEMES, *_LAWS))
        raise InputError(
            f"{plan.path}: scheme is '{as_text(scheme)[:60]}', allowed is one of {allowed}."
        )
    return device.rendered_by(str(scheme))


def _neutral(device: DeviceConfig, count: int) -> F64:
    return np.tile(device.neutral, (count, 1))


def _set(device: DeviceConfig, values: F64, actuator: int, shares: Any, hertz: Any) -> None:
    """Set strength shares of an actuator's range, scalar or (T,), and a frequency if not None."""
    part = device.actuator_columns[actuator]
    for k, control in enumerate(device.actuators[actuator].type.controls):
        column = values[:, part.start + k]
        if k == 0:
            up = control.highest - control.neutral
            reach = up if up > 0.0 else control.lowest - control.neutral
            column[:] = control.neutral + np.asarray(shares) * reach
        elif hertz is not None and control.name.startswith("frequency"):
            column[:] = hertz


def _vibrating(device: DeviceConfig) -> list[int]:
    """Indices of the vibration actuators; of all actuators for a device without vibration."""
    kinds = [actuator.type.modality for actuator in device.actuators]
    return [k for k, kind in enumerate(kinds) if kind == "vibration" or "vibration" not in kinds]


def _hertz(check: _Checked) -> float | None:
    return check.number("frequency_hz", 1, 1000) if "frequency_hz" in check else None


def _steady(device: DeviceConfig, check: _Checked, count: int, rate_hz: float) -> F64:
    """Constant strength of all actuators, or of the named actuator."""
    values, chosen = _neutral(device, count), _vibrating(device)
    if "actuator" in check:
        ids = [actuator.id for actuator in device.actuators]
        if check.text("actuator") not in ids:
            check.fail("actuator", f"one of {', '.join(ids)}")
        chosen = [ids.index(check.text("actuator"))]
    for k in chosen:
        _set(device, values, k, check.strength, _hertz(check))
    return values


def _line(device: DeviceConfig, check: _Checked, count: int, rate_hz: float) -> F64:
    """Virtual actuator on a straight line through the middle of the layout, at constant speed."""
    chosen = _vibrating(device)
    actuators = [device.actuators[k] for k in chosen]
    model = load_model(f"hfx-{MODALITIES[actuators[0].type.modality].model}-1")
    layout = panned_layout(device, actuators, model)
    places = [actuator.place for actuator in actuators]
    if layout is None or not all(isinstance(one, BodyPlace) for one in places):
        raise InputError(
            f"Device '{device.id}': a line needs actuators on the body and a scheme that pans; "
            f"'{device.scheme.name}' does not."
        )
    centres = np.array([one.centre_m for one in places if isinstance(one, BodyPlace)])
    middle = centres.mean(axis=0)
    if device.mount is not None:
        axes = np.array([device.mount.x_axis, device.mount.y_axis])
    else:
        axes = np.linalg.svd(centres - middle)[2][:2]
    angle = check.angle_rad
    direction = np.array([math.cos(angle), math.sin(angle)]) @ axes
    along = (centres - middle) @ direction
    # From side to side of the layout: the shorter side counts, so that the middle is the middle.
    half_m = min(along.max(), -along.min())
    times = (np.arange(count) + 0.5) / count
    points = middle + np.outer((2.0 * times - 1.0) * half_m, direction)
    gains = np.asarray(layout.at(points))
    rhythm = rhythm_s(device.scheme)
    if rhythm is not None:
        gains = Bursts(*rhythm).gains(np.arange(count) / rate_hz, gains)
    values = _neutral(device, count)
    for k, gain in zip(chosen, gains.T, strict=True):
        _set(device, values, k, check.strength * gain, _hertz(check))
    return values


def _stroke(device: DeviceConfig, check: _Checked, count: int, rate_hz: float) -> F64:
    """Stroke over a material at constant speed, on all vibration actuators; the strongest moment
    has the strength of the stimulus."""
    from hfx_blender.engine.texture.procedural import MATERIALS
    from hfx_blender.engine.texture.stroke import line
    from hfx_blender.engine.texture.stroke_rendering import render_stroke

    if "surface" not in check or check.text("surface") not in MATERIALS:
        allowed = f"one of {', '.join(MATERIALS)}"
        if "surface" in check:
            check.fail("surface", allowed)
        raise InputError(f"a stroke needs the factor 'surface', allowed is {allowed}.")
    texture = _texture(check.text("surface"))
    speed_m_s = check.number("speed_mm_s", 1, 1000) / 1000.0
    # One more step than is played: a stroke of whole steps may end early by rounding.
    stroke = line((0.0, 0.0), 0.35, speed_m_s * (count + 1) / rate_hz, speed_m_s)
    signal = render_stroke(texture, stroke, step_s=1.0 / rate_hz)
    shares = signal.amplitude_m_s2[:count] / texture.device.amplitude_m_s2(1.0)
    values = _neutral(device, count)
    for k in _vibrating(device):
        _set(device, values, k, check.strength * shares, signal.frequency_hz[:count])
    return values


@lru_cache(maxsize=16)
def _texture(name: str) -> Any:
    """Haptic map of a procedural material."""
    from hfx_blender.engine.texture import mcha
    from hfx_blender.engine.texture.haptic_map import SurfaceTexture
    from hfx_blender.engine.texture.procedural import MATERIALS

    height, roughness = MATERIALS[name].make(_STROKE_TEXELS)
    return SurfaceTexture(map=mcha.make_map(height, roughness=roughness))


def _scaled(device: DeviceConfig, values: F64, share: float) -> F64:
    """Values with the strengths' distances from neutral multiplied by ``share``."""
    scaled, columns = values.copy(), device.strength_columns
    neutral = device.neutral[columns]
    scaled[:, columns] = neutral + share * (values[:, columns] - neutral)
    return scaled
