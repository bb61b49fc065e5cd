# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives live devices from Blender's handlers and timers, while a device is connected."""

import logging
import time
from dataclasses import dataclass
from typing import Any, Final

import bpy
from bpy.app.handlers import persistent

from ...authoring import painting
from ...blender.events import add_handlers, call_soon, redraw, remove_handlers, remove_timers
from ...errors import HfxError
from ...reading.stepped import stepping
from ..evaluation import evaluation

BEAT_S = 0.05

_log = logging.getLogger(__name__)


def is_playing() -> bool:
    """Test for animation playback in the current window; False without a window."""
    screen = bpy.context.screen
    return screen is not None and screen.is_animation_playing


class LiveHandlers:
    """Handlers and timers that connect live devices with the open scene.

    ``listener``: the :class:`.live.Live` with the devices.
    """

    def __init__(self, listener: Any) -> None:
        self._listener = listener
        self._is_describing = False
        self._handlers = {
            "frame_change_post": self.on_change,
            "depsgraph_update_post": self.on_update,
            "load_pre": self.on_load,
            "undo_pre": self.on_undo,
            "redo_pre": self.on_undo,
        }

    def listen(self) -> None:
        """Add the handlers and the heartbeat timer."""
        # Stops come first: earlier handlers, also of other add-ons, may take long.
        add_handlers(self._handlers, first=("load_pre", "undo_pre", "redo_pre"))
        call_soon(self.beat, BEAT_S, outlives_load=True)

    def stop_listening(self) -> None:
        """Remove the handlers and timers."""
        remove_handlers(self._handlers)
        remove_timers(self.beat, self.describe)

    def request_update(self) -> None:
        """Schedule :meth:`describe` for Blender's next idle moment; allowed during a depsgraph
        update."""
        call_soon(self.describe)

    def describe(self) -> None:
        """Send description and current samples; errors become the follower's fault.

        Without a scene, and after the deletion of an object, the description is discarded.
        """
        if getattr(bpy.context, "scene", None) is None:  # at this moment
            self._listener.forget()
            return
        # A description evaluates the scene, which calls `on_update` again.
        self._is_describing = True
        try:
            self._listener.describe(bpy.context)
            self._listener.update(bpy.context.scene)
        except ReferenceError as error:  # a deleted object; the next change describes the scene
            _log.info("live: %s", error)
            self._listener.forget()
        except HfxError as error:
            self._listener.fail(str(error))
        except Exception as error:
            self._fail(error)
        finally:
            self._is_describing = False

    @persistent
    def on_change(self, scene: bpy.types.Scene, *_: object) -> None:
        """Discard cached samples and send new ones, after a frame change or an edit.

        Nothing is sent while no device is armed, while the scene is described, stepped or rendered,
        and for other scenes. Without playback, a description is scheduled.
        """
        evaluation.invalidate()  # disarmed devices need fresh samples on Play
        # A description evaluates the scene: its own updates must not send samples.
        if self._is_describing or not self._listener.is_armed or scene != bpy.context.scene:
            return
        # Frames of an export, a recording or a render are not frames of the user.
        if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
            return
        try:
            self._listener.update(scene)
        except (ReferenceError, HfxError) as error:
            self._listener.forget()
            self._listener.fail(str(error))
        except Exception as error:
            self._fail(error)
        if not is_playing():
            self.request_update()  # the description may have changed

    @persistent
    def on_update(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Send samples after an edit, but for strokes on a canvas; during playback, check the
        description as well."""
        if painting.is_stroke(depsgraph):
            return
        # Asked first: sending samples may evaluate the scene, and an edit is not due to that.
        is_edit = not stepping.is_stepping()
        self.on_change(scene)
        if is_edit and not self._is_describing and is_playing():
            self.request_update()

    @persistent
    def on_load(self, *_: object) -> None:
        """Stop all devices before a file is opened."""
        self._stop("another file was opened")

    @persistent
    def on_undo(self, *_: object) -> None:
        """Stop all devices before an undo or redo."""
        self._stop("stopped by an undo or redo")

    def beat(self) -> float:
        """Timer: send a heartbeat, and redraw the panel after device events; returns the interval,
        seconds. Errors stop the devices; a deleted object discards the description."""
        try:
            if self._listener.exchange_heartbeat():
                redraw("VIEW_3D")
        except ReferenceError as error:  # a deleted object; the next change describes the scene
            _log.info("live: %s", error)
            self._listener.forget()
        except Exception as error:  # Blender removes a timer after an exception
            self._fail(error)
        return BEAT_S

    def _stop(self, reason: str) -> None:
        self._listener.stop_all(reason)
        self._listener.forget()

    def _fail(self, error: Exception) -> None:
        self._listener.fail(f"{type(error).__name__}: {error}")
        _log.error("live", exc_info=error)  # may wait for the terminal


SLOW_S: Final = 0.2
"""Duration of a slow frame, seconds; devices stop after 0.25 s without a heartbeat."""


@dataclass(frozen=True)
class SlowFrame:
    """Duration of a slow frame of Blender's main thread, seconds."""

    whole_s: float
    own_s: float  # part of whole_s: haptic evaluation

    def __str__(self) -> str:
        return (
            f"Blender needed {self.whole_s:.1f} s for a frame, {self.own_s:.1f} s of this for "
            "haptics; devices stop after 0.25 s without a heartbeat."
        )


class SlowFrames:
    """Detects slow frames by the intervals between heartbeats."""

    def __init__(self) -> None:
        self.newest: SlowFrame | None = None  # last interval above SLOW_S
        self._sign_s = time.monotonic()
        self.own_s = 0.0  # haptic evaluation in the current interval

    def sign(self) -> None:
        """End the interval at a heartbeat; one above :data:`SLOW_S` becomes :attr:`newest`."""
        now = time.monotonic()
        if now - self._sign_s > SLOW_S:
            self.newest = SlowFrame(now - self._sign_s, self.own_s)
        self._sign_s, self.own_s = now, 0.0
