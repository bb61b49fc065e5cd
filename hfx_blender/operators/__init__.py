# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can do: thin operators over plain functions, one file a topic."""

from __future__ import annotations

from types import ModuleType


def _modules() -> tuple[ModuleType, ...]:
    from . import body, clips, effects, export, paint

    return body, effects, paint, clips, export


def register() -> None:
    for module in _modules():
        module.register()


def unregister() -> None:
    for module in reversed(_modules()):
        module.unregister()
