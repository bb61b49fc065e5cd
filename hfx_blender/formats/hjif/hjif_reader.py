# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF reader for own and foreign files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...files.findings import Report, refuse_errors
from ...files.json_shapes import check, known_members
from ...files.strict_json import parse, read_bytes
from ..leniency import ToleratedFaults, as_fact, refuse_but
from .body_parts import described
from .foreign import in_standard_form
from .hjif_rules import DOCUMENT, findings

_STRUCTURAL = {f"HJIF-{word}" for word in ("MISSING", "TYPE", "RANGE", "CHOICE", "COUNT")}
_STRUCTURAL |= {"HJIF-MODALITY", "HJIF-VERSION"}
_FATAL = _STRUCTURAL - {"HJIF-RANGE"}  # amplitudes of early wavelets


def decode(content: bytes, name: str) -> tuple[dict[str, Any], ToleratedFaults]:
    """Parse a document, and return sentences about its tolerated faults.

    Files of other tools and drafts are converted to the standard's form as far as their meaning
    is clear; unknown members are dropped. Raises InputError for other files.
    """
    document = parse(content, name)
    faults = findings(document)
    if any(fault.code in _STRUCTURAL and fault.severity == "error" for fault in faults):
        document = in_standard_form(DOCUMENT, document)
        report = Report("HJIF")
        check(DOCUMENT, document, report)
        refuse_errors([finding for finding in report.findings if finding.code in _FATAL], name)
    notes = refuse_but(faults, name, lambda each: True)
    return known_members(DOCUMENT, document), notes


def facts(path: Path) -> dict[str, Any]:
    """Description, avatars and perceptions of a file for ``hfx info``."""
    document, notes = decode(read_bytes(path), str(path))
    return {
        **as_fact("notes", notes),
        "description": document["description"],
        "profile": f"{document['profile']}, level {document['level']}",
        "timescale": document.get("timescale"),
        "avatars": [avatar.get("mesh") or avatar["type"] for avatar in document["avatars"]],
        "perceptions": [
            {
                "perception": perception["description"] or str(perception["id"]),
                "modality": perception["perception_modality"],
                "library": len(perception["effect_library"]),
                "channels": [
                    {
                        "channel": channel["description"] or str(channel["id"]),
                        "where": described(channel.get("body_part_mask", 0)),
                        "vertices": len(channel.get("vertices", ())),
                        "effects": sum(len(band["effects"]) for band in channel["bands"]),
                    }
                    for channel in perception["channels"]
                ],
            }
            for perception in document["perceptions"]
        ],
    }
