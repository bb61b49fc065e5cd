# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF envelopes of all channels, for other formats and for imported effects."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, Final

from ...errors import InputError
from ...files import limits
from ..signals.curves import Curve
from ..signals.signals import Piece, Transient, mixed
from ..sound.waveforms import Waveform, added, piece_of
from . import bands, wavelets

VIBRATIONS: Final = ("Vibrotactile", "Other")
"""HJIF modalities taken as vibration; the reference encoder writes Other for any sound or AHAP."""

_LARGEST_GAIN: Final = 1e6
_DEEPEST: Final = 8  # levels of nested references and compositions


@dataclass(frozen=True, eq=False)
class Envelope:
    """Envelope of a channel, multiplied by its gain."""

    modality: str  # of the standard, such as "Vibrotactile"
    channel: str
    body_part_mask: int
    vertices: tuple[int, ...]
    strength: Curve  # times gain; of a curve band -1..1 of full scale
    frequency_hz: Curve | None  # None: curves have no pitch
    transients: tuple[Transient, ...]
    full_scale: float | None  # largest amplitude of its reference device; None: unknown
    left_out: tuple[str, ...] = ()  # losses, a sentence each


def envelopes(document: dict[str, Any], name: str = "HJIF") -> Iterator[Envelope]:
    """Yield the envelope of each channel with all bands, references and compositions resolved.
    ``name`` is the file's name in messages. Raises TooLargeError for too many unfolded effects or
    too long envelopes, and InputError for cyclic references."""
    unfolding = Unfolding(name)
    timescale = document.get("timescale", 1000)
    for perception in document["perceptions"]:
        devices = {device["id"]: device for device in perception.get("reference_devices", ())}
        for channel in perception["channels"]:
            device = devices.get(channel.get("reference_device_id", 0), {})
            full_scale = device.get("maximum_amplitude")
            envelope = _envelope(perception, channel, timescale, full_scale, unfolding)
            ends = [float(envelope.strength.times_s[-1]), *(t.time_s for t in envelope.transients)]
            where = f"{name}: channel '{envelope.channel[:60]}'"
            limits.SECONDS.check(max(ends), where, "lasts")
            yield envelope


class _Parts:
    """Decoded content of a channel's bands; ``lost`` counts losses by reason. Pieces, ticks and
    curves are multiplied by ``gain``, waveforms are not."""

    def __init__(self, is_vibration: bool, gain: float) -> None:
        self.pieces: list[Piece] = []
        self.transients: list[Transient] = []
        self.curves: list[Curve] = []
        self.waveforms: list[Waveform] = []
        self.lost: Counter[str] = Counter()
        self._is_vibration, self._gain = is_vibration, gain

    def add(self, band: dict[str, Any], timescale: int, unfolding: "Unfolding") -> None:
        """Decode the effects of a band; a curve of a vibration is a waveform. Raises TooLargeError
        and InputError as :meth:`Unfolding.effects`."""
        placed = list(unfolding.effects(band["effects"], self.lost))
        if band["band_type"] == "Transient":
            for tick in chain.from_iterable(
                bands.ticks(band, effect, timescale) for effect in placed
            ):
                # A tick above 1 would be refused by writers: it is clipped and reported.
                level = self._gain * tick.amplitude
                if level > 1.0:
                    self.lost["are ticks louder than full scale: cut to it"] += 1
                self.transients.append(replace(tick, amplitude=min(level, 1.0)))
        elif band["band_type"] == "VectorialWave":
            for effect in placed:
                if effect[1].get("keyframes"):
                    self.pieces.append(bands.tone(band, effect, timescale, self._gain))
                    if (shape := effect[1].get("base_signal", "Sine")) != "Sine":
                        self.lost[f"are waves of the shape {shape}: as Sine"] += 1
        elif band["band_type"] == "WaveletWave":
            waveform, lost = wavelets.waveform(band, placed, timescale, unfolding.name)
            self.lost.update(lost)
            self.waveforms += [waveform] if waveform else []
        else:
            values = bands.curve(band, placed, timescale)
            if values is not None and self._is_vibration:
                self.waveforms.append(bands.curve_as_waveform(band, values, unfolding.name))
            elif values is not None:
                self.curves.append(Curve(values.times_s, self._gain * values.values))


