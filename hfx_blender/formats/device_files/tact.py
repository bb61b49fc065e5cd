# SPDX-License-Identifier: GPL-3.0-or-later
"""bHaptics .tact: dots of a vest or of sleeves, switched every 20 ms.

Source: haptic-library ``src/ProjectModel.cpp`` (the player's own parser). Strengths are constant
between switches; there is no frequency.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.raster import Raster
from ...errors import InputError
from ...files import limits
from ...files.findings import Finding, Report, json_validator, refuse_untolerated, without_nulls
from ...files.json_shapes import (
    Anything,
    Flag,
    Items,
    Number,
    Record,
    Table,
    Text,
    check,
    known_members,
    loose,
)
from ...files.strict_json import Place, clean, parse
from ...text import counted
from ..registry import FORMATS
from ..signals import losses
from ..signals.curves import Curve
from ..signals.signals import (
    Credits,
    FrequencyRange,
    Piece,
    Signal,
    mixed,
    signals_of,
    stretches,
    text_of,
)
from ..written import Written, part_path, write_json
from .tact_layouts import LAYOUTS, MAX_DOTS, Motor, motors_of, why_nothing

SUFFIX: Final = FORMATS["tact"].suffix
DEFAULT_RANGE: Final = FrequencyRange(100.0, 100.0, is_stated=False)
"""Approximate frequency of a vest's motors, which depends on their strength."""

_GAP_MS: Final = 500  # longest silence within an effect
INTERVAL_MS: Final = 20
_MAX_MS: Final = 3_600_000 * 24
_MILLIS = Number(0, _MAX_MS)
_SHARE = Number(0.0, 1.0, may_be_text=True)
_DOT = Number(0, MAX_DOTS - 1, is_whole=True)
_PLAYBACK = Text(("NONE", "FADE_IN", "FADE_OUT", "FADE_IN_OUT"))
_DOT_FEEDBACK = loose(
    {
        "startTime": _MILLIS,
        "endTime": _MILLIS,
        "playbackType": _PLAYBACK,
        "pointList": Items(loose({"index": _DOT, "intensity": _SHARE})),
    }
)
_PATH_FEEDBACK = loose(
    {
        "playbackType": _PLAYBACK,
        "movingPattern": Text(("CONST_SPEED", "CONST_TDM")),
        "pointList": Items(loose({"x": _SHARE, "y": _SHARE, "intensity": _SHARE, "time": _MILLIS})),
    }
)
_DOT_MODE = loose({"feedback": Items(_DOT_FEEDBACK)}, {"dotConnected": Flag()})
_PATH_MODE = loose({"feedback": Items(_PATH_FEEDBACK)})
_MODE = loose(
    {"mode": Text(("DOT_MODE", "PATH_MODE")), "dotMode": _DOT_MODE, "pathMode": _PATH_MODE}
)
_EFFECT = loose({"startTime": _MILLIS, "offsetTime": _MILLIS, "modes": Table(_MODE)})
_LAYOUT = loose(
    {
        "type": Text(),
        "name": Text(),
        "layouts": Table(Items(loose({"index": _DOT, "x": _SHARE, "y": _SHARE}), most=MAX_DOTS)),
    }
)
_DOCUMENT = Record(
    {
        "intervalMillis": Number(INTERVAL_MS, INTERVAL_MS, is_whole=True),
        "size": Number(MAX_DOTS, MAX_DOTS, is_whole=True),
        "durationMillis": _MILLIS,
        "project": loose(
            {
                "layout": _LAYOUT,
                "tracks": Items(loose({"effects": Items(_EFFECT)}, {"enable": Flag()})),
            },
            dict.fromkeys(("name", "description"), Anything()),
        ),
    },
    {"name": Anything(), "feedback": Anything()},
)


def write(signals: Sequence[Signal], motors: Mapping[str, Motor], stem: Path) -> Written:
    """Write a file for each kind of suit with a motor for any of the signals.

    A single file is ``stem.tact``, several are ``stem.<kind>.tact``. Signals are not simplified:
    each interval of 20 ms stores its maximum in steps of 0.01. ``motors`` maps signal names; the
    maximum counts where signals share a motor.
    """
    files = []
    kinds = dict.fromkeys(motors[signal.name].kind for signal in signals if signal.name in motors)
    for kind in kinds:
        path = stem.with_name(stem.name + SUFFIX)
        files.append(path if len(kinds) == 1 else part_path(stem, kind.lower(), SUFFIX))
        write_json(document(signals, motors, kind, clean(stem.name)), files[-1])
    played = [signal for signal in signals if signal.name in motors and not signal.is_silent]
    # A device may have more actuators than the suit has motors.
    sharing = Counter(motors[signal.name] for signal in played)
    left_out = (
        *counted(
            [signal.name for signal in signals if signal.name not in motors],
            "no bHaptics motor is where these actuators are",
        ),
        *counted(
            [signal.name for signal in played if sharing[motors[signal.name]] > 1],
            "where actuators share a motor, the strongest at each time counts",
        ),
    )
    weak = [
        signal.name for signal in played if np.rint(100.0 * signal.amplitude.values.max()) < 1.0
    ]
    notes = (
        "strengths change every 20 ms, in steps of 1 %; the motors set the frequency",
        *counted(weak, "actuators too weak for steps of 1 % are silent"),
    )
    return Written(tuple(files), left_out, notes)


