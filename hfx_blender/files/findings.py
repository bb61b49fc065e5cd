# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation findings: faults of a file with place, message and a stable code.

Readers tolerate some findings, and describe these as sentences.
"""

from collections import Counter
from collections.abc import Callable, Container
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from ..errors import InputError
from .strict_json import Place, parse, shown, shown_place

MAX_FINDINGS: Final = 1000

Severity = Literal["error", "warning"]
ToleratedFaults = tuple[str, ...]  # sentences about tolerated faults of a file
_HUGE: Final = 1e15


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
    """Collector of findings about a file, at most about ``MAX_FINDINGS``. The first finding of each
    code and severity is always stored, so that an error is not lost behind a thousand warnings."""

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
        # Beyond the limit only the first of each kind is stored: a damaged file may have millions.
        self.count += 1
        if len(self.findings) < MAX_FINDINGS or (code, severity) not in self._kinds:
            self._kinds.add((code, severity))
            full_code = f"{self.prefix}-{code}"
            self.findings.append(Finding(full_code, shown_place(place), message, severity))


def json_validator(
    findings: Callable[[Any], list[Finding]], read: Callable[[bytes, str], Any] = parse
) -> Callable[[bytes, str], list[Finding]]:
    """Make a validator of file content from a validator of parsed documents. The validator raises
    InputError for content that is no JSON."""
    return lambda content, name: findings(read(content, name))


def refuse_errors(findings: list[Finding], name: str) -> None:
    """Raise InputError for the first error, with the number of further errors; ignore warnings."""
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        count = len(errors) - 1
        more = f" (and {count} more {'fault' if count == 1 else 'faults'})" if count else ""
        raise InputError(f"{name}: {sentence(errors[0])} [{errors[0].code}]{more}.")


def sentence(finding: Finding) -> str:
    """Place and message of a finding: ``side is "up", allowed is ...``."""
    if finding.message.startswith("is "):
        return f"{finding.place or 'the document'} {finding.message}"
    return f"{finding.place}: {finding.message}" if finding.place else finding.message


def refuse_untolerated(
    findings: list[Finding], name: str, tolerated: Callable[[Finding], bool], document: Any = None
) -> ToleratedFaults:
    """Raise InputError for the first error outside the tolerated kinds; describe all other faults.
    Warnings are always tolerated. Returns a sentence for each code of tolerated errors, then of
    warnings. With a ``document``, numbers beyond 1e15 in it are refused if there are errors."""
    errors = [finding for finding in findings if finding.severity == "error"]
    refuse_errors([error for error in errors if not tolerated(error)], name)
    # Tolerated range errors must not let absurd numbers through to readers without ranges.
    waiting = [document] if errors else []
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item
        elif isinstance(item, int | float) and not -_HUGE <= item <= _HUGE:
            raise InputError(f"{name}: {shown(item)} is out of any range, allowed is up to 1e15.")
    warnings = [finding for finding in findings if finding.severity == "warning"]
    return _sentences(errors, "not valid but read: ") + _sentences(warnings, "")


def _sentences(findings: list[Finding], begin: str) -> tuple[str, ...]:
    """A sentence for each code: the first finding and the number of further findings. ``begin`` is
    put in front."""
    counts = Counter(finding.code for finding in findings)
    # Reversed, so that the first finding of a code is the last to be stored.
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
