# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of devices for an export, including their scripts.

A script runs in the same worker as in live playback, once for each row of the raster, from the
first to the last row of the track. So the state does not depend on the division of the recording.
"""

import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ..engine.arrays import F64
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import Played, blocks
from ..engine.rendering.renderer import Renderer
from ..engine.samples import SampleRun
from ..engine.track import TrackHeader, TrackReader
from ..errors import InputError, ScriptError
from ..processes.messages import Message, MessageError, MessageKind, encode_json, message
from ..processes.worker import Worker
from .live import approval
from .workers.haptics import encode_haptics
from .workers.message_bodies import decode_values

FeltRuns = list[tuple[SampleRun, F64]]
START_S: Final = 60.0  # time limit for the start of a script, seconds, which includes its imports
ROW_S: Final = 10.0  # time limit for one row, seconds; live the limit is 0.1
SUM_S: Final = 60.0
SUM_ROW_S: Final = 0.1
"""Time limit for all rows, seconds: the sum of ``SUM_S`` and ``SUM_ROW_S`` for each row."""

PRINTED: Final = 20  # largest number of printed lines in the report, for each device and body
_PRINTS_PER_S: Final = 10_000  # bounds an endless loop of prints
_BATCH_ROWS: Final = 64
# Size of a batch of rows, bytes; the next batch is in the pipe during the work on one.
_BATCH_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class Rendered:
    """Rendered rasters, and the devices without one."""

    played: list[Played]
    silent: Mapping[str, str] = field(default_factory=dict)  # reasons by device id
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def without(self, silent: Mapping[str, str]) -> "Rendered":
        """Copy without the rasters of some devices, given by id with the reasons."""
        played = [pair for pair in self.played if pair[0].id not in silent]
        return replace(self, played=played, silent={**self.silent, **silent})


def rendering(
    track: TrackReader, renderers: Sequence[tuple[DeviceConfig, Renderer]]
) -> Generator[float, None, Rendered]:
    """Render devices in steps, for progress; renderers have received the whole track before.

    Reads the track again for each script. A device whose script fails on one body has no raster
    on any body.
    """
    played: list[Played] = []
    silent: dict[str, str] = {}
    notes: list[str] = []
    warnings: list[str] = []
    for device, renderer in renderers:
        if device.id in silent:
            continue  # failed on an earlier body
        answers = None
        if device.script is not None:
            try:
                answers = yield from _answers(track, device, renderer, notes)
            except ScriptError as error:
                silent[device.id] = str(error)
                continue
            invalid = int(np.count_nonzero(~np.isfinite(answers).all(axis=1)))
            if invalid:
                warnings.append(
                    f"device '{device.id}': its script gave no number at {invalid} of "
                    f"{len(answers)} times; actuators were silent then"
                )
        notes += renderer.notes()
        played.append((device, renderer.raster(answers)))
    return Rendered(played, {}, tuple(notes), tuple(warnings)).without(silent)


def _answers(
    track: TrackReader, device: DeviceConfig, renderer: Renderer, notes: list[str]
) -> Generator[float, None, F64]:
    """Answers of a device's script for all rows, (T, columns); ScriptError if that fails. The first
    printed lines are added to ``notes``."""
    script = _approved_script(device)
    script_input = renderer.script_input()
    answers = np.zeros_like(script_input)
    row = 0
    # Times from frames, as in live playback: a script gets equal numbers, rounding included.
    base, fps = track.header.time, float(track.header.time.fps)
    labels = {effect.id: effect.name for effect in track.header.effects}
    printed: list[str] = []
    times_s = [(float(base.frame(k)) - base.scene_start) / fps for k in range(base.sample_count)]
    try:
        with ScriptRun(script, device, answers, printed) as run:
            batch: list[bytes] = []
            size = 0
            for effects in _felt_by_row(track, renderer):
                haptics = encode_haptics(times_s[row], effects, script_input[row], labels)
                batch.append(message(MessageKind.HAPTICS, 0, haptics))
                size += len(batch[-1])
                row += 1
                # Batches save switches between the processes; small ones keep the progress smooth.
                if len(batch) >= _BATCH_ROWS or size >= _BATCH_BYTES:
                    run.ask(batch)
                    batch, size = [], 0
                    yield 1.0  # share of the recording, which is complete; scripts have no share
            run.ask(batch)
            run.wait()
    except MessageError as error:  # haptic data exceed the size of a message
        reason = f"cannot be told {error}{_when(track.header, row)}"
        raise ScriptError(_nothing_for(device, script, reason)) from None
    except ScriptFaultError as error:
        reason = str(error)
        if error.row is not None:
            reason = f"failed{_when(track.header, error.row)}: {reason}"
        raise ScriptError(_nothing_for(device, script, reason)) from None
    finally:
        notes += [f"device '{device.id}': its script printed: {x}" for x in printed[:PRINTED]]
        if len(printed) > PRINTED:
            more = len(printed) - PRINTED
            notes.append(f"device '{device.id}': its script printed {more} more lines")
    return answers


def _approved_script(device: DeviceConfig) -> approval.DeviceScript:
    """Script of a device; ScriptError if missing, unreadable, or neither shipped nor approved."""
    assert device.script is not None
    try:
        script = approval.script_of(device.script.configuration)
    except InputError as error:
        raise ScriptError(f"device '{device.id}' plays nothing: {error}".rstrip(".")) from None
    if script is None:
        raise ScriptError(
            f"device '{device.id}' plays nothing: its script {device.script.script} is gone"
        )
    if not script.is_approved:
        reason = f"is not approved; {approval.how_to_approve(device.script.device)}"
        raise ScriptError(_nothing_for(device, script, reason))
    return script


def _nothing_for(device: DeviceConfig, script: approval.DeviceScript, reason: str) -> str:
    """Join a message: the device plays nothing, as its script (path) ``reason``."""
    return f"device '{device.id}' plays nothing: its script {script.path} {reason}"


def _when(header: TrackHeader, row: int) -> str:
    """End of a sentence with the time and frame of a row; a row beyond the end is the last."""
    row = min(row, header.time.sample_count - 1)
    (time_s,) = header.time.times_s(np.array([row]))
    return f" at {time_s:.3f} s (frame {float(header.time.frame(row)):g})"


def _felt_by_row(track: TrackReader, renderer: Renderer) -> Iterator[FeltRuns]:
    """Yield for each row of a track the effects on the wearer, as runs of one sample, and their
    gains (A,); an empty list for a row without effects."""
    nothing: FeltRuns = []
    row = 0  # next row to yield
    for block in blocks(track.header, track.runs()):
        # Rows of one block are complete together: runs of later blocks have later rows.
        by_row: dict[int, FeltRuns] = {}
        for run in block:
            if run.stream.body_id == renderer.body_id and len(run):
                gains = renderer.gains(run)
                for k, index in enumerate(run.indices.tolist()):
                    by_row.setdefault(index, []).append((run.one(k), gains[k]))
        for index in sorted(by_row):
            yield from [nothing] * (index - row)
            yield by_row[index]
            row = index + 1
    yield from [nothing] * (track.header.time.sample_count - row)


class ScriptFaultError(Exception):
    """Fault of a script; ``row`` is None during its start."""

    def __init__(self, text: str, row: int | None = None) -> None:
        super().__init__(text)
        self.row = row


class ScriptRun:
    """Run of a script, row by row; a context manager that kills the worker at the end.

    ``answers`` (T, columns) float64: filled in place, row by row.
    ``printed``: printed lines are appended, beyond ``PRINTED`` as empty ones, which are counted.
    ``variables``: environment variables of the worker besides its usual ones.
    """

    def __init__(
        self,
        script: approval.DeviceScript,
        device: DeviceConfig,
        answers: F64,
        printed: list[str],
        variables: Mapping[str, str] | None = None,
    ) -> None:
        assert device.script is not None
        self._printed = printed
        self._answers = answers
        self._path = script.path
        limit = {"folder": None, "prints_per_s": _PRINTS_PER_S}
        self._request = {**script.as_request(), "device": str(device.script.device), **limit}
        # A fixed seed makes the order of sets in the script reproducible.
        self._worker = Worker(
            "devices.workers.script_worker", variables={"PYTHONHASHSEED": "0", **(variables or {})}
        )
        self._asked = self._answered = 0  # rows sent, rows answered
        self._last = 0  # rows sent before the last batch
        self._is_ready = False
        self._went_on_at = 0.0
        self._left_s = SUM_S + SUM_ROW_S * len(answers)

    def __enter__(self) -> "ScriptRun":
        try:
            self._worker.start()
        except OSError as error:  # too many processes, no memory
            raise ScriptFaultError(f"cannot be started: {error}") from None
        self._went_on_at = time.monotonic()
        self._worker.send(message(MessageKind.HEARTBEAT, 0, encode_json(self._request)))
        return self

    def __exit__(self, *_: object) -> None:
        self._worker.kill()
        self._worker.wait()

    def ask(self, batch: Sequence[bytes]) -> None:
        """Wait until all rows before the last batch are answered, then send a new batch. So the
        script always has work, and the pipe has a bounded length. Raises ScriptFaultError: the
        script has failed, or has exceeded a time limit."""
        self.wait(self._asked - self._last)
        if self._answered == self._asked:
            self._went_on_at = time.monotonic()
        self._last, self._asked = self._asked, self._asked + len(batch)
        self._worker.send(b"".join(batch))

    def wait(self, most: int = 0) -> None:
        """Process messages until the script is ready and at most ``most`` rows are unanswered.

        Raises ScriptFaultError: the script has failed, or has exceeded a time limit.
        """
        while not self._is_ready or self._asked - self._answered > most:
            began = time.monotonic()
            # The limit of a row starts with its predecessor's answer, or with its question after a
            # pause.
            limit_s = self._went_on_at + (ROW_S if self._is_ready else START_S) - began
            if self._is_ready:
                limit_s = min(limit_s, self._left_s)
            try:
                received = self._worker.receive(max(limit_s, 0.0))
            except TimeoutError:
                count = len(self._answers)
                if not self._is_ready:
                    text = f"did not start within {START_S:g} s"
                elif limit_s == self._left_s:
                    total_s = SUM_S + SUM_ROW_S * count
                    text = f"it took longer than {total_s:g} s for {count} rows in all"
                else:
                    text = f"it did not answer within {ROW_S:g} s"
                raise self._fault(text) from None
            # Only the time of waiting counts: the work of this process is not the script's.
            if self._is_ready:
                self._left_s -= time.monotonic() - began
            self._process_message(received)

    def _fault(self, text: str) -> ScriptFaultError:
        """Fault at the first unanswered row; without a row during the start."""
        return ScriptFaultError(text, self._answered if self._is_ready else None)

    def _process_message(self, received: Message | None) -> None:
        """Process READY, an answer (stored as the next row of ``answers``), or a printed line.
        Raises ScriptFaultError: anything else, as FAULT, an unexpected answer, or None, the
        worker's end."""
        if received is None and self._worker.fault:
            raise self._fault(f"its process {self._worker.fault}")
        if received is None:
            raise self._fault("it ended itself" if self._is_ready else "ended as it was started")
        if received.kind in (MessageKind.LOG, MessageKind.FAULT):
            text = received.body.decode(errors="replace")
            if received.kind is MessageKind.LOG:
                lines = text.splitlines()
                self._printed += lines if len(self._printed) < PRINTED else [""] * len(lines)
                return
            raise self._fault(text if self._is_ready else f"cannot be started: {text}")
        if received.kind is MessageKind.READY and not self._is_ready:
            self._is_ready = True
        elif (
            received.kind is MessageKind.ANSWER and self._is_ready and self._answered < self._asked
        ):
            values = decode_values(received.body)
            if values.shape != self._answers[0].shape:
                raise self._fault("its process sent no values")
            self._answers[self._answered] = values
            self._answered += 1
        else:
            raise self._fault("it sent an answer without a question")
        self._went_on_at = time.monotonic()
