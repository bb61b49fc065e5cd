# SPDX-License-Identifier: GPL-3.0-or-later
"""Atlas pictures of painted effects: weights as texels for 2D painting, linked both ways.

A texel of a vertex has the colour of the effect times the weight; its brightest channel is the
weight. The picture is an image of the file, which the Image Editor and other programs change.
"""

from __future__ import annotations

import time
import zlib
from contextlib import suppress
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ..blender.events import call_soon, is_painting, redraw
from ..errors import InputError
from . import painting, volumes
from .effects import effects

if TYPE_CHECKING:
    from ..engine.arrays import F64

EFFECT, MODEL, LAYOUT = "hfx_atlas_effect", "hfx_atlas_model", "hfx_atlas_layout"
"""ID properties of a picture: its effect, the id of the effect's model, and the layout of its
texels (``_layout``)."""

_POLL_S = 0.1
# Levels 0..255 (V,) last equal on both sides, by session uid; None: the weights are to be shown.
_synced: dict[int, F64 | None] = {}
_times_s = {"changed": 0.0, "read": 0.0}  # last change of an effect or canvas, last comparison
# Since the last comparison, in any picture: a running stroke, and the presses of the mouse.
_had_stroke = False
_presses: list[str] = []  # each "inside" or "outside" of the picture's edges
_is_missed = False  # the last stroke lay outside of the charts


def pictures() -> list[bpy.types.Image]:
    """Atlas pictures of existing effects."""
    return [image for image in bpy.data.images if image.get(EFFECT) is not None]


def picture_of(effect: bpy.types.Object) -> bpy.types.Image:
    """Picture of an effect with the present weights, added if missing, resized for another model.
    Raises InputError: the canvas was edited, or the stored area is invalid."""
    from ..engine.body import atlas

    weights, model_id = painting.weights_of(effect), effects.model_id_of(effect)
    _, size = atlas.texels(model_id)
    image = next((image for image in pictures() if image[EFFECT] == effect), None)
    if image is None:
        image = bpy.data.images.new(f"{effect.name} Atlas", *size, alpha=True)
        image.colorspace_settings.name = "Non-Color"
        image.use_fake_user = True
    image[EFFECT], image[MODEL] = effect, model_id
    if tuple(image.size) != size:
        image.scale(*size)
    _write(image, weights)
    watch()
    return image


def sync(image: bpy.types.Image) -> bool:
    """Apply the changes of one side to the other; weights win where both changed, after undo and
    redo, and in a picture with the layout of an earlier version. Returns True if weights were set.
    No effect for a picture of another model or size.
    Raises InputError: the canvas was edited, or the stored area is invalid."""
    import numpy as np

    effect, shown = image[EFFECT], _shown(image)
    if shown is None:
        return False
    weights = painting.weights_of(effect)
    levels = np.round(weights * 255.0)
    is_earlier = image.get(LAYOUT) != _layout(image)
    if is_earlier or not np.array_equal(levels, _synced.get(image.session_uid, levels)):
        _write(image, weights)
        return False
    _synced[image.session_uid] = shown
    is_painted = shown != levels
    if is_painted.any():
        weights[is_painted] = shown[is_painted] / 255.0
        painting.set_weights(effect, weights)
    return bool(is_painted.any())


def sync_all() -> None:
    """Synchronize all pictures, and pack those without a file, before the .blend is saved."""
    for image in pictures():
        with suppress(InputError):  # an edited canvas is reported when painting is finished
            sync(image)
        if image.is_dirty and not image.filepath:
            image.pack()


def watch() -> None:
    """Compare pictures with weights soon, and from now on; no effect in background mode. Called
    after loading and after changes of effects and canvases."""
    _times_s["changed"] = time.monotonic()
    if not bpy.app.background and pictures():
        call_soon(_poll, _POLL_S)


@persistent
def show_undone(*_: object) -> None:
    """Show the weights in all pictures soon. Handler of undo and redo, which can leave a picture
    with texels of another step."""
    _synced.update((image.session_uid, None) for image in pictures())
    watch()


def _poll() -> float | None:
    """Timer: synchronize changed pictures and, after a pause, changed weights; take strokes outside
    of the charts back. None without any picture."""
    global _had_stroke, _is_missed
    import numpy as np

    _note_stroke()
    if is_painting():
        return _POLL_S
    had_stroke, _had_stroke, presses = _had_stroke, False, tuple(_presses)
    _presses.clear()
    now_s, window = time.monotonic(), bpy.context.window_manager.windows[0]
    # Reading weights of a canvas takes 20 ms: not during a stroke.
    are_weights_due = _times_s["read"] < _times_s["changed"] < now_s - _POLL_S
    for image in pictures():
        shown = _shown(image)
        if are_weights_due or not np.array_equal(shown, _synced.get(image.session_uid)):
            with suppress(InputError), bpy.context.temp_override(window=window):
                before = _synced.get(image.session_uid)
                if sync(image):
                    if had_stroke or presses:
                        _undo_in_picture(image, before, len(presses))
                    bpy.ops.ed.undo_push(message="Paint in 2D")
                    return _POLL_S  # undo has replaced the images of this loop
        is_empty = had_stroke and presses[-1:] == ("outside",)
        if shown is not None and (is_empty or (presses and _count_outside(image))):
            with bpy.context.temp_override(window=window):
                before = _synced.get(image.session_uid)
                _undo_in_picture(image, before, len(presses), is_empty)
            _is_missed = True
            redraw("IMAGE_EDITOR")
            return _POLL_S
    if are_weights_due:
        _times_s["read"] = now_s
    return _POLL_S if pictures() else None


