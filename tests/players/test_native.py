# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine library: output by ``players/conformance/spatial``, and refusal of invalid input."""

from __future__ import annotations

import ctypes

import numpy as np
from core_library import ROOT, library

FOLDER = ROOT / "players" / "conformance" / "spatial"
BYTES = (FOLDER / "walk.hfxclip").read_bytes()


def floats(numbers: list[str] | int) -> ctypes.Array[ctypes.c_float]:
    count = numbers if isinstance(numbers, int) else len(numbers)
    return (ctypes.c_float * count)(*([] if isinstance(numbers, int) else map(float, numbers)))


def test_a_walk_matches_the_folder_and_invalid_input_is_refused() -> None:
    core = library()
    error = ctypes.c_int32()

    def opened(content: bytes, number: int = 0) -> ctypes.c_void_p:
        size = ctypes.c_size_t(len(content))
        live_open = core.hfx_live_open(content, size, number, ctypes.byref(error))
        return ctypes.c_void_p(live_open)

    assert not opened(b"") and error.value == -2
    assert not opened(BYTES[:-1]) and error.value == -1
    assert not opened(BYTES, 1) and error.value == -6
    assert b"number" in core.hfx_live_error(error)
    body = opened(BYTES)
    assert error.value == 0
    columns = core.hfx_live_columns(body)
    matrices, out, samples = [], floats(columns), 0
    for line in (FOLDER / "walk.txt").read_text().splitlines():
        word, *rest = line.split()
        if word == "bone":
            matrices += rest[1:]
        elif word == "volume":
            assert core.hfx_live_set_volume(body, int(rest[0]), floats(rest[2:]), 12) == 0
            assert core.hfx_live_trigger(body, int(rest[0]), ctypes.c_double(float(rest[1]))) == 0
        elif word == "evaluate":
            assert core.hfx_live_set_bones(body, floats(matrices), len(matrices)) == 0
            seconds, matrices = ctypes.c_double(float(rest[0])), []
            assert core.hfx_live_evaluate(body, seconds, out, columns) == 0
        else:
            effect = int(rest[0])
            live_open = floats(core.hfx_live_weights(body, effect, None, 0))
            core.hfx_live_weights(body, effect, live_open, len(live_open))
            expected = np.zeros(len(live_open))
            for item in rest[1:]:
                vertex, _, value = item.partition(":")
                expected[int(vertex)] = float(value)
            weights = np.array(live_open) * core.hfx_live_level(body, effect)
            assert np.abs(weights - expected).max() <= 1.0 / 255.0, line[:20]
            samples += int(np.count_nonzero(expected))
    assert samples > 10_000
    refused = (
        core.hfx_live_set_bones(body, floats(12), 12),
        core.hfx_live_set_volume(body, 99, floats(12), 12),
        core.hfx_live_set_volume(body, 0, floats(3), 3),
        core.hfx_live_evaluate(body, ctypes.c_double(0.1), out, columns + 1),
        core.hfx_live_evaluate(None, ctypes.c_double(0.1), out, columns),
    )
    assert all(item < 0 for item in refused)
    core.hfx_live_close(body)
    core.hfx_live_close(None)
