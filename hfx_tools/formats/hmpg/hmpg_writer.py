# SPDX-License-Identifier: GPL-3.0-or-later
"""HMPG writer: a HJIF document becomes a stream of units."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.formats.hjif.to_signals import Unfolding

from . import syntax
from .bits import DECIMALS, LONGEST_TEXT, BitWriter, amplitude_code

UNIT_S: Final = 0.128
"""Duration of a unit of effects, that of MPEG's encoder."""

MOST_BANDS: Final = 256  # with numbers that are unique in the file
_LONGEST_DURATION: Final = (1 << 24) - 1  # ticks
_AXES: Final = ("X", "Y", "Z")
_STEPS: Final = (
    "HMPG holds amplitudes in 8 bits (within 0.6 % of full scale; 0 stays 0), frequencies in whole "
    f"hertz, phases within 0.00005 rad, gains and numbers of devices within {10.0**-DECIMALS:f}"
)


@dataclass(frozen=True)
class Encoded:
    """Bytes of a HMPG file, with sentences about left out content and about the encoding."""

    content: bytes
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


def encoded(document: Mapping[str, Any], name: str) -> Encoded:
    """Encode a document of the standard's form, as :func:`hjif_reader.decode` returns.

    Metadata first, then a unit for each 128 ms with effects, and silent units between. Raises
    InputError, with ``name`` of the file, for content that HMPG cannot hold: other modalities, ids
    and positions beyond their fields, packets above 131,071 bytes; TooLargeError for wavelets that
    begin too late.
    """
    writer = _Writer(document, name)
    content = writer.content()
    lost = tuple(f"{count} {what}" for what, count in writer.lost.items())
    return Encoded(content, lost, (_STEPS, *writer.notes))


@dataclass(eq=False)
class _Part:
    """Keyframes of an effect within a unit."""

    effect: Mapping[str, Any]
    id: int
    position: int  # ticks, from the start of the file
    frames: list[Mapping[str, Any]] = field(default_factory=list)
    is_start: bool = True


@dataclass(eq=False)
class _Band:
    """Band with the numbers that packets refer to, and the place for messages."""

    members: Mapping[str, Any]
    number: int
    perception: Mapping[str, Any]
    channel: Mapping[str, Any]
    place: str


