# SPDX-License-Identifier: GPL-3.0-or-later
"""Dispatch: actuators that respond to a stream, their gains, and missing actuators.

Danieau et al., VRST 2018, section 3.3: haptic data goes to a device with the modality and with
shared vertices.
"""

from collections.abc import Callable, Iterator

import numpy as np

from ...text import counted
from ..arrays import F64, I64, Bool
from ..body.detection import equal_feel_factors, threshold
from ..body.model import PerceptualModel
from ..body.parts import PARTS
from ..modality import MODALITIES
from ..samples import SampleRun
from ..track.header import TrackHeader
from .actuator_vertices import on_parts
from .conditioning.actuator_limits import rounded
from .conditioning.frequency import TONE_PAIR_HZ, tone_pair_shares
from .coverage import ActuatorCells
from .device_config import ActuatorType, DeviceConfig, RoomPlace
from .room import PlaySpace, has_place, room_gains
from .schemes import FocusPanning, cells_of, panned_layout, unpanned

ModelLoader = Callable[[str], PerceptualModel]


def rendered_modalities(device: DeviceConfig, modality: str) -> set[str]:
    """Actuator modalities showing ``modality``: itself, and a substitution's target."""
    substitution = device.substitutions.get(modality)
    return {modality} if substitution is None else {modality, substitution.target}


