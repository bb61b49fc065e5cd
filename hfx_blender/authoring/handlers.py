# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's handlers: before a file is saved, copies of effects get ids of their own, and painted
areas are stored with their effects; drawn fades follow their clips. After a file is loaded, areas
on earlier body models are carried over to the present ones. Effects know their bodies by name.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..blender.events import add_handlers, remove_handlers
from ..blender.stored_values import stored_at
from .areas import painting
from .clips import drawn_fades
from .effects import effects, model_migration
from .surfaces import surface_updates

_log = logging.getLogger(__name__)


@persistent
def _before_saving(*_: object) -> None:
    effects.store_unique_ids()
    effects.store_body_names(_effects())
    painting.store_all_painted()


@persistent
def _after_loading(*_: object) -> None:
    found = model_migration.update_all()
    if found:
        _log.info("carried over to the present body models: %s", ", ".join(found))
    effects.store_body_names(_effects())  # files of versions that stored no names


@persistent
def _on_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object):
            changed = update.id.original
            if drawn_fades.is_remembered(changed) and drawn_fades.follow(changed):
                changed.update_tag()
            # A new name is an update of neither place nor shape, and posing is one of both.
            is_named = not (update.is_updated_transform or update.is_updated_geometry)
            if is_named and changed.hfx.role == "BODY":
                effects.store_body_names(e for e in _effects() if stored_at(e, "body") == changed)


def _effects() -> Iterator[bpy.types.Object]:
    return (obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT")


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
