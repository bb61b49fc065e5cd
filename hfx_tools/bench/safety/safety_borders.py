# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials at both ends: Mute pressed in Blender's panel, the cable to a board cut."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.processes import blender_session

from . import firmware_core
from .safety_stops import DEVICE, PATIENCE_S, RATE_HZ, Log, NotPlayedError, NotSilentError, Rounds

_WATCHED_S: Final = 0.05
"""Seconds of input to a muted device; a perceptible value in this time is a failure."""

_BOARD: Final = "arduino_uno_pwm"


class _Mutes(Rounds):
    """Trial of Mute: the property of a device following this process's Blender is set."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._count = folder, 0
        self._bpy = blender_session.start()
        self._bpy.ops.wm.read_homefile(use_empty=True)
        self._bpy.ops.hfx.live_add(name=DEVICE)
        self._log = Log(folder / "log")

    @property
    def _item(self) -> Any:
        return self._bpy.context.scene.hfx.devices[DEVICE]

    def _feed(self) -> None:
        """Send a heartbeat, arm the device if needed, and send a surface's vibration."""
        from hfx_blender.playback.live.live import live

        live.exchange_heartbeat()
        if not live.is_armed:
            live.arm()
        live.send_vibration(10.0, 100.0)

    def round(self) -> float:
        from hfx_blender.devices.live.live_settings import LiveSettings
        from hfx_blender.playback.live.live import live

        if not live.states:
            self._count += 1
            path = self._folder / f"log{self._count}"
            self._log = Log(path)
            live.connect(DEVICE, LiveSettings(path=str(path)))
        self._item.is_muted = False
        self._log.forget()
        self.until_played(self._log.is_loud, self._feed)
        pressed_s = time.monotonic()
        self._item.is_muted = True
        end = pressed_s + _WATCHED_S
        while time.monotonic() < end:
            self._feed()
            time.sleep(1.0 / RATE_HZ)
        silence_s = self._log.silence_after(pressed_s, by_values=True)
        if silence_s is None:
            raise NotSilentError
        return silence_s

    def recover(self) -> None:
        from hfx_blender.playback.live.live import live

        live.close()

    close = recover


class _CableIsCut(Rounds):
    """Trial of a cut cable: firmware behind a pseudo-terminal loses all bytes, both ways."""

    def __init__(self, folder: Path) -> None:
        self._library = firmware_core.built(folder)
        self._device = load_device(_BOARD)
        self._values = np.array([c.highest for c in self._device.controls], np.float64)
        self._rng = np.random.default_rng(1)
        self._open()

    def _open(self) -> None:
        import tty

        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        self._board = firmware_core.PluggedBoard(self._library, self._ends[0])
        target = {"kind": "serial", "port": os.ttyname(self._ends[1])}
        self._output = open_output(self._device, target)

    def recover(self) -> None:
        self.close()
        self._open()

    def close(self) -> None:
        self._output.close()
        self._board.close()
        for descriptor in self._ends:
            os.close(descriptor)

    def _send(self) -> None:
        try:
            self._output.send(self._values)
        except OutputLostError:  # the board stopped after the cut of the cable
            self._output.stop()

    def _send_paced(self, seconds: float, is_over: Callable[[], bool] = lambda: False) -> None:
        end = following = time.monotonic()
        end += seconds
        while time.monotonic() < end and not is_over():
            self._send()
            following += 1.0 / RATE_HZ
            time.sleep(max(0.0, following - time.monotonic()))

    def round(self) -> float:
        self._board.is_cut = False
        self.until_played(lambda: self._board.silent_since_s == math.inf, self._send)
        self._send_paced(float(self._rng.uniform(0.05, 0.1)))
        if self._board.silent_since_s != math.inf:
            raise NotPlayedError("the board was silent before the fault")
        self._board.is_cut = True
        cut_s = time.monotonic()
        self._send_paced(PATIENCE_S, lambda: self._board.silent_since_s != math.inf)
        silent_s = self._board.silent_since_s
        if silent_s == math.inf:
            raise NotSilentError
        return silent_s - cut_s


KINDS: Final[dict[str, tuple[Callable[[Path], Rounds], int]]] = {
    "mute": (_Mutes, 1),
    "cable lost": (_CableIsCut, 4),
}
"""Class of rounds, and number of parallel runs, by kind."""
