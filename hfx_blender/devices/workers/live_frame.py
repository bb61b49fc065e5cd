# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding of a scene and of moments for the render worker.

A moment is a :class:`LiveFrame` with the objects of Blender's evaluation, encoded in a thread. All
runs are joined in a few arrays: the size of the JSON part does not depend on the number of effects.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from itertools import chain
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.samples import Drive, SampleRun, Stream
from ...engine.track.header import TrackHeader
from ...engine.track.layout import from_json, to_json
from ...processes.messages import MessageError, decode_json, encode_json
from .haptics import ARRAYS
from .message_bodies import Array, decode_arrays, encode_arrays

_PARAMETERS: Final = max(len(modality.parameters) for modality in MODALITIES.values())


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """Current samples and settings of the open scene."""

    time_s: float  # on the scene's clock
    runs: Sequence[SampleRun]  # of one sample, or of none
    gains: Mapping[int, float] = field(default_factory=dict)  # by device number; 0: mute, default 1
    play_space: F64 | None = None  # (4, 4) play space to world, metres
    # Runs at ``time_s`` plus a latency, by latency in ms; missing where not known.
    later: Mapping[float, Sequence[SampleRun]] = field(default_factory=dict)


@dataclass(frozen=True)
class RenderedDevice:
    """Device for the render worker."""

    number: int
    configuration: str  # name or file
    folder: str | None  # of the user's configurations
    has_script: bool
    scheme: str = ""  # rendering scheme; "": as configured
    body_id: str = ""  # wearer; "": the body of the scene message
    profile: str = ""  # of a person; "": none


@dataclass(frozen=True, eq=False)
class SceneMessage:
    """Scene data for the rendering of later moments."""

    header: TrackHeader
    body_id: str
    devices: tuple[RenderedDevice, ...]


def encode_scene(scene: SceneMessage) -> bytes:
    """Encode a scene as the body of a message."""
    devices = [astuple(device) for device in scene.devices]
    header = to_json(scene.header, {}).decode()
    return encode_json({"header": header, "body": scene.body_id, "devices": devices})


def decode_scene(body: bytes) -> SceneMessage:
    """Decode a body of :func:`encode_scene`; MessageError if invalid."""
    content = decode_json(body)
    try:
        header, _ = from_json(content["header"].encode())
        devices = tuple(RenderedDevice(*members) for members in content["devices"])
        return SceneMessage(header, str(content["body"]), devices)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise MessageError(f"not a scene: {error}") from None


def encode_live_frame(moment: LiveFrame, places: Mapping[Stream, int]) -> bytes:
    """Encode a moment as the body of a message.

    ``places`` has the index of each stream in the scene's header; KeyError for a stream of
    another scene.
    """
    arrays: dict[str, Array] = {}
    content: dict[str, Any] = {
        "time_s": moment.time_s,
        "gains": [[number, gain] for number, gain in moment.gains.items()],
        # Runs without a sample are not sent, so they do not count.
        "later": [[ms, sum(len(run) > 0 for run in runs)] for ms, runs in moment.later.items()],
        "drives": _add_runs([*moment.runs, *chain(*moment.later.values())], places, arrays),
    }
    if moment.play_space is not None:
        arrays["play_space"] = np.asarray(moment.play_space, np.float64)
    return encode_arrays(content, arrays)


