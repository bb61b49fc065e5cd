# SPDX-License-Identifier: GPL-3.0-or-later
"""RichTap .he, versions 1 and 2, and OpenHarmony's variant: events with short curves.

Sources: AOSP's HapticPlayer.java (RichTap's own parser on phones), OpenHarmony's vibrator
guidelines, files of RichTap Creator Pro. Times are whole milliseconds, frequencies 0 to 100 of the
device's range. A curve has at most 16 points, so a signal becomes many events.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...errors import InputError
from ...files.findings import refuse_untolerated
from ...files.json_shapes import known_members
from ...files.strict_json import clean, encoded, parse
from ...text import counted
from ..registry import FORMATS
from ..signals import losses
from ..signals.curves import Curve, clipped
from ..signals.signals import (
    DEFAULT_TOLERANCE,
    Credits,
    FrequencyRange,
    Piece,
    Signal,
    Transient,
    mixed,
    simplified_signals,
    text_of,
)
from ..signals.simplified_writer import WHOLE_MS, simplified_writer, write_audible
from ..written import Written
from .he_events import HeEvent, event_entry, events_of, patterns_of, silent_end
from .he_rules import (
    MAX_PATTERN_EVENTS,
    MAX_RELATIVE_MS,
    OPENHARMONY_MAX_BYTES,
    OPENHARMONY_MAX_EVENTS,
    OPENHARMONY_MAX_START_MS,
    TRANSIENT_MS,
    findings,
    shape_of,
)

SUFFIX: Final = FORMATS["he"].suffix
V1_SUFFIX: Final = FORMATS["he1"].suffix
OPENHARMONY_SUFFIX: Final = FORMATS["openharmony"].suffix
DEFAULT_RANGE: Final = FrequencyRange(50.0, 250.0, is_stated=False)
"""Approximate frequencies of 0 and 100 on a phone, for files that state none."""

_MOST: Final = 1e6  # clips strengths and frequencies of foreign files
_COARSEST: Final = 0.1  # largest tolerance, a share of full scale; a larger one is refused
_COARSER: Final = 1.5
_RANGE_TEXT: Final = "0 to 100 is {:g} to {:g} Hz"
_TOLERATED: Final = tuple(
    f"'{key}' is missing" for key in ("Index", "Metadata", "MetaData", "Version", "ChannelNumber")
)
_SIDES: Final = {1: "left", 2: "right"}  # by actuator index; 0 plays on both sides


def write(signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path) -> Written:
    """Write version 2: one file per audible signal, ``stem.<name>.he``, with consecutive events."""
    delayed_names = [
        signal.name
        for signal in signals
        if any(
            group[0].start_ms < start
            for start, group in patterns_of(events_of(signal, frequencies, falls_to_zero=False))
        )
    ]
    text = f"ticks closer than {TRANSIENT_MS} ms come up to that later between two patterns"
    written = _write(signals, stem, SUFFIX, lambda each: document(each, frequencies))
    return written + Written((), counted(delayed_names, text))


def write_v1(
    signals: Sequence[Signal],
    frequencies: FrequencyRange,
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write version 1: at most 16 events in 50 s, beginning and ending at 0.

    Signals are not simplified beforehand: the tolerance grows up to a tenth of full scale until a
    signal fits. Signals without a fit are in ``left_out``; if none fits, InputError is raised and
    no file written.
    """

    def build(signal: Signal) -> dict[str, Any] | None:
        events = events_of(signal, frequencies, falls_to_zero=True)
        # Silence at the end keeps the length of loops, and is dropped first where events are few.
        events = _with_end(signal, events, MAX_PATTERN_EVENTS, MAX_RELATIVE_MS)
        if len(events) > MAX_PATTERN_EVENTS or any(e.start_ms > MAX_RELATIVE_MS for e in events):
            return None
        return {
            "Metadata": _metadata(signal, frequencies, 1),
            "Pattern": [{"Event": event_entry(event, event.start_ms)} for event in events],
        }

    limit = f"{MAX_PATTERN_EVENTS} events within {MAX_RELATIVE_MS // 1000} s; version 2 holds more"
    written = _write_fitting(
        signals, stem, V1_SUFFIX, tolerance, build, f".he version 1 holds {limit}"
    )
    return written + Written(notes=("between two events there are up to 2 ms of silence",))


