# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of a scene, recorded by jobs of a render farm in any order and then merged.

Piece 2 of 8 of ``out/scene`` is in ``out/scene.pieces``: a track, positions of volumes, and last
the record, with sizes and hashes of both files and the inputs of the recording.
"""

import re
from collections.abc import Container, Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from ...errors import InputError, OutputError
from ...files.atomic import atomic_file, stored_json
from ...files.hashes import sha256_of
from ...files.staging import make_folder, place, remove_abandoned, with_final_names
from .. import report
from . import journal
from .units import Unit

MOST_PIECES = 10_000
_RECORD = re.compile(r"([1-9]\d*)-of-([1-9]\d*)\.json")


def pieces_folder(folder: Path, stem: str) -> Path:
    """Folder of the pieces of a scene whose results go to ``folder/stem.*``."""
    return folder / f"{stem}.pieces"


def folder_of(unit: Unit) -> Path:
    """Folder of the pieces of a unit's scene."""
    return pieces_folder(Path(unit.folder), unit.stem)


def path_of(folder: Path, piece: tuple[int, int], suffix: str) -> Path:
    """Path of a file of a piece (number from 1, count)."""
    return folder / f"{piece[0]}-of-{piece[1]}{suffix}"


def keep(
    unit: Unit,
    part: tuple[int, int] | None,
    recorded: Mapping[str, Any] | None,
    made_from: Mapping[str, Any],
    files: tuple[Path, ...] = (),
) -> dict[str, Any]:
    """Move a finished piece into the folder of pieces; return the record. ``unit`` is of the kind
    ``piece``; its ``files`` are finished, on the same file system, and moved.

    ``part`` are the samples (first, stop) and ``recorded`` the fields of :class:`.Recorded`; both
    None for an empty piece of a short scene. ``made_from``: see :func:`.journal.made_from`. Raises
    OutputError for an unwritable file.
    """
    assert unit.piece is not None
    folder = folder_of(unit)
    make_folder(folder)
    named = [(path_of(path.parent, unit.piece, path.suffix), path) for path in files]
    # Renamed within the stage, so that each moves into place under its final name.
    renamed = [path.replace(name) for name, path in named]
    record = {
        "piece": list(unit.piece),
        "samples": None if part is None else list(part),
        "recorded": recorded,
        "made_from": made_from,
        "files": [
            {"name": path.name, "bytes": path.stat().st_size, "sha256": sha256_of(path)}
            for path in renamed
        ],
    }
    # The record comes last: without a record the files of a killed job count as missing.
    record_file = path_of(Path(unit.stage), unit.piece, ".json")
    try:
        with atomic_file(record_file) as file:
            file.write(report.encoded_report(record, record_file.name))
        # Files that no record lists are never removed: those of an earlier recording go first.
        if earlier := _record(folder, unit.piece):
            with suppress(OSError):
                _remove_files(folder, unit.piece, earlier, {path.name for path in renamed})
        place([*renamed, record_file], folder)
    except OutputError as error:
        raise OutputError(with_final_names(str(error), Path(unit.stage), folder)) from error
    return record


def finished(unit: Unit) -> dict[str, Any] | None:
    """Record of an earlier recording of a piece with unchanged inputs and files; None otherwise."""
    assert unit.piece is not None
    record = _record(folder_of(unit), unit.piece)
    return record if record and journal.is_still(record["made_from"], unit) else None


