# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of the file formats: their names, what they hold, and where their functions are.

An entry is all that registers a format: commands, checks, the export dialog and help texts are
made of the table, which imports none of the formats until one is used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from ..errors import UsageError
from ..files.suffixes import TEXTURE_MAP


@dataclass(frozen=True)
class FormatInfo:
    """A file format: its names, what it holds, and its functions.

    A function is named ``"module:function"`` below :mod:`hfx_blender.formats`; :meth:`function`
    imports it. The smallest entry is a file that is only checked::

        FormatInfo("x", "X file", ".x", check="folder.module:validate")

    Attributes
    ----------
    id : str
        Name in commands; in capital letters, codes of findings begin with it.
    title : str
        Name in messages.
    suffix : str
        End of the names of its files.
    dialog : (str, str, int), optional
        Formats of an export: label and tooltip in the export dialog, and the number of the bit
        of its check box, which stays the same for ever.
    modalities : tuple of str, optional
        What it holds of a device's output; None: all.
    holds_waves : bool
        It holds several frequencies of an actuator at once.
    beside : tuple of str
        Ends of the names of files that are written beside its own.
    read_suffix : str
        End of the names of files that are read, where it is shorter than ``suffix``.
    marks : tuple of str
        Texts at the beginning of a ``.json`` of any name that is of this format.
    own_start : bytes
        Pattern of the beginning that only our writers make, spaces included: who changes a file
        with another program lays it out anew. Without one, no file counts as ours.
    credits : frozenset of str
        Statements of :class:`~.signals.signals.Credits` that it has a place for.
    write_track : str
        ``(track, devices, stem, tolerance) -> Written``: what is felt, of a ``TrackReader``;
        raises ``NothingFeltError`` where a format cannot hold that nothing is.
    write_played : str
        ``(header, played, stem, scene) -> Written``: what all devices play, in one file.
    write_raster : str
        ``(raster, device, stem, tolerance) -> Written``: what one device plays.
    write_signals : str
        ``(signals, frequencies, stem, tolerance) -> Written``: vibration as envelopes, also from
        files of other formats.
    held : str
        ``(frequencies) -> FrequencyRange`` that it holds of those of ``write_signals``.
    why_nothing : str
        ``(device) -> str``: why it can hold nothing of a device; empty: it can.
    check : str
        ``(content, name) -> list of Finding``: faults of a file of anybody.
    unchecked : str
        Rules that ``check`` leaves to others, told with its verdict.
    read : str
        ``(path)``: reads a file that is too large, or needs too many others, for ``check``;
        raises ``InputError`` for its first fault.
    decode : str
        ``(content, name) -> (signals, frequencies)``: vibration as envelopes.
    read_raster : str
        ``(path) -> Raster``.
    facts : str
        ``(path) -> dict``: what ``hfx info`` shows beyond signals; with ``check`` only.

    Notes
    -----
    Writers get ``folder/stem``, without a suffix. They raise ``InputError`` when the format can
    hold nothing, or not all of a signal, and ``OutputError`` when a file cannot be written; what
    else is lost is told by ``Written.left_out``.
    """

    id: str
    title: str
    suffix: str
    dialog: tuple[str, str, int] | None = None
    modalities: tuple[str, ...] | None = None
    holds_waves: bool = False
    beside: tuple[str, ...] = ()
    read_suffix: str = ""
    marks: tuple[str, ...] = ()
    own_start: bytes = b""
    credits: frozenset[str] = frozenset()
    write_track: str = ""
    write_played: str = ""
    write_raster: str = ""
    write_signals: str = ""
    held: str = ""
    why_nothing: str = ""
    check: str = ""
    unchecked: str = ""
    read: str = ""
    decode: str = ""
    read_raster: str = ""
    facts: str = ""

    def function(self, kind: str) -> Callable[..., Any]:
        """Import one of the functions: ``info.function("check")(content, name)``."""
        module, _, name = getattr(self, kind).partition(":")
        found: Callable[..., Any] = getattr(import_module(f"{__package__}.{module}"), name)
        return found

    @property
    def is_written(self) -> bool:
        """Test that a writer of its own makes it, which conversions can use."""
        return bool(self.write_track or self.write_played or self.is_of_device)

    @property
    def is_of_device(self) -> bool:
        """Test that a file of this format holds the output of one device only."""
        return bool(self.write_raster or self.write_signals) and not self.write_track

    def plays_of(self, modalities: Iterable[str]) -> tuple[str, ...]:
        """Select the modalities that a file of this format can hold, in the given order."""
        return tuple(m for m in modalities if self.modalities is None or m in self.modalities)


_VIBRATION: Final = ("vibration",)
_OF_HE: Final = frozenset({"created"})
_START_OF_HE: Final = rb'\{"Meta[Dd]ata":\{"Version":.*?; 0 to 100 is \S+ to \S+ Hz"\},"'

