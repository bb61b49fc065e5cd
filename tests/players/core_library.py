# SPDX-License-Identifier: GPL-3.0-or-later
"""Core of the players, compiled as a library and called as in a game."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "players" / "core"
_PLAYER_BYTES = 1024
_CLIP_BYTES = 1024
_BODY_BYTES = 1024
_SOURCE = """\
#ifdef _WIN32
#define HFX_API __declspec(dllexport)
#else
#define HFX_API __attribute__((visibility("default")))
#endif
#include "hfx_player.h"
#include "../native/live_body.c"
#include "../native/live_player.c"
HFX_API int sizes(int which);
HFX_API int sizes(int which) {
  return (int)(which == 0 ? sizeof(hfx_clip) : which == 1 ? sizeof(hfx_player) : sizeof(hfx_body));
}
"""

F32 = npt.NDArray[np.float32]


def compiler() -> list[str]:
    """Command of a C compiler: the system's, or the package ``ziglang``.

    Raises
    ------
    RuntimeError
        No compiler is installed.
    """
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    spec = importlib.util.find_spec("ziglang")
    if spec is None:
        raise RuntimeError("no C compiler: install gcc, clang, or the package ziglang")
    return [sys.executable, "-m", "ziglang", "cc"]


def compiled(source: str, target: Path, *options: str, suffix: str = ".c") -> Path:
    """Compile a source with the core in the include path; warnings are errors.

    Raises
    ------
    RuntimeError
        Compilation failed; with the compiler's messages.
    """
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "source" + suffix)
        path.write_text(source, encoding="utf-8")
        command = [*compiler(), str(path), "-o", str(target), f"-I{CORE}", "-O2", *options, "-lm"]
        strict = ["-Wall", "-Wextra", "-Wno-unused-function", "-pedantic", "-Werror"]
        done = subprocess.run([*command, *strict], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return target


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Return the core and the engine functions as a library."""
    folder = tempfile.mkdtemp(prefix="hfx_players_")
    created = compiled(_SOURCE, Path(folder, "core.so"), "-std=c99", "-shared", "-fPIC")
    core = ctypes.CDLL(str(created))
    shutil.rmtree(folder, ignore_errors=True)
    assert core.sizes(0) <= _CLIP_BYTES and core.sizes(1) <= _PLAYER_BYTES
    assert core.sizes(2) <= _BODY_BYTES
    core.hfx_body_bytes.restype = ctypes.c_size_t
    core.hfx_body_effects_bytes.restype = ctypes.c_size_t
    core.hfx_body_effects_volume_bytes.restype = ctypes.c_size_t
    core.hfx_body_add_volume.restype = ctypes.c_uint32
    core.hfx_body_remove_volume.restype = ctypes.c_void_p
    core.hfx_body_weights.restype = ctypes.POINTER(ctypes.c_float)
    core.hfx_body_level.restype = ctypes.c_double
    core.hfx_clip_seconds.restype = core.hfx_player_position.restype = ctypes.c_double
    core.hfx_error_text.restype = core.hfx_live_error.restype = ctypes.c_char_p
    core.hfx_live_open.restype = core.hfx_live_player_open.restype = ctypes.c_void_p
    core.hfx_live_open_effects.restype = ctypes.c_void_p
    core.hfx_live_level.restype = ctypes.c_double
    return core


