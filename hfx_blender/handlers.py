# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens by itself: before a file is saved, copies of effects get ids of their own, and
what is being painted is stored with its effect.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .authoring import effects, painting, surface_updates


@persistent
def _before_saving(*_: object) -> None:
    effects.settle_ids()
    painting.take_over_all()


def register() -> None:
    bpy.app.handlers.save_pre.append(_before_saving)
    surface_updates.register()


def unregister() -> None:
    surface_updates.unregister()
    bpy.app.handlers.save_pre.remove(_before_saving)
