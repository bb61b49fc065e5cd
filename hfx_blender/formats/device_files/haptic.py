# SPDX-License-Identifier: GPL-3.0-or-later
"""Meta .haptic: a vibration as breakpoints of amplitude and frequency, with emphasis.

Source: meta-haptics-sdk, ``resources/haptic-file-spec.md`` 1.0. A file has no place on the body, so
each actuator gets a file.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...files.findings import Finding, Report, json_validator, refuse_untolerated, without_nulls
from ...files.json_shapes import Items, Number, Record, Text, check, loose
from ...files.strict_json import clean, parse
from ..registry import FORMATS
from ..signals.curves import Curve
from ..signals.signals import Credits, FrequencyRange, Signal, Transient, joined_times, text_of
from ..signals.simplified_writer import simplified_writer, write_audible
from ..written import Written, rounded_s

SUFFIX: Final = FORMATS["haptic"].suffix
DEFAULT_RANGE: Final = FrequencyRange(50.0, 200.0, is_stated=False)
"""Approximate frequencies of 0 and 1 on a controller, for files that state none."""

_RANGE_TAG: Final = "frequency-range-hz:{:g}-{:g}"
_RANGE_PATTERN: Final = re.compile(r"frequency-range-hz:([0-9.e+]{1,12})-([0-9.e+]{1,12})")
_SHARE = Number(0.0, 1.0)
_TIME = Number(0.0, 1e6)
_AMPLITUDE = Record(
    {"time": _TIME, "amplitude": _SHARE},
    {"emphasis": Record({"amplitude": _SHARE, "frequency": _SHARE})},
)
_FREQUENCY = Record({"time": _TIME, "frequency": _SHARE})
_ENVELOPES = Record({"amplitude": Items(_AMPLITUDE, least=1)}, {"frequency": Items(_FREQUENCY)})
_METADATA = loose(
    {},
    {
        **dict.fromkeys(("author", "editor", "source", "project", "description"), Text()),
        "tags": Items(Text()),
    },
)
_TOLERATED: Final = ("HAPTIC-EMPHASIS",)
_DOCUMENT = Record(
    {
        "version": Record(
            {"major": Number(1, 1, is_whole=True)},
            {each: Number(0, 2**32 - 1, is_whole=True) for each in ("minor", "patch")},
        ),
        "signals": Record({"continuous": Record({"envelopes": _ENVELOPES})}),
    },
    {"metadata": _METADATA},
)


def write(signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path) -> Written:
    """Write ``stem.<name>.haptic`` per audible signal; dropped or raised ticks are in
    ``left_out``, silent signals in ``notes``."""
    written = write_audible(signals, stem, SUFFIX, lambda signal: document(signal, frequencies))
    left_out: list[str] = []
    for signal in signals:
        lost = len(signal.transients) - len({rounded_s(tick.time_s) for tick in signal.transients})
        if lost:
            left_out.append(f"'{signal.name}': {lost} ticks at the time of a stronger tick")
        # Readers refuse an emphasis weaker than the envelope: document() raises the emphasis.
        raised = sum(
            tick.amplitude < float(signal.amplitude.at(tick.time_s)) - 1e-6
            for tick in signal.transients
        )
        if raised:
            left_out.append(
                f"'{signal.name}': {raised} ticks weaker than the vibration at their time are "
                "as strong as it"
            )
    return written + Written(left_out=tuple(left_out))


def document(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """Content of a .haptic file of a signal: breakpoints from 0 s on, with ticks as emphasis. Of
    ticks at a time the strongest is stored; an emphasis is raised to the envelope's level. Lasts 1
    ms at least."""
    # One emphasis per time: the strongest of simultaneous ticks is stored.
    ticks: dict[float, Transient] = {}
    for tick in signal.transients:
        before = ticks.get(rounded_s(tick.time_s))
        if before is None or tick.amplitude > before.amplitude:
            ticks[rounded_s(tick.time_s)] = tick
    points = [
        (rounded_s(time), value)
        for time, value in zip(
            signal.amplitude.times_s.tolist(), signal.amplitude.values.tolist(), strict=True
        )
    ]
    # An emphasis belongs to a breakpoint: ticks between breakpoints add one on the line.
    known = {time for time, _ in points}
    points += [(t, float(signal.amplitude.at(t))) for t in sorted(ticks) if t not in known]
    points.sort(key=lambda point: point[0])
    # All samples of the maker begin at 0 s.
    if points[0][0] > 0.0:
        points.insert(0, (0.0, points[0][1]))
    # Meta's reader refuses an envelope without duration.
    if points[-1][0] <= 0.0:
        points.append((0.001, points[-1][1]))
    breakpoints: list[dict[str, Any]] = []
    for time, value in points:
        breakpoints.append({"time": time, "amplitude": round(value, 6)})
        if time in ticks:
            # Removed, so of the two breakpoints of a step only the first has the emphasis.
            emphasized = ticks.pop(time)
            breakpoints[-1]["emphasis"] = {
                "amplitude": round(max(emphasized.amplitude, breakpoints[-1]["amplitude"]), 6),
                "frequency": round(float(frequencies.share(emphasized.frequency_hz)), 6),
            }
    times = joined_times([signal.frequency_hz], 0.0, points[-1][0])
    shares = frequencies.share(signal.frequency_hz.at(times))
    return {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {
            "editor": "HFX",
            "author": clean(signal.credits.author),
            "source": clean(signal.credits.source),
            "project": clean(signal.credits.project),
            "tags": [
                *map(clean, signal.credits.tags),
                _RANGE_TAG.format(frequencies.lowest_hz, frequencies.highest_hz),
            ],
            "description": clean(signal.name),
        },
        "signals": {
            "continuous": {
                "envelopes": {
                    "amplitude": breakpoints,
                    "frequency": [
                        {"time": rounded_s(time), "frequency": round(share, 6)}
                        for time, share in zip(times.tolist(), shares.tolist(), strict=True)
                    ],
                }
            }
        },
    }


def _parsed(content: bytes, name: str) -> Any:
    """Parse JSON without null members ``emphasis`` and ``frequency``; InputError if invalid."""
    return without_nulls(parse(content, name), ("emphasis", "frequency"))


def _findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values. Times and
    strengths are compared in 32 bits, as by the readers of Lofelt and Meta."""
    report = Report("HAPTIC")
    check(_DOCUMENT, document, report)
    if report.has_errors:
        return report.findings
    envelopes = document["signals"]["continuous"]["envelopes"]
    location = (((None, "signals"), "continuous"), "envelopes")
    amplitude, frequency = envelopes["amplitude"], envelopes.get("frequency", [])
    for name, points in (("amplitude", amplitude), ("frequency", frequency)):
        # Players parse times as 32-bit floats: equal after rounding is still ascending for
        # them.
        times = np.array([point["time"] for point in points], np.float32)
        for k in (np.flatnonzero(np.diff(times) < 0.0) + 1).tolist():
            message = "the time is before that of the last point"
            report.error("ORDER", ((location, name), k), message)
    first, last = amplitude[0]["time"], amplitude[-1]["time"]
    if last <= first:
        message = "the envelope has no duration: Lofelt's reader takes it, Meta's does not"
        report.warn("DURATION", (location, "amplitude"), message)
    if first > 0.0:
        report.warn("START", (location, "amplitude"), f"it begins at {first:g} s, not at 0")
    for k, point in enumerate(frequency):
        if not first <= point["time"] <= last:
            message = "it is outside of the amplitude envelope: Lofelt's and Meta's readers take it"
            report.warn("FREQUENCY-TIME", ((location, "frequency"), k), message)
    for k, point in enumerate(amplitude):
        emphasis = point.get("emphasis")
        if emphasis and np.float32(emphasis["amplitude"]) < np.float32(point["amplitude"]):
            message = "its emphasis is weaker than its amplitude"
            report.error("EMPHASIS", ((location, "amplitude"), k), message)
    return report.findings


