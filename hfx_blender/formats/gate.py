# SPDX-License-Identifier: GPL-3.0-or-later
"""Written files pass our own validation, or they do not get their names.

Conversions, of files of strangers, check whatever they wrote. Exports check what has rules of its
own on how many points, how long and how fast, which takes 1 % of their time; their tables, sound
and samples are made of numbers that were checked before. They do not read envelopes here: writers
of keyframes have done so for the error that their notes tell.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from .ahap import ahap
from .device_files import haptic, openxr
from .files import validate
from .he import he
from .hjif.perceptions import SUFFIX as HJIF_SUFFIX
from .tact import tact
from .written import Written

_WITH_RULES: Final = (
    ahap.SUFFIX,
    haptic.SUFFIX,
    he.SUFFIX,
    he.OPENHARMONY_SUFFIX,
    openxr.SUFFIX,
    tact.SUFFIX,
    HJIF_SUFFIX,
)


def fault_of(path: Path, *, reads: bool = True) -> str:
    """Reason that a file that was just written is not valid; empty: it is.

    Parameters
    ----------
    path : Path
    reads : bool
        See :func:`~hfx_blender.formats.files.validate`.

    Raises
    ------
    InputError
        It cannot be read, or is of no format of ours.
    """
    _, findings = validate(path, reads=reads)
    errors = [each for each in findings if each.severity == "error"]
    if not errors:
        return ""
    place = f"{errors[0].place}: " if errors[0].place else ""
    return f"{place}{errors[0].message} [{errors[0].code}]"


def valid_only(written: Written) -> Written:
    """An export's files without those that are not valid, which are removed and told."""
    files: list[Path] = []
    left_out: list[str] = []
    for path in written.files:
        fault = fault_of(path, reads=False) if path.name.endswith(_WITH_RULES) else ""
        if fault:
            path.unlink()
            left_out.append(f"{path.name} would not be valid, and is not written: {fault}")
        else:
            files.append(path)
    return replace(written, files=tuple(files), left_out=(*written.left_out, *left_out))
