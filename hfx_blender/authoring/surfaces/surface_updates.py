# SPDX-License-Identifier: GPL-3.0-or-later
"""Updates of haptic maps after edits of settings and materials, which a hash of nodes detects.

Maps of edited settings are made again after a short delay. A material needs a new bake, which
blocks Blender: automatic bakes happen only while the maps are displayed, and if the last bake
was quick. Otherwise the maps are marked as outdated.
"""

import logging
import time
import zlib

import bpy

from ...blender.events import call_soon, redraw, remove_timers
from ...errors import HfxError, InputError
from . import surfaces
from .material_relief import images_of, material_hash

DELAY_S = 0.3
BAKE_DELAY_S = 0.8
QUICK_S = 1.5  # longest duration of automatic bakes, seconds
_SHOWN_S = 2.0
_PAINTED = "painted"  # no hash of a material
_UNNAMED = ""  # no image's name

_log = logging.getLogger(__name__)
_waiting: set[str] = set()  # names of objects
shown_s: dict[str, float] = {}  # time of an object's last display
painted_images: set[str] = set()  # full names of updated images, "" for an unnamed image
_pixel_sums: dict[int, int] = {}  # CRC-32 of an image's pixels by session uid
last_edit_s: list[float] = [0.0]


def request(obj: bpy.types.Object) -> None:
    """Schedule an update of a surface's maps in 0.3 s, unless they were never made."""
    if not surfaces.is_surface(obj) or not obj.hfx.surface.made_of:
        return  # never baked
    _waiting.add(obj.name)
    remove_timers(make_waiting)
    call_soon(make_waiting, DELAY_S)


def on_shown(obj: bpy.types.Object) -> None:
    """Store the time of display; schedule a bake of outdated maps if the last bake was quick."""
    shown_s[obj.name] = time.monotonic()
    if obj.hfx.surface.is_outdated and may_bake(obj):
        call_soon(bake_outdated, BAKE_DELAY_S)


def may_bake(obj: bpy.types.Object) -> bool:
    """Test that maps were displayed within 2 s, and the last bake took at most 1.5 s."""
    is_shown = time.monotonic() - shown_s.get(obj.name, -_SHOWN_S) < _SHOWN_S
    return is_shown and surfaces.bake_s.get(obj.name, QUICK_S + 1.0) <= QUICK_S


