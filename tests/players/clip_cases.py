# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips of ``players/conformance``: devices' output for random tracks and demo tracks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import numpy.typing as npt
from telling import Telling

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.render import renderers_of_track
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import Clip, TimeBase
from hfx_blender.engine.track import TrackHeader, TrackReader, TrackWriter
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackModel
from hfx_blender.formats.clip.clip_writer import write

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """Clip file, and the expected output computed without the clip."""

    name: str
    path: Path
    telling: Telling


@dataclass(frozen=True)
class Spec:
    """Random track by seed, and the devices of the clip."""

    name: str
    modalities: str  # initials of the effects' modalities
    devices: str
    rate_hz: Fraction = Fraction(100)
    samples: int = 240
    bodies: int = 1
    way: str = "mixed"  # of the levels: mixed, pulses, square, silent


def _specs() -> list[Spec]:
    vibrating = "oculus_touch phone_lra waist_belt mango_pad bhaptics_tactosy_left insoles"
    specs = [
        Spec("touch", "v", "oculus_touch"),
        Spec("phone", "vv", "phone_wide_band"),
        Spec("belt", "vvv", "waist_belt"),
        Spec("suit", "vvp", "bhaptics_tactsuit_x40"),
        Spec("vest", "pp", "pressure_vest"),
        Spec("peltier", "tt", "peltier_sleeve_left"),
        Spec("heater", "tw", "fan_heater"),
        Spec("fan", "ww", "dyson_pure_cool_link"),
        Spec("everything", "vptw", "back_pad pressure_vest fan_heater peltier_sleeve_right"),
        Spec("two_bodies", "vpvt", "oculus_touch pressure_vest", bodies=2),
        Spec("three_bodies", "vw", "insoles fan_heater", bodies=3),
        Spec("substituted", "pt", "oculus_touch waist_belt"),
        Spec("one_row", "v", "oculus_touch", samples=1),
        Spec("two_rows", "vt", "oculus_touch fan_heater", samples=2),
        Spec("silent", "v", "waist_belt", way="silent"),
        Spec("pulses", "vpt", "waist_belt pressure_vest fan_heater", way="pulses"),
        Spec("square", "v", "sound_card_8", Fraction(1000), 3000, way="square"),
        Spec("square_heat", "t", "fan_heater", Fraction(50), 300, way="square"),
        Spec("kilohertz", "vv", "phone_lra", Fraction(1000), 2500),
        Spec("slow", "vt", "mango_pad fan_heater", Fraction(1, 2), 40),
        Spec("film", "vw", "insoles dyson_pure_cool_link", Fraction(24000, 1001)),
        Spec("odd_rate", "vp", "head_band pressure_vest", Fraction(1000, 7)),
        Spec("subpac", "v", "subpac_m2", Fraction(500), 1000),
        Spec("many", "vptw", vibrating + " pressure_vest fan_heater"),
    ]
    rates = (Fraction(24), Fraction(60), Fraction(90), Fraction(100), Fraction(250))
    kinds = ("v", "vv", "vp", "vt", "vw", "ptw", "vptw", "vvvv")
    for k in range(24):
        devices = vibrating.split()[k % 6]
        if k % 3 == 0:
            devices += " pressure_vest fan_heater"
        way = ("mixed", "pulses", "square")[k % 4 % 3]
        kind = kinds[k % 8]
        specs.append(Spec(f"seed_{k:02}", kind, devices, rates[k % 5], 150 + 10 * k, way=way))
    return specs


SPECS = _specs()
DEMOS = ("garage", "surfaces")


def case_of(spec: Spec, folder: Path) -> Case:
    """Write the clip of a spec into a folder and return the case."""
    seed = list(spec.name.encode())
    with _track(spec, folder, np.random.default_rng(seed)) as track:
        return _case(track, [load_device(name) for name in spec.devices.split()], spec.name, folder)


def cases(folder: Path, demos: Sequence[str] = DEMOS) -> Iterator[Case]:
    """Yield all clips in order; clips of demos need Blender."""
    for spec in SPECS:
        yield case_of(spec, folder)
    for name in demos:
        created = folder / f"demo_{name}"
        command = [sys.executable, "-m", "hfx_blender", "demo", "-o", str(created)]
        command += ["--scene", name, "--no-pictures"]
        subprocess.run(command, check=True, capture_output=True)
        (path,) = created.glob("*.hfxtrack")
        ids = {path.name.split(".")[1] for path in created.glob("*.csv")}
        with TrackReader(path) as track:
            yield _case(
                track, [load_device(number) for number in sorted(ids)], f"demo_{name}", folder
            )