class ActuatorGroup:
    """The A actuators of one modality of a device.

    Attributes: ``members``, indices of the actuators in the device; ``strength_columns`` (A,) of
    the device's raster, a vibration's frequency in the next column; ``takes_waveform`` (A,);
    ``neutral``, ``lowest`` and ``highest`` (A,) strength; ``play_space``, initially the world.
    """

    def __init__(self, device: DeviceConfig, modality: str, models: ModelLoader) -> None:
        self.modality = modality
        self._device = device
        self._models = models
        self._cells: dict[str, ActuatorCells] = {}
        self._focus: dict[str, FocusPanning | None] = {}
        self.members = [k for k, a in enumerate(device.actuators) if a.type.modality == modality]
        self._actuators = [device.actuators[k] for k in self.members]
        self._standing = [k for k, a in enumerate(self._actuators) if has_place(a)]
        self.play_space = PlaySpace.of_settings({})
        self.strength_columns: I64 = device.strength_columns[self.members]
        self.takes_waveform: Bool = np.array([a.type.takes_waveform for a in self._actuators])
        strengths = [a.type.strength for a in self._actuators]
        self.neutral: F64 = np.array([control.neutral for control in strengths], np.float64)
        self.lowest: F64 = np.array([control.lowest for control in strengths], np.float64)
        self.highest: F64 = np.array([control.highest for control in strengths], np.float64)

    def is_rounded_away(self, strengths: F64) -> Bool:
        """Mask (R, A) of strengths other than neutral that allowed values round to neutral."""
        is_away = np.zeros(strengths.shape, np.bool_)
        for k, actuator in enumerate(self._actuators):
            strength = actuator.type.strength
            if strength.values:
                within = np.clip(strengths[:, k : k + 1], strength.lowest, strength.highest)
                is_neutral = rounded(within, actuator.type) == strength.neutral
                is_away[:, k] = (is_neutral & (within != strength.neutral))[:, 0]
        return is_away

    def renders(self, modality: str) -> bool:
        """Test that the actuators show a modality, their own or by substitution."""
        return self.modality in rendered_modalities(self._device, modality)

    def cells_on(self, model_id: str) -> ActuatorCells:
        """Vertices reached by the actuators on a model, cached; InputError for a misplaced one."""
        if model_id not in self._cells:
            self._cells[model_id] = cells_of(self._device, self._actuators, self._models(model_id))
        return self._cells[model_id]

    def gains(self, run: SampleRun) -> F64:
        """Gains (n, A) of the actuators for a run's samples, in 0..1.

        A run with a drive has the drive's values, 0 on another device. A spot on a panned layout is
        panned at its focus. Else shared vertices count, and for actuators at a position in the room
        the reach, if the run has positions. Raises InputError for a place that does not fit the
        run's model.
        """
        if run.drive is not None:
            return run.drive.gains(self._device.id, [actuator.id for actuator in self._actuators])
        panning = None if run.focus is None else self.panning_on(run.stream.model_id)
        if panning is not None and run.focus is not None:
            return panning.gains(run.focus)
        # Gains of each distinct vertex set, then of each sample.
        of_sets = self.cells_on(run.stream.model_id).gains(
            run.offsets, run.vertices, run.weights, self._device.scheme.statistic
        )
        gains: F64 = of_sets[run.set_of]
        if self._standing and run.positions is not None:
            # Actuators with a position in the room respond by reach, not by shared vertices.
            model, points = self._models(run.stream.model_id), self.play_space.local(run)
            for column in self._standing:
                standing = self._actuators[column].place
                assert isinstance(standing, RoomPlace)
                is_part = on_parts(standing.parts, model)
                gains[:, column] = room_gains(standing, is_part, run, points)
        return gains

    def equal_gains(self, run: SampleRun) -> F64:
        """Gains (n, A) for equal dB SL at the body part that most vertices of each actuator belong
        to, at the frequency that the actuator plays; unchanged for driven actuators and substituted
        modalities."""
        gains = self.gains(run)
        if run.drive is not None or run.stream.modality != self.modality:
            return gains
        part_of = self._models(run.stream.model_id).part
        rows = self.cells_on(run.stream.model_id).rows
        parts = [np.bincount(part_of[row], minlength=len(PARTS)).argmax() for row in rows]
        # Computed once for each type: actuators of a type play the same frequencies.
        kinds = [actuator.type for actuator in self._actuators]
        thresholds = {kind: _played_thresholds(kind, run) for kind in dict.fromkeys(kinds)}
        of_each = [thresholds[kind][:, part] for kind, part in zip(kinds, parts, strict=True)]
        return gains * equal_feel_factors(self.modality, np.stack(of_each, axis=1))

    def personal_factors(self, strengths: F64) -> F64:
        """Factors (R, A) of strengths (R, A) from 0 by the marks of a person; 1 without marks.

        A strength above 0 is played from "first felt" up, the full strength as "strong enough".
        """
        factors = np.ones_like(strengths)
        for k, actuator in enumerate(self._actuators):
            if actuator.type.marks is not None and MODALITIES[self.modality].is_silent_at_0:
                first, strong, full = actuator.type.marks
                own = strengths[:, k]
                is_on, share = own > 0.0, np.minimum(own / full, 1.0)
                factors[is_on, k] = (first + (strong - first) * share)[is_on] / own[is_on]
        return factors

    def notes(self) -> Iterator[str]:
        """Yield sentences about actuators without a vertex, and a scheme replaced by coverage. Only
        for models rendered so far, sorted by id."""
        ids = [actuator.id for actuator in self._actuators]
        for model_id, cells in sorted(self._cells.items()):
            lost = [name for name, count in zip(ids, cells.counts, strict=True) if not count]
            text = f"device '{self._device.id}': {self.modality} actuators without a vertex on the"
            yield from counted(lost, f"{text} body model '{model_id}' do not play its effects")
            reasons = unpanned(self._device, self._actuators, self._models(model_id))
            if self._device.scheme.name != "coverage" and reasons:
                yield (
                    f"device '{self._device.id}': coverage replaces the scheme "
                    f"'{self._device.scheme.name}' on the body model '{model_id}', because "
                    f"actuators {reasons}"
                )

    def panning_on(self, model_id: str) -> FocusPanning | None:
        """Panning of spots on a model, cached; None without a :func:`panned_layout`."""
        if model_id not in self._focus:
            model, is_mirrored = self._models(model_id), self._device.is_mirrored
            layout = panned_layout(self._device, self._actuators, model)
            self._focus[model_id] = None
            if layout is not None:
                self._focus[model_id] = FocusPanning(layout, model, is_mirrored=is_mirrored)
        return self._focus[model_id]

    def is_faint(self, run: SampleRun, gains: F64) -> Bool:
        """Mask (n,) of samples driving actuators, by gains (n, A), only below detection thresholds,
        at the frequencies that the actuators play.

        Actuators without thresholds count as felt. All False unless effect and actuators vibrate.
        """
        is_vibration = self.modality == run.stream.modality == "vibration"
        if not is_vibration or not any(a.type.thresholds for a in self._actuators):
            return np.zeros(len(run), np.bool_)
        # In the unit of the effect: the caller has multiplied the gains by the device's gain.
        amplitudes = gains * (run.levels * run.parameters[:, 0])[:, None]
        hz = run.parameters[:, 1]
        thresholds = np.stack(
            [
                np.interp(_played_hz(a.type, hz), *np.array(a.type.thresholds).T)
                if a.type.thresholds
                else np.zeros(len(run))
                for a in self._actuators
            ],
            axis=1,
        )
        is_on = amplitudes > 0.0
        return np.asarray(is_on.any(axis=1) & ~(is_on & (amplitudes >= thresholds)).any(axis=1))

    def is_off_frequency(self, run: SampleRun, fires: Bool) -> Bool:
        """Mask (n,) of samples with a frequency out of range of an actuator with ``fires`` (n, A).
        All False unless effect and actuators vibrate."""
        if self.modality != "vibration" or run.stream.modality != "vibration":
            return np.zeros(len(run), np.bool_)
        controls = [a.type.controls[1] for a in self._actuators]
        frequencies = run.parameters[:, 1:2]
        is_outside = frequencies < np.array([control.lowest for control in controls])
        is_outside |= frequencies > np.array([control.highest for control in controls])
        return np.asarray((fires & is_outside).any(axis=1))