def _envelope(
    perception: dict[str, Any],
    channel: dict[str, Any],
    timescale: int,
    full_scale: float | None,
    unfolding: "Unfolding",
) -> Envelope:
    """Mix the bands of a channel; curves are left out in a channel with waves or ticks.
    ``full_scale``: largest amplitude of the reference device, or None. Losses are in
    ``left_out``."""
    # Ids of effects are unique within a perception only.
    unfolding.library = {effect.get("id"): effect for effect in perception["effect_library"]}
    is_vibration = perception["perception_modality"] in VIBRATIONS
    # Gains and exponents of foreign files may have any size: clipped, so products stay finite.
    gain = min(channel["gain"], _LARGEST_GAIN)
    if is_vibration:  # other modalities state their unit with this exponent
        gain *= 10.0 ** min(max(perception.get("perception_unit_exponent", 0), -30), 6)
    parts = _Parts(is_vibration, gain)
    for band in channel["bands"]:
        parts.add(band, timescale, unfolding)
    name = channel["description"] or f"channel {channel['id']}"
    # Keyframes end with the last sound; this duration states the silence after the last keyframe.
    lasts_s = channel.get("sample_count", 0) / (channel.get("frequency_sampling") or math.inf)
    limits.SECONDS.check(lasts_s, unfolding.name, "its channels last")
    # Wavelet and curve bands of a vibration are one waveform: bands add sample by sample.
    if parts.waveforms:
        whole = added(parts.waveforms, unfolding.name).until(lasts_s)
        parts.pieces.append(piece_of(whole, gain))
    # Curves of other modalities have no frequency, so they cannot be mixed with waves.
    if parts.curves and (parts.pieces or parts.transients):
        parts.lost["are curves in a channel with waves or ticks"] += len(parts.curves)
    left_out = tuple(f"'{name}': {count} effects {why}" for why, count in parts.lost.items())
    envelope = partial(
        Envelope,
        modality=perception["perception_modality"],
        channel=name,
        body_part_mask=channel.get("body_part_mask", 0),
        vertices=tuple(channel.get("vertices", ())),
        full_scale=full_scale,
    )
    if parts.curves and not parts.pieces and not parts.transients:
        strength = bands.one_after_another(parts.curves)
        return envelope(strength=strength, frequency_hz=None, transients=(), left_out=left_out)
    signal = mixed(name, parts.pieces, parts.transients, lasts_s)
    return envelope(
        strength=signal.amplitude,
        frequency_hz=signal.frequency_hz,
        transients=signal.transients,
        left_out=left_out + signal.left_out,
    )


class Unfolding:
    """Resolver of references and compositions with a limit on the total number of effects.
    ``library`` maps effect ids of the current perception to effects."""

    def __init__(self, name: str) -> None:
        self.library: dict[int | None, dict[str, Any]] = {}
        self.name = name
        self._count = 0

    def effects(
        self, effects: Iterable[dict[str, Any]], lost: Counter[str], start: int = 0, depth: int = 0
    ) -> Iterator[bands.Placed]:
        """Yield (position in ticks, basis effect); missing references are counted in ``lost``.
        Positions add to ``start``; ``depth``: level of nesting. Raises InputError beyond eight
        levels, and TooLargeError beyond the file's limit of effects and keyframes."""
        # The limit also ends circular references, without a list of visited effects.
        if depth > _DEEPEST:
            raise InputError(
                f"{self.name}: effects refer to each other more than {_DEEPEST} levels deep."
            )
        for effect in effects:
            # Nested references multiply: a small file may unfold to billions of effects.
            self._count += 1 + len(effect.get("keyframes", ()))
            limits.UNFOLDED.check(self._count, self.name, "its references unfold to")
            # Positions within a composition count from its own position.
            position = start + effect.get("position", 0)
            # A reference plays the library's effect, which may be a composition again.
            if effect["effect_type"] == "Reference":
                target = self.library.get(effect.get("id"))
                if target is None:
                    lost["are references to none of the library"] += 1
                else:
                    yield from self.effects((target,), lost, position, depth + 1)
            elif effect["effect_type"] == "Composite":
                yield from self.effects(effect.get("composition", ()), lost, position, depth + 1)
            else:
                yield position, effect
