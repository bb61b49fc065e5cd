# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of the conditions of a trial as a raster of a device.

Kinds: a straight line over the device (Schneider et al., UIST 2015), a steady strength, a stroke
over a material, and a file or sensation.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final, NoReturn

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import BodyPlace, DeviceConfig, Scheme
from hfx_blender.engine.rendering.panning.bursts import Bursts, rhythm_s
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.schemes import panned_layout
from hfx_blender.errors import InputError

from .parameters import COMPASS, LAWS, STRENGTHS, allowed_instead
from .plan import Conditions, Plan, Value, as_text
from .plan_values import kind_of
from .stimulus_files import file_raster, raster_of

_DEFAULTS: Final[dict[str, Value]] = {"strength": 0.5, "duration_ms": 500.0, "speed_mm_s": 100.0}
_STROKE_TEXELS: Final = 512


def rendered(plan: Plan, conditions: Conditions, device: DeviceConfig) -> Raster:
    """Raster of a stimulus, from its first row with strength on. InputError for a value that the
    device or kind cannot have."""
    settings = {**_DEFAULTS, **plan.stimulus, **conditions}
    check = _Checked(plan, settings)
    if "scheme" in settings:
        device = _with_scheme(device, str(check.value("scheme")))
    kind = kind_of(plan)
    if kind == "file":
        is_cut = "duration_ms" in {**plan.stimulus, **conditions}
        has_strength = not {*STRENGTHS, "level_db"}.isdisjoint(
            {**plan.stimulus, **conditions}.keys()
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

    def value(self, name: str) -> Any:
        """Value of a parameter that is allowed for every device; InputError for a missing one."""
        if name not in self:
            raise InputError(f"{self._plan.path}: the factor '{name}' is missing.")
        value = self._settings[name]
        allowed = allowed_instead(name, value)
        if allowed:
            self.fail(name, allowed)
        return value

    def number(self, name: str) -> float:
        return float(self.value(name))

    def fail(self, name: str, allowed: str) -> NoReturn:
        value = self._settings[name]
        shown = f"'{value[:60]}'" if isinstance(value, str) else repr(value)
        raise InputError(f"{self._plan.path}: {name} is {shown}, allowed is {allowed}.")

    def __contains__(self, name: str) -> bool:
        return name in self._settings

    @property
    def seconds(self) -> float:
        return self.number("duration_ms") / 1000.0

    @property
    def strength(self) -> float:
        """Share of the actuators' range, 0..1."""
        strength = self.number("strength")
        for name in STRENGTHS[1:]:
            if name in self:
                strength = self.number(name)
        if "level_db" in self:
            strength = 10.0 ** (self.number("level_db") / 20.0)
        return strength

    @property
    def angle_rad(self) -> float:
        """Direction, counted from the right against the clock: compass, or degrees from north."""
        value = self.value("direction")
        degrees = 45.0 * COMPASS.index(value) if value in COMPASS else float(value)
        return math.radians(90.0 - degrees)

    def text(self, name: str) -> str:
        return as_text(self._settings[name])


def _rate_hz(device: DeviceConfig) -> int:
    """Rows a second: updates of the fastest actuator, at most 200."""
    fastest = min(actuator.type.update_interval_ms for actuator in device.actuators)
    return round(min(max(1000.0 / fastest, 20.0), 200.0))


def _with_scheme(device: DeviceConfig, scheme: str) -> DeviceConfig:
    """Device with a rendering scheme, or a law of the barycentric scheme."""
    if scheme not in LAWS:
        return device.rendered_by(scheme)
    name = device.scheme.name if device.scheme.name == "surface" else "barycentric"
    law: Any = LAWS[scheme]
    return replace(device, scheme=Scheme(name, law=law))


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
    return check.number("frequency_hz") if "frequency_hz" in check else None


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
    from hfx_blender.engine.texture.stroke import line
    from hfx_blender.engine.texture.stroke_rendering import render_stroke

    texture = _texture(str(check.value("surface")))
    speed_m_s = check.number("speed_mm_s") / 1000.0
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
