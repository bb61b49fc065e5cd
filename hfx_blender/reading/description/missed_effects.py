# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings about effects that are not felt; imported before Blender starts."""

from collections.abc import Iterable, Mapping
from typing import Final

from ...text import MOST_NAMES, named

NO_TOUCH: Final = "touches no body"
NEVER_ON: Final = "is never on"


def missed_warnings(missed: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Warnings about unfelt effects, from (name, reason); one warning for each reason."""
    reasons: dict[str, list[str]] = {}
    for name, why in missed:
        reasons.setdefault(why, []).append(name)
    return tuple(
        f"effect '{names[0]}' {why}: it is not felt"
        if len(names) == 1
        else f"effects are not felt, as each {why}: {len(names)} ({named(names, MOST_NAMES)})"
        for why, names in reasons.items()
    )


def flattened_warning(counts: Mapping[str, int]) -> tuple[str, ...]:
    """Warning about volumes flattened at samples, from numbers of samples by effect name; empty for
    none."""
    names = [*counts]
    if not names:
        return ()
    times = sum(counts.values())
    if len(names) == 1:
        return (
            f"effect '{names[0]}' is flattened, infinite or not a number: it is not felt "
            f"({times} times)",
        )
    return (
        f"each of {len(names)} effects is flattened, infinite or not a number: it is not felt "
        f"({times} times): {named(names, MOST_NAMES)}",
    )
