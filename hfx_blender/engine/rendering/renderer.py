# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders samples to the values of one device's actuators.

Order of work: match vertices, combine per modality, substitute, look ahead by each actuator's
latency, the device's script if it has one, hold between updates, and only then its limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ...errors import InputError
from ...text import counted
from ..arrays import F64, I64, Bool
from ..body.model import PerceptualModel, load_model
from ..modality import MODALITIES, neutral_temperature_c
from ..samples import SampleRun, Stream
from ..surface.surface_drive import SurfaceDrives
from ..track.header import TrackHeader
from .conditioning.actuator_limits import DeviceLimits, advanced, held, limited, rows_of
from .conditioning.frequency import Partial, Partials, StrongestContributor
from .conditioning.mixing import Contribution, Mixed, merged, mix, substituted
from .device_config import ActuatorType, DeviceConfig
from .dispatch import ActuatorGroup, MissingActuators, ModelLoader
from .raster import FeltStream, Raster, Reason, Shortfall, columns_of
from .room import PlaySpace


@dataclass(eq=False)
class _Outcome:
    """Samples of a run, and the outcome of each at any actuator."""

    indices: I64  # (n,)
    strengths: F64  # (n,) level times strength parameter (temperature: deviation), >= 0
    is_rendered: Bool  # (n,)
    is_off: Bool  # (n,) off the actuators' frequency
    is_over: Bool  # (n,) cut by a limit
    is_faint: Bool  # (n,) below the threshold of detection

    @classmethod
    def none(cls, indices: I64, strengths: F64) -> _Outcome:
        """Outcome of samples that no group has rendered yet."""
        return cls(indices, strengths, *(np.zeros(len(indices), np.bool_) for _ in range(4)))


@dataclass(eq=False)
class _GroupShare:
    """Contribution of a run to a block, at the actuators of one group."""

    run: SampleRun
    outcome: _Outcome
    positions: I64  # (n,) rows of the block
    gains: F64  # (n, A)


