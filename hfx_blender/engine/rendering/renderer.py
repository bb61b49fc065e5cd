# SPDX-License-Identifier: GPL-3.0-or-later
"""Renderer of samples to the values of a device's actuators.

Steps: match vertices, combine effects of a modality, substitute, advance by each actuator's
latency, run the device's script, hold between updates, limit.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ...errors import InputError
from ...text import counted
from ..areas.felt_times import has_strength
from ..arrays import F64, I64, Bool
from ..body.model import PerceptualModel, load_model
from ..modality import MODALITIES, neutral_temperature_c
from ..samples import SampleRun, Stream
from ..surface.surface_drive import SurfaceDrives
from ..track.header import TrackHeader
from .conditioning import frequency
from .conditioning.actuator_limits import DeviceLimits, advanced, held, limited, rounded, rows_of
from .conditioning.feel import Feel, SkinMemory
from .conditioning.mixing import Contribution, Mixed, merged, mix, substituted
from .device_config import ActuatorType, DeviceConfig
from .dispatch import ActuatorGroup, MissingActuators, ModelLoader
from .panning.bursts import Bursts, rhythm_s
from .raster import FeltStream, Raster, Reason, Shortfall, columns_of
from .room import PlaySpace

_UNPLAYED: Final[tuple[Reason, ...]] = ("modality", "place", "device")
"""Reasons of samples that no actuator plays."""


@dataclass(eq=False)
class _Outcome:
    """Samples of a run, with the outcome of each sample over all actuators."""

    indices: I64  # (n,)
    strengths: F64  # (n,) as of FeltStream
    is_rendered: Bool  # (n,)
    is_off: Bool  # (n,) frequency out of range
    is_over: Bool  # (n,) cut by a limit
    is_faint: Bool  # (n,) below the detection threshold
    is_small: Bool  # (n,) below the first allowed value


@dataclass(eq=False)
class _GroupShare:
    """A run and its gains at the actuators of one group."""

    run: SampleRun
    outcome: _Outcome
    positions: I64  # (n,) rows of the block
    gains: F64  # (n, A)


class Renderer:
    """Renderer of a track's blocks, in order of time, for one device.

    Memory: arrays of a block, the raster (8 bytes per time and column), 20 bytes per sample.

    ``models`` loads a perceptual model by id. ``body_id``, also an attribute, is the body that
    wears the device; None for the only body of a track, InputError for an unknown body.
    ``compensates_latency``: advance values by each actuator's latency. The attribute ``groups`` has
    the device's actuators by modality; ``latency_ms`` is the lead of the samples of live moments,
    whose bursts are separate.
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
        self._frequency = frequency.StrongestContributor(len(vibrating))
        self._sounding = [a for a in device.actuators if a.type.takes_waveform]
        self._partials = frequency.Partials(len(self._sounding))
        self._is_pair = np.array([a.type.is_tone_pair for a in self._sounding], np.bool_)
        self._missing = MissingActuators(device)
        self._rhythm_s = rhythm_s(device.scheme)
        self._bursts: dict[tuple[Stream, str, float], Bursts] = {}
        self._feel = Feel.of_settings(header.settings)
        self._memories: dict[float, SkinMemory] = {}
        self.latency_ms = 0.0

    def restart(self) -> None:
        """Discard all blocks and values; keep model tables, bursts and held frequencies."""
        self._partials.forget()
        self._outcomes = {stream: [] for stream in self._outcomes}
        self._values = np.tile(self._neutral, (len(self._values), 1))
        self._next_row = 0

    def add(self, runs: Iterable[SampleRun], time_s: float | None = None) -> None:
        """Render the next block: all runs of its times; runs on other bodies are ignored.

        ``time_s`` is the scene's time of a live moment, for adaptation and persistence. Raises
        InputError for a place off a model, or a model other than the track's, and ValueError for a
        block not later than the blocks before.
        """
        runs = [run for run in runs if run.stream.body_id == self.body_id and len(run)]
        runs = [self._drives.on_device(run) for run in runs]
        if self._feel.has_memory:
            stop = max((int(run.indices[-1]) + 1 for run in runs), default=0)
            runs = self._remembered(runs, stop, time_s)
        if runs:
            self._render(runs)

    def _remembered(
        self, runs: Sequence[SampleRun], stop: int, time_s: float | None = None
    ) -> list[SampleRun]:
        """Runs with adaptation and persistence at rows before ``stop`` not yet rendered; of a live
        moment, with ``time_s``, at row 0."""
        rows = np.arange(self._next_row, stop if time_s is None else 1)
        if not len(rows):
            return list(runs)
        times_s = self._header.time.times_s(rows) if time_s is None else np.array([time_s])
        memory = self._memories.setdefault(self.latency_ms, SkinMemory(self._feel))
        return memory.felt(runs, rows, times_s)

    def _end(self) -> None:
        """Render what persists after the last block; no block can be added afterwards."""
        if self._feel.has_memory:
            if runs := self._remembered((), len(self._values)):
                self._render(runs)
            self._next_row = len(self._values)

    def _render(self, runs: Sequence[SampleRun]) -> None:
        """Render one or more runs of the next rows."""
        rows = np.unique(np.concatenate([run.indices for run in runs]))
        # Blocks in order of time are required by held frequencies.
        if rows[0] < self._next_row or rows[-1] >= len(self._values):
            raise ValueError(f"samples {rows[0]} to {rows[-1]} come out of order")
        self._next_row = int(rows[-1]) + 1
        outcomes = []
        for run in runs:
            # A temperature is as strong as its deviation from the effect's neutral.
            is_heat = run.stream.modality == "temperature"
            neutral = self._neutral_c(run.stream) if is_heat else 0.0
            strengths = run.levels * np.abs(run.parameters[:, 0] - neutral)
            strengths[~has_strength(run, self._effects[run.stream.effect_id].is_contact)] = 0.0
            masks = np.zeros((5, len(run)), np.bool_)
            outcomes.append(_Outcome(run.indices, strengths, *masks))
        for group in self.groups:
            is_equal = self._feel.is_equal
            shares = [
                _GroupShare(run, outcome, np.searchsorted(rows, run.indices), gains)
                for run, outcome in zip(runs, outcomes, strict=True)
                if group.renders(run.stream.modality)
                for gains in [group.equal_gains(run) if is_equal else group.gains(run)]
            ]
            if not shares:
                continue
            is_cut, is_lost = self._write(group, rows, self._mixed(group, shares, rows))
            # A sample counts as rendered if any actuator of any group responds.
            for share in shares:
                fires, outcome = share.gains > 0.0, share.outcome
                outcome.is_rendered |= fires.any(axis=1)
                outcome.is_off |= group.is_off_frequency(share.run, fires)
                outcome.is_over |= (fires & is_cut[share.positions]).any(axis=1)
                is_lost_here = is_lost[share.positions]
                outcome.is_small |= fires.any(axis=1) & ~(fires & ~is_lost_here).any(axis=1)
                outcome.is_faint |= group.is_faint(share.run, self._device.gain * share.gains)
        for run, outcome in zip(runs, outcomes, strict=True):
            self._missing.add(run)
            self._outcomes[run.stream].append(outcome)

    def notes(self) -> tuple[str, ...]:
        """Sentences about missing vertices or actuators, replaced schemes, late beginnings. To be
        called after all blocks, before :meth:`raster`."""
        name = f"device '{self._device.id}'"
        notes = [note for group in self.groups for note in group.notes()]
        notes += self._missing.notes(self._header)
        rate_hz = float(self._header.time.rate_hz)
        if self._rhythm_s is not None and self._rhythm_s[0] * rate_hz < 2.0:
            notes.append(
                f"{name}: {rate_hz:g} samples a second are too few for the scheme "
                f"'{self._device.scheme.name}', which needs {2.0 / self._rhythm_s[0]:g}"
            )
        late = []
        for actuator, (part, kind) in zip(self._device.actuators, self._parts(), strict=True):
            # Rows within the latency have no earlier row to go to; see ``advanced``.
            rows = self._late_rows(kind)
            if (self._values[:rows, part.start] != self._neutral[part.start]).any():
                late.append(actuator.id)
        text = (
            f"{name}: effects at the beginning come late, or not at all, at actuators with latency"
        )
        return tuple(dict.fromkeys([*notes, *counted(late, text)]))

    def _neutral_c(self, stream: Stream) -> float:
        """Skin temperature without the stream's effect, degrees Celsius."""
        return neutral_temperature_c(self._effects[stream.effect_id].is_contact)

    def _model(self, model_id: str) -> PerceptualModel:
        """Load a model; InputError unless the content hash is that of the recording."""
        model = self._models(model_id)
        # Vertex ids of another version of a model are other places on the body.
        recorded = next(m for m in self._header.models if m.id == model_id)
        if recorded.content_hash != model.content_hash:
            raise InputError(
                f"The track was recorded on body model '{model_id}' with the hash "
                f"{recorded.content_hash[:12]}..., here it has {model.content_hash[:12]}...; "
                "record it again, or use the version that it was recorded with."
            )
        return model

    def _mixed(self, group: ActuatorGroup, shares: Sequence[_GroupShare], rows: I64) -> Mixed:
        """Combine all runs of a block at a group's actuators: strengths (R, A), at R = ``rows``.

        Runs of a modality combine by :func:`.mixing.mix`. A modality other than the group's is
        then converted by the device's substitution of that modality, and the modalities combine by
        :func:`.mixing.merged`: vibrations add at equal frequencies, else as powers; others add.

        For vibration, frequencies (R, A) are of the strongest contributor (an effect, or a
        substituted modality), held until another is 1.25 times as strong. Side effect: the
        vibrations at actuators with a waveform are added to the partials, times the device's gain.
        """
        mixes = []
        vibrations: list[tuple[str, F64, F64]] = []  # effect, (R, A) m/s^2, (R,) Hz
        for modality in MODALITIES:
            matching = [s for s in shares if s.run.stream.modality == modality]
            if not matching:
                continue
            contributions = [self._contribution(group, share, len(rows)) for share in matching]
            # Within a modality first: its effects combine by its own rule.
            mixed = mix(modality, contributions)
            if modality != group.modality:
                mixed = substituted(mixed, self._device.substitutions[modality])
            mixes.append(mixed)
            if group.modality != "vibration":
                continue
            if modality == "vibration":
                names = [share.run.stream.effect_id for share in matching]
                vibrations += [
                    (name, c.strengths * c.parameters[:, :1], c.parameters[:, 1])
                    for name, c in zip(names, contributions, strict=True)
                ]
            elif mixed.frequencies_hz is not None:
                vibrations.append((modality, mixed.strengths, mixed.frequencies_hz[:, 0]))
        mixed = mixes[0] if len(mixes) == 1 else merged(group.modality, mixes)
        gain: F64 = np.array(self._device.gain)
        if any(actuator.type.marks for actuator in self._device.actuators):
            factors = group.personal_factors(gain * mixed.strengths)
            mixed = replace(mixed, strengths=mixed.strengths * factors)
            gain = gain * factors[:, group.takes_waveform]
        if group.modality != "vibration":
            return mixed
        # Actuators driven as sound play every vibration at its own frequency; all actuators also
        # get a combined strength and one frequency, for outputs without a waveform.
        pairs = np.zeros((2, len(rows), len(self._sounding)))
        for name, amplitudes, frequencies_hz in vibrations if self._sounding else ():
            sounding = gain * amplitudes[:, group.takes_waveform]
            if self._is_pair.any():
                by_tone = frequency.tone_pair_shares(frequencies_hz)[..., None]
                pairs += by_tone * np.where(self._is_pair, sounding, 0.0)
                sounding = np.where(self._is_pair, 0.0, sounding)
            self._partials.add(name, rows, sounding, frequencies_hz)
        # Tones of all effects in one partial: equal frequencies are in phase, and add.
        for (name, tone_hz), tones in zip(frequency.TONE_PAIR_HZ.items(), pairs, strict=True):
            self._partials.add(name, rows, tones, np.full(len(rows), tone_hz))
        frequencies = self._frequency.frequencies(
            [name for name, _, _ in vibrations],
            np.stack([amplitudes for _, amplitudes, _ in vibrations]),
            np.stack([frequencies_hz for _, _, frequencies_hz in vibrations]),
        )
        return Mixed(mixed.strengths, frequencies)

    def _contribution(
        self, group: ActuatorGroup, share: _GroupShare, row_count: int
    ) -> Contribution:
        """Contribution of a run at all ``row_count`` rows of a block: gains times levels, and
        parameters; both 0 at rows without samples. Gains are of bursts if the scheme has bursts."""
        run, gains = share.run, share.gains
        if self._rhythm_s is not None and run.drive is None:
            key = run.stream, group.modality, self.latency_ms
            bursts = self._bursts.setdefault(key, Bursts(*self._rhythm_s))
            gains = bursts.gains(run.times_s, gains)
        strengths = np.zeros((row_count, share.gains.shape[1]))
        strengths[share.positions] = gains * run.levels[:, None]
        parameters = np.zeros((row_count, run.parameters.shape[1]))
        parameters[share.positions] = run.parameters
        return Contribution(strengths, parameters, self._neutral_c(run.stream))

    def _write(self, group: ActuatorGroup, rows: I64, mixed: Mixed) -> tuple[Bool, Bool]:
        """Write neutral plus gain times strengths; returns masks (R, A) out of limits, and rounded
        to silence. Silence keeps the neutral frequency."""
        strengths = group.neutral + self._device.gain * mixed.strengths
        self._values[rows[:, None], group.strength_columns] = strengths
        if mixed.frequencies_hz is not None:
            columns = group.strength_columns + 1
            # So devices do not retune in silence.
            is_silent = mixed.strengths == 0.0
            frequencies = np.where(is_silent, self._neutral[columns], mixed.frequencies_hz)
            self._values[rows[:, None], columns] = frequencies
        is_cut = np.asarray((strengths < group.lowest) | (strengths > group.highest))
        return is_cut, group.is_rounded_away(strengths)

    def first_row(self) -> F64:
        """Values (columns,) of the first row within limits, without latency or holding."""
        if self._limits is None:
            self._limits = DeviceLimits(self._device)
        return self._limits.joined(self._limits.by_actuator(self._values[0]))

    def gains(self, run: SampleRun) -> F64:
        """Gains (n, A) of all actuators of the device for a run's samples, in 0..1; 0 for
        actuators whose places do not fit the run's model. Raises InputError for such a place if the
        actuator renders the run's modality."""
        gains = np.zeros((len(run), len(self._device.actuators)))
        for group in self.groups:
            try:
                gains[:, group.members] = group.gains(run)
            except InputError:
                if group.renders(run.stream.modality):
                    raise  # places need not fit models of further modalities
        return gains

    def script_input(self) -> F64:
        """Values (T, columns) for a device's script: earlier by each actuator's latency, if
        compensated; within its limits, neutral for rows with a non-finite value; not yet held for
        update intervals. Call after the last block is added."""
        self._end()
        values = np.zeros_like(self._values)
        for part, kind in self._parts():
            values[:, part] = self._limited(self._early(part, kind), part)
        return values

    def raster(self, answers: F64 | None = None) -> Raster:
        """Finish the raster; no block can be added afterwards.

        ``answers`` (T, columns) are the output of the device's script for :meth:`script_input`,
        held and limited like all values; None without a script. Samples at changed rows count as
        rendered if any actuator plays there, else as not rendered.
        """
        self._end()
        time = self._header.time
        # Latency before holding: an update interval begins at the sending of a value.
        for part, kind in self._parts():
            self._values[:, part] = self._held(self._early(part, kind), part, kind)
        streams = tuple(_felt(stream, outcomes) for stream, outcomes in self._outcomes.items())
        shortfalls = tuple(self._shortfalls(streams))
        partials = self.partials()
        # A script replaces the values; at rows changed by the script, samples are judged again.
        if answers is not None:
            without, self._values = self._values, np.zeros_like(self._values)
            for part, kind in self._parts():
                self._values[:, part] = self._held(answers[:, part], part, kind)
            partials = ()  # a script sets a single frequency per actuator
            is_changed, is_on = self._changes(without)
            if is_changed.any():
                streams = tuple(
                    replace(
                        stream,
                        is_rendered=np.where(
                            is_changed[stream.indices], is_on[stream.indices], stream.is_rendered
                        ),
                    )
                    for stream in streams
                )
                # Whether the script compensated the actuators' limits is unknown.
                shortfalls = tuple(s for s in self._shortfalls(streams) if s.reason in _UNPLAYED)
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
            felt=streams,
            waveform_actuators=tuple(a.id for a in self._sounding) if answers is None else (),
            partials=partials,
        )

    def _parts(self) -> Iterator[tuple[slice, ActuatorType]]:
        """Yield the slice of raster columns and the type of each actuator."""
        kinds = (actuator.type for actuator in self._device.actuators)
        return zip(self._device.actuator_columns, kinds, strict=True)

    def _late_rows(self, kind: ActuatorType) -> int:
        """Latency of an actuator type in rows; 0 without compensation."""
        if not self._compensates_latency:
            return 0
        return rows_of(self._header.time.rate_hz, kind.latency_ms)

    def _early(self, part: slice, kind: ActuatorType) -> F64:
        """Columns of an actuator (T, P), advanced by the latency if compensated."""
        return advanced(self._values[:, part], self._neutral[part], self._late_rows(kind))

    def _limited(self, values: F64, part: slice) -> F64:
        """Values (T, P) of the columns ``part``, clipped; rows with a non-finite value neutral."""
        return limited(values, self._lowest[part], self._highest[part], self._neutral[part])

    def _held(self, values: F64, part: slice, kind: ActuatorType) -> F64:
        """Values (T, P) sent to an actuator: held between updates, clipped to its limits, and
        rounded to allowed values."""
        rate_hz, interval_ms = self._header.time.rate_hz, kind.update_interval_ms
        values = held(values, self._neutral[part], rate_hz, interval_ms)
        return rounded(self._limited(values, part), kind)

    def _changes(self, without: F64) -> tuple[Bool, Bool]:
        """Masks (T,) of rows changed by a script from ``without``, and of rows with any strength
        or custom control away from neutral. Both also at the rows later by each actuator's latency,
        when it responds."""
        is_changed, is_on = np.zeros((2, len(without)), np.bool_)
        for part, kind in self._parts():
            # Samples are counted when they are felt, a latency after the row that was sent.
            changed = (self._values[:, part] != without[:, part]).any(axis=1)
            plays = [not k or control.unit != "" for k, control in enumerate(kind.controls)]
            on = (self._values[:, part] != self._neutral[part])[:, plays].any(axis=1)
            # A set: without latency both rows are the same.
            for rows in {0, min(self._late_rows(kind), len(without))}:
                is_changed[rows:] |= changed[: len(changed) - rows]
                is_on[rows:] |= on[: len(on) - rows]
        return is_changed, is_on

    def partials(self) -> tuple[frequency.Partial, ...]:
        """Partials of each effect so far at the actuators with a waveform, advanced by latency and
        within limits; empty without such actuators."""
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

    def _shortfalls(self, felt: Iterable[FeltStream]) -> Iterator[Shortfall]:
        """Yield, per stream and reason, the number of samples not rendered, off frequency,
        limited, below threshold or below the first allowed value, if above 0; with seconds and the
        share. Only samples with strength count."""
        for rendered in felt:
            stream, outcomes = rendered.stream, self._outcomes[rendered.stream]
            is_strong = rendered.strengths > 0.0
            strong_count = int(np.count_nonzero(is_strong))
            if not strong_count:
                continue
            # Samples drive no actuator if their effect drives another device, if actuators of the
            # modality do not reach them, or if the device does not render the modality.
            device_id = self._effects[stream.effect_id].device_id
            undriven: Reason = "modality"
            if device_id is not None and device_id != self._device.id:
                undriven = "device"
            elif any(group.renders(stream.modality) for group in self.groups):
                undriven = "place"
            losses: dict[Reason, list[Bool]] = {
                undriven: [~rendered.is_rendered],
                "frequency": [outcome.is_off for outcome in outcomes],
                "limit": [outcome.is_over for outcome in outcomes],
                "threshold": [outcome.is_faint for outcome in outcomes],
                "step": [outcome.is_small for outcome in outcomes],
            }
            for reason, masks in losses.items():
                samples = int(np.count_nonzero(np.concatenate(masks) & is_strong))
                if samples:
                    yield Shortfall(
                        stream.effect_id,
                        stream.body_id,
                        stream.modality,
                        reason,
                        samples,
                        share=samples / strong_count,
                        seconds=samples / float(self._header.time.rate_hz),
                    )


def _felt(stream: Stream, outcomes: list[_Outcome]) -> FeltStream:
    """Indices, strengths and rendered mask of a stream's samples, its runs joined in order; empty
    arrays without runs."""
    return FeltStream(
        stream,
        np.concatenate([np.zeros(0, np.int64), *(outcome.indices for outcome in outcomes)]),
        np.concatenate([np.zeros(0), *(outcome.strengths for outcome in outcomes)]),
        np.concatenate([np.zeros(0, np.bool_), *(outcome.is_rendered for outcome in outcomes)]),
    )


def _wearer(header: TrackHeader, device: DeviceConfig, body_id: str | None) -> str:
    """``body_id``, or for None the only body of the track. Raises InputError for an id that is not
    in the track, and for None with no or several bodies."""
    ids = [body.id for body in header.bodies]
    if body_id is None and len(ids) == 1:
        return ids[0]
    if body_id not in ids:
        names = ", ".join(f"'{body.name}' ({body.id})" for body in header.bodies) or "none"
        fault = "no body is chosen" if body_id is None else f"there is no body '{body_id}'"
        raise InputError(f"Device '{device.id}': {fault} to wear it; the track has: {names}.")
    return str(body_id)
