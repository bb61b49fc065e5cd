# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits on the memory and time that a file may require, checked before any allocation.

A few bytes can require days of values. Every reader and converter checks the limits; ``hfx ...
--largest N``, or :func:`raised` in Python, multiplies the limits by N.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final

from ..errors import InputError

_times: ContextVar[float | None] = ContextVar("hfx_file_limits", default=None)
"""Factor of all limits; None where the user cannot change it."""

MOST_TIMES: Final = 1e6
_COUNTLESS: Final = 1e300  # whole numbers may be larger than any float


class TooLargeError(InputError):
    """Error of a possibly valid file that exceeds a limit."""


@dataclass(frozen=True)
class Limit:
    """Limit on one quantity that a file requires."""

    default: float
    unit: str  # after the number in messages

    @property
    def allowed(self) -> float:
        """Current limit."""
        return self.default * (_times.get() or 1.0)

    def check(self, amount: float, name: str, clause: str) -> None:
        """Raise TooLargeError for an amount, in the limit's unit, above the limit or NaN. The
        message begins with ``name`` of the file and ``clause``, subject and verb: ``values would
        take``, ``the envelope lasts``."""
        if not amount <= self.allowed:  # also true for NaN
            # A larger whole number has no float, and its division would fail.
            times = amount / self.default if amount < _COUNTLESS else math.inf
            cure = ""
            if not times <= MOST_TIMES:
                cure = " (far too much)"
            elif _times.get() is not None:
                # Rounded up to two digits: the raised limit is above the amount.
                step = 10.0 ** (math.floor(math.log10(times)) - 1) if times >= 1.0 else 0.1
                cure = f" ('--largest {math.ceil(times / step) * step:.10g}' allows it)"
            raise TooLargeError(
                f"{name}: {clause} {_shown(amount)} {self.unit}, allowed are "
                f"{_shown(self.allowed)} {self.unit}{cure}."
            )


MEMORY: Final = Limit(float(1 << 30), "bytes")
"""Limit on arrays held at a time: an hour at 1 kHz of 37 values, a day at 100 Hz of 15."""

SECONDS: Final = Limit(86_400.0, "s")  # a day of envelopes

UNFOLDED: Final = Limit(2e6, "effects and keyframes")
"""Limit on the expansion of a file's references, all of them together."""

OVERLAP: Final = Limit(2e7, "keyframes")
"""Limit on overlapping sounds, counted for each piece that sounds."""

PIXELS: Final = Limit(float(1 << 26), "pixels")  # limit on one picture: 8192 x 8192

UNPACKED: Final = Limit(float(1 << 28), "bytes")
"""Limit on the unpacked size of any file, however small; :func:`check_unfolded` is the rule."""

PACKING: Final = 200.0
"""Largest ratio of unpacked to packed size: recorded values pack 2 to 100 times."""


def check_unfolded(unfolded: float, size: float, name: str) -> None:
    """Raise TooLargeError for ``size`` bytes that expand above :data:`PACKING` and
    :data:`UNPACKED`."""
    if unfolded > PACKING * size * (_times.get() or 1.0):
        UNPACKED.check(unfolded, name, f"{_shown(size)} bytes would become")


def check_unpacked(unpacked: float, packed: float, name: str) -> None:
    """Raise TooLargeError by :func:`check_unfolded`, and above :data:`MEMORY`; sizes in bytes."""
    check_unfolded(unpacked, packed, name)
    MEMORY.check(unpacked, name, "its arrays would take")


@contextmanager
def raised(times: float) -> Iterator[None]:
    """Context with all limits multiplied by ``times``, in this thread; messages name ``--largest``.
    Raises ValueError for a factor of 0 or less, or above ``MOST_TIMES``."""
    if not 0.0 < times <= MOST_TIMES:
        raise ValueError(f"expected more than 0, up to {MOST_TIMES:g} times, found {times}")
    token = _times.set(times)
    try:
        yield
    finally:
        _times.reset(token)


def _shown(amount: float) -> str:
    """Whole number with commas below 1e15, else three digits; "countless" from 1e300 on."""
    if abs(amount) < 1e15:
        return f"{amount:,.0f}"
    return f"{amount:.3g}" if abs(amount) < _COUNTLESS else "countless"
