# SPDX-License-Identifier: GPL-3.0-or-later
"""Session of a participant: plays the remaining trials and stores an answer after each."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final, Protocol

from hfx_blender.errors import InputError

from .answers import AnswerFile
from .design import FIRST, SECOND, Trial, columns_of
from .device_player import DevicePlayer, Playback, StandstillError
from .folder import Study
from .plan import Conditions, Plan, Value, as_text
from .psychometric import PsychometricGrid, staircase
from .stimuli import Stimulus, StimulusLibrary, intervals_of
from .tables import NOTHING

TLX: Final = {
    "mental_demand": "How mentally demanding was the task?",
    "physical_demand": "How physically demanding was the task?",
    "temporal_demand": "How hurried or rushed was the pace of the task?",
    "performance": "How successful were you in accomplishing what you were asked to do?",
    "effort": "How hard did you have to work to accomplish your level of performance?",
    "frustration": "How insecure, discouraged, irritated, stressed and annoyed were you?",
}
"""Scales of the NASA Task Load Index (Hart and Staveland 1988), 0 to 100 in steps of 5."""

_TLX_STEPS: Final = 21
_READY_S: Final = 0.5  # before the first stimulus of a trial
_FEEDBACK_S: Final = 0.8

Screen = dict[str, Any]
Input = Mapping[str, Any]


class Presenter(Protocol):
    """Display of a session, with the participant's inputs.

    Screens hold texts for the participant and no condition. Inputs are ``{"type": ...}`` with the
    types next, answer ("value": number of the answer from 1, "ms"), up, down, again, pause and
    stop.
    """

    def show(self, screen: Screen) -> None: ...

    def inputs(self) -> list[Input]: ...


class StoppedError(Exception):
    """End of a session at the participant's wish."""


class _PausedError(Exception):
    """Pause: the present trial begins again afterwards."""


def event_columns(plan: Plan) -> list[str]:
    """Columns of a participant's answers."""
    own = [name for name in columns_of(plan) if name not in ("trial", "kind")]
    columns = ["onset", "duration", "trial_type", "trial", *own]
    if plan.has_intervals:
        columns += ["onset_second", "stimulus_first", "stimulus_second"]
    else:
        columns.append("stimulus")
    if plan.design == "adjustment":
        columns.append("changes")
    columns += [f"rating_{scale.id}" for scale in plan.scales]
    if not plan.scales:
        columns += ["response", "correct"]
    if plan.questionnaire:
        columns += ["item", "score"]
    return [*columns, "response_time", "latency_ms", "session"]


