# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of effects, clips and devices received from other programs by OSC.

Received values replace values of the scene in previews and live devices, also while an animation
plays. Nothing is written into the .blend; a recording keeps values as keyframes and clips.
"""

import logging
import time
from dataclasses import dataclass
from typing import Any, Final

import bpy
from bpy.app.handlers import persistent

from ...authoring import clips
from ...authoring.effects import effects
from ...blender import compat
from ...blender.events import add_handlers, call_soon, redraw, remove_handlers, remove_timers
from ...blender.scene_info import fps_of
from ...engine.modality import MODALITIES
from ...errors import HfxError
from ...tracking.receiver import OscReceiver
from ...tracking.value_addresses import ValueChange, address_of, change_of
from ..evaluation import evaluation
from ..preview.preview import preview
from .live import live

STEP_S: Final = 1.0 / 60.0
_MOST_SHOWN: Final = 8  # addresses in the panel
_UNUSED: Final = ("envelope",)
_MENUS: Final = ("shape", "falloff", "temperature_reference")  # of settings that change the touch

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Trigger:
    """Clip started by a message."""

    effect: str
    clip: str
    begun_s: float  # monotonic


class Listening:
    """Received values of this Blender, while a receiver is open."""

    def __init__(self) -> None:
        self.receiver: OscReceiver | None = None
        self.fault = ""  # error that ended the listening; "" without
        self.newest: dict[str, str] = {}  # address -> value or reason of refusal, newest last
        self.is_recording = False
        self._muted: set[str] = set()  # names of effects
        # Property -> number, or three numbers, by name of the effect.
        self._set: dict[str, dict[str, float | str | tuple[float, ...]]] = {}
        self._triggers: list[_Trigger] = []
        # Value by effect, data path, index and frame; frames of started clips.
        self._keys: dict[tuple[str, str, int], dict[int, float]] = {}
        self._clips: list[tuple[_Trigger, int]] = []
        self._handlers = dict.fromkeys(("load_pre", "undo_pre", "redo_pre"), self.on_end)

    def start(self, receiver: OscReceiver) -> None:
        """Receive values from now on; the receiver before is closed."""
        self.stop()
        self.receiver, self.fault = receiver, ""
        add_handlers(self._handlers)
        call_soon(self.step, STEP_S)

    def stop(self) -> None:
        """End receiving; values of the scene are back. A running recording is discarded."""
        if self.receiver is None:
            return
        self.receiver.close()
        self.receiver, self.is_recording = None, False
        for state in (self._muted, self._set, self._triggers, self._keys, self._clips, self.newest):
            state.clear()
        live.factors.pop("gain", None)
        live.factors.pop("mute", None)
        remove_handlers(self._handlers)
        remove_timers(self.step)
        self._show()

    def step(self) -> float | None:
        """Timer: apply received values; returns the interval in seconds, None at the end. Errors
        end the listening and stop the devices."""
        if self.receiver is None:
            return None
        try:
            messages = [received.message for received in self.receiver.take()]
            changes = [change for message in messages if (change := change_of(message))]
            for change in changes:
                self._apply(change)
            if changes or self._triggers:
                self._show()
        except HfxError as error:
            self._fail(str(error))
        except Exception as error:
            self._fail(f"{type(error).__name__}: {error}")
            _log.error("listening", exc_info=error)
        return STEP_S if self.receiver is not None else None

    def _fail(self, text: str) -> None:
        live.fail(text)  # first, as the end of receiving waits for a thread
        self.stop()
        self.fault = text
        redraw("VIEW_3D")

    def _apply(self, change: ValueChange) -> None:
        """Store a change; an unknown effect, clip or property is named in ``newest`` only."""
        shown = change.text or " ".join(f"{x:g}" for x in change.vector or (change.value,))
        if change.target == "all":
            is_mute = change.parameter == "mute"
            live.factors[change.parameter] = 1.0 - change.value if is_mute else change.value
        elif change.target == "clip":
            shown = self._trigger(change) if change.value else shown
        elif change.target == "effect":
            shown = self._set_value(change) or shown
        else:
            shown = "not used in Blender"
        address = address_of(*change[:3])
        self.newest.pop(address, None)
        self.newest[address] = shown
        for oldest in list(self.newest)[:-_MOST_SHOWN]:
            del self.newest[oldest]

    def _set_value(self, change: ValueChange) -> str:
        """Store a value of an effect; returns the reason of a refusal, or ""."""
        scene = bpy.context.scene
        effect = next((e for e in effects.effects_of(scene) if e.name == change.name), None)
        if effect is None:
            return "no such effect"
        if change.parameter == "mute":
            (self._muted.add if change.value else self._muted.discard)(effect.name)
            return ""
        name = properties_by_parameter(effect).get(change.parameter, change.parameter)
        path, limits = _property_of(effect, name)
        if limits is not None and limits.type == "ENUM":
            return self._set_entry(effect, name, change, [x.identifier for x in limits.enum_items])
        if limits is None or change.text or limits.array_length != len(change.vector):
            return "no such value"
        numbers = tuple(
            min(max(x, limits.hard_min), limits.hard_max) for x in change.vector or (change.value,)
        )
        self._set.setdefault(effect.name, {})[name] = numbers if change.vector else numbers[0]
        if self.is_recording and limits.is_animatable:
            for k, number in enumerate(numbers):
                self._keys.setdefault((effect.name, path, k), {})[scene.frame_current] = number
        return ""

    def _set_entry(
        self, effect: bpy.types.Object, name: str, change: ValueChange, entries: list[str]
    ) -> str:
        """Store an entry of a menu by its identifier or number; returns the reason of a refusal, or
        "". Entries are not recorded: settings of a description have no keyframes."""
        by_name = {entry.lower(): entry for entry in entries}
        by_name |= {f"{float(k)}": entry for k, entry in enumerate(entries)}
        entry = by_name.get(change.text.lower() or f"{change.value}")
        if entry is None or change.vector:
            return f"expected {', '.join(entries)}, or 0 to {len(entries) - 1}"
        if "MESH" in (entry, getattr(effect.hfx, name)):
            return "the shape of a mesh stays"
        self._set.setdefault(effect.name, {})[name] = entry
        return ""

    def _trigger(self, change: ValueChange) -> str:
        """Start a clip now, again if it plays; returns the reason of a refusal, or "started"."""
        scene = bpy.context.scene
        for effect in effects.effects_of(scene):
            for _, strip in clips.strips_of(effect):
                if strip.name == change.name:
                    trigger = _Trigger(effect.name, strip.name, time.monotonic())
                    self._triggers = [t for t in self._triggers if t.clip != strip.name]
                    self._triggers.append(trigger)
                    if self.is_recording:
                        self._clips.append((trigger, scene.frame_current))
                    return "started"
        return "no such clip"

    def _show(self) -> None:
        """Evaluate the scene with the present values, for devices and preview."""
        overrides = {name: dict(values) for name, values in self._set.items()}
        now_s, scene = time.monotonic(), bpy.context.scene
        for trigger in list(self._triggers):
            level = _level_of(trigger, now_s - trigger.begun_s, scene)
            if level is None:
                self._triggers.remove(trigger)
            else:
                values = overrides.setdefault(trigger.effect, {})
                before = values.get("activation", 0.0)
                values["activation"] = max(level, before if isinstance(before, float) else 0.0)
        for name in self._muted:
            overrides.setdefault(name, {})["intensity"] = 0.0
        # Changed in place: the described scene reads this mapping at each moment.
        evaluation.overrides.clear()
        evaluation.overrides.update(overrides)
        evaluation.invalidate()
        preview.invalidate()
        redraw("VIEW_3D")  # colours, and the newest values in the panel
        if evaluation.is_outdated:
            live.handlers.request_update()
        live.resend(scene)

    def record(self) -> None:
        """Begin a recording: the newest value of each frame."""
        self._keys.clear()
        self._clips.clear()
        self.is_recording = True

    def finish_recording(self, scene: bpy.types.Scene) -> str:
        """End the recording, and key its values; returns a report. Recorded values become linear
        keyframes in the actions of the effects; started clips become clips at their frames."""
        self.is_recording = False
        count = 0
        for (name, path, index), keys in self._keys.items():
            effect = bpy.data.objects.get(name)
            if effect is None:
                continue
            curve = compat.own_fcurve(effect, path, "Values", index)
            before = {point.co[0]: point.co[1] for point in curve.keyframe_points}
            compat.set_keys(curve, sorted({**before, **keys}.items()))
            count += len(keys)
        for trigger, frame in self._clips:
            effect = bpy.data.objects.get(trigger.effect)
            strip = None if effect is None else _strip_of(effect, trigger.clip)
            if effect is not None and strip is not None:
                clips.add_clip(
                    effect,
                    frame,
                    frame + strip.frame_end - strip.frame_start,
                    name=strip.name,
                    fade_in=strip.blend_in,
                    fade_out=strip.blend_out,
                )
        report = f"{count} keyframes, {len(self._clips)} clips"
        self._keys.clear()
        self._clips.clear()
        return report

    @persistent
    def on_end(self, *_: object) -> None:
        """End the listening before an undo, a redo and another file."""
        self.stop()


def properties_by_parameter(effect: bpy.types.Object) -> dict[str, str]:
    """Properties of an effect by the parameter of an OSC address: the intensity, and the controls
    of the modality, such as "frequency_hz"."""
    controls = MODALITIES[effect.hfx.modality].controls
    return {"intensity": "intensity", **{control.name: control.prop for control in controls}}


def _property_of(effect: bpy.types.Object, name: str) -> tuple[str, Any]:
    """Data path and definition of a number or of a menu that can be set of an effect, or of the
    place of a volume; "" and None without it. Filters of the contact response are named
    ``response/0/decay``, strengths of actuators ``drive/0/value``."""
    from ...authoring.effects import effect_values  # needs numpy, which Blender's start does not

    owner, path = effect.hfx, "hfx."
    if name in effect_values.TRANSFORM and effect.hfx.kind == "VOLUME":
        owner, path = effect, ""
    elif "/" in name:
        collection, index, name = name.split("/")
        items = getattr(effect.hfx, collection)
        if int(index) >= len(items):
            return "", None
        owner, path = items[int(index)], f"hfx.{collection}[{int(index)}]."
    elif name in _MENUS:
        return "hfx." + name, owner.bl_rna.properties[name]
    definition = owner.bl_rna.properties.get(name)
    is_number = definition is not None and definition.type == "FLOAT" and name not in _UNUSED
    is_set = is_number and (definition.is_animatable or name == "falloff_share")
    return (path + name, definition) if is_set else ("", None)


def _strip_of(effect: bpy.types.Object, name: str) -> bpy.types.NlaStrip | None:
    return next((strip for _, strip in clips.strips_of(effect) if strip.name == name), None)


def _level_of(trigger: _Trigger, passed_s: float, scene: bpy.types.Scene) -> float | None:
    """Activation of a started clip after a time; None after its end, and without the clip."""
    effect = bpy.data.objects.get(trigger.effect)
    strip = None if effect is None else _strip_of(effect, trigger.clip)
    frame = passed_s * fps_of(scene)
    if strip is None or frame >= strip.frame_end - strip.frame_start:
        return None
    return clips.activation_at(strip, frame)


listening = Listening()
