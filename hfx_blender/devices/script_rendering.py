# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders devices for an export, their scripts included.

A script is run as live playback runs it, by the same worker, but for each row of the raster, in
the order of time, from the track's first row to its last. So its state depends on the track
alone, whoever recorded it in however many parts.
"""

from __future__ import annotations

import logging
import subprocess
import threading
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from typing import Final

import numpy as np

from ..engine.arrays import F64
from ..engine.rendering.device import DeviceConfig
from ..engine.rendering.devices import Played, renderers_of_track
from ..engine.rendering.render import Renderer, blocks
from ..engine.samples import SampleRun
from ..engine.stepwise import finish
from ..engine.track import TrackHeader, TrackReader
from ..errors import InputError, ScriptError
from ..processes import start
from .live import approval
from .workers.haptics import encode_haptics
from .workers.messages import (
    MessageError,
    MessageKind,
    decode_values,
    encode_json,
    message,
    read_message,
)
from .workers.script_process import end_group

FeltRuns = list[tuple[SampleRun, F64]]

START_S: Final = 60.0
"""Time limit of a script's start, seconds: it may import what it needs, on a busy machine."""

ROW_S: Final = 10.0
"""Time limit of a script for one row, seconds; live it has 0.1."""

SUM_S: Final = 60.0
SUM_ROW_S: Final = 0.1
"""Time per row that is added to the limit for all rows, seconds, as live."""

_BATCH_ROWS: Final = 64
_BATCH_BYTES: Final = 1 << 20
"""Size of a batch of rows, bytes; the next batch waits in the pipe meanwhile."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rendered:
    """Rendered rasters, and the devices without one."""

    played: list[Played]
    silent: Mapping[str, str] = field(default_factory=dict)  # by device: why it plays nothing
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def without(self, silent: Mapping[str, str]) -> Rendered:
        """Copy in which some devices play nothing."""
        played = [each for each in self.played if each[0].id not in silent]
        return replace(self, played=played, silent={**self.silent, **silent})

    def complete(self) -> Rendered:
        """Itself, with all devices.

        Raises
        ------
        ScriptError
            A device plays nothing.
        """
        for reason in self.silent.values():
            raise ScriptError(f"{reason}.")
        return self


def render_devices(track: TrackReader, devices: Sequence[DeviceConfig]) -> list[Played]:
    """A recorded track, rendered for each device on each body.

    Raises
    ------
    ScriptError
        A device's script may not run, or has failed.
    InputError
        A place of a device does not fit a model, or a model is not the track's.
    """
    return finish(rendering(track, renderers_of_track(track, devices))).complete().played


def rendering(
    track: TrackReader, renderers: Sequence[tuple[DeviceConfig, Renderer]]
) -> Generator[float, None, Rendered]:
    """Render devices, whose renderers have been given all of a track, in steps.

    The track is read once more for each script. A device whose script fails on one body plays
    nothing on any.
    """
    played: list[Played] = []
    silent: dict[str, str] = {}
    notes: list[str] = []
    warnings: list[str] = []
    for device, renderer in renderers:
        if device.id in silent:
            continue  # its reason is told once
        answers = None
        if device.script is not None:
            try:
                answers = yield from _answers(track, device, renderer)
            except ScriptError as error:
                silent[device.id] = str(error)
                continue
            lost = int(np.count_nonzero(~np.isfinite(answers).all(axis=1)))
            if lost:
                warnings.append(
                    f"device '{device.id}': its script gave no number at {lost} of "
                    f"{len(answers)} times; actuators were silent then"
                )
        notes += renderer.notes()
        played.append((device, renderer.raster(answers)))
    return Rendered(played, {}, tuple(notes), tuple(warnings)).without(silent)


def _answers(
    track: TrackReader, device: DeviceConfig, renderer: Renderer
) -> Generator[float, None, F64]:
    """Answers of a device's script for each row, (T, columns).

    Raises
    ------
    ScriptError
        It may not run, or has failed.
    """
    script = _approved_script(device)
    script_input = renderer.script_input()
    answers = np.zeros_like(script_input)
    row = 0
    times_s = _scene_times_s(track.header)
    try:
        with _Worker(script, device, answers) as worker:
            batch: list[bytes] = []
            size = 0
            for felt in _felt_by_row(track, renderer):
                haptics = encode_haptics(times_s[row], felt, script_input[row])
                batch.append(message(MessageKind.HAPTICS, 0, haptics))
                size += len(batch[-1])
                row += 1
                if len(batch) >= _BATCH_ROWS or size >= _BATCH_BYTES:
                    worker.ask(batch)
                    batch, size = [], 0
                    yield 1.0  # the track is complete; progress of reading it again is not shown
            worker.ask(batch)
            worker.wait()
    except MessageError as error:  # more than a message holds
        reason = f"cannot be told {error}{_when(track.header, row)}"
        raise ScriptError(_nothing_for(device, script, reason)) from None
    except _FaultError as error:
        reason = str(error)
        if error.row is not None:
            reason = f"failed{_when(track.header, error.row)}: {reason}"
        raise ScriptError(_nothing_for(device, script, reason)) from None
    return answers


def _approved_script(device: DeviceConfig) -> approval.DeviceScript:
    """Approved script of a device, in its present state.

    Raises
    ------
    ScriptError
        It cannot be read, or the user has not approved it as it is.
    """
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
    return f"device '{device.id}' plays nothing: its script {script.path} {reason}"


def _when(header: TrackHeader, row: int) -> str:
    """Time of a row as the script gets it, as text."""
    frame = float(header.time.frame(min(row, header.time.sample_count - 1)))
    return f" at {frame / float(header.time.fps):.3f} s (frame {frame:g})"


def _scene_times_s(header: TrackHeader) -> list[float]:
    """The scene's time at each row, as live: that of its frame, and frame 0 is at 0 s."""
    fps = float(header.time.fps)
    return [float(header.time.frame(row)) / fps for row in range(header.time.sample_count)]