class Session:
    """Remaining part of a participant's study: training, trials and questionnaire."""

    def __init__(
        self,
        study: Study,
        participant: str,
        stimuli: StimulusLibrary,
        player: DevicePlayer,
        presenter: Presenter,
        answers: AnswerFile,
        *,
        ready_s: float = _READY_S,
    ) -> None:
        self._plan, self._stimuli = study.plan, stimuli
        self._player, self._presenter, self._answers = player, presenter, answers
        self._ready_s = ready_s
        player.interrupted = self._raise_requests
        self._queue: list[Input] = []
        self._training, self._trials = study.trials(participant)
        rows = answers.rows
        self._done = {(row["trial_type"], row["trial"]) for row in rows}
        self._items = {row["item"] for row in rows if row.get("item", NOTHING) != NOTHING}
        self.number = 1 + max((int(row["session"]) for row in rows), default=0)
        # Times count on after the last row of an earlier session.
        past_s = max((float(row["onset"]) for row in rows if row["onset"] != NOTHING), default=0.0)
        self._zero_s = time.monotonic() - (past_s + 60.0 if rows else 0.0)
        self._staircases: dict[Value, PsychometricGrid] = {}
        for row in rows:
            if row["trial_type"] == "trial" and self._plan.design == "staircase":
                self._learn(row)
        self.latencies_ms: list[float] = []

    @property
    def is_complete(self) -> bool:
        """Test that all trials and questions have answers."""
        return not any(True for _ in self._remaining(self._trials)) and not self._open_items()

    def run(self) -> bool:
        """Run to the end or to the participant's stop; True for a complete study."""
        texts = self._plan.texts
        try:
            self._text(texts["welcome"])
            if self._training and not self._is_begun(self._trials):
                for trial in self._remaining(self._training):
                    self._answer(trial, "training")
                self._text("The training is over. The answers count from now on.")
            done = len(self._trials) - sum(1 for _ in self._remaining(self._trials))
            for trial in list(self._remaining(self._trials)):
                if done and self._plan.breaks_every and done % self._plan.breaks_every == 0:
                    self._text(texts["pause"])
                self._answer(trial, "trial", done)
                done += 1
            for item in self._open_items():
                self._questionnaire(item)
        except StoppedError:
            self._player.stop("stopped by the participant")
            self._presenter.show({"kind": "end", "text": "The session was stopped."})
            return False
        self._player.silence()
        self._presenter.show({"kind": "end", "text": texts["end"]})
        return True

    def _remaining(self, trials: list[Trial]) -> Iterator[Trial]:
        for trial in trials:
            if (str(trial["kind"]), as_text(trial["trial"])) not in self._done:
                yield trial

    def _is_begun(self, trials: list[Trial]) -> bool:
        return len(trials) > sum(1 for _ in self._remaining(trials))

    def _open_items(self) -> list[str]:
        is_asked = self._plan.questionnaire == "nasa-tlx"
        return [item for item in TLX if item not in self._items] if is_asked else []

    def _answer(self, trial: Trial, phase: str, done: int = 0) -> None:
        """Play a trial until it has an answer, which is stored."""
        progress = {"phase": phase, "done": done, "total": len(self._trials)}
        while True:
            try:
                row = self._played(trial, progress)
                break
            except _PausedError:
                self._player.silence()
                self._text("Paused. The last trial will begin again.")
            except StandstillError:
                self._text(
                    "The computer stood still, and the devices were silenced. The last trial will "
                    "begin again."
                )
                self._player.arm()
        self._answers.append(row)
        self._done.add((str(trial["kind"]), as_text(trial["trial"])))
        if self._plan.design == "staircase" and trial["kind"] == "trial":
            self._learn(self._answers.rows[-1])
        if phase == "training" and row.get("correct") is not None:
            text = "Right." if row["correct"] else "Not right."
            self._presenter.show({"kind": "feedback", "text": text, **progress})
            with suppress(_PausedError):
                self._player.idle(_FEEDBACK_S)

    def _played(self, trial: Trial, progress: Screen) -> dict[str, Any]:
        """Play the stimuli of a trial and wait for the answer; returns its row."""
        plan = self._plan
        if plan.design == "adjustment":
            return self._adjusted(trial, progress)
        level = self._level(trial) if plan.design == "staircase" else None
        conditions = intervals_of(plan, trial, level)
        played: list[tuple[Stimulus, Playback]] = []
        for k, one in enumerate(conditions, 1):
            which = k if len(conditions) > 1 else 0
            self._presenter.show({"kind": "feel", "which": which, **progress})
            self._player.idle(plan.gap_ms / 1000.0 if played else self._ready_s)
            stimulus = self._stimuli[one]
            played.append((stimulus, self._player.play(stimulus)))
        row = self._row(trial, played)
        if level is not None:
            row[plan.level_factor] = level
        return row | self._question(trial, progress)

    def _row(self, trial: Trial, played: list[tuple[Stimulus, Playback]]) -> dict[str, Any]:
        """Times, stimuli and conditions of a trial, without the answer."""
        first, last = played[0][1], played[-1][1]
        row: dict[str, Any] = dict(trial)
        del row["kind"]
        row |= {
            "onset": round(first.onset_s - self._zero_s, 4),
            "duration": round(last.end_s - first.onset_s, 4),
            "trial_type": trial["kind"],
            "session": self.number,
        }
        names = (
            ["stimulus"]
            if not self._plan.has_intervals
            else [f"stimulus_{FIRST}", f"stimulus_{SECOND}"]
        )
        row |= dict(zip(names, [stimulus.name for stimulus, _ in played], strict=False))
        if self._plan.has_intervals:
            row["onset_second"] = round(last.onset_s - self._zero_s, 4)
        # A silent reference gives no report.
        latencies = [one.latency_s for _, one in played if one.latency_s is not None]
        if latencies:
            row["latency_ms"] = round(1000.0 * latencies[0], 2)
            self.latencies_ms.append(1000.0 * latencies[0])
        return row

    def _question(self, trial: Trial, progress: Screen) -> dict[str, Any]:
        """Ask the question of the design; returns the columns of the answer."""
        plan, text = self._plan, self._plan.texts["question"]
        if plan.scales:
            row: dict[str, Any] = {"response_time": 0.0}
            for scale in plan.scales:
                screen = {
                    "kind": "scale",
                    "text": scale.text,
                    "lowest": scale.lowest,
                    "highest": scale.highest,
                    "steps": scale.steps,
                }
                value, seconds = self._response(screen | progress, scale.steps)
                row[f"rating_{scale.id}"] = value
                row["response_time"] = round(row["response_time"] + seconds, 4)
            return row
        answers: list[Value] = list(plan.answers) or [FIRST, SECOND]
        labels = [plan.label(value) for value in answers] if plan.answers else ["First", "Second"]
        number, seconds = self._response(
            {"kind": "choice", "text": text, "choices": labels, **progress}, len(labels)
        )
        response = answers[number - 1]
        correct = None
        if plan.identify:
            correct = int(response == trial[plan.identify])
        elif plan.level_factor and plan.guess > 0.0:
            correct = int(response == trial["target"])
        return {"response": response, "correct": correct, "response_time": round(seconds, 4)}

    def _adjusted(self, trial: Trial, progress: Screen) -> dict[str, Any]:
        """Play the level again after each change, until the participant accepts the level."""
        plan = self._plan
        index = plan.levels.index(trial["start"])
        changes, first = 0, None
        begun_s = time.monotonic()
        screen = {"kind": "adjust", "text": plan.texts["question"], **progress}
        self._presenter.show(screen)
        self._queue.clear()
        self._player.idle(self._ready_s)
        while True:
            conditions: Conditions = intervals_of(plan, trial, plan.levels[index])[0]
            stimulus = self._stimuli[conditions]
            playback = self._player.play(stimulus)
            first = first or playback
            step = None
            while step is None:
                self._player.idle()
                for entry in self._new_inputs():
                    kind = entry.get("type")
                    step = {"up": 1, "down": -1, "again": 0}.get(str(kind), step)
                    if kind == "next":
                        row = self._row(trial, [(stimulus, first)])
                        seconds = time.monotonic() - begun_s
                        row["duration"] = round(playback.end_s - first.onset_s, 4)
                        return row | {
                            "response": plan.levels[index],
                            "changes": changes,
                            "response_time": round(seconds, 4),
                        }
            changes += bool(step)
            index = min(max(index + step, 0), len(plan.levels) - 1)

    def _questionnaire(self, item: str) -> None:
        """Ask one scale of the NASA Task Load Index and store its answer."""
        ends = ("Perfect", "Failure") if item == "performance" else ("Very low", "Very high")
        screen = {
            "kind": "scale",
            "text": TLX[item],
            "lowest": ends[0],
            "highest": ends[1],
            "steps": _TLX_STEPS,
            "phase": "questions",
        }
        while True:
            try:
                value, seconds = self._response(screen, _TLX_STEPS)
                break
            except _PausedError:
                self._text("Paused.")
        self._items.add(item)
        self._answers.append(
            {
                "onset": round(time.monotonic() - self._zero_s - seconds, 4),
                "duration": round(seconds, 4),
                "trial_type": "questionnaire",
                "item": item,
                "score": 5 * (value - 1),
                "response_time": round(seconds, 4),
                "session": self.number,
            }
        )

    def _level(self, trial: Trial) -> Value:
        """Level of a staircase's next trial, or the level of a catch or training trial."""
        plan, level = self._plan, trial[self._plan.level_factor]
        if trial["kind"] == "trial":
            return plan.levels[self._grid(as_text(trial["staircase"])).next_level()]
        return plan.levels[-1] if level == NOTHING else level

    def _learn(self, row: Mapping[str, Any]) -> None:
        """Pass a stored answer to its staircase."""
        plan = self._plan
        texts = [as_text(level) for level in plan.levels]
        level_text = row[plan.level_factor]
        if level_text not in texts:
            raise InputError(
                f"{self._answers.path}: {plan.level_factor} is '{level_text[:60]}', allowed is one "
                f"of {', '.join(texts)}."
            )
        level = texts.index(level_text)
        self._grid(row["staircase"]).observe(level, row["response"] == row["target"])

    def _grid(self, number: str) -> PsychometricGrid:
        if number not in self._staircases:
            plan = self._plan
            levels = [float(level) for level in plan.levels]
            is_logarithmic = plan.scale == "log"
            self._staircases[number] = staircase(
                levels, is_logarithmic=is_logarithmic, guess=plan.guess
            )
        return self._staircases[number]

    def _text(self, text: str) -> None:
        """Show a text until the participant continues."""
        self._presenter.show({"kind": "text", "text": text})
        self._queue.clear()
        while True:
            try:
                self._player.idle()
            except _PausedError:
                continue
            if any(entry.get("type") == "next" for entry in self._new_inputs()):
                return

    def _response(self, screen: Screen, count: int) -> tuple[int, float]:
        """Show a screen and wait for an answer: its number, 1 to ``count``, and the time in s."""
        self._presenter.show(screen)
        shown_s = time.monotonic()
        self._queue.clear()
        while True:
            self._player.idle()
            for entry in self._new_inputs():
                value = entry.get("value")
                if entry.get("type") == "answer" and type(value) is int and 1 <= value <= count:
                    return value, self._seconds(entry, time.monotonic() - shown_s)

    @staticmethod
    def _seconds(entry: Input, most_s: float) -> float:
        """Response time by the page's own clock if plausible, else by this one."""
        ms = entry.get("ms")
        is_plausible = isinstance(ms, int | float) and 0.0 <= ms <= 1000.0 * most_s
        return ms / 1000.0 if is_plausible else most_s  # type: ignore[operator]

    def _new_inputs(self) -> list[Input]:
        """Inputs queued since the last call; empties the queue."""
        inputs, self._queue = self._queue, []
        return inputs

    def _raise_requests(self) -> None:
        """Queue the participant's inputs; raise for a stop or a pause."""
        for entry in self._presenter.inputs():
            if entry.get("type") == "stop":
                raise StoppedError
            if entry.get("type") in ("pause", "left"):
                raise _PausedError
            self._queue.append(entry)
