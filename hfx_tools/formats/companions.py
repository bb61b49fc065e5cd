# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules between a file and its name, or other files: kind of content, meshes, sound of a list."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from hfx_blender.errors import InputError
from hfx_blender.files.findings import Finding, Report
from hfx_blender.files.strict_json import Place, mapped, parse, read_bytes, read_data
from hfx_blender.formats.device_files import he_rules
from hfx_blender.formats.glb import glb
from hfx_blender.formats.registry import FORMATS, FormatInfo
from hfx_blender.formats.sound import wav

from . import wav_rules
from .hmpg.hmpg_files import document_at

_HE_NAMES: Final = {"he1": ("he1",), "he": ("he1", "he"), "openharmony": ("openharmony",)}
"""Kinds of patterns that players of files with a suffix read, by the format of the suffix."""


def findings_of(info: FormatInfo, path: Path) -> list[Finding]:
    """Findings on a file of the format ``info``, valid by itself, that its content alone does not
    show; empty for formats without such rules."""
    report = Report("HE" if info.id in _HE_NAMES else info.id.upper())
    rules: dict[str, Callable[[Path, Report], None]] = {
        "hjif": _check_meshes,
        "hmpg": _check_meshes,
        "wav": _check_channels,
        "channels": _check_sound,
        "he": _check_pattern,
        "openharmony": _check_pattern,
        "glb": _check_media,
    }
    if info.marks:
        _check_name(info, path, report)
    if info.id in rules and not report.has_errors:
        rules[info.id](path, report)
    return report.findings


def _named(path: Path) -> FormatInfo | None:
    """Format whose suffix ends a file's name, the longest of several; None for another name."""
    names = [info for info in FORMATS.values() if path.name.lower().endswith(info.suffix)]
    return max(names, key=lambda info: len(info.suffix), default=None)


def _check_name(info: FormatInfo, path: Path, report: Report) -> None:
    """Report content of the format ``info`` under the name of another format with marks."""
    named = _named(path)
    if named is not None and named.marks and named.id != info.id:
        _tell_name(info.id, named, report)


def _tell_name(id: str, named: FormatInfo, report: Report) -> None:
    """Report content of the format ``id`` under a name of the format ``named``."""
    message = f"the content is {FORMATS[id].title}, allowed in a *{named.suffix} is {named.title}"
    report.error("NAME", None, message)


def _check_pattern(path: Path, report: Report) -> None:
    """Report a pattern of another kind than the name says, and OpenHarmony's limit of bytes, which
    counts spaces too."""
    content = read_data(path)
    document = parse(content, str(path))
    kind, named = _kind_of_pattern(document), _named(path)
    if named is not None and kind not in _HE_NAMES.get(named.id, (kind,)):
        _tell_name(kind, named, report)
    most = he_rules.OPENHARMONY_MAX_BYTES
    if kind == "openharmony" and len(content) > most:
        report.error("BYTES", None, f"is {len(content)} bytes, allowed are up to {most}")


def _kind_of_pattern(document: dict[str, Any]) -> str:
    """Id of the format of a valid pattern: ``openharmony``, ``he1`` or ``he``."""
    if "Channels" in document:
        return "openharmony"
    return "he1" if "Pattern" in document else "he"


def meshes_of(path: Path) -> list[Path]:
    """Meshes of the avatars of a HJIF or HMPG file that are in its own folder."""
    document, _ = document_at(path)
    meshes = [_beside(path, avatar.get("mesh", "")) for avatar in document["avatars"]]
    found = [mesh for mesh in meshes if mesh is not None and mesh.parent == path.parent]
    return [mesh for mesh in dict.fromkeys(found) if mesh.is_file()]


