# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of bHaptics .tact files, derived from the player's own parser."""

from __future__ import annotations

from typing import Any, Final

from ...files.findings import Finding, Report, json_validator
from ...files.json_shapes import (
    Anything,
    Flag,
    Items,
    Number,
    Record,
    Shape,
    Table,
    Text,
    check,
    loose,
)
from ...files.strict_json import Place
from .tact_layouts import MAX_DOTS

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
_DOT_MODE: Shape = loose({"feedback": Items(_DOT_FEEDBACK)}, {"dotConnected": Flag()})
_PATH_MODE: Shape = loose({"feedback": Items(_PATH_FEEDBACK)})
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
DOCUMENT = Record(
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


def findings(document: Any) -> list[Finding]:
    """Return the findings of a parsed document: schema errors, or else faults of values."""
    report = Report("TACT")
    check(DOCUMENT, document, report)
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
