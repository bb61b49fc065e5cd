# SPDX-License-Identifier: GPL-3.0-or-later
"""Retry and report drivers that Blender cannot evaluate at a time.

Blender marks a driver as invalid at the first failure and skips the driver from then on. Without a
retry, the driven property would be lost at all later times, and at earlier times if a late time is
read first.
"""

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Final

import bpy

from ...authoring.effects import effects

_STDERR: Final = 2

LOOKS: Final = (bpy.types.Material, bpy.types.ShaderNodeTree)
"""Data-block types without influence on positions and shapes."""


def drivers_of(reached: Iterable[bpy.types.ID]) -> Iterator[tuple[bpy.types.ID, bpy.types.FCurve]]:
    """Yield (owner, driver F-curve) of data-blocks, except of materials and shader nodes."""
    for owner in reached:
        data = getattr(owner, "animation_data", None)
        if data is not None and not isinstance(owner, LOOKS):
            yield from ((owner, curve) for curve in data.drivers)


class RetriedDrivers:
    """Evaluate every driver of the original data-blocks ``reached`` at every time, also after
    earlier failures; muted drivers and drivers of missing properties are ignored. ``tags``: tag
    owners of failed drivers, so that Blender evaluates them without changed inputs. False with a
    simulation, because tagging empties its cache."""

    def __init__(self, reached: Iterable[bpy.types.ID], *, tags: bool) -> None:
        self._owners = [*dict.fromkeys(owner for owner, _ in drivers_of(reached))]
        self._tags = tags
        self._messages: IO[bytes] | None = None
        self.failures: tuple[str, ...] = ()
        """Sentences about the drivers that failed in the last :meth:`evaluate`."""
        self._collect()

    def _collect(self) -> None:
        """Cache all unmuted drivers of existing properties and mark each as failed; opens a file
        for Blender's messages if any is scripted."""
        self._counts = list(map(_count, self._owners))
        pairs = [
            (owner, curve)
            for owner, curve in drivers_of(self._owners)
            if not curve.mute and _drives(owner, curve)
        ]
        self._pairs = [(owner, _sentence(owner, curve)) for owner, curve in pairs]
        self._drivers = [curve.driver for _, curve in pairs]
        # Failures from before this reading are retried as well.
        self._failed = [*range(len(pairs))]
        # Blender reports infinite and NaN results of scripts on standard error only.
        self._scripted = [
            k
            for k, driver in enumerate(self._drivers)
            if driver.type == "SCRIPTED" and not driver.is_simple_expression
        ]
        # A file, because a pipe would fill and block Blender, and its C code bypasses sys.stderr.
        if self._scripted and self._messages is None:
            self._messages = tempfile.TemporaryFile()

    def evaluate(self, work: Callable[[], object]) -> None:
        """Make failed drivers valid, call ``work`` once, which evaluates the scene, and set
        :attr:`failures`. Drivers are searched again if their number has changed."""
        if not self._owners:
            work()
            return
        # A handler may have added or removed drivers, which invalidates the references.
        if list(map(_count, self._owners)) != self._counts:
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
        # Blender replaces NaN and infinite results by 0, and the driver stays valid: only the
        # message on standard error tells.
        text = ""
        if self._messages is not None:
            self._messages.seek(0)
            text = self._messages.read().decode(errors="replace")
        endless = (
            k for k in self._scripted if f"'{self._drivers[k].expression}' evaluates to" in text
        )
        self.failures = tuple(self._pairs[k][1] for k in (*self._failed, *endless))


def _count(owner: bpy.types.ID) -> int:
    """Number of drivers of a data-block; 0 without animation data."""
    data = owner.animation_data
    return 0 if data is None else len(data.drivers)


def _drives(owner: bpy.types.ID, curve: bpy.types.FCurve) -> bool:
    """True if the driven property's path resolves on the owner."""
    with suppress(ValueError):
        owner.path_resolve(curve.data_path, False)
        return True
    return False


def _sentence(owner: bpy.types.ID, curve: bpy.types.FCurve) -> str:
    """Message about a failed driver, without a full stop: path (array properties with index), kind
    and name of the owner."""
    path = curve.data_path
    if hasattr(owner.path_resolve(path), "__len__"):
        path += f"[{curve.array_index}]"
    kind = owner.bl_rna.name.lower()
    is_object = isinstance(owner, bpy.types.Object)
    name = effects.shown_names([owner])[owner] if is_object else owner.name
    return (
        f"the driver of '{path}' of {kind} '{name}' cannot be evaluated: its value is the "
        "one that Blender leaves there"
    )


@contextmanager
def _errors_to(file: IO[bytes] | None) -> Iterator[None]:
    """Context that redirects standard error of the process (descriptor 2) to an emptied file; None:
    no change."""
    if file is None:
        yield
        return
    file.seek(0)
    file.truncate()
    original = os.dup(_STDERR)
    try:
        os.dup2(file.fileno(), _STDERR)
        yield
    finally:
        os.dup2(original, _STDERR)
        os.close(original)