def _case(track: TrackReader, devices: list[DeviceConfig], name: str, folder: Path) -> Case:
    rendered: list[tuple[DeviceConfig, Raster]] = [
        (device, renderer.raster()) for device, renderer in renderers_of_track(track, devices)
    ]
    (path,) = write(track.header, rendered, folder / name).files
    clips = {
        clip.name: (int(clip.frame_start), int(clip.frame_end), clip.name.endswith("loop"))
        for effect in track.header.effects
        for clip in effect.clips
        if not name.startswith("demo")  # frames of demos differ from samples
    }
    return Case(name, path, Telling(rendered, clips))


def _track(spec: Spec, folder: Path, random: np.random.Generator) -> TrackReader:
    """Write a track of effects on many places of the skin, one frame per sample."""
    time = TimeBase(spec.rate_hz, spec.rate_hz, 0, 0, spec.samples - 1)
    of_initial = {name[0]: name for name in MODALITIES}
    effects, streams, runs = [], [], []
    models = {}
    for k, initial in enumerate(spec.modalities):
        modality = of_initial[initial]
        model = load_model(f"hfx-{MODALITIES[modality].model}-1")
        models[model.id] = TrackModel(model.id, model.modality, model.content_hash, len(model))
        body = f"b{k % spec.bodies}"
        vertices = np.flatnonzero(random.random(len(model)) < 0.1).astype(np.int32)
        first, last = sorted(random.integers(0, spec.samples, 2).tolist())
        name = f"part {k}" + " loop" * (k % 2)
        clip = Clip(name, float(first), float(last))
        effects.append(
            TrackEffect(f"e{k}", f"Effect {k}", modality, "painted", model.id, k % 2 == 1, (clip,),
                        len(vertices))
        )  # fmt: skip
        stream = Stream(f"e{k}", body, modality, model.id)
        streams.append(stream)
        levels = _levels(spec, random)
        indices = np.flatnonzero(levels > 0.0)
        if len(indices):
            runs.append(
                SampleRun(
                    stream=stream,
                    indices=indices,
                    times_s=time.times_s(indices),
                    levels=levels[indices],
                    parameters=_parameters(modality, spec.samples, random)[indices],
                    sets=np.zeros(len(indices), np.int64),
                    offsets=np.array([0, len(vertices)]),
                    vertices=vertices,
                    weights=random.uniform(0.3, 1.0, len(vertices)).astype(np.float32),
                )
            )
    header = TrackHeader(
        time=time,
        models=tuple(models.values()),
        bodies=tuple(TrackBody(f"b{k}", f"Body {k}") for k in range(spec.bodies)),
        effects=tuple(effects),
        streams=tuple(streams),
    )
    path = folder / f"{spec.name}.hfxtrack"
    with TrackWriter(path, header, full_precision=True) as writer:
        writer.append(runs)
    return TrackReader(path)


def _levels(spec: Spec, random: np.random.Generator) -> F64:
    count = spec.samples
    if spec.way == "silent":
        return np.zeros(count)
    if spec.way == "square":
        return (np.arange(count) // random.integers(1, 40) % 2 == 0).astype(np.float64)
    if spec.way == "pulses":
        return np.where(random.random(count) < 0.03, random.uniform(0.05, 1.0, count), 0.0)
    knots = np.sort(random.integers(0, count, 8))
    slow = np.interp(np.arange(count), knots, random.uniform(-0.5, 1.0, 8))
    hits = np.where(random.random(count) < 0.02, random.random(count), 0.0)
    return np.clip(np.maximum(slow, hits), 0.0, 1.0)


def _parameters(modality: str, count: int, random: np.random.Generator) -> F64:
    """Return parameters changing with time, (T, P)."""
    share = np.interp(np.arange(count), np.linspace(0, count, 5), random.random(5))
    if modality == "vibration":
        return np.column_stack([2.0 + 30.0 * share, 20.0 + 400.0 * share[::-1]])
    if modality == "pressure":
        return (60.0 * share)[:, None]
    if modality == "temperature":
        return (-20.0 + 80.0 * share)[:, None]
    return np.column_stack([20.0 * share, np.tile([0.0, -1.0, 0.0], (count, 1))])
