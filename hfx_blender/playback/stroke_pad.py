# SPDX-License-Identifier: GPL-3.0-or-later
"""Stroke pad: a surface stroked by the mouse, with vibration and friction sound.

No drawing and no window here; ``operators/surfaces/stroke_pad_view.py`` draws the pad.
"""

import logging
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..blender.events import call_soon, remove_timers
from ..engine.arrays import F64
from ..engine.surface.surface_drive import SurfaceDrive
from ..engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from ..engine.texture.height_field import HeightField
from ..engine.texture.procedural import reference_fabrics, woven
from ..engine.texture.stroke import FAST_M_S, SLOW_M_S, Stroke, line
from ..engine.texture.stroke_rendering import StrokeSignal, render_stroke
from ..errors import InputError
from .live.live import live

TARGETS_M_S = (SLOW_M_S, FAST_M_S)
TARGET_PX_S = 200.0
"""Speed of the pointer on the screen at the target speed, pixels a second."""

SPEED_WINDOW_S = 0.15
LONGEST_S = 60.0
WAVEFORM_HZ = 8000.0

# Time step of drawn values within several positions, seconds.
_FELT_STEP_S = 0.008

# Spacing of the drawn line's points, pixels.
_TRAIL_STEP_PX = 1.0

REFERENCE_S = 2.0
_FABRIC_M = 0.02
_FABRIC_TEXELS = 512
_DIRECTION_RAD = np.radians(20.0)  # along the threads nothing would change

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StrokeState:
    """Momentary state under the finger."""

    speed_m_s: float = 0.0
    height_m: float = 0.0
    amplitude_m_s2: float = 0.0
    frequency_hz: float = 0.0


@dataclass(frozen=True, eq=False)
class Take:
    """Finished stroke with the signal."""

    name: str  # of the surface
    texture: SurfaceTexture
    stroke: Stroke
    signal: StrokeSignal