def _felt_by_row(track: TrackReader, renderer: Renderer) -> Iterator[FeltRuns]:
    """Effects on the wearer at each row of a track, with their gains at each actuator."""
    nothing: FeltRuns = []
    row = 0
    for block in blocks(track.header, track.runs()):
        runs = [run for run in block if run.stream.body_id == renderer.body_id and len(run)]
        gains = [renderer.gains(run) for run in runs]
        indices = [[*run.indices.tolist(), -1] for run in runs]
        places = [0] * len(runs)
        for index in sorted({index for each in indices for index in each[:-1]}):
            for _ in range(row, index):
                yield nothing
            felt = []
            for n, k in enumerate(places):
                if indices[n][k] == index:
                    felt.append((runs[n].one(k), gains[n][k]))
                    places[n] += 1
            yield felt
            row = index + 1
    for _ in range(row, track.header.time.sample_count):
        yield nothing


class _FaultError(Exception):
    """Fault of a script, with its row if it was asked one."""

    def __init__(self, text: str, row: int | None = None) -> None:
        super().__init__(text)
        self.row = row


class _Worker:
    """Worker of a script, which is asked row after row; it ends with the ``with`` block.

    One thread writes, as a worker that does not read must keep nobody waiting; one reads.

    Parameters
    ----------
    answers : (T, columns) float64
        Is filled row by row.
    """

    def __init__(self, script: approval.DeviceScript, device: DeviceConfig, answers: F64) -> None:
        assert device.script is not None
        self._answers = answers
        self._request = {**script.as_request(), "device": str(device.script.device), "folder": None}
        self._answers_changed = threading.Condition()
        self._unsent: SimpleQueue[bytes | None] = SimpleQueue()
        self._asked = self._answered = self._last = 0  # rows; asked before the last batch
        self._is_ready = False
        self._fault: str | None = None
        self._went_on_at = 0.0
        self._left_s = SUM_S + SUM_ROW_S * len(answers)

    def __enter__(self) -> _Worker:
        try:
            self._process = start.start(
                start.command("devices.workers.script_worker"),
                # Where a script goes through a set, it does so in one order.
                {"PYTHONHASHSEED": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # it ends together with its child processes
            )
        except OSError as error:  # too many processes, no memory
            raise _FaultError(f"cannot be started: {error}") from None
        self._went_on_at = time.monotonic()
        for work in (self._write, self._listen):
            threading.Thread(target=work, args=(self._process,), daemon=True).start()
        self._unsent.put(message(MessageKind.HEARTBEAT, 0, encode_json(self._request)))
        return self

    def __exit__(self, *_: object) -> None:
        with self._answers_changed:
            self._fault = self._fault or "was ended"
        end_group(self._process)
        self._unsent.put(None)
        self._process.wait()

    def ask(self, batch: Sequence[bytes]) -> None:
        """Send the messages of the next rows, after the rows before the last are answered.

        Raises
        ------
        _FaultError
            The script has failed, or does not answer.
        """
        self.wait(self._asked - self._last)
        with self._answers_changed:
            if self._answered == self._asked:
                self._went_on_at = time.monotonic()
            self._last, self._asked = self._asked, self._asked + len(batch)
        self._unsent.put(b"".join(batch))

    def wait(self, most: int = 0) -> None:
        """Wait until at most ``most`` rows are not answered.

        Raises
        ------
        _FaultError
            The script has failed, or does not answer.
        """
        with self._answers_changed:
            while self._fault is None and (
                not self._is_ready or self._asked - self._answered > most
            ):
                began = time.monotonic()
                patience_s = ROW_S if self._is_ready else START_S
                left_s = min(self._went_on_at + patience_s - began, self._left_s)
                if left_s <= 0.0:
                    self._fault = self._late(patience_s)
                    break
                self._answers_changed.wait(left_s)
                if self._is_ready:
                    self._left_s -= time.monotonic() - began
            if self._fault is not None:
                raise _FaultError(self._fault, self._answered if self._is_ready else None)

    def _late(self, patience_s: float) -> str:
        if not self._is_ready:
            return f"did not start within {patience_s:g} s"
        if self._left_s <= 0.0:
            allowed_s = SUM_S + SUM_ROW_S * len(self._answers)
            return f"it took longer than {allowed_s:g} s for {len(self._answers)} rows in all"
        return f"it did not answer within {patience_s:g} s"

    def _write(self, process: subprocess.Popen[bytes]) -> None:
        stream = process.stdin
        assert stream is not None
        with suppress(OSError, ValueError):  # the listener reports it
            while (data := self._unsent.get()) is not None:
                stream.write(data)
                stream.flush()
        with suppress(OSError, ValueError):
            stream.close()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        stream = process.stdout
        assert stream is not None
        text: str | None
        try:
            with stream:
                while True:
                    found = read_message(stream)
                    if found is None:
                        text = "it ended itself" if self._is_ready else "ended as it was started"
                        break
                    text = self._process_message(found.kind, found.body)
                    if text is not None:
                        break
        except (MessageError, OSError, ValueError) as error:
            text = f"its process sent {error}"
        with self._answers_changed:
            self._fault = self._fault or text
            self._answers_changed.notify()

    def _process_message(self, kind: MessageKind, body: bytes) -> str | None:
        """Process a message of the worker; returns its fault."""
        if kind is MessageKind.FAULT:
            text = body.decode(errors="replace")
            return text if self._is_ready else f"cannot be started: {text}"
        if kind is MessageKind.LOG:
            _log.info("%s: %s", self._request["path"], body.decode(errors="replace"))
            return None
        with self._answers_changed:
            if kind is MessageKind.READY and not self._is_ready:
                self._is_ready = True
            elif kind is MessageKind.ANSWER and self._is_ready and self._answered < self._asked:
                values = decode_values(body)
                if values.shape != self._answers[0].shape:
                    return "its process sent no values"
                self._answers[self._answered] = values
                self._answered += 1
            else:
                return "it sent an answer without a question"
            self._went_on_at = time.monotonic()
            if not self._asked - self._answered or self._answered == self._last:
                self._answers_changed.notify()
        return None
