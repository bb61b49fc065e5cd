# SPDX-License-Identifier: GPL-3.0-or-later
"""Playback of a track or a clip with gain, mutes and intensities of other programs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.samples import SampleRun

from ..commands.playback_loop import ValueSource
from ..commands.played_track import PlayedTrackSource
from .live_values import LiveValues
from .triggered_parts import TriggeredParts, is_strength, strongest


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
    holds values of actuators and no effects any more. ``parts``: triggered parts of a clip.
    """

    def __init__(
        self,
        source: ValueSource,
        values: LiveValues,
        devices: Mapping[str, DeviceConfig],
        parts: TriggeredParts | None = None,
    ) -> None:
        self._source, self._values, self._devices = source, values, devices
        self._parts = parts
        self.is_rendered = source.is_rendered
        self.start_s, self.end_s = source.start_s, source.end_s
        self.sample_s = source.sample_s

    def begin(self, client: LiveClient) -> None:
        """Begin the source."""
        self._source.begin(client)

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the changed values of a time."""
        self._values.take()
        if self._parts is not None:
            self._parts.update(self._values.triggered, time.monotonic())
        if isinstance(self._source, PlayedTrackSource) and time_s < self.end_s:
            self._show_track(self._source, client, time_s)
        elif self.is_rendered:
            self._source.show(client, time_s)
        else:
            self._source.show(_ChangedRows(client, self._changed_row), time_s)  # type: ignore[arg-type]

    def _changed_row(self, name: str, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Values (columns,) of a device with triggered parts and gain."""
        device, now_s = self._devices[name], time.monotonic()
        if self._parts is not None:
            values = strongest([values, *self._parts.values(name, now_s)], device)
        return weakened(values, self._values.gain, device)

    def _show_track(self, track: PlayedTrackSource, client: LiveClient, time_s: float) -> None:
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


class _ChangedRows:
    """Client of a clip's playback that changes the values of a device by a function."""

    def __init__(
        self,
        client: LiveClient,
        changed: Callable[[str, npt.NDArray[np.float64]], npt.NDArray[np.float64]],
    ) -> None:
        self._client, self._changed = client, changed

    def send(self, name: str, values: npt.NDArray[np.float64]) -> None:
        self._client.send(name, self._changed(name, values))
