# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of the stroke pad: stroke a surface with the mouse, export the stroke."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
from bpy.props import EnumProperty

from ...authoring.surfaces import surfaces
from ...errors import InputError
from ...files import kinds
from ...playback.live.live import live
from .. import framing
from ..shared import FileOperator, HfxOperator, ModalTimer
from .surface_operators import ON_SURFACE

if TYPE_CHECKING:
    from ...playback.stroke_pad import Take

_TICK_S = 0.01
_BUSY_S = 0.03
"""Delay of a timer event in a busy window, seconds: mouse events are still waiting."""

last_take: Take | None = None
"""Last stroke in this session, for the export."""


class HFX_OT_stroke_pad(ModalTimer, HfxOperator):
    """Stroke the active surface with the mouse: see, hear and feel the texture"""

    bl_label = "Stroke Pad"
    bl_options = {"REGISTER"}
    requires = (ON_SURFACE,)

    def work(self, context: bpy.types.Context) -> str:
        raise InputError("The stroke pad needs a window and a mouse.")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        from ...playback.stroke_pad import StrokePad, StrokeSound
        from .stroke_pad_view import PadPlace, draw

        obj, area = context.object, context.area
        if area is None or area.type not in ("VIEW_3D", "IMAGE_EDITOR"):
            raise InputError("Open the stroke pad from a 3D viewport or the Image Editor")
        self._pad = StrokePad(obj.name, surfaces.texture_of(obj))
        settings = obj.hfx.surface
        self._screen = context.window.screen
        self._region = framing.views(area)[0]  # the last region of quad view
        self._sound = StrokeSound(
            float(self._pad.texture.device.amplitude_m_s2(1.0)), settings.sound
        )
        self._place = rectangle = PadPlace(self._region.width, self._region.height)
        self._passed: list[tuple[float, float]] = []  # points not yet processed
        self._ticked_s = time.monotonic()
        self._space = type(area.spaces.active)
        arguments = (self._pad, settings.intensity_image, rectangle, self._region)
        self._handler = self._space.draw_handler_add(draw, arguments, "WINDOW", "POST_PIXEL")
        self.start_modal(context, _TICK_S)
        self._region.tag_redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            return self._react(context, event)
        # After an exception Blender does not call cancel(): draw handler and timer would stay.
        except Exception:
            self._close(context)
            raise

    def _react(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        pad, now = self._pad, time.monotonic()
        # The pad's viewport is hidden after a change of workspace, or by a file browser.
        if context.window is None or context.window.screen != self._screen:
            return {"PASS_THROUGH"}
        x, y = event.mouse_x - self._region.x, event.mouse_y - self._region.y
        if event.type == "ESC" and event.value == "PRESS":
            self._close(context)
            return {"FINISHED"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            if not self._place.holds(x, y):
                return {"PASS_THROUGH"}
            self._passed.clear()
            pad.press(now, self._place.surface_point(pad, x, y))
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE" and pad.is_stroking:
            pad.move_through(self._passed or [self._place.surface_point(pad, x, y)], now)
            self._keep(pad.release(now))
        elif event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE") and pad.is_stroking:
            self._passed.append(self._place.surface_point(pad, x, y))
            # Waiting events have no times, so that speeds between their points are unknown: the
            # points are a single step of the stroke, at the time of the last event.
            if event.type == "INBETWEEN_MOUSEMOVE":
                return {"RUNNING_MODAL"}
            pad.move_through(self._passed, now)
            self._passed.clear()
        elif event.type == "TIMER":
            is_late, self._ticked_s = now - self._ticked_s > _BUSY_S, now
            if not pad.is_stroking:
                return {"PASS_THROUGH"}
            if is_late:
                # Mouse events wait while Blender draws: this drawing is skipped to catch up.
                return {"RUNNING_MODAL"}
            pad.rest(now)
        elif event.value == "PRESS" and event.type in ("ONE", "TWO", "R", "E"):
            self._key(event.type)
        elif not self._place.holds(x, y):
            return {"PASS_THROUGH"}
        self._feel()
        self._region.tag_redraw()
        return {"RUNNING_MODAL"}

    def _feel(self) -> None:
        """Play a new part of the stroke, if a whole step of the device, as sound and on connected
        devices."""
        pad = self._pad
        signal = pad.next_step()
        if signal is None:
            return
        self._sound.play(signal.waveform_m_s2, signal.waveform_rate_hz)
        self._sound.set_friction(pad.now.speed_m_s / pad.target_m_s / 2.0)
        live.send_vibration(
            float(signal.amplitude_m_s2[-1]), float(signal.frequency_hz[-1]), pad.drive
        )

    def _keep(self, take: Take | None) -> None:
        global last_take
        last_take = take or last_take
        self._sound.set_friction(0.0)
        live.send_vibration(0.0, self._pad.texture.device.carrier_hz)

    def _key(self, key: str) -> None:
        from ...engine.texture.haptic_map import SurfaceRenderer
        from ...playback.stroke_pad import TARGETS_M_S

        pad = self._pad
        # A new speed or renderer must not apply to the middle of a stroke.
        pad.cancel()
        if key in ("ONE", "TWO"):
            pad.target_m_s = TARGETS_M_S[key == "TWO"]
        elif key == "R":
            order = (
                list(SurfaceRenderer) if pad.texture.height is not None else [SurfaceRenderer.MCHA]
            )
            following = order[(order.index(pad.texture.renderer) + 1) % len(order)]
            pad.texture = replace(pad.texture, renderer=following)
        elif last_take is not None:
            bpy.ops.hfx.export_stroke("INVOKE_DEFAULT")

    def _close(self, context: bpy.types.Context) -> None:
        self._space.draw_handler_remove(self._handler, "WINDOW")
        self.stop_timer(context)
        # Silences the devices; the last stroke stays for the export.
        self._keep(None)
        self._sound.close()
        self._region.tag_redraw()

    def cancel(self, context: bpy.types.Context) -> None:
        self._close(context)


class HFX_OT_export_stroke(FileOperator):
    """Write the last stroke as WAV, AHAP, .he, .haptic or CSV"""

    bl_label = "Export Last Stroke"
    bl_options = {"REGISTER"}

    kind: EnumProperty(
        name="Format",
        items=[
            (suffix, suffix[1:].upper(), f"A file *{suffix}") for suffix in kinds.STROKE_SUFFIXES
        ],
        description="Format if the name has no suffix",
    )

    requires = ((lambda _context: last_take, "Stroke a surface first"),)

    def first_path(self, _context: bpy.types.Context) -> str:
        return "" if last_take is None else bpy.path.clean_name(last_take.name) + self.kind

    def work(self, _context: bpy.types.Context) -> str:
        from ...engine.texture.stroke_rendering import render_stroke
        from ...formats.signals import stroke_files

        assert last_take is not None
        path = self.path()
        if not path.suffix:
            path = path.with_suffix(self.kind)
        stroke_files.check(path)
        signal = last_take.signal
        if path.suffix.lower() == ".wav":
            rate = stroke_files.WAV_RATE_HZ
            signal = render_stroke(last_take.texture, last_take.stroke, waveform_rate_hz=rate)
        written = stroke_files.write(signal, last_take.stroke, last_take.texture.device, path)
        return f"Wrote {path.name}" + "".join(f"; {note}" for note in written.notes)


def unregister() -> None:
    global last_take
    last_take = None
