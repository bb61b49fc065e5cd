# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress reports of a build."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]
"""Callback with the finished share, 0..1, and the name of the current step."""


def quiet(_share: float, _text: str) -> None:
    """Ignore progress."""
