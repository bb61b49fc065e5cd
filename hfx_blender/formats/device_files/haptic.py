# SPDX-License-Identifier: GPL-3.0-or-later
"""Meta .haptic: one vibration as breakpoints of amplitude and frequency, with emphasis.

Source: meta-haptics-sdk, ``resources/haptic-file-spec.md`` 1.0. It has no place on the body:
one file an actuator.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...files.findings import Finding, Report, json_validator
from ...files.json_shapes import Items, Number, Record, Text, check, loose
from ...files.strict_json import clean, parse
from ..leniency import refuse_but, without_nulls
from ..registry import FORMATS
from ..signals.curves import Curve
from ..signals.signals import Credits, FrequencyRange, Signal, Transient, joined_times, text_of
from ..signals.simplified_writer import simplified_writer
from ..written import Written, beside, silent_note, write_json

SUFFIX: Final = FORMATS["haptic"].suffix
DEFAULT_RANGE: Final = FrequencyRange(50.0, 200.0, is_stated=False)
"""Frequencies of 0 and 1 on a controller, about, for files without a statement of them."""

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
    """Write one file for each audible signal: ``stem.<name>.haptic``."""
    files = []
    for signal in signals:
        if not signal.is_silent:
            files.append(beside(stem, signal.name, SUFFIX))
            write_json(document(signal, frequencies), files[-1])
    left_out: list[str] = []
    for signal in signals:
        lost = len(signal.transients) - len({_rounded(tick.time_s) for tick in signal.transients})
        if lost:
            left_out.append(f"'{signal.name}': {lost} ticks at the same time as a stronger one")
        # An emphasis that is weaker than the envelope is none.
        raised = sum(
            tick.amplitude < float(signal.amplitude.at(tick.time_s)) - 1e-6
            for tick in signal.transients
        )
        if raised:
            left_out.append(
                f"'{signal.name}': {raised} ticks weaker than the vibration at their time are "
                "as strong as it"
            )
    return Written(
        tuple(files),
        tuple(left_out),
        silent_note([signal.name for signal in signals if signal.is_silent]),
    )


def document(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """A signal as the content of a file."""
    # A time has one breakpoint with emphasis; of several ticks at once the strongest counts.
    ticks: dict[float, Transient] = {}
    for each in signal.transients:
        before = ticks.get(_rounded(each.time_s))
        if before is None or each.amplitude > before.amplitude:
            ticks[_rounded(each.time_s)] = each
    points = [
        (_rounded(time), value)
        for time, value in zip(
            signal.amplitude.times_s.tolist(), signal.amplitude.values.tolist(), strict=True
        )
    ]
    known = {time for time, _ in points}
    points += [(t, float(signal.amplitude.at(t))) for t in sorted(ticks) if t not in known]
    points.sort(key=lambda point: point[0])
    if points[0][0] > 0.0:
        points.insert(0, (0.0, points[0][1]))
    if points[-1][0] <= 0.0:
        points.append((0.001, points[-1][1]))
    breakpoints: list[dict[str, Any]] = []
    for time, value in points:
        breakpoints.append({"time": time, "amplitude": round(value, 6)})
        if time in ticks:
            tick = ticks.pop(time)
            breakpoints[-1]["emphasis"] = {
                "amplitude": round(max(tick.amplitude, breakpoints[-1]["amplitude"]), 6),
                "frequency": round(float(frequencies.share(tick.frequency_hz)), 6),
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
                        {"time": _rounded(time), "frequency": round(share, 6)}
                        for time, share in zip(times.tolist(), shares.tolist(), strict=True)
                    ],
                }
            }
        },
    }


def _rounded(seconds: float) -> float:
    return round(float(seconds), 7)


def _parsed(content: bytes, name: str) -> Any:
    """A document; the members that may be null, as in Meta's reader, are then left out."""
    return without_nulls(parse(content, name), ("emphasis", "frequency"))


