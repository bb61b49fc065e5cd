# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives live devices from Blender's handlers and timers, while a device is connected."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, Protocol

import bpy
from bpy.app.handlers import persistent

from ...blender.events import add_handlers, call_soon, redraw, remove_handlers, remove_timers
from ...errors import HfxError
from ...reading.stepped import stepping

BEAT_S = 0.05


class SceneFollower(Protocol):
    """Interface of what follows the open scene."""

    @property
    def is_armed(self) -> bool: ...

    def invalidate(self) -> None: ...

    def forget(self) -> None: ...

    def describe(self, context: bpy.types.Context) -> None: ...

    def update(self, scene: bpy.types.Scene) -> None: ...

    def exchange_heartbeat(self) -> bool: ...

    def stop_all(self, reason: str) -> None: ...

    def fail(self, text: str) -> None: ...


_log = logging.getLogger(__name__)


def is_playing() -> bool:
    """Test for a playing animation, in which the next frames are known."""
    screen = bpy.context.screen
    return screen is not None and screen.is_animation_playing


class LiveHandlers:
    """Handlers and timers by which live devices follow the open scene."""

    def __init__(self, listener: SceneFollower) -> None:
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
        """Follow the open scene, and give signs of life."""
        add_handlers(self._handlers)
        call_soon(self.beat, BEAT_S, outlives_load=True)

    def stop_listening(self) -> None:
        """Remove handlers and timers, as no device is connected any more."""
        remove_handlers(self._handlers)
        remove_timers(self.beat, self.describe)

    def request_update(self) -> None:
        """Describe and send soon; not from within an update of Blender's."""
        call_soon(self.describe)

    def describe(self) -> None:
        """Describe what is played, and send the present samples."""
        if getattr(bpy.context, "scene", None) is None:  # at this moment
            self._listener.forget()
            return
        self._is_describing = True
        try:
            self._listener.describe(bpy.context)
            self._listener.update(bpy.context.scene)
        except ReferenceError as error:  # something was deleted; the next change will describe it
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
        """Send the samples of a frame, or of an edit."""
        self._listener.invalidate()  # also while nothing plays: the next Play needs the change
        if self._is_describing or not self._listener.is_armed or scene != bpy.context.scene:
            return
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
            self.request_update()  # something may have been added, painted or muted

    @persistent
    def on_update(self, scene: bpy.types.Scene, *_: object) -> None:
        """Take an edit; it is felt at once, also during playback."""
        is_edit = not stepping.is_stepping()
        self.on_change(scene)
        if is_edit and not self._is_describing and is_playing():
            self.request_update()

    @persistent
    def on_load(self, *_: object) -> None:
        """Stop before another file is opened."""
        self._stop("another file was opened")

    @persistent
    def on_undo(self, *_: object) -> None:
        """Stop before an undo or redo."""
        self._stop("stopped by an undo or redo")

    def beat(self) -> float:
        """Give a sign of life; returns the seconds until the next one."""
        try:
            if self._listener.exchange_heartbeat():
                redraw("VIEW_3D")
        except ReferenceError as error:  # something was deleted; the next change will describe it
            _log.info("live: %s", error)
            self._listener.forget()
        except Exception as error:  # a timer that raises is not called again
            self._fail(error)
        return BEAT_S

    def _stop(self, reason: str) -> None:
        self._listener.stop_all(reason)
        self._listener.forget()

    def _fail(self, error: Exception) -> None:
        _log.error("live", exc_info=error)
        self._listener.fail(f"{type(error).__name__}: {error}")


SLOW_S: Final = 0.2
"""Duration of a frame that devices may not survive, seconds; their limit is a little longer."""


@dataclass(frozen=True)
class SlowFrame:
    """Frame for which Blender's main thread needed long."""

    whole_s: float
    own_s: float  # of it to evaluate what is felt

    def __str__(self) -> str:
        return (
            f"Blender needed {self.whole_s:.1f} s for a frame, {self.own_s:.1f} s of it for touch; "
            "devices stop after 0.25 s without a sign of life."
        )


class SlowFrames:
    """Finds slow frames by the pauses between signs of life.

    Attributes
    ----------
    newest : SlowFrame or None
    """

    def __init__(self) -> None:
        self.newest: SlowFrame | None = None
        self._sign_s, self._own_s = time.monotonic(), 0.0

    def sign(self) -> None:
        """Take a sign of life of Blender's main thread."""
        now = time.monotonic()
        if now - self._sign_s > SLOW_S:
            self.newest = SlowFrame(now - self._sign_s, self._own_s)
        self._sign_s, self._own_s = now, 0.0

    @contextmanager
    def own_work(self) -> Iterator[None]:
        """Context in which what is felt is evaluated."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self._own_s += time.monotonic() - begun
