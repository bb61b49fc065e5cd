# SPDX-License-Identifier: GPL-3.0-or-later
"""Descriptions of the columns of answers, for the JSON sidecar of BIDS."""

from __future__ import annotations

from typing import Any, Final

from .plan import Plan, as_text
from .session import TLX, event_columns

_TEXTS: Final = {
    "onset": "Time at which the first stimulus reached the port, from the begin of the first "
    "session; a later session continues 60 s after the last row.",
    "duration": "Time from the onset to the end of the last stimulus, or to the answer.",
    "trial_type": "Kind of the row.",
    "trial": "Number of the trial in the list of its kind.",
    "onset_second": "Onset of the second stimulus.",
    "stimulus": "Name of the file in stimuli/: first digits of its SHA-256.",
    "stimulus_first": "Name of the first stimulus' file in stimuli/.",
    "stimulus_second": "Name of the second stimulus' file in stimuli/.",
    "target": "Interval of the level; the other interval has the reference.",
    "staircase": "Number of the staircase.",
    "start": "Level at the begin of the adjustment.",
    "changes": "Number of changes of the level.",
    "response": "Answer of the participant.",
    "correct": "1 for a right answer, 0 for a wrong one.",
    "item": "Scale of the questionnaire.",
    "score": "Answer on the scale of the questionnaire, 0 to 100.",
    "response_time": "Time from the question to the answer, by the page's clock.",
    "latency_ms": "Measured time from sending the first values to their arrival at the port.",
    "session": "Number of the session of this participant.",
}
_UNITS: Final = {
    **dict.fromkeys(("onset", "duration", "onset_second", "response_time"), "s"),
    "latency_ms": "ms",
}


def described(plan: Plan) -> dict[str, Any]:
    """Description of each column but onset and duration, which BIDS defines, by name."""
    columns: dict[str, Any] = {}
    questions = {f"rating_{scale.id}": scale for scale in plan.scales}
    for name in event_columns(plan):
        column: dict[str, Any] = {"Description": _TEXTS.get(name, "Factor of the plan.")}
        if name in questions:
            scale = questions[name]
            column["Description"] = scale.text
            column["Levels"] = {"1": scale.lowest, str(scale.steps): scale.highest}
        if name in _UNITS:
            column["Units"] = _UNITS[name]
        if name == "trial_type":
            column["Levels"] = {
                "training": "practice, without part in the results",
                "trial": "trial",
                "catch": "check of attention",
                "questionnaire": "scale of a questionnaire",
            }
        if name == "item":
            column["Levels"] = dict(TLX)
        if name in plan.factors:
            column["Levels"] = {as_text(value): plan.label(value) for value in plan.factors[name]}
        columns[name] = column
    return columns
