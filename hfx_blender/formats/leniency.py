# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults that a reader passes over, and tells of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Sequence
from typing import Any, Final

from ..errors import InputError
from ..files.findings import Finding, refuse_errors
from ..files.json_shapes import shown

ToleratedFaults = tuple[str, ...]
"""Sentences about a file that was read."""

_HUGE: Final = 1e15


def refuse_but(
    findings: list[Finding],
    name: str,
    tolerated: Callable[[Finding], bool],
    found: Any = None,
) -> ToleratedFaults:
    """Raise the first error that a reader does not tolerate; tell of the others, and of warnings.

    Parameters
    ----------
    found : optional
        The document, where its ranges are tolerated: numbers beyond all sense are not.

    Returns
    -------
    tuple of str
        A sentence for each code of an error that is tolerated, and of a warning.

    Raises
    ------
    InputError
        There is another error.
    """
    errors = [each for each in findings if each.severity == "error"]
    refuse_errors([each for each in errors if not tolerated(each)], name)
    if errors and found is not None:
        _refuse_huge(found, name)
    warnings = [each for each in findings if each.severity == "warning"]
    return _sentences(errors, "not valid but read: ") + _sentences(warnings, "")


def as_fact(key: str, sentences: Sequence[str]) -> dict[str, Any]:
    """Sentences about how a file was read as a fact of it, a line each, if there are any."""
    return {key: [{"": each} for each in sentences]} if sentences else {}


def _sentences(findings: list[Finding], begin: str) -> tuple[str, ...]:
    """A sentence for each code: its first place, and how many more there are."""
    counts = Counter(each.code for each in findings)
    firsts = {each.code: each for each in reversed(findings)}
    return tuple(
        f"{begin}{first.place or 'the document'}: {first.message} [{code}]"
        + (f", and {counts[code] - 1} more of this kind" if counts[code] > 1 else "")
        for code, first in firsts.items()
    )


def without_nulls(found: Any, members: Container[str] | None = None) -> Any:
    """A document without members that are null, or those of some names: tools write them so."""
    if isinstance(found, dict):
        return {
            key: without_nulls(item, members)
            for key, item in found.items()
            if item is not None or (members is not None and key not in members)
        }
    return [without_nulls(item, members) for item in found] if isinstance(found, list) else found


def _refuse_huge(found: Any, name: str) -> None:
    """Refuse a document with a number that no time or strength is, for readers without ranges.

    Raises
    ------
    InputError
    """
    waiting = [found]
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item
        elif isinstance(item, int | float) and not -_HUGE <= item <= _HUGE:
            raise InputError(f"{name}: {shown(item)} is out of any range, allowed is up to 1e15.")