@bpy.app.handlers.persistent
def on_update(_scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Handler: schedule a bake 0.8 s after the last edit of a material, node tree or image; nothing
    in background mode."""
    if bpy.app.background or not is_material_update(graph):
        return
    # Each edit delays the bake, so that a slider is dragged without a bake per step.
    note_painted(graph)
    last_edit_s[0] = time.monotonic()
    call_soon(bake_outdated, BAKE_DELAY_S)


def is_material_update(graph: bpy.types.Depsgraph) -> bool:
    """Test for an update of a material, node tree or image."""
    return any(graph.id_type_updated(kind) for kind in ("MATERIAL", "NODETREE", "IMAGE"))


def note_painted(graph: bpy.types.Depsgraph) -> None:
    """Add the full names of updated images to :data:`painted_images`; "" if Blender names none."""
    if graph.id_type_updated("IMAGE"):
        # Only images in the graph are named: none of a hidden object, and up to 4.4 none assigned
        # to a node since the graph was last built, which a new object causes.
        names = {u.id.name_full for u in graph.updates if isinstance(u.id, bpy.types.Image)}
        painted_images.update(names or {_UNNAMED})


def check() -> list[bpy.types.Object]:
    """Return the surfaces, baked before, with an edited material or painted image; sets
    ``is_outdated`` of material surfaces, and forgets the painted images."""
    baked = [obj for obj in surfaces.surfaces_of(bpy.context.scene) if obj.hfx.surface.made_of]
    painted = _forget_painted(baked) if painted_images else set()
    outdated_surfaces = []
    for obj in baked:
        settings = obj.hfx.surface
        if settings.source == "IMAGE" and painted & _sources_of(obj):
            outdated_surfaces.append(obj)
        if settings.source != "MATERIAL":
            continue
        if painted and painted & _sources_of(obj):
            settings.material_state = _PAINTED
        is_outdated = has_edited_material(obj)
        # Assigning an equal value would cause another update.
        if is_outdated != settings.is_outdated:
            settings.is_outdated = is_outdated
        if is_outdated:
            outdated_surfaces.append(obj)
    return outdated_surfaces


def _sources_of(obj: bpy.types.Object) -> set[bpy.types.Image]:
    """Images that a surface of an image or material is made from; empty for further sources."""
    settings = obj.hfx.surface
    if settings.source == "IMAGE":
        return {settings.image, settings.roughness_image} - {None}
    return images_of(obj) if settings.source == "MATERIAL" else set()


def _forget_painted(baked: list[bpy.types.Object]) -> set[bpy.types.Image]:
    """Clear :data:`painted_images`; return the painted images of surfaces. After an update without
    names these are images with other pixels than at the last comparison."""
    names = set(painted_images)
    painted_images.clear()
    images = set().union(*map(_sources_of, baked))
    changed = {image for image in images if _has_new_pixels(image)} if _UNNAMED in names else set()
    return changed | {image for image in images if image.name_full in names}


def _has_new_pixels(image: bpy.types.Image) -> bool:
    """Compare an image's pixels with the last call; at the first call, test for unsaved pixels."""
    from . import image_values

    try:
        pixel_sum = zlib.crc32(image_values.pixels_of(image))
    except InputError:  # no pixels, or too many: no surface is made from the image
        return False
    last = _pixel_sums.get(image.session_uid)
    _pixel_sums[image.session_uid] = pixel_sum
    return image.is_dirty if last is None else pixel_sum != last


def has_edited_material(obj: bpy.types.Object) -> bool:
    """Test that the hash of the materials differs from that at baking; False without a hash."""
    baked_state = obj.hfx.surface.material_state
    return baked_state != "" and baked_state != material_hash(obj)


def bake_outdated() -> float | None:
    """Timer: make outdated maps of images, and of materials displayed within 2 s whose last bake
    took at most 1.5 s; redraw. Returns seconds to wait within 0.8 s of an edit and in playback,
    else None."""
    since = time.monotonic() - last_edit_s[0]
    if since < BAKE_DELAY_S:  # still being edited
        return BAKE_DELAY_S - since
    if any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows):
        return BAKE_DELAY_S
    for obj in check():
        if obj.hfx.surface.source == "IMAGE" or may_bake(obj):
            _make_one(obj, remake=True)
    redraw("VIEW_3D", "IMAGE_EDITOR")
    return None


def make_waiting() -> None:
    """Timer: update the maps of scheduled objects, and redraw; faults are shown in the panel."""
    waiting = sorted(_waiting)
    _waiting.clear()
    for name in waiting:
        obj = bpy.data.objects.get(name)
        if obj is not None and surfaces.is_surface(obj):
            _make_one(obj, remake=False)
    redraw("VIEW_3D", "IMAGE_EDITOR")


def _make_one(obj: bpy.types.Object, *, remake: bool) -> None:
    try:
        surfaces.make_maps(obj, remake=remake)
    except HfxError:
        pass  # shown in the panel
    except Exception as error:  # errors in a timer are not shown
        _log.exception("surface '%s'", obj.name)
        obj.hfx.surface.note = f"{type(error).__name__}: {error}"
        obj.hfx.surface.is_faulty = True


def register() -> None:
    """Watch for edits."""
    bpy.app.handlers.depsgraph_update_post.append(on_update)


def unregister() -> None:
    """Remove the handler and all scheduled updates."""
    bpy.app.handlers.depsgraph_update_post.remove(on_update)
    for state in (_waiting, surfaces.bake_s, shown_s, painted_images, _pixel_sums):
        state.clear()