class Clip:
    """Clip opened by the core; ``error`` is the result of ``hfx_clip_open``."""

    def __init__(self, content: bytes) -> None:
        self._core = library()
        self._content = ctypes.create_string_buffer(content, len(content))
        self.at = (ctypes.c_uint64 * (_CLIP_BYTES // 8))()
        self.error = int(
            self._core.hfx_clip_open(self.at, self._content, ctypes.c_size_t(len(content)))
        )
        self.columns = int(self._core.hfx_clip_columns(self.at))

    def is_device(self, index: int, name: str) -> bool:
        return bool(self._core.hfx_clip_is_device(self.at, index, name.encode()))


class Player:
    """Player of the core."""

    def __init__(self, clip: Clip) -> None:
        self._core = library()
        self._clip = clip
        self._at = (ctypes.c_uint64 * (_PLAYER_BYTES // 8))()
        self._out = np.zeros(max(clip.columns, 1), np.float32)
        self.play()

    def play(self) -> None:
        self._core.hfx_player_play(self._at, self._clip.at)

    def named(self, name: str) -> int:
        return int(self._core.hfx_player_play_named(self._at, self._clip.at, name.encode()))

    def replay(self, name: str = "") -> int:
        return int(self._core.hfx_player_replay(self._at, name.encode()))

    def advance(self, seconds: float) -> F32:
        """Return the values of all columns, (C,)."""
        self._core.hfx_player_advance(self._at, ctypes.c_double(seconds), self._values())
        return self._out[: self._clip.columns].copy()

    def silence(self) -> F32:
        self._core.hfx_player_silence(self._at, self._values())
        return self._out[: self._clip.columns].copy()

    def pause(self, is_paused: int) -> None:
        self._core.hfx_player_pause(self._at, int(is_paused))

    def stop(self) -> None:
        self._core.hfx_player_stop(self._at)

    def seek(self, seconds: float) -> None:
        self._core.hfx_player_seek(self._at, ctypes.c_double(seconds))

    def loop(self, loops: int) -> None:
        self._core.hfx_player_loop(self._at, int(loops))

    def gain(self, gain: float) -> None:
        self._core.hfx_player_gain(self._at, ctypes.c_double(gain))

    def place(self, turn_degrees: float, raise_m: float, stretch: float) -> None:
        numbers = map(ctypes.c_double, (turn_degrees, raise_m, stretch))
        self._core.hfx_player_place(self._at, *numbers)

    def parameter(self, name: str, factor: float) -> int:
        actual = self._core.hfx_player_set_parameter(
            self._at, name.encode(), ctypes.c_double(factor)
        )
        return int(actual)

    @property
    def is_playing(self) -> bool:
        return bool(self._core.hfx_player_is_playing(self._at))

    @property
    def position_s(self) -> float:
        return float(self._core.hfx_player_position(self._at))

    def _values(self) -> object:
        return self._out.ctypes.data_as(ctypes.POINTER(ctypes.c_float))


class Body:
    """Body of the core, with effects of its own clip or another one; ``error`` is the result of
    opening."""

    def __init__(self, clip: Clip, body: int = 0, effects: Clip | None = None) -> None:
        self._core, self._clip, self._effects = library(), clip, effects or clip
        self._at = (ctypes.c_uint64 * (_BODY_BYTES // 8))()
        size = int(self._core.hfx_body_effects_bytes(clip.at, body, self._effects.at))
        self._memory = (ctypes.c_uint64 * (size // 8 + 1))()
        self._out = np.zeros(max(clip.columns, 1), np.float32)
        given = (self._memory, ctypes.c_size_t(size))
        if effects is None:
            self.error = int(self._core.hfx_body_open(self._at, clip.at, body, *given))
        else:
            self.error = int(
                self._core.hfx_body_open_effects(self._at, clip.at, body, effects.at, *given)
            )

        self._blocks: list[object] = []
        self._body = body

    def add_volume(
        self, effect: int, size: int | None = None, *, in_memory_of_last: bool = False
    ) -> int:
        """Add a volume, with memory of ``size`` bytes or as many as needed; return the number. The
        memory is new, or that of the last volume added."""
        if size is None:
            size = int(
                self._core.hfx_body_effects_volume_bytes(
                    self._clip.at, self._body, self._effects.at, effect
                )
            )
        if not in_memory_of_last:
            self._blocks.append((ctypes.c_uint64 * (size // 8 + 1))())
        given = ctypes.c_size_t(size)
        return int(self._core.hfx_body_add_volume(self._at, effect, self._blocks[-1], given))

    def remove_volume(self, number: int) -> bool:
        return bool(self._core.hfx_body_remove_volume(self._at, number))

    def set_bones(self, matrices: npt.NDArray[np.float64]) -> None:
        """Set the pose by (B, 3, 4) matrices of the clip's bones, rest space to world."""
        given = np.ascontiguousarray(matrices, np.float32)
        self._core.hfx_body_set_bones(self._at, given.ctypes.data_as(ctypes.c_void_p))

    def set_volume(self, effect: int, matrix: npt.NDArray[np.float64]) -> int:
        given = np.ascontiguousarray(matrix, np.float32)
        at = given.ctypes.data_as(ctypes.c_void_p)
        return int(self._core.hfx_body_set_volume(self._at, effect, at))

    def place(self, effect: int, turn_degrees: float, raise_m: float, stretch: float) -> int:
        numbers = map(ctypes.c_double, (turn_degrees, raise_m, stretch))
        return int(self._core.hfx_body_place(self._at, effect, *numbers))

    def trigger(self, effect: int, level: float) -> int:
        return int(self._core.hfx_body_trigger(self._at, effect, ctypes.c_double(level)))

    def set_parameter(self, effect: int, parameter: int, value: float) -> int:
        given = ctypes.c_double(value)
        return int(self._core.hfx_body_set_parameter(self._at, effect, parameter, given))

    def evaluate(self, seconds: float) -> F32:
        """Return the values of all columns, (C,)."""
        out = self._out.ctypes.data_as(ctypes.c_void_p)
        self._core.hfx_body_evaluate(self._at, ctypes.c_double(seconds), out)
        return self._out[: self._clip.columns].copy()

    def weights(self, effect: int) -> F32:
        """Weights of an effect at the vertices of the body's model, (V,); empty without weights."""
        count = ctypes.c_uint32()
        body_weights = self._core.hfx_body_weights(self._at, effect, ctypes.byref(count))
        return (
            np.ctypeslib.as_array(body_weights, (count.value,))
            if count.value
            else np.zeros(0, "f4")
        )

    def level(self, effect: int) -> float:
        return float(self._core.hfx_body_level(self._at, effect))


class Stroke:
    """Finger of the core on a clip's surface."""

    def __init__(self, clip: Clip, surface: int = 0) -> None:
        self._core, self._clip, self._surface = library(), clip, surface
        self._at = (ctypes.c_uint64 * 8)()

    def feel(
        self, u: float, v: float, seconds: float, speed_mm_s: float = -1.0
    ) -> tuple[float, float]:
        """Amplitude, m/s^2, and frequency, Hz, of the path to a place; -1 mm/s: measured speed."""
        out = (ctypes.c_float * 2)()
        numbers = map(ctypes.c_double, (u, v, speed_mm_s, seconds))
        self.error = self._core.hfx_surface_feel(
            self._clip.at, self._surface, self._at, *numbers, out
        )
        return out[0], out[1]

    def lift(self) -> None:
        self._core.hfx_surface_lift(self._at)
