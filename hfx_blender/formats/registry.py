# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of the file formats: names, contents and functions.

The table is the only registration of a format: commands, checks, the export dialog and help
texts are derived from it. A format's module is imported at the first use of a function.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from ..errors import UsageError
from ..files.kinds import TEXTURE_MAP_SUFFIX


@dataclass(frozen=True)
class FormatInfo:
    """File format: its names, contents and functions.

    A function is named ``"module:function"`` below :mod:`hfx_blender.formats`, empty for none;
    :meth:`function` imports it. Functions of ``hfx_tools`` serve commands that Blender lacks: an
    installed extension names these functions, and never imports them. The smallest entry is a
    format with a check only::

        FormatInfo("x", "X file", ".x", check="folder.module:validate")

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
    # (path): validates a file that is large or needs companions; InputError for the first fault.
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
    def is_written(self) -> bool:
        """True for a target of conversions: a writer of tracks, of all devices or of a device."""
        return bool(self.write_track or self.write_played or self.is_of_device)

    @property
    def is_of_device(self) -> bool:
        """True for files of a single device: written from rasters or signals, no tracks."""
        return bool(self.write_raster or self.write_signals) and not self.write_track

    def plays_of(self, modalities: Iterable[str]) -> tuple[str, ...]:
        """Select the modalities that a file can hold, in the given order."""
        return tuple(m for m in modalities if self.modalities is None or m in self.modalities)


_TOOLS: Final = "hfx_tools.formats."
_VIBRATION: Final = ("vibration",)
_OF_HE: Final = frozenset({"created"})
_START_OF_HE: Final = rb'\{"Meta[Dd]ata":\{"Version":.*?; 0 to 100 is \S+ to \S+ Hz"\},"'

FORMATS: Final[dict[str, FormatInfo]] = {
    info.id: info
    for info in (
        FormatInfo(
            "track",
            "HapticTrack",
            ".hfxtrack",
            dialog=("Haptic Track", "Samples of all effects, for any device (.hfxtrack)", 0),
            read=f"{_TOOLS}whole_files:read_track",
        ),
        FormatInfo(
            "hjif",
            "MPEG HJIF",
            ".hjif",
            dialog=(
                "MPEG HJIF",
                "Samples of all effects in MPEG's haptics format, with .glb meshes",
                1,
            ),
            companions=(".glb",),
            credits=frozenset({"description", "created"}),
            write_track="hjif.from_track:write",
            write_raster="hjif.from_actuators:write",
            write_signals="hjif.from_actuators:write_signals",
            check="hjif.hjif_rules:validate",
            decode="hjif.to_signals:decode",
            facts=f"{_TOOLS}facts:hjif_facts",
        ),
        FormatInfo(
            "jsonl",
            "JSON Lines of samples",
            ".samples.jsonl",
            dialog=("JSON Lines", "Samples of all effects as lines of JSON, for game engines", 2),
            read_suffix=".jsonl",
            write_track="jsonl_samples:export",
            check=f"{_TOOLS}jsonl_rules:validate",
            facts=f"{_TOOLS}jsonl_rules:facts",
        ),
        FormatInfo(
            "glb",
            "glTF binary",
            ".glb",
            dialog=("glTF Scene", "Bodies and moving volumes, with draft MPEG triggers (.glb)", 3),
            own_start=rb'.{20}\{"asset":\{"version":"2\.0","generator":"HFX"',
            check="glb.glb:validate",
            unchecked="only the members used by HFX were checked; Khronos' gltf-validator "
            "checks all rules of glTF",
            facts=f"{_TOOLS}facts:glb_facts",
        ),
        FormatInfo(
            "clip",
            "game clip",
            ".hfxclip",
            dialog=("Game Clip", "Output of devices, for players in games (.hfxclip)", 18),
            write_played="clip.clip_writer:write",
            check=f"{_TOOLS}clip_rules:validate",
            facts=f"{_TOOLS}facts:clip_facts",
        ),
        FormatInfo(
            "csv",
            "CSV raster",
            ".csv",
            dialog=("CSV", "Values of each device, a row for each sample", 4),
            write_raster="rasters.csv_raster:export",
            check=f"{_TOOLS}csv_reader:validate",
            read_raster=f"{_TOOLS}csv_reader:read",
            facts=f"{_TOOLS}csv_reader:facts",
        ),
        FormatInfo(
            "npz",
            "NPZ raster",
            ".raster.npz",
            dialog=("NPZ Raster", "Values of each device, as NumPy arrays", 5),
            write_raster="rasters.npz_raster:export",
            check=f"{_TOOLS}npz_reader:validate",
            read_raster=f"{_TOOLS}npz_reader:read",
            facts=f"{_TOOLS}npz_reader:facts",
        ),
        FormatInfo(
            "wav",
            "WAV",
            ".wav",
            dialog=("WAV", "Sound for vibration actuators, 16 bits", 6),
            modalities=_VIBRATION,
            holds_waves=True,
            companions=(".channels.json",),
            write_raster="sound.wav:export",
            check=f"{_TOOLS}wav_rules:validate",
            facts=f"{_TOOLS}wav_rules:facts",
        ),
        FormatInfo(
            "ahap",
            "Apple AHAP",
            ".ahap",
            dialog=("Apple AHAP", "Patterns for Core Haptics", 9),
            modalities=_VIBRATION,
            own_start=rb'\{"Version":1\.0,"Metadata":\{"Project":.*?"Hfx[A-Z]\w+":',
            credits=frozenset({"project", "created", "others"}),
            write_signals="device_files.ahap:write_signals",
            held="device_files.ahap:held",
            check="device_files.ahap_rules:validate",
            decode="device_files.ahap:decode",
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
            write_signals="device_files.he:write_signals",
            held="device_files.he:held",
            check="device_files.he_rules:validate",
            decode="device_files.he:decode",
        ),
        FormatInfo(  # RichTap's player on phones of its core 22 refuses version 2
            "he1",
            "RichTap .he version 1",
            ".v1.he",
            dialog=("RichTap .he 1", "Patterns for RichTap phones, version 1", 12),
            modalities=_VIBRATION,
            credits=_OF_HE,
            write_signals="device_files.he:write_v1",
            held="device_files.he:held",
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
            write_signals="device_files.he:write_openharmony",
            held="device_files.he:held",
            check="device_files.he_rules:validate",
            decode="device_files.he:decode",
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
            write_raster="device_files.tact:export",
            why_nothing="device_files.tact_layouts:why_nothing",
            check="device_files.tact:validate",
            decode="device_files.tact:decode",
        ),
        FormatInfo(
            "channels",
            "channels of a WAV",
            ".channels.json",
            own_start=rb'\{\n  "format": "hfx-',
            check=f"{_TOOLS}wav_rules:validate_channels",
            facts=f"{_TOOLS}wav_rules:channel_facts",
        ),
        FormatInfo("texture", "texture map", TEXTURE_MAP_SUFFIX, read="pictures.texture_map:read"),
        FormatInfo("picture", "PNG", ".png", read="pictures.png:read"),
        FormatInfo("chart", "SVG picture", ".svg", read=f"{_TOOLS}whole_files:read_svg"),
        FormatInfo("scene", "Blender file", ".blend", read=f"{_TOOLS}whole_files:read_blend"),
    )
}

EXPORTED: Final = tuple(info.id for info in FORMATS.values() if info.dialog is not None)
"""Ids of the export formats in dialog order; the export writes ``track`` and ``glb`` directly."""

TARGETS: Final = tuple(info.id for info in FORMATS.values() if info.is_written)
"""Ids of the formats that a file can be converted to."""


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
