# SPDX-License-Identifier: MIT
"""Play haptic clips (.hfxclip) with the compiled core, by ctypes; Python 3.9 or later.

``python hfx_player.py CLIP [NAME]`` prints the values of all columns at 60 frames a second of the
clip's own time as CSV. ``HFX_LIBRARY`` in the environment is the path of the library; without it
the library is looked for beside this file.
"""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path
from typing import NamedTuple

_NAMES = {"win32": "hfx_haptics.dll", "darwin": "libhfx_haptics.dylib"}


class Column(NamedTuple):
    """One value of an actuator, with its unit and limits."""

    actuator: str
    parameter: str
    unit: str
    lowest: float
    highest: float
    neutral: float


class Device(NamedTuple):
    """A device and its columns. An output has to be silent ``dead_man_s`` after the last value."""

    id: str
    first_column: int
    columns: int
    dead_man_s: float


class Player:
    """Player of one clip; use it from one thread at a time, and close it at the end (or ``with``).

    Raises ``ValueError`` for bytes that are no clip, and ``OSError`` if there is no library.
    """

    def __init__(self, clip: bytes) -> None:
        self._core = _library()
        error = ctypes.c_int32()
        self._self = ctypes.c_void_p(
            self._core.hfx_live_player_open(clip, ctypes.c_size_t(len(clip)), ctypes.byref(error))
        )
        if not self._self:
            raise ValueError(self._core.hfx_live_error(error).decode())
        self._count = self._core.hfx_live_player_columns(self._self)
        self._out = (ctypes.c_float * self._count)()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the clip; closing twice is allowed, other calls are not."""
        self._core.hfx_live_player_close(self._self)
        self._self = ctypes.c_void_p()

    @property
    def seconds(self) -> float:
        """Length of the clip."""
        return float(self._core.hfx_live_player_seconds(self._self))

    @property
    def is_playing(self) -> bool:
        """Whether a clip plays, paused or not."""
        return bool(self._core.hfx_live_player_is_playing(self._self))

    @property
    def position(self) -> float:
        """Seconds from the beginning of the clip."""
        return float(self._core.hfx_live_player_position(self._self))

    def columns(self) -> list[Column]:
        """One for each value of :meth:`advance`."""
        found = []
        for k in range(self._count):
            texts = [ctypes.c_char_p() for _ in range(3)]
            numbers = [ctypes.c_double() for _ in range(3)]
            given = [ctypes.byref(item) for item in (*texts, *numbers)]
            self._core.hfx_live_player_column(self._self, k, *given)
            names = [(text.value or b"").decode() for text in texts]
            found.append(Column(*names, *(number.value for number in numbers)))
        return found

    def devices(self) -> list[Device]:
        """Devices in the order of their columns."""
        found = []
        for k in range(self._core.hfx_live_player_devices(self._self)):
            id, numbers = ctypes.c_char_p(), [ctypes.c_uint32() for _ in range(3)]
            given = [ctypes.byref(item) for item in (id, *numbers)]
            self._core.hfx_live_player_device(self._self, k, *given)
            first, count, dead_man_ms = (number.value for number in numbers)
            found.append(Device((id.value or b"").decode(), first, count, dead_man_ms / 1000.0))
        return found

    def named_clips(self) -> list[str]:
        """Names for :meth:`play`."""
        found, name = [], ctypes.c_char_p()
        while not self._core.hfx_live_player_named_clip(
            self._self, len(found), ctypes.byref(name), None, None
        ):
            found.append((name.value or b"").decode())
        return found

    def play(self, name: str = "") -> bool:
        """Begin with the whole clip or a named one; False, and silence, for an unknown name."""
        return self._core.hfx_live_player_play(self._self, name.encode()) == 0

    def advance(self, seconds: float) -> list[float]:
        """Go on by the seconds since the last call; values of all columns, in their units."""
        self._core.hfx_live_player_advance(
            self._self, ctypes.c_double(seconds), self._out, self._count
        )
        return list(self._out)

    def silence(self) -> list[float]:
        """Pause; neutral values of all columns."""
        self._core.hfx_live_player_silence(self._self, self._out, self._count)
        return list(self._out)

    def pause(self, is_paused: bool) -> None:
        """Stand still with neutral values, or go on."""
        self._core.hfx_live_player_pause(self._self, int(is_paused))

    def stop(self) -> None:
        """End in silence, at the beginning of what was played."""
        self._core.hfx_live_player_stop(self._self)

    def seek(self, seconds: float) -> None:
        """Jump to a time from the beginning of the clip; nothing between is felt."""
        self._core.hfx_live_player_seek(self._self, ctypes.c_double(seconds))

    def loop(self, loops: bool) -> None:
        """Set whether the whole clip, and what plays now, begins again at its end."""
        self._core.hfx_live_player_loop(self._self, int(loops))

    def gain(self, gain: float) -> None:
        """Scale all strengths: 0 is silence, 1 as made."""
        self._core.hfx_live_player_gain(self._self, ctypes.c_double(gain))

    def place(self, turn_degrees: float, raise_m: float = 0.0, stretch: float = 1.0) -> None:
        """Turn all to the left about the body, raise it by metres, and multiply heights."""
        numbers = map(ctypes.c_double, (turn_degrees, raise_m, stretch))
        self._core.hfx_live_player_place(self._self, *numbers)

    def set_parameter(self, parameter: str, factor: float) -> bool:
        """Scale one parameter, say ``amplitude_m_s2``; False if no column has this name."""
        given = ctypes.c_double(factor)
        return self._core.hfx_live_player_set_parameter(self._self, parameter.encode(), given) == 0


_loaded: ctypes.CDLL | None = None


def _library() -> ctypes.CDLL:
    """Load the library once and declare results that are no C int."""
    global _loaded
    if _loaded is None:
        beside = Path(__file__).with_name(_NAMES.get(sys.platform, "libhfx_haptics.so"))
        core = ctypes.CDLL(os.environ.get("HFX_LIBRARY") or str(beside))
        core.hfx_live_player_open.restype = ctypes.c_void_p
        core.hfx_live_error.restype = ctypes.c_char_p
        core.hfx_live_player_seconds.restype = ctypes.c_double
        core.hfx_live_player_position.restype = ctypes.c_double
        core.hfx_live_player_columns.restype = ctypes.c_uint32
        core.hfx_live_player_devices.restype = ctypes.c_uint32
        _loaded = core
    return _loaded


def main(arguments: list[str]) -> int:
    """Print a clip, or a named clip of it, as CSV."""
    if len(arguments) not in (1, 2):
        sys.stderr.write("usage: python hfx_player.py CLIP [NAME]\n")
        return 2
    try:
        with Player(Path(arguments[0]).read_bytes()) as player:
            if not player.play(*arguments[1:]):
                raise ValueError("there is no clip of this name")
            player.loop(False)  # an end, also for a named clip that is meant to loop
            names = [f"{column.actuator} {column.parameter}" for column in player.columns()]
            sys.stdout.write(",".join(["time_s", *names]) + "\n")
            while player.is_playing:
                values = player.advance(1.0 / 60.0)
                row = [player.position, *values]
                sys.stdout.write(",".join(f"{value:.4f}" for value in row) + "\n")
    except (OSError, ValueError) as fault:
        sys.stderr.write(f"{arguments[0]}: {fault}\n")
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
