# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of this program's own files: suffixes, and markers in the content of JSON documents.

The suffixes are here for the user interface, which does not import the formats.
"""

import json
from pathlib import Path
from typing import Any, Final

from ..errors import InputError, refuse_no_file

EFFECT_SUFFIX: Final = ".hfxeffect"
PATH_SUFFIX: Final = ".hfxpath"
REPORT_SUFFIX: Final = ".report.json"
OWN_KINDS: Final = {
    REPORT_SUFFIX: "report of an export",
    EFFECT_SUFFIX: "effects",
    PATH_SUFFIX: "path on the skin",
}
"""Titles of files that are no format of an export or conversion, by suffix."""

TEXTURE_MAP_SUFFIX: Final = ".texture.json"
GENERATED_SUFFIX: Final = ".generated.json"
STROKE_SUFFIXES: Final = (".wav", ".ahap", ".he", ".haptic", ".csv")
PICTURE_SUFFIXES: Final = (".exr", ".jpeg", ".jpg", ".png", ".tif", ".tiff")  # of heights

_MARKS: Final = ("format", "schema")

_TITLES: Final = {
    "hfx-device": "a device configuration",
    "hfx-effects": "a file of effects (.hfxeffect)",
    "hfx-generated-texture": "the record of a generated surface (.generated.json)",
    "hfx-openxr-parametric": "OpenXR vibration (.openxr.json)",
    "hfx-path": "a path (.hfxpath)",
    "hfx-sound-channels": "the channels of a sound (.channels.json)",
    "hfx-texture-map": "a texture map (.texture.json)",
    "hfx-wav-channels": "the channels of a WAV (.channels.json)",
    "hfx bone mapping": "a table of bones",
    "report": "the report of an export (.report.json)",
}
_MOST_BYTES: Final = 64 << 20


def refuse_another(document: Any, file: str, own: str) -> None:
    """Raise InputError for a document with the marker of another kind than ``own``. Documents
    without a known marker pass. ``file`` is the name for the message."""
    mark = _mark_of(document)
    if mark not in ("", own):
        raise InputError(f"{file}: is {_TITLES[mark]}, expected {_TITLES[own]}.")


def title_of(path: Path) -> str:
    """Describe a file with an article: by its suffix, JSON by its marker ("JSON of another program
    or kind" without one). An unreadable JSON file is described as such; never raises."""
    suffix = f"a {path.suffix} file" if path.suffix else "a file without a suffix"
    try:
        if path.suffix.lower() != ".json" or path.stat().st_size > _MOST_BYTES:
            return suffix
        refuse_no_file(path)
        mark = _mark_of(json.loads(path.read_bytes()))
    except (OSError, ValueError, RecursionError, InputError):
        return f"{suffix} that cannot be read"
    return _TITLES[mark] if mark else "JSON of another program or kind"


def _mark_of(value: Any) -> str:
    """Marker of a document of any type, a key of ``_TITLES``; empty for documents without one."""
    if not isinstance(value, dict):
        return ""
    marks = (value.get(key) for key in _MARKS)
    known = next((mark for mark in marks if isinstance(mark, str) and mark in _TITLES), "")
    return known or ("report" if {"scene", "files"} <= set(value) else "")
