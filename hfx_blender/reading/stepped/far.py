# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes and bodies that are far from each other: of what is stepped only places are read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...authoring.responses import responses
from ...engine.arrays import F64, Bool
from ...engine.scene import EffectBlock, PoseBlock, SceneDescription, SurfaceBinding
from ..description.scene_description import HapticObjects
from .nearness import SkinBoxes, may_meet
from .scene_rows import Places, Row
from .stepped_volumes import SteppedVolumes, near, over_time
from .stepping import Stepper


class FarVolumes:
    """Volumes that are stepped, and read in full only while they are near skin.

    Parameters
    ----------
    found : HapticObjects
    scene : SceneDescription
    effects : sequence of int
        Effects that are stepped, and silent where they are far. Those whose place does not decide
        where they can be felt are left out.

    Attributes
    ----------
    placements : SteppedVolumes
        Reads their places.
    in_full : set of int
        Effects that were near at last, and of which more than a place is unknown: they are read
        at once.
    not_seen_on : set of int
        Effects that were not on yet at any time.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, effects: Sequence[int]
    ) -> None:
        self.placements = SteppedVolumes({k: found.effects[k] for k in effects})
        self.in_full: set[int] = set()
        self.not_seen_on = {*self.numbers}
        self._states = [found.activations[k] for k in self.numbers]
        self._ids = [scene.effects[k].id for k in self.numbers]
        self._effects = [found.effects[k] for k in self.numbers]
        self._unit_m = found.unit_m
        model_ids = {scene.effects[k].model_id for k in self.numbers}
        self._skins = [SkinBoxes(body, model_ids) for body in scene.bodies if self.numbers]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the effects, (N,)."""
        return self.placements.numbers

    def may_be_on(self, frames: F64) -> Bool:
        """Volumes that may be on at frames of the animation, (N, T)."""
        found = [state.may_be_on(frames) for state in self._states]
        return np.array(found, np.bool_).reshape(len(found), len(frames))

    def seen_on(self, there: Bool, may_be_on: Bool, stepper: Stepper) -> list[str]:
        """Ids of volumes that are on for the first time, at the present time of a scene.

        Parameters
        ----------
        there, may_be_on : (N,) bool
            Volumes that are not disabled now, and that may be on in the present block.
        """
        found = []
        for n in np.flatnonzero(there & may_be_on).tolist():
            if self.numbers[n] not in self.not_seen_on:
                continue
            evaluated = stepper.evaluated(self._effects[n])
            is_there = evaluated.is_evaluated and not evaluated.hide_viewport
            if is_there and self._states[n].level(evaluated.hfx) > 0.0:
                found.append(self._ids[n])
                self.not_seen_on.discard(self.numbers[n])
        return found

    def places(self, rows: Iterable[Row]) -> Places:
        """Their places over the times of a block."""
        return over_time([row.places for row in rows if row.places is not None])

    def are_near(self, places: Places, poses: Sequence[PoseBlock]) -> Bool:
        """Volumes that may meet the skin of any body, (N,)."""
        skins = [skin.over(pose) for skin, pose in zip(self._skins, poses, strict=True)]
        return near(places, self._unit_m, skins)


class FarSurfaces:
    """Bodies that follow their mesh, and are read in full only while a volume reaches their bounds.

    Parameters
    ----------
    found : HapticObjects
    scene : SceneDescription
    bodies, effects : sequence of int
        Bodies that are stepped, and effects that need their poses.
    """

    def __init__(
        self,
        found: HapticObjects,
        scene: SceneDescription,
        bodies: Sequence[int],
        effects: Sequence[int],
    ) -> None:
        self._skins: dict[int, SkinBoxes] = {}
        settings = [found.effects[k].hfx for k in effects]
        if any(hfx.kind != "VOLUME" or responses.active(hfx) for hfx in settings):
            return  # felt from afar, or still ringing there
        model_ids = {scene.effects[k].model_id for k in effects}
        for k in bodies:
            if isinstance(scene.bodies[k].binding, SurfaceBinding):
                self._skins[k] = SkinBoxes(scene.bodies[k], model_ids)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the bodies."""
        return tuple(self._skins)

    def is_near(self, body: int, outline: PoseBlock, volumes: Iterable[EffectBlock]) -> bool:
        """Test that a volume may reach a body, of which the bounds are known."""
        skin = self._skins[body].over(outline)
        return any(may_meet(each, skin) for each in volumes)
