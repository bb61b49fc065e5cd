# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of Apple AHAP files."""

from itertools import pairwise
from typing import Any, Final

from ...files.findings import Finding, Report, json_validator
from ...files.json_shapes import Anything, Items, Number, Record, Shape, Text, check

MAX_EVENT_S: Final = 30.0
MAX_CURVE_POINTS: Final = 16
INTENSITY, SHARPNESS = "HapticIntensity", "HapticSharpness"
INTENSITY_CONTROL, SHARPNESS_CONTROL = "HapticIntensityControl", "HapticSharpnessControl"

_TIME = Number(0.0, 1e6)
_EVENT_PARAMETERS = (
    INTENSITY,
    SHARPNESS,
    "AttackTime",
    "DecayTime",
    "ReleaseTime",
    "Sustained",
    "AudioVolume",
    "AudioPitch",
    "AudioPan",
    "AudioBrightness",
)
_CONTROLS = tuple(
    f"{kind}{name}Control"
    for kind, names in (
        ("Haptic", ("Intensity", "Sharpness", "AttackTime", "DecayTime", "ReleaseTime")),
        (
            "Audio",
            ("Volume", "Pitch", "Pan", "Brightness", "AttackTime", "DecayTime", "ReleaseTime"),
        ),
    )
    for name in names
)
_EVENT = Record(
    {
        "Time": _TIME,
        "EventType": Text(
            ("HapticTransient", "HapticContinuous", "AudioContinuous", "AudioCustom")
        ),
    },
    {
        "EventDuration": Number(0.0, 1e6),
        "EventWaveformPath": Text(),
        "EventWaveformUseVolumeEnvelope": Anything(),
        "EventParameters": Items(
            Record({"ParameterID": Text(_EVENT_PARAMETERS), "ParameterValue": Number()})
        ),
    },
)
_PARAMETER = Record({"ParameterID": Text(_CONTROLS), "Time": _TIME, "ParameterValue": Number()})
_PARAMETER_CURVE = Record(
    {
        "ParameterID": Text(_CONTROLS),
        "Time": _TIME,
        "ParameterCurveControlPoints": Items(
            Record({"Time": _TIME, "ParameterValue": Number()}), least=1
        ),
    }
)
_ENTRIES: Final = {"Event": _EVENT, "Parameter": _PARAMETER, "ParameterCurve": _PARAMETER_CURVE}
_MEMBERS: Final[dict[str, Shape]] = {
    key: member
    for shape in _ENTRIES.values()
    for key, member in {**shape.required, **shape.optional}.items()
}
DOCUMENT = Record(
    {"Pattern": Items(Record({}, _ENTRIES))}, {"Version": Number(0.0, 1e3), "Metadata": Anything()}
)
_VERSION: Final = 1.0
_RANGES: Final = {
    INTENSITY: (0.0, 1.0),
    SHARPNESS: (0.0, 1.0),
    INTENSITY_CONTROL: (0.0, 1.0),
    SHARPNESS_CONTROL: (-1.0, 1.0),
}


def findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values."""
    report = Report("AHAP")
    check(DOCUMENT, document, report)
    _check_misplaced(document, report)
    if report.has_errors:
        return report.findings
    if "Version" not in document:
        message = f"'Version' is missing, which some players refuse; the version is {_VERSION}"
        report.warn("VERSION", None, message)
    elif document["Version"] != _VERSION:
        message = f"{document['Version']:g}: phones do not play it, only version {_VERSION}"
        report.warn("VERSION", (None, "Version"), message)
    # Beyond the schema: a single kind per entry, durations, value ranges and order of points.
    for k, entry in enumerate(document["Pattern"]):
        location = ((None, "Pattern"), k)
        if len(entry) != 1:
            report.error("ENTRY", location, "expected one of Event, Parameter, ParameterCurve")
        event = entry.get("Event", {})
        if "Continuous" in event.get("EventType", ""):
            duration = event.get("EventDuration")
            if duration is None:
                report.error("DURATION-MISSING", (location, "Event"), "'EventDuration' is missing")
            elif duration > MAX_EVENT_S:
                message = f"lasts {duration:g} s, the most is {MAX_EVENT_S:g} s"
                report.error("DURATION", (location, "Event"), message)
        for parameter in event.get("EventParameters", []):
            _check_range(parameter, report, (location, "Event"))
        if "Parameter" in entry:
            _check_range(entry["Parameter"], report, (location, "Parameter"))
        curve = entry.get("ParameterCurve", {})
        points = curve.get("ParameterCurveControlPoints", [])
        here = (location, "ParameterCurve")
        if len(points) > MAX_CURVE_POINTS:
            message = f"{len(points)} control points, the most is {MAX_CURVE_POINTS}"
            report.warn("CURVE-POINTS", here, message)  # vendors write more, and it plays
        times = [point["Time"] for point in points]
        if any(b < a for a, b in pairwise(times)):
            report.error("CURVE-ORDER", here, "the times of its control points descend")
        for point in points:
            _check_range({**point, "ParameterID": curve["ParameterID"]}, report, here)
    return report.findings


def _check_misplaced(document: Any, report: Report) -> None:
    """Add findings on values of known members in the wrong kind of entry. The values are checked
    against the member's shape in its own kind."""
    pattern = document.get("Pattern") if isinstance(document, dict) else None
    # Unknown members are only warnings, but a misplaced known one has the type of its own kind.
    for k, entry in enumerate(pattern if isinstance(pattern, list) else ()):
        for kind, item in entry.items() if isinstance(entry, dict) else ():
            shape = _ENTRIES.get(kind)
            if shape is None or not isinstance(item, dict):
                continue
            known = {**shape.required, **shape.optional}
            for key in (item.keys() - known.keys()) & _MEMBERS.keys():
                check(_MEMBERS[key], item[key], report, ((((None, "Pattern"), k), kind), key))


validate = json_validator(findings)

_NEEDED: Final = {
    "Event": ("EventType",),
    "Parameter": ("ParameterID", "ParameterValue"),
    "ParameterCurve": ("ParameterID", "ParameterCurveControlPoints"),
    "EventParameters": ("ParameterID", "ParameterValue"),
    "ParameterCurveControlPoints": ("ParameterValue",),
}
"""Members required for an entry or list item to have an effect."""


def completed(document: dict[str, Any]) -> dict[str, Any]:
    """Copy of a document without missing members, as Core Haptics reads it. Missing times are 0;
    entries and items without another needed member are dropped."""
    entries = []
    for entry in document.get("Pattern", []):
        full = {kind: _completed(kind, entry[kind]) for kind in entry.keys() & _NEEDED.keys()}
        entries.append({kind: item for kind, item in full.items() if item is not None})
    return {**document, "Pattern": entries}


def _completed(kind: str, item: dict[str, Any]) -> dict[str, Any] | None:
    """Copy of an entry or list item with time 0 if missing (not for event parameters), and without
    list items that lack a needed member. None: the entry itself lacks a needed member, or no
    control point remains."""
    completed_item = {**item} if kind == "EventParameters" else {"Time": 0.0, **item}
    for listed in ("EventParameters", "ParameterCurveControlPoints"):
        if listed in completed_item:
            rows = [_completed(listed, row) for row in completed_item[listed]]
            completed_item[listed] = [row for row in rows if row is not None]
    has_no_points = completed_item.get("ParameterCurveControlPoints") == []
    return (
        None
        if has_no_points or any(key not in completed_item for key in _NEEDED[kind])
        else completed_item
    )


def _check_range(parameter: dict[str, Any], report: Report, place: Any) -> None:
    """Warn about a parameter value outside its range; +-1e9 for parameters without a range."""
    name, value = parameter["ParameterID"], parameter["ParameterValue"]
    low, high = _RANGES.get(name, (-1e9, 1e9))
    if not low <= value <= high:
        message = f"{name} is {value:g}, allowed is {low:g} to {high:g}"
        report.warn("RANGE", place, message)