def _findings(found: Any) -> list[Finding]:
    """Faults of a parsed document; an error is what the readers of Lofelt and Meta refuse.

    Both compare times and strengths with 32 bits.
    """
    report = Report("HAPTIC")
    check(_DOCUMENT, found, report)
    if report.has_errors:
        return report.findings
    envelopes = found["signals"]["continuous"]["envelopes"]
    place = (((None, "signals"), "continuous"), "envelopes")
    amplitude, frequency = envelopes["amplitude"], envelopes.get("frequency", [])
    for name, points in (("amplitude", amplitude), ("frequency", frequency)):
        times = np.array([point["time"] for point in points], np.float32)
        for k in (np.flatnonzero(np.diff(times) < 0.0) + 1).tolist():
            report.error("ORDER", ((place, name), k), "its time is before the last one's")
    first, last = amplitude[0]["time"], amplitude[-1]["time"]
    if last <= first:
        message = "the envelope has no duration: Lofelt's reader takes it, Meta's does not"
        report.warn("DURATION", (place, "amplitude"), message)
    if first > 0.0:
        report.warn("START", (place, "amplitude"), f"it begins at {first:g} s, not at 0")
    for k, point in enumerate(frequency):
        if not first <= point["time"] <= last:
            message = "it is outside of the amplitude envelope: Lofelt's and Meta's readers take it"
            report.warn("FREQUENCY-TIME", ((place, "frequency"), k), message)
    for k, point in enumerate(amplitude):
        emphasis = point.get("emphasis")
        if emphasis and np.float32(emphasis["amplitude"]) < np.float32(point["amplitude"]):
            message = "its emphasis is weaker than its amplitude"
            report.error("EMPHASIS", ((place, "amplitude"), k), message)
    return report.findings


validate = json_validator(_findings, _parsed)


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """The signal of a file.

    Raises
    ------
    InputError
        It cannot be read or has errors.
    """
    found = _parsed(content, name)
    notes = refuse_but(
        _findings(found),
        name,
        lambda each: each.code in _TOLERATED or each.place.startswith("metadata"),
    )
    # Faults of the metadata hide those that are looked for behind them.
    signals = {key: item for key, item in found.items() if key != "metadata"}
    refuse_but(_findings(signals), name, lambda each: each.code in _TOLERATED)
    envelopes = found["signals"]["continuous"]["envelopes"]
    metadata = found.get("metadata")
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
        Curve.of([p["time"] for p in points], [p["amplitude"] for p in points]),
        Curve(
            np.array([p["time"] for p in shares], np.float64),
            frequencies.hertz([p["frequency"] for p in shares]),
        ),
        tuple(transients),
        notes=notes,
        credits=_credits_of(metadata),
    )
    return [signal], frequencies


held: Final = DEFAULT_RANGE.held
write_signals: Final = simplified_writer(write, SUFFIX, decode)


def _credits_of(metadata: Any) -> Credits:
    """Statements of the metadata, without our own tag of the range."""
    tags = metadata.get("tags") if isinstance(metadata, dict) else None
    return Credits(
        author=text_of(metadata, "author"),
        project=text_of(metadata, "project"),
        source=text_of(metadata, "source"),
        tags=tuple(
            tag
            for tag in (tags if isinstance(tags, list) else ())
            if isinstance(tag, str) and tag and not _RANGE_PATTERN.fullmatch(tag)
        ),
    )


def _range_of(metadata: Any) -> FrequencyRange:
    tags = metadata.get("tags") if isinstance(metadata, dict) else None
    for tag in tags if isinstance(tags, list) else ():
        found = _RANGE_PATTERN.fullmatch(tag) if isinstance(tag, str) else None
        if found:
            try:
                return FrequencyRange(float(found[1]), float(found[2]))
            except ValueError:
                continue  # a foreign tag that looks like ours: nothing is lost
    return DEFAULT_RANGE