class StrokePad:
    """Pad with a surface under the mouse; ``name`` is that of the surface, for messages."""

    def __init__(self, name: str, texture: SurfaceTexture) -> None:
        self.name = name
        self.texture = texture
        self.brightest = 1.0 if texture.map is None else float(texture.map.intensity.max())
        self.target_m_s = SLOW_M_S
        """Target speed, metres a second; sets the pad's scale."""
        self.now = StrokeState()
        self.take: Take | None = None
        self.fault = ""
        self._begin_s = 0.0
        # Relative to the stroke's start: differences of large clock values lose precision.
        self._times: list[float] = []
        self._points: list[tuple[float, float]] = []
        self._rendered_s = self._felt_s = 0.0
        self.trail_m: list[tuple[float, float]] = []
        """Drawn path of the current stroke; empty between strokes."""
        self.history: list[tuple[float, StrokeState]] = []  # of the present or the last stroke
        self.waveform_m_s2: F64 = np.zeros(2)  # of the last step

    @property
    def metres_per_pixel(self) -> float:
        return self.target_m_s / TARGET_PX_S

    @property
    def drive(self) -> SurfaceDrive | None:
        """Surface drive for devices with a calibration (c_v) of their own."""
        return SurfaceDrive.of(self.texture)

    @property
    def is_stroking(self) -> bool:
        return bool(self._times)

    @property
    def path_m(self) -> F64:
        """Path of the present stroke, (N, 2) metres; empty between strokes."""
        return np.array(self._points, np.float64).reshape(-1, 2)

    def press(self, time_s: float, point_m: tuple[float, float]) -> None:
        """Begin a stroke at a surface point; fault and history are cleared."""
        self._begin_s = time_s
        self._times, self._points, self.trail_m = [0.0], [point_m], [point_m]
        self.now = StrokeState(height_m=self._height(point_m))
        self._rendered_s, self.fault, self.history = 0.0, "", []

    def move(self, time_s: float, point_m: tuple[float, float]) -> None:
        """Move the pointer; a time not after the last is ignored."""
        self.move_through([point_m], time_s)

    def move_through(self, points_m: Sequence[tuple[float, float]], time_s: float) -> None:
        """Move the pointer through points since the last call, at equal intervals.

        A busy window delivers several mouse events at once, without their times. The state is
        evaluated every 8 ms at most, and at the end. No effect between strokes, at a time not after
        the last, and after :data:`LONGEST_S`, which is a fault.
        """
        now = time_s - self._begin_s
        if not self._times or now <= self._times[-1]:
            return
        if now > LONGEST_S:
            self.fault = f"a stroke lasts {LONGEST_S:g} s at most"
            return
        # Mouse events have no times of their own: equal intervals are the best guess.
        times = np.linspace(self._times[-1], now, len(points_m) + 1)[1:]
        for at_s, point in zip(times.tolist(), points_m, strict=True):
            if at_s <= self._times[-1]:
                continue  # closer together than a clock can tell
            self._times.append(at_s)
            self._points.append(point)
            way = np.hypot(point[0] - self.trail_m[-1][0], point[1] - self.trail_m[-1][1])
            if way >= _TRAIL_STEP_PX * self.metres_per_pixel:
                self.trail_m.append(point)
            if not self.history or at_s - self._felt_s >= _FELT_STEP_S or at_s == now:
                self._feel(at_s)

    def rest(self, time_s: float) -> None:
        """Extend the stroke to a time, with the pointer at rest; no effect between strokes."""
        if self._times:
            self.move(time_s, self._points[-1])

    def next_step(self) -> StrokeSignal | None:
        """Signal since the last call, in whole steps of the device; None without any."""
        step = self.texture.device.update_s
        if not self._times or self._times[-1] - self._rendered_s < step:
            return None
        # The factor keeps a whole step that rounding has made slightly too short.
        count = int((self._times[-1] - self._rendered_s) / step * (1.0 + 1e-9))
        signal = self._render(self._rendered_s, self._rendered_s + count * step)
        self._rendered_s += count * step
        return signal

    def release(self, time_s: float) -> Take | None:
        """End the stroke and return it, also as :attr:`take`; None for a stroke below the shortest
        duration, with a :attr:`fault`. The pad is ready for the next stroke."""
        self.rest(time_s)
        times, points = np.array(self._times), self.path_m
        self.cancel()
        try:
            stroke = Stroke(times, points)
            signal = render_stroke(self.texture, stroke, waveform_rate_hz=WAVEFORM_HZ)
        except (InputError, IndexError) as error:
            self.fault = str(error)
            return None
        self.take = Take(self.name, self.texture, stroke, signal)
        return self.take

    def cancel(self) -> None:
        """Discard the stroke and its state; :attr:`history` stays."""
        self._times, self._points, self.trail_m, self.now = [], [], [], StrokeState()

    def recent(self, seconds: float) -> list[tuple[float, StrokeState]]:
        """Times and values of the last seconds of the current or the last stroke, oldest first."""
        if not self.history:
            return []
        begin = self.history[-1][0] - seconds
        return self.history[bisect_left(self.history, begin, key=lambda row: row[0]) :]

    def _feel(self, time_s: float) -> None:
        """Set :attr:`now` and the waveform to a time of the present stroke, and extend the history;
        amplitude and frequency are 0 within the first step of the device."""
        self._felt_s = time_s
        # Speed over a window of past time: pointer events are too coarse for a difference quotient.
        begin = max(time_s - SPEED_WINDOW_S, 0.0)
        stroke = self._since(begin)
        # 16 points: the length of a path through few, unevenly spaced events.
        grid = np.linspace(begin, time_s, 16)
        way = np.linalg.norm(np.diff(stroke.at(grid), axis=0), axis=1).sum()
        speed = float(way) / (time_s - begin) if time_s > begin else 0.0
        step = self.texture.device.update_s
        amplitude = frequency = 0.0
        signal = self._render(time_s - step, time_s) if time_s >= step else None
        if signal is not None:
            amplitude = float(signal.amplitude_m_s2[-1])
            frequency = float(signal.frequency_hz[-1])
            self.waveform_m_s2 = signal.waveform_m_s2
        self.now = StrokeState(speed, self._height(self._points[-1]), amplitude, frequency)
        self.history.append((time_s, self.now))

    def _render(self, begin_s: float, end_s: float) -> StrokeSignal | None:
        """Signal of a part of the present stroke; None for a part below a step of the device."""
        stroke = self._since(begin_s)
        inner = (stroke.times_s > begin_s) & (stroke.times_s < end_s)
        times = np.concatenate([[begin_s], stroke.times_s[inner], [end_s]])
        part = Stroke(times, stroke.at(times))
        try:
            step = self.texture.device.update_s  # no window reaches into the part before
            return render_stroke(self.texture, part, window_s=step, waveform_rate_hz=WAVEFORM_HZ)
        except InputError:
            return None  # shorter than a step, by rounding

    def _since(self, time_s: float) -> Stroke:
        """Part of the stroke from the last point at or before a time: two points or more."""
        first = min(max(bisect_right(self._times, time_s) - 1, 0), len(self._times) - 2)
        return Stroke(np.array(self._times[first:]), np.array(self._points[first:]))

    def _height(self, point_m: tuple[float, float]) -> float:
        field = self.texture.height
        return 0.0 if field is None else float(field.sample(np.array([point_m]))[0])


