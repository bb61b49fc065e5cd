# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering one moment: what a device's actuators are to be given now.

It is the rendering of an export with one row; only the update interval is not held, as there
is nothing before or after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from ..body.model import load_model
from ..samples import SampleRun
from ..scene import SceneDescription, TimeBase
from ..track.header import TrackHeader
from .device import DeviceConfig
from .dispatch import ModelLoader
from .render import Renderer

F64 = npt.NDArray[np.float64]

_ONE_ROW = TimeBase(Fraction(1), Fraction(1), scene_start=0, frame_first=0, frame_last=0)


class MomentRenderer:
    """Renders moments of one scene for one device.

    Parameters
    ----------
    scene : SceneDescription
    device : DeviceConfig
    models : callable
        Loads a perceptual model by its id.
    body_id : str, optional
        Who wears the device; may be left out if the scene has one body.

    Raises
    ------
    InputError
        The wearer is not known.
    """

    def __init__(
        self,
        scene: SceneDescription,
        device: DeviceConfig,
        models: ModelLoader = load_model,
        *,
        body_id: str | None = None,
    ) -> None:
        used = {effect.model_id: models(effect.model_id) for effect in scene.effects}
        header = TrackHeader.of(scene, used, settings={}, tools={})
        self.device = device
        header = replace(header, time=_ONE_ROW)
        self._renderer = Renderer(header, device, models, body_id=body_id)
        self._scene = scene
        self._members = [
            [k for k, each in enumerate(device.actuators) if each.type.modality == group.modality]
            for group in self._renderer.groups
        ]

    @property
    def body_id(self) -> str:
        """Who wears the device."""
        return self._renderer.body_id

    def prepare(self) -> None:
        """Work out what takes long now, not when an effect is felt for the first time.

        Raises
        ------
        InputError
            A place of the device does not fit a model.
        """
        for group in self._renderer.groups:
            for effect in self._scene.effects:
                if group.answers_to(effect.modality):
                    group.cells_on(effect.model_id)
                    if effect.kind == "spot":
                        group.panning_on(effect.model_id)

    def move_play_space(self, matrix: F64) -> None:
        """The play space is there from now on: (4, 4) to the world, metres."""
        for group in self._renderer.groups:
            group.play_space.move(matrix)

    def values(self, runs: Sequence[SampleRun]) -> F64:
        """Values (columns,) within the device's limits; neutral where nothing is felt.

        Parameters
        ----------
        runs : sequence of SampleRun
            At most one sample each, all of index 0.

        Raises
        ------
        InputError
            A place of the device does not fit a model.
        """
        self._renderer.restart()
        self._renderer.add(runs)
        return self._renderer.first_row()

    def felt(self, runs: Sequence[SampleRun]) -> list[tuple[SampleRun, F64]]:
        """What the wearer feels, and how strongly it reaches each actuator (A,), in 0..1."""
        mine = [run for run in runs if run.stream.body_id == self.body_id and len(run)]
        return [(run, self._gains(run)) for run in mine]

    def _gains(self, run: SampleRun) -> F64:
        gains = np.zeros(len(self.device.actuators))
        for members, group in zip(self._members, self._renderer.groups, strict=True):
            gains[members] = group.gains(run)[0]
        return gains
