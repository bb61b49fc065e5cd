# SPDX-License-Identifier: GPL-3.0-or-later
"""Fields of bits, highest bit first: whole numbers, texts, numbers of a range in equal steps."""

from __future__ import annotations

from typing import Final

from hfx_blender.errors import InputError

LONGEST_TEXT: Final = 255  # bytes
DECIMALS: Final = 5
"""Decimal places of numbers in 32 bits: their step is 2e-6 to 5e-6."""

_ZERO: Final = 127
"""Code of amplitude 0. MPEG's software cuts an amplitude down to a step, so it writes this code for
the values around 0. It reads the code as -1/255."""


def amplitude_of(code: int) -> float:
    """Amplitude -1 to 1 of a code of 8 bits; exactly 0 for the code that writers use for 0."""
    return 0.0 if code == _ZERO else round(2.0 * code / 255.0 - 1.0, 6)


def amplitude_code(amplitude: float) -> int:
    """Code of an amplitude; :func:`amplitude_of` differs by 1.5/255 at most. Amplitudes outside of
    -1 to 1 are clipped."""
    code = round((min(max(amplitude, -1.0), 1.0) + 1.0) * 255.0 / 2.0)
    # Halves between the neighbours of 0, -3/255 and 1/255.
    if code in (_ZERO, _ZERO + 1):
        code = _ZERO + (amplitude > 0.5 / 255.0) - (amplitude < -1.5 / 255.0)
    return code


class BitReader:
    """Reader of consecutive fields of ``data``. Messages of InputError begin with ``place``.
    The attribute ``replaced_texts`` counts texts that were no UTF-8."""

    def __init__(self, data: bytes, place: str) -> None:
        self._data, self.place = data, place
        self.replaced_texts = 0
        self._at = 0  # bits

    def take(self, width: int) -> int:
        """Read a whole number of ``width`` bits; InputError past the end."""
        end = self._at + width
        if end > 8 * len(self._data):
            raise InputError(f"{self.place} is cut off.")
        first, last = self._at // 8, (end + 7) // 8
        number = int.from_bytes(self._data[first:last]) >> (8 * last - end)
        self._at = end
        return number & ((1 << width) - 1)

    def signed(self, width: int) -> int:
        """Read a whole number in two's complement."""
        number = self.take(width)
        return number - (1 << width) if number >> (width - 1) else number

    def number(self, width: int, lowest: float, highest: float) -> float:
        """Read a number between ``lowest`` and ``highest``, in equal steps."""
        share = self.take(width) / ((1 << width) - 1)
        return round(lowest + share * (highest - lowest), DECIMALS)

    def text(self) -> str:
        """Read a text: its number of bytes, then UTF-8; other bytes become U+FFFD."""
        content = bytes(self.take(8) for _ in range(self.take(8)))
        try:
            return content.decode()
        except UnicodeDecodeError:
            self.replaced_texts += 1
            return content.decode(errors="replace")


class BitWriter:
    """Writer of consecutive fields. Messages of InputError begin with ``name``, the file's."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._fields: list[str] = []
        self._bits = 0

    def put(self, width: int, number: int, field: str) -> None:
        """Write a whole number in ``width`` bits; InputError, with ``field``, if it needs more."""
        most = (1 << width) - 1
        if not 0 <= number <= most:
            raise InputError(f"{self.name}: {field} is {number}, HMPG holds 0 to {most}.")
        self._fields.append(f"{number:0{width}b}")
        self._bits += width

    def put_signed(self, width: int, number: int, field: str) -> None:
        """Write a whole number in two's complement; InputError if it needs more bits."""
        half = 1 << (width - 1)
        if not -half <= number < half:
            raise InputError(f"{self.name}: {field} is {number}, HMPG holds {-half} to {half - 1}.")
        self.put(width, number % (2 * half), field)

    def put_number(
        self, width: int, number: float, lowest: float, highest: float, field: str
    ) -> None:
        """Write a number as the nearest of the steps from ``lowest`` to ``highest``; InputError
        outside of these."""
        if not lowest <= number <= highest:
            raise InputError(
                f"{self.name}: {field} is {number:g}, HMPG holds {lowest:g} to {highest:g}."
            )
        steps = (1 << width) - 1
        self.put(width, round((number - lowest) / (highest - lowest) * steps), field)

    def put_text(self, text: str, field: str) -> None:
        """Write a text as its number of bytes, then UTF-8; InputError above 255 bytes."""
        content = text.encode("utf-8", "replace")
        if len(content) > LONGEST_TEXT:
            raise InputError(
                f"{self.name}: {field} has {len(content)} bytes, HMPG holds {LONGEST_TEXT}."
            )
        self.put(8, len(content), field)
        for byte in content:
            self.put(8, byte, field)

    def content(self) -> bytes:
        """Bytes of all fields, filled up with 0 bits."""
        size = (self._bits + 7) // 8
        digits = "".join(self._fields).ljust(8 * size, "0")
        return int(digits or "0", 2).to_bytes(size)
