# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads HJIF, our own files and those of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...files.findings import Report, refuse_errors
from ...files.json_shapes import check, known_members
from ...files.strict_json import parse, read_bytes
from ..leniency import ToleratedFaults, as_fact, refuse_but
from .body_parts import described
from .foreign import in_standard_form
from .rules import DOCUMENT, findings

_STRUCTURAL = {f"HJIF-{word}" for word in ("MISSING", "TYPE", "RANGE", "CHOICE", "COUNT")}
_STRUCTURAL |= {"HJIF-MODALITY", "HJIF-VERSION"}
_FATAL = _STRUCTURAL - {"HJIF-RANGE"}  # amplitudes of early wavelets


def decode(content: bytes, name: str) -> tuple[dict[str, Any], ToleratedFaults]:
    """A file's content, and what about it is not valid but was read.

    Files of other tools and of versions before the standard are taken, as far as their meaning
    is clear; unknown members are left out.

    Raises
    ------
    InputError
        It cannot be read.
    """
    found = parse(content, name)
    faults = findings(found)
    if any(each.code in _STRUCTURAL and each.severity == "error" for each in faults):
        found = in_standard_form(DOCUMENT, found)
        report = Report("HJIF")
        check(DOCUMENT, found, report)
        refuse_errors([each for each in report.findings if each.code in _FATAL], name)
    notes = refuse_but(faults, name, lambda each: True)
    document: dict[str, Any] = known_members(DOCUMENT, found)
    return document, notes


def facts(path: Path) -> dict[str, Any]:
    """Short description of a file."""
    document, notes = decode(read_bytes(path), str(path))
    return {
        **as_fact("notes", notes),
        "description": document["description"],
        "profile": f"{document['profile']}, level {document['level']}",
        "timescale": document.get("timescale"),
        "avatars": [each.get("mesh") or each["type"] for each in document["avatars"]],
        "perceptions": [
            {
                "perception": each["description"] or str(each["id"]),
                "modality": each["perception_modality"],
                "library": len(each["effect_library"]),
                "channels": [
                    {
                        "channel": channel["description"] or str(channel["id"]),
                        "where": described(channel.get("body_part_mask", 0)),
                        "vertices": len(channel.get("vertices", ())),
                        "effects": sum(len(band["effects"]) for band in channel["bands"]),
                    }
                    for channel in each["channels"]
                ],
            }
            for each in document["perceptions"]
        ],
    }
