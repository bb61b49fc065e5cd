# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF schema rules (ISO/IEC 23090-31); unknown keys are warnings.

Rules across several members are in :mod:`.semantics`.
"""

from dataclasses import replace
from typing import Any, Final

from ...files.findings import Finding, Report
from ...files.json_shapes import Items, Number, Record, Shape, Text, check
from ...files.strict_json import parse
from .semantics import check_semantics

MODALITIES: Final = tuple(
    "Pressure,Acceleration,Velocity,Position,Temperature,Vibrotactile,Water,Wind,Force,"
    "Electrotactile,Vibrotactile Texture,Stiffness,Friction,Humidity,User-defined Temporal,"
    "User-defined Spatial,Other".split(",")
)
BODY_PART_TARGETS: Final = tuple(
    "Unknown,All,Upper,Lower,Right,Left,Front,Back,Arm,Head,Chest,Waist,Leg,Upper-arm,Forearm,"
    "Hand,Crane,Neck,Thigh,Calf,Foot,Palm,Finger,Sole,Toe,Thumb,Index,Middle,Ring,Pinky,Hallux,"
    "Index-Toe,Middle-Toe,Ring-Toe,Pinky-Toe,First Phalanx,Second Phalanx,Third Phalanx,Minus,"
    "Plus".split(",")
)
_MASK = Number(0, 2**32 - 1, is_whole=True)
_COUNT = Number(0, is_whole=True)
_POSITIVE = Number(1, is_whole=True)
_HERTZ = Number(0.0, 10_000.0)
_NOT_NEGATIVE = Number(0.0)
_VECTOR = Record({axis: Number(-127, 127, is_whole=True) for axis in ("X", "Y", "Z")})
_KEYFRAME = Record(
    {},
    {
        "relative_position": _COUNT,
        "amplitude_modulation": Number(-1.0, 1.0),
        "frequency_modulation": _HERTZ,
    },
)
_EFFECT_MEMBERS: dict[str, Shape] = {
    "id": _COUNT,
    "semantic_keywords": Text(),
    "position": _COUNT,
    "phase": Number(0.0, 6.28318),
    "base_signal": Text(("Sine", "Square", "Triangle", "SawToothUp", "SawToothDown")),
    "keyframes": Items(_KEYFRAME),
    "wavelet_stream": Text(),
}
_EFFECT = Record({"effect_type": Text(("Basis", "Composite", "Reference"))}, _EFFECT_MEMBERS)
_EFFECT_MEMBERS["composition"] = Items(_EFFECT)  # effects within effects
_BAND = Record(
    {
        "band_type": Text(("WaveletWave", "VectorialWave", "Curve", "Transient")),
        "lower_frequency_limit": _HERTZ,
        "upper_frequency_limit": _HERTZ,
        "effects": Items(_EFFECT),
    },
    {
        "priority": _COUNT,
        "curve_type": Text(("Linear", "Cubic", "Akima", "Bezier", "BSpline", "Unknown")),
        "block_length": Number(16, is_whole=True),
    },
)
_CHANNEL = Record(
    {
        "id": _COUNT,
        "description": Text(),
        "gain": _NOT_NEGATIVE,
        "mixing_coefficient": _NOT_NEGATIVE,
        "bands": Items(_BAND),
    },
    {
        "priority": _COUNT,
        "reference_device_id": _COUNT,
        "body_part_mask": _MASK,
        "actuator_resolution": _VECTOR,
        "body_part_target": Items(Text(BODY_PART_TARGETS)),
        "actuator_target": Items(_VECTOR),
        "frequency_sampling": _COUNT,
        "sample_count": _COUNT,
        "vertices": Items(Number(is_whole=True)),
        "direction": _VECTOR,
    },
)
_DEVICE = Record(
    {"id": _POSITIVE, "name": Text()},
    {
        "body_part_mask": _MASK,
        **dict.fromkeys(
            (
                *("maximum_frequency", "minimum_frequency", "resonance_frequency", "impedance"),
                *("maximum_amplitude", "maximum_voltage", "maximum_current"),
                *("maximum_displacement", "weight", "size"),
            ),
            _NOT_NEGATIVE,
        ),
        "custom": Number(),
        "type": Text(("LRA", "VCA", "ERM", "Piezo", "Unknown")),
    },
)
_PERCEPTION = Record(
    {
        "id": _COUNT,
        "perception_modality": Text(MODALITIES, code="MODALITY"),
        "description": Text(),
        "avatar_id": _COUNT,
        "effect_library": Items(_EFFECT),
        "channels": Items(_CHANNEL, least=1),
    },
    {
        "priority": _COUNT,
        "semantic_scheme": Text(),
        "effect_semantic_scheme": Text(),
        "reference_devices": Items(_DEVICE),
        "unit_exponent": Number(is_whole=True),
        "perception_unit_exponent": Number(is_whole=True),
    },
)
_AVATAR = Record(
    {
        "id": _POSITIVE,
        "lod": _COUNT,
        "type": Text(("Vibration", "Pressure", "Temperature", "Custom")),
    },
    {"mesh": Text()},
)
_SYNC = Record({"timestamp": _COUNT}, {"timescale": _POSITIVE})
DOCUMENT = Record(
    {
        "version": Text(pattern=r"[0-9]{4}(-[0-9])?", code="VERSION"),
        "profile": Text(),
        "level": _COUNT,
        "date": Text(),
        "description": Text(),
        "avatars": Items(_AVATAR),
        "perceptions": Items(_PERCEPTION, least=1),
    },
    {"timescale": _POSITIVE, "syncs": Items(_SYNC)},
)
_EARLY: Final = "files of MPEG's reference software from before the standard are like that"
_ENCODER: Final = "MPEG's reference encoder writes files like that"
_TOOLS: Final = (  # code, part of the place or message, the tool
    ("DATE", "", f"{_ENCODER}, and 5G-MAG's samples have a day only"),
    ("VERSION", "", _EARLY),
    ("UNKNOWN", "'mixing_weight'", _EARLY),
    ("UNKNOWN", "'bitstream'", _EARLY),
    ("UNKNOWN", "'tracks'", _EARLY),
    ("MISSING", "'mixing_coefficient'", _EARLY),
    ("MISSING", "'channels'", _EARLY),
    ("TYPE", "block_length", _EARLY),
    ("RANGE", "block_length", _EARLY),
    ("RANGE", "amplitude_modulation", _EARLY),
    ("CURVE-TYPE", "", _EARLY),
    ("WAVELET-KEYFRAMES", "", _EARLY),
    ("WAVELET-STREAM", "", _EARLY),
    ("RANGE", "avatar_id", "files of SenseGlove's tools are like that"),
)


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file; InputError without valid JSON.

    Codes are ``HJIF-`` and a word: MISSING, UNKNOWN, TYPE, RANGE, CHOICE and COUNT for the schema,
    otherwise words of :mod:`.semantics`. REFERENCE-... are warnings about content unreadable for
    the standard's reference software.
    """
    return findings(parse(content, name))


def findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema faults, or without any, semantic faults.
    Unknown members are warnings and no schema faults. Messages of faults that a tool is known for
    end with a remark about the tool in brackets."""
    report = Report("HJIF")
    check(DOCUMENT, document, report)
    if all(finding.code == "HJIF-UNKNOWN" for finding in report.findings):
        check_semantics(document, report)
    findings = []
    for finding in report.findings:
        text = f"{finding.place} {finding.message}"
        tools = (t for code, part, t in _TOOLS if finding.code == f"HJIF-{code}" and part in text)
        tool = next(tools, None)
        message = f"{finding.message} ({tool})" if tool else finding.message
        findings.append(replace(finding, message=message))
    return findings
