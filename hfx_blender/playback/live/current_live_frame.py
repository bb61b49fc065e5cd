# SPDX-License-Identifier: GPL-3.0-or-later
"""Current frame of the scene, packed for all devices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import bpy

from ...devices.workers.live_frame import LiveFrame
from ...reading.description.play_space import pose_now
from ..evaluation import evaluation

if TYPE_CHECKING:
    from ...devices.live.playhead import Playhead


def current_live_frame(
    scene: bpy.types.Scene, numbers: Mapping[str, int], edition: int, playhead: Playhead
) -> LiveFrame:
    """Current samples of the evaluated scene, for all devices.

    Parameters
    ----------
    numbers : mapping
        Of connected devices, by name.

    Raises
    ------
    InputError
        Something of the scene cannot be felt any more.
    """
    assert evaluation.scene is not None
    play_space = None
    if evaluation.with_positions:
        objects = evaluation.scene.objects
        play_space = pose_now(scene, objects.layer, objects.unit_m)
    return LiveFrame(
        playhead.frame / playhead.fps,
        evaluation.runs(),
        gains(scene, numbers),
        play_space,
        edition,
        playhead,
    )


def gains(scene: bpy.types.Scene, numbers: Mapping[str, int]) -> dict[int, float]:
    """Gains that the user has set, by a device's number; 0 is mute."""
    found = {}
    for name, number in numbers.items():
        item = scene.hfx.devices.get(name)
        if item is not None and (item.is_muted or item.gain != 1.0):
            found[number] = 0.0 if item.is_muted else item.gain
    return found
