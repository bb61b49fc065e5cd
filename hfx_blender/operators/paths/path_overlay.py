# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay of paths and points on the posed avatar."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...authoring.effects import effects
from ...authoring.paths import paths, skin_picking
from ...authoring.volumes import effect_colour
from ...blender.events import DrawHandlers
from ...blender.scene_info import metres_of
from ...errors import HfxError

if TYPE_CHECKING:
    from ...engine.arrays import F32, F64


_ABOVE_SKIN_M = 0.003
_RING = 24
_MOST_POINTS = 400
_FAINT = 0.45
_PENDING_COLOUR = (1.0, 0.85, 0.2, 1.0)

_anchors: dict[int, skin_picking.Anchors] = {}
pending_clicks: tuple[bpy.types.Object | None, F64 | None, F64 | None] = (None, None, None)


def show_pending(
    body: bpy.types.Object | None, places: F64 | None = None, path: F64 | None = None
) -> None:
    """Show points (n, 3) during drawing on a body, and a path (m, 3) through them; body None hides
    both. Metres on the canonical body; without a path, straight segments join the points."""
    global pending_clicks
    pending_clicks = (body, places, places if path is None else path)


def lines_of(
    effect: bpy.types.Object, depsgraph: bpy.types.Depsgraph, unit_m: float
) -> tuple[F32, F32] | None:
    """Line of a point's path (n, 3) and rim of its disc (m, 3) at the current frame.

    World space, Blender's units, lifted 3 mm above the skin. None for a point without a position.
    Raises InputError: the stored path is damaged, or the body models do not fit the body.
    """
    import numpy as np

    from ...engine.areas.spot import places_on

    path = paths.path_of(effect)
    body = effect.hfx.body
    if not len(path) or body is None:
        return None
    evaluated = effect.evaluated_get(depsgraph).hfx
    own = paths.own_path(effect)
    # Long recordings are thinned for display; the end of the path is always drawn.
    shown = own[:: max(len(own) // _MOST_POINTS, 1)]
    lifted = _on_body(body, depsgraph, np.concatenate([shown, own[-1:]]), unit_m)
    now = places_on(path, np.array([evaluated.path_position]))
    ring = _ring(body, depsgraph, now, evaluated.radius * unit_m, unit_m)
    return lifted, ring


def _on_body(
    body: bpy.types.Object, depsgraph: bpy.types.Depsgraph, places: F64, unit_m: float
) -> F32:
    import numpy as np

    key = hash(places.tobytes())
    # A path rarely changes, but is drawn at each frame: its anchors on the skin are cached.
    if key not in _anchors:
        # A path that is being edited leaves an entry for each of its versions.
        if len(_anchors) > 256:
            _anchors.clear()
        _anchors[key] = skin_picking.Anchors.of(places)
    points, normals = _anchors[key].posed_on(body, depsgraph)
    return (points + normals * (_ABOVE_SKIN_M / unit_m)).astype(np.float32)


def _ring(
    body: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    centre: F64,
    radius_m: float,
    unit_m: float,
) -> F32:
    """Rim of a disc (m, 3), lifted a little above the posed skin; world space.

    ``centre`` (1, 3) in metres on the canonical body; the radius is at least 4 mm.
    """
    import numpy as np

    from ...engine.body.model import load_model

    around = skin_picking.Anchors.of(centre)
    skin_normals = load_model(skin_picking.SKIN_MODEL).normals
    normal = around.weights[0] @ skin_normals[around.corners[0]].astype(np.float64)
    # The right singular vectors of a single row: the normal, then two axes of the plane across.
    axes = np.linalg.svd(normal[None])[2][1:]
    angle = np.arange(_RING + 1) * (2.0 * np.pi / _RING)
    rim = centre + max(radius_m, 0.004) * np.column_stack([np.cos(angle), np.sin(angle)]) @ axes
    points, normals = skin_picking.Anchors.of(rim).posed_on(body, depsgraph)
    return (points + normals * (_ABOVE_SKIN_M / unit_m)).astype(np.float32)


def _draw() -> None:
    """Draw all paths of the scene, those of inactive effects faintly, and the pending path; stop at
    the first damaged path."""
    from ...playback.preview.drawing import card_state, draw_lines

    space = bpy.context.space_data
    if space is None or not space.overlay.show_overlays:
        return
    scene = bpy.context.scene
    body, places, path = pending_clicks
    spots = [e for e in effects.effects_of(scene) if e.hfx.kind == "SPOT" and e.visible_get()]
    spots = [spot for spot in spots if not effects.needs_body(scene, spot)]
    if not spots and body is None:
        return
    depsgraph = bpy.context.evaluated_depsgraph_get()
    unit_m = metres_of(scene)
    try:
        for effect in spots:
            lines = lines_of(effect, depsgraph, unit_m)
            if lines is not None:
                strength = 1.0 if effect == bpy.context.object else _FAINT
                colour = (*effect_colour(effect.hfx)[:3], strength)
                for line in lines:
                    draw_lines(line, colour)
        if body is not None and places is not None and len(places):
            draw_lines(_on_body(body, depsgraph, path, unit_m), _PENDING_COLOUR)
            points = _on_body(body, depsgraph, places, unit_m)
            shader = gpu.shader.from_builtin("UNIFORM_COLOR")
            with card_state("NONE"):
                gpu.state.point_size_set(7.0)
                shader.uniform_float("color", _PENDING_COLOUR)
                batch_for_shader(shader, "POINTS", {"pos": points}).draw(shader)
    except (HfxError, ReferenceError):
        return  # the export and the panels report faults


_handlers = DrawHandlers((bpy.types.SpaceView3D, _draw, "POST_VIEW"))
register = _handlers.register


def unregister() -> None:
    _handlers.unregister()
    _anchors.clear()
    show_pending(None)
