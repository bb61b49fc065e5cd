# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration signals of HJIF files, for conversion to other formats."""

from collections import Counter
from dataclasses import replace
from typing import Any, Final

import numpy as np

from hfx_blender.files.findings import ToleratedFaults
from hfx_blender.formats.hjif.hjif_reader import decode as read
from hfx_blender.formats.hjif.perceptions import DATE
from hfx_blender.formats.hjif.to_signals import VIBRATIONS, envelopes
from hfx_blender.formats.signals.curves import clipped
from hfx_blender.formats.signals.signals import Credits, FrequencyRange, Signal

_PLACES: Final = ("body_part_mask", "vertices", "body_part_target", "actuator_target", "direction")


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode the vibration channels of a file as signals, and the range of all frequencies. Losses
    and notes of the file are on the first signal; 0 to 1 Hz without signals. Raises InputError for
    an unreadable file, and TooLargeError for too many effects after unfolding."""
    document, notes = read(content, name)
    signals = []
    # The constant date of HFX's own files states nothing.
    credits = Credits(
        description=document["description"],
        created="" if document["date"] == DATE else document["date"],
    )
    lost: Counter[str] = Counter()  # channels without a signal, by reason
    for envelope in envelopes(document, name):
        if envelope.frequency_hz is None or envelope.modality not in VIBRATIONS:
            lost[f"modality {envelope.modality}"] += 1
            continue
        losses = envelope.left_out
        if (envelope.strength.values > 1.0).any():
            losses += (f"'{envelope.channel}': is louder than full scale: cut to it",)
        strength = clipped(envelope.strength, 0.0, 1.0)
        signals.append(
            Signal(
                envelope.channel,
                strength,
                envelope.frequency_hz,
                envelope.transients,
                losses,
                credits=credits,
            )
        )
    if signals:
        left_out = tuple(f"{count} channels: {reason}" for reason, count in lost.items())
        notes += _unused_members(document)
        first = signals[0]
        signals[0] = replace(first, left_out=left_out + first.left_out, notes=notes)
    hertz = [signal.frequency_hz.values for signal in signals]
    hertz += [np.array([tick.frequency_hz]) for signal in signals for tick in signal.transients]
    all_hertz = np.concatenate(hertz) if hertz else np.array([0.0, 1.0])
    lowest, highest = float(all_hertz.min()), float(all_hertz.max())
    return signals, FrequencyRange(lowest, highest, is_stated=False)


def _unused_members(document: dict[str, Any]) -> ToleratedFaults:
    """Sentences about places, mixing coefficients and modality Other, lost in signals; empty for a
    document without any of these."""
    perceptions = document["perceptions"]
    channels = [channel for perception in perceptions for channel in perception["channels"]]
    sentences = {
        "modality Other is taken as vibration": any(
            perception["perception_modality"] == "Other" for perception in perceptions
        ),
        "places of its channels on the body are not kept": any(
            channel.get(key) for channel in channels for key in _PLACES
        ),
        "mixing coefficients of its channels are not kept": any(
            abs(channel["mixing_coefficient"] - 1.0) > 1e-3 for channel in channels
        ),
    }
    return tuple(sentence for sentence, holds in sentences.items() if holds)
