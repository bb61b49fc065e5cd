# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of .he files: RichTap versions 1 and 2, and OpenHarmony's variant."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

from ...files.findings import Finding, Report, json_validator
from ...files.json_shapes import Anything, Items, Number, Record, Shape, Text, check, loose
from ...files.strict_json import Place

MAX_PATTERN_EVENTS: Final = 16
MAX_RELATIVE_MS: Final = 50_000
MAX_DURATION_MS: Final = 5_000
MIN_CURVE_POINTS: Final = 4
MAX_CURVE_POINTS: Final = 16
TRANSIENT_MS: Final = 48
"""Duration of a transient in players."""

OPENHARMONY_MAX_EVENTS: Final = 128
OPENHARMONY_MAX_START_MS: Final = 1_800_000
OPENHARMONY_MAX_BYTES: Final = 64 << 10

_PERCENT = Number(0, 100)
_POINT = Record(
    {"Time": Number(0, MAX_DURATION_MS, is_whole=True), "Intensity": Number(0.0, 1.0)},
    {"Frequency": Number(-100, 100)},
)
_PARAMETERS = Record({"Intensity": _PERCENT, "Frequency": _PERCENT}, {"Curve": Items(_POINT)})


def _event(time: str, most_ms: int, indexed: bool) -> Shape:
    """Shape of an event; ``time`` is the member with its time, 0 to ``most_ms``; the member
    ``Index`` is required if ``indexed``, else optional."""
    index = {"Index": Number(0, 2, is_whole=True)}
    return Record(
        {
            "Type": Text(("continuous", "transient")),
            time: Number(0, most_ms, is_whole=True),
            "Parameters": _PARAMETERS,
            **(index if indexed else {}),
        },
        {"Duration": Number(0, MAX_DURATION_MS, is_whole=True), **({} if indexed else index)},
    )


def _pattern(event: Shape) -> Items:
    """Shape of a list of objects with the member ``Event``."""
    return Items(Record({"Event": event}))


_METADATA = loose({"Version": Number(1, 2)}, dict.fromkeys(("Created", "Description"), Anything()))
_V1 = Record(
    {"Metadata": _METADATA, "Pattern": _pattern(_event("RelativeTime", MAX_RELATIVE_MS, False))}
)
_V2 = Record(
    {
        "Metadata": _METADATA,
        "PatternList": Items(
            Record(
                {
                    "AbsoluteTime": Number(0, 2**31 - 1, is_whole=True),
                    "Pattern": _pattern(_event("RelativeTime", MAX_RELATIVE_MS, True)),
                }
            )
        ),
    }
)
_OPENHARMONY = Record(
    {
        "MetaData": Record(
            {"Version": Number(1, 1), "ChannelNumber": Number(1, 3, is_whole=True)},
            {"Create": Anything(), "Description": Anything()},
        ),
        "Channels": Items(
            Record(
                {
                    "Parameters": Record({}, {"Index": Number(0, 2, is_whole=True)}),
                    "Pattern": _pattern(_event("StartTime", OPENHARMONY_MAX_START_MS, False)),
                }
            ),
            least=1,
            most=3,
        ),
    }
)


def shape_of(document: Any) -> Shape:
    """Shape of a document of any type by its members: MetaData or Channels: OpenHarmony, Pattern:
    version 1, otherwise version 2."""
    keys = document if isinstance(document, dict) else {}
    if "MetaData" in keys or "Channels" in keys:
        return _OPENHARMONY
    return _V1 if "Pattern" in keys else _V2


def findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values."""
    report = Report("HE")
    shape = shape_of(document)
    check(shape, document, report)
    if report.has_errors:
        return report.findings
    if shape is _OPENHARMONY:
        _check_openharmony(document, report)
    elif shape is _V1:
        if document["Metadata"]["Version"] != 1:
            report.error("VERSION", (None, "Metadata"), "a file with 'Pattern' is version 1")
        _check_events(document["Pattern"], (None, "Pattern"), report, is_first=True)
    else:
        _check_pattern_list(document, report)
    return report.findings


validate = json_validator(findings)


def _check_pattern_list(document: dict[str, Any], report: Report) -> None:
    """Report a version other than 2, patterns too early for players, and faults of events."""
    if document["Metadata"]["Version"] != 2:
        report.error("VERSION", (None, "Metadata"), "a file with 'PatternList' is version 2")
    pause = PatternSpacing()
    for k, entry in enumerate(document["PatternList"]):
        location = ((None, "PatternList"), k)
        start = entry["AbsoluteTime"]
        # The stricter player first: Android's refusal affects every phone.
        if k and start < pause.android_ms:
            message = (
                f"begins at {start} ms; Android's player refuses the whole file if that is before "
                f"{pause.android_ms} ms, when the last pattern has ended for it"
            )
            report.error("ABSOLUTE-TIME", location, message)
        elif k and start < pause.library_ms:
            message = (
                f"begins at {start} ms; versions of RichTap's library refuse the whole file if "
                f"that is before {pause.library_ms} ms: a tick lasts {TRANSIENT_MS} ms for them"
            )
            report.warn("TICK-TIME", location, message)
        _check_events(entry["Pattern"], (location, "Pattern"), report)
        events = [item["Event"] for item in entry["Pattern"]]
        pause.follow(
            start,
            [
                (
                    event["RelativeTime"],
                    event.get("Duration") if event["Type"] == "continuous" else None,
                )
                for event in events
            ],
        )


class PatternSpacing:
    """Earliest times of version 2 patterns for two kinds of players.

    Android's HapticPlayer adds the duration of the latest continuous event (of this pattern or an
    earlier pattern) to the relative time of the last event, and compares the sum with the next
    absolute time. In versions of RichTap's library a pattern ends with the last end of all events,
    transients lasting 48 ms. Both players refuse the whole file if a pattern begins earlier.
    """

    def __init__(self, last_duration_ms: int = 0) -> None:
        self.android_ms = self.library_ms = 0
        self._last_duration_ms = last_duration_ms

    @property
    def earliest_ms(self) -> int:
        """Earliest absolute time of the next pattern for both players, ms."""
        return max(self.android_ms, self.library_ms)

    def follow(self, start_ms: int, events: Sequence[tuple[int, int | None]]) -> None:
        """Advance past a pattern at ``start_ms`` with events (relative time, duration) in ms. A
        duration of None stands for a transient."""
        ends = [(time, TRANSIENT_MS if lasts is None else lasts) for time, lasts in events]
        self.library_ms = start_ms + max((sum(end) for end in ends), default=0)
        continuous = [(time, lasts) for time, lasts in events if lasts is not None]
        self._last_duration_ms = continuous[-1][1] if continuous else self._last_duration_ms
        last_ms = events[-1][0] if events else 0
        ended_ms = start_ms + max((time + lasts for time, lasts in continuous), default=0)
        self.android_ms = max(last_ms + self._last_duration_ms, ended_ms)

    def after(self, start_ms: int, events: Sequence[tuple[int, int | None]]) -> int:
        """Earliest absolute time, ms, of the pattern after the given pattern, without advancing."""
        trial = PatternSpacing(self._last_duration_ms)
        trial.follow(start_ms, events)
        return trial.earliest_ms


def _check_openharmony(document: dict[str, Any], report: Report) -> None:
    """Report more than 128 events, a wrong channel count, and faults of events."""
    count = sum(len(channel["Pattern"]) for channel in document["Channels"])
    if count > OPENHARMONY_MAX_EVENTS:
        message = f"{count} events, the most is {OPENHARMONY_MAX_EVENTS}"
        report.error("EVENTS", (None, "Channels"), message)
    if document["MetaData"]["ChannelNumber"] != len(document["Channels"]):
        message = (
            f"says {document['MetaData']['ChannelNumber']}, there are {len(document['Channels'])}"
        )
        report.error("CHANNELS", ((None, "MetaData"), "ChannelNumber"), message)
    for k, channel in enumerate(document["Channels"]):
        location = (((None, "Channels"), k), "Pattern")
        _check_events(channel["Pattern"], location, report, "StartTime", most=math.inf)


def _check_events(
    pattern: list[Any],
    place: Place,
    report: Report,
    time: str = "RelativeTime",
    *,
    most: float = MAX_PATTERN_EVENTS,
    is_first: bool = False,
) -> None:
    """Report more than ``most`` events, descending times, and faults of durations and curves.
    ``time`` is the member with the time of an event; ``is_first``: rules of version 1."""
    if len(pattern) > most:
        report.error("EVENTS", place, f"{len(pattern)} events, the most is {most}")
    last = 0
    for k, entry in enumerate(pattern):
        event, here = entry["Event"], ((place, k), "Event")
        if event[time] < last:
            report.error("ORDER", here, f"begins at {event[time]} ms, before the event before")
        last = max(last, event[time])
        curve = event["Parameters"].get("Curve")
        if event["Type"] == "transient":
            if curve:
                report.error("TRANSIENT-CURVE", here, "a transient has no curve")
        elif "Duration" not in event:
            report.error("DURATION", here, "a continuous event has a Duration")
        elif curve is not None:
            # A curve has 4 to 16 ascending points from 0 to the duration; in version 1 both ends
            # have intensity 0. An empty curve has a single error.
            if not MIN_CURVE_POINTS <= len(curve) <= MAX_CURVE_POINTS:
                message = (
                    f"{len(curve)} points, allowed are {MIN_CURVE_POINTS} to {MAX_CURVE_POINTS}"
                )
                report.error("CURVE-POINTS", here, message)
            if not curve:
                continue
            if any(b["Time"] < a["Time"] for a, b in pairwise(curve)):
                report.error("CURVE-ORDER", here, "the times of its curve descend")
            duration = event["Duration"]
            if curve[0]["Time"] != 0 or curve[-1]["Time"] != duration:
                message = f"its curve must go from 0 to its duration ({duration} ms)"
                report.error("CURVE-ENDS", here, message)
            if is_first and (curve[0]["Intensity"] != 0 or curve[-1]["Intensity"] != 0):
                message = "in version 1 a curve begins and ends with intensity 0"
                report.error("CURVE-ZERO", here, message)