def _add_runs(
    runs: Iterable[SampleRun], places: Mapping[Stream, int], arrays: dict[str, Array]
) -> list[Any]:
    """Add the K runs with a sample to ``arrays`` in place, rows in order and vertices concatenated.
    Missing parameters and focus are NaN. Returns ``[run number, device id, actuators, values]`` of
    each run with a drive."""
    present = [run for run in runs if len(run)]
    # Rows of equal width for all modalities, so that one array holds all runs.
    parameters = np.full((len(present), _PARAMETERS), np.nan)
    focus = np.full((len(present), 4), np.nan)
    drives = []
    for k, run in enumerate(present):
        parameters[k, : run.parameters.shape[1]] = run.parameters[0]
        if run.focus is not None:
            focus[k] = run.focus[0]
        if run.drive is not None:
            drive = run.drive
            drives.append([k, drive.device_id, list(drive.actuators), drive.values[0].tolist()])
    arrays["streams"] = np.array([places[run.stream] for run in present], np.int32)
    arrays["levels"] = np.array([run.levels[0] for run in present], np.float64)
    arrays["parameters"] = parameters
    arrays["focus"] = focus
    arrays["counts"] = np.array([len(run.vertices) for run in present], np.int32)
    # The empty array stands for no runs at all.
    arrays["vertices"] = np.concatenate([np.zeros(0, np.int32), *(x.vertices for x in present)])
    arrays["weights"] = np.concatenate([np.zeros(0, np.float32), *(x.weights for x in present)])
    for name in ARRAYS:
        # Only some runs have the array: a mask marks the runs.
        details = [getattr(run, name) for run in present]
        parts = [detail for detail in details if detail is not None]
        if parts:
            has = [detail is not None for detail in details]
            arrays[f"has {name}"] = np.array(has, np.int32)
            arrays[name] = np.concatenate(parts).astype(np.float32)
    return drives


def decode_live_frame(body: bytes, streams: Sequence[Stream]) -> LiveFrame:
    """Decode a body of :func:`encode_live_frame`; MessageError if invalid."""
    content, arrays = decode_arrays(body)
    try:
        runs = _runs(content["drives"], float(content["time_s"]), streams, arrays)
        # The runs of all latencies follow the present runs, so the last latency is cut off first.
        later: dict[float, Sequence[SampleRun]] = {}
        for ms, count in reversed(content["later"]):
            start = len(runs) - int(count)
            after_s = float(ms) / 1e3
            later[float(ms)] = [replace(run, times_s=run.times_s + after_s) for run in runs[start:]]
            runs = runs[:start]
        return LiveFrame(
            float(content["time_s"]),
            runs,
            {int(number): float(gain) for number, gain in content["gains"]},
            arrays.get("play_space"),
            later,
        )
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise MessageError(f"not a moment: {error}") from None


def _runs(
    drives: Sequence[Any], time_s: float, streams: Sequence[Stream], arrays: Mapping[str, Array]
) -> list[SampleRun]:
    """Runs of one sample at ``time_s`` from the return value and arrays (as views) of
    :func:`_add_runs`; ``streams``: of the scene's header, by index."""
    counts = arrays["counts"]
    ends = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    # A drive gives values of a device's actuators directly; few runs have a drive.
    driven = {
        k: Drive(device, tuple(names), np.array([values], np.float32))
        for k, device, names, values in drives
    }
    first = dict.fromkeys(ARRAYS, 0)
    runs = []
    # Optional arrays hold rows only of runs with them: ``first`` is the next unread row.
    for k, index in enumerate(arrays["streams"].tolist()):
        part = slice(int(ends[k]), int(ends[k + 1]))
        more: dict[str, Any] = {}
        for name in ARRAYS:
            if name in arrays and arrays[f"has {name}"][k]:
                stop = first[name] + int(counts[k])
                more[name] = arrays[name][first[name] : stop]
                first[name] = stop
        width = len(MODALITIES[streams[index].modality].parameters)
        parameters = arrays["parameters"][k : k + 1, :width]
        # A run without focus has NaN.
        focus = arrays["focus"][k]
        runs.append(
            SampleRun(
                streams[index],
                np.zeros(1, np.int64),
                np.array([time_s]),
                arrays["levels"][k : k + 1],
                parameters,
                np.array([0, part.stop - part.start]),
                arrays["vertices"][part],
                arrays["weights"][part],
                focus=None if np.isnan(focus).all() else focus[None].astype(np.float32),
                drive=driven.get(k),
                **more,
            )
        )
    return runs
