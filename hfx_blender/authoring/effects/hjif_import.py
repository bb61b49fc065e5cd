# SPDX-License-Identifier: GPL-3.0-or-later
"""Import of files of haptics, HJIF or vibration envelopes, as painted effects: one per channel,
with its envelope as a clip."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import bpy
import numpy as np

from ...blender.scene_info import animation_fps
from ...engine.body.model import load_model
from ...engine.modality import AMBIENT_NEUTRAL_C, MODALITIES
from ...errors import InputError
from ...files.strict_json import read_bytes
from ...formats.files import format_of, read_signals
from ...formats.glb import glb
from ...formats.hjif import hjif_reader
from ...formats.hjif.body_parts import vertex_masks
from ...formats.hjif.to_signals import VIBRATIONS, Envelope, envelopes
from ...formats.signals.curves import Curve, with_crossings
from ...formats.signals.signals import TICK_S, Piece, Signal, mixed, simplified_signals
from .. import clips
from . import effects

_MODALITIES = {modality.hjif: name for name, modality in MODALITIES.items()}
_MODALITIES |= dict.fromkeys(VIBRATIONS, "vibration")
_WHOLE_BODY = 0xFFFFFFFF  # mask of all body parts
MOST_KEYS = 500  # largest number of keyframes of a channel before simplification
_WARMER_K = 6.0  # default full scale of a temperature


def import_hjif(
    scene: bpy.types.Scene, path: Path, body: bpy.types.Object, frame: float
) -> tuple[list[bpy.types.Object], list[str], list[str]]:
    """Add a file's channels to a body as painted effects, starting at a frame.

    Vertices are imported if the file's mesh equals a perceptual model; else the area is the
    channel's body part mask. Without a full scale in the file, the strength of a new effect is full
    scale. Formats besides HJIF have vibration of no body part.

    Returns the effects, the channels and parts of channels without an effect, with reasons, and the
    reader's assumptions. Raises InputError: the file cannot be read; the scene is unchanged.
    """
    # All is read before the first effect is added, as an error must leave the scene unchanged.
    own_models: set[str] = set()
    if format_of(path).id == "hjif":
        document, tolerated = hjif_reader.decode(read_bytes(path), str(path))
        channels = [_with_ticks(envelope) for envelope in envelopes(document, str(path))]
        own_models, notes = _own_models(document, path.parent, body), list(tolerated)
    else:
        signals, _ = read_signals(path)
        channels = []
        for signal in signals:  # vibration of no body part, of the file's name without one
            curves = signal.amplitude, signal.frequency_hz, signal.transients
            head = (VIBRATIONS[0], signal.name or path.stem, 0, ())
            channels.append(_with_ticks(Envelope(*head, *curves, None, signal.left_out)))
        notes = [note for signal in signals for note in signal.notes]
    created: list[bpy.types.Object] = []
    left_out: list[str] = []
    for envelope in channels:
        name, modality = envelope.channel, _MODALITIES.get(envelope.modality)
        left_out += envelope.left_out
        if modality is None:
            left_out.append(f"'{name}': {envelope.modality} is not supported")
        elif not envelope.strength.values.any():
            left_out.append(f"'{name}': is silent")
        else:
            # A channel without a body part is not refused, the whole body is assumed.
            if not envelope.body_part_mask and not envelope.vertices:
                notes.append(f"'{name}' names no body part: it is on the whole body")
            is_own = effects.model_id_for(modality, body) in own_models
            created += _add_effects(scene, envelope, modality, body, frame, is_own)
    return created, left_out, notes


def _with_ticks(envelope: Envelope) -> Envelope:
    """Copy of a vibration envelope with its transients as pulses, see :func:`with_pulses`;
    unchanged without a frequency."""
    if envelope.frequency_hz is None:
        return envelope
    curves = envelope.strength, envelope.frequency_hz, envelope.transients
    signal = with_pulses(Signal(envelope.channel, *curves))
    strength, pitch = signal.amplitude, signal.frequency_hz
    return replace(envelope, strength=strength, frequency_hz=pitch, transients=())


def with_pulses(signal: Signal) -> Signal:
    """Copy of a signal with its transients mixed in as falling pulses, as effects have one curve
    each; simplified if it had any transients or more than 500 keyframes."""
    strength, pitch = signal.amplitude, signal.frequency_hz
    if len(strength) <= MOST_KEYS and not signal.transients:
        return signal
    pieces = [
        Piece(float(strength.times_s[0]), float(strength.times_s[-1]), strength, pitch),
        *(
            Piece(
                tick.time_s,
                tick.time_s + TICK_S,
                Curve.of([tick.time_s, tick.time_s + TICK_S], [tick.amplitude, 0.0]),
                Curve.of([tick.time_s], [tick.frequency_hz]),
            )
            for tick in signal.transients
        ),
    ]
    (simplified,) = simplified_signals([mixed(signal.name, pieces)])
    return simplified


def _own_models(document: dict[str, Any], folder: Path, body: bpy.types.Object) -> set[str]:
    """Ids of a body's perceptual models equal by hash to a GLB mesh that the avatars of
    ``document`` name by a file in ``folder``; unreadable meshes count as different."""
    model_ids = set()
    for avatar in document["avatars"]:
        # Only a file next to the HJIF file is opened, never another path.
        file = unquote(avatar.get("mesh", ""))
        if not file or file != Path(file).name or not (folder / file).is_file():
            continue
        try:
            hashes = glb.model_hashes(read_bytes(folder / file), str(folder / file))
        except InputError:
            continue
        own = {effects.model_id_for(name, body) for name in MODALITIES}
        for model_id in own & hashes.keys():
            if hashes[model_id] == load_model(model_id).content_hash:
                model_ids.add(model_id)
    return model_ids


def _add_effects(
    scene: bpy.types.Scene,
    envelope: Envelope,
    modality: str,
    body: bpy.types.Object,
    frame: float,
    is_own: bool,
) -> list[bpy.types.Object]:
    """Add painted effects for an envelope; returns them, or [] for a strength without a peak. One
    effect, of a temperature up to two: warmth and cold. A clip from ``frame`` on holds the envelope
    and a varying frequency. ``is_own``: HFX wrote the file, so its vertices are those of a
    model."""
    model = load_model(effects.model_id_for(modality, body))
    if is_own and envelope.vertices:
        vertices = sorted({vertex for vertex in envelope.vertices if 0 <= vertex < len(model)})
    else:
        # Without own vertices the body part mask selects an area.
        masks = vertex_masks(model) & np.uint32(envelope.body_part_mask or _WHOLE_BODY)
        vertices = np.flatnonzero(masks).tolist()
    # An intensity is unsigned: warmth and cold are separate effects. Keyframes at zero crossings
    # let each begin where the other ends.
    crossed = with_crossings(envelope.strength, 0.0)
    signs = [1.0, -1.0] if modality == "temperature" else [1.0]
    created = []
    for sign in signs:
        curve = Curve(crossed.times_s, np.maximum(sign * crossed.values, 0.0))
        peak = float(curve.values.max())
        if peak <= 0.0:
            continue
        effect = effects.add_painted(scene, modality, body, envelope.channel)
        effects.set_area(effect, vertices, [1.0] * len(vertices))
        full = envelope.full_scale
        if modality == "temperature":
            effect.hfx.temperature = AMBIENT_NEUTRAL_C + sign * peak * (full or _WARMER_K)
        else:
            strength = MODALITIES[modality].strength_parameter.prop
            setattr(effect.hfx, strength, peak * (full or getattr(effect.hfx, strength)))
        level = Curve(curve.times_s, curve.values / peak)
        add_envelope_clip(effect, envelope.channel, level, envelope.frequency_hz, frame, scene)
        created.append(effect)
    return created


def add_envelope_clip(
    effect: bpy.types.Object,
    name: str,
    level: Curve,
    frequency_hz: Curve | None,
    frame: float,
    scene: bpy.types.Scene,
) -> None:
    """Add a clip from ``frame`` on with a level (0..1) and, if not None, a frequency as keyframes;
    a constant frequency is set on the effect."""
    fps = animation_fps(scene)

    def keys(of: Curve) -> list[clips.Key]:
        return [*zip((of.times_s * fps).tolist(), of.values.tolist(), strict=True)]

    # In a clip the curves move together, and hold no value before and after.
    profile, varying = keys(level), {}
    if frequency_hz is not None:
        effect.hfx.frequency = float(frequency_hz.values[0])
        if np.ptp(frequency_hz.values) > 0.0:
            varying["hfx.frequency"] = keys(frequency_hz)
    (start, _), (end, last) = profile[0], profile[-1]
    if end == start:
        end += 1.0
        profile.append((end, last))
    clips.add_clip(effect, frame + start, frame + end, name=name, profile=profile, curves=varying)
