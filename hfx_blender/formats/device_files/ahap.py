# SPDX-License-Identifier: GPL-3.0-or-later
"""Apple AHAP: a haptic pattern, for the actuator of a phone.

Source: developer.apple.com, "Representing haptic patterns in AHAP files". Intensity is the share of
full scale; sharpness 0 to 1 spans the device's frequency range.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...errors import InputError
from ...files import limits
from ...files.findings import refuse_untolerated
from ...files.json_shapes import known_members
from ...files.strict_json import clean, parse, read_bytes, shown
from ..registry import FORMATS
from ..signals.curves import Curve, clipped
from ..signals.signals import (
    Credits,
    FrequencyRange,
    Piece,
    Signal,
    Transient,
    bursts,
    joined_times,
    mixed,
    text_of,
)
from ..signals.simplified_writer import simplified_writer
from ..written import Written, part_path, rounded_s, silent_note, write_json
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
"""Suffix of the companion pattern with the ticks, played together with the pattern."""

DEFAULT_RANGE: Final = FrequencyRange(80.0, 230.0, is_stated=False)
"""Approximate frequencies of sharpness 0 and 1 on a phone, for files that state none."""

_OWN_PROJECT: Final = "HFX"
_RANGE_KEY: Final = "HfxFrequencyRangeHz"  # Core Haptics ignores unknown keys
_LAW_KEY: Final = "HfxIntensityLaw"  # of amplitude to intensity
_LINEAR: Final = "linear"

_CONTROLS: Final = {INTENSITY_CONTROL: (0.0, 1.0), SHARPNESS_CONTROL: (-1.0, 1.0)}
_SHORTEST_S: Final = 1e-3  # silence at the end, seconds
_TRANSIENT_S: Final = 0.02  # duration of a tick, for the end of a pattern of ticks
_RAMPS: Final = ("AttackTime", "DecayTime", "ReleaseTime", "Sustained")
_LONGEST_RAMP_S: Final = 60.0
_PARTS: Final = 4  # straight pieces for the product of two ramps


def write(signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path) -> Written:
    """Write a pattern per audible signal: ``stem.<name>.ahap``. Curves modulate the whole pattern,
    ticks included. The ticks of a signal with an envelope are therefore a second pattern,
    ``stem.<name>.transients.ahap``, to be played with the first."""
    files: list[Path] = []
    for signal in signals:
        for suffix, content in (
            (SUFFIX, document(signal, frequencies)),
            (TICKS_SUFFIX, ticks(signal, frequencies)),
        ):
            if content["Pattern"]:
                files.append(part_path(stem, signal.name, suffix))
                # Converters of Meta and Lofelt store the square root of the amplitude; the key
                # states this file's law for reading.
                content["Metadata"][_LAW_KEY] = _LINEAR
                write_json(content, files[-1])
    return Written(
        tuple(files), notes=silent_note([signal.name for signal in signals if signal.is_silent])
    )


def document(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """AHAP document of a signal's envelope without its ticks; see :func:`ticks`. Events last 30 s
    at most and are silent in the rest of the signal; a changing frequency is a sharpness curve.
    ``Pattern`` is empty for a silent signal without ``is_kept``."""
    pattern: list[dict[str, Any]] = []
    sharpness = frequencies.share(signal.frequency_hz.values)
    constant = float(sharpness[0]) if np.ptp(sharpness) == 0.0 else None
    times = signal.amplitude.times_s
    for first, last in bursts(signal.amplitude):
        start, end = float(times[first]), float(times[last])
        count = max(1, int(np.ceil((end - start) / MAX_EVENT_S)))
        cuts = np.linspace(start, end, count + 1)
        # An event lasts 30 s at most: longer stretches are several events without gaps.
        for begin, stop in pairwise(cuts.tolist()):
            # Full intensity: controls multiply, so the control curve alone is the envelope.
            pattern.append(_continuous(begin, stop - begin, 1.0, constant or 0.0))
    controls: list[dict[str, Any]] = []
    if pattern:
        controls += _curve(INTENSITY_CONTROL, signal.amplitude)
        # The sharpness control adds to the event's sharpness, so it is only used for
        # changing frequencies, on events of sharpness 0.
        if constant is None:
            controls += _curve(SHARPNESS_CONTROL, Curve(signal.frequency_hz.times_s, sharpness))
    if pattern or signal.is_kept:
        pattern += _silent_end(signal, pattern)
    pattern += controls
    return _document(signal, frequencies, pattern)


def ticks(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """AHAP document of a signal's ticks; ``Pattern`` is empty without ticks. Without an envelope,
    silent events are added up to the signal's end."""
    pattern = [
        {
            "Event": {
                "Time": rounded_s(tick.time_s),
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
    """Yield silent events from the end of the last event of ``pattern`` to the signal's end, so
    loops keep their length; each 30 s at most, none for a rest of 1 ms or less."""
    last = 0.0
    for event in (entry["Event"] for entry in pattern):
        last = max(last, event["Time"] + event.get("EventDuration", 0.0))
    end = rounded_s(signal.duration_s)
    while end - last > _SHORTEST_S:
        length = min(end - last, MAX_EVENT_S)
        yield _continuous(last, length, 0.0, 0.0)
        last += length


def _continuous(time: float, duration: float, intensity: float, sharpness: float) -> dict[str, Any]:
    """Continuous event; ``time`` and ``duration`` in s, intensity and sharpness 0 to 1."""
    return {
        "Event": {
            "Time": rounded_s(time),
            "EventType": "HapticContinuous",
            "EventDuration": rounded_s(duration),
            "EventParameters": [_parameter(INTENSITY, intensity), _parameter(SHARPNESS, sharpness)],
        }
    }


def _document(
    signal: Signal, frequencies: FrequencyRange, pattern: list[dict[str, Any]]
) -> dict[str, Any]:
    """AHAP document of ``pattern``, with version 1 and metadata: the signal's name, its credits,
    and the range of frequencies; project "HFX" for a signal without a project."""
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
    """Event parameter ``name`` with its value rounded to 6 decimals, as JSON."""
    return {"ParameterID": name, "ParameterValue": round(value, 6)}


def _curve(name: str, curve: Curve) -> Iterator[dict[str, Any]]:
    """Yield ParameterCurve entries of at most 16 points for the control ``name``; consecutive
    entries share a point."""
    points = list(zip(curve.times_s.tolist(), curve.values.tolist(), strict=True))
    # The control keeps its value between two curves. A shared point makes the value at the start
    # of a curve equal to the value held, so no jump is played.
    for first in range(0, max(len(points) - 1, 1), MAX_CURVE_POINTS - 1):
        chunk = points[first : first + MAX_CURVE_POINTS]
        start = rounded_s(chunk[0][0])
        yield {
            "ParameterCurve": {
                "ParameterID": name,
                "Time": start,
                "ParameterCurveControlPoints": [
                    {"Time": rounded_s(max(time - start, 0.0)), "ParameterValue": round(value, 6)}
                    for time, value in chunk
                ],
            }
        }


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode a pattern to a list of one signal, and the frequency range; audio events are left out.
    Losses are in ``left_out``, tolerated faults in ``notes``. Raises InputError for an unreadable
    file, errors not tolerated by Core Haptics, or a law of intensity other than linear."""
    document = parse(content, name)
    # Apple's reader accepts these faults; the limits bind writers only.
    lenient = ("DURATION", "DURATION-MISSING", "CURVE-ORDER", "ENTRY", "CHOICE", "MISSING")
    codes = {f"AHAP-{code}" for code in lenient}
    notes = refuse_untolerated(findings(document), name, lambda each: each.code in codes)
    document = known_members(DOCUMENT, document)
    # A missing member ends the check before the rules of values: the completed document is checked
    # again.
    if any("[AHAP-MISSING]" in note for note in notes):
        document = completed(document)
        notes += refuse_untolerated(findings(document), name, lambda each: each.code in codes)
    metadata = document.get("Metadata")
    if not isinstance(metadata, dict):
        metadata = {}  # the rules allow metadata of any type
    law = metadata.get(_LAW_KEY, _LINEAR)
    if law != _LINEAR:
        raise InputError(
            f"{name}: Metadata: '{_LAW_KEY}' is {shown(law)}, allowed is '{_LINEAR}'; export the "
            "scene again with 'hfx export SCENE.blend -f ahap --device NAME'."
        )
    frequencies = _range_of(metadata)
    entries = document["Pattern"]
    intensity = _control(entries, INTENSITY_CONTROL, 1.0)
    sharpness = _control(entries, SHARPNESS_CONTROL, 0.0)
    pieces: list[Piece] = []
    transients: list[Transient] = []
    strengths: dict[tuple[float, ...], Curve] = {}  # shared by events of one level
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
            # Controls act on the whole pattern: a tick takes their values at its start.
            amplitude = level * float(intensity.at(start))
            tone_hz = float(frequencies.hertz(pitch + float(sharpness.at(start))))
            transients.append(Transient(start, amplitude, tone_hz))
        elif kind == "HapticContinuous":
            duration = event.get("EventDuration")
            if duration is None:
                lost["continuous events without a duration"] += 1
                continue
            end = start + float(duration)
            # Events of equal level or sharpness share one product curve: a pattern may have
            # thousands of events under a control curve with thousands of points.
            shape = _envelope(values, start, end)
            if shape is not None:
                has_ramps = True
                end = max(end, float(shape.times_s[-1]))
                # The product of two ramps is a parabola. Four straight pieces in each interval
                # between keyframes of both are within 1/64 of the product of the rises.
                knots = joined_times([shape, intensity], start, float(shape.times_s[-1]))
                steps = np.arange(_PARTS * (len(knots) - 1) + 1) / _PARTS
                times = np.interp(steps, np.arange(len(knots)), knots)
                strength = Curve(times, level * shape.at(times) * intensity.at(times))
                # Never shared, as a shape depends on the event's own times; stored for the count of
                # keyframes.
                strengths[start, end, len(pieces)] = strength
            else:
                if (level,) not in strengths:
                    strengths[level,] = Curve(intensity.times_s, level * intensity.values)
                strength = strengths[level,]
            if pitch not in pitches:
                shares = clipped(Curve(sharpness.times_s, pitch + sharpness.values), 0.0, 1.0)
                pitches[pitch] = Curve(shares.times_s, frequencies.hertz(shares.values))
            keyframe_count = len(strengths) * len(intensity) + len(pitches) * len(sharpness)
            limits.OVERLAP.check(keyframe_count, name, "its events and curves together have")
            pieces.append(Piece(start, end, strength, pitches[pitch]))
    title = metadata.get("Description")
    label = title if isinstance(title, str) and title else Path(name).stem
    end = max((tick.time_s + _TRANSIENT_S for tick in transients), default=0.0)
    signal = mixed(label, pieces, transients, end)
    left_out = tuple(f"{count} {loss}" for loss, count in lost.items())
    if has_ramps:
        notes += ("attack, decay and release are straight ramps of so many seconds",)
    left_out += signal.left_out
    signal = replace(signal, credits=_credits_of(metadata), left_out=left_out, notes=notes)
    return [signal], frequencies


def _credits_of(metadata: dict[str, Any]) -> Credits:
    """Project, creation date and further texts of metadata, without HFX's own entries, which each
    writer makes again."""
    project = text_of(metadata, "Project")
    known = ("Project", "Created", "Description", _RANGE_KEY, _LAW_KEY)
    others = tuple((key, text_of(metadata, key)) for key in sorted(metadata.keys() - set(known)))
    return Credits(
        project="" if project == _OWN_PROJECT else project,
        created=text_of(metadata, "Created"),
        others=tuple(entry for entry in others if entry[1]),
    )


def _envelope(parameters: Mapping[str, float], start_s: float, end_s: float) -> Curve | None:
    """Shape of an event, 0 to 1, to the end of the release; None for a constant event.

    Times of ``parameters`` are clipped to 0..60 s; an attack beyond ``end_s`` stops at its level
    there. Sustained (at least 0.5, or without attack and decay): release after ``end_s``; otherwise
    decay after the attack, then 0 until ``end_s``. Source: developer.apple.com,
    CHHapticEvent.ParameterID.
    """
    attack, decay, release = (
        min(max(float(parameters.get(name, 0.0)), 0.0), _LONGEST_RAMP_S) for name in _RAMPS[:3]
    )
    is_sustained = float(parameters.get("Sustained", 1.0)) >= 0.5 or attack + decay <= 0.0
    if end_s <= start_s or (is_sustained and attack + release <= 0.0):
        return None
    # An attack longer than the event is cut off at the level reached.
    top = min(start_s + attack, end_s)
    level = (top - start_s) / attack if attack > 0.0 else 1.0
    points = [(start_s, 0.0)] if attack > 0.0 else []
    points.append((top, level))
    if is_sustained:
        points.append((end_s, level))
        if release > 0.0:
            points.append((end_s + release, 0.0))
    else:
        if decay > 0.0:
            points.append((top + decay, 0.0))
        points.append((max(points[-1][0], end_s), 0.0))
    times, values = np.array(points, np.float64).T
    return Curve(times, values)


held: Final = DEFAULT_RANGE.held
write_signals: Final = simplified_writer(write, SUFFIX, decode)


def with_companion_ticks(path: Path, signals: list[Signal]) -> list[Signal]:
    """Add the ticks of ``<name>.transients.ahap`` in the same folder to the first signal, by time.
    Without this file, and for such a file itself, the signals are returned unchanged. An envelope
    of the companion is reported in ``left_out``. Raises InputError for an unreadable companion."""
    companion = path.with_name(path.name[: -len(SUFFIX)] + TICKS_SUFFIX)
    if path.name.lower().endswith(TICKS_SUFFIX) or not companion.is_file():
        return signals
    (ticking,), _ = decode(read_bytes(companion), str(companion))
    left_out, signal = ticking.left_out, signals[0]
    if (ticking.amplitude.values > 0.0).any():
        left_out += (f"{companion.name}: only the ticks are taken",)
    all_ticks = sorted((*signal.transients, *ticking.transients), key=attrgetter("time_s"))
    first = replace(
        signal,
        transients=tuple(all_ticks),
        left_out=signal.left_out + left_out,
        notes=(*signal.notes, *ticking.notes, f"read with {companion.name} beside it"),
    )
    return [first, *signals[1:]]


def _count_lost(entry: dict[str, Any], lost: Counter[str]) -> None:
    """Count in ``lost`` the parts of an entry ignored or clipped by :func:`decode`."""
    event = entry.get("Event")
    if event is not None and event.get("EventType") not in ("HapticTransient", "HapticContinuous"):
        lost[f"events of the kind {str(event.get('EventType'))[:40]}"] += 1
    elif event is not None:
        for parameter in event.get("EventParameters", []):
            name, value = parameter["ParameterID"], parameter["ParameterValue"]
            if name in _RAMPS and event["EventType"] == "HapticContinuous":
                continue
            if name not in (INTENSITY, SHARPNESS):
                lost[f"parameters {name} of events"] += 1
            elif not 0.0 <= value <= 1.0:
                lost[f"values of {name} beyond 0 to 1, taken as the nearest"] += 1
    for key in ("Parameter", "ParameterCurve"):
        control_change = entry.get(key, {})
        control = control_change.get("ParameterID", INTENSITY_CONTROL)
        if control not in _CONTROLS:
            lost[f"changes of {control}"] += 1
            continue
        lowest, highest = _CONTROLS[control]
        # A single value has the members of a control point.
        points = control_change.get(
            "ParameterCurveControlPoints", [control_change] if control_change else []
        )
        beyond = sum(not lowest <= point["ParameterValue"] <= highest for point in points)
        if beyond:
            loss = f"values of {control} beyond {lowest:g} to {highest:g}, taken as the nearest"
            lost[loss] += beyond


def _range_of(metadata: dict[str, Any]) -> FrequencyRange:
    """Frequency range stated by HFX's metadata; the default if missing or not within 10 kHz."""
    hertz = metadata.get(_RANGE_KEY)
    if isinstance(hertz, list) and len(hertz) == 2:
        low, high = hertz
        if all(isinstance(number, int | float) for number in hertz) and 0 <= low <= high <= 10_000:
            return FrequencyRange(float(low), float(high))
    return DEFAULT_RANGE


def _control(entries: list[dict[str, Any]], name: str, neutral: float) -> Curve:
    """Control curve of all curves and single values named ``name``, clipped to its range.
    ``neutral`` from 0 s to the first value; a later curve replaces the rest of an earlier curve;
    the last value is held between curves."""
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
        # A later curve replaces the rest of an earlier curve; 1 us covers the rounding of times.
        while len(points) > 1 and points[-1][0] > start + 1e-6:
            points.pop()
        points.append((max(start, points[-1][0]), points[-1][1]))  # hold the last value
        points += [(max(time, start), value) for time, value in control_points]
    times, values = np.array(points, np.float64).T
    return Curve(np.maximum.accumulate(times), np.clip(values, *_CONTROLS[name]))
