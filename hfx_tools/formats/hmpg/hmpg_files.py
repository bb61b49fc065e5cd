# SPDX-License-Identifier: GPL-3.0-or-later
"""HMPG files of tracks, rasters, vibration signals and HJIF documents; check and signals of files.

The writers compose a HJIF document as for ``.hjif`` files, and encode it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.track import TrackReader
from hfx_blender.files.atomic import atomic_file
from hfx_blender.files.findings import Finding
from hfx_blender.files.strict_json import encoded as as_json
from hfx_blender.files.strict_json import read_bytes
from hfx_blender.formats.glb import glb
from hfx_blender.formats.hjif import from_track, hjif_reader, hjif_rules
from hfx_blender.formats.registry import FORMATS
from hfx_blender.formats.signals.signals import FrequencyRange, Signal
from hfx_blender.formats.written import Written, write_json

from .. import hjif_from_actuators, hjif_signals
from .hmpg_reader import decode, document_of, with_own_codes
from .hmpg_writer import encoded

SUFFIX = FORMATS["hmpg"].suffix


def validate(content: bytes, name: str) -> list[Finding]:
    """Findings of a stream: those of its HJIF document with codes ``HMPG-``, and a warning
    ``HMPG-UNREAD`` for each kind of content that was not read. InputError for a damaged stream."""
    document, notes = document_of(content, name)
    findings = [Finding("HMPG-UNREAD", "", note, "warning") for note in notes]
    for finding in hjif_rules.findings(document):
        code = finding.code.replace("HJIF-", "HMPG-", 1)
        findings.append(replace(finding, code=code))
    channels = Counter(
        channel.get("id") for item in document["perceptions"] for channel in item["channels"]
    )
    for id, count in channels.items():
        if count > 1:
            message = f"{count} channels have the id {id}: MPEG's reader takes them for one"
            findings.append(Finding("HMPG-CHANNEL-ID", "", message, "warning"))
    return findings


def document_at(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read the HJIF document of a ``.hmpg`` or ``.hjif`` file, and sentences about content that was
    not read; InputError for a damaged file."""
    read = decode if path.name.lower().endswith(SUFFIX) else hjif_reader.decode
    return read(read_bytes(path), str(path))


def signals_at(path: Path) -> tuple[list[Signal], FrequencyRange]:
    """Vibration signals of a ``.hmpg`` file, as of a HJIF file; notes are on the first signal."""
    document, notes = document_at(path)
    signals, frequencies = hjif_signals.decode(as_json(document), str(path))
    if signals:
        # The document is read twice: a note of both readings is stated once.
        unique = dict.fromkeys((*notes, *with_own_codes(signals[0].notes)))
        signals[0] = replace(signals[0], notes=tuple(unique))
    return signals, frequencies


def converted(source: Path, stem: Path, suffix: str) -> Written:
    """Write the document of a HJIF or HMPG file in the other form, as ``stem`` + ``suffix``. Raises
    InputError for a source that cannot be read, or content that HMPG cannot hold."""
    document, notes = document_at(source)
    if suffix == SUFFIX:
        return _write(document, stem, str(source)) + Written(notes=notes)
    path = stem.with_name(stem.name + suffix)
    write_json(document, path)
    return Written((path,), notes=notes)


def write_track(
    track: TrackReader, devices: Sequence[DeviceConfig], stem: Path, tolerance: float
) -> Written:
    """Write ``stem.hmpg``, and each body model as ``stem.<model>.glb``; raises as
    :func:`from_track.write`."""
    document, meshes, loss = from_track.compose(track, devices, stem.name, tolerance)
    written = _write(document, stem, str(track.path))
    uri, files = quote(stem.name + SUFFIX), list(written.files)
    for model in meshes:
        files.append(stem.with_name(f"{stem.name}.{model.id}{glb.SUFFIX}"))
        glb.write_model(model, files[-1], uri)
    return replace(written, files=tuple(files)) + loss


def write_raster(raster: Raster, device: DeviceConfig, stem: Path, tolerance: float) -> Written:
    """Write ``stem.hmpg`` of a device's output; raises as :func:`hjif_from_actuators.write`."""
    with TemporaryDirectory(prefix="hfx-") as folder:
        written = hjif_from_actuators.write(raster, device, Path(folder) / stem.name, tolerance)
        return _through(written, stem)


def write_signals(
    signals: Sequence[Signal], frequencies: FrequencyRange, stem: Path, tolerance: float
) -> Written:
    """Write ``stem.hmpg`` of vibration; raises as :func:`hjif_from_actuators.write_signals`."""
    with TemporaryDirectory(prefix="hfx-") as folder:
        inner = Path(folder) / stem.name
        written = hjif_from_actuators.write_signals(signals, frequencies, inner, tolerance)
        return _through(written, stem)


def _through(written: Written, stem: Path) -> Written:
    """Encode the HJIF file of a writer; its losses and notes stay."""
    document, _ = document_at(written.files[0])
    return _write(document, stem, stem.name) + replace(written, files=())


def _write(document: Mapping[str, Any], stem: Path, name: str) -> Written:
    """Encode a document as ``stem.hmpg``; ``name`` begins messages."""
    made = encoded(document, name)
    path = stem.with_name(stem.name + SUFFIX)
    with atomic_file(path) as file:
        file.write(made.content)
    return Written((path,), made.left_out, made.notes)
