# SPDX-License-Identifier: GPL-3.0-or-later
"""Playback of a track or a clip with gain, mutes and intensities of other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.live.track_playback import PlayedTrack
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.samples import SampleRun

from ..commands.playback_loop import ValueSource
from .live_values import LiveValues


def is_strength(device: DeviceConfig) -> npt.NDArray[np.bool_]:
    """Columns (columns,) of a device that are strengths: the first control of each actuator."""
    return np.array([k == 0 for a in device.actuators for k in range(len(a.type.controls))])


def weakened(
    values: npt.NDArray[np.float64], factor: float, device: DeviceConfig
) -> npt.NDArray[np.float64]:
    """Values (columns,) with strengths nearer to neutral by a factor 0 to 1; neutral for 0."""
    if factor == 0.0:
        return device.neutral
    moved = device.neutral + factor * (values - device.neutral)
    return np.where(is_strength(device), moved, values)


class ControlledSource:
    """Track or clip as a value source, whose values are changed by :class:`.LiveValues`.

    Gain and mute apply to every device. Intensities and mutes of effects apply to tracks; a clip
    holds values of actuators and no effects any more.
    """

    def __init__(
        self, source: ValueSource, values: LiveValues, devices: Mapping[str, DeviceConfig]
    ) -> None:
        self._source, self._values, self._devices = source, values, devices
        self.is_rendered = source.is_rendered
        self.start_s, self.end_s = source.start_s, source.end_s
        self.sample_s = source.sample_s

    def begin(self, client: LiveClient) -> None:
        """Begin the source."""
        self._source.begin(client)

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the changed values of a time."""
        self._values.take()
        if isinstance(self._source, PlayedTrack):
            self._show_track(self._source, client, time_s)
        else:
            self._source.show(_Weakening(client, self._values.gain, self._devices), time_s)  # type: ignore[arg-type]

    def _show_track(self, track: PlayedTrack, client: LiveClient, time_s: float) -> None:
        gains = {state.number: self._values.gain for state in client.devices.values()}
        later_s = {ms: time_s + ms / 1000.0 for ms in track.latencies_ms}
        frame = track.frame(time_s, later_s=later_s, gains=gains)
        names = {effect.id: effect.name for effect in track.header.effects}
        later = {ms: self._changed(runs, names) for ms, runs in frame.later.items()}
        client.show(replace(frame, runs=self._changed(frame.runs, names), later=later))

    def _changed(self, runs: Sequence[SampleRun], names: Mapping[str, str]) -> list[SampleRun]:
        """Runs with levels times the intensities of their effects, without silent runs."""
        factors = [self._values.factor(names[run.stream.effect_id]) for run in runs]
        return [
            replace(run, levels=run.levels * factor) if factor < 1.0 else run
            for run, factor in zip(runs, factors, strict=True)
            if factor
        ]


class _Weakening:
    """Client of a clip's playback that weakens the values."""

    def __init__(
        self, client: LiveClient, gain: float, devices: Mapping[str, DeviceConfig]
    ) -> None:
        self._client, self._gain, self._devices = client, gain, devices

    def send(self, name: str, values: npt.NDArray[np.float64]) -> None:
        self._client.send(name, weakened(values, self._gain, self._devices[name]))