FORMATS: Final[dict[str, FormatInfo]] = {
    each.id: each
    for each in (
        FormatInfo(
            "track",
            "HapticTrack",
            ".hfxtrack",
            dialog=("Haptic Track", "Everything that is felt, for any device (.hfxtrack)", 0),
            read="files:read_track",
        ),
        FormatInfo(
            "hjif",
            "MPEG HJIF",
            ".hjif",
            dialog=(
                "MPEG HJIF",
                "Everything that is felt, in MPEG's haptics format, with .glb meshes",
                1,
            ),
            beside=(".glb",),
            credits=frozenset({"description", "created"}),
            write_track="hjif.from_track:write",
            write_raster="hjif.from_actuators:write",
            write_signals="hjif.from_actuators:write_signals",
            check="hjif.rules:validate",
            decode="hjif.to_signals:decode",
            facts="hjif.reader:facts",
        ),
        FormatInfo(
            "jsonl",
            "JSON Lines of samples",
            ".samples.jsonl",
            dialog=(
                "JSON Lines",
                "Everything that is felt, sample by sample, for game engines",
                2,
            ),
            read_suffix=".jsonl",
            write_track="jsonl.jsonl_samples:export",
            check="jsonl.jsonl_samples:validate",
            facts="jsonl.jsonl_samples:facts",
        ),
        FormatInfo(
            "glb",
            "glTF binary",
            ".glb",
            dialog=("glTF Scene", "Bodies and moving volumes, with draft MPEG triggers (.glb)", 3),
            own_start=rb'.{20}\{"asset":\{"version":"2\.0","generator":"HFX"',
            check="glb.glb_reader:validate",
            unchecked="only what HFX reads of it was checked; all rules of glTF are those of "
            "Khronos' gltf-validator",
            facts="glb.glb_reader:facts",
        ),
        FormatInfo(
            "clip",
            "game clip",
            ".hfxclip",
            dialog=("Game Clip", "What devices play, for players in games (.hfxclip)", 18),
            write_played="clip.writing:write",
            check="clip.rules:validate",
            facts="clip.writing:facts",
        ),
        FormatInfo(
            "csv",
            "CSV raster",
            ".csv",
            dialog=("CSV", "Values of each device, a row for each sample", 4),
            write_raster="rasters.csv_raster:export",
            check="rasters.csv_raster:validate",
            read_raster="rasters.csv_raster:read",
            facts="rasters.csv_raster:facts",
        ),
        FormatInfo(
            "npz",
            "NPZ raster",
            ".raster.npz",
            dialog=("NPZ Raster", "Values of each device, as NumPy arrays", 5),
            write_raster="rasters.npz_raster:export",
            check="rasters.npz_raster:validate",
            read_raster="rasters.npz_raster:read",
            facts="rasters.npz_raster:facts",
        ),
        FormatInfo(
            "wav",
            "WAV",
            ".wav",
            dialog=("WAV", "Sound for vibration actuators, 16 bits", 6),
            modalities=_VIBRATION,
            holds_waves=True,
            beside=(".channels.json",),
            write_raster="sound.wav:export",
            check="sound.wav_reader:validate",
            facts="sound.wav_reader:facts",
        ),
        FormatInfo(
            "ahap",
            "Apple AHAP",
            ".ahap",
            dialog=("Apple AHAP", "Patterns for Core Haptics", 9),
            modalities=_VIBRATION,
            own_start=rb'\{"Version":1\.0,"Metadata":\{"Project":.*?"Hfx[A-Z]\w+":',
            credits=frozenset({"project", "created", "others"}),
            write_signals="ahap.ahap:write_signals",
            held="ahap.ahap:held",
            check="ahap.ahap_rules:validate",
            decode="ahap.ahap:decode",
        ),
        FormatInfo(
            "haptic",
            "Meta .haptic",
            ".haptic",
            dialog=("Meta .haptic", "Clips for Meta's Haptics SDK", 10),
            modalities=_VIBRATION,
            own_start=rb'\{"version":\{"major":1,.*?"metadata":\{"editor":"HFX"',
            credits=frozenset({"author", "project", "source", "tags"}),
            write_signals="device_files.haptic:write_signals",
            held="device_files.haptic:held",
            check="device_files.haptic:validate",
            decode="device_files.haptic:decode",
        ),
        FormatInfo(
            "he",
            "RichTap .he",
            ".he",
            dialog=("RichTap .he", "Patterns for RichTap phones, version 2", 11),
            modalities=_VIBRATION,
            marks=("Metadata", '"Pattern'),
            own_start=_START_OF_HE,
            credits=_OF_HE,
            write_signals="he.he:write_signals",
            held="he.he:held",
            check="he.he_rules:validate",
            decode="he.he:decode",
        ),
        FormatInfo(  # RichTap's player on phones of its core 22 refuses version 2
            "he1",
            "RichTap .he version 1",
            ".v1.he",
            dialog=("RichTap .he 1", "Patterns for RichTap phones, version 1", 12),
            modalities=_VIBRATION,
            credits=_OF_HE,
            write_signals="he.he:write_v1",
            held="he.he:held",
        ),
        FormatInfo(
            "openharmony",
            "OpenHarmony pattern",
            ".openharmony.json",
            dialog=("OpenHarmony", "Vibration patterns for OpenHarmony", 13),
            modalities=_VIBRATION,
            marks=('"MetaData"', '"Channels"'),
            own_start=_START_OF_HE,
            credits=_OF_HE,
            write_signals="he.he:write_openharmony",
            held="he.he:held",
            check="he.he_rules:validate",
            decode="he.he:decode",
        ),
        FormatInfo(
            "openxr",
            "OpenXR parametric vibration",
            ".openxr.json",
            dialog=("OpenXR", "Parametric vibration for OpenXR controllers", 14),
            modalities=_VIBRATION,
            marks=('"hfx-openxr-parametric"',),
            write_signals="device_files.openxr:write_signals",
            held="device_files.openxr:held",
            check="device_files.openxr:validate",
            decode="device_files.openxr:decode",
        ),
        FormatInfo(
            "tact",
            "bHaptics .tact",
            ".tact",
            dialog=("bHaptics .tact", "Projects for bHaptics vests and sleeves", 15),
            modalities=_VIBRATION,
            own_start=rb'\{"name":.*?"createdAt":0,"updatedAt":0,"id":""',
            write_raster="tact.tact:export",
            why_nothing="tact.tact_layouts:why_nothing",
            check="tact.tact_rules:validate",
            decode="tact.tact:decode",
        ),
        FormatInfo(
            "channels",
            "channels of a WAV",
            ".channels.json",
            own_start=rb'\{\n  "format": "hfx-',
            check="sound.channel_list:validate",
            facts="sound.channel_list:facts",
        ),
        FormatInfo("texture", "texture map", TEXTURE_MAP, read="pictures.texture_map:read"),
        FormatInfo("picture", "PNG", ".png", read="pictures.png:read"),
        FormatInfo("chart", "SVG picture", ".svg", read="files:read_svg"),
        FormatInfo("scene", "Blender file", ".blend", read="files:read_blend"),
    )
}

