# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation findings: faults of a file with place, message and a stable code."""

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
    """Collector of findings about a file, at most about ``MAX_FINDINGS``.

    The first finding of each code and severity is always stored, so that an error is not lost
    behind a thousand warnings.
    """

    prefix: str
    findings: list[Finding] = field(default_factory=list)
    has_errors: bool = False
    count: int = 0  # of all findings, stored or not
    _kinds: set[tuple[str, Severity]] = field(default_factory=set)

    def error(self, code: str, place: Place, message: str) -> None:
        """Report an error."""
        self._add(code, place, message, "error")
        self.has_errors = True

    def warn(self, code: str, place: Place, message: str) -> None:
        """Report an unusual value that readers accept."""
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
    """Decode a file; the decoding error is its only finding, without an error the list is empty."""
    report = Report(format_name)
    try:
        decode(content, name)
    except InputError as error:
        report.error("CONTENT", None, str(error).removeprefix(f"{name}: ").rstrip("."))
    return report.findings


def json_validator(
    findings: Callable[[Any], list[Finding]], read: Callable[[bytes, str], Any] = parse
) -> Callable[[bytes, str], list[Finding]]:
    """Make a validator of file content from a validator of parsed documents.

    The validator raises InputError for content that is no JSON.
    """
    return lambda content, name: findings(read(content, name))


def refuse_errors(findings: list[Finding], name: str) -> None:
    """Raise InputError for the first error, with the number of further errors; ignore warnings."""
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more faults)" if len(errors) > 1 else ""
        raise InputError(f"{name}: {sentence(errors[0])} [{errors[0].code}]{more}.")


def sentence(finding: Finding) -> str:
    """Place and message of a finding: ``side is "up", allowed is ...``."""
    if finding.message.startswith("is "):
        return f"{finding.place or 'the document'} {finding.message}"
    return f"{finding.place}: {finding.message}" if finding.place else finding.message
