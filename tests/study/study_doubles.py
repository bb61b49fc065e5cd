# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubles of a session: a player without devices, and observers that answer at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hfx_tools.study import folder
from hfx_tools.study.answers import AnswerFile
from hfx_tools.study.device_player import Playback
from hfx_tools.study.session import Session, event_columns
from hfx_tools.study.stimuli import StimulusLibrary, devices_of

DEVICE = "back_pad"


class SilentPlayer:
    """Player without devices: stimuli take no time, and are listed in ``played``."""

    def __init__(self) -> None:
        self.played: list[Any] = []
        self.stops: list[str] = []
        self.interrupted: Callable[[], None] = lambda: None

    def idle(self, seconds: float = 0.0) -> None:
        self.interrupted()

    def play(self, stimulus: Any) -> Playback:
        self.interrupted()
        self.played.append(stimulus)
        now_s = time.monotonic()
        return Playback(now_s, now_s + stimulus.duration_s, 0.002)

    def silence(self) -> None:
        pass

    def stop(self, reason: str) -> None:
        self.stops.append(reason)


class Observer:
    """Presenter whose participant answers by ``answer``, a function of the screen's number."""

    def __init__(self, answer: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
        self.screens: list[Mapping[str, Any]] = []
        self._answer = answer
        self._waiting: list[Mapping[str, Any]] = []

    def show(self, screen: Mapping[str, Any]) -> None:
        self.screens.append(screen)
        self._waiting = []

    def inputs(self) -> list[Mapping[str, Any]]:
        # The answer comes after the session has begun to wait.
        if self.screens and not self._waiting:
            self._waiting = [self._answer(self.screens[-1])]
            return []
        return list(self._waiting)


def eager(screen: Mapping[str, Any]) -> Mapping[str, Any]:
    """Continue, accept, and give the first answer to each question."""
    is_question = screen["kind"] in ("choice", "scale")
    return {"type": "answer", "value": 1} if is_question else {"type": "next"}


def session_of(
    study: folder.Study,
    answer: Callable[[Mapping[str, Any]], Mapping[str, Any]] = eager,
    participant: str = "01",
) -> tuple[Session, SilentPlayer, Observer, AnswerFile]:
    """Session with doubles; the caller closes the file of answers."""
    library = StimulusLibrary(study, devices_of(study.plan, [DEVICE]))
    answers = AnswerFile(study.data_file(participant), event_columns(study.plan))
    player, observer = SilentPlayer(), Observer(answer)
    session = Session(study, participant, library, player, observer, answers, ready_s=0.0)  # type: ignore[arg-type]
    return session, player, observer, answers


def make(folder_path: Path, document: Mapping[str, Any]) -> folder.Study:
    """Study of a plan in a new folder."""
    import json

    folder_path.mkdir(parents=True, exist_ok=True)
    path = folder_path / "plan.json"
    path.write_text(json.dumps(document))
    return folder.make(path, folder_path / "s")
