# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF rules across several members: ids, limits, profiles and levels.

Source: the standard's conformance configuration (MPEGGroup, HapticReferenceSoftware).
"""

import math
import re
from datetime import datetime
from typing import Any, Final

from ...files.findings import Report
from ...files.strict_json import Place

MAX_CHANNELS: Final = {1: 127, 2: 65_535}  # by level
MAX_BANDS: Final = {1: 7, 2: 63}
MAX_TIMESCALE: Final = 48_000
PROFILES: Final = ("Main", "Simple Parametric")
SIMPLE_MODALITIES: Final = ("Force", "Vibrotactile", "Stiffness", "Vibrotactile Texture")
SEMANTICS: Final = frozenset(
    f"{group}/{word}"
    for group, words in {
        "Ambient": "Cold Cracks Earthquack ElectricBuzz Heat Ignition Rain Sparks Thunderbolt "
        "Undefined WaterDrop Waterfall Wind",
        "Avatar": "Collision Crawl Fall Footstep Grab Jumping Swim Swip Touch Undefined",
        "Music": "BouncyMaterial Bowing BrassInstrument HardMaterial Pucking Striking Undefined "
        "WoodWindInstrument",
        "SpecialFX": "Noise Undefined Washout",
        "Texture": "Gravel Metal Plastic Rock Sand Undefined Wood",
        "UX": "Alarm Click Confirmatioon DoubleClick Error Message Ring Success Undefined Wrong",
        "Vehicle": "AirFriction Brake Doors Drift Engine MechanicalContraption RoadBump "
        "RoadFriction Tires Undefined",
        "WeaponCombat": "Blade Blast ElasticPropulsion ElectricShock Grenade Gun HandThrown "
        "Handgun Hit Machinegun Mine Missile Pneumatic Rifle Shotgun Taser Undefined",
    }.items()
    for word in words.split()
)
"""Closed list of semantic keywords, including the standard's misspellings."""

# Modalities of the schema at which the reference software ends with an exception (out_of_range).
_CRASHING: Final = ("Humidity", "User-defined Temporal", "User-defined Spatial")
# Body parts of the schema that the reference software has under another name, with the same end.
_CRASHING_PARTS: Final = ("Upper", "Lower", "Index-Toe", "Middle-Toe", "Ring-Toe", "Pinky-Toe")
# RFC 3986: unreserved and reserved characters; a percent sign precedes two hexadecimal digits.
_URI: Final = re.compile(r"(?:[A-Za-z0-9._~:/?#\[\]@!$&'()*+,;=-]|%[0-9A-Fa-f]{2})+")
_YEAR: Final = re.compile(r"[0-9]{4}")
_DATE: Final = re.compile(
    r"\d{4}-\d{2}-\d{2}[Tt]\d{2}:\d{2}:\d{2}(?:\.\d+)?(?:[Zz]|[+-]\d{2}:\d{2})"
)


def check_semantics(document: dict[str, Any], report: Report) -> None:
    """Report semantic faults of a document that has no schema faults. Ids, URIs, counts of
    channels, and the faults of all perceptions."""
    is_simple = document["profile"] == "Simple Parametric"
    _check_root(document, report, is_simple=is_simple)
    avatars = _ids(document["avatars"], (None, "avatars"), "AVATAR-ID-DUPLICATE", report)
    for k, avatar in enumerate(document["avatars"]):
        mesh = avatar.get("mesh")
        if mesh is not None and not _URI.fullmatch(mesh):
            where = (((None, "avatars"), k), "mesh")
            message = "is no URI (RFC 3986): encode other characters"
            (report.warn if mesh else report.error)("AVATAR-URI", where, message)
    _ids(document["perceptions"], (None, "perceptions"), "PERCEPTION-ID-DUPLICATE", report)
    # A wrong level is reported with the root; here the limits of the nearest level apply.
    level = min(max(document["level"], 1), 2)
    # The level limits the channels of the whole file.
    counts = [len(perception["channels"]) for perception in document["perceptions"]]
    if sum(counts) > MAX_CHANNELS[level]:
        message = f"{sum(counts)} channels, level {level} allows {MAX_CHANNELS[level]}"
        # The reference software counts each perception by itself.
        tell = report.error if max(counts) > MAX_CHANNELS[level] else report.warn
        tell("CHANNEL-COUNT", (None, "perceptions"), message)
    for k, perception in enumerate(document["perceptions"]):
        location = ((None, "perceptions"), k)
        if perception["avatar_id"] and perception["avatar_id"] not in avatars:
            message = f"there is no avatar {perception['avatar_id']}"
            report.error("AVATAR-ID-UNKNOWN", (location, "avatar_id"), message)
        _check_perception(perception, location, report, level=level, is_simple=is_simple)


