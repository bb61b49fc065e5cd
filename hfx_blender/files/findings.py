# SPDX-License-Identifier: GPL-3.0-or-later
"""Findings about files of strangers: faults with their place, and stable codes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from ..errors import InputError
from .strict_json import Place, parse, shown_place

MAX_FINDINGS: Final = 1000

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """Fault of a file."""

    code: str
    place: str
    message: str
    severity: Severity = "error"

    def __str__(self) -> str:
        return f"{self.severity} {self.code} {self.place or 'the document'}: {self.message}"


@dataclass
class Report:
    """Findings about one file, about ``MAX_FINDINGS`` at most.

    The first one of each kind is always kept: a fault is not to hide behind a thousand others
    that a reader copes with.
    """

    prefix: str
    findings: list[Finding] = field(default_factory=list)
    has_errors: bool = False
    count: int = 0  # of all findings, kept or not
    _kinds: set[tuple[str, Severity]] = field(default_factory=set)

    def error(self, code: str, place: Place, message: str) -> None:
        """Report an error."""
        self._add(code, place, message, "error")
        self.has_errors = True

    def warn(self, code: str, place: Place, message: str) -> None:
        """Report something unusual, with which readers cope."""
        self._add(code, place, message, "warning")

    def _add(self, code: str, place: Place, message: str, severity: Severity) -> None:
        self.count += 1
        if len(self.findings) < MAX_FINDINGS or (code, severity) not in self._kinds:
            self._kinds.add((code, severity))
            full_code = f"{self.prefix}-{code}"
            self.findings.append(Finding(full_code, shown_place(place), message, severity))


def decoding_findings(
    format_name: str, decode: Callable[[bytes, str], object], content: bytes, name: str
) -> list[Finding]:
    """Faults of a file whose decoding reveals all of them."""
    report = Report(format_name)
    try:
        decode(content, name)
    except InputError as error:
        report.error("CONTENT", None, str(error).removeprefix(f"{name}: ").rstrip("."))
    return report.findings


def json_validator(
    findings: Callable[[Any], list[Finding]], read: Callable[[bytes, str], Any] = parse
) -> Callable[[bytes, str], list[Finding]]:
    """Function of the faults of a file, given that of the faults of a parsed document.

    It raises ``InputError`` for a file that is no JSON document.
    """
    return lambda content, name: findings(read(content, name))


def refuse_errors(findings: list[Finding], name: str) -> None:
    """Raise the first error among findings.

    Raises
    ------
    InputError
        There is one; how many more there are is told.
    """
    errors = [each for each in findings if each.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more faults)" if len(errors) > 1 else ""
        raise InputError(f"{name}: {sentence(errors[0])} [{errors[0].code}]{more}.")


def sentence(finding: Finding) -> str:
    """Place and message: ``side is "up", allowed is ...``, ``the document: 'id' is missing``."""
    if finding.message.startswith("is "):
        return f"{finding.place or 'the document'} {finding.message}"
    return f"{finding.place}: {finding.message}" if finding.place else finding.message