def note_press(place: tuple[float, float] | None) -> None:
    """Note a press of the mouse at a place of a picture, (0, 0) to (1, 1) inside; None elsewhere. A
    stroke may begin, and strokes between two comparisons are not seen. The message about a stroke
    outside of the charts ends."""
    global _is_missed
    if place is not None:
        is_inside = all(0.0 <= share <= 1.0 for share in place)
        _presses.append("inside" if is_inside else "outside")
        call_soon(_note_stroke)  # a click can end before the next comparison
    if _is_missed:
        _is_missed = False
        redraw("IMAGE_EDITOR")


def _note_stroke() -> None:
    """Set ``_had_stroke`` if a stroke of texture paint is running."""
    global _had_stroke
    _had_stroke |= is_painting("PAINT_OT_image_paint")


def is_missed() -> bool:
    """Test that the last stroke lay outside of the charts, and was taken back."""
    return _is_missed


def _undo_in_picture(
    image: bpy.types.Image, before: F64 | None, presses: int, is_empty: bool = False
) -> None:
    """Remove the undo steps of the last strokes in a picture, back to levels ``before`` (V,), but
    keep the weights of the strokes. A single step of the scene, added next, then takes the strokes
    back on both sides; strokes outside of the charts need none. Each of ``presses`` of the mouse
    has at most one step. With ``is_empty`` the last stroke, with an undo step, lay outside of the
    picture."""
    import numpy as np

    uid, weights = image.session_uid, painting.weights_of(image[EFFECT])
    frame = bpy.context.scene.frame_current
    for _ in range(max(presses, 1)):
        shown, outside = _shown(image), _count_outside(image)
        if not (is_empty or outside) and np.array_equal(shown, before):
            break
        bpy.ops.ed.undo()
        image = next((image for image in pictures() if image.session_uid == uid), None)
        is_same = image is not None and _count_outside(image) == outside
        if image is None or (is_same and not is_empty and np.array_equal(_shown(image), shown)):
            bpy.ops.ed.redo()  # the step of something else
            image = next(image for image in pictures() if image.session_uid == uid)
            break
        # An undo to a step of the scene can leave an image without its texels, and not dirty.
        if not image.is_dirty:
            break
        is_empty = False
    painting.set_weights(image[EFFECT], weights)
    _write(image, weights)
    bpy.context.scene.frame_current = frame  # played frames have no undo steps


def _shown(image: bpy.types.Image) -> F64 | None:
    """Levels 0..255 (V,) in a picture; None for a picture of another model or size."""
    import numpy as np

    from ..engine.body import atlas
    from .surfaces.image_values import pixels_of

    cells, size = atlas.texels(image[MODEL])
    model_id = effects.model_id_of(image[EFFECT])
    if tuple(image.size) != size or image[MODEL] != model_id:
        return None
    brightest = pixels_of(image)[cells[:, 1], cells[:, 0], :3].max(axis=1)
    return np.asarray(np.round(brightest.clip(0.0, 1.0) * 255.0), np.float64)


def _count_outside(image: bpy.types.Image) -> int:
    """Count the painted texels outside of the charts of a picture."""
    import numpy as np

    from ..engine.body import atlas
    from .surfaces.image_values import pixels_of

    cells, _ = atlas.texels(image[MODEL])
    is_painted = pixels_of(image)[..., 3] > 0.0
    return int(np.count_nonzero(is_painted) - is_painted[cells[:, 1], cells[:, 0]].sum())


def _write(image: bpy.types.Image, weights: F64) -> None:
    """Set the texels of all vertices; other texels become transparent."""
    import numpy as np

    from ..engine.body import atlas

    colour = np.array(volumes.effect_colour(image[EFFECT].hfx, bpy.context.scene.hfx.palette))
    levels = np.round(weights * 255.0)
    cells, (width, height) = atlas.texels(image[MODEL])
    pixels = np.zeros((height, width, 4), np.float32)
    pixels[cells[:, 1], cells[:, 0]] = levels[:, None] / 255.0 * (colour / colour[:3].max())
    pixels[cells[:, 1], cells[:, 0], 3] = 1.0
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image[LAYOUT] = _layout(image)
    _synced[image.session_uid] = levels


def _layout(image: bpy.types.Image) -> str:
    """Checksum of the places of a picture's texels, which differ between versions of the add-on."""
    from ..engine.body import atlas

    return f"{zlib.crc32(atlas.texels(image[MODEL])[0].tobytes()):08x}"
