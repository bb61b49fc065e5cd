# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuators that an effect drives one by one, and that the device does not have for it."""

from __future__ import annotations

from collections.abc import Iterator

from ...text import counted
from ..samples import SampleRun
from ..track.header import TrackHeader
from .device import DeviceConfig
from .dispatch import rendered_modalities


class MissingActuators:
    """Collects them run by run, for one device."""

    def __init__(self, device: DeviceConfig) -> None:
        self._device = device
        self._found: dict[str, dict[str, None]] = {}  # by effect, each once

    def add(self, run: SampleRun) -> None:
        """Take the next samples of an effect."""
        drive = run.drive
        if drive is None or drive.device_id != self._device.id:
            return  # that an effect is of another device is a shortfall of its own
        shown = rendered_modalities(self._device, run.stream.modality)
        there = {each.id for each in self._device.actuators if each.type.modality in shown}
        is_on = (drive.values > 0.0).any(axis=0).tolist()
        found = self._found.setdefault(run.stream.effect_id, {})
        for name, is_driven in zip(drive.actuators, is_on, strict=True):
            if is_driven and name not in there:
                found[name] = None

    def notes(self, header: TrackHeader) -> Iterator[str]:
        """A sentence for each effect that drives any."""
        for effect in header.effects:
            text = (
                f"device '{self._device.id}' has not all {effect.modality} actuators that effect "
                f"'{effect.name}' drives; missing"
            )
            found = self._found.get(effect.id, {})
            yield from counted([name for name in effect.actuators if name in found], text)