def _played_hz(kind: ActuatorType, hz: F64) -> F64:
    """Frequencies (n,) of a vibration actuator for effects of ``hz`` (n,): within its limits, and
    without a waveform also rounded to its allowed values."""
    control = kind.controls[1]
    played = np.clip(hz, control.lowest, control.highest)
    if not kind.takes_waveform:
        played = rounded(np.stack([np.zeros_like(played), played], axis=1), kind)[:, 1]
    return played


def _played_thresholds(kind: ActuatorType, run: SampleRun) -> F64:
    """Detection thresholds (n, parts) of skin for a run's samples played by an actuator type of
    the run's modality. Of a pair of tones the tone that is detected first counts."""
    modality = run.stream.modality
    if modality != "vibration":
        return np.broadcast_to(threshold(modality), (len(run), len(PARTS)))
    hz = run.parameters[:, 1]
    if not kind.is_tone_pair:
        return threshold(modality, _played_hz(kind, hz))
    tones = threshold(modality, _played_hz(kind, np.array([*TONE_PAIR_HZ.values()])))
    return np.asarray(1.0 / (tone_pair_shares(hz)[..., None] / tones[:, None]).max(axis=0))


class MissingActuators:
    """Actuators that effects drive but a device lacks, collected run by run."""

    def __init__(self, device: DeviceConfig) -> None:
        self._device = device
        self._missing: dict[str, dict[str, None]] = {}  # ids by effect, as an ordered set

    def add(self, run: SampleRun) -> None:
        """Collect driven actuators (value above 0) missing in the effect's modalities. Runs without
        a drive, or for another device, are ignored."""
        drive = run.drive
        if drive is None or drive.device_id != self._device.id:
            return
        shown = rendered_modalities(self._device, run.stream.modality)
        present = {a.id for a in self._device.actuators if a.type.modality in shown}
        # Actuators that an effect names but never drives are not missed.
        is_on = (drive.values > 0.0).any(axis=0).tolist()
        missing = self._missing.setdefault(run.stream.effect_id, {})
        for name, is_driven in zip(drive.actuators, is_on, strict=True):
            if is_driven and name not in present:
                missing[name] = None

    def notes(self, header: TrackHeader) -> Iterator[str]:
        """Yield a sentence for each effect with missing actuators, in the order of the header, with
        the actuators in the order of the effect."""
        for effect in header.effects:
            text = (
                f"device '{self._device.id}' has not all {effect.modality} actuators that effect "
                f"'{effect.name}' drives; missing"
            )
            missing = self._missing.get(effect.id, {})
            yield from counted([name for name in effect.actuators if name in missing], text)
