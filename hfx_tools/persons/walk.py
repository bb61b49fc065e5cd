# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk over a device's actuators: the strengths that a person first feels, finds enough, too much.

The strength of an actuator rises until the person has answered three times.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.errors import InputError

RISE_S: Final = 9.0
"""Time from the lowest strength to the limit of an actuator, s."""
LOWEST: Final = 0.01
"""First strength of an actuator, as a share of the limit: 40 dB below the limit."""
PAUSE_S: Final = 1.0
MOST: Final = 12
"""Largest number of measured actuators: two minutes for answers at the limit of each."""
QUESTIONS: Final = ("first felt", "strong enough", "too strong")

Marks = dict[str, float]


def walked(device: DeviceConfig) -> list[int]:
    """Actuators of the walk by index, at most 12, evenly spread in the order of the device.

    Only modalities that are silent at 0: a temperature is no strength from 0. InputError without
    such an actuator.
    """
    usable = [
        k
        for k, actuator in enumerate(device.actuators)
        if MODALITIES[actuator.type.modality].is_silent_at_0 and actuator.type.strength.highest > 0
    ]
    if not usable:
        raise InputError(
            f"Device '{device.id}' has no actuator of vibration, pressure or wind; a profile "
            "holds strengths of these."
        )
    rows = np.linspace(0, len(usable) - 1, min(MOST, len(usable)))
    return [usable[round(row)] for row in rows]


class Walk:
    """Source of values for :func:`..commands.playback_loop.play`, ended by the last answer.

    ``pressed`` returns the keys since the last call: a space is an answer, "r" repeats the present
    actuator. ``write_note`` takes a line for the person.
    """

    is_rendered = False
    start_s = 0.0
    sample_s = 0.02

    def __init__(
        self,
        name: str,
        device: DeviceConfig,
        pressed: Callable[[], str],
        write_note: Callable[[str], None],
    ) -> None:
        self._name, self._device = name, device
        self._pressed, self._write_note = pressed, write_note
        self._order = walked(device)
        self.end_s = np.inf
        self.marks: dict[str, Marks] = {}
        self._position = 0
        self._begun_s = 0.0
        self._answers: list[float] = []

    def begin(self, client: LiveClient) -> None:
        """Explain the keys."""
        client.send(self._name, self._device.neutral)
        self._write_note(
            "Press Space at each actuator when you first feel it, when it is strong enough, and "
            "when it is too strong. R repeats an actuator, Ctrl-C ends without a profile."
        )

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the values of ``time_s``; take answers."""
        if self.end_s < np.inf:
            client.send(self._name, self._device.neutral)
            return
        limit = self._device.actuators[self._order[self._position]].type.strength.highest
        share = (time_s - self._begun_s - PAUSE_S) / RISE_S
        strength = 0.0 if share < 0.0 else limit * LOWEST ** max(1.0 - share, 0.0)
        for key in self._pressed():
            if key in "rR":
                self._begun_s, self._answers, strength = time_s, [], 0.0
                break
            if key == " " and strength > 0.0 and len(self._answers) < len(QUESTIONS):
                self._write_note(f"  {QUESTIONS[len(self._answers)]}: {strength:.3g}")
                self._answers.append(strength)
        # Unanswered questions have the limit, which the ramp has reached.
        if share >= 1.0:
            self._answers += [limit] * (len(QUESTIONS) - len(self._answers))
        if len(self._answers) == len(QUESTIONS):
            self._finish(time_s)
            strength = 0.0
        values = self._device.neutral
        if strength > 0.0:
            column = self._device.strength_columns[self._order[self._position]]
            values[column] = strength
        client.send(self._name, values)

    def _finish(self, time_s: float) -> None:
        """Store the answers of an actuator, and go on to the next actuator or end the walk."""
        actuator = self._device.actuators[self._order[self._position]]
        names = ("first_felt", "strong_enough", "too_strong")
        self.marks[actuator.id] = dict(zip(names, self._answers, strict=True))
        self._begun_s, self._answers = time_s, []
        self._position += 1
        if self._position == len(self._order):
            self._position -= 1
            self.end_s = time_s
        else:
            following = self._device.actuators[self._order[self._position]]
            self._write_note(f"{following.id} ({self._position + 1} of {len(self._order)})")

    def all_marks(self) -> dict[str, Marks]:
        """Marks of all actuators by id: an actuator without answers has those of the nearest
        measured one of its type in the order of the device, scaled to its own limit."""
        marks: dict[str, Marks] = {}
        for k, actuator in enumerate(self._device.actuators):
            alike = [
                j
                for j in self._order
                if self._device.actuators[j].type.modality == actuator.type.modality
            ]
            if not alike:
                continue
            nearest = self._device.actuators[min(alike, key=lambda j: abs(j - k))]
            scale = actuator.type.strength.highest / nearest.type.strength.highest
            marks[actuator.id] = {
                mark: scale * value for mark, value in self.marks[nearest.id].items()
            }
        return marks
