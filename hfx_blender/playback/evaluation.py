# SPDX-License-Identifier: GPL-3.0-or-later
"""Describes and evaluates the open scene once, for the preview and the live devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy

from ..errors import HfxError

if TYPE_CHECKING:
    from ..engine.samples import SampleRun
    from ..reading.live.live_scene import LiveScene


class Evaluation:
    """Evaluation of one scene: cached until something moves, described anew if that changes.

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
        self.before_describing: Callable[[], None] = lambda: None
        self._key: tuple[object, ...] = ()
        self._runs: list[SampleRun] | None = None

    def invalidate(self) -> None:
        """Invalidate the samples: something moved, in time or otherwise."""
        self._runs = None

    def forget(self) -> None:
        """Drop everything: the scene may have become another one."""
        self.invalidate()
        self.scene, self._key, self.fault = None, (), ""
        self.generation += 1

    def describe(self, context: bpy.types.Context) -> None:
        """Describe the scene anew if it has changed; never from within an update."""
        from ..reading.description.scene_tolerance import live_tolerance
        from ..reading.live.live_scene import LiveScene, signature_of

        scene, layer = context.scene, context.view_layer
        hfx = scene.hfx
        settings = hfx.live_tolerance, hfx.tolerance, hfx.tolerance_custom
        # Another file may have the very same names.
        which = scene.session_uid, scene.as_pointer(), layer.as_pointer()
        key = (*signature_of(scene), layer.name, *settings, *which, self.with_positions)
        if key == self._key:
            return
        self.forget()
        self._key = key
        self.before_describing()
        try:
            tolerance = live_tolerance(scene)
            self.scene = LiveScene(scene, layer, tolerance, with_positions=self.with_positions)
        except HfxError as error:
            self.fault = str(error)

    def runs(self) -> list[SampleRun]:
        """Current samples: at most one for each effect and body.

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


evaluation = Evaluation()
