# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and folders of the files of an export.

All names begin with ``folder/scene``. With several bodies, the output of devices is in folders by
body and device: ``folder/scene/Anna/insoles/scene.Anna.insoles.csv``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Final

from ..formats.written import name_part
from ..text import name_key

if TYPE_CHECKING:
    from ..engine.rendering.device_config import DeviceConfig
    from ..engine.rendering.raster import Raster
    from ..engine.track import TrackBody, TrackHeader


_LONGEST_PART: Final = 255
"""Largest length of a file or folder name on Linux, bytes; longer names are system errors."""

_DEVICE: Final = r"(?:con|prn|aux|nul|(?:com|lpt)[0-9\u00b9\u00b2\u00b3]) *(?:\.|$)"
_NO_FOLDER: Final = re.compile(rf"^[. ]|[. ]$|^(?={_DEVICE}).", re.IGNORECASE)
"""Characters that no folder's name has: dots and spaces at the ends ("..", Windows), and the first
letter of a device of Windows, such as CON or nul.txt."""

_LONGEST_NAME: Final = 1020
"""Largest length of a listed name with its folders, at most three, bytes."""


def scene_stem(scene: Path) -> str:
    """Stem of the results of a scene's file: the file's stem, in which backslash, colon and control
    characters are percent-encoded, as a report cannot list them (:func:`listed`)."""
    return re.sub(r"[\\:\x00-\x1f\x7f]", lambda found: f"%{ord(found[0]):02X}", scene.stem)


def distinct(names: Iterable[str]) -> list[str]:
    """Unique parts of file names for names, in the same order, for any file system. Unique without
    regard to case and to the encoding of accents; repeated names get a number."""
    taken: set[str] = set()
    parts = []
    for name in names:
        part, number = name_part(name), 1
        while name_key(part) in taken:
            number += 1
            part = name_part(f"{name} {number}")
        taken.add(name_key(part))
        parts.append(part)
    return parts


def body_parts(bodies: Sequence[TrackBody]) -> dict[str, str]:
    """Name part of the files of each body, by body id, from the body's name, else its id; empty for
    a single body."""
    if len(bodies) < 2:
        return dict.fromkeys((body.id for body in bodies), "")
    parts = distinct(body.name or body.id for body in bodies)
    parts = [_NO_FOLDER.sub(lambda end: f"%{ord(end[0]):02X}", part) for part in parts]
    return {body.id: part for body, part in zip(bodies, parts, strict=True)}


def device_stem(scene: Path, stem: Path, body: str, device_id: str) -> Path:
    """Path stem of the files of a device on a body, a value of :func:`body_parts`:
    ``scene/body/device/stem.body.device``, or ``stem.device`` for body "". ``scene`` is
    ``folder/scene``; ``stem`` is equal, or ``folder/scene.clip`` for a clip."""
    if not body:
        return stem.with_name(f"{stem.name}.{device_id}")
    return scene / body / device_id / f"{stem.name}.{body}.{device_id}"


def placed(
    whole: TrackHeader, played: Sequence[tuple[DeviceConfig, Raster]], scene: Path, stem: Path
) -> list[tuple[Path, DeviceConfig, Raster]]:
    """Pair devices and rasters with the path stems of their files (:func:`device_stem`), and make
    their folders: ``scene/body/device`` if ``whole`` has two or more bodies. ``scene`` is the stem
    of the whole scene; ``stem`` is equal, or that of one clip."""
    parts = body_parts(whole.bodies)
    entries = []
    for device, raster in played:
        path = device_stem(scene, stem, parts[raster.body_id], device.id)
        path.parent.mkdir(parents=True, exist_ok=True)
        entries.append((path, device, raster))
    return entries


def listed(folder: Path, name: object) -> Path | None:
    """Path of a file listed in a report by its name relative to ``folder``. None for a name outside
    the folder, or a name too long for a file system."""
    # Reports may be edited: a name must not lead out of the folder. Backslash and colon are
    # separators on Windows only.
    if not isinstance(name, str) or re.search(r"[\\\x00-\x1f]", name):
        return None
    path = PurePosixPath(name)
    lengths = [len(part.encode("utf-8", "replace")) for part in path.parts]
    if max(lengths, default=0) > _LONGEST_PART or sum(lengths) > _LONGEST_NAME:
        return None
    is_plain = path.parts and not path.is_absolute() and ".." not in path.parts
    return folder / path if is_plain and str(path) == name and ":" not in path.parts[0] else None
