# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults tolerated by readers, and their sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Sequence
from typing import Any, Final

from ..errors import InputError
from ..files.findings import Finding, refuse_errors
from ..files.json_shapes import shown

ToleratedFaults = tuple[str, ...]
"""Sentences about tolerated faults of a file."""

_HUGE: Final = 1e15


def refuse_untolerated(
    findings: list[Finding], name: str, tolerated: Callable[[Finding], bool], document: Any = None
) -> ToleratedFaults:
    """Raise InputError for the first error outside the tolerated kinds; describe all other faults.

    Warnings are always tolerated. Returns a sentence for each code of tolerated errors, then of
    warnings. With a ``document``, numbers beyond 1e15 in it are refused if there are errors.
    """
    errors = [finding for finding in findings if finding.severity == "error"]
    refuse_errors([error for error in errors if not tolerated(error)], name)
    # Tolerated range errors must not let absurd numbers through to readers without ranges.
    if errors and document is not None:
        _refuse_huge(document, name)
    warnings = [finding for finding in findings if finding.severity == "warning"]
    return _sentences(errors, "not valid but read: ") + _sentences(warnings, "")


def as_fact(key: str, sentences: Sequence[str]) -> dict[str, Any]:
    """Dict of ``key`` and a row ``{"": sentence}`` for each sentence; empty without sentences."""
    return {key: [{"": sentence} for sentence in sentences]} if sentences else {}


def _sentences(findings: list[Finding], begin: str) -> tuple[str, ...]:
    """A sentence for each code: the first finding and the number of further findings.

    ``begin`` is put in front.
    """
    counts = Counter(finding.code for finding in findings)
    firsts = {finding.code: finding for finding in reversed(findings)}
    return tuple(
        f"{begin}{first.place or 'the document'}: {first.message} [{code}]"
        + (f", and {counts[code] - 1} more of this kind" if counts[code] > 1 else "")
        for code, first in firsts.items()
    )


def without_nulls(document: Any, members: Container[str] | None = None) -> Any:
    """Copy of a document without null members at any depth, or only of names in ``members``."""
    if isinstance(document, dict):
        return {
            key: without_nulls(item, members)
            for key, item in document.items()
            if item is not None or (members is not None and key not in members)
        }
    return (
        [without_nulls(item, members) for item in document]
        if isinstance(document, list)
        else document
    )


def _refuse_huge(document: Any, name: str) -> None:
    """Raise InputError for a number beyond +-1e15 anywhere in a document."""
    waiting = [document]
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item
        elif isinstance(item, int | float) and not -_HUGE <= item <= _HUGE:
            raise InputError(f"{name}: {shown(item)} is out of any range, allowed is up to 1e15.")