def _check_meshes(path: Path, report: Report) -> None:
    """Report meshes of avatars that are not there, which warn only where no channel needs them, and
    vertices of channels outside of the mesh."""
    document, _ = document_at(path)
    counts: dict[int, tuple[str, int]] = {}  # name of the mesh and number of vertices, by avatar
    missing: dict[int, tuple[Place, str]] = {}
    for k, avatar in enumerate(document["avatars"]):
        here: Place = (((None, "avatars"), k), "mesh")
        mesh = _beside(path, avatar.get("mesh", ""))
        if mesh is None:
            continue
        if not mesh.is_file():
            message = f"is '{avatar['mesh'][:60]}', allowed is the name of a file that is there"
            missing[avatar["id"]] = (here, message)
        elif mesh.suffix.lower() == glb.SUFFIX:
            try:
                counts[avatar["id"]] = (mesh.name, _vertex_count(mesh))
            except InputError as error:
                fault = str(error).removeprefix(f"{mesh}: ").rstrip(".")
                message = f"is '{mesh.name}', allowed is a valid glTF binary: {fault}"
                report.error("MESH", here, message)
    needed = set()
    for p, perception in enumerate(document["perceptions"]):
        avatar_id = perception["avatar_id"]
        name, count = counts.get(avatar_id, ("", 0))
        allowed = f"0 to {count - 1}, the vertices of '{name}'" if name else "0 or more"
        for c, channel in enumerate(perception["channels"]):
            vertices = channel.get("vertices", [])
            if vertices:
                needed.add(avatar_id)
            bad = (k for k, v in enumerate(vertices) if v < 0 or (name and v >= count))
            for k in list(bad)[:1]:
                at = (((((None, "perceptions"), p), "channels"), c), "vertices")
                report.error("VERTEX", (at, k), f"is {vertices[k]}, allowed is {allowed}")
    for avatar_id, (here, message) in missing.items():
        tell = report.error if avatar_id in needed else report.warn
        tell("MESH", here, message)


def _check_media(path: Path, report: Report) -> None:
    """Warn of files of the extension MPEG_media that are not there."""
    document = glb.read_json(read_data(path), str(path))
    try:
        media = document["extensions"]["MPEG_media"]["media"]
        uris = [each["uri"] for medium in media for each in medium["alternatives"]]
    except (KeyError, TypeError):  # none, or of another form
        return
    for uri in dict.fromkeys(uri for uri in uris if isinstance(uri, str)):
        file = _beside(path, uri)
        if file is not None and not file.is_file():
            message = f"names the file '{uri[:60]}', which is not there"
            report.warn("MEDIA", ((None, "extensions"), "MPEG_media"), message)


def _beside(path: Path, uri: str) -> Path | None:
    """File of a relative URI in a file's folder or below; None for an empty or other URI."""
    try:
        parts = urlsplit(uri)
    except ValueError:
        return None
    name = unquote(parts.path)
    is_relative = not (parts.scheme or parts.netloc) and not name.startswith(("/", "\\"))
    return path.parent / name if name and is_relative and "\0" not in name else None


def _vertex_count(mesh: Path) -> int:
    """Number of vertices of all meshes of a GLB file together; InputError for a file with
    errors."""
    document = glb.read_json(read_data(mesh), str(mesh))
    try:
        primitives = [each for item in document["meshes"] for each in item["primitives"]]
        places = dict.fromkeys(each["attributes"]["POSITION"] for each in primitives)
        return sum(document["accessors"][place]["count"] for place in places)
    except (KeyError, IndexError, TypeError):
        raise InputError(f"{mesh}: has a mesh without positions.") from None


def _check_channels(path: Path, report: Report) -> None:
    """Report a channel list beside a WAV that does not fit; no finding without a list."""
    beside = path.with_name(path.name + wav.SIDECAR_SUFFIX)
    if beside.is_file():
        _compare(path, beside, report)


def _check_sound(path: Path, report: Report) -> None:
    """Report a sound beside a channel list that does not fit; a warning without a sound."""
    sound = path.with_name(path.name[: -len(wav.SIDECAR_SUFFIX)])
    if sound.is_file():
        _compare(sound, path, report)
    else:
        report.warn("SOUND", None, f"is of the sound '{sound.name}', which is not there")


def _compare(sound: Path, beside: Path, report: Report) -> None:
    """Report a WAV and its channel list with other numbers of channels or another rate. Faults of
    either file are no findings here."""
    form, _ = wav_rules.inspect(mapped(sound))
    try:
        if form is None or wav_rules.validate_channels(read_bytes(beside), str(beside)):
            return
        document = parse(read_bytes(beside), str(beside))
    except InputError:
        return
    pairs = (
        ("channels", form.channels, len(document["channels"])),
        ("rate_hz", form.rate_hz, document["rate_hz"]),
    )
    for key, found, listed in pairs:
        if found != listed:
            message = f"'{sound.name}' has {found}, '{beside.name}' says {listed}"
            report.error("LIST", (None, key), message)
