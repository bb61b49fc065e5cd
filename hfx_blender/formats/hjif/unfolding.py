# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects of HJIF with their references and compositions followed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from ...errors import InputError
from ...files import limits
from .document import Effect

_DEEPEST: Final = 8


class Unfolding:
    """Expansion of a file's effects with all references, counted."""

    def __init__(self, name: str) -> None:
        self.library: dict[int | None, Effect] = {}
        self.name = name
        self._count = self._unknown = 0

    def take_unknown(self) -> dict[str, int]:
        """Count of references to no effect since the last call, by the reason."""
        count, self._unknown = self._unknown, 0
        return {"are references to none of the library": count} if count else {}

    def effects(
        self, effects: tuple[Effect, ...], start: int, depth: int
    ) -> Iterator[tuple[int, Effect]]:
        """Basis effects and their positions, ticks."""
        if depth > _DEEPEST:
            raise InputError(
                f"{self.name}: effects refer to each other more than {_DEEPEST} levels deep."
            )
        for effect in effects:
            self._count += 1 + len(effect.keyframes or ())
            limits.UNFOLDED.check(self._count, self.name, "its references unfold to")
            position = start + (effect.position or 0)
            if effect.effect_type == "Reference":
                target = self.library.get(effect.id)
                if target is None:
                    self._unknown += 1
                else:
                    yield from self.effects((target,), position, depth + 1)
            elif effect.effect_type == "Composite":
                yield from self.effects(effect.composition or (), position, depth + 1)
            else:
                yield position, effect