def _check_root(document: dict[str, Any], report: Report, *, is_simple: bool) -> None:
    """Report an unknown profile or level, a version before 2023, a wrong date or timescale. Warns
    about members needed by the reference software. The timescale of a simple profile is 1000."""
    # The schema's pattern holds here: four digits, and perhaps an amendment of one digit.
    year, _, amendment = document["version"].partition("-")
    if int(year) < 2023:
        report.error("VERSION-YEAR", (None, "version"), f"{year} is before 2023")
    if amendment and int(amendment) == 0:
        report.error("VERSION-AMENDMENT", (None, "version"), "the amendment is 0")
    if document["profile"] not in PROFILES:
        report.error("PROFILE", (None, "profile"), f"is none of {', '.join(PROFILES)}")
    if document["level"] not in MAX_CHANNELS:
        report.error("LEVEL", (None, "level"), f"{document['level']} is neither 1 nor 2")
    if not is_date(document["date"]):
        has_year = _YEAR.search(document["date"]) is not None  # enough for the reference software
        message = "is no ISO 8601 date and time with an offset"
        (report.warn if has_year else report.error)("DATE", (None, "date"), message)
    timescale = document.get("timescale", 1000)
    if timescale > MAX_TIMESCALE or (is_simple and timescale != 1000):
        allowed = "1000" if is_simple else f"1 to {MAX_TIMESCALE}"
        report.error("TIMESCALE", (None, "timescale"), f"{timescale}, allowed is {allowed}")
    for key in ("timescale", "syncs"):
        if key not in document:
            report.warn("REFERENCE-MISSING", None, f"the reference software needs '{key}'")


def is_date(text: str) -> bool:
    """Test for an existing date and time of ISO 8601 with seconds and an offset or Z."""
    if not _DATE.fullmatch(text):
        return False
    try:
        # The pattern has lower case too; the calendar, such as 30 February, is checked by parsing.
        datetime.fromisoformat(text.upper().replace("Z", "+00:00"))
    except ValueError:
        return False
    return True


def _ids(items: list[dict[str, Any]], place: Place, code: str, report: Report) -> set[int]:
    """Set of the ids of items; a repeated id is reported with ``code``."""
    seen: set[int] = set()
    for k, item in enumerate(items):
        if item["id"] in seen:
            report.error(code, ((place, k), "id"), f"{item['id']} is there before")
        seen.add(item["id"])
    return seen


