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
        self._owners = [owner for owner in reached if next(drivers_of([owner]), None) is not None]
        self._tags = tags
        self._messages: IO[bytes] | None = None
        self.failures: tuple[str, ...] = ()
        """Drivers that failed at the last time, as sentences."""
        self._collect()

    def _collect(self) -> None:
        """Keep references to the drivers: finding each of a rig's again costs more than posing."""
        self._counts = list(map(_count, self._owners))
        pairs = [
            (owner, curve)
            for owner, curve in drivers_of(self._owners)
            if not curve.mute and _drives(owner, curve)
        ]
        self._pairs = [(owner, _sentence(owner, curve)) for owner, curve in pairs]
        self._drivers = [curve.driver for _, curve in pairs]
        self._failed = [*range(len(pairs))]
        # Their results that are no numbers are told on the standard error stream only.
        self._scripted = [
            k
            for k, driver in enumerate(self._drivers)
            if driver.type == "SCRIPTED" and not driver.is_simple_expression
        ]
        if self._scripted and self._messages is None:
            self._messages = tempfile.TemporaryFile()

    def evaluate(self, work: Callable[[], object]) -> None:
        """Call ``work``, in which Blender evaluates the drivers, and note those that failed."""
        if not self._owners:
            work()
            return
        if list(map(_count, self._owners)) != self._counts:  # a handler made or removed some
            self._collect()
        for k in self._failed:
            if not self._drivers[k].is_valid:
                self._drivers[k].is_valid = True
                if self._tags:
                    self._pairs[k][0].update_tag()
        with _errors_to(self._messages):
            work()
        if list(map(_count, self._owners)) != self._counts:
            self._collect()
        self._failed = [k for k, driver in enumerate(self._drivers) if not driver.is_valid]
        self.failures = tuple(self._pairs[k][1] for k in (*self._failed, *self._endless()))

    def _endless(self) -> list[int]:
        """Drivers whose last result was no finite number; Blender takes 0 for it."""
        if self._messages is None:
            return []
        self._messages.seek(0)
        text = self._messages.read().decode(errors="replace")
        return [
            k for k in self._scripted if f"'{self._drivers[k].expression}' evaluates to" in text
        ]


def _count(owner: bpy.types.ID) -> int:
    """Number of drivers of some data."""
    data = owner.animation_data
    return 0 if data is None else len(data.drivers)


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
