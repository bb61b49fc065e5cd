# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of an export: felt and unfelt effects, effects without a device, files, warnings; and its
text for the terminal and the popup."""

import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.areas.felt_times import FeltTimes
from ..engine.contact.contact_query import FLATTENED
from ..engine.counters import Unfelt, as_reported, powerless_reason
from ..engine.rendering.raster import Raster, unrendered
from ..engine.track import StreamSummary, TrackEffect, TrackHeader, TrackReader
from ..files import limits
from ..files.atomic import stored_json
from ..files.hashes import sha256_of
from ..files.kinds import REPORT_SUFFIX
from ..reading.description.missed_effects import NEVER_ON, NO_TOUCH, missed_warnings
from ..text import MOST_LINES, MOST_NAMES, counted, named, printable, shortened
from .result_files import listed

_FILES = 12
"""Largest number of files that are listed line by line."""


@dataclass(frozen=True)
class ExportReport:
    """Results of an export."""

    scene: str
    folder: Path  # of the files and their subfolders
    files: tuple[Path, ...]
    felt: tuple[dict[str, Any], ...]  # per effect and body: name, seconds, vertices, peak level
    unrendered: tuple[dict[str, Any], ...]  # felt by a body, played by no device
    warnings: tuple[str, ...]
    effects: tuple[dict[str, Any], ...] = ()  # of all effects: times, or reason of silence
    engine: dict[str, Any] = field(default_factory=dict)
    reading: dict[str, Any] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()  # subset of the warnings: content that a format cannot hold
    silent_devices: tuple[str, ...] = ()  # subset of the warnings: devices without output
    notes: tuple[str, ...] = ()  # simplifications by formats, with their size
    made_from: Mapping[str, Any] = field(default_factory=dict)  # inputs and options

    def as_dict(self) -> dict[str, Any]:
        """Plain data; file names relative to the folder, with slashes."""
        return {
            "scene": self.scene,
            "files": [
                {
                    "name": path.relative_to(self.folder).as_posix(),
                    "bytes": path.stat().st_size,
                    "sha256": sha256_of(path),
                }
                for path in self.files
            ],
            "felt": list(self.felt),
            "effects": list(self.effects),
            "unrendered": list(self.unrendered),
            "warnings": list(self.warnings),
            "left_out": list(self.left_out),
            "silent_devices": list(self.silent_devices),
            "notes": list(self.notes),
            "engine": self.engine,
            "reading": as_reported(self.reading),
            "made_from": dict(self.made_from),
        }


def felt_effects(
    track: TrackReader, times: FeltTimes | None = None, unfelt: Collection[str] = ()
) -> tuple[dict[str, Any], ...]:
    """Facts of each stream of a track: name, body, modality, seconds, times and vertices. With
    ``times``, only samples of nonzero strength count for seconds, and for the first and last time
    (seconds; None without samples). Streams of ``unfelt`` effects, by name, need samples."""
    # A stream holds the samples of one effect on one body.
    bodies = {body.id: body.name for body in track.header.bodies}
    period_s = 1.0 / float(track.header.time.rate_hz)
    return tuple(
        {
            "effect": effect.name,
            "body": bodies[summary.stream.body_id],
            "modality": summary.stream.modality,
            "kind": effect.kind,
            "seconds": round(strong.sample_count * period_s, 6),
            "first_s": strong.first_s,
            "last_s": strong.last_s,
            # Of all samples, also of samples without strength.
            "mean_vertices": round(summary.entry_count / max(summary.sample_count, 1), 1),
            "peak_level": summary.peak_level,
        }
        for summary in track.summary()
        for effect in [track.header.effect(summary.stream)]
        if summary.sample_count or effect.name not in unfelt
        for strong in [_with_strength(summary, track.header, times)]
    )


def _with_strength(
    summary: StreamSummary, header: TrackHeader, times: FeltTimes | None
) -> StreamSummary:
    """Copy of a summary with samples of nonzero strength only; unchanged without ``times``."""
    if times is None or not summary.sample_count:
        return summary
    stream = summary.stream
    span = times.felt.get(stream.effect_id, {}).get(stream.body_id)
    if span is None:
        return replace(summary, sample_count=0, first_s=None, last_s=None)
    count, first, last = span
    first_s, last_s = header.time.times_s(np.array([first, last])).tolist()
    return replace(summary, sample_count=count, first_s=first_s, last_s=last_s)


def effect_facts(
    track: TrackReader,
    unfelt: Mapping[str, Unfelt],
    warnings: Sequence[str],
    *,
    flattened: Collection[str] = (),
    is_part: bool = False,
    instances: Collection[str] = (),
    times: FeltTimes | None = None,
    answering: Collection[str] = (),
    seen_on: Collection[str] = (),
) -> tuple[tuple[dict[str, Any], ...], tuple[str, ...]]:
    """Facts of each effect for the report, and warnings about effects that are not felt.

    The facts are the times at which any body feels the effect, or the reason of silence. ``unfelt``
    are reasons known before the recording, by effect name. Effects named in ``warnings`` of the
    recording, or in ``flattened`` (names of volumes flattened at any sample), get no second
    warning. Silence is expected if frames of the scene were not recorded (``is_part``; reasons that
    depend on time then name the exported frames), and for ``instances`` (ids) of which another is
    felt. ``times`` are samples at which effects are on with nonzero strength, ``answering`` ids of
    volumes with a contact response, ``seen_on`` ids of volumes that were on at samples far from all
    skin.
    """
    spans_of: dict[str, list[tuple[float, float]]] = {}
    powerless, forceful = set(), set()
    for summary in track.summary():
        strong = _with_strength(summary, track.header, times)
        if strong.first_s is not None and strong.last_s is not None:
            span = (strong.first_s, strong.last_s)
            spans_of.setdefault(summary.stream.effect_id, []).append(span)
        elif summary.sample_count:
            powerless.add(summary.stream.effect_id)
            if "forces_n" in summary.channels:
                forceful.add(summary.stream.effect_id)
    # Ids of instances are "emitter:number"; an emitter counts as felt with any of its instances.
    swarms = {instance.rpartition(":")[0] for instance in instances if instance in spans_of}
    lines, missed = [], []
    for effect in track.header.effects:
        line: dict[str, Any] = {"effect": effect.name, "modality": effect.modality}
        spans = spans_of.get(effect.id)
        known = unfelt.get(effect.name)
        if known is None and spans is None:
            is_one_of_many = effect.id in instances and effect.id.rpartition(":")[0] in swarms
            failed_drivers = [
                driver.removeprefix("the driver of ")
                for driver, failed, _ in (
                    text.partition(f" of object '{effect.name}' cannot be evaluated")
                    for text in warnings
                )
                if failed and driver.startswith("the driver of ")
            ]
            # The most specific reason first: a failed driver explains missing samples, too.
            if failed_drivers:
                reason = f"has a driver that cannot be evaluated, that of {failed_drivers[0]}"
            elif effect.id in powerless:
                reason = powerless_reason(effect.modality, effect.is_contact)
                if effect.id in forceful:
                    reason += ", and its contact force goes to scripts and files alone"
            else:
                reason = _why_missed(effect, times, answering, seen_on, flattened)
            if not failed_drivers and is_part and (effect.id in powerless or reason in _OF_TIME):
                reason = f"{reason} in the exported frames"
            is_warned = effect.name in flattened
            is_warned |= any(f"'{effect.name}'" in text for text in warnings)
            known = Unfelt(reason, (is_part or is_one_of_many) and not is_warned, is_warned)
            if not (known.is_expected or known.is_warned):
                missed.append((effect.name, known.reason))
        lines.append(line | _felt_or_not(spans, known))
    # Effects that were left out before the recording are not in the track.
    names = {effect.name for effect in track.header.effects}
    lines += [
        {"effect": name} | _felt_or_not(None, why)
        for name, why in unfelt.items()
        if name not in names
    ]
    return tuple(lines), missed_warnings(missed)


_NO_ANSWER = "touches a body, but its contact response gives nothing"
_NO_SLIDING = "touches a body, but does not slide along the skin"  # a surface
_OF_TIME = (NO_TOUCH, NEVER_ON, _NO_ANSWER, _NO_SLIDING)
_MISSED = {
    "volume": NO_TOUCH,
    "painted": "covers no vertex of the body",
    "spot": "covers no vertex of the body",
    "actuators": "drives no actuator",
}


def _why_missed(
    effect: TrackEffect,
    times: FeltTimes | None,
    answering: Collection[str],
    seen_on: Collection[str],
    flattened: Collection[str],
) -> str:
    """Predicate why an effect has no samples: its values, never on, a response without output, no
    sliding, or no contact. ``times`` and the collections as of :func:`effect_facts`."""
    if times is not None and effect.id not in times.is_on:
        if effect.id in times.no_number:
            quantity = times.no_number[effect.id]
            return f"has {quantity} that is no number wherever it would be on"
        if effect.id not in seen_on:
            return NEVER_ON
    has_response = effect.id in answering
    if has_response and times is None:
        return f"{NO_TOUCH}, or its contact response gives nothing"
    if times is not None and effect.id in times.touched:
        return _NO_ANSWER if has_response else _NO_SLIDING
    reason = _MISSED.get(effect.kind, NEVER_ON)
    # A volume flattened at any sample could not be evaluated there.
    return FLATTENED if reason == NO_TOUCH and effect.name in flattened else reason


def _felt_or_not(
    spans: Sequence[tuple[float, float]] | None, known: Unfelt | None
) -> dict[str, Any]:
    if known is not None or spans is None:
        known = known or Unfelt(NEVER_ON)
        return {"felt": False, "reason": known.reason, "expected": known.is_expected}
    first, last = zip(*spans, strict=True)
    return {"felt": True, "from_s": min(first), "to_s": max(last)}


def not_played(
    header: TrackHeader, rasters: Sequence[Raster], ignored: Collection[str] = ()
) -> tuple[dict[str, Any], ...]:
    """Facts of streams that no device of the body renders, with seconds and share; without effects
    whose names are in ``ignored``."""
    effects = {effect.id: effect.name for effect in header.effects}
    bodies = {body.id: body.name for body in header.bodies}
    return tuple(
        {
            "effect": effects[lost.effect_id],
            "body": bodies[lost.body_id],
            "modality": lost.modality,
            "seconds": round(lost.seconds, 6),
            "share": round(lost.share, 4),
        }
        for lost in unrendered(rasters)
        if effects[lost.effect_id] not in ignored
    )


def below_threshold(header: TrackHeader, times: FeltTimes | None) -> tuple[str, ...]:
    """Counted note on felt effects below the detection threshold of skin at all times and parts of
    the body; empty without such effects, or without ``times``."""
    levels = {} if times is None else times.strongest_db
    names = [effect.name for effect in header.effects if levels.get(effect.id, 0.0) < 0.0]
    return counted(names, "effects stay below the detection threshold of skin (0 dB SL)")


_OTHERWISE = {
    "frequency": "plays effect '{}' at another frequency",
    "limit": "cuts effect '{}' to an actuator's limits",
    "threshold": "plays effect '{}' below the detection threshold",
    "step": "is silent during effect '{}', which is weaker than the first allowed value,",
}


def shortfalls(
    header: TrackHeader, rasters: Sequence[Raster], ignored: Collection[str] = ()
) -> tuple[str, ...]:
    """Notes on modalities that devices lack, and on effects that devices play differently.
    :func:`not_played` covers effects without any device. A device away from an effect gets no note,
    because several devices share a body."""
    effects = {effect.id: effect.name for effect in header.effects}
    notes = []
    for raster in rasters:
        missing = {short.modality for short in raster.shortfalls if short.reason == "modality"}
        if missing:
            notes.append(f"device '{raster.device_id}' plays no {', '.join(sorted(missing))}")
        notes += [
            f"device '{raster.device_id}' "
            f"{_OTHERWISE[short.reason].format(effects[short.effect_id])} "
            f"for {short.seconds:.2f} s ({short.share:.0%})"
            for short in raster.shortfalls
            if short.reason in _OTHERWISE and effects[short.effect_id] not in ignored
        ]
    return tuple(notes)


def encoded_report(document: Mapping[str, Any], name: str) -> bytes:
    """Encode a report or record as indented JSON; TooLargeError above the limit of its readers."""
    content = (json.dumps(document, indent=1) + "\n").encode()
    limits.MEMORY.check(len(content), name, "it would have")
    return content


def stale_files(folder: Path, stem: str, devices: Collection[str]) -> tuple[Path, ...]:
    """Files of devices (by id) from an earlier export to ``folder/stem.*``, with the content stated
    in its report; without links, changed files and invalid entries of the report."""
    report = stored_json(folder / (stem + REPORT_SUFFIX)) if devices else None
    files = (report or {}).get("files")
    stale = []
    for entry in files if isinstance(files, list) else ():
        path = listed(folder, entry.get("name")) if isinstance(entry, dict) else None
        if path is None or not path.name.startswith(f"{stem}."):
            continue
        if not any(f".{device}." in path.name.removeprefix(stem) for device in devices):
            continue
        # Only unchanged files are ours: a user may have edited or replaced an exported file.
        with suppress(OSError):
            if not path.is_symlink() and path.is_file() and sha256_of(path) == entry.get("sha256"):
                stale.append(path)
    return tuple(stale)


def describe(report: ExportReport) -> str:
    """Text of an export for the terminal: files with sizes (above 12 their number), warnings,
    notes, felt effects, unplayed and unfelt effects."""
    sizes = [path.stat().st_size for path in report.files]
    if len(sizes) <= _FILES:
        pairs = zip(report.files, sizes, strict=True)
        written = [f"wrote {path} ({_size(size)})" for path, size in pairs]
    else:
        lists = (path for path in report.files if path.name.endswith(REPORT_SUFFIX))
        where = "".join(f", listed in {path}" for path in lists)
        written = [f"wrote {len(sizes)} files ({_size(sum(sizes))}) to {report.folder}{where}"]
    lines = [f"Scene '{report.scene}'", *(f"  {text}" for text in written)]
    # The command prints silent devices itself, for all scenes together.
    already_said = set(report.silent_devices)
    warnings = (text for text in report.warnings if text not in already_said)
    lines += [f"  warning: {text}" for text in shortened(warnings, MOST_LINES)]
    lines += [f"  note: {text}" for text in shortened(report.notes, MOST_LINES)]
    lines += [f"  {text}" for text in felt_lines(report)]
    lines += [
        f"  {lost['effect']}: {lost['seconds']:.2f} s of it ({lost['share']:.0%}) felt by "
        f"{lost['body']} but played by no device"
        for lost in report.unrendered
    ]
    lines += [f"  {text}" for text in unfelt_lines(report)]
    return "\n".join(map(printable, lines))


def felt_lines(report: ExportReport) -> tuple[str, ...]:
    """Lines with the times of felt effects for each body; effects without any body are left out."""
    # Effects without any body have lines of their own, with the reason.
    unfelt = {line["effect"] for line in report.effects if not line["felt"]}
    texts = []
    for line in report.felt:
        title = f"{line['effect']} ({line['modality']})"
        if line["effect"] in unfelt:
            continue
        if not line["seconds"]:
            texts.append(f"{title} was not felt by {line['body']}")
            continue
        texts.append(
            f"{title} felt by {line['body']} from {line['first_s']:.2f} to {line['last_s']:.2f} s, "
            f"for {line['seconds']:.2f} s, on {line['mean_vertices']:.0f} vertices on average"
        )
    return shortened(texts, MOST_LINES)


def unfelt_lines(report: ExportReport) -> tuple[str, ...]:
    """Lines on effects without samples on any body: one per reason, with at most 12 names."""
    reasons: dict[str, list[str]] = {}
    for line in report.effects:
        if not line["felt"]:
            title = f"{line['effect']} ({line['modality']})" if "modality" in line else None
            reasons.setdefault(line["reason"], []).append(title or line["effect"])
    return tuple(
        f"{names[0]} was not felt: it {why}"
        if len(names) == 1
        else f"{len(names)} effects were not felt: each {why}: {named(names, MOST_NAMES)}"
        for why, names in reasons.items()
    )


def _size(count: int) -> str:
    """Number of bytes in MB from 1 MB on, else in kB, at least 0.1."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"
