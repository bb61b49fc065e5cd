# SPDX-License-Identifier: GPL-3.0-or-later
"""The core of the players, compiled into a library and called as a game would call it."""

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
_PLAYER_BYTES = 512
_CLIP_BYTES = 1024
_SOURCE = """\
#ifdef _WIN32
#define HFX_API __declspec(dllexport)
#else
#define HFX_API __attribute__((visibility("default")))
#endif
#include "hfx_player.h"
HFX_API int sizes(int which);
HFX_API int sizes(int which) {
  return (int)(which == 0 ? sizeof(hfx_clip) : which == 1 ? sizeof(hfx_player) : sizeof(hfx_body));
}
"""

F32 = npt.NDArray[np.float32]


def compiler() -> list[str]:
    """Command of a C compiler: the system's, or that of the package ``ziglang``.

    Raises
    ------
    RuntimeError
        There is none.
    """
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    spec = importlib.util.find_spec("ziglang")
    if spec is None:
        raise RuntimeError("no C compiler: install gcc, clang, or the package ziglang")
    return [sys.executable, "-m", "ziglang", "cc"]


def compiled(source: str, made: Path, *options: str, suffix: str = ".c") -> Path:
    """Compile a source that may include the core; warnings are errors.

    Raises
    ------
    RuntimeError
        It cannot be compiled; the compiler's messages.
    """
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "source" + suffix)
        path.write_text(source, encoding="utf-8")
        command = [*compiler(), str(path), "-o", str(made), f"-I{CORE}", "-O2", *options, "-lm"]
        strict = ["-Wall", "-Wextra", "-Wno-unused-function", "-pedantic", "-Werror"]
        done = subprocess.run([*command, *strict], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return made


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The core as a library."""
    folder = tempfile.mkdtemp(prefix="hfx_players_")
    made = compiled(_SOURCE, Path(folder, "core.so"), "-std=c99", "-shared", "-fPIC")
    core = ctypes.CDLL(str(made))
    shutil.rmtree(folder, ignore_errors=True)
    assert core.sizes(0) <= _CLIP_BYTES and core.sizes(1) <= _PLAYER_BYTES
    core.hfx_clip_seconds.restype = core.hfx_player_position.restype = ctypes.c_double
    core.hfx_error_text.restype = ctypes.c_char_p
    return core


class Clip:
    """Clip opened by the core; ``error`` is what ``hfx_clip_open`` returned."""

    def __init__(self, content: bytes) -> None:
        self._core = library()
        self._content = ctypes.create_string_buffer(content, len(content))
        self.at = (ctypes.c_uint64 * (_CLIP_BYTES // 8))()
        self.error = int(
            self._core.hfx_clip_open(self.at, self._content, ctypes.c_size_t(len(content)))
        )
        self.columns = int(self._core.hfx_clip_columns(self.at))


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

    def advance(self, seconds: float) -> F32:
        """Values of all columns, (C,)."""
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

    def parameter(self, name: str, factor: float) -> int:
        found = self._core.hfx_player_set_parameter(
            self._at, name.encode(), ctypes.c_double(factor)
        )
        return int(found)

    @property
    def is_playing(self) -> bool:
        return bool(self._core.hfx_player_is_playing(self._at))

    @property
    def position_s(self) -> float:
        return float(self._core.hfx_player_position(self._at))

    def _values(self) -> object:
        return self._out.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
