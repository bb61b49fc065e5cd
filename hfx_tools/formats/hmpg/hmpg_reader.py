# SPDX-License-Identifier: GPL-3.0-or-later
"""HMPG reader: a stream of units becomes a HJIF document."""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats.hjif import hjif_reader

from . import syntax
from .bits import BitReader, amplitude_of

_DEEPEST: Final = 8  # levels of compositions
_AXES: Final = ("X", "Y", "Z")
_UNFOLD: Final = "its packets hold"
_UNKNOWN_KEYWORDS: Final = "semantic keywords of no known number were not read"
_CODE: Final = re.compile(r"\[HJIF-([A-Z-]+)\]")  # of a finding, at the end of a sentence


def decode(content: bytes, name: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read a stream as a HJIF document, with sentences about unread parts and tolerated faults.
    Raises InputError for a damaged stream, and TooLargeError for too many effects and keyframes."""
    document, notes = document_of(content, name)
    # The same tolerance as for HJIF: dates in any form, numbers outside of their range.
    try:
        tolerated, faults = hjif_reader.decode(encoded(document), name)
    except InputError as error:
        if not _CODE.search(text := str(error)):
            raise
        raise InputError(with_own_codes([text])[0]) from None
    return tolerated, (*notes, *with_own_codes(faults))


def with_own_codes(sentences: Iterable[str]) -> tuple[str, ...]:
    """Sentences about a HJIF document with the codes of HMPG, which ``hfx validate`` names."""
    return tuple(_CODE.sub(r"[HMPG-\1]", sentence) for sentence in sentences)


def document_of(content: bytes, name: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read a stream as a HJIF document, valid or not, with sentences about unread parts.
    Raises as :func:`decode`."""
    stream = _Stream(name)
    at = 0
    while at < len(content):
        at = stream.unit(content, at)
    return stream.document(), stream.notes()


def choice(names: Sequence[str] | Mapping[int, str], number: int, place: str, field: str) -> str:
    """Name of a number; InputError for a number without a name."""
    known = dict(enumerate(names)) if isinstance(names, Sequence) else names
    if number not in known:
        raise InputError(f"{place} has {field} {number}, HMPG has {min(known)} to {max(known)}.")
    return known[number]


class _Stream:
    """State of a stream: metadata and effects so far, by the ids that packets refer to."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._lost: Counter[str] = Counter()
        self._count = 0  # effects and keyframes
        self._time = 0  # ticks
        self._is_back = False  # the current start is before the end of earlier units
        self._timescale = 0  # 0: not stated yet
        self._root: dict[str, Any] = {}
        self._syncs: list[dict[str, int]] = []
        self._avatars: dict[int, dict[str, Any]] = {}
        self._perceptions: dict[int, dict[str, Any]] = {}
        self._channels: dict[tuple[int, int], dict[str, Any]] = {}
        self._bands: dict[tuple[int, int, int], dict[str, Any]] = {}
        self._announced: dict[tuple[int, int, int], int] = {}  # effects of a band
        # Basis effects of a band by id: later units continue their keyframes.
        self._effects: dict[tuple[int, int, int, int], dict[str, Any]] = {}
        self._readers: Final = {
            syntax.TIMING: self._timing,
            syntax.INITIAL_TIMING: self._initial_timing,
            syntax.EXPERIENCE: self._experience,
            syntax.PERCEPTION: self._perception,
            syntax.CHANNEL: self._channel,
            syntax.BAND: self._band,
            syntax.LIBRARY: self._library,
            syntax.DATA: self._data,
        }

    def document(self) -> dict[str, Any]:
        """Document of all units; InputError without the packet of the experience."""
        if not self._root:
            raise InputError(f"{self._name}: holds no haptic experience (packet type 1).")
        return {
            **self._root,
            "timescale": self._timescale,
            "avatars": list(self._avatars.values()),
            "perceptions": list(self._perceptions.values()),
            "syncs": self._syncs,
        }

    def notes(self) -> tuple[str, ...]:
        """Sentence for each kind of content that was not read or is not there, with its count."""
        lost = self._lost.copy()
        for key, count in self._announced.items():
            modality = self._perceptions[key[0]]["perception_modality"]
            if modality not in syntax.OVER_SPACE:
                missing = count - len(self._bands[key]["effects"])
                lost["effects that bands announce are not in the stream"] += max(missing, 0)
        return tuple(f"{count} {what}" for what, count in lost.items() if count)

    def unit(self, content: bytes, at: int) -> int:
        """Read the unit at byte ``at``; returns its end. InputError for a damaged unit."""
        place = f"{self._name}: the unit at byte {at}"
        head = BitReader(content[at : at + syntax.UNIT_BYTES], place)
        kind = head.take(6)
        if kind > syntax.SILENT:
            raise InputError(f"{place} has the type {kind}, HMPG has 0 to {syntax.SILENT}.")
        if not at and kind != syntax.INITIALIZATION:
            raise InputError(f"{self._name}: does not begin with an initialization unit.")
        head.take(6)  # synchronization and layer
        duration, length = head.take(24), head.take(32)
        head.take(4)
        begin = at + syntax.UNIT_BYTES
        end = begin + length
        if end > len(content):
            raise InputError(f"{place} is cut off: {end - len(content)} bytes are missing.")
        while begin < end:
            begin = self._packet(content, begin, end)
        self._time += duration
        return end

    def _packet(self, content: bytes, at: int, end: int) -> int:
        """Read the packet at byte ``at`` of a unit that ends at ``end``; returns its own end."""
        place = f"{self._name}: the packet at byte {at}"
        head = BitReader(content[at : min(at + syntax.PACKET_BYTES, end)], place)
        kind, length = head.take(6), head.take(17)
        begin = at + syntax.PACKET_BYTES
        if begin + length > end:
            raise InputError(f"{place} is longer than its unit.")
        bits = BitReader(content[begin : begin + length], place)
        if kind in self._readers:
            self._readers[kind](bits)
            self._lost["texts are not UTF-8: other bytes became U+FFFD"] += bits.replaced_texts
        elif kind in syntax.CHECKSUMS:
            self._lost["checksums were not compared"] += 1
        else:
            self._lost[f"packets of the unknown type {kind} were passed over"] += 1
        return begin + length

    def _timing(self, bits: BitReader) -> None:
        self._time = bits.take(32)

    def _initial_timing(self, bits: BitReader) -> None:
        """Time and ticks a second. Durations that follow are for the planning of players."""
        time, timescale = bits.take(32), bits.take(32)
        self._is_back, self._time = time < self._time, time
        if not timescale:
            raise InputError(f"{bits.place} has 0 ticks a second, expected is 1 or more.")
        self._timescale = timescale
        self._syncs.append({"timestamp": self._time, "timescale": timescale})

    def _experience(self, bits: BitReader) -> None:
        version, profile = bits.text(), bits.text()
        level, date, description = bits.take(8), bits.text(), bits.text()
        self._root = {"version": version, "profile": profile, "level": level}
        self._root |= {"date": date, "description": description}
        bits.take(8)  # count of perceptions
        for _ in range(bits.take(8)):
            id, lod = bits.take(8), bits.take(8)
            kind = choice(syntax.AVATAR_TYPES, bits.take(8), bits.place, "the avatar type")
            avatar: dict[str, Any] = {"id": id, "lod": lod, "type": kind}
            if kind == "Custom":
                avatar["mesh"] = bits.text()
            self._avatars[id] = avatar

    def _perception(self, bits: BitReader) -> None:
        id, priority = bits.take(8), bits.take(8)
        members: dict[str, Any] = {"id": id, "description": bits.text()}
        number = bits.take(8)
        modality = choice(syntax.MODALITIES, number, bits.place, "the modality")
        members |= {"perception_modality": modality, "avatar_id": bits.take(8)}
        if priority:
            members["priority"] = priority
        bits.take(16)  # count of effects in the library
        if bits.take(1):
            members["effect_semantic_scheme"] = bits.text()
        members["unit_exponent"] = bits.signed(8)
        members["perception_unit_exponent"] = bits.signed(8)
        members["reference_devices"] = [self._device(bits) for _ in range(bits.take(8))]
        # A stream repeats its metadata where a player may join.
        known = self._perceptions.setdefault(id, {"effect_library": [], "channels": []})
        known |= members

    def _device(self, bits: BitReader) -> dict[str, Any]:
        """Reference device; the actuator type is dropped, as no source states its numbers."""
        device: dict[str, Any] = {"id": bits.take(8), "name": bits.text()}
        device["body_part_mask"] = bits.take(32)
        mask = [bits.take(1) for _ in range(len(syntax.DEVICE_NUMBERS) + 1)]
        for (key, (lowest, highest)), is_there in zip(
            syntax.DEVICE_NUMBERS.items(), mask, strict=False
        ):
            if is_there:
                device[key] = bits.number(32, lowest, highest)
        if mask[-1]:
            bits.take(4)
            self._lost["actuator types of reference devices were not read"] += 1
        return device

    def _channel(self, bits: BitReader) -> None:
        id, perception_id = bits.take(16), bits.take(8)
        perception = self._known_perception(perception_id, bits)
        channel: dict[str, Any] = {"id": id}
        if priority := bits.take(8):
            channel["priority"] = priority
        channel["description"] = bits.text()
        if (device := bits.take(8)) != syntax.NO_DEVICE:
            channel["reference_device_id"] = device
        channel["gain"] = bits.number(32, -syntax.MOST, syntax.MOST)
        channel["mixing_coefficient"] = bits.number(32, 0.0, syntax.MOST)
        fields = bits.take(8)
        if fields & 0b001:
            channel["body_part_mask"] = bits.take(32)
        elif fields & 0b010:
            channel["actuator_resolution"] = _vector(bits)
            channel["body_part_target"] = [
                choice(syntax.BODY_PARTS, bits.take(8), bits.place, "the body part")
                for _ in range(bits.take(8))
            ]
            channel["actuator_target"] = [_vector(bits) for _ in range(bits.take(8))]
        if sampling := bits.take(32):
            channel |= {"frequency_sampling": sampling, "sample_count": bits.take(32)}
        if fields & 0b100:
            channel["direction"] = _vector(bits)
        if count := bits.take(16):
            channel["vertices"] = [bits.take(32) for _ in range(count)]
        key = (perception_id, id)
        if key in self._channels:
            self._channels[key] |= channel
        else:
            self._channels[key] = channel | {"bands": []}
            perception["channels"].append(self._channels[key])

    def _band(self, bits: BitReader) -> None:
        id, perception_id, channel_id = bits.take(8), bits.take(8), bits.take(16)
        self._known_perception(perception_id, bits)
        channel = self._channels.get((perception_id, channel_id))
        if channel is None:
            raise InputError(f"{bits.place} is of the channel {channel_id}, which is not there.")
        priority = bits.take(8)
        kind = choice(syntax.BAND_TYPES, bits.take(3), bits.place, "the band type")
        band: dict[str, Any] = {"band_type": kind}
        if priority:
            band["priority"] = priority
        code = 0
        if kind == "Curve":
            number = bits.take(4)
            band["curve_type"] = choice(syntax.CURVE_TYPES, number, bits.place, "the curve type")
        elif kind == "WaveletWave":
            code = bits.take(8)
        band |= {"lower_frequency_limit": bits.take(16), "upper_frequency_limit": bits.take(16)}
        if kind == "WaveletWave":
            hertz = band["upper_frequency_limit"]
            band["block_length"] = syntax.block_ticks(code, hertz, self._timescale or 1000)
        key = (perception_id, channel_id, id)
        self._announced[key] = bits.take(16)
        if key in self._bands:
            self._bands[key] |= band
        else:
            self._bands[key] = band | {"effects": []}
            channel["bands"].append(self._bands[key])

    def _library(self, bits: BitReader) -> None:
        perception = self._known_perception(bits.take(8), bits)
        # Repeated metadata replaces effects of the same id.
        library = {effect["id"]: effect for effect in perception["effect_library"]}
        for _ in range(bits.take(16)):
            unknown = self._lost[_UNKNOWN_KEYWORDS]
            effect = self._library_effect(bits, 0)
            if effect["id"] in library:  # counted before
                self._lost[_UNKNOWN_KEYWORDS] = unknown
            library[effect["id"]] = effect
        perception["effect_library"] = list(library.values())

    def _library_effect(self, bits: BitReader, depth: int) -> dict[str, Any]:
        if depth > _DEEPEST:
            raise InputError(f"{bits.place} has compositions of more than {_DEEPEST} levels.")
        effect = self._new_effect(bits)
        effect |= self._keyword(bits) | {"position": bits.take(25)}
        if effect["effect_type"] == "Basis":
            effect |= _wave(bits)
        frames = []
        for _ in range(bits.take(16)):
            self._counted(bits)
            mask = bits.take(3)
            frame: dict[str, Any] = {}
            if mask & 0b001:
                frame["relative_position"] = bits.take(16)
            if mask & 0b010:
                frame["amplitude_modulation"] = amplitude_of(bits.take(8))
            if mask & 0b100:
                frame["frequency_modulation"] = bits.take(16)
            frames.append(frame)
        if frames or effect["effect_type"] == "Basis":
            effect["keyframes"] = frames
        parts = [self._library_effect(bits, depth + 1) for _ in range(bits.take(16))]
        if parts:
            effect["composition"] = parts
        return effect

    def _data(self, bits: BitReader) -> None:
        """Read a packet of a band's effects in the current unit of time."""
        bits.take(1)  # whether all effects begin here
        key = (bits.take(8), bits.take(16), bits.take(8))
        perception = self._known_perception(key[0], bits)
        band = self._bands.get(key)
        if band is None:
            raise InputError(f"{bits.place} is of the band {key[2]}, which is not there.")
        if perception["perception_modality"] in syntax.OVER_SPACE:
            modality = perception["perception_modality"]
            self._lost[f"packets of effects over space ({modality}) were not read"] += 1
            return
        # In a stream that is there twice, the second copy continues the effects of the first.
        self._lost["packets are of a time that was over: effects may be there twice"] += (
            self._is_back
        )
        count = bits.take(16)
        if band["band_type"] == "WaveletWave":
            if count:
                self._wavelet(bits, band)
            return
        for _ in range(count):
            effect = self._new_effect(bits)
            effect["position"] = self._time + bits.signed(25)
            if effect["effect_type"] != "Basis":
                band["effects"].append(effect)
                continue
            # Ids of basis effects only join their parts in consecutive units.
            known = self._effects.setdefault((*key, effect.pop("id")), effect)
            effect |= self._keyword(bits, is_counted=known is effect)
            frames = bits.take(16)
            if band["band_type"] == "VectorialWave":
                effect |= _wave(bits)
            elif band["band_type"] == "Transient":
                effect["base_signal"] = "Sine"  # not stored
            if known is effect:
                effect["keyframes"] = []
                band["effects"].append(effect)
            known["keyframes"] += [self._frame(bits, band["band_type"]) for _ in range(frames)]

    def _wavelet(self, bits: BitReader, band: dict[str, Any]) -> None:
        """Read a wavelet block, which follows the previous block of its band without a gap."""
        self._new_effect(bits)
        keyword = self._keyword(bits)
        stream = bytes(bits.take(8) for _ in range(bits.take(16)))
        band["effects"].append(
            {
                "effect_type": "Basis",
                "position": len(band["effects"]) * band["block_length"],
                **keyword,
                "wavelet_stream": base64.b64encode(stream).decode().rstrip("="),
            }
        )

    def _frame(self, bits: BitReader, kind: str) -> dict[str, Any]:
        """Keyframe of a band of a type."""
        self._counted(bits)
        mask = bits.take(2) if kind == "VectorialWave" else 0b01 if kind == "Curve" else 0b11
        frame: dict[str, Any] = {}
        if mask & 0b01:
            frame["amplitude_modulation"] = amplitude_of(bits.take(8))
        frame["relative_position"] = bits.take(16)
        if mask & 0b10:
            frame["frequency_modulation"] = bits.take(16)
        return frame

    def _new_effect(self, bits: BitReader) -> dict[str, Any]:
        """Id and type of an effect."""
        self._counted(bits)
        id = bits.take(16)
        kind = choice(syntax.EFFECT_TYPES, bits.take(2), bits.place, "the effect type")
        return {"id": id, "effect_type": kind}

    def _keyword(self, bits: BitReader, *, is_counted: bool = True) -> dict[str, str]:
        """Semantic keyword, if there is one of the standard's list; else counted as lost."""
        if not bits.take(1):
            return {}
        word = syntax.KEYWORDS.get(bits.take(12))
        if word is None:
            self._lost[_UNKNOWN_KEYWORDS] += is_counted
            return {}
        return {"semantic_keywords": word}

    def _counted(self, bits: BitReader) -> None:
        """Count an effect or keyframe against the limit."""
        self._count += 1
        limits.UNFOLDED.check(self._count, self._name, _UNFOLD)

    def _known_perception(self, id: int, bits: BitReader) -> dict[str, Any]:
        if id not in self._perceptions:
            raise InputError(f"{bits.place} is of the perception {id}, which is not there.")
        return self._perceptions[id]


def _vector(bits: BitReader) -> dict[str, int]:
    return {axis: bits.signed(8) for axis in _AXES}


def _wave(bits: BitReader) -> dict[str, Any]:
    """Phase and shape of a wave."""
    phase = bits.number(16, 0.0, syntax.FULL_TURN)
    shape = choice(syntax.BASE_SIGNALS, bits.take(4), bits.place, "the base signal")
    return {"phase": phase, "base_signal": shape}
