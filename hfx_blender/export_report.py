# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of an export: samples by effect, effects that no device played, files."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .engine.rendering.raster import Raster, unrendered
from .engine.track import TrackHeader, TrackReader
from .file_hash import sha256_of
from .reading_counters import Unfelt, as_reported
from .result_files import listed
from .sentences import counted

REPORT_SUFFIX = ".report.json"
_LARGEST_REPORT = 2**26


@dataclass(frozen=True)
class ExportReport:
    """Results of one export."""

    scene: str
    folder: Path  # that the files are in, or in folders below
    files: tuple[Path, ...]
    felt: tuple[dict[str, Any], ...]  # per effect and body: name, seconds, vertices, peak level
    unrendered: tuple[dict[str, Any], ...]  # felt by the body, played by none of the devices
    warnings: tuple[str, ...]
    effects: tuple[dict[str, Any], ...] = ()  # all of them: felt from and to, or why not
    engine: dict[str, Any] = field(default_factory=dict)
    reading: dict[str, Any] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()  # among the warnings: what a format could not hold of a device
    silent_devices: tuple[str, ...] = ()  # of the warnings: devices whose script did not run
    notes: tuple[str, ...] = ()  # what formats had to simplify, and how far
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


def felt_effects(track: TrackReader) -> tuple[dict[str, Any], ...]:
    """Summary of each effect on each body over a whole track."""
    names = {effect.id: effect for effect in track.header.effects}
    bodies = {body.id: body.name for body in track.header.bodies}
    period_s = 1.0 / float(track.header.time.rate_hz)
    return tuple(
        {
            "effect": names[summary.stream.effect_id].name,
            "body": bodies[summary.stream.body_id],
            "modality": summary.stream.modality,
            "kind": names[summary.stream.effect_id].kind,
            "seconds": round(summary.sample_count * period_s, 6),
            "first_s": summary.first_s,
            "last_s": summary.last_s,
            "mean_vertices": round(summary.entry_count / max(summary.sample_count, 1), 1),
            "peak_level": summary.peak_level,
        }
        for summary in track.summary()
    )


def told_effects(
    track: TrackReader,
    unfelt: Mapping[str, Unfelt],
    warnings: Sequence[str],
    *,
    is_part: bool = False,
    instances: Collection[str] = (),
) -> tuple[tuple[dict[str, Any], ...], tuple[str, ...]]:
    """Each effect of a scene: when it is felt on any body, or the reason why it is not.

    Parameters
    ----------
    track : TrackReader
        Of all samples.
    unfelt : mapping
        Reasons that are known already, by the names of effects.
    warnings : sequence of str
        Of the recording. An effect that they name needs no other warning.
    is_part : bool
        Only some frames of the scene were recorded: effects that are felt at others are expected.
    instances : collection of str
        Ids of effects that are instances: one of them may pass by, if another is felt.

    Returns
    -------
    tuple of dict
        For the report.
    tuple of str
        Warnings about effects that reach no body.
    """
    times: dict[str, list[tuple[float, float]]] = {}
    for summary in track.summary():
        if summary.first_s is not None and summary.last_s is not None:
            span = (summary.first_s, summary.last_s)
            times.setdefault(summary.stream.effect_id, []).append(span)
    swarms = {each.rpartition(":")[0] for each in instances if each in times}
    told, missed = [], []
    for effect in track.header.effects:
        line: dict[str, Any] = {"effect": effect.name, "modality": effect.modality}
        spans = times.get(effect.id)
        known = unfelt.get(effect.name)
        if known is None and spans is None:
            is_one_of_many = effect.id in instances and effect.id.rpartition(":")[0] in swarms
            known = Unfelt(_MISSED.get(effect.kind, _NEVER_ON), is_part or is_one_of_many)
            is_told = any(f"'{effect.name}'" in text for text in warnings)
            if not known.is_expected and not is_told:
                missed.append((effect.name, known.reason))
        told.append(line | _felt_or_not(spans, known))
    names = {effect.name for effect in track.header.effects}
    told += [
        {"effect": name} | _felt_or_not(None, why)
        for name, why in unfelt.items()
        if name not in names
    ]
    return tuple(told), _of_missed(missed)