class StrokeSound:
    """Sound of a stroke: vibration samples, and friction noise scaled by the speed."""

    def __init__(self, full_m_s2: float, friction: Any = None) -> None:
        self._full = full_m_s2
        self._device: Any = None
        self._friction: Any = None
        try:
            import aud

            self._aud = aud
            self._device = aud.Device()
            if friction is not None:
                self._friction = self._device.play(friction.factory)
                self._friction.loop_count = -1
                self._friction.volume = 0.0
        except Exception as error:  # without aud or a sound card: devices play, silently
            _log.info("no sound: %s", error)
            self._device = None

    def play(self, waveform_m_s2: npt.ArrayLike, rate_hz: float) -> None:
        """Play a piece of a waveform, clipped at full volume; no effect without a sound device."""
        if self._device is None:
            return
        samples = np.clip(np.asarray(waveform_m_s2, np.float32) / self._full, -1.0, 1.0)
        sound = self._aud.Sound.buffer(np.ascontiguousarray(samples.reshape(-1, 1)), rate_hz)
        self._device.play(sound)

    def set_friction(self, share: float) -> None:
        """Set the volume of the friction sound, clipped to 0..1; no effect without this sound."""
        if self._friction is not None:
            self._friction.volume = float(np.clip(share, 0.0, 1.0))

    def close(self) -> None:
        if self._device is not None:
            self._device.stopAll()
            self._device = None


@cache
def reference_fabric(name: str) -> HeightField:
    """Height field of a reference fabric, given by its name (a key of ``reference_fabrics()``)."""
    return woven(reference_fabrics()[name], _FABRIC_M, _FABRIC_TEXELS)


def reference_signal(name: str, speed_m_s: float, drive_per_m: float) -> StrokeSignal:
    """Signal of an even stroke of :data:`REFERENCE_S` over a reference fabric, at a calibration c_v
    of ``drive_per_m``."""
    texture = SurfaceTexture(reference_fabric(name), None, SurfaceRenderer.TEXTILE, drive_per_m)
    stroke = line((0.0, 0.0), float(_DIRECTION_RAD), speed_m_s * REFERENCE_S, speed_m_s)
    return render_stroke(texture, stroke, waveform_rate_hz=WAVEFORM_HZ)


class ReferenceStroke:
    """Stroke played as sound and on connected devices; a new stroke replaces the current one."""

    def __init__(self) -> None:
        self.signal: StrokeSignal | None = None  # None while silent
        self.step = 0  # index of the next time step
        self._sound: StrokeSound | None = None

    def play(self, signal: StrokeSignal, full_m_s2: float) -> None:
        """Play a stroke by a timer; acceleration ``full_m_s2`` is the full volume of its sound."""
        self.stop()
        self.signal, self.step = signal, 0
        self._sound = StrokeSound(full_m_s2)
        self._sound.play(signal.waveform_m_s2, signal.waveform_rate_hz)
        call_soon(self._next)

    def stop(self) -> None:
        """Stop stroke and sound, and send silence to the devices; no effect between strokes."""
        remove_timers(self._next)
        if self._sound is not None:
            self._sound.close()
        if self.signal is not None:
            live.send_vibration(0.0, float(self.signal.frequency_hz[0]))
        self.signal = self._sound = None

    def _next(self) -> float | None:
        signal, step = self.signal, self.step
        if signal is None:
            return None
        if step >= len(signal.times_s):
            self.stop()
            return None
        live.send_vibration(float(signal.amplitude_m_s2[step]), float(signal.frequency_hz[step]))
        self.step += 1
        return signal.step_s


reference_stroke = ReferenceStroke()
