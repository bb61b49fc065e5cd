# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps follow their settings and their material: made again a moment after the last edit.

Parameters are quick. A material must be baked again, while Blender waits: that is done by itself
only while the maps are shown and where it was quick the last time; else the maps are told to be
out of date.
"""

from __future__ import annotations

import logging
import time

import bpy

from ...blender.events import call_soon, redraw, remove_timers
from ...errors import HfxError

DELAY_S = 0.3
BAKE_DELAY_S = 0.8
QUICK_S = 1.5
"""Longest bake that runs without a request, seconds."""

_SHOWN_S = 2.0
_PAINTED = "painted"  # the state of no material

_log = logging.getLogger(__name__)
_waiting: set[str] = set()  # objects
shown_s: dict[str, float] = {}  # when an object's maps were drawn last
painted_images: set[str] = set()  # images whose pixels may be others
last_edit_s: list[float] = [0.0]


def request(obj: bpy.types.Object) -> None:
    """Make an object's maps soon, if it has some; timers never fire without a window."""
    from . import surfaces

    if not surfaces.is_surface(obj) or not obj.hfx.surface.made_of:
        return  # nothing was made yet: the first bake needs a request
    _waiting.add(obj.name)
    remove_timers(make_waiting)
    call_soon(make_waiting, DELAY_S)


def shown(obj: bpy.types.Object) -> None:
    """Note that an object's maps are being drawn."""
    shown_s[obj.name] = time.monotonic()
    if obj.hfx.surface.is_outdated and may_bake(obj):
        call_soon(bake_outdated, BAKE_DELAY_S)


def may_bake(obj: bpy.types.Object) -> bool:
    """Test that an object's material may be baked without a request."""
    from . import material_state

    is_shown = time.monotonic() - shown_s.get(obj.name, -_SHOWN_S) < _SHOWN_S
    return is_shown and material_state.bake_s.get(obj.name, QUICK_S + 1.0) <= QUICK_S


@bpy.app.handlers.persistent
def on_update(_scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """React to an edit; called at each update of the scene, so it must be quick."""
    if bpy.app.background or not is_of_matter(graph):
        return
    note(graph)
    last_edit_s[0] = time.monotonic()
    call_soon(bake_outdated, BAKE_DELAY_S)


def is_of_matter(graph: bpy.types.Depsgraph) -> bool:
    """Test an update for an edited material or image."""
    return any(graph.id_type_updated(kind) for kind in ("MATERIAL", "NODETREE", "IMAGE"))


def note(graph: bpy.types.Depsgraph) -> None:
    """Remember which images were painted on."""
    if graph.id_type_updated("IMAGE"):
        painted_images.update(
            update.id.name_full
            for update in graph.updates
            if isinstance(update.id, bpy.types.Image)
        )


def check() -> list[bpy.types.Object]:
    """Find the surfaces that are older than their material or image; marks and returns them."""
    from . import material_state, surfaces

    painted = {image for image in bpy.data.images if image.name_full in painted_images}
    painted_images.clear()
    found = []
    for obj in surfaces.surfaces_of(bpy.context.scene):
        settings = obj.hfx.surface
        if not settings.made_of:
            continue
        if settings.source == "IMAGE" and painted & {settings.image, settings.roughness_image}:
            found.append(obj)
        if settings.source != "MATERIAL":
            continue
        if painted and painted & material_state.images_of(obj):
            settings.material_state = _PAINTED
        outdated = surfaces.differs_from_material(obj)
        if outdated != settings.is_outdated:
            settings.is_outdated = outdated
        if outdated:
            found.append(obj)
    return found


def bake_outdated() -> float | None:
    since = time.monotonic() - last_edit_s[0]
    if since < BAKE_DELAY_S:  # still being edited
        return BAKE_DELAY_S - since
    if any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows):
        return BAKE_DELAY_S
    for obj in check():
        if obj.hfx.surface.source == "IMAGE" or may_bake(obj):
            _make_one(obj, anew=True)
    redraw("VIEW_3D", "IMAGE_EDITOR")
    return None


def make_waiting() -> None:
    from . import surfaces

    waiting = sorted(_waiting)
    _waiting.clear()
    for name in waiting:
        obj = bpy.data.objects.get(name)
        if obj is not None and surfaces.is_surface(obj):
            _make_one(obj, anew=False)
    redraw("VIEW_3D", "IMAGE_EDITOR")


def _make_one(obj: bpy.types.Object, *, anew: bool) -> None:
    from . import surfaces

    try:
        surfaces.make(obj, anew=anew)
    except HfxError:
        pass  # shown beside the map
    except Exception as error:  # errors in a timer are not shown
        _log.exception("surface '%s'", obj.name)
        obj.hfx.surface.note = f"{type(error).__name__}: {error}"
        obj.hfx.surface.is_faulty = True


def register() -> None:
    """Watch for edits."""
    bpy.app.handlers.depsgraph_update_post.append(on_update)


def unregister() -> None:
    """Discard all requests."""
    from . import material_state

    bpy.app.handlers.depsgraph_update_post.remove(on_update)
    for known in (_waiting, material_state.bake_s, shown_s, painted_images):
        known.clear()