class Renderer:
    """Renders the blocks of one track for one device as they come.

    Memory is one block's working arrays, the raster (8 bytes per time and column) and 20 bytes per
    sample.

    Parameters
    ----------
    models : callable
        Loads a perceptual model by its id.
    body_id : str, optional
        Who wears the device; may be left out if the track has one body.
    compensates_latency : bool
        Otherwise values stand at the time at which they are meant to be felt, whatever an
        actuator's latency.

    Attributes
    ----------
    body_id : str
        Body that wears the device.
    groups : tuple of ActuatorGroup
        The device's actuators by modality.

    Raises
    ------
    InputError
        The wearer is not known.
    """

    def __init__(
        self,
        header: TrackHeader,
        device: DeviceConfig,
        models: ModelLoader = load_model,
        *,
        body_id: str | None = None,
        compensates_latency: bool = True,
    ) -> None:
        self._header = header
        self._compensates_latency = compensates_latency
        self._device = device
        self._models = models
        self.body_id = _wearer(header, device, body_id)
        self._effects = {effect.id: effect for effect in header.effects}
        self._outcomes: dict[Stream, list[_Outcome]] = {
            stream: [] for stream in header.streams if stream.body_id == self.body_id
        }
        self._columns = columns_of(device)
        self._neutral = device.neutral
        self._lowest = np.array([control.lowest for control in device.controls], np.float64)
        self._highest = np.array([control.highest for control in device.controls], np.float64)
        self.groups = tuple(
            ActuatorGroup(device, modality, self._model) for modality in device.modalities
        )
        self._drives = SurfaceDrives(header.settings, device.surface_drive_per_m)
        play_space = PlaySpace.of_settings(header.settings)
        for group in self.groups:
            group.play_space = play_space
        self._values = np.tile(self._neutral, (header.time.sample_count, 1))
        self._next_row = 0
        self._limits: DeviceLimits | None = None
        vibrating = [a for a in device.actuators if a.type.modality == "vibration"]
        self._frequency = StrongestContributor(len(vibrating))
        self._sounding = [a for a in device.actuators if a.type.takes_waveform]
        self._partials = Partials(len(self._sounding))
        self._missing = MissingActuators(device)

    def restart(self) -> None:
        """Restart, as if nothing had been added; tables of models are kept.

        So is whose frequency actuators play: moments follow each other.
        """
        self._partials.forget()
        self._outcomes = {stream: [] for stream in self._outcomes}
        self._values = np.tile(self._neutral, (len(self._values), 1))
        self._next_row = 0

    def add(self, runs: Iterable[SampleRun]) -> None:
        """Render one block: all runs of its times; blocks follow each other in time.

        Raises
        ------
        InputError
            A place of the device does not fit a model, or a model is not the track's.
        """
        runs = [run for run in runs if run.stream.body_id == self.body_id and len(run)]
        runs = [self._drives.on_device(run) for run in runs]
        if not runs:
            return
        rows = np.unique(np.concatenate([run.indices for run in runs]))
        if rows[0] < self._next_row or rows[-1] >= len(self._values):
            raise ValueError(f"samples {rows[0]} to {rows[-1]} come out of order")
        self._next_row = int(rows[-1]) + 1
        outcomes = [
            _Outcome.none(run.indices, run.levels * np.abs(self._strength(run))) for run in runs
        ]
        for group in self.groups:
            played = [
                _GroupShare(run, outcome, np.searchsorted(rows, run.indices), group.gains(run))
                for run, outcome in zip(runs, outcomes, strict=True)
                if group.renders(run.stream.modality)
            ]
            if not played:
                continue
            is_cut = self._write(group, rows, self._mixed(group, played, rows))
            for each in played:
                fires, outcome = each.gains > 0.0, each.outcome
                outcome.is_rendered |= fires.any(axis=1)
                outcome.is_off |= group.is_off_frequency(each.run, fires)
                outcome.is_over |= (fires & is_cut[each.positions]).any(axis=1)
                outcome.is_faint |= group.is_faint(each.run, self._device.gain * each.gains)
        for run, outcome in zip(runs, outcomes, strict=True):
            self._missing.add(run)
            self._outcomes[run.stream].append(outcome)

    def notes(self) -> tuple[str, ...]:
        """Notes on differences of the rendering from the device's configuration, after all blocks.

        Tell it before :meth:`raster`, which looks ahead.
        """
        name = f"device '{self._device.id}'"
        found = [note for group in self.groups for note in group.notes()]
        found += self._missing.notes(self._header)
        late = []
        for actuator, (part, kind) in zip(self._device.actuators, self._parts(), strict=True):
            rows = self._late_rows(kind)
            if (self._values[:rows, part.start] != self._neutral[part.start]).any():
                late.append(actuator.id)
        text = f"{name}: what is felt right at the beginning comes late, or not, at actuators"
        return tuple(dict.fromkeys([*found, *counted(late, f"{text} that answer late")]))

    def _neutral_c(self, stream: Stream) -> float:
        return neutral_temperature_c(self._effects[stream.effect_id].is_contact)

    def _strength(self, run: SampleRun) -> F64:
        """The strength parameter of each sample; of temperature, its deviation."""
        if run.stream.modality == "temperature":
            return run.parameters[:, 0] - self._neutral_c(run.stream)
        return run.parameters[:, 0]

    def _model(self, model_id: str) -> PerceptualModel:
        model = self._models(model_id)
        recorded = next(each for each in self._header.models if each.id == model_id)
        if recorded.content_hash != model.content_hash:
            raise InputError(
                f"The track was recorded on body model '{model_id}' with the hash "
                f"{recorded.content_hash[:12]}..., here it has {model.content_hash[:12]}...; "
                "record it again, or use the version that it was recorded with."
            )
        return model

    def _mixed(self, group: ActuatorGroup, played: Sequence[_GroupShare], rows: I64) -> Mixed:
        mixes = []
        vibrations: list[tuple[str, F64, F64]] = []  # who, (R, A) m/s^2, (R,) Hz
        for modality in MODALITIES:
            mine = [each for each in played if each.run.stream.modality == modality]
            if not mine:
                continue
            contributions = [self._contribution(each, len(rows)) for each in mine]
            mixed = mix(modality, contributions)
            if modality != group.modality:
                mixed = substituted(mixed, self._device.substitutions[modality])
            mixes.append(mixed)
            if group.modality != "vibration":
                continue
            if modality == "vibration":
                names = [each.run.stream.effect_id for each in mine]
                vibrations += [
                    (name, each.strengths * each.parameters[:, :1], each.parameters[:, 1])
                    for name, each in zip(names, contributions, strict=True)
                ]
            elif mixed.frequencies_hz is not None:
                vibrations.append((modality, mixed.strengths, mixed.frequencies_hz[:, 0]))
        mixed = mixes[0] if len(mixes) == 1 else merged(group.modality, mixes)
        if group.modality != "vibration":
            return mixed
        for name, amplitudes, frequencies_hz in vibrations if group.takes_waveform.any() else ():
            sounding = self._device.gain * amplitudes[:, group.takes_waveform]
            self._partials.add(name, rows, sounding, frequencies_hz)
        frequencies = self._frequency.frequencies(
            [name for name, _, _ in vibrations],
            np.stack([amplitudes for _, amplitudes, _ in vibrations]),
            np.stack([frequencies_hz for _, _, frequencies_hz in vibrations]),
        )
        return Mixed(mixed.strengths, frequencies)

    def _contribution(self, played: _GroupShare, row_count: int) -> Contribution:
        run = played.run
        strengths = np.zeros((row_count, played.gains.shape[1]))
        strengths[played.positions] = played.gains * run.levels[:, None]
        parameters = np.zeros((row_count, run.parameters.shape[1]))
        parameters[played.positions] = run.parameters
        return Contribution(strengths, parameters, self._neutral_c(run.stream))

    def _write(self, group: ActuatorGroup, rows: I64, mixed: Mixed) -> Bool:
        """Write mixed strengths into the raster; returns the mask (R, A) of values that a limit
        cuts.
        """
        strengths = group.neutral + self._device.gain * mixed.strengths
        self._values[rows[:, None], group.strength_columns] = strengths
        if mixed.frequencies_hz is not None:
            columns = group.strength_columns + 1
            is_silent = mixed.strengths == 0.0
            frequencies = np.where(is_silent, self._neutral[columns], mixed.frequencies_hz)
            self._values[rows[:, None], columns] = frequencies
        return np.asarray((strengths < group.lowest) | (strengths > group.highest))

    def first_row(self) -> F64:
        """Values (columns,) at the first time, within the device's limits; nothing is held."""
        if self._limits is None:
            self._limits = DeviceLimits(self._device)
        return self._limits.joined(self._limits.by_actuator(self._values[0]))

    def gains(self, run: SampleRun) -> F64:
        """Gain of each actuator for each sample of a run, (n, A) in 0..1.

        Raises
        ------
        InputError
            A place of the device does not fit a model that it is to play.
        """
        found = np.zeros((len(run), len(self._device.actuators)))
        for group in self.groups:
            try:
                found[:, group.members] = group.gains(run)
            except InputError:
                if group.renders(run.stream.modality):
                    raise  # its places need not fit other modalities' models
        return found

    def script_input(self) -> F64:
        """Values for a device's script, (T, columns), as they would be sent without it; after all
        blocks.

        Values look ahead and are within limits, as live; they are held after the script.
        """
        found = np.zeros_like(self._values)
        for part, kind in self._parts():
            found[:, part] = self._limited(self._early(part, kind), part)
        return found

    def raster(self, answers: F64 | None = None) -> Raster:
        """The finished raster; nothing can be added after it.

        Parameters
        ----------
        answers : (T, columns) float64, optional
            What a device's script has made of :meth:`script_input`. It is what the device plays:
            held between updates and limited as any values are. What it does not change is rendered
            as without it; of what is felt where it does, all is, or nothing if it is silent.
        """
        time = self._header.time
        for part, kind in self._parts():
            self._values[:, part] = self._held(self._early(part, kind), part, kind)
        felt = tuple(_felt(stream, outcomes) for stream, outcomes in self._outcomes.items())
        shortfalls = tuple(self._shortfalls(felt))
        partials = self.partials()
        if answers is not None:
            without, self._values = self._values, np.zeros_like(self._values)
            for part, kind in self._parts():
                self._values[:, part] = self._held(answers[:, part], part, kind)
            partials = ()  # a script says one frequency for each actuator
            is_changed, is_on = self._changes(without)
            if is_changed.any():
                felt = tuple(
                    replace(
                        each,
                        is_rendered=np.where(
                            is_changed[each.indices], is_on[each.indices], each.is_rendered
                        ),
                    )
                    for each in felt
                )
                # How far a script has compensated limits of the actuators is unknown.
                shortfalls = tuple(
                    each for each in self._shortfalls(felt) if each.reason in _UNPLAYED
                )
        self._next_row = len(self._values)
        return Raster(
            device_id=self._device.id,
            body_id=self.body_id,
            actuators=tuple(actuator.id for actuator in self._device.actuators),
            columns=self._columns,
            times_s=time.times_s(np.arange(len(self._values))),
            rate_hz=time.rate_hz,
            values=self._values,
            neutral=self._neutral,
            shortfalls=shortfalls,
            felt=felt,
            waveform_actuators=tuple(each.id for each in self._sounding) if answers is None else (),
            partials=partials,
        )

    def _parts(self) -> Iterator[tuple[slice, ActuatorType]]:
        """Columns and type of each actuator."""
        kinds = (actuator.type for actuator in self._device.actuators)
        return zip(self._device.actuator_columns, kinds, strict=True)

    def _late_rows(self, kind: ActuatorType) -> int:
        return (
            rows_of(self._header.time.rate_hz, kind.latency_ms) if self._compensates_latency else 0
        )

    def _early(self, part: slice, kind: ActuatorType) -> F64:
        latency_ms = kind.latency_ms if self._compensates_latency else 0.0
        rate_hz = self._header.time.rate_hz
        return advanced(self._values[:, part], self._neutral[part], rate_hz, latency_ms)

    def _limited(self, values: F64, part: slice) -> F64:
        return limited(values, self._lowest[part], self._highest[part], self._neutral[part])

    def _held(self, values: F64, part: slice, kind: ActuatorType) -> F64:
        """Values of one actuator as it gets them: held between its updates, and limited."""
        rate_hz, interval_ms = self._header.time.rate_hz, kind.update_interval_ms
        return self._limited(held(values, self._neutral[part], rate_hz, interval_ms), part)

    def _changes(self, without: F64) -> tuple[Bool, Bool]:
        """Rows (T,) that a script changed, and rows in which any actuator plays, as two masks.

        It is played then, or earlier by an actuator's latency.
        """
        is_changed, is_on = np.zeros((2, len(without)), np.bool_)
        for part, kind in self._parts():
            changed = (self._values[:, part] != without[:, part]).any(axis=1)
            on = self._values[:, part.start] != self._neutral[part.start]
            for rows in {0, min(self._late_rows(kind), len(without))}:
                is_changed[rows:] |= changed[: len(changed) - rows]
                is_on[rows:] |= on[: len(on) - rows]
        return is_changed, is_on

    def partials(self) -> tuple[Partial, ...]:
        """Partials of each effect so far at the actuators that take a waveform, within limits."""
        if not self._sounding:
            return ()
        kinds = [actuator.type for actuator in self._sounding]
        late = [self._late_rows(kind) for kind in kinds]
        return self._partials.finished(
            len(self._values),
            late,
            np.array([kind.controls[1].lowest for kind in kinds]),
            np.array([kind.controls[1].highest for kind in kinds]),
            np.array([kind.strength.highest for kind in kinds]),
        )

    def _why_not(self, stream: Stream) -> Reason:
        """Reason why samples of a stream drive no actuator."""
        effect = self._effects[stream.effect_id]
        if effect.device_id is not None and effect.device_id != self._device.id:
            return "device"
        can = any(group.renders(stream.modality) for group in self.groups)
        return "place" if can else "modality"

    def _shortfalls(self, felt: Iterable[FeltStream]) -> Iterator[Shortfall]:
        for each in felt:
            outcomes = self._outcomes[each.stream]
            losses: dict[Reason, list[Bool]] = {
                self._why_not(each.stream): [~each.is_rendered],
                "frequency": [one.is_off for one in outcomes],
                "limit": [one.is_over for one in outcomes],
                "threshold": [one.is_faint for one in outcomes],
            }
            for reason, masks in losses.items():
                samples = sum(int(np.count_nonzero(mask)) for mask in masks)
                if samples:
                    yield Shortfall(
                        each.stream.effect_id,
                        each.stream.body_id,
                        each.stream.modality,
                        reason,
                        samples,
                        share=samples / len(each.indices),
                        seconds=samples / float(self._header.time.rate_hz),
                    )


def _felt(stream: Stream, outcomes: list[_Outcome]) -> FeltStream:
    return FeltStream(
        stream,
        np.concatenate([np.zeros(0, np.int64), *(each.indices for each in outcomes)]),
        np.concatenate([np.zeros(0), *(each.strengths for each in outcomes)]),
        np.concatenate([np.zeros(0, np.bool_), *(each.is_rendered for each in outcomes)]),
    )


_UNPLAYED: Final[tuple[Reason, ...]] = ("modality", "place", "device")
"""Reasons for which something does not play at all."""


def _wearer(header: TrackHeader, device: DeviceConfig, body_id: str | None) -> str:
    ids = [body.id for body in header.bodies]
    if body_id is None and len(ids) == 1:
        return ids[0]
    if body_id not in ids:
        names = ", ".join(f"'{body.name}' ({body.id})" for body in header.bodies) or "none"
        found = "no body is chosen" if body_id is None else f"there is no body '{body_id}'"
        raise InputError(f"Device '{device.id}': {found} to wear it; the track has: {names}.")
    return str(body_id)
