# SPDX-License-Identifier: GPL-3.0-or-later
"""Describes and evaluates the open scene once, for the preview and the live devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy

from ..errors import HfxError

if TYPE_CHECKING:
    from ..engine.samples import SampleRun
    from ..reading.live_scene import LiveScene


class Evaluation:
    """Cached evaluation of the open scene."""

    def __init__(self) -> None:
        self.scene: LiveScene | None = None  # None before a description, and after a fault
        self.fault = ""  # error of the last description; empty without an error
        self.generation = 0  # rises with each description
        # Received values by property and name of the effect, in place of those in the scene.
        self.overrides: dict[str, dict[str, float | str | tuple[float, ...]]] = {}
        self._described: tuple[object, ...] = ()  # part of ``overrides``, of the last description
        self.with_positions = False  # True while a device needs the positions of samples
        # Called before a description, which may load body models and take seconds.
        self.before_describing: Callable[[], None] = lambda: None
        self._key: tuple[object, ...] = ()
        self._runs: list[SampleRun] | None = None

    def invalidate(self) -> None:
        """Discard the cached samples, keep the description."""
        self._runs = None

    def forget(self) -> None:
        """Discard samples, description and fault; raise :attr:`generation`."""
        self.invalidate()
        self.scene, self._key, self.fault = None, (), ""
        self.generation += 1

    def describe(self, context: bpy.types.Context) -> None:
        """Store a new description of the context's scene in :attr:`scene`.

        Only after a change of bodies, effects, the live tolerance of the scene, the scene itself,
        its view layer or :attr:`with_positions`; else nothing happens. The text of an HfxError is
        stored in :attr:`fault` instead. Never call this during a depsgraph update.
        """
        from ..reading.description.scene_settings import live_tolerance
        from ..reading.live_scene import LiveScene, described_overrides, signature_of

        scene, layer = context.scene, context.view_layer
        hfx = scene.hfx
        settings = hfx.live_tolerance, hfx.tolerance, hfx.tolerance_custom
        # Another file may have the very same names.
        which = scene.session_uid, scene.as_pointer(), layer.as_pointer()
        self._described = described_overrides(self.overrides)
        key = (*signature_of(scene), layer.name, *settings, *which, self.with_positions)
        key = (*key, self._described)
        if key == self._key:
            return
        before = self.scene
        self.forget()
        # Stored before the attempt: a faulty scene is described again only after a change.
        self._key = key
        self.before_describing()
        try:
            tolerance = live_tolerance(scene)
            self.scene = LiveScene(
                scene,
                layer,
                tolerance,
                with_positions=self.with_positions,
                overrides=self.overrides,
                before=before,
            )
        except HfxError as error:
            self.fault = str(error)

    @property
    def is_outdated(self) -> bool:
        """Test that :attr:`overrides` need a new description."""
        from ..reading.live_scene import described_overrides

        return described_overrides(self.overrides) != self._described

    def runs(self) -> list[SampleRun]:
        """Samples of the current frame: at most a run of a single sample for each effect and body.

        Cached until :meth:`invalidate`; empty without a description.

        Raises InputError: an effect or a body has a fault.
        Raises ReferenceError: an object of the description was deleted.
        """
        if self.scene is None:
            return []
        # Once a frame, for preview and devices.
        if self._runs is None:
            self._runs = self.scene.runs()
        return self._runs


evaluation = Evaluation()
