# SPDX-License-Identifier: GPL-3.0-or-later
"""Pickle-free serialization of engine dataclasses for helper processes.

Only numbers, text, arrays and dataclasses and enumerations of the engine are known; nothing in
the bytes is ever run, and nothing else is ever made of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from typing import Any, Final

import numpy as np

from .messages import Array, MessageError, pack, unpack

_PACKAGE: Final = __package__.rsplit(".", 2)[0]
_HOMES: Final = ("engine.", "devices.live.keyed_scene")
_DTYPES: Final = ("f8", "f4", "i4", "i8")


def to_bytes(value: Any) -> bytes:
    """A value as a body.

    Raises
    ------
    TypeError
        It holds something that is not plain data.
    """
    arrays: dict[str, Array] = {}
    return pack({"value": _to(value, arrays)}, arrays)


def from_bytes(body: bytes) -> Any:
    """The value of a body.

    Raises
    ------
    MessageError
        It is none.
    """
    content, arrays = unpack(body)
    try:
        return _from(content["value"], arrays)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise MessageError(f"not plain data: {error}") from None
    except (ImportError, RecursionError) as error:
        raise MessageError(f"not plain data: {error}") from None


def _to(value: Any, arrays: dict[str, Array]) -> Any:
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.str[1:] not in _DTYPES:
            raise TypeError(f"an array of {value.dtype}")
        name = str(len(arrays))
        arrays[name] = value
        return ["array", name]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Fraction):
        return ["fraction", value.numerator, value.denominator]
    if isinstance(value, Enum):
        return ["one", _name(type(value)), value.name]
    if is_dataclass(value):
        members = {
            each.name: _to(getattr(value, each.name), arrays) for each in fields(value) if each.init
        }
        return ["object", _name(type(value)), members]
    if isinstance(value, Mapping):
        return ["mapping", [[_to(k, arrays), _to(v, arrays)] for k, v in value.items()]]
    if isinstance(value, Sequence):
        return ["tuple", [_to(each, arrays) for each in value]]
    raise TypeError(f"a {type(value).__name__} is not plain data")


def _name(kind: type) -> str:
    module = kind.__module__.removeprefix(f"{_PACKAGE}.")
    if not module.startswith(_HOMES):
        raise TypeError(f"{kind.__name__} is not of the engine")
    return f"{module}:{kind.__qualname__}"


def _kind(name: str) -> Any:
    module, _, found = name.partition(":")
    if not module.startswith(_HOMES) or not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"'{name}' is not of the engine")
    kind = getattr(importlib.import_module(f"{_PACKAGE}.{module}"), found)
    if not isinstance(kind, type) or _name(kind) != name:
        raise ValueError(f"'{name}' is not at home there")
    return kind


def _from(value: Any, arrays: Mapping[str, Array]) -> Any:
    if not isinstance(value, list):
        if isinstance(value, dict):
            raise ValueError("a bare object")
        return value
    what, *rest = value
    if what == "array":
        return arrays[rest[0]]
    if what == "fraction":
        return Fraction(rest[0], rest[1])
    if what == "tuple":
        return tuple(_from(each, arrays) for each in rest[0])
    if what == "mapping":
        return {_from(key, arrays): _from(each, arrays) for key, each in rest[0]}
    kind = _kind(rest[0])
    if what == "one":
        return kind[rest[1]]
    if what == "object" and is_dataclass(kind):
        make: Any = kind
        return make(**{name: _from(each, arrays) for name, each in rest[1].items()})
    raise ValueError(f"'{what}' is not known")
