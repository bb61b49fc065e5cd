# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenXR parametric vibration (XR_EXT_haptic_parametric) as JSON.

The extension defines no file format. Each frame of a file is the content of an
``XrHapticParametricVibrationEXT``, to be passed to ``xrApplyHapticFeedback`` at time ``start``.
Member names and units (nanoseconds from the start of the frame, values 0 to 1) follow the
extension.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...files.findings import Finding, Report, json_validator, refuse_errors
from ...files.json_shapes import Items, Number, Record, Text, check
from ...files.strict_json import clean, parse
from ..registry import FORMATS
from ..signals.curves import Curve
from ..signals.signals import FrequencyRange, Signal, Transient, joined_times
from ..signals.simplified_writer import simplified_writer
from ..written import Written, silent_note, write_json

SUFFIX: Final = FORMATS["openxr"].suffix
FORMAT: Final = "hfx-openxr-parametric"
MAX_POINTS: Final = 500  # XR_HAPTIC_PARAMETRIC_MAX_POINTS_TRANSIENTS_EXT
MIN_HZ, MAX_HZ = 1.0, 1000.0  # XR_HAPTIC_PARAMETRIC_FREQUENCY_MIN_HZ_EXT, _MAX_HZ_EXT

_NS: Final = 1e9
_SHARE = Number(0.0, 1.0)
_TIME = Number(0, 2**62, is_whole=True)  # XrTime has 63 bits
_POINT = Record({"time": _TIME, "value": _SHARE})
_TICK = Record({"time": _TIME, "amplitude": _SHARE, "frequency": _SHARE})
_FRAME = Record(
    {
        "start": _TIME,
        "streamFrameType": Text(("NONE", "FIRST_FRAME", "INTERMEDIATE_FRAME", "LAST_FRAME")),
        "amplitudePoints": Items(_POINT, most=MAX_POINTS),
    },
    {
        "frequencyPoints": Items(_POINT, most=MAX_POINTS),
        "transients": Items(_TICK, most=MAX_POINTS),
    },
)
_DOCUMENT = Record(
    {
        "format": Text((FORMAT,)),
        "version": Number(1, 1, is_whole=True),
        "minFrequencyHz": Number(MIN_HZ, MAX_HZ),
        "maxFrequencyHz": Number(MIN_HZ, MAX_HZ),
        "channels": Items(Record({"actuator": Text(), "frames": Items(_FRAME)})),
    }
)


def write(signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path) -> Written:
    """Write all audible signals into one file, ``stem.openxr.json``; silent ones are noted."""
    silent = [signal.name for signal in signals if signal.is_silent]
    path = stem.with_name(stem.name + SUFFIX)
    write_json(document([signal for signal in signals if not signal.is_silent], frequencies), path)
    notes = tuple(note.replace("file", "channel") for note in silent_note(silent))
    return Written((path,), notes=notes)


def held(frequencies: FrequencyRange) -> FrequencyRange:
    """Frequency range clipped to the extension's 1 to 1000 Hz."""
    low = min(max(frequencies.lowest_hz, MIN_HZ), MAX_HZ)
    return FrequencyRange(low, min(max(frequencies.highest_hz, low), MAX_HZ))


def document(signals: Sequence[Signal], frequencies: FrequencyRange) -> dict[str, Any]:
    """JSON of signals, a channel with frames each; frequencies are clipped to 1 to 1000 Hz."""
    hertz = held(frequencies)
    return {
        "format": FORMAT,
        "version": 1,
        "minFrequencyHz": hertz.lowest_hz,
        "maxFrequencyHz": hertz.highest_hz,
        "channels": [
            {"actuator": clean(signal.name), "frames": list(_frames(signal, hertz))}
            for signal in signals
        ],
    }


def _frames(signal: Signal, hertz: FrequencyRange) -> Iterator[dict[str, Any]]:
    """Yield frames of a signal, each with at most 500 amplitude and frequency points. Frames share
    the point at their border; ticks belong to the frame beginning at their time."""
    ticks = sorted(signal.transients, key=lambda each: each.time_s)
    knots = np.unique(np.concatenate([signal.amplitude.times_s, [tick.time_s for tick in ticks]]))
    # A frame needs a duration.
    if len(knots) == 1:
        knots = np.append(knots, knots[0] + 0.001)
    pitch_times = signal.frequency_hz.times_s
    cuts, first = [float(knots[0])], 0
    while first < len(knots) - 1:
        last = min(first + MAX_POINTS - 1, len(knots) - 1)
        # Two of the frame's frequency points are its ends. While the pitch has too many keyframes
        # for the amplitude's span, the span is halved; a single piece is cut at pitch keyframes.
        begin = np.searchsorted(pitch_times, knots[first], side="right")
        while last > first + 1:
            end = np.searchsorted(pitch_times, knots[last], side="left")
            if end - begin <= MAX_POINTS - 2:
                break
            last = first + (last - first) // 2
        inside = pitch_times[begin : np.searchsorted(pitch_times, knots[last], side="left")]
        cuts += inside[MAX_POINTS - 2 :: MAX_POINTS - 2].tolist()
        cuts.append(float(knots[last]))
        first = last
    for k, (start, end) in enumerate(pairwise(cuts)):
        is_last = k == len(cuts) - 2
        amplitude = signal.amplitude
        times = joined_times([amplitude], start, end)
        levels = amplitude.at(times)
        # A step at the border is played by the next frame: here the value before the step ends.
        levels[-1] = amplitude.before(end)
        # Each frame is complete in itself, with values at its start and end.
        pitch = joined_times([signal.frequency_hz], start, end)
        shares = hertz.share(signal.frequency_hz.at(pitch))
        kind = "NONE" if len(cuts) == 2 else "FIRST_FRAME" if k == 0 else "INTERMEDIATE_FRAME"
        yield {
            "start": _ns(start),
            "streamFrameType": "LAST_FRAME" if is_last and len(cuts) > 2 else kind,
            "amplitudePoints": _points(times - start, levels),
            "frequencyPoints": _points(pitch - start, shares),
            "transients": [
                {
                    "time": _ns(tick.time_s - start),
                    "amplitude": round(tick.amplitude, 6),
                    "frequency": round(float(hertz.share(tick.frequency_hz)), 6),
                }
                for tick in ticks
                if start <= tick.time_s < end or (is_last and tick.time_s == end)
            ],
        }


