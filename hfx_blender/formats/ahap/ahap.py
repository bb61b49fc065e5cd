# SPDX-License-Identifier: GPL-3.0-or-later
"""Apple AHAP: one haptic pattern, for the actuator of a phone.

Source: developer.apple.com, "Representing haptic patterns in AHAP files". Intensity is the
share of full scale, sharpness 0 to 1 the device's own range of frequencies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...files import limits
from ...files.json_shapes import known_members
from ...files.strict_json import clean, parse, read_bytes
from ..leniency import refuse_but
from ..registry import FORMATS
from ..signals.curves import Curve, clipped
from ..signals.signals import (
    Credits,
    FrequencyRange,
    Piece,
    Signal,
    Transient,
    bursts,
    mixed,
    text_of,
)
from ..signals.simplified_writer import simplified_writer
from ..written import Written, beside, silent_note, write_json
from .ahap_envelopes import RAMPS, envelope, product
from .ahap_rules import (
    DOCUMENT,
    INTENSITY,
    INTENSITY_CONTROL,
    MAX_CURVE_POINTS,
    MAX_EVENT_S,
    SHARPNESS,
    SHARPNESS_CONTROL,
    completed,
    findings,
)

SUFFIX: Final = FORMATS["ahap"].suffix
TICKS_SUFFIX: Final = ".transients.ahap"
"""Suffix of the ticks of a pattern, beside it and played with it."""

DEFAULT_RANGE: Final = FrequencyRange(80.0, 230.0, is_stated=False)
"""Frequencies of sharpness 0 and 1 on a phone, about, for files without a statement of them."""

_OWN_PROJECT: Final = "HFX"
_RANGE_KEY: Final = "HfxFrequencyRangeHz"  # Core Haptics ignores keys that it does not know
_LAW_KEY: Final = "HfxIntensityLaw"
_LINEAR, _SQUARE_ROOT = "linear", "square root"
"""Intensity of an amplitude: the same share of full scale, or the square root of that share, which
earlier versions wrote, too."""

_CONTROLS: Final = {INTENSITY_CONTROL: (0.0, 1.0), SHARPNESS_CONTROL: (-1.0, 1.0)}
_CUTS: Final = 16  # of a straight line whose square is not straight
_SHORTEST_S: Final = 1e-3  # of silence at the end
_TRANSIENT_S: Final = 0.02  # how long a reader takes a tick to last, if nothing else is there


def write(signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path) -> Written:
    """Write one pattern for each audible signal: ``stem.<name>.ahap``.

    Curves change the whole pattern, ticks included, so ticks of a signal that also has an
    envelope are a second pattern, ``stem.<name>.transients.ahap``, to be played with it.
    """
    files: list[Path] = []
    for signal in signals:
        for suffix, content in (
            (SUFFIX, document(signal, frequencies)),
            (TICKS_SUFFIX, ticks(signal, frequencies)),
        ):
            if content["Pattern"]:
                files.append(beside(stem, signal.name, suffix))
                content["Metadata"][_LAW_KEY] = _LINEAR
                write_json(content, files[-1])
    return Written(
        tuple(files), notes=silent_note([signal.name for signal in signals if signal.is_silent])
    )


def _with_squares(signal: Signal) -> Signal:
    """A signal of intensities by the square-root law, as one of amplitudes.

    Straight lines bend: each is cut into 16, so that amplitudes are within a thousandth.
    """
    times, values = signal.amplitude.times_s, signal.amplitude.values
    share = np.arange(_CUTS) / _CUTS
    cut_times = (times[:-1, None] + np.diff(times)[:, None] * share).ravel()
    cut_values = (values[:-1, None] + np.diff(values)[:, None] * share).ravel()
    return replace(
        signal,
        amplitude=Curve(np.append(cut_times, times[-1]), np.append(cut_values, values[-1]) ** 2.0),
        transients=tuple(replace(tick, amplitude=tick.amplitude**2) for tick in signal.transients),
    )


def document(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """Pattern of a signal's envelope; empty without one."""
    pattern: list[dict[str, Any]] = []
    sharpness = frequencies.share(signal.frequency_hz.values)
    constant = float(sharpness[0]) if np.ptp(sharpness) == 0.0 else None
    times = signal.amplitude.times_s
    for first, last in bursts(signal.amplitude):
        start, end = float(times[first]), float(times[last])
        count = max(1, int(np.ceil((end - start) / MAX_EVENT_S)))
        cuts = np.linspace(start, end, count + 1)
        for begin, stop in pairwise(cuts.tolist()):
            pattern.append(_continuous(begin, stop - begin, 1.0, constant or 0.0))
    controls: list[dict[str, Any]] = []
    if pattern:
        controls += _curve(INTENSITY_CONTROL, signal.amplitude)
        if constant is None:
            controls += _curve(SHARPNESS_CONTROL, Curve(signal.frequency_hz.times_s, sharpness))
    if pattern or signal.is_kept:
        pattern += _silent_end(signal, pattern)
    pattern += controls
    return _document(signal, frequencies, pattern)


