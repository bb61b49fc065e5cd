# SPDX-License-Identifier: GPL-3.0-or-later
"""Factors and parameters of effects, sent by other programs (``docs/osc-addresses.md``)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from hfx_blender.engine.modality import MODALITIES
from hfx_blender.tracking import value_addresses
from hfx_blender.tracking.receiver import OscReceiver
from hfx_blender.tracking.value_addresses import ValueChange, change_of

_RANGES: Final = {
    parameter.name: (parameter.minimum, parameter.maximum)
    for modality in MODALITIES.values()
    for parameter in modality.parameters
}


@dataclass(eq=False)
class LiveValues:
    """Newest values of a receiver.

    ``gain``: of all devices, 0 to 1; 0 while muted.
    ``intensities``, ``muted``: by effect; ``parameters``, and ``vectors`` of three numbers: by
    effect and parameter.
    ``triggered``: names of clips started by the last :meth:`take`.
    ``ignored``: messages without a known address or a valid value.
    """

    receiver: OscReceiver | None = None
    overall: float = 1.0
    is_muted: bool = False
    intensities: dict[str, float] = field(default_factory=dict)
    muted: dict[str, bool] = field(default_factory=dict)
    parameters: dict[tuple[str, str], float] = field(default_factory=dict)
    vectors: dict[tuple[str, str], tuple[float, ...]] = field(default_factory=dict)
    triggered: list[str] = field(default_factory=list)
    ignored: int = 0

    @classmethod
    def listening(cls, address: str, port: int, allowed: tuple[str, ...]) -> LiveValues:
        """Open an OSC receiver for values; UsageError for an unusable address or port."""
        return cls(OscReceiver(address, port, allowed, value_addresses.is_used))

    @property
    def gain(self) -> float:
        return 0.0 if self.is_muted else self.overall

    def factor(self, effect: str) -> float:
        """Factor of an effect's level by name: the intensity, 0 while muted; 1 unless received."""
        return 0.0 if self.muted.get(effect) else self.intensities.get(effect, 1.0)

    def take(self) -> list[ValueChange]:
        """Apply the newest messages; returns the changes in order of arrival."""
        changes = []
        self.triggered = []
        for message, _ in self.receiver.take() if self.receiver else ():
            change = change_of(message)
            if change is None or change.text:  # entries of menus are of Blender
                self.ignored += 1
                continue
            changes.append(change)
            if change.target == "all":
                if change.parameter == "mute":
                    self.is_muted = bool(change.value)
                else:
                    self.overall = change.value
            elif change.target == "effect":
                self._change_effect(change)
            elif change.target == "clip" and change.value:
                self.triggered.append(change.name)
        return changes

    def close(self) -> None:
        """End the receiver."""
        if self.receiver is not None:
            self.receiver.close()

    def _change_effect(self, change: ValueChange) -> None:
        if change.vector:
            self.vectors[change.name, change.parameter] = change.vector
        elif change.parameter == "intensity":
            self.intensities[change.name] = change.value
        elif change.parameter == "mute":
            self.muted[change.name] = bool(change.value)
        else:
            lowest, highest = _RANGES.get(change.parameter, (-math.inf, math.inf))
            if lowest <= change.value <= highest:
                self.parameters[change.name, change.parameter] = change.value
            else:
                self.ignored += 1
