# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of any format: detection, validation, signals, short descriptions.

Written files pass our own validation, or they do not get their names. Conversions, of files of
strangers, check whatever they wrote. Exports check what has rules of its own on how many points,
how long and how fast, which takes 1 % of their time; their tables, sound and samples are made of
numbers that were checked before. They do not read envelopes here: writers of keyframes have done
so for the error that their notes tell.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

from ..engine.track import TrackReader
from ..errors import InputError, OutputError, refuse_no_file
from ..files import limits
from ..files.findings import Finding, refuse_errors
from ..files.kinds import title_of
from ..files.strict_json import mapped, read_bytes
from .leniency import as_fact
from .registry import FORMATS, FormatInfo
from .signals.signals import FrequencyRange, Signal
from .written import Written

_MOST_BYTES: Final = 1 << 30
_HEAD: Final = 1 << 16  # bytes of a .json that tell what it is


def format_of(path: Path) -> FormatInfo:
    """Format of a file, by its name, and of a ``.json`` by its content.

    Raises
    ------
    InputError
        It is none that is checked by its content, or cannot be read.
    """
    name = path.name.lower()
    checked = [each for each in FORMATS.values() if each.check]
    for info in checked:
        suffix = info.read_suffix or info.suffix
        if name.endswith(suffix) and not (info.marks and suffix.endswith(".json")):
            return info
    if name.endswith(".json"):
        head = read_bytes(path)[:_HEAD].decode("utf-8", "replace")
        for info in checked:
            if info.marks and all(mark in head for mark in info.marks):
                return info
    known = ", ".join(each.read_suffix or each.suffix for each in [*checked, *_read_whole()])
    raise InputError(
        f"{path}: is {title_of(path)}, of no format that is known here; known are {known}."
    )


def refuse_strangers(files: Iterable[Path], target: Path) -> None:
    """Refuse to replace files beside a target, which nobody named, unless HFX wrote them.

    Raises
    ------
    OutputError
        There is one whose content does not prove that.
    """
    for path in files:
        if path != target and path.is_file() and not _is_ours(path):
            raise OutputError(
                f"{path}: cannot be written (a file of this name is there that HFX did not make); "
                f"'{target.name}' needs this name: choose another target."
            )


def _is_ours(path: Path) -> bool:
    starts = (each.own_start for each in FORMATS.values() if path.name.endswith(each.suffix))
    start = next(filter(None, starts), None)
    try:
        with path.open("rb") as file:
            return start is not None and bool(re.match(start, file.read(_HEAD), re.DOTALL))
    except OSError:
        return False


def _read_whole() -> list[FormatInfo]:
    """Formats that are checked by reading a file with what is beside it, or part by part."""
    return [each for each in FORMATS.values() if each.read]


def is_known(path: Path) -> bool:
    """Test that :func:`facts_of` knows a file's format; a ``.json`` is looked into."""
    try:
        format_of(path)
    except InputError:
        return False
    return True


def can_validate(path: Path) -> bool:
    """Test for a file that :func:`validate` knows; a ``.json`` is looked into."""
    return any(path.name.endswith(each.suffix) for each in _read_whole()) or is_known(path)


def validate(path: Path, *, reads: bool = True) -> tuple[FormatInfo, list[Finding]]:
    """The format of a file, and what is wrong with it.

    A file that cannot be parsed at all has the single finding ``<FORMAT>-UNREADABLE``.

    Parameters
    ----------
    reads : bool
        Read its envelopes as well, to see that they can be read: most of the work.

    Raises
    ------
    InputError
        It is of no known format, or cannot be read.
    """
    refuse_no_file(path)
    for info in _read_whole():
        if path.name.endswith(info.suffix):
            try:
                info.function("read")(path)
            except InputError as error:
                return info, [_finding(info, "CONTENT", error, path)]
            return info, []
    info = format_of(path)
    content = mapped(path) if info.id == "wav" else read_bytes(path, _MOST_BYTES)
    try:
        findings: list[Finding] = info.function("check")(content, str(path))
        if reads and info.decode and not any(each.severity == "error" for each in findings):
            decoded(info, content, str(path))  # a valid file can be read
        return info, findings
    except limits.TooLargeError as error:
        return info, [_finding(info, "LARGE", error, path)]
    except InputError as error:
        return info, [_finding(info, "UNREADABLE", error, path)]


def _finding(info: FormatInfo, code: str, error: InputError, path: Path) -> Finding:
    """The error of a reader as the only finding about a file."""
    message = str(error).removeprefix(f"{path}: ").rstrip(".")
    return Finding(f"{info.id.upper()}-{code}", "", message)


