# SPDX-License-Identifier: GPL-3.0-or-later
"""Body variants: MakeHuman's macro values, and the resulting mix of shape targets."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Final

import numpy as np

from hfx_blender.errors import UsageError

_MACRO: Final = "targets/macrodetails"
_ORIGINS: Final = ("african", "asian", "caucasian")
_AGES: Final = ("baby", "child", "young", "old")
_AGES_YEARS: Final = (1.0, 10.0, 25.0, 90.0)


@dataclass(frozen=True)
class Variant:
    """MakeHuman's macro values of a person; the defaults are the average adult."""

    gender: float = 0.5  # 0 female, 1 male
    age: float = 25.0  # years
    muscle: float = 0.5  # 0 least, 1 most
    weight: float = 0.5  # 0 least, 1 most
    stature: float = 0.5  # build, 0 of a short, 1 of a tall person: limbs against head
    proportions: float = 0.5  # 0 uncommon, 1 ideal
    height: float | None = None  # metres; None: height of the shape targets

    def __str__(self) -> str:
        return ",".join(f"{name}={value:g}" for name, value in self.values().items())

    def values(self) -> dict[str, float]:
        """Values by name, without a height of None."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def suffix(self) -> str:
        """Suffix of the variant's ids: ``+`` and eight digits of a hash."""
        text = ",".join(f"{name}={value!r}" for name, value in self.values().items())
        return f"+{hashlib.sha256(text.encode()).hexdigest()[:8]}"


RANGES: Final = {field.name: (0.0, 1.0) for field in fields(Variant)} | {
    "age": (_AGES_YEARS[0], _AGES_YEARS[-1]),
    "height": (0.4, 2.6),
}
"""Smallest and largest allowed value by name; age in years, height in metres."""


def parse(text: str) -> Variant:
    """Parse a variant of the command line: ``gender=1,age=70,height=1.72``.

    Raises
    ------
    UsageError
        An unknown or repeated name, or a value outside of its range.
    """
    values: dict[str, float] = {}
    for pair in text.split(","):
        name, equals, word = (piece.strip() for piece in pair.partition("="))
        if name not in RANGES or not equals:
            raise UsageError(
                f"--variant '{pair}': expected NAME=NUMBER with one of {', '.join(RANGES)}."
            )
        if name in values:
            raise UsageError(f"--variant: '{name}' is given twice.")
        lowest, highest = RANGES[name]
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            unit = {"age": " (years)", "height": " (metres)"}.get(name, "")
            raise UsageError(
                f"--variant {name}={word}: allowed are numbers from {lowest:g} to {highest:g}"
                f"{unit}."
            )
        values[name] = value
    return Variant(**values)


def target_shares(variant: Variant) -> dict[str, float]:
    """Shares of shape targets by file, combined like in MakeHuman.

    A share is the product over the target's axes (gender, age, muscle, weight), each axis linear
    between its two nearest targets; the three origins have a third each. MakeHuman's ages are baby
    1, child 10, young 25, old 90 years. Babies have no targets of proportions.
    """
    shares: dict[str, float] = {}
    genders = {"female": 1.0 - variant.gender, "male": variant.gender}
    ages = _between(variant.age, _AGES, _AGES_YEARS)
    amounts = [
        _between(getattr(variant, axis), (f"min{axis}", f"average{axis}", f"max{axis}"))
        for axis in ("muscle", "weight")
    ]
    statures = _between(variant.stature, ("minheight", "", "maxheight"))
    proportions = _between(variant.proportions, ("uncommonproportions", "", "idealproportions"))
    for (gender, age), share in _products(genders, ages):
        for origin in _ORIGINS:
            shares[f"{_MACRO}/{origin}-{gender}-{age}.target.gz"] = share / len(_ORIGINS)
    for names, share in _products(genders, ages, *amounts):
        person = "-".join(names)
        shares[f"{_MACRO}/universal-{person}.target.gz"] = share
        for stature, part in statures.items():
            if stature:
                shares[f"{_MACRO}/height/{person}-{stature}.target.gz"] = share * part
        for proportion, part in proportions.items():
            if proportion and "baby" not in names:
                shares[f"{_MACRO}/proportions/{person}-{proportion}.target.gz"] = share * part
    return shares


def _between(
    value: float, names: tuple[str, ...], places: tuple[float, ...] = (0.0, 0.5, 1.0)
) -> dict[str, float]:
    """Interpolation shares of the one or two names next to a value; the sum is 1."""
    shares = np.interp(value, places, np.arange(len(places))) - np.arange(len(places))
    return {
        name: float(1.0 - abs(share))
        for name, share in zip(names, shares, strict=True)
        if abs(share) < 1.0
    }


def _products(*axes: dict[str, float]) -> Iterator[tuple[tuple[str, ...], float]]:
    for choice in itertools.product(*(axis.items() for axis in axes)):
        share = math.prod(part for _, part in choice)
        if share > 0.0:
            yield tuple(name for name, _ in choice), share
