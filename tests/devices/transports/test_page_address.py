# SPDX-License-Identifier: GPL-3.0-or-later
"""QR code of the page's address: its modules in half blocks."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_tools.commands.play import qr_code

pytest.importorskip("segno")

# Finder pattern of ISO/IEC 18004: a dark ring of 7 modules around a dark square of 3.
FINDER = np.pad(np.pad(np.ones((3, 3), bool), 1), 1, constant_values=True)
LIGHT_HALVES = {"█": (True, True), "▀": (True, False), "▄": (False, True), " ": (False, False)}


def modules(lines: list[str]) -> np.ndarray:
    """Return dark modules of lines on a dark terminal, where characters are light."""
    halves = np.array([[LIGHT_HALVES[mark] for mark in line] for line in lines])
    return ~halves.transpose(0, 2, 1).reshape(2 * len(lines), -1)


def test_the_modules_are_a_qr_code_with_a_light_border():
    dark = modules(qr_code("http://192.168.178.112:8137", "utf-8"))
    dark = dark[: dark.shape[1]]  # an odd number of rows ends with half a line
    side = dark.shape[1]
    code = dark[2 : side - 2, 2:-2]
    assert code.shape[0] == code.shape[1] and (len(code) - 17) % 4 == 0  # a version of 1 to 40
    for corner in (code[:7, :7], code[:7, -7:], code[-7:, :7]):
        assert np.array_equal(corner, FINDER)
    assert code[6, 8 : len(code) - 8].tolist() == [k % 2 == 0 for k in range(len(code) - 16)]
    assert not dark[:2].any() and not dark[:, :2].any() and not dark[:, -2:].any()


def test_a_terminal_without_block_characters_gets_no_code():
    assert qr_code("http://127.0.0.1:8137", "ascii") == []
