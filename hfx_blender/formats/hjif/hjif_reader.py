# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF reader for own and foreign files.

Documents of other tools, and of drafts before the standard, are converted to the standard's form.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

from ...files.findings import Report, ToleratedFaults, refuse_errors, refuse_untolerated
from ...files.json_shapes import Items, Number, Record, Shape, Text, check, known_members
from ...files.strict_json import parse
from .hjif_rules import DOCUMENT, findings

_STRUCTURAL = {f"HJIF-{word}" for word in ("MISSING", "TYPE", "RANGE", "CHOICE", "COUNT")}
_STRUCTURAL |= {"HJIF-MODALITY", "HJIF-VERSION"}
_FATAL = _STRUCTURAL - {"HJIF-RANGE"}  # amplitudes of early wavelets


def decode(content: bytes, name: str) -> tuple[dict[str, Any], ToleratedFaults]:
    """Parse a document; second, sentences about tolerated faults. Files of other tools and drafts
    are converted to the standard's form as far as clear in meaning; unknown members are dropped.
    Raises InputError for unreadable files."""
    document = parse(content, name)
    faults = findings(document)
    silent = _negative_gains(document)
    # Valid files are read as they are; only faulty ones are brought to the standard's form.
    if any(fault.code in _STRUCTURAL and fault.severity == "error" for fault in faults):
        document = in_standard_form(DOCUMENT, document)
        report = Report("HJIF")
        check(DOCUMENT, document, report)
        refuse_errors([finding for finding in report.findings if finding.code in _FATAL], name)
    notes = refuse_untolerated(faults, name, lambda each: True)
    if silent:
        notes = (f"gains below 0, read as 0, so that their channels are silent: {silent}", *notes)
    return known_members(DOCUMENT, document), notes


def _negative_gains(value: Any) -> int:
    """Number of members ``gain`` below 0 in a document, at any depth."""
    count, waiting = 0, [value]
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict):
            gain = item.get("gain")
            count += isinstance(gain, int | float) and gain < 0
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item
    return count


_OLD_NAMES: Final = {
    "mixing_weight": "mixing_coefficient",
    "tracks": "channels",
    "window_length": "block_length",
    "bitstream": "wavelet_stream",
    "semantic": "semantic_keywords",
    "signals": "bands",
}
_OLD_VALUES: Final = {
    "perception_modality": {"Vibration": "Vibrotactile", "Texture": "Vibrotactile Texture"},
    "band_type": {"Vectorial": "VectorialWave", "Wavelet": "WaveletWave"},
}
_ENCODINGS: Final = {
    "Vectorial": "VectorialWave",
    "Quantized": "WaveletWave",
    "Wavelet": "WaveletWave",
}
_DEFAULTS: Final[Mapping[str, Any]] = {
    "version": "2023",
    "profile": "Main",
    "level": 1,
    "date": "",
    "description": "",
    "name": "",
    "avatars": [],
    "avatar_id": 0,
    "effect_library": [],
    "gain": 1.0,
    "mixing_coefficient": 1.0,
    "lower_frequency_limit": 0,
    "upper_frequency_limit": 1000,
    "effects": [],
    "effect_type": "Basis",
    "curve_type": "Unknown",
    "base_signal": "Sine",
    "type": "Custom",
    "lod": 0,
}
"""Values of missing or unknown members that do not change the haptic content."""

_LARGEST_SCALE: Final = 16.0
_HIGHEST_RATE: Final = 192_000  # upper limit of wavelet bands, their sampling rate


def in_standard_form(shape: Shape, value: Any, name: str = "") -> Any:
    """Convert a value to the standard's form as far as the meaning is clear.

    Old names and choices are replaced, unknown members dropped, missing members without haptic
    effect added, and numbers clipped to the allowed range. Everything else is returned unchanged.
    ``name`` is the member's name.
    """
    if isinstance(shape, Record):
        return _record(shape, value) if isinstance(value, dict) else value
    if isinstance(shape, Items):
        if not isinstance(value, list):
            return value
        items = [in_standard_form(shape.item, element) for element in value]
        if name == "composition":  # the standard's schema lets anything be in it
            return [item for item in items if _is_effect(shape.item, item)]
        # An unknown target on the body is dropped; the known targets of the list stay meaningful.
        if isinstance(shape.item, Text) and shape.item.choices:
            return [item for item in items if item in shape.item.choices]
        return items
    if isinstance(shape, Number):
        return _number(shape, value, name)
    if isinstance(shape, Text) and isinstance(value, str):
        # An old choice becomes the standard's, an unknown one the member's default, if any.
        known = _OLD_VALUES.get(name, {}).get(value, value)
        is_known = not shape.choices or known in shape.choices
        is_known &= not shape.pattern or re.fullmatch(shape.pattern, known) is not None
        return known if is_known else str(_DEFAULTS.get(name, known))
    return value


def _record(shape: Record, value: dict[str, Any]) -> dict[str, Any]:
    """Convert an object: old member names, missing members with defaults, draft types of bands.
    Unknown members, and a ``block_length`` other than a whole number from 16 on, are dropped."""
    known = {**shape.required, **shape.optional}
    members = {}
    for key, item in value.items():
        name = key
        # An old name yields to the standard's name within the same object.
        if key not in known and _OLD_NAMES.get(key) not in value:
            name = _OLD_NAMES.get(key, key)
        if name == "block_length" and not (
            isinstance(item, int | float) and item >= 16 and float(item).is_integer()
        ):
            continue  # of other bands, in files from before the standard
        if name in known:
            members[name] = in_standard_form(known[name], item, name)
    # Drafts had one band type for waves, and the coding beside it.
    if value.get("band_type") == "Wave" and value.get("encoding_modality") in _ENCODINGS:
        members["band_type"] = _ENCODINGS[value["encoding_modality"]]
    for name in shape.required:
        if name not in members and name in _DEFAULTS:
            members[name] = _DEFAULTS[name]
    return members


def _is_effect(shape: Shape, item: Any) -> bool:
    """Test for an item without faults of the shape but RANGE, nested compositions ignored."""
    report = Report("HJIF")
    if isinstance(item, dict):
        item = {key: member for key, member in item.items() if key != "composition"}
    check(shape, item, report)
    return not any(finding.code != "HJIF-RANGE" for finding in report.findings)


def _number(shape: Number, value: Any, name: str) -> Any:
    """Clip a number to the allowed range; unchanged for another type. Wider: amplitudes to +-16
    (scale of early wavelets), upper frequency limits to 192 kHz, ids from 0."""
    # Python's bool is an int: true and false are no numbers here.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if name == "amplitude_modulation":  # early wavelet blocks hold their scale as one
        return min(max(value, -_LARGEST_SCALE), _LARGEST_SCALE)
    highest = _HIGHEST_RATE if name == "upper_frequency_limit" else shape.highest
    # Ids are labels: an id of 0, clipped to 1, would be that of another item.
    lowest = 0 if name == "id" else shape.lowest
    within = min(max(value, lowest), highest)
    # Writers without integers store 1 as 1.0.
    return int(within) if shape.is_whole and float(within).is_integer() else within