def collect(unit: Unit, made_from: Mapping[str, Any], sample_count: int) -> list[dict[str, Any]]:
    """Records of all nonempty pieces of a scene, in order of time. Raises InputError for missing or
    damaged pieces, and for pieces recorded from inputs that differ from ``made_from``."""
    folder = folder_of(unit)
    count = _count(folder, unit)
    records, missing, stale = [], [], []
    for number in range(1, count + 1):
        record = _record(folder, (number, count))
        if record is None:
            missing.append(number)
        elif record["made_from"] != made_from:
            stale.append(number)
        elif record["samples"] is not None:
            records.append(record)
    if missing or stale:
        wrong = sorted(missing + stale)
        faults = [
            f"{_listed(numbers)} {'are' if len(numbers) > 1 else 'is'} {why}"
            for numbers, why in (
                (missing, "not there, or damaged"),
                (stale, "made from another state of the scene, or with other options"),
            )
            if numbers
        ]
        again = (
            f"export with --piece {wrong[0]}/{count}"
            if len(wrong) == 1
            else f"export each of them with --piece K/{count}"
        )
        raise InputError(
            f"{folder}: of {count} pieces, {'; '.join(faults)}; {again} and the same options."
        )
    # Every piece must begin where the piece before ends: pairs (stop, first) at even positions.
    edges = [0, *(edge for record in records for edge in record["samples"]), sample_count]
    if any(stop != first for stop, first in list(pairwise(edges))[::2]):
        raise InputError(f"{folder}: the pieces do not fit together; export all of them again.")
    return records


def _listed(numbers: list[int]) -> str:
    """The first ten numbers, and the count of further ones."""
    more = f" and {len(numbers) - 10} more" if len(numbers) > 10 else ""
    return ", ".join(map(str, numbers[:10])) + more


def files_of(unit: Unit, record: Mapping[str, Any]) -> dict[str, Path]:
    """Files of a piece, by suffix."""
    paths = [folder_of(unit) / file["name"] for file in record["files"]]
    return {path.suffix: path for path in paths}


def remove(unit: Unit) -> None:
    """Remove the merged pieces of all counts (8 pieces, 16 pieces ...). Files without a record, and
    changed files, stay; :func:`remove_folder` removes the folder."""
    folder = folder_of(unit)
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            match = _RECORD.fullmatch(path.name)
            record = match and _record(folder, (int(match[1]), int(match[2])))
            if record:
                _remove_files(folder, (int(match[1]), int(match[2])), record)
                path.unlink()


def remove_folder(folder: Path) -> None:
    """Remove a folder of pieces that holds nothing but unfinished files of killed jobs."""
    remove_abandoned(folder)
    with suppress(OSError):
        folder.rmdir()


def _remove_files(
    folder: Path, piece: tuple[int, int], record: Mapping[str, Any], kept: Container[str] = ()
) -> None:
    """Remove the files of a piece listed in its record, except names ``kept``. Raises OSError."""
    for file in record["files"]:
        name = file["name"]
        if name not in kept and name.startswith(path_of(folder, piece, ".").name):
            (folder / name).unlink()


def _count(folder: Path, unit: Unit) -> int:
    """Number of pieces of a scene, of several the most complete; InputError without pieces."""
    finished_of: dict[int, int] = {}
    with suppress(OSError):
        for path in folder.iterdir():
            if match := _RECORD.fullmatch(path.name):
                count = int(match[2])
                finished_of[count] = finished_of.get(count, 0) + 1
    if not finished_of:
        raise InputError(
            f"{folder}: has no pieces of {unit.title}; export them with --piece 1/N to N/N."
        )
    # Jobs of an earlier attempt may have left pieces of another count.
    return max(finished_of, key=lambda count: (finished_of[count] / count, count))


def _record(folder: Path, piece: tuple[int, int]) -> dict[str, Any] | None:
    """Record of a piece with unchanged files; None without one, or with an invalid one."""
    record = stored_json(path_of(folder, piece, ".json"))
    if record is None or not journal.has_files(record, folder):
        return None
    samples = record.get("samples")
    is_known = record.get("piece") == list(piece) and isinstance(record.get("made_from"), dict)
    is_range = (
        isinstance(samples, list)
        and len(samples) == 2
        and all(isinstance(edge, int) for edge in samples)
        and isinstance(record.get("recorded"), dict)
    )
    return record if is_known and (samples is None or is_range) else None
