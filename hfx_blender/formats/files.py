# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of any registered format: detection, rules and signals.

An export validates only formats with rules on the number of points, durations and frequencies (1 %
of the export's time), before files get their names; tables, sound and samples consist of checked
numbers. Envelopes are not decoded here: keyframe writers read their files back for error notes.
"""

from dataclasses import replace
from pathlib import Path
from typing import Final

from ..errors import InputError
from ..files import limits
from ..files.findings import Finding
from ..files.kinds import OWN_KINDS, title_of
from ..files.strict_json import mapped, mapped_data, read_bytes, read_data
from .registry import FORMATS, FormatInfo
from .signals.signals import FrequencyRange, Signal
from .written import Written

_HEAD: Final = 1 << 16  # bytes searched for the marks of a .json


def format_of(path: Path) -> FormatInfo:
    """Return the format of a file by its name; of ``.json`` by marks in the first 64 KiB. Only
    formats with ``check``. Raises InputError for another name, or an unreadable file."""
    name = path.name.lower()
    checked = [entry for entry in FORMATS.values() if entry.check]
    # Formats with marks share the suffix .json: their content decides below.
    for info in checked:
        suffix = info.read_suffix or info.suffix
        if name.endswith(suffix) and not (info.marks and suffix.endswith(".json")):
            return info
    if name.endswith(".json"):
        # Any .json is possible here: configurations and other programs' files as well.
        head = read_bytes(path)[:_HEAD].decode("utf-8", "replace")
        for info in checked:
            if info.marks and all(mark in head for mark in info.marks):
                return info
    entries = [*checked, *(entry for entry in FORMATS.values() if entry.read)]
    known = ", ".join([*(info.read_suffix or info.suffix for info in entries), *OWN_KINDS])
    raise InputError(f"{path}: is {title_of(path)}, which is no known format; known are {known}.")


def findings_of(info: FormatInfo, path: Path) -> list[Finding]:
    """Findings of the format's ``check``, in file order; none: valid. :func:`failure` for a file
    beyond parsing. Raises InputError for an unreadable path."""
    # Of a WAV only the head is parsed, of samples a line at a time: map instead of reading.
    content = {"wav": mapped, "jsonl": mapped_data}.get(info.id, read_data)(path)
    try:
        findings: list[Finding] = info.function("check")(content, str(path))
        return findings
    except InputError as error:
        return [failure(info, error, path)]


def failure(info: FormatInfo, error: InputError, path: Path) -> Finding:
    """Finding ``<FORMAT>-LARGE`` for an exceeded limit, else ``-UNREADABLE``, with the message of a
    reader without path and full stop."""
    code = "LARGE" if isinstance(error, limits.TooLargeError) else "UNREADABLE"
    message = str(error).removeprefix(f"{path}: ").rstrip(".")
    return Finding(f"{info.id.upper()}-{code}", "", message)


def first_error(findings: list[Finding]) -> str:
    """First finding of severity error as "place: message [code]"; empty without an error."""
    for finding in findings:
        if finding.severity == "error":
            location = f"{finding.place}: " if finding.place else ""
            return f"{location}{finding.message} [{finding.code}]"
    return ""


def without_invalid_files(written: Written) -> Written:
    """Delete files of an export that are invalid or too large; returns ``written`` without these.
    Formats with ``decode`` are validated without decoding; other files but tracks and WAV have at
    most the default memory limit. Each deletion is a sentence at the end of ``left_out``."""
    with_rules = tuple(info.suffix for info in FORMATS.values() if info.decode)
    unlimited = tuple(FORMATS[id].suffix for id in ("track", "wav"))
    files: list[Path] = []
    left_out: list[str] = []
    for path in dict.fromkeys(written.files):  # formats may share a companion
        size = path.stat().st_size
        fault = ""
        # Rows of tables, sound and samples were checked before writing.
        if path.name.endswith(with_rules):
            fault = first_error(findings_of(format_of(path), path))
        # Readers would refuse a larger file.
        elif size > limits.MEMORY.default and not path.name.endswith(unlimited):
            most = limits.MEMORY.default
            fault = f"it has {size:,} bytes, allowed are {most:,.0f}; export a shorter range"
        if fault:
            path.unlink()
            left_out.append(f"{path.name} would not be valid, and is not written: {fault}")
        else:
            files.append(path)
    return replace(written, files=tuple(files), left_out=(*written.left_out, *left_out))


def decoded(info: FormatInfo, content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """Decode the vibration signals of a file's content, and the frequency range of the file. Raises
    InputError for a format without envelopes or undecodable content, and TooLargeError for signals
    longer than ``limits.SECONDS``."""
    if not info.decode:
        raise InputError(f"{name}: {info.title} holds no vibration envelopes.")
    signals, frequencies = info.function("decode")(content, name)
    lasts_s = max((signal.duration_s for signal in signals), default=0.0)
    limits.SECONDS.check(lasts_s, name, "its envelopes last")
    return signals, frequencies


def read_signals(path: Path) -> tuple[list[Signal], FrequencyRange]:
    """Decode the vibration signals of a file and the frequency range. An AHAP pattern includes the
    ticks of ``<name>.transients.ahap`` in the same folder. Raises InputError for an unreadable file
    or a format without envelopes."""
    info = format_of(path)
    signals, frequencies = decoded(info, read_bytes(path), str(path))
    if info.id == "ahap":
        from .device_files.ahap import with_companion_ticks

        signals = with_companion_ticks(path, signals)
    return signals, frequencies
