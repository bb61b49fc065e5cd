# SPDX-License-Identifier: GPL-3.0-or-later
"""Drivers that cannot be evaluated at a time: found, and evaluated again at the next time.

Blender marks a driver as invalid at its first failure, and skips it from then on: what it drives
would be lost at all later times, and at earlier ones if a late time is read first.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Final

import bpy

_STDERR: Final = 2

LOOKS: Final = (bpy.types.Material, bpy.types.ShaderNodeTree)
"""Data that changes no place and no shape."""


def drivers_of(
    reached: Iterable[bpy.types.ID],
) -> Iterator[tuple[bpy.types.ID, bpy.types.FCurve]]:
    """Drivers that may move or shape something, and the data that they belong to."""
    for owner in reached:
        data = getattr(owner, "animation_data", None)
        if data is not None and not isinstance(owner, LOOKS):
            yield from ((owner, curve) for curve in data.drivers)


class RetriedDrivers:
    """Drivers of some data, each of which is evaluated at every time, whatever failed before.

    Parameters
    ----------
    reached : iterable of bpy.types.ID
        Original data; its drivers that are muted, or that drive nothing, are left out.
    tags : bool
        Also evaluate failed drivers again where nothing that they depend on has changed. Not with
        a simulation, whose cache that would empty.
    """

    def __init__(self, reached: Iterable[bpy.types.ID], *, tags: bool) -> None:
        self._curves = [
            (owner, curve)
            for owner, curve in drivers_of(reached)
            if not curve.mute and _drives(owner, curve)
        ]
        # Their results that are no numbers are told on the standard error stream only.
        self._scripted = [
            (owner, curve)
            for owner, curve in self._curves
            if curve.driver.type == "SCRIPTED" and not curve.driver.is_simple_expression
        ]
        self._tags = tags
        self._messages: IO[bytes] | None = tempfile.TemporaryFile() if self._scripted else None
        self.failures: tuple[str, ...] = ()
        """Drivers that failed at the last time, as sentences."""

    def evaluate(self, work: Callable[[], object]) -> None:
        """Call ``work``, in which Blender evaluates the drivers, and note those that failed."""
        if not self._curves:
            work()
            return
        for owner, curve in self._curves:
            if not curve.driver.is_valid:
                curve.driver.is_valid = True
                if self._tags:
                    owner.update_tag()
        with _errors_to(self._messages):
            work()
        failed = [pair for pair in self._curves if not pair[1].driver.is_valid]
        failed += self._endless()
        self.failures = tuple(_sentence(*pair) for pair in failed)

    def _endless(self) -> list[tuple[bpy.types.ID, bpy.types.FCurve]]:
        """Drivers whose last result was no finite number; Blender takes 0 for it."""
        if self._messages is None:
            return []
        self._messages.seek(0)
        text = self._messages.read().decode(errors="replace")
        return [
            (owner, curve)
            for owner, curve in self._scripted
            if f"'{curve.driver.expression}' evaluates to" in text
        ]


def _drives(owner: bpy.types.ID, curve: bpy.types.FCurve) -> bool:
    """Test that the property of a driver exists."""
    with suppress(ValueError):
        owner.path_resolve(curve.data_path, False)
        return True
    return False


def _sentence(owner: bpy.types.ID, curve: bpy.types.FCurve) -> str:
    path = curve.data_path
    if hasattr(owner.path_resolve(path), "__len__"):
        path += f"[{curve.array_index}]"
    kind = owner.bl_rna.name.lower()
    return (
        f"the driver of '{path}' of {kind} '{owner.name}' cannot be evaluated: its value is the "
        "one that Blender leaves there"
    )


@contextmanager
def _errors_to(file: IO[bytes] | None) -> Iterator[None]:
    """Context in which the standard error stream, also Blender's own, goes to a file."""
    if file is None:
        yield
        return
    file.seek(0)
    file.truncate()
    kept = os.dup(_STDERR)
    try:
        os.dup2(file.fileno(), _STDERR)
        yield
    finally:
        os.dup2(kept, _STDERR)
        os.close(kept)