def _check_perception(
    perception: dict[str, Any], place: Place, report: Report, *, level: int, is_simple: bool
) -> None:
    """Report faults of a perception: profile, devices, library, channels and bands."""
    modality = perception["perception_modality"]
    here: Place = (place, "perception_modality")
    if is_simple and level == 1 and modality not in SIMPLE_MODALITIES:
        message = f"{modality} is not of level 1 of the profile Simple Parametric"
        report.error("MODALITY-PROFILE", here, message)
    if modality in _CRASHING:
        report.warn("REFERENCE-CRASH", here, f"the reference software cannot read {modality}")
    for key in ("semantic_scheme", "effect_semantic_scheme"):
        if key in perception:
            report.warn("REFERENCE-SCHEME", (place, key), "the reference software refuses it")
    devices = perception.get("reference_devices", [])
    known = _ids(devices, (place, "reference_devices"), "DEVICE-ID-DUPLICATE", report)
    for k, device in enumerate(devices):
        _check_device(device, ((place, "reference_devices"), k), report)
    library = perception["effect_library"]
    # All ids are collected first: effects may refer to later ones.
    library_ids: set[int] = set()
    for k, effect in enumerate(library):
        here = ((place, "effect_library"), k)
        number = effect.get("id")
        if number is None:
            report.error("EFFECT-ID-MISSING", here, "an effect of the library has an id")
        elif number in library_ids:
            report.error("EFFECT-ID-DUPLICATE", (here, "id"), f"{number} is there before")
        else:
            library_ids.add(number)
    for k, effect in enumerate(library):
        _check_effect(effect, ((place, "effect_library"), k), report, library_ids, is_simple, None)
    _ids(perception["channels"], (place, "channels"), "CHANNEL-ID-DUPLICATE", report)
    for k, channel in enumerate(perception["channels"]):
        here = ((place, "channels"), k)
        device_id = channel.get("reference_device_id")
        if device_id is not None and device_id not in known:
            message = f"there is no reference device {device_id}"
            report.error("DEVICE-ID-UNKNOWN", (here, "reference_device_id"), message)
        if "body_part_mask" not in channel:
            report.warn("REFERENCE-MISSING", here, "the reference software needs 'body_part_mask'")
        _check_channel(channel, here, report)
        if len(channel["bands"]) > MAX_BANDS[level]:
            message = f"{len(channel['bands'])} bands, level {level} allows {MAX_BANDS[level]}"
            report.error("BAND-COUNT", (here, "bands"), message)
        for b, band in enumerate(channel["bands"]):
            _check_band(band, ((here, "bands"), b), report, library_ids, is_simple)


def _check_device(device: dict[str, Any], place: Place, report: Report) -> None:
    """Report a reference device with maximum < minimum, or a resonance outside."""
    low, high = device.get("minimum_frequency"), device.get("maximum_frequency")
    resonance = device.get("resonance_frequency")
    if low is not None and high is not None and high < low:
        message = f"maximum_frequency {high:g} is below minimum_frequency {low:g}"
        report.error("DEVICE-FREQUENCY-RANGE", place, message)
    if resonance is not None and low is not None and resonance < low:
        report.error("DEVICE-RESONANCE-LOW", place, "resonance is below the minimum frequency")
    if resonance is not None and high is not None and resonance > high:
        report.error("DEVICE-RESONANCE-HIGH", place, "resonance is above the maximum frequency")


def _check_channel(channel: dict[str, Any], place: Place, report: Report) -> None:
    """Report actuators outside the resolution, and directions of a length other than 127."""
    resolution = channel.get("actuator_resolution")
    if resolution is not None and min(resolution[axis] for axis in "XYZ") < 0:
        message = "a resolution is not negative"
        report.error("RESOLUTION-NEGATIVE", (place, "actuator_resolution"), message)
    if resolution is not None:
        for k, target in enumerate(channel.get("actuator_target", [])):
            if any(not 0 <= target[axis] < max(resolution[axis], 1) for axis in "XYZ"):
                here = ((place, "actuator_target"), k)
                # The reference software takes the resolution itself for the last actuator.
                is_taken = all(0 <= target[axis] <= resolution[axis] for axis in "XYZ")
                tell = report.warn if is_taken else report.error
                tell("ACTUATOR-TARGET", here, "is outside of the resolution")
    elif "actuator_target" in channel:
        message = "'actuator_resolution' is missing"
        report.error("ACTUATOR-TARGET", (place, "actuator_target"), message)
    for k, part in enumerate(channel.get("body_part_target", ())):
        if part in _CRASHING_PARTS:
            here = ((place, "body_part_target"), k)
            report.warn("REFERENCE-CRASH", here, f"the reference software cannot read {part}")
    direction = channel.get("direction")
    if direction is not None:
        length = math.sqrt(sum(direction[axis] ** 2 for axis in "XYZ")) / 127.0
        if not 0.99 <= length <= 1.01:
            message = f"has the length {length:.3f} of 127, allowed is 0.99 to 1.01"
            report.error("DIRECTION", (place, "direction"), message)


