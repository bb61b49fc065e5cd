# SPDX-License-Identifier: GPL-3.0-or-later
"""The players' core (``players/core``) as a compiled library: a clip's touch on a posed body."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.errors import HfxError, InputError

FOLDER: Final = Path(__file__).parent
NAME: Final = {"win32": "hfx_core.dll", "darwin": "hfx_core.dylib"}.get(sys.platform, "hfx_core.so")
_MARK: Final = b"hfx_player_core"
_RESULTS: Final[dict[str, Any]] = {
    "hfx_core_build": ctypes.c_char_p,
    "hfx_core_bytes": ctypes.c_size_t,
    "hfx_error_text": ctypes.c_char_p,
    "hfx_clip_columns": ctypes.c_uint32,
    "hfx_body_bytes": ctypes.c_size_t,
    "hfx_body_level": ctypes.c_double,
    "hfx_body_weights": ctypes.POINTER(ctypes.c_float),
}


@cache
def library() -> ctypes.CDLL:
    """Compiled core of this installation, loaded once; HfxError without one."""
    return load(FOLDER / NAME)


def load(path: Path) -> ctypes.CDLL:
    """Load a compiled core; HfxError for a missing or foreign file."""
    try:
        core = ctypes.CDLL(str(path))
        for name, result in _RESULTS.items():
            getattr(core, name).restype = result
        if not core.hfx_core_build().startswith(_MARK):
            raise OSError("is another library")
    except (OSError, AttributeError) as error:
        raise HfxError(
            f"{path}: the compiled core of the players cannot be loaded ({error}); install "
            "hfx-blender again with pip."
        ) from None
    return core


class CoreBody:
    """Body of a clip in the core, with the effects of the clip.

    ``content``: bytes of the clip; ``body``: index of the body. ``columns`` is the number of values
    of all devices in the clip. Volumes begin at their place in the scene with factor 1, painted
    areas with factor 0. Raises InputError for a clip that the core refuses.
    """

    def __init__(self, content: bytes, body: int, name: str) -> None:
        self._core = library()
        # The core reads the clip in place: bytes and structures live as long as this object.
        self._content = ctypes.create_string_buffer(content, len(content))
        self._clip, self._self = (
            ctypes.create_string_buffer(self._core.hfx_core_bytes(which)) for which in (0, 1)
        )
        self._check(
            self._core.hfx_clip_open(self._clip, self._content, ctypes.c_size_t(len(content))), name
        )
        size = ctypes.c_size_t(self._core.hfx_body_bytes(self._clip, body))
        self._memory = (ctypes.c_uint64 * (size.value // 8 + 1))()
        self._check(
            self._core.hfx_body_open(self._self, self._clip, body, self._memory, size), name
        )
        self.columns = int(self._core.hfx_clip_columns(self._clip))
        self._values = np.zeros(max(self.columns, 1), np.float32)

    def evaluate(self, matrices: npt.NDArray[np.float64], seconds: float) -> npt.NDArray[Any]:
        """Values (columns,) at a pose, float32; a new array.

        ``matrices``: (bones, 3, 4) from rest space to the world for each bone of the body.
        ``seconds``: since the last call.
        """
        rows = np.ascontiguousarray(matrices, np.float32)
        self._core.hfx_body_set_bones(self._self, rows.ctypes.data_as(ctypes.c_void_p))
        out = self._values.ctypes.data_as(ctypes.c_void_p)
        self._core.hfx_body_evaluate(self._self, ctypes.c_double(seconds), out)
        return self._values[: self.columns].copy()

    def set_factor(self, effect: int, factor: float) -> None:
        """Set the factor 0 to 1 of an effect's level in the clip."""
        self._core.hfx_body_trigger(self._self, effect, ctypes.c_double(factor))

    def set_parameter(self, effect: int, parameter: int, value: float) -> None:
        """Set a parameter of an effect by its index in the modality, in its unit."""
        self._core.hfx_body_set_parameter(self._self, effect, parameter, ctypes.c_double(value))

    def set_volume(self, effect: int, matrix: npt.NDArray[np.float64]) -> None:
        """Place a volume by its matrix (3, 4) from the unit shape to the world, metres."""
        row = np.ascontiguousarray(matrix, np.float32)
        self._core.hfx_body_set_volume(self._self, effect, row.ctypes.data_as(ctypes.c_void_p))

    def weights(self, effect: int) -> npt.NDArray[np.float32]:
        """Weights 0 to 1 of an effect at the last evaluation, for each vertex of its model on this
        body; empty without the model. A view, changed by the next evaluation."""
        count = ctypes.c_uint32()
        weights = self._core.hfx_body_weights(self._self, effect, ctypes.byref(count))
        if not count.value:
            return np.zeros(0, np.float32)
        return np.ctypeslib.as_array(weights, (count.value,))

    def level(self, effect: int) -> float:
        """Level 0 to 1 of an effect at the last evaluation, with the response to the touch."""
        return float(self._core.hfx_body_level(self._self, effect))

    def touch(self, effect: int) -> float:
        """Level 0 to 1 of an effect on the skin at the last evaluation; 0 without a touch."""
        return self.level(effect) if self.weights(effect).any() else 0.0

    def _check(self, error: int, name: str) -> None:
        if error:
            raise InputError(f"{name}: {self._core.hfx_error_text(error).decode()}.")