def read_track(path: Path) -> None:
    """Read a track to its end, as it may be larger than memory.

    Raises
    ------
    InputError
        It is damaged.
    """
    with TrackReader(path) as track:
        for _ in track.runs():
            pass


def read_blend(path: Path) -> None:
    """Read the beginning of a Blender file; Blender alone reads the rest.

    Raises
    ------
    InputError
        It is none.
    """
    if not mapped(path)[:7].startswith((b"BLENDER", b"\x28\xb5\x2f\xfd")):
        raise InputError(f"{path}: is no .blend file.")


def read_svg(path: Path) -> None:
    """Read a picture as XML.

    Raises
    ------
    InputError
        It is not well-formed, or no SVG.
    """
    root = ""
    parser = expat.ParserCreate()

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal root
        root, parser.StartElementHandler = name, None

    parser.StartElementHandler = begin
    try:
        parser.Parse(read_bytes(path), True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: is not valid XML ({error}).") from None
    if root != "svg":
        raise InputError(f"{path}: begins with '{root[:60]}', expected is 'svg'.")


def fault_of(path: Path, *, reads: bool = True) -> str:
    """Reason that a file that was just written is not valid; empty: it is.

    Parameters
    ----------
    reads : bool
        See :func:`validate`.

    Raises
    ------
    InputError
        It cannot be read, or is of no format of ours.
    """
    _, findings = validate(path, reads=reads)
    errors = [each for each in findings if each.severity == "error"]
    if not errors:
        return ""
    place = f"{errors[0].place}: " if errors[0].place else ""
    return f"{place}{errors[0].message} [{errors[0].code}]"


def valid_only(written: Written) -> Written:
    """An export's files without those that are not valid, which are removed and told."""
    with_rules = tuple(each.suffix for each in FORMATS.values() if each.decode)
    files: list[Path] = []
    left_out: list[str] = []
    for path in written.files:
        fault = fault_of(path, reads=False) if path.name.endswith(with_rules) else ""
        if fault:
            path.unlink()
            left_out.append(f"{path.name} would not be valid, and is not written: {fault}")
        else:
            files.append(path)
    return replace(written, files=tuple(files), left_out=(*written.left_out, *left_out))


def decoded(info: FormatInfo, content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Vibration signals of a file, within the limits of what a file may ask for.

    Raises
    ------
    InputError
        It cannot be read, has errors, asks for too much, or is of a format without envelopes.
    """
    if not info.decode:
        raise InputError(f"{name}: {info.title} holds no vibration envelopes.")
    signals, frequencies = info.function("decode")(content, name)
    lasts_s = max((each.duration_s for each in signals), default=0.0)
    limits.SECONDS.check(lasts_s, name, "its envelopes last")
    return signals, frequencies


def read_signals(path: Path) -> tuple[list[Signal], FrequencyRange]:
    """Vibration signals in a file; those of AHAP with the ticks of the pattern beside it.

    Raises
    ------
    InputError
        It cannot be read, or is of a format without envelopes.
    """
    info = format_of(path)
    signals, frequencies = decoded(info, read_bytes(path), str(path))
    if info.id == "ahap":
        from .ahap.ahap import with_ticks_beside

        signals = with_ticks_beside(path, signals)
    return signals, frequencies


def facts_of(path: Path) -> dict[str, Any]:
    """Format, validity and content of a file.

    Files of formats that other tools write may have errors that readers tolerate.

    Raises
    ------
    InputError
        It is of no known format, or cannot be read.
    """
    info, findings = validate(path)
    errors = [each for each in findings if each.severity == "error"]
    if not info.decode:
        refuse_errors(errors, str(path))
    facts: dict[str, Any] = {
        "file": str(path),
        "format": info.title,
        "bytes": path.stat().st_size,
        "valid": f"no, {len(errors)} errors ('hfx validate' tells them)" if errors else "yes",
    }
    return facts | (info.function("facts")(path) if info.facts else _facts_of_signals(path))


def _facts_of_signals(path: Path) -> dict[str, Any]:
    signals, frequencies = read_signals(path)
    notes = [note for each in signals for note in each.notes]
    left_out = [note for each in signals for note in each.left_out]
    return {
        **({"metadata": texts} if signals and (texts := signals[0].credits.texts) else {}),
        **as_fact("notes", notes),
        **as_fact("left_out", left_out),
        "lowest_hz": frequencies.lowest_hz,
        "highest_hz": frequencies.highest_hz,
        "signals": [
            {
                "signal": each.name,
                "seconds": round(each.duration_s, 6),
                "peak": round(float(each.amplitude.values.max()), 4),
                "keyframes": len(each.amplitude),
                "transients": len(each.transients),
            }
            for each in signals
        ],
    }