def export(raster: Raster, device: DeviceConfig, stem: Path, tolerance: float) -> Written:
    """Write the vibration of a device's raster; steps of strength replace the unused ``tolerance``.
    Raises InputError for a device without a corresponding motor."""
    why = why_nothing(device)
    if why:
        raise InputError(f"D{why[1:]}.")
    signals, _ = signals_of(raster, device)
    written = write(signals, motors_of(device), stem)
    # The format has no frequencies, so none is clipped.
    return written + Written((), losses.beyond_limits(raster, device, highest_hz=np.inf))


def document(
    signals: Sequence[Signal], motors: Mapping[str, Motor], kind: str, name: str
) -> dict[str, Any]:
    """Document of the signals of a kind of suit, in steps of 20 ms from 0; 1 step at least. Silence
    above 500 ms parts effects. Raises TooLargeError beyond the memory limit; ``name`` is the title
    and the file's name in messages."""
    layout = LAYOUTS[kind]
    end_s = max((signal.duration_s for signal in signals), default=0.0)
    # The margin keeps a duration of whole steps, computed in floats, from one step more.
    steps = max(1, int(np.ceil(end_s * 1000.0 / INTERVAL_MS - 1e-6)))
    most_bytes = 3.0 * 8.0 * steps * len(layout.positions) * MAX_DOTS  # strengths, in three steps
    limits.MEMORY.check(most_bytes, name, "strengths every 20 ms would take")
    places = {
        (position, index): k * MAX_DOTS + index
        for k, position in enumerate(layout.positions)
        for index in range(len(layout.dots))
    }
    # Strengths of all dots over time: position by position, MAX_DOTS columns each.
    levels = np.zeros((steps, len(layout.positions) * MAX_DOTS))
    for signal in signals:
        motor = motors.get(signal.name)
        if motor is not None and motor.kind == kind:
            column = places[motor.position, motor.index]
            levels[:, column] = np.maximum(levels[:, column], _strongest(signal.amplitude, steps))
    # Whole percent, the step of the format, so that equal steps join to one entry.
    hundredths = np.rint(100.0 * levels).astype(np.int64)
    spans = stretches(hundredths.any(axis=1), gap=_GAP_MS // INTERVAL_MS)
    effects = [_effect(hundredths, span, layout.positions) for span in spans]
    length = steps * INTERVAL_MS
    return {
        "name": name,
        "intervalMillis": INTERVAL_MS,
        "size": MAX_DOTS,
        "durationMillis": length,
        "project": {
            "name": name,
            "description": "",
            "mediaFileDuration": max(1, -(-length // 1000)),
            "createdAt": 0,
            "updatedAt": 0,
            "id": "",
            "layout": {
                "type": layout.type,
                "name": layout.name,
                "layouts": {
                    position: [{"index": k, "x": x, "y": y} for k, (x, y) in enumerate(layout.dots)]
                    for position in layout.positions
                },
            },
            "tracks": [{"enable": True, "effects": effects}],
        },
    }


def _strongest(curve: Curve, steps: int) -> F64:
    """Maximum of a curve in each interval of 20 ms, (steps,), 0..1; 0 after the curve."""
    # A piecewise linear curve is highest at a keyframe or at an end of the interval.
    edges = np.arange(steps + 1) * (INTERVAL_MS / 1000.0)
    strongest = np.maximum(curve.at(edges[:-1]), curve.before(edges[1:]))
    inside = np.floor(curve.times_s * 1000.0 / INTERVAL_MS + 1e-9).astype(np.int64)
    # Keyframes within an interval; its two edges were taken above.
    is_inside = (inside >= 0) & (inside < steps)
    # A keyframe on an edge already counts through the limits at both sides of the edge.
    is_inside &= np.abs(curve.times_s - edges[np.clip(inside, 0, steps)]) > 1e-9
    np.maximum.at(strongest, inside[is_inside], curve.values[is_inside])
    strongest[edges[:-1] >= curve.times_s[-1] - 1e-9] = 0.0  # a signal ends with its curve
    return np.asarray(np.clip(strongest, 0.0, 1.0))


def _effect(
    levels: npt.NDArray[np.int64], span: tuple[int, int], positions: Sequence[str]
) -> dict[str, Any]:
    """Effect of the steps of ``span``, (first, after the last), with the dots of all positions;
    ``startTime`` is of the file, times of dots from there. ``levels`` (steps, 20 columns for each
    of ``positions``) are percent."""
    first, stop = span
    part = levels[first:stop]
    return {
        "name": f"from {first * INTERVAL_MS} ms",
        "startTime": first * INTERVAL_MS,
        # In spite of the name the duration of the effect, as in bHaptics' parser.
        "offsetTime": (stop - first) * INTERVAL_MS,
        "modes": {
            position: {
                "mode": "DOT_MODE",
                "dotMode": {
                    "dotConnected": False,
                    "feedback": list(_dots(part[:, k * MAX_DOTS : (k + 1) * MAX_DOTS])),
                },
                # The parser refuses a mode without both members, whichever is played.
                "pathMode": {
                    "feedback": [
                        {"playbackType": "NONE", "movingPattern": "CONST_SPEED", "pointList": []}
                    ]
                },
            }
            for k, position in enumerate(positions)
        },
    }


def _dots(levels: npt.NDArray[np.int64]) -> Iterator[dict[str, Any]]:
    """Yield feedback entries of a position, percent (steps, 20): one per run of equal rows. Silent
    runs are omitted; times are ms from the first row."""
    changes = np.flatnonzero((levels[1:] != levels[:-1]).any(axis=1)) + 1
    for first, stop in pairwise([0, *changes.tolist(), len(levels)]):
        row = levels[first]
        if row.any():
            yield {
                "startTime": first * INTERVAL_MS,
                "endTime": stop * INTERVAL_MS,
                "playbackType": "NONE",
                "pointList": [
                    {"index": int(k), "intensity": row[k] / 100.0} for k in np.flatnonzero(row)
                ],
            }


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode a signal per used dot, named like ``VestFront 0``, and the default frequency. Moving
    points are played by the nearest dot. Losses and notes are on the first signal. Raises
    InputError for an unreadable file or a wrong structure."""
    document = without_nulls(parse(content, name))
    # The player requires only the right types, and skips missing members.
    notes = refuse_untolerated(
        findings(document), name, lambda finding: finding.code != "TACT-TYPE", document
    )
    document = known_members(_DOCUMENT, document)
    pieces: dict[tuple[str, int], list[Piece]] = {}
    lost: Counter[str] = Counter()
    project = document.get("project", {})
    layouts = project.get("layout", {}).get("layouts", {})
    for track in project.get("tracks", []):
        if not track.get("enable", True):
            lost["tracks that are switched off"] += 1
            continue
        for effect in track.get("effects", []):
            for position, mode in effect.get("modes", {}).items():
                dots = [dot for dot in layouts.get(position, []) if "index" in dot]
                if mode.get("mode") == "PATH_MODE":
                    played = _path_pieces(effect, mode, dots, lost)
                else:
                    played = _dot_pieces(effect, mode)
                for index, piece in played:
                    pieces.setdefault((position, index), []).append(piece)
    end_s = document.get("durationMillis", 0) / 1000.0
    signals = [
        mixed(f"{position} {index}", dot_pieces, (), end_s)
        for (position, index), dot_pieces in sorted(pieces.items())
    ]
    credits = Credits(
        project=text_of(project, "name") or text_of(document, "name"),
        description=text_of(project, "description"),
    )
    signals = [replace(signal, credits=credits) for signal in signals]
    if signals:
        left_out = tuple(f"{count} {loss}" for loss, count in lost.items())
        signals[0] = replace(signals[0], left_out=left_out + signals[0].left_out, notes=notes)
    return signals, DEFAULT_RANGE


_FADES: Final = {
    "NONE": ((0.0, 1.0), (1.0, 1.0)),
    "FADE_IN": ((0.0, 1.0), (0.0, 1.0)),
    "FADE_OUT": ((0.0, 1.0), (1.0, 0.0)),
    "FADE_IN_OUT": ((0.0, 0.5, 1.0), (0.0, 1.0, 0.0)),
}


def _piece(start_s: float, end_s: float, level: float, fade: str) -> Piece:
    """Piece of a dot between two times, at 100 Hz, with a fade; an unknown fade is constant.
    ``level`` is clipped to 0..1; an end before the start gives no duration."""
    shares, values = _FADES.get(fade, _FADES["NONE"])
    level = min(max(level, 0.0), 1.0)
    times = start_s + max(end_s - start_s, 0.0) * np.array(shares)
    pitch = Curve.of([start_s], [DEFAULT_RANGE.lowest_hz])
    return Piece(start_s, end_s, Curve(times, level * np.array(values)), pitch)


def _dot_pieces(effect: dict[str, Any], mode: dict[str, Any]) -> Iterator[tuple[int, Piece]]:
    """Yield (motor number, piece) for the dots of a mode, in seconds of the file, with the fade of
    ``playbackType``; points without ``index`` are skipped. Times of a feedback are relative to the
    effect: without a member 0 for starts, the effect's ``offsetTime`` for ends."""
    begin = effect.get("startTime", 0)
    for feedback in mode.get("dotMode", {}).get("feedback", []):
        start = begin + feedback.get("startTime", 0)
        end = begin + feedback.get("endTime", effect.get("offsetTime", 0))
        fade = feedback.get("playbackType", "NONE")
        for point in feedback.get("pointList", []):
            level = float(point.get("intensity", 0.0))
            if "index" in point:
                yield point["index"], _piece(start / 1000.0, end / 1000.0, level, fade)


def _path_pieces(
    effect: dict[str, Any], mode: dict[str, Any], dots: list[dict[str, Any]], lost: Counter[str]
) -> Iterator[tuple[int, Piece]]:
    """Yield (motor number, piece) of the dot of ``dots`` nearest to each point of the mode's paths,
    in seconds of the file. A point lasts until the next point, the last until the end of the
    effect. Differences from bHaptics' own playback are counted in ``lost`` by description."""
    places = np.array([[float(dot.get("x", 0.5)), float(dot.get("y", 0.5))] for dot in dots])
    begin = effect.get("startTime", 0)
    for feedback in mode.get("pathMode", {}).get("feedback", []):
        points = sorted(
            feedback.get("pointList", []), key=lambda point: float(point.get("time", 0))
        )
        if not points:
            lost["paths without points, which are silent"] += 1
            continue
        if not dots:
            lost["paths at a position whose layout has no dots"] += 1
            continue
        # bHaptics' player moves the point between dots; envelopes of dots have no places between.
        if len(points) > 1:
            lost["moving points, which jump from dot to dot"] += 1
        if feedback.get("playbackType", "NONE") != "NONE":
            lost["fades of paths"] += 1
        times = [float(point.get("time", 0)) for point in points] + [effect.get("offsetTime", 0)]
        for point, (start, end) in zip(points, pairwise(times), strict=True):
            off = places - (float(point.get("x", 0.5)), float(point.get("y", 0.5)))
            nearest = dots[int(np.argmin((off**2).sum(axis=1)))]
            level = float(point.get("intensity", 0.0))
            piece = _piece((begin + start) / 1000.0, (begin + end) / 1000.0, level, "NONE")
            yield nearest["index"], piece


def findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values."""
    report = Report("TACT")
    check(_DOCUMENT, document, report)
    if report.has_errors:
        return report.findings
    project = document["project"]
    layouts = project["layout"]["layouts"]
    for t, track in enumerate(project["tracks"]):
        for e, effect in enumerate(track["effects"]):
            location: Place = (((((None, "project"), "tracks"), t), "effects"), e)
            end = effect["startTime"] + effect["offsetTime"]
            if document["durationMillis"] and end > document["durationMillis"]:
                message = f"ends at {end} ms, after the file ({document['durationMillis']} ms)"
                report.warn("DURATION", location, message)
            for position, mode in effect["modes"].items():
                here = ((location, "modes"), position)
                if position not in layouts:
                    message = f"the layout has no position '{position[:40]}'"
                    report.error("POSITION", here, message)
                    continue
                if mode["mode"] == "PATH_MODE":
                    paths = mode["pathMode"]["feedback"]
                    if any(not path["pointList"] for path in paths):
                        report.warn("PATH-EMPTY", here, "a path has no points: it is silent")
                # Dots are checked against the layout of their own position.
                known = {dot["index"] for dot in layouts[position]}
                for feedback in mode["dotMode"]["feedback"]:
                    if feedback["endTime"] < feedback["startTime"]:
                        report.error("ORDER", here, "a feedback ends before it begins")
                    for point in feedback["pointList"]:
                        if point["index"] not in known:
                            message = f"the layout has no dot {point['index']}"
                            report.error("DOT", here, message)
    return report.findings


validate = json_validator(findings)
