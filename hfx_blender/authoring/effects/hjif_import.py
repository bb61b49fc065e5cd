# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF files as painted effects: one for each channel, its envelope as keyframes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import bpy
import numpy as np

from ...blender import compat
from ...blender.scene_info import fps_of
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import AMBIENT_NEUTRAL_C, MODALITIES
from ...errors import InputError
from ...files.strict_json import read_bytes
from ...formats.glb import glb_reader
from ...formats.hjif import reader
from ...formats.hjif.body_parts import vertex_masks
from ...formats.hjif.to_signals import VIBRATIONS, Envelope, envelopes
from ...formats.rasters.signal_raster import TICK_S
from ...formats.signals.curves import Curve, with_zeros
from ...formats.signals.signals import Piece, mixed, simplified_signals
from . import effects

_OURS = {modality.hjif: name for name, modality in MODALITIES.items()}
_OURS |= dict.fromkeys(VIBRATIONS, "vibration")
_ANYWHERE = 0xFFFFFFFF  # mask of all body parts
MOST_KEYS = 500  # keyframes of a channel: beyond it they are simplified
_WARMER_K = 6.0  # full scale of a temperature whose file does not state it


def import_hjif(
    scene: bpy.types.Scene, path: Path, body: bpy.types.Object, frame: float
) -> tuple[list[bpy.types.Object], list[str], list[str]]:
    """Add a file's channels to a body as painted effects, from a frame on.

    Vertices are taken over if the file's mesh is ours; otherwise the area is what the channel's
    body part mask names. Where a file does not tell its full scale, that of a new effect is
    taken.

    Returns
    -------
    made : list of Object
    left_out : list of str
        Channels that no effect can be, each with the reason, and parts of channels.
    notes : list of str
        How the file was read.

    Raises
    ------
    InputError
        The file cannot be read; nothing was added.
    """
    document, tolerated = reader.decode(read_bytes(path), str(path))
    # Everything is read before anything is made.
    found = [_with_ticks(each) for each in envelopes(document, str(path))]
    ours = _own_models(document, path.parent)
    made: list[bpy.types.Object] = []
    left_out: list[str] = []
    notes = list(tolerated)
    for each in found:
        modality = _OURS.get(each.modality)
        left_out += each.left_out
        if modality is None:
            left_out.append(f"'{each.channel}': {each.modality} is none of our modalities")
        elif not each.strength.values.any():
            left_out.append(f"'{each.channel}': is silent")
        else:
            if not each.body_part_mask and not each.vertices:
                notes.append(f"'{each.channel}' names no body part: it is on the whole body")
            made += _effects(
                scene, each, modality, body, frame, effects.model_id_for(modality) in ours
            )
    return made, left_out, notes


def _with_ticks(envelope: Envelope) -> Envelope:
    """An envelope with its ticks as short pulses, and few keyframes."""
    if envelope.frequency_hz is None:
        return envelope
    strength, pitch = envelope.strength, envelope.frequency_hz
    pieces = [
        Piece(float(strength.times_s[0]), float(strength.times_s[-1]), strength, pitch),
        *(
            Piece(
                tick.time_s,
                tick.time_s + TICK_S,
                Curve.of([tick.time_s, tick.time_s + TICK_S], [tick.amplitude, 0.0]),
                Curve.of([tick.time_s], [tick.frequency_hz]),
            )
            for tick in envelope.transients
        ),
    ]
    if len(strength) > MOST_KEYS or envelope.transients:
        whole = mixed(envelope.channel, pieces)
        (few,) = simplified_signals([whole])
        strength, pitch = few.amplitude, few.frequency_hz
    return replace(envelope, strength=strength, frequency_hz=pitch, transients=())


def _own_models(document: dict[str, Any], folder: Path) -> set[str]:
    """Models that the file's meshes are, to the last vertex."""
    found = set()
    for avatar in document["avatars"]:
        name = unquote(avatar.get("mesh", ""))
        if not name or name != Path(name).name or not (folder / name).is_file():
            continue
        try:
            content = read_bytes(folder / name)
            hashes = glb_reader.model_hashes(content, str(folder / name))
        except InputError:
            continue
        for model_id in {effects.model_id_for(each) for each in MODALITIES} & hashes.keys():
            if hashes[model_id] == load_model(model_id).content_hash:
                found.add(model_id)
    return found


def _effects(
    scene: bpy.types.Scene,
    envelope: Envelope,
    modality: str,
    body: bpy.types.Object,
    frame: float,
    is_own: bool,
) -> list[bpy.types.Object]:
    """Add one effect; two for a temperature that both warms and cools."""
    model = load_model(effects.model_id_for(modality))
    vertices = _vertices(envelope, model, is_own)
    signs = [1.0, -1.0] if modality == "temperature" else [1.0]
    made = []
    for sign in signs:
        curve = _positive(envelope.strength, sign)
        peak = float(curve.values.max())
        if peak <= 0.0:
            continue
        effect = effects.add_painted(scene, modality, body, envelope.channel)
        effects.set_area(effect, vertices, [1.0] * len(vertices))
        _set_strength(effect, modality, sign, peak, envelope.full_scale)
        _animate(scene, effect, "hfx.intensity", Curve(curve.times_s, curve.values / peak), frame)
        if envelope.frequency_hz is not None:
            effect.hfx.frequency = float(envelope.frequency_hz.values[0])
            if np.ptp(envelope.frequency_hz.values) > 0.0:
                _animate(scene, effect, "hfx.frequency", envelope.frequency_hz, frame)
        made.append(effect)
    return made


def _vertices(envelope: Envelope, model: PerceptualModel, is_own: bool) -> list[int]:
    if is_own and envelope.vertices:
        return sorted({each for each in envelope.vertices if 0 <= each < len(model)})
    masks = vertex_masks(model)
    return np.flatnonzero(masks & np.uint32(envelope.body_part_mask or _ANYWHERE)).tolist()


def _positive(curve: Curve, sign: float) -> Curve:
    """Part of a curve that has this sign, 0 elsewhere; it crosses 0 at the same times."""
    crossed = with_zeros(curve)
    return Curve(crossed.times_s, np.maximum(sign * crossed.values, 0.0))


def _set_strength(
    effect: bpy.types.Object, modality: str, sign: float, peak: float, full: float | None
) -> None:
    name = MODALITIES[modality].strength_parameter.prop
    if modality == "temperature":
        effect.hfx.temperature = AMBIENT_NEUTRAL_C + sign * peak * (full or _WARMER_K)
    else:
        setattr(effect.hfx, name, peak * (full or getattr(effect.hfx, name)))


def _animate(
    scene: bpy.types.Scene, effect: bpy.types.Object, path: str, curve: Curve, frame: float
) -> None:
    fps = fps_of(scene)
    keys = zip((frame + curve.times_s * fps).tolist(), curve.values.tolist(), strict=True)
    compat.set_keys(compat.own_fcurve(effect, path, ""), keys)
