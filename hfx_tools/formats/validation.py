# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation of files of any registered format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hfx_blender.errors import InputError, refuse_no_file
from hfx_blender.files.findings import Finding
from hfx_blender.files.strict_json import read_data
from hfx_blender.formats.files import decoded, failure, findings_of, first_error, format_of
from hfx_blender.formats.registry import FORMATS, FormatInfo

from . import companions


def validate(path: Path, *, is_alone: bool = False) -> tuple[FormatInfo, list[Finding]]:
    """Return the format and the findings of a file, in file order; none: valid.

    A file beyond parsing has a single finding: ``<FORMAT>-LARGE`` beyond a limit of size,
    ``-CONTENT`` in a format without a check of its own (its reader's error), else ``-UNREADABLE``.
    Envelopes of a file without errors are decoded too, to find a file beyond the reader's limits.
    Unless ``is_alone``, its name and the files that it belongs to are compared with its content.
    Raises InputError if the path is missing, unreadable or of an unknown format.
    """
    refuse_no_file(path)
    # Formats with ``read`` are large files, or files with companions.
    for info in FORMATS.values():
        if info.read and path.name.lower().endswith(info.suffix):
            try:
                return info, info.function("read")(path)
            except InputError as error:
                code = f"{info.id.upper()}-CONTENT"
                return info, [replace(failure(info, error, path), code=code)]
    info = format_of(path)
    findings = findings_of(info, path)
    if info.decode and not any(finding.severity == "error" for finding in findings):
        content = read_data(path)
        try:
            decoded(info, content, str(path))
        except InputError as error:
            return info, [failure(info, error, path)]
    if not is_alone and not any(finding.severity == "error" for finding in findings):
        findings = [*findings, *companions.findings_of(info, path)]
    return info, findings


def fault_of(path: Path) -> str:
    """First error in the content of a file as "place: message [code]"; empty for valid content.
    Raises InputError for an unreadable or unknown file."""
    return first_error(validate(path, is_alone=True)[1])