EXPORTED: Final = tuple(each.id for each in FORMATS.values() if each.dialog is not None)
"""Formats of an export, in the order of its dialog; ``track`` and ``glb`` it writes itself."""

TARGETS: Final = tuple(each.id for each in FORMATS.values() if each.is_written)
"""Formats that a file can be converted to."""

_REMOVED: Final = {
    "ahap-sqrt": ("ahap", ".sqrt.ahap"),
    "jsonl-compact": ("jsonl", ".compact.samples.jsonl"),
    "wav24": ("wav", ".24bit.wav"),
    "wavfloat": ("wav", ".float.wav"),
}
"""Formats that are read, but written no more: what is written instead, and their suffixes."""


def refuse_unknown(names: Iterable[str], option: str, known: Collection[str] = EXPORTED) -> None:
    """Reject names of formats that are not known; for a removed one, name its replacement.

    Raises
    ------
    UsageError
    """
    for name in names:
        if name in _REMOVED:
            instead = _REMOVED[name][0]
            raise UsageError(f"{option} {name}: is read, but written no more; use {instead}")
        if name not in known:
            raise UsageError(f"{option} {name}: expected one of {', '.join(known)}")


def target_of(path: Path) -> FormatInfo:
    """Format that the suffix of a file to be written names.

    Raises
    ------
    UsageError
        It names none, or one that is written no more.
    """
    for removed, (instead, suffix) in _REMOVED.items():
        if path.name.endswith(suffix):
            raise UsageError(
                f"{path}: '{suffix}' was the suffix of {removed}, which is written no more; use "
                f"'{FORMATS[instead].suffix}', or '--to {instead}' with any name"
            )
    targets = [FORMATS[id] for id in TARGETS]
    for info in sorted(targets, key=lambda each: -len(each.suffix)):
        if path.name.endswith(info.suffix) and path.name != info.suffix:
            return info
    suffixes = ", ".join(each.suffix for each in targets)
    raise UsageError(f"{path}: its suffix names no format; there are {suffixes}, or say --to")


def suffixes(ids: Sequence[str]) -> tuple[str, ...]:
    """Ends of the names of the files that formats of an export write, also beside others."""
    return tuple(
        dict.fromkeys(each for id in ids for each in (FORMATS[id].suffix, *FORMATS[id].beside))
    )