def _check_band(
    band: dict[str, Any], place: Place, report: Report, library: set[int], is_simple: bool
) -> None:
    """Report a wrong curve type, block length (no power of two) or limits, and faulty effects.
    ``library``: ids of the effect library."""
    kind = band["band_type"]
    if "curve_type" in band and kind != "Curve":
        report.error("CURVE-TYPE", (place, "curve_type"), f"a {kind} band has no curve_type")
    length = band.get("block_length")
    if length is None and kind == "WaveletWave":
        report.error("BLOCK-LENGTH", place, "'block_length' of wavelets is missing")
    # A power of two has a single bit.
    if length is not None and length & (length - 1):
        report.error("BLOCK-LENGTH", (place, "block_length"), f"{length} is no power of two")
    if band["upper_frequency_limit"] < band["lower_frequency_limit"]:
        report.error("BAND-FREQUENCY", place, "the upper limit is below the lower one")
    if is_simple and kind == "WaveletWave":
        message = "the profile Simple Parametric has no wavelets"
        report.error("WAVELET-PROFILE", (place, "band_type"), message)
    for key in ("lower_frequency_limit", "upper_frequency_limit"):
        if not isinstance(band[key], int):
            message = "the standard's readers leave a band out whose limit is no whole number"
            report.error("BAND-WHOLE", (place, key), message)
    for k, effect in enumerate(band["effects"]):
        _check_effect(effect, ((place, "effects"), k), report, library, is_simple, kind)


def _check_content(effect: dict[str, Any], place: Place, report: Report, band: str) -> None:
    """Report ``wavelet_stream``, or else ``keyframes``, missing in a basis effect of ``band``.
    ``band`` is a band type; waves also need ``phase`` and ``base_signal``."""
    if band == "WaveletWave" and "wavelet_stream" not in effect:
        report.error("WAVELET-STREAM", place, "'wavelet_stream' is missing")
    if band != "WaveletWave" and "keyframes" not in effect:
        report.error("EFFECT-KEYFRAMES", place, "'keyframes' is missing")
    for key in ("phase", "base_signal"):
        if band == "VectorialWave" and key not in effect:
            report.error("EFFECT-WAVE", place, f"'{key}' of a wave is missing")


def _check_effect(
    effect: dict[str, Any],
    place: Place,
    report: Report,
    library: set[int],
    is_simple: bool,
    band: str | None,
) -> None:
    """Report faults of an effect and its composition. ``library``: ids of the effect library;
    ``band``: type of the band, None within the library."""
    kind = effect["effect_type"]
    if is_simple and kind == "Composite":
        message = "the profile Simple Parametric has no composite effects"
        report.error("EFFECT-TYPE-PROFILE", (place, "effect_type"), message)
    if kind == "Reference" and effect.get("id") not in library:
        message = f"there is no effect {effect.get('id')} in the library"
        report.error("EFFECT-ID-UNKNOWN", (place, "id"), message)
    keywords = effect.get("semantic_keywords")
    if keywords is not None and keywords not in SEMANTICS:
        here = (place, "semantic_keywords")
        report.error("SEMANTIC-KEYWORDS", here, "is not of the standard's list")
    if "position" not in effect:
        report.error("EFFECT-POSITION", place, "'position' is missing: readers leave it out")
    # What an effect of the library needs depends on the bands that refer to it.
    if kind == "Basis" and band is not None:
        _check_content(effect, place, report, band)
    if band == "WaveletWave" and effect.get("keyframes"):
        report.error("WAVELET-KEYFRAMES", (place, "keyframes"), "a wavelet has no keyframes")
    last = dict.fromkeys(("amplitude_modulation", "frequency_modulation"), 0)
    for k, keyframe in enumerate(effect.get("keyframes", ())):
        at = keyframe.get("relative_position", 0)
        latest = max((last[key] for key in last if key in keyframe), default=0)
        # Ticks of a transient band are played one by one, in any order.
        if at < latest and band != "Transient":
            here = (((place, "keyframes"), k), "relative_position")
            report.error("KEYFRAME-ORDER", here, f"is {at}, allowed is {latest} or more")
        last |= {key: at for key in last if key in keyframe}
        if isinstance(keyframe.get("frequency_modulation"), float):
            here = (((place, "keyframes"), k), "frequency_modulation")
            report.warn("REFERENCE-WHOLE", here, "the reference software needs a whole number")
    for k, part in enumerate(effect.get("composition", ())):
        _check_effect(part, ((place, "composition"), k), report, library, is_simple, band)
