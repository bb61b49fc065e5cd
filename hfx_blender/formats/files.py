# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of any format: detection, validation, signals."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat

from ..engine.track import SUFFIX as TRACK_SUFFIX
from ..engine.track import TrackReader
from ..errors import InputError, OutputError, refuse_no_file
from ..files import limits
from ..files.findings import Finding
from ..files.kinds import title_of
from ..files.strict_json import mapped, read_bytes
from .ahap import ahap, ahap_rules
from .clip import rules as clip_rules
from .clip.container import SUFFIX as CLIP_SUFFIX
from .device_files import haptic, openxr
from .glb import glb, glb_rules
from .he import he, he_rules
from .hjif import rules, to_signals
from .jsonl import jsonl_samples
from .pictures import png, texture_map
from .rasters import csv_raster, npz_raster
from .signals.signals import FrequencyRange, Signal
from .signals.simplified_writer import Decoder
from .sound import channel_list, wav, wav_reader
from .tact import tact, tact_rules

_MOST_BYTES: Final = 1 << 30
_HEAD: Final = 1 << 16  # bytes of a .json that tell what it is


@dataclass(frozen=True)
class FileFormat:
    """Format that files of strangers may have."""

    name: str
    title: str
    validate: Callable[[bytes, str], list[Finding]]
    decode: Decoder | None = None  # None: it does not hold vibration as envelopes

    @property
    def has_signals(self) -> bool:
        """Test that the format holds vibration as envelopes."""
        return self.decode is not None

    def signals(self, content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
        """Vibration signals of a file, within the limits of what a file may ask for.

        Raises
        ------
        InputError
            It cannot be read, has errors, asks for too much, or is of a format without envelopes.
        """
        if self.decode is None:
            raise InputError(f"{name}: {self.title} holds no vibration envelopes.")
        signals, frequencies = self.decode(content, name)
        lasts_s = max((each.duration_s for each in signals), default=0.0)
        limits.SECONDS.check(lasts_s, name, "its envelopes last")
        return signals, frequencies


FILE_FORMATS: Final[dict[str, FileFormat]] = {
    each.name: each
    for each in (
        FileFormat("ahap", "Apple AHAP", ahap_rules.validate, ahap.decode),
        FileFormat("haptic", "Meta .haptic", haptic.validate, haptic.decode),
        FileFormat("he", "RichTap .he", he_rules.validate, he.decode),
        FileFormat("openharmony", "OpenHarmony pattern", he_rules.validate, he.decode),
        FileFormat("openxr", "OpenXR parametric vibration", openxr.validate, openxr.decode),
        FileFormat("tact", "bHaptics .tact", tact_rules.validate, tact.decode),
        FileFormat("hjif", "MPEG HJIF", rules.validate, to_signals.decode),
        FileFormat("jsonl", "JSON Lines of samples", jsonl_samples.validate),
        FileFormat("glb", "glTF binary", glb_rules.validate),
        FileFormat("npz", "NPZ raster", npz_raster.validate),
        FileFormat("csv", "CSV raster", csv_raster.validate),
        FileFormat("wav", "WAV", wav_reader.validate),
        FileFormat("clip", "game clip", clip_rules.validate),
        FileFormat("channels", "channels of a WAV", channel_list.validate),
    )
}
_WHOLE: Final = {
    TRACK_SUFFIX: FileFormat("track", "HapticTrack", lambda content, name: []),
    texture_map.SUFFIX: FileFormat("texture", "texture map", lambda content, name: []),
    ".png": FileFormat("picture", "PNG", lambda content, name: []),
    ".svg": FileFormat("chart", "SVG picture", lambda content, name: []),
    ".blend": FileFormat("scene", "Blender file", lambda content, name: []),
}
"""Files that are checked by reading them with what is beside them, or part by part."""

_SUFFIXES: Final = {
    ".ahap": "ahap",
    ".haptic": "haptic",
    ".he": "he",
    ".tact": "tact",
    ".hjif": "hjif",
    ".jsonl": "jsonl",
    CLIP_SUFFIX: "clip",
    glb.SUFFIX: "glb",
    npz_raster.SUFFIX: "npz",
    ".csv": "csv",
    ".wav": "wav",
    wav.SIDECAR_SUFFIX: "channels",
}


_RICHTAP: Final = rb'\{"Meta[Dd]ata":\{"Version":.*?; 0 to 100 is \S+ to \S+ Hz"\},"'
_OWN_STARTS: Final = {
    ".ahap": rb'\{"Version":1\.0,"Metadata":\{"Project":.*?"Hfx[A-Z]\w+":',
    ".haptic": rb'\{"version":\{"major":1,.*?"metadata":\{"editor":"HFX"',
    ".he": _RICHTAP,
    he.OPENHARMONY_SUFFIX: _RICHTAP,
    ".tact": rb'\{"name":.*?"createdAt":0,"updatedAt":0,"id":""',
    wav.SIDECAR_SUFFIX: rb'\{\n  "format": "hfx-',
}
"""Beginnings that only our writers make, spaces included: who changes a file with another program
lays it out anew."""


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
    if path.name.endswith(glb.SUFFIX):
        return glb.is_ours(path)
    start = next((own for suffix, own in _OWN_STARTS.items() if path.name.endswith(suffix)), None)
    try:
        with path.open("rb") as file:
            return start is not None and bool(re.match(start, file.read(_HEAD), re.DOTALL))
    except OSError:
        return False


def format_of(path: Path) -> FileFormat:
    """Format of a file, by its name, and of a ``.json`` by its content.

    Raises
    ------
    InputError
        It is none of ours, or cannot be read.
    """
    name = path.name.lower()
    for suffix, kind in _SUFFIXES.items():
        if name.endswith(suffix):
            return FILE_FORMATS[kind]
    if name.endswith(".json"):
        inside = _json_kind(path)
        if inside is not None:
            return FILE_FORMATS[inside]
    known = ", ".join([*_SUFFIXES, he.OPENHARMONY_SUFFIX, openxr.SUFFIX, *_WHOLE])
    raise InputError(
        f"{path}: is {title_of(path)}, of no format that is known here; known are {known}."
    )


def _json_kind(path: Path) -> str | None:
    head = read_bytes(path)[:_HEAD].decode("utf-8", "replace")
    for marks, kind in (
        (('"MetaData"', '"Channels"'), "openharmony"),
        (("Metadata", '"Pattern'), "he"),
        ((json.dumps(openxr.FORMAT),), "openxr"),
    ):
        if all(mark in head for mark in marks):
            return kind
    return None


def can_validate(path: Path) -> bool:
    """Test for a file that :func:`validate` knows; a ``.json`` is looked into."""
    try:
        return path.name.endswith(tuple(_WHOLE)) or format_of(path) is not None
    except InputError:
        return False


def validate(path: Path, *, reads: bool = True) -> tuple[FileFormat, list[Finding]]:
    """The format of a file, and what is wrong with it.

    A file that cannot be parsed at all has the single finding ``<FORMAT>-UNREADABLE``.

    Parameters
    ----------
    path : Path
    reads : bool
        Read its envelopes as well, to see that they can be read: most of the work.

    Raises
    ------
    InputError
        It is of no known format, or cannot be read.
    """
    refuse_no_file(path)
    for suffix, whole in _WHOLE.items():
        if path.name.endswith(suffix):
            return whole, _whole_findings(path, whole.name)
    found = format_of(path)
    content = mapped(path) if found.name == "wav" else read_bytes(path, _MOST_BYTES)
    prefix = found.name.upper()
    try:
        findings = found.validate(content, str(path))
        if reads and found.has_signals and not any(each.severity == "error" for each in findings):
            found.signals(content, str(path))  # a valid file can be read
        return found, findings
    except limits.TooLargeError as error:
        return found, [Finding(f"{prefix}-LARGE", "", _message(error, path))]
    except InputError as error:
        return found, [Finding(f"{prefix}-UNREADABLE", "", _message(error, path))]


def _message(error: InputError, path: Path) -> str:
    return str(error).removeprefix(f"{path}: ").rstrip(".")


def _whole_findings(path: Path, kind: str) -> list[Finding]:
    """Faults of a file that is read as a whole."""
    try:
        if kind == "texture":
            texture_map.read(path)
        elif kind == "picture":
            png.read(path)
        elif kind == "chart":
            _refuse_no_svg(path)
        elif kind == "scene":  # Blender alone reads the rest
            if not mapped(path)[:7].startswith((b"BLENDER", b"\x28\xb5\x2f\xfd")):
                raise InputError(f"{path}: is no .blend file.")
        else:
            with TrackReader(path) as track:  # it may be larger than memory
                for _ in track.runs():
                    pass
    except InputError as error:
        return [Finding(f"{kind.upper()}-CONTENT", "", _message(error, path))]
    return []


def _refuse_no_svg(path: Path) -> None:
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


def read_signals(path: Path) -> tuple[list[Signal], FrequencyRange]:
    """Vibration signals in a file.

    Raises
    ------
    InputError
        It cannot be read, or is of a format without envelopes.
    """
    found = format_of(path)
    signals, frequencies = found.signals(read_bytes(path), str(path))
    beside = path.with_name(path.name.removesuffix(ahap.SUFFIX) + ahap.TICKS_SUFFIX)
    is_ticks = path.name.endswith(ahap.TICKS_SUFFIX)
    if found.name == "ahap" and not is_ticks and beside.is_file():
        ticks = ahap.with_ticks_of(read_bytes(beside), str(beside), signals[0])
        signals = [ticks, *signals[1:]]
    return signals, frequencies
