# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens by itself: before a file is saved, copies of effects get ids of their own."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import effects


@persistent
def _before_saving(*_: object) -> None:
    effects.settle_ids()


def register() -> None:
    bpy.app.handlers.save_pre.append(_before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_saving)
