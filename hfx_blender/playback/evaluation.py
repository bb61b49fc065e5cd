# SPDX-License-Identifier: GPL-3.0-or-later
"""The open scene, described and evaluated once for whoever shows it: preview and live devices."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy

from ..errors import HfxError

if TYPE_CHECKING:
    from ..engine.samples import SampleRun
    from ..reading.live_scene import LiveScene
    from ..reading.looking_ahead import LookAhead


LOOK_AHEAD_S = 0.01
"""The most of a frame's time that is spent on what comes; what was begun is finished."""


_MOST_KEPT = 2000
"""Frames; then it begins anew."""


class Evaluation:
    """What is felt in one scene: kept until something moves, described anew if that changes.

    Attributes
    ----------
    scene : LiveScene or None
        None: nothing can be felt, :attr:`fault` says why.
    fault : str
    generation : int
        Another one after each description.
    before_describing : callable
        Called before work that may take long: models may have to be loaded.
    """

    def __init__(self) -> None:
        self.scene: LiveScene | None = None
        self.fault = ""
        self.generation = 0
        self.with_positions = False  # whether a device needs to know where samples are
        self.before_describing: Callable[[], None] = _nothing
        self._key: tuple[object, ...] = ()
        self._runs: list[SampleRun] | None = None
        self._ahead: LookAhead | None = None
        self._later: dict[float, list[SampleRun]] = {}  # by frame
        self._spent_s = 0.0  # on those

    def touch(self) -> None:
        """Something moved, in time or otherwise."""
        self._runs = None
        self._spent_s = 0.0

    def edited(self) -> None:
        """Something changed but the time: what comes may come otherwise."""
        self._later.clear()

    def forget(self) -> None:
        """The scene may have become another one: nothing of it is kept."""
        self.touch()
        self.edited()
        self.scene, self._key, self._ahead, self.fault = None, (), None, ""
        self.generation += 1

    def describe(self, context: bpy.types.Context) -> None:
        """Find out what there is to feel, if that changed; never from within an update."""
        from ..export import scene_tolerance
        from ..reading.live_scene import LiveScene, signature_of

        scene, layer = context.scene, context.view_layer
        settings = scene.hfx.tolerance, scene.hfx.tolerance_custom
        # Another file may have the very same names.
        which = scene.session_uid, scene.as_pointer(), layer.as_pointer()
        key = (*signature_of(scene), layer.name, *settings, *which, self.with_positions)
        if key == self._key:
            return
        self.forget()
        self._key = key
        self.before_describing()
        try:
            self.scene = LiveScene(
                scene, layer, scene_tolerance(scene), with_positions=self.with_positions
            )
        except HfxError as error:
            self.fault = str(error)

    def runs(self) -> list[SampleRun]:
        """What is felt now: at most one sample for each effect and body.

        Raises
        ------
        InputError
            Something of the scene cannot be felt any more.
        ReferenceError
            Something of it was deleted.
        """
        if self.scene is None:
            return []
        if self._runs is None:
            self._runs = self.scene.runs()
        return self._runs

    def prepare_ahead(self) -> str:
        """Get ready for :meth:`runs_at`; why other frames cannot be known, empty if they can."""
        from ..reading.looking_ahead import LookAhead

        self.edited()
        if self.scene is None:
            return self.fault
        if self._ahead is None:
            self._ahead = LookAhead(self.scene)
        return self._ahead.reason

    def runs_at(self, frame: float) -> list[SampleRun]:
        """What is felt at another frame; what is felt now where that cannot be known.

        It is kept until something is edited: whoever looks further ahead has found already what
        others look for later. When :data:`LOOK_AHEAD_S` is spent, it is what is felt at the nearest
        frame that is known.

        Raises
        ------
        InputError
            Something of the scene cannot be felt any more.
        """
        if self._ahead is None or self._ahead.reason:
            return self.runs()
        if frame not in self._later:
            if self._spent_s > LOOK_AHEAD_S and self._later:
                return self._later[min(self._later, key=lambda known: abs(known - frame))]
            if len(self._later) >= _MOST_KEPT:
                self._later.clear()
            begun = time.perf_counter()
            self._later[frame] = self._ahead.runs(frame)
            self._spent_s += time.perf_counter() - begun
        return self._later[frame]


def _nothing() -> None:
    pass


evaluation = Evaluation()