def write_openharmony(
    signals: Sequence[Signal],
    frequencies: FrequencyRange,
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write OpenHarmony's variant, at most 128 events within 30 min and 64 KiB a file. Tolerance,
    ``left_out`` and InputError as of :func:`write_v1`."""

    def build(signal: Signal) -> dict[str, Any] | None:
        events = events_of(signal, frequencies, falls_to_zero=False)
        most = OPENHARMONY_MAX_EVENTS // 2  # half, as the file size is limited too
        events = _with_end(signal, events, most, OPENHARMONY_MAX_START_MS)
        if len(events) > OPENHARMONY_MAX_EVENTS:
            return None
        if any(event.start_ms > OPENHARMONY_MAX_START_MS for event in events):
            return None
        entries = []
        for event in events:
            entry = event_entry(event, event.start_ms)
            entry["StartTime"] = entry.pop("RelativeTime")
            entries.append({"Event": entry})
        version_1 = _metadata(signal, frequencies, 1)
        content = {
            "MetaData": {
                "Version": 1.0,
                "ChannelNumber": 1,
                "Create": version_1["Created"],
                "Description": version_1["Description"],
            },
            "Channels": [{"Parameters": {"Index": 0}, "Pattern": entries}],
        }
        # The limit of the system is on bytes of the file, known only after encoding.
        return content if len(encoded(content)) <= OPENHARMONY_MAX_BYTES else None

    limit = f"{OPENHARMONY_MAX_EVENTS} events and {OPENHARMONY_MAX_BYTES >> 10} KiB"
    title = f"an OpenHarmony pattern holds {limit}"
    return _write_fitting(signals, stem, OPENHARMONY_SUFFIX, tolerance, build, title)


def _with_end(signal: Signal, events: list[HeEvent], most: int, latest_ms: int) -> list[HeEvent]:
    """Events with silence up to the signal's end; the events alone if that breaks a limit. Limits:
    ``most`` events, starting at ``latest_ms`` or before."""
    whole = [*events, *silent_end(signal, events)]
    is_held = len(whole) <= most and all(event.start_ms <= latest_ms for event in whole)
    return whole if is_held else events


def document(signal: Signal, frequencies: FrequencyRange) -> dict[str, Any]:
    """Version 2 document of a signal, with silence up to its end."""
    events = events_of(signal, frequencies, falls_to_zero=False)
    patterns = [
        {
            "AbsoluteTime": start,
            "Pattern": [
                {"Event": {**event_entry(e, max(e.start_ms - start, 0)), "Index": 0}} for e in group
            ],
        }
        for start, group in patterns_of([*events, *silent_end(signal, events)])
    ]
    return {"Metadata": _metadata(signal, frequencies, 2), "PatternList": patterns}


def _write(
    signals: Sequence[Signal], stem: Path, suffix: str, build: Callable[[Signal], Any]
) -> Written:
    """Write ``build(signal)`` as JSON per audible signal; notes on silent signals, weak ticks."""
    notes = []
    for signal in signals:
        weak = sum(0.0 < 100.0 * tick.amplitude <= 0.5 for tick in signal.transients)
        if weak:
            notes.append(f"'{signal.name}': {weak} ticks too weak for steps of 1 % are silent")
    return write_audible(signals, stem, suffix, build) + Written(notes=tuple(notes))


def _write_fitting(
    signals: Sequence[Signal],
    stem: Path,
    suffix: str,
    tolerance: float,
    build: Callable[[Signal], Any],
    limit: str,
) -> Written:
    """Write a file per audible signal, with the smallest of the tolerances that fits.

    ``build`` returns a document, or None beyond the limits; ``limit`` is a clause on the limits for
    messages. The tolerance grows by factors of 1.5 while it is at most 0.1; a ``tolerance`` above
    that is tried alone. Signals without a fit are in ``left_out``; InputError if none fits.
    """
    documents: dict[str, Any] = {}
    notes = []
    refused: list[str] = []
    dense, simple = [], []
    for signal in signals:
        if signal.is_silent:
            continue  # reported by _write
        # A coarser curve has fewer points, and so fewer events.
        value, content = tolerance, None
        while content is None and value <= max(_COARSEST, tolerance):
            (few,) = simplified_signals([signal], value)
            content = build(few)
            if content is not None and value > tolerance:
                notes.append(f"'{signal.name}': {limit}, so kept within {value:.1%}")
            value *= _COARSER
        if content is None:
            refused.append(
                f"'{signal.name}': {limit}; this signal needs more even if simplified "
                f"to {_COARSEST:.0%} of full scale. Export a shorter range"
            )
            continue
        documents[signal.name] = content
        dense.append(signal)
        simple.append(few)
    # Some signals without a fit are a loss, all of them a failure.
    if refused and not documents:
        raise InputError(f"{refused[0]}.")
    written_signals = [each for each in signals if each.is_silent or each.name in documents]
    written = _write(written_signals, stem, suffix, lambda each: documents[each.name])
    within = f"curves are within {tolerance:.1%} of full scale, their times whole milliseconds"
    return written + Written((), tuple(refused), (within, *notes, *losses.silenced(dense, simple)))


def _metadata(signal: Signal, frequencies: FrequencyRange, version: int) -> dict[str, Any]:
    """Metadata with ``version``, creation date, and the description "NAME; 0 to 100 is LOW to HIGH
    Hz"."""
    hertz = _RANGE_TEXT.format(frequencies.lowest_hz, frequencies.highest_hz)
    return {
        "Version": version,
        "Created": clean(signal.credits.created),
        "Description": f"{clean(signal.name)}; {hertz}",
    }


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode the signals of a file of any version, and the frequency range.

    One signal without actuator indices, otherwise a signal per index, named left (1) and right (2);
    a silent signal for a file without events. Losses and notes are on the first signal. Raises
    InputError for an unreadable file or a wrong structure.
    """
    document = parse(content, name)
    # Phones play files beyond the editor's limits, so only the structure matters. Events without
    # an index play on both actuators.
    notes = refuse_untolerated(
        findings(document),
        name,
        lambda offset: (
            offset.code not in ("HE-TYPE", "HE-CHOICE", "HE-MISSING")
            or offset.message in _TOLERATED
        ),
    )
    document = known_members(shape_of(document), document)
    metadata = document.get("Metadata", document.get("MetaData", {}))
    title = metadata.get("Description")
    title = title if isinstance(title, str) else ""
    frequencies = _range_of(title)
    pieces: dict[int, list[Piece]] = {}
    ticks: dict[int, list[Transient]] = {}
    end_s = 0.0
    beyond = endless = 0
    for index, start_ms, event in _absolute_events(document):
        parameters = event["Parameters"]
        # A curve's frequencies are offsets from the event's, in hundredths of the range.
        hundredths = [
            parameters["Frequency"] + point.get("Frequency", 0)
            for point in parameters.get("Curve") or ()
        ]
        beyond += sum(not 0 <= percent <= 100 for percent in hundredths)
        # Sums of foreign values must stay finite; they are clipped to the range later.
        level, pitch = (
            min(max(float(parameters[key]), -_MOST), _MOST) for key in ("Intensity", "Frequency")
        )
        level /= 100.0
        start = start_ms / 1000.0
        if event["Type"] == "transient":
            hertz = float(frequencies.hertz(pitch / 100.0))
            tick = Transient(start, min(max(level, 0.0), 1.0), hertz)
            ticks.setdefault(index, []).append(tick)
            end_s = max(end_s, start)
        elif "Duration" not in event:
            endless += 1
        else:
            pieces.setdefault(index, []).append(_piece(event, start_ms, level, pitch, frequencies))
            end_s = max(end_s, pieces[index][-1].end_s)
    # HFX's own descriptions end with "; 0 to 100 is LOW to HIGH Hz".
    label = title.partition(";")[0] or Path(name).stem
    created = text_of(metadata, "Created") or text_of(metadata, "Create")
    signals = []
    for index in sorted({*pieces, *ticks}) or [0]:
        signal_name = f"{label} {_SIDES.get(index, str(index))}" if index else label
        signal = mixed(signal_name, pieces.get(index, []), ticks.get(index, []), end_s)
        signals.append(replace(signal, credits=Credits(created=created)))
    losses_of_file = {
        "frequencies of curves beyond 0 to 100, taken as the nearest": beyond,
        "continuous events without a duration": endless,
    }
    left_out = tuple(f"{count} {loss}" for loss, count in losses_of_file.items() if count)
    signals[0] = replace(signals[0], left_out=left_out + signals[0].left_out, notes=notes)
    return signals, frequencies


held: Final = DEFAULT_RANGE.held
write_signals: Final = simplified_writer(write, SUFFIX, decode, grid_s=WHOLE_MS)


def _absolute_events(document: dict[str, Any]) -> list[tuple[int, int, dict[str, Any]]]:
    """Events as (actuator index, ms from the file's start, event), in file order. The index is the
    event's, in OpenHarmony's files the channel's; 0 without."""
    if "Channels" in document:
        return [
            (channel["Parameters"].get("Index", 0), entry["Event"]["StartTime"], entry["Event"])
            for channel in document["Channels"]
            for entry in channel["Pattern"]
        ]
    # Version 1 is a single pattern from 0 ms.
    patterns = document.get(
        "PatternList", [{"AbsoluteTime": 0, "Pattern": document.get("Pattern", [])}]
    )
    return [
        (
            entry["Event"].get("Index", 0),
            pattern["AbsoluteTime"] + entry["Event"]["RelativeTime"],
            entry["Event"],
        )
        for pattern in patterns
        for entry in pattern["Pattern"]
    ]


def _piece(
    event: dict[str, Any], start_ms: int, level: float, pitch: float, frequencies: FrequencyRange
) -> Piece:
    """Piece of an event at ``start_ms``; constant ``level`` and ``pitch`` without a curve.
    ``level`` (1: full) scales and ``pitch`` (0 to 100) shifts the points of a curve, which may be
    in any order; shifted frequencies are clipped to the range."""
    curve = event["Parameters"].get("Curve")
    # Sums in milliseconds are exact, so that the end of an event is the start of the next.
    start, end = start_ms / 1000.0, (start_ms + event["Duration"]) / 1000.0
    if not curve:
        hertz = Curve.of([start], frequencies.hertz([pitch / 100]))
        return Piece(start, end, Curve.of([start], [level]), hertz)
    curve = sorted(curve, key=lambda point: point["Time"])
    times = np.array([start_ms + point["Time"] for point in curve], np.float64) / 1000.0
    # Foreign values are clipped far outside the range, so products stay finite; mixing clips to
    # full scale.
    levels = level * np.clip([float(point["Intensity"]) for point in curve], -_MOST, _MOST)
    offsets = np.clip([float(point.get("Frequency", 0)) for point in curve], -_MOST, _MOST)
    shares = clipped(Curve(times, (pitch + offsets) / 100.0), 0.0, 1.0)
    hertz = Curve(shares.times_s, frequencies.hertz(shares.values))
    return Piece(start, end, Curve(times, levels), hertz)


def _range_of(description: str) -> FrequencyRange:
    """Range of "...; 0 to 100 is LOW to HIGH Hz" in a description, or ``DEFAULT_RANGE``."""
    words = description.rpartition(";")[2].split()
    try:
        if words[:4] == ["0", "to", "100", "is"] and words[5:8:2] == ["to", "Hz"]:
            return FrequencyRange(float(words[4]), float(words[6]))
    except (ValueError, IndexError):
        pass  # a foreign description without a range
    return DEFAULT_RANGE