def _ns(seconds: float) -> int:
    """Whole nanoseconds of ``seconds``; 0 for negative times."""
    return max(0, round(seconds * _NS))


def _points(times: Any, values: Any) -> list[dict[str, Any]]:
    """JSON points of arrays (n,): ``times`` (s from the frame's start) in whole nanoseconds, and
    ``values`` 0..1, rounded to 6 decimals."""
    return [
        {"time": _ns(time), "value": round(value, 6)}
        for time, value in zip(times.tolist(), values.tolist(), strict=True)
    ]


def _findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values."""
    report = Report("OPENXR")
    check(_DOCUMENT, document, report)
    if report.has_errors:
        return report.findings
    if document["minFrequencyHz"] > document["maxFrequencyHz"]:
        report.error("FREQUENCY-RANGE", None, "minFrequencyHz is above maxFrequencyHz")
    for k, channel in enumerate(document["channels"]):
        location = (((None, "channels"), k), "frames")
        kinds = [frame["streamFrameType"] for frame in channel["frames"]]
        # A stream of several frames is told to the runtime as first, intermediate and last.
        middle = ["INTERMEDIATE_FRAME"] * (len(kinds) - 2)
        if len(kinds) > 1 and kinds != ["FIRST_FRAME", *middle, "LAST_FRAME"]:
            message = "several frames are a FIRST_FRAME, INTERMEDIATE_FRAMEs and a LAST_FRAME"
            report.error("STREAM", location, message)
        if len(kinds) == 1 and kinds != ["NONE"]:
            report.error("STREAM", location, "a single frame has the type NONE")
        last = end = -1
        for i, frame in enumerate(channel["frames"]):
            if frame["start"] <= last or frame["start"] < end - 1:  # rounded
                message = f"begins at {frame['start']} ns, allowed is {end}, the last end, or later"
                report.error("ORDER", (location, i), message)
            last = end = frame["start"]
            for name in ("amplitudePoints", "frequencyPoints", "transients"):
                times = [point["time"] for point in frame.get(name, [])]
                end = max(end, *(last + time for time in times), last)
                if any(b < a for a, b in pairwise(times)):
                    report.error("POINT-ORDER", ((location, i), name), "its times descend")
    return report.findings


validate = json_validator(_findings)


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode a signal per channel and the frequency range; InputError for an invalid file."""
    document = parse(content, name)
    refuse_errors(_findings(document), name)
    hertz = FrequencyRange(float(document["minFrequencyHz"]), float(document["maxFrequencyHz"]))
    return [_signal(channel, hertz) for channel in document["channels"]], hertz


write_signals: Final = simplified_writer(write, SUFFIX, decode)


def _signal(channel: dict[str, Any], hertz: FrequencyRange) -> Signal:
    """Signal of a channel, with the frames joined and duplicate border points dropped. Amplitude 0
    without points, frequency 0.5 of the range without frequency points; a time before an earlier
    point's is raised to that."""
    amplitude: list[tuple[float, float]] = []
    pitch: list[tuple[float, float]] = []
    ticks = []
    for frame in channel["frames"]:
        start = frame["start"]
        # Frames repeat the point at their common border; the duplicate is dropped.
        for name, points in (("amplitudePoints", amplitude), ("frequencyPoints", pitch)):
            for point in frame.get(name, []):
                entry = ((start + point["time"]) / _NS, float(point["value"]))
                if not points or entry != points[-1]:
                    points.append(entry)
        for tick in frame.get("transients", []):
            frequency = float(hertz.hertz(tick["frequency"]))
            time = (start + tick["time"]) / _NS
            ticks.append(Transient(time, float(tick["amplitude"]), frequency))
    levels = np.array(amplitude or [(0.0, 0.0)], np.float64)
    shares = np.array(pitch or [(0.0, 0.5)], np.float64)
    return Signal(
        channel["actuator"],
        Curve(np.maximum.accumulate(levels[:, 0]), levels[:, 1]),
        Curve(np.maximum.accumulate(shares[:, 0]), hertz.hertz(shares[:, 1])),
        tuple(ticks),
    )