validate = json_validator(_findings, _parsed)


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode a file to a list of one signal, and the frequency range. Points with an emphasis also
    give ticks; frequency 0.5 without a frequency envelope. Raises InputError for an unreadable
    file, or errors not tolerated by players."""
    document = _parsed(content, name)
    notes = refuse_untolerated(
        _findings(document),
        name,
        lambda each: each.code in _TOLERATED or each.place.startswith("metadata"),
    )
    # Faults of the metadata end the check before the value rules: repeat without the metadata.
    signals = {key: item for key, item in document.items() if key != "metadata"}
    refuse_untolerated(_findings(signals), name, lambda each: each.code in _TOLERATED)
    envelopes = document["signals"]["continuous"]["envelopes"]
    metadata = document.get("metadata")
    frequencies = _range_of(metadata)
    points = envelopes["amplitude"]
    shares = envelopes.get("frequency") or [{"time": 0.0, "frequency": 0.5}]
    transients = [
        Transient(
            float(point["time"]),
            float(point["emphasis"]["amplitude"]),
            float(frequencies.hertz(point["emphasis"]["frequency"])),
        )
        for point in points
        if "emphasis" in point
    ]
    title = metadata.get("description") if isinstance(metadata, dict) else None
    signal = Signal(
        title if isinstance(title, str) and title else Path(name).stem,
        Curve.of(_times_s(points), [p["amplitude"] for p in points]),
        Curve(_times_s(shares), frequencies.hertz([p["frequency"] for p in shares])),
        tuple(transients),
        notes=notes,
        credits=_credits_of(metadata),
    )
    return [signal], frequencies


def _times_s(points: list[Any]) -> F64:
    """Times of points, seconds, ascending in 64 bits, too: a time that is before the last one only
    in 64 bits becomes the last one."""
    return np.maximum.accumulate(np.array([point["time"] for point in points], np.float64))


held: Final = DEFAULT_RANGE.held
write_signals: Final = simplified_writer(write, SUFFIX, decode)


def _credits_of(metadata: Any) -> Credits:
    """Author, project, source and tags of metadata, without HFX's tag of the frequency range."""
    return Credits(
        author=text_of(metadata, "author"),
        project=text_of(metadata, "project"),
        source=text_of(metadata, "source"),
        tags=tuple(tag for tag in _tags_of(metadata) if not _RANGE_PATTERN.fullmatch(tag)),
    )


def _tags_of(metadata: Any) -> list[str]:
    """Tags of metadata of any type, without empty tags and tags of another type."""
    tags = metadata.get("tags") if isinstance(metadata, dict) else None
    return [tag for tag in tags if isinstance(tag, str) and tag] if isinstance(tags, list) else []


def _range_of(metadata: Any) -> FrequencyRange:
    """Frequency range of the first tag ``frequency-range-hz:LOW-HIGH``, or ``DEFAULT_RANGE``."""
    for match in map(_RANGE_PATTERN.fullmatch, _tags_of(metadata)):
        if match:
            try:
                return FrequencyRange(float(match[1]), float(match[2]))
            except ValueError:
                continue  # a foreign tag of the same form
    return DEFAULT_RANGE