class _Writer:
    """Writer of a document; ``lost`` counts what HMPG has no field for."""

    def __init__(self, document: Mapping[str, Any], name: str) -> None:
        self._document, self._name = document, name
        self.lost: Counter[str] = Counter()
        self.notes: list[str] = []
        self._timescale = document.get("timescale", 1000)
        self._unit = max(1, round(UNIT_S * self._timescale))
        self._perceptions = [
            (k, perception)
            for k, perception in enumerate(document["perceptions"])
            if not self._is_over_space(perception)
        ]
        if not self._perceptions:
            raise InputError(f"{name}: has no perception over time, which HMPG is written of here.")
        self._bands = self._numbered_bands()
        ids = [channel["id"] for _, each in self._perceptions for channel in each["channels"]]
        if len(set(ids)) < len(ids):
            self.notes.append(
                "channels of several perceptions have the same id, which readers that ignore the "
                "perception, as MPEG's reference software, confuse"
            )

    def content(self) -> bytes:
        """Bytes of all units."""
        syncs = self._document.get("syncs", ())
        if later := sum(sync["timestamp"] > 0 for sync in syncs):
            self.lost["synchronization points after the start"] += later
        heads = [self._initial_timing(), self._experience()]
        for k, perception in self._perceptions:
            heads.append(self._perception(perception, f"perceptions[{k}]"))
        for k, perception in self._perceptions:
            heads += self._library(perception, f"perceptions[{k}]")
        for k, perception in self._perceptions:
            for c, channel in enumerate(perception["channels"]):
                place = f"perceptions[{k}].channels[{c}]"
                heads.append(self._channel(channel, perception, place))
        heads += [self._band(band) for band in self._bands]
        self._count_lost_keywords()
        return self._unit_of(syntax.INITIALIZATION, 0, heads) + b"".join(self._units())

    # --- metadata ---------------------------------------------------------------------------

    def _is_over_space(self, perception: Mapping[str, Any]) -> bool:
        modality = perception["perception_modality"]
        if modality in syntax.OVER_SPACE:
            self.lost[f"perceptions over space ({modality})"] += 1
        return modality in syntax.OVER_SPACE

    def _numbered_bands(self) -> list[_Band]:
        """All bands, numbered over the file as far as the field allows, else within channels."""
        bands = [
            _Band(band, b, perception, channel, f"perceptions[{k}].channels[{c}].bands[{b}]")
            for k, perception in self._perceptions
            for c, channel in enumerate(perception["channels"])
            for b, band in enumerate(channel["bands"])
        ]
        if len(bands) <= MOST_BANDS:
            for number, band in enumerate(bands):
                band.number = number
        else:
            self.notes.append(
                f"its {len(bands)} bands are numbered within each channel, as the field holds "
                f"{MOST_BANDS} numbers; MPEG's reference software needs unique numbers"
            )
        return bands

    def _initial_timing(self) -> bytes:
        bits = BitWriter(self._name)
        bits.put(32, 0, "")  # time of the first unit
        bits.put(32, self._timescale, "timescale")
        bits.put(24, self._unit, "timescale")
        bits.put(24, 0, "")  # largest deviation of durations
        bits.put(1, 0, "")  # units do not overlap
        return self._packet(syntax.INITIAL_TIMING, bits, "the timing")

    def _experience(self) -> bytes:
        document = self._document
        bits = BitWriter(self._name)
        self._text(bits, document, "version", "")
        self._text(bits, document, "profile", "")
        bits.put(8, document["level"], "level")
        self._text(bits, document, "date", "")
        self._text(bits, document, "description", "")
        bits.put(8, len(self._perceptions), "the count of perceptions")
        bits.put(8, len(document["avatars"]), "the count of avatars")
        for k, avatar in enumerate(document["avatars"]):
            bits.put(8, avatar["id"], f"avatars[{k}].id")
            bits.put(8, avatar["lod"], f"avatars[{k}].lod")
            bits.put(8, syntax.AVATAR_TYPES.index(avatar["type"]), "type")
            if avatar["type"] == "Custom":  # a shortened address would name another file
                bits.put_text(avatar.get("mesh", ""), f"avatars[{k}].mesh")
        return self._packet(syntax.EXPERIENCE, bits, "the document")

    def _perception(self, perception: Mapping[str, Any], place: str) -> bytes:
        modality = perception["perception_modality"]
        if modality not in syntax.MODALITIES:
            allowed = ", ".join(syntax.MODALITIES)
            where = f"{self._name}: {place}.perception_modality"
            raise InputError(f"{where} is {modality}, HMPG holds {allowed}.")
        bits = BitWriter(self._name)
        bits.put(8, perception["id"], f"{place}.id")
        bits.put(8, perception.get("priority", 0), f"{place}.priority")
        self._text(bits, perception, "description", place)
        bits.put(8, syntax.MODALITIES.index(modality), "")
        bits.put(8, perception["avatar_id"], f"{place}.avatar_id")
        bits.put(16, len(perception["effect_library"]), f"the size of {place}.effect_library")
        keys = ("effect_semantic_scheme", "semantic_scheme")
        scheme = next((key for key in keys if key in perception), None)
        bits.put(1, int(scheme is not None), "")
        if scheme is not None:
            bits.put_text(perception[scheme], f"{place}.{scheme}")
        for key, default in (("unit_exponent", -3), ("perception_unit_exponent", 0)):
            bits.put_signed(8, perception.get(key, default), f"{place}.{key}")
        devices = perception.get("reference_devices", ())
        bits.put(8, len(devices), f"the count of {place}.reference_devices")
        for k, device in enumerate(devices):
            self._device(bits, device, f"{place}.reference_devices[{k}]")
        bits.put(16, len(perception["channels"]), f"the count of {place}.channels")
        return self._packet(syntax.PERCEPTION, bits, place)

    def _device(self, bits: BitWriter, device: Mapping[str, Any], place: str) -> None:
        if device["id"] == syntax.NO_DEVICE:
            raise InputError(f"{self._name}: {place}.id is 255, which states no device in HMPG.")
        bits.put(8, device["id"], f"{place}.id")
        self._text(bits, device, "name", place)
        bits.put(32, device.get("body_part_mask", 0), f"{place}.body_part_mask")
        held = [key for key in syntax.DEVICE_NUMBERS if key in device]
        for key in syntax.DEVICE_NUMBERS:
            bits.put(1, int(key in held), "")
        bits.put(1, 0, "")
        if "type" in device:
            self.lost["actuator types of reference devices"] += 1
        for key in held:
            bits.put_number(32, device[key], *syntax.DEVICE_NUMBERS[key], f"{place}.{key}")

    def _channel(
        self, channel: Mapping[str, Any], perception: Mapping[str, Any], place: str
    ) -> bytes:
        bits = BitWriter(self._name)
        bits.put(16, channel["id"], f"{place}.id")
        bits.put(8, perception["id"], "")
        bits.put(8, channel.get("priority", 0), f"{place}.priority")
        self._text(bits, channel, "description", place)
        device = channel.get("reference_device_id", syntax.NO_DEVICE)
        bits.put(8, device, f"{place}.reference_device_id")
        bits.put_number(32, channel["gain"], -syntax.MOST, syntax.MOST, f"{place}.gain")
        mixing = channel["mixing_coefficient"]
        bits.put_number(32, mixing, 0.0, syntax.MOST, f"{place}.mixing_coefficient")
        self._place(bits, channel, place)
        sampling = channel.get("frequency_sampling", 0)
        bits.put(32, sampling, f"{place}.frequency_sampling")
        if sampling:
            bits.put(32, channel.get("sample_count", 0), f"{place}.sample_count")
        if "direction" in channel:
            self._vector(bits, channel["direction"], f"{place}.direction")
        vertices = channel.get("vertices", ())
        bits.put(16, len(vertices), f"the count of {place}.vertices")
        for vertex in vertices:
            bits.put(32, vertex, f"{place}.vertices")
        bits.put(8, len(channel["bands"]), f"the count of {place}.bands")
        return self._packet(syntax.CHANNEL, bits, f"{place} ({len(vertices)} vertices)")

    def _place(self, bits: BitWriter, channel: Mapping[str, Any], place: str) -> None:
        """Write the body part mask, or actuators with their resolution: HMPG holds one of both."""
        resolution = channel.get("actuator_resolution")
        has_direction = 0b100 if "direction" in channel else 0
        bits.put(8, has_direction | (0b010 if resolution is not None else 0b001), "")
        targets = channel.get("body_part_target", ())
        if resolution is None:
            bits.put(32, channel.get("body_part_mask", 0), f"{place}.body_part_mask")
            for key in ("body_part_target", "actuator_target"):
                self.lost[f"entries of {key} without actuator_resolution"] += len(
                    channel.get(key, ())
                )
            self.lost += Counter()  # drops counts of 0
            return
        if channel.get("body_part_mask"):
            self.lost["body part masks beside actuator_resolution"] += 1
        self._vector(bits, resolution, f"{place}.actuator_resolution")
        numbers = {name: number for number, name in syntax.BODY_PARTS.items()}
        bits.put(8, len(targets), f"the count of {place}.body_part_target")
        for target in targets:
            bits.put(8, numbers[target], "")
        actuators = channel.get("actuator_target", ())
        bits.put(8, len(actuators), f"the count of {place}.actuator_target")
        for actuator in actuators:
            self._vector(bits, actuator, f"{place}.actuator_target")

    def _band(self, band: _Band) -> bytes:
        members, place = band.members, band.place
        bits = BitWriter(self._name)
        bits.put(8, band.number, f"the number of {place}")
        bits.put(8, band.perception["id"], "")
        bits.put(16, band.channel["id"], "")
        bits.put(8, members.get("priority", 0), f"{place}.priority")
        kind = members["band_type"]
        bits.put(3, syntax.BAND_TYPES.index(kind), "")
        low, high = (round(members[f"{end}_frequency_limit"]) for end in ("lower", "upper"))
        if kind == "Curve":
            bits.put(4, syntax.CURVE_TYPES.index(members.get("curve_type", "Unknown")), "")
        elif kind == "WaveletWave":
            length = members.get("block_length", 0)
            code = syntax.block_code(length, high, self._timescale)
            if not length or syntax.block_ticks(code, high, self._timescale) != length:
                raise InputError(
                    f"{self._name}: {place}.block_length is {length}, HMPG holds 16 to 255 ticks "
                    "and powers of two of samples."
                )
            bits.put(8, code, "")
        bits.put(16, low, f"{place}.lower_frequency_limit")
        bits.put(16, high, f"{place}.upper_frequency_limit")
        bits.put(16, len(members["effects"]), f"the count of {place}.effects")
        return self._packet(syntax.BAND, bits, place)

    def _library(self, perception: Mapping[str, Any], place: str) -> Iterator[bytes]:
        """Yield a packet for each effect of the library: a packet's length is limited."""
        for k, effect in enumerate(perception["effect_library"]):
            here = f"{place}.effect_library[{k}]"
            bits = BitWriter(self._name)
            bits.put(8, perception["id"], "")
            bits.put(16, 1, "")
            self._library_effect(bits, effect, here)
            yield self._packet(syntax.LIBRARY, bits, here)

    def _library_effect(self, bits: BitWriter, effect: Mapping[str, Any], place: str) -> None:
        self._effect_head(bits, effect, effect.get("id", 0), place)
        self._keyword(bits, effect)
        bits.put(25, effect.get("position", 0), f"{place}.position")
        if effect["effect_type"] == "Basis":
            self._wave(bits, effect, place)
        if "wavelet_stream" in effect:
            self.lost[
                "wavelets of effect libraries, but where bands of wavelets refer to them"
            ] += 1
        frames = effect.get("keyframes", ())
        bits.put(16, len(frames), f"the count of {place}.keyframes")
        for k, frame in enumerate(frames):
            keys = ("relative_position", "amplitude_modulation", "frequency_modulation")
            mask = sum(1 << bit for bit, key in enumerate(keys) if key in frame)
            bits.put(3, mask, "")
            here = f"{place}.keyframes[{k}]"
            if mask & 0b001:
                bits.put(16, frame["relative_position"], f"{here}.relative_position")
            if mask & 0b010:
                bits.put(8, amplitude_code(frame["amplitude_modulation"]), "")
            if mask & 0b100:
                bits.put(16, round(frame["frequency_modulation"]), f"{here}.frequency_modulation")
        parts = effect.get("composition", ())
        bits.put(16, len(parts), f"the count of {place}.composition")
        for k, part in enumerate(parts):
            self._library_effect(bits, part, f"{place}.composition[{k}]")

    # --- effects ----------------------------------------------------------------------------

    def _units(self) -> Iterator[bytes]:
        """Yield units with effects in time order, and silent units between them."""
        packets: dict[int, list[bytes]] = {}
        late: set[int] = set()  # units with an effect that began earlier
        for band in self._bands:
            if band.members["band_type"] == "WaveletWave":
                for unit, packet in self._wavelets(band):
                    packets.setdefault(unit, []).append(packet)
                continue
            for unit, parts in sorted(self._parts(band).items()):
                if not all(part.is_start for part in parts):
                    late.add(unit)
                packets.setdefault(unit, []).append(self._data(band, unit, parts))
        after = 0
        for unit in sorted(packets):
            yield from self._silence((unit - after) * self._unit, is_late=unit in late)
            is_late = unit in late
            yield self._unit_of(syntax.TEMPORAL, self._unit, packets[unit], is_late=is_late)
            after = unit + 1

    def _silence(self, ticks: int, *, is_late: bool) -> Iterator[bytes]:
        """Yield silent units of whole units' length; none for 0 ticks."""
        longest = _LONGEST_DURATION // self._unit * self._unit
        limits.UNFOLDED.check(ticks / longest, self._name, "its silence would be")
        while ticks > 0:
            length = min(ticks, longest)
            yield self._unit_of(syntax.SILENT, length, (), is_late=is_late)
            ticks -= length

    def _parts(self, band: _Band) -> dict[int, list[_Part]]:
        """Effects of a band by unit; keyframes of a long effect are in several units."""
        # Readers join keyframes of equal ids, so a basis effect has no id of the library.
        library = band.perception["effect_library"]
        next_id = 1 + max((effect.get("id", 0) for effect in library), default=-1)
        units: dict[int, list[_Part]] = {}
        kind = band.members["band_type"]
        for position, effect in self._flat(band.members["effects"], 0, band.place):
            if effect["effect_type"] == "Reference":
                id = effect.get("id", 0)
                units.setdefault(position // self._unit, []).append(_Part(effect, id, position))
                continue
            frames = [frame for frame in effect.get("keyframes", ()) if _is_held(frame, kind)]
            dropped = len(effect.get("keyframes", ())) - len(frames)
            if dropped:
                self.lost["keyframes of curves without amplitude"] += dropped
            frames.sort(key=lambda frame: int(frame.get("relative_position", 0)))
            parts: dict[int, _Part] = {}
            for frame in frames:
                unit = (position + frame.get("relative_position", 0)) // self._unit
                if unit not in parts:
                    parts[unit] = _Part(effect, next_id, position, is_start=not parts)
                    units.setdefault(unit, []).append(parts[unit])
                parts[unit].frames.append(frame)
            if not frames:
                part = _Part(effect, next_id, position)
                units.setdefault(position // self._unit, []).append(part)
            next_id += 1
        return units

    def _flat(
        self, effects: Iterable[Mapping[str, Any]], start: int, place: str, depth: int = 0
    ) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Yield positions with effects and references; compositions are unfolded, as bands of HMPG
        have none."""
        if depth > 8:
            raise InputError(f"{self._name}: {place} has compositions of more than 8 levels.")
        for effect in effects:
            position = start + effect.get("position", 0)
            if effect["effect_type"] == "Composite":
                parts = effect.get("composition", ())
                yield from self._flat(parts, position, place, depth + 1)
            else:
                yield position, effect

    def _data(self, band: _Band, unit: int, parts: Sequence[_Part]) -> bytes:
        bits = self._data_head(band, len(parts), is_late=not all(part.is_start for part in parts))
        kind, place = band.members["band_type"], f"an effect of {band.place}"
        for part in parts:
            self._effect_head(bits, part.effect, part.id, place)
            bits.put_signed(25, part.position - unit * self._unit, f"{place}.position")
            if part.effect["effect_type"] == "Reference":
                continue
            self._keyword(bits, part.effect)
            bits.put(16, len(part.frames), f"the count of keyframes of {place}")
            if kind == "VectorialWave":
                self._wave(bits, part.effect, place)
            for frame in part.frames:
                self._frame(bits, frame, band, place)
        return self._packet(syntax.DATA, bits, f"{band.place}, 128 ms of its effects,")

    def _frame(self, bits: BitWriter, frame: Mapping[str, Any], band: _Band, place: str) -> None:
        members = band.members
        amplitude, hertz = frame.get("amplitude_modulation"), frame.get("frequency_modulation")
        if members["band_type"] == "VectorialWave":
            bits.put(2, 2 * (hertz is not None) + (amplitude is not None), "")
        elif members["band_type"] == "Transient":
            # Both are needed; where HJIF leaves them out, these are the values of its readers.
            amplitude = 1.0 if amplitude is None else amplitude
            middle = (members["lower_frequency_limit"] + members["upper_frequency_limit"]) / 2.0
            hertz = middle if hertz is None else hertz
        else:
            hertz = None
        if amplitude is not None:
            bits.put(8, amplitude_code(amplitude), "")
        bits.put(16, frame.get("relative_position", 0), f"{place}: relative_position")
        if hertz is not None:
            bits.put(16, round(hertz), f"{place}: frequency_modulation")

    def _wavelets(self, band: _Band) -> Iterator[tuple[int, bytes]]:
        """Yield units and packets of wavelet blocks, one after another. Gaps become empty blocks:
        blocks of HMPG have no position."""
        unfolding = Unfolding(self._name)
        library = band.perception["effect_library"]
        unfolding.library = {effect.get("id"): dict(effect) for effect in library}
        missing: Counter[str] = Counter()
        placed = list(unfolding.effects(band.members["effects"], missing))
        self.lost.update({f"effects of wavelet bands that {why}": n for why, n in missing.items()})
        length = band.members.get("block_length", 0)
        blocks: list[Mapping[str, Any]] = []
        for position, effect in sorted(placed, key=lambda each: each[0]):
            gap = round(position / length) - len(blocks)
            limits.UNFOLDED.check(len(blocks) + gap, self._name, "its wavelet blocks are")
            blocks += [{"effect_type": "Basis"}] * gap
            blocks.append(effect)
        for number, block in enumerate(blocks):
            bits = self._data_head(band, 1, is_late=False)
            place = f"block {number} of {band.place}"
            self._effect_head(bits, block, number % (1 << 16), place)
            self._keyword(bits, block)
            stream = _bytes_of(block.get("wavelet_stream", ""))
            if stream is None:
                self.lost["wavelet blocks with a fault, which are silent"] += 1
                stream = b""
            bits.put(16, len(stream), f"the size of {place}")
            for byte in stream:
                bits.put(8, byte, "")
            yield number * length // self._unit, self._packet(syntax.DATA, bits, place)

    def _data_head(self, band: _Band, count: int, *, is_late: bool) -> BitWriter:
        bits = BitWriter(self._name)
        bits.put(1, int(is_late), "")
        bits.put(8, band.perception["id"], "")
        bits.put(16, band.channel["id"], "")
        bits.put(8, band.number, "")
        bits.put(16, count, f"the count of effects of {band.place} within 128 ms")
        return bits

    def _effect_head(self, bits: BitWriter, effect: Mapping[str, Any], id: int, place: str) -> None:
        bits.put(16, id, f"{place}.id")
        bits.put(2, syntax.EFFECT_TYPES.index(effect["effect_type"]), "")

    def _count_lost_keywords(self) -> None:
        """Count each lost keyword of the document once; effects of bands may be written in several
        parts, and effects of the library several times."""
        for _, perception in self._perceptions:
            bands = [band for channel in perception["channels"] for band in channel["bands"]]
            for effect in _nested(perception["effect_library"]):
                self._count_keyword(effect, is_of_band=False)
            for effect in _nested(effect for band in bands for effect in band["effects"]):
                self._count_keyword(effect, is_of_band=True)

    def _count_keyword(self, effect: Mapping[str, Any], *, is_of_band: bool) -> None:
        """Count the keyword of an effect if HMPG has no field or no number for the keyword."""
        word = effect.get("semantic_keywords")
        if word is None:
            return
        if is_of_band and effect["effect_type"] != "Basis":
            kind = "references" if effect["effect_type"] == "Reference" else "compositions"
            self.lost[f"semantic keywords of {kind}"] += 1
        elif word not in syntax.KEYWORD_NUMBERS:
            self.lost["semantic keywords outside of the standard's list"] += 1

    def _keyword(self, bits: BitWriter, effect: Mapping[str, Any]) -> None:
        number = syntax.KEYWORD_NUMBERS.get(effect.get("semantic_keywords", ""))
        bits.put(1, int(number is not None), "")
        if number is not None:
            bits.put(12, number, "")

    def _wave(self, bits: BitWriter, effect: Mapping[str, Any], place: str) -> None:
        phase = min(effect.get("phase", 0.0), syntax.FULL_TURN)
        bits.put_number(16, phase, 0.0, syntax.FULL_TURN, f"{place}.phase")
        bits.put(4, syntax.BASE_SIGNALS.index(effect.get("base_signal", "Sine")), "")

    # --- fields -----------------------------------------------------------------------------

    def _text(self, bits: BitWriter, members: Mapping[str, Any], key: str, place: str) -> None:
        """Write a member of a document as a text of at most 255 bytes, and count a cut text."""
        text = members[key]
        content = text.encode("utf-8", "replace")
        if len(content) > LONGEST_TEXT:
            text = content[:LONGEST_TEXT].decode("utf-8", "ignore")
            self.lost[f"ends of texts longer than {LONGEST_TEXT} bytes ({key})"] += 1
        bits.put_text(text, f"{place}.{key}")

    def _vector(self, bits: BitWriter, vector: Mapping[str, int], place: str) -> None:
        for axis in _AXES:
            bits.put_signed(8, vector[axis], f"{place}.{axis}")

    def _packet(self, kind: int, bits: BitWriter, what: str) -> bytes:
        payload = bits.content()
        if len(payload) > syntax.LONGEST_PACKET:
            raise InputError(
                f"{self._name}: {what} takes {len(payload)} bytes, a packet of HMPG holds "
                f"{syntax.LONGEST_PACKET}."
            )
        head = BitWriter(self._name)
        head.put(6, kind, "")
        head.put(17, len(payload), "")
        return head.content() + payload

    def _unit_of(
        self, kind: int, duration: int, packets: Iterable[bytes], *, is_late: bool = False
    ) -> bytes:
        payload = b"".join(packets)
        head = BitWriter(self._name)
        head.put(6, kind, "")
        head.put(2, int(is_late), "")  # 0: a player may join here
        head.put(4, 0, "")  # layer
        head.put(24, duration, "the duration of a unit")
        head.put(32, len(payload), "the length of a unit")
        head.put(4, 0, "")
        return head.content() + payload


def _nested(effects: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Yield effects and the parts of their compositions, at any depth."""
    waiting = list(effects)
    while waiting:
        effect = waiting.pop()
        yield effect
        waiting += effect.get("composition", ())


def _is_held(frame: Mapping[str, Any], kind: str) -> bool:
    return kind != "Curve" or "amplitude_modulation" in frame


def _bytes_of(stream: str) -> bytes | None:
    """Bytes of base64 digits of any number, filled up with 0 bits; None for other characters."""
    digits = stream.rstrip("=")
    try:
        content = base64.b64decode(digits + "A" * (-len(digits) % 4), validate=True)
    except ValueError:
        return None
    whole = 6 * len(digits) // 8
    return content[:whole] + content[whole : whole + 1].strip(b"\0")