def ticks(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """The ticks of a signal as a pattern."""
    pattern = [
        {
            "Event": {
                "Time": _rounded(tick.time_s),
                "EventType": "HapticTransient",
                "EventParameters": [
                    _parameter(INTENSITY, tick.amplitude),
                    _parameter(SHARPNESS, float(frequencies.share(tick.frequency_hz))),
                ],
            }
        }
        for tick in signal.transients
    ]
    if pattern and not (signal.amplitude.values > 0.0).any():
        pattern += _silent_end(signal, pattern)
    return _document(signal, frequencies, pattern)


def _silent_end(signal: Signal, pattern: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Silent events from the last one to the end of a signal: a loop keeps its length."""
    last = 0.0
    for event in (entry["Event"] for entry in pattern):
        last = max(last, event["Time"] + event.get("EventDuration", 0.0))
    end = _rounded(signal.duration_s)
    while end - last > _SHORTEST_S:
        length = min(end - last, MAX_EVENT_S)
        yield _continuous(last, length, 0.0, 0.0)
        last += length


def _continuous(time: float, duration: float, intensity: float, sharpness: float) -> dict[str, Any]:
    return {
        "Event": {
            "Time": _rounded(time),
            "EventType": "HapticContinuous",
            "EventDuration": _rounded(duration),
            "EventParameters": [_parameter(INTENSITY, intensity), _parameter(SHARPNESS, sharpness)],
        }
    }


def _document(
    signal: Signal, frequencies: FrequencyRange, pattern: list[dict[str, Any]]
) -> dict[str, Any]:
    return {
        "Version": 1.0,
        "Metadata": {
            **{key: clean(text) for key, text in signal.credits.others},
            "Project": clean(signal.credits.project) or _OWN_PROJECT,
            **({"Created": clean(signal.credits.created)} if signal.credits.created else {}),
            "Description": clean(signal.name),
            _RANGE_KEY: [frequencies.lowest_hz, frequencies.highest_hz],
        },
        "Pattern": pattern,
    }


def _parameter(name: str, value: float) -> dict[str, Any]:
    return {"ParameterID": name, "ParameterValue": round(value, 6)}


def _rounded(seconds: float) -> float:
    return round(float(seconds), 7)


def _curve(name: str, curve: Curve) -> Iterator[dict[str, Any]]:
    """Curve in chunks; each begins with the last point of the one before."""
    points = list(zip(curve.times_s.tolist(), curve.values.tolist(), strict=True))
    for first in range(0, max(len(points) - 1, 1), MAX_CURVE_POINTS - 1):
        chunk = points[first : first + MAX_CURVE_POINTS]
        start = _rounded(chunk[0][0])
        yield {
            "ParameterCurve": {
                "ParameterID": name,
                "Time": start,
                "ParameterCurveControlPoints": [
                    {
                        "Time": _rounded(max(time - start, 0.0)),
                        "ParameterValue": round(value, 6),
                    }
                    for time, value in chunk
                ],
            }
        }


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """The signal of a pattern; audio events are left out.

    Raises
    ------
    InputError
        It cannot be read or has errors.
    """
    found = parse(content, name)
    # Ours accepts what Apple's reader accepts; only a writer must keep the limits.
    lenient = ("DURATION", "DURATION-MISSING", "CURVE-ORDER", "ENTRY", "CHOICE", "MISSING")
    codes = {f"AHAP-{code}" for code in lenient}
    notes = refuse_but(findings(found), name, lambda each: each.code in codes)
    found = known_members(DOCUMENT, found)
    if any("[AHAP-MISSING]" in note for note in notes):
        found = completed(found)
        notes += refuse_but(findings(found), name, lambda each: each.code in codes)
    metadata = found.get("Metadata")
    frequencies = _range_of(metadata)
    entries = found["Pattern"]
    intensity = _control(entries, INTENSITY_CONTROL, 1.0)
    sharpness = _control(entries, SHARPNESS_CONTROL, 0.0)
    pieces: list[Piece] = []
    transients: list[Transient] = []
    strengths: dict[tuple[float, ...], Curve] = {}  # alike for events of one level
    has_ramps = False
    pitches: dict[float, Curve] = {}
    lost: Counter[str] = Counter()
    for entry in entries:
        event = entry.get("Event", {})
        _count_lost(entry, lost)
        kind, start = event.get("EventType"), float(event.get("Time", 0.0))
        values = {p["ParameterID"]: p["ParameterValue"] for p in event.get("EventParameters", [])}
        level = min(max(float(values.get(INTENSITY, 1.0)), 0.0), 1.0)
        pitch = min(max(float(values.get(SHARPNESS, 0.5)), 0.0), 1.0)
        if kind == "HapticTransient":
            amplitude = level * float(intensity.at(start))
            tone_hz = float(frequencies.hertz(pitch + float(sharpness.at(start))))
            transients.append(Transient(start, amplitude, tone_hz))
        elif kind == "HapticContinuous":
            duration = event.get("EventDuration")
            if duration is None:
                lost["continuous events without a duration"] += 1
                continue
            end = start + float(duration)
            shape = envelope(values, start, end)
            if shape is not None:
                has_ramps = True
                end = max(end, float(shape.times_s[-1]))
                strength = product(shape, intensity, level)
                strengths[start, end, len(pieces)] = strength
            else:
                if (level,) not in strengths:
                    strengths[level,] = Curve(intensity.times_s, level * intensity.values)
                strength = strengths[level,]
            if pitch not in pitches:
                shares = clipped(Curve(sharpness.times_s, pitch + sharpness.values), 0.0, 1.0)
                pitches[pitch] = Curve(shares.times_s, frequencies.hertz(shares.values))
            held = len(strengths) * len(intensity) + len(pitches) * len(sharpness)
            limits.OVERLAP.check(held, name, "its events and curves together have")
            pieces.append(Piece(start, end, strength, pitches[pitch]))
    title = metadata.get("Description") if isinstance(metadata, dict) else None
    label = title if isinstance(title, str) and title else Path(name).stem
    end = max((tick.time_s + _TRANSIENT_S for tick in transients), default=0.0)
    signal = mixed(label, pieces, transients, end)
    if isinstance(metadata, dict) and metadata.get(_LAW_KEY) == _SQUARE_ROOT:
        signal = _with_squares(signal)
    left_out = tuple(f"{count} {what}" for what, count in lost.items())
    if has_ramps:
        notes += ("attack, decay and release are straight ramps of so many seconds",)
    signal = replace(signal, credits=_credits_of(metadata))
    return [replace(signal, left_out=left_out + signal.left_out, notes=notes)], frequencies


def _credits_of(metadata: Any) -> Credits:
    """Statements of the metadata, without our own."""
    project = text_of(metadata, "Project")
    known = ("Project", "Created", "Description", _RANGE_KEY, _LAW_KEY)
    keys = metadata.keys() - set(known) if isinstance(metadata, dict) else ()
    others = tuple((key, text_of(metadata, key)) for key in sorted(keys))
    return Credits(
        project="" if project == _OWN_PROJECT else project,
        created=text_of(metadata, "Created"),
        others=tuple(credit for credit in others if credit[1]),
    )


held: Final = DEFAULT_RANGE.held
write_signals: Final = simplified_writer(write, SUFFIX, decode)


def with_ticks_beside(path: Path, signals: list[Signal]) -> list[Signal]:
    """Signals of a file, with the ticks of the pattern beside it that is played with it.

    Raises
    ------
    InputError
        The pattern cannot be read.
    """
    beside = path.with_name(path.name.removesuffix(SUFFIX) + TICKS_SUFFIX)
    if path.name.endswith(TICKS_SUFFIX) or not beside.is_file():
        return signals
    return [with_ticks_of(read_bytes(beside), str(beside), signals[0]), *signals[1:]]


def with_ticks_of(content: bytes, name: str, signal: Signal) -> Signal:
    """A signal with the ticks of the pattern that is played with it.

    Raises
    ------
    InputError
        The pattern cannot be read.
    """
    (ticking,), _ = decode(content, name)
    left_out, notes = ticking.left_out, ticking.notes
    if (ticking.amplitude.values > 0.0).any():
        left_out += (f"{Path(name).name}: has more than ticks, which are all that is taken",)
    return replace(
        signal,
        transients=tuple(
            sorted((*signal.transients, *ticking.transients), key=attrgetter("time_s"))
        ),
        left_out=signal.left_out + left_out,
        notes=(*signal.notes, *notes, f"read with {Path(name).name} beside it"),
    )


def _count_lost(entry: dict[str, Any], lost: Counter[str]) -> None:
    """Count the parts of an entry that :func:`decode` does not play."""
    event = entry.get("Event")
    if event is not None and event.get("EventType") not in ("HapticTransient", "HapticContinuous"):
        lost[f"events of the kind {str(event.get('EventType'))[:40]}"] += 1
    elif event is not None:
        for parameter in event.get("EventParameters", []):
            value = parameter["ParameterValue"]
            is_ramp = parameter["ParameterID"] in RAMPS and event["EventType"] == "HapticContinuous"
            if is_ramp:
                continue
            if parameter["ParameterID"] not in (INTENSITY, SHARPNESS):
                lost[f"parameters {parameter['ParameterID']} of events"] += 1
            elif not 0.0 <= value <= 1.0:
                lost[
                    f"values of {parameter['ParameterID']} beyond 0 to 1, taken as the nearest"
                ] += 1
    for key in ("Parameter", "ParameterCurve"):
        found = entry.get(key, {})
        control = found.get("ParameterID", INTENSITY_CONTROL)
        if control not in _CONTROLS:
            lost[f"changes of {control}"] += 1
            continue
        lowest, highest = _CONTROLS[control]
        points = found.get("ParameterCurveControlPoints", [found] if found else [])
        beyond = sum(not lowest <= point["ParameterValue"] <= highest for point in points)
        if beyond:
            what = f"values of {control} beyond {lowest:g} to {highest:g}, taken as the nearest"
            lost[what] += beyond


def _range_of(metadata: Any) -> FrequencyRange:
    found = metadata.get(_RANGE_KEY) if isinstance(metadata, dict) else None
    if isinstance(found, list) and len(found) == 2:
        low, high = found
        if all(isinstance(each, int | float) for each in found) and 0 <= low <= high <= 10_000:
            return FrequencyRange(float(low), float(high))
    return DEFAULT_RANGE


def _control(entries: list[dict[str, Any]], name: str, neutral: float) -> Curve:
    """All curves and single values of one control, one after the other."""
    points: list[tuple[float, float]] = [(0.0, neutral)]
    changes: list[tuple[float, list[tuple[float, float]]]] = []
    for entry in entries:
        single, curve = entry.get("Parameter"), entry.get("ParameterCurve")
        if single is not None and single["ParameterID"] == name:
            changes.append((single["Time"], [(single["Time"], single["ParameterValue"])]))
        if curve is not None and curve["ParameterID"] == name:
            start = curve["Time"]
            control_points = [
                (start + point["Time"], point["ParameterValue"])
                for point in sorted(curve["ParameterCurveControlPoints"], key=lambda p: p["Time"])
            ]
            changes.append((start, control_points))
    for start, control_points in sorted(changes, key=lambda change: change[0]):
        # A later curve takes over; times are rounded to 0.1 us.
        while len(points) > 1 and points[-1][0] > start + 1e-6:
            points.pop()
        points.append((max(start, points[-1][0]), points[-1][1]))  # held until then
        points += [(max(time, start), value) for time, value in control_points]
    times, values = np.array(points, np.float64).T
    return Curve(np.maximum.accumulate(times), np.clip(values, *_CONTROLS[name]))
