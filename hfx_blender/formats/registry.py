# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of the file formats: names, contents and functions.

``formats.toml`` is the only registration of a format: commands, checks, the export dialog and help
texts are derived from it. A format's module is imported at the first use of a function.
"""

import tomllib
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from ..errors import UsageError


@dataclass(frozen=True)
class FormatInfo:
    """File format: its names, contents and functions.

    A function is named ``"module:function"`` below :mod:`hfx_blender.formats`, empty for none;
    :meth:`function` imports it. Functions of ``hfx_tools`` serve commands that Blender lacks: an
    installed extension names these functions, and never imports them. The smallest entry is a
    format with a check only::

        [x]
        title = "X file"
        suffix = ".x"
        check = "folder.module:validate"

    Writers get ``folder/stem`` without suffix. They raise ``InputError`` if the format can store
    nothing, or a signal only in part, and ``OutputError`` if a file cannot be written; all other
    losses are sentences in ``Written.left_out``.
    """

    id: str  # name in commands; in capitals the prefix of finding codes
    title: str  # name in messages
    suffix: str  # end of its file names
    # Export formats: label, tooltip and bit number of the check box in the export dialog. The
    # number is stored in .blend files and never changes.
    dialog: tuple[str, str, int] | None = None
    modalities: tuple[str, ...] | None = None  # that a file holds; None: all
    holds_waves: bool = False  # several simultaneous frequencies of an actuator
    companions: tuple[str, ...] = ()  # suffixes of files written with each file
    read_suffix: str = ""  # accepted by readers, where shorter than ``suffix``
    marks: tuple[str, ...] = ()  # texts in the first 64 KiB that identify a .json of any name
    # Regular expression for the first bytes written by HFX, spaces included; a file saved by
    # another program does not match. Empty: no file counts as written by HFX.
    own_start: bytes = b""
    credits: frozenset[str] = frozenset()  # stored fields of signals.signals.Credits
    # (track, devices, stem, tolerance) -> Written: the samples of a TrackReader; raises
    # NothingFeltError if there are none and the format requires some.
    write_track: str = ""
    write_played: str = ""  # (header, played, stem, scene) -> Written: all devices in one file
    write_raster: str = ""  # (raster, device, stem, tolerance) -> Written: a single device
    # (signals, frequencies, stem, tolerance) -> Written: vibration envelopes, also from files of
    # other formats.
    write_signals: str = ""
    held: str = ""  # (frequencies) -> FrequencyRange stored by write_signals
    why_nothing: str = ""  # (device) -> str: why no output can be stored; empty: some can
    check: str = ""  # (content, name) -> list of Finding, for files of any program
    unchecked: str = ""  # rules that check omits, shown with its verdict
    # (path) -> list of Finding, warnings alone: reads a file that is large or needs companions;
    # InputError for the first fault.
    read: str = ""
    decode: str = ""  # (content, name) -> (signals, frequencies): vibration envelopes
    read_raster: str = ""  # (path) -> Raster
    facts: str = ""  # (path) -> dict: rows of hfx info besides signals; with check only

    def function(self, kind: str) -> Callable[..., Any]:
        """Import and return the function named in field ``kind``, which must not be empty:
        ``info.function("check")(content, name)``."""
        module, _, name = getattr(self, kind).partition(":")
        path = module if module.startswith(_TOOLS) else f"{__package__}.{module}"
        function: Callable[..., Any] = getattr(import_module(path), name)
        return function

    @property
    def is_of_device(self) -> bool:
        """True for files of a single device: written from rasters or signals, no tracks."""
        return bool(self.write_raster or self.write_signals) and not self.write_track

    def plays_of(self, modalities: Iterable[str]) -> tuple[str, ...]:
        """Select the modalities that a file can hold, in the given order."""
        return tuple(m for m in modalities if self.modalities is None or m in self.modalities)


_TOOLS: Final = "hfx_tools.formats."


def _entry(id: str, members: dict[str, Any]) -> FormatInfo:
    """Entry of a table of ``formats.toml``: arrays are tuples, ``credits`` a set, ``own_start``
    bytes."""
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in members.items()}
    own_start, stored = values.pop("own_start", ""), frozenset(values.pop("credits", ()))
    return FormatInfo(id, own_start=own_start.encode(), credits=stored, **values)


FORMATS: Final[dict[str, FormatInfo]] = {
    id: _entry(id, members)
    for id, members in tomllib.loads(
        Path(__file__).with_name("formats.toml").read_text(encoding="utf-8")
    ).items()
}
"""Formats by id, in the order of menus and help texts; a table each in ``formats.toml``."""

EXPORTED: Final = tuple(info.id for info in FORMATS.values() if info.dialog is not None)
"""Ids of the export formats in dialog order; the export writes ``track`` and ``glb`` directly."""


def refuse_unknown(names: Iterable[str], option: str, known: Collection[str] = EXPORTED) -> None:
    """Raise UsageError for the first name outside ``known``; returns nothing. ``option``, such as
    ``--format``, begins the message."""
    for name in names:
        if name not in known:
            raise UsageError(f"{option} {name}: expected one of {', '.join(known)}")


def suffixes(ids: Sequence[str]) -> tuple[str, ...]:
    """Distinct suffixes of the files of export formats, each followed by its companions'."""
    return tuple(
        dict.fromkeys(name for id in ids for name in (FORMATS[id].suffix, *FORMATS[id].companions))
    )
