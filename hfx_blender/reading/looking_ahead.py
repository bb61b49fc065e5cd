# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene a little later than it stands, from its F-curves alone: nothing is stepped.

Devices that answer late are told early. Where something else than F-curves moves a scene, it
cannot be known without evaluating it, which playback has no time for.
"""

from __future__ import annotations

import numpy as np

from ..engine.evaluate import Engine
from ..engine.samples import SampleRun
from ..engine.scene import AnimationBlock, HapticSurface
from .effect_values import Shapes
from .live_scene import LiveScene
from .reading_plan import plan_of


class LookAhead:
    """What is felt at other frames of a scene.

    Parameters
    ----------
    live : LiveScene

    Attributes
    ----------
    reason : str
        Why it is not known; empty: it is.
    """

    def __init__(self, live: LiveScene) -> None:
        self._plan = plan_of(live.objects, live.description, Shapes())
        self.reason = self._plan.reason
        if any(isinstance(e.area, HapticSurface) for e in live.description.effects):
            self.reason = "a surface is felt by the way that skin goes over it"
        self._engine = Engine(live.description, record=live.record, tolerance=live.tolerance)
        self._is_posed = bool(live.record)
        self._effects = range(len(live.description.effects))
        self._volumes = [k for k, e in enumerate(live.description.effects) if e.kind == "volume"]
        self._bodies = range(len(live.description.bodies))

    def runs(self, frame: float) -> list[SampleRun]:
        """What is felt at a frame: at most one sample for each effect and body.

        Raises
        ------
        InputError
            Something of the scene cannot be felt any more.
        ValueError
            It is not known; see :attr:`reason`.
        """
        if self.reason:
            raise ValueError(self.reason)
        frames = np.array([frame])
        effects = tuple(self._plan.effects[k].read(frames) for k in self._effects)
        is_on = any((effects[k].levels > 0.0).any() for k in self._volumes)
        is_posed = np.array([self._is_posed or is_on])
        poses = tuple(self._plan.bodies[k].read(frames, is_posed) for k in self._bodies)
        return self._engine.evaluate(AnimationBlock(np.zeros(1, np.int64), effects, poses))
