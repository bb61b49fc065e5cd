# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's handlers: before a file is saved, copies of effects get ids of their own, and painted
areas are stored with their effects; drawn fades follow their clips. After a file is loaded, areas
on earlier body models are carried over to the present ones.
"""

from __future__ import annotations

import logging

import bpy
from bpy.app.handlers import persistent

from ..blender.events import add_handlers, remove_handlers
from .areas import painting
from .clips import drawn_fades
from .effects import effects, model_migration
from .surfaces import surface_updates

_log = logging.getLogger(__name__)


@persistent
def _before_saving(*_: object) -> None:
    effects.settle_ids()
    painting.store_all_painted()


@persistent
def _after_loading(*_: object) -> None:
    found = model_migration.update_all()
    if found:
        _log.info("carried over to the present body models: %s", ", ".join(found))


@persistent
def _on_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object):
            effect = update.id.original
            if drawn_fades.is_remembered(effect) and drawn_fades.follow(effect):
                effect.update_tag()


_HANDLERS = {
    "save_pre": _before_saving,
    "load_post": _after_loading,
    "depsgraph_update_post": _on_update,
}


def register() -> None:
    add_handlers(_HANDLERS)
    surface_updates.register()


def unregister() -> None:
    surface_updates.unregister()
    remove_handlers(_HANDLERS)
