# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender handlers for saving, loading and updates.

Before saving, copies of effects get unique ids and canvases are stored. After loading, areas of
earlier body models are transferred. On updates, drawn fades follow their clips, effects store the
names of their bodies, and edited wires of volumes are redrawn.
"""

import logging
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..blender.events import add_handlers, remove_handlers
from ..blender.stored_values import stored_at
from . import atlas_pictures, drawn_fades, painting, volumes
from .effects import effects, model_migration
from .surfaces import surface_updates

_log = logging.getLogger(__name__)


@persistent
def _before_saving(*_: object) -> None:
    effects.store_unique_ids()
    effects.store_body_names(_effects())
    painting.store_all_painted()
    atlas_pictures.sync_all()


@persistent
def _after_loading(*_: object) -> None:
    names = model_migration.update_all()
    if names:
        _log.info("areas transferred to the present body models: %s", ", ".join(names))
    effects.store_body_names(_effects())  # for files of versions without names
    atlas_pictures.watch()


@persistent
def _on_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if depsgraph.id_type_updated("OBJECT"):
        atlas_pictures.watch()
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object):
            # Updates name evaluated copies.
            changed = update.id.original
            if drawn_fades.has_drawn_fades(changed) and drawn_fades.follow_clips(changed):
                changed.update_tag()
            # Renaming updates neither transform nor geometry, posing updates both.
            is_named = not (update.is_updated_transform or update.is_updated_geometry)
            if is_named and changed.hfx.role == "BODY":
                effects.store_body_names(e for e in _effects() if stored_at(e, "body") == changed)
            elif changed.hfx.role == "EFFECT":
                # A copied effect has the stored name of its original's body.
                effects.store_body_names([changed])
                # Nobody sees it in background mode, where the warning of an export says more.
                if update.is_updated_geometry and not bpy.app.background:
                    volumes.restore_wire(changed)


def _effects() -> Iterator[bpy.types.Object]:
    return (obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT")


_HANDLERS = {
    "save_pre": _before_saving,
    "load_post": _after_loading,
    "undo_post": atlas_pictures.show_undone,
    "redo_post": atlas_pictures.show_undone,
    "depsgraph_update_post": _on_update,
}


def register() -> None:
    add_handlers(_HANDLERS)
    surface_updates.register()


def unregister() -> None:
    surface_updates.unregister()
    remove_handlers(_HANDLERS)