_MISSED = {"volume": "touches no body"}
_NEVER_ON = "is never on"
_SEVERAL = {
    _MISSED["volume"]: "effects that touch no body are not felt",
    _NEVER_ON: "effects that are never on are not felt",
}


def _felt_or_not(
    spans: Sequence[tuple[float, float]] | None, known: Unfelt | None
) -> dict[str, Any]:
    if known is not None or spans is None:
        known = known or Unfelt(_NEVER_ON)
        return {"felt": False, "reason": known.reason, "expected": known.is_expected}
    first, last = zip(*spans, strict=True)
    return {"felt": True, "from_s": min(first), "to_s": max(last)}


def _of_missed(missed: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Warnings about effects, each with the reason, that are not felt."""
    if len(missed) == 1:
        return (f"effect '{missed[0][0]}' {missed[0][1]}: it is not felt",)
    reasons = dict.fromkeys(why for _, why in missed)
    return tuple(
        text
        for why in reasons
        for text in counted([name for name, each in missed if each == why], _SEVERAL[why])
    )


def not_played(header: TrackHeader, rasters: Sequence[Raster]) -> tuple[dict[str, Any], ...]:
    """Effects on a body that none of its devices renders."""
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
    )


_OTHERWISE = {
    "frequency": "plays effect '{}' at another frequency",
    "limit": "cuts effect '{}' to an actuator's limits",
    "threshold": "plays effect '{}' below the detection threshold",
}


def shortfalls(header: TrackHeader, rasters: Sequence[Raster]) -> tuple[str, ...]:
    """Notes on effects that devices play differently or not at all.

    What no device plays of an effect is told by :func:`not_played`; that one of several devices
    does not lie where an effect is felt is how devices share a body.
    """
    effects = {effect.id: effect.name for effect in header.effects}
    notes = []
    for raster in rasters:
        lacking = {each.modality for each in raster.shortfalls if each.reason == "modality"}
        if lacking:
            notes.append(f"device '{raster.device_id}' plays no {', '.join(sorted(lacking))}")
        notes += [
            f"device '{raster.device_id}' "
            f"{_OTHERWISE[each.reason].format(effects[each.effect_id])} "
            f"for {each.seconds:.2f} s ({each.share:.0%})"
            for each in raster.shortfalls
            if each.reason in _OTHERWISE
        ]
    return tuple(notes)


def read(path: Path) -> dict[str, Any] | None:
    """Read a report; None if the file is missing or no report."""
    try:
        # A pipe of that name would be waited for, and no signal ends that.
        if not path.is_file() or path.stat().st_size > _LARGEST_REPORT:
            return None
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def stale_files(folder: Path, stem: str, devices: Collection[str]) -> tuple[Path, ...]:
    """Unchanged device files that an earlier export of this name wrote.

    Parameters
    ----------
    folder : Path
        Where the results and their report are.
    stem : str
        Their common name.
    devices : collection of str
        Ids of the devices.
    """
    report = read(folder / (stem + REPORT_SUFFIX)) if devices else None
    return tuple(
        path
        for path, digest in _listed(report or {}, folder)
        if path.name.startswith(f"{stem}.")
        and any(f".{device}." in path.name.removeprefix(stem) for device in devices)
        and _is(path, digest)
    )


def _listed(report: Mapping[str, Any], folder: Path) -> Iterator[tuple[Path, str]]:
    files = report.get("files")
    for each in files if isinstance(files, list) else ():
        if isinstance(each, dict):
            path, digest = listed(folder, each.get("name")), each.get("sha256")
            if path is not None and isinstance(digest, str):
                yield path, digest


def _is(path: Path, digest: str) -> bool:
    try:
        return not path.is_symlink() and path.is_file() and sha256_of(path) == digest
    except OSError:
        return False
