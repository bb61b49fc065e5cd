# SPDX-License-Identifier: GPL-3.0-or-later
"""OSC addresses of values and time: from messages to typed changes (``docs/osc-addresses.md``)."""

import re
from typing import Final, NamedTuple
from urllib.parse import quote, unquote

from .osc_packets import OscMessage

_PARAMETER: Final = re.compile(r"((response|drive)/[0-9]{1,4}/)?[a-z][a-z0-9_]{0,63}")
_ENTRY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_MAX_NAME: Final = 256
_SWITCHES: Final = frozenset(("mute", "trigger"))
_RANGES: Final = {"gain": (0.0, 1.0), "intensity": (0.0, 1.0), "rate": (-16.0, 16.0)}
_LARGEST: Final = 1e6  # of values without a range: beyond all parameters and times


class ValueChange(NamedTuple):
    """Change of a value.

    ``target``: ``effect``, ``clip``, ``all`` (every device) or ``time``.
    ``name``: of the effect or clip; "" for further targets.
    ``parameter``: ``intensity``, ``frequency_hz`` ..., ``response/0/decay`` of the first filter of
    a contact response; ``mute``, ``trigger``, ``gain``, ``time`` or ``rate``.
    ``value``: finite; 0 or 1 of ``mute`` and ``trigger``; the first of three numbers; 0 for a text.
    ``vector``: three finite numbers, such as a location; empty for one number.
    ``text``: entry of a menu, as ``linear``; empty for numbers.
    """

    target: str
    name: str
    parameter: str
    value: float
    vector: tuple[float, ...] = ()
    text: str = ""


def is_used(address: str) -> bool:
    """True for an OSC address that begins as one of a value, or is that of a time or a rate."""
    return address.startswith("/hfx/") or address in ("/time", "/rate")


def address_of(target: str, name: str = "", parameter: str = "") -> str:
    """OSC address of a parameter; the inverse of :func:`change_of`.

    Characters of a name that OSC addresses cannot have are percent-encoded UTF-8, as in a URL.
    """
    if target == "time":
        return f"/{parameter}"
    return (
        f"/hfx/{parameter}" if target == "all" else f"/hfx/{target}/{quote(name, '')}/{parameter}"
    )


def change_of(message: OscMessage) -> ValueChange | None:
    """Change of a message; None for an unknown address, a pattern, an argument that is no number,
    NaN, infinity, and a value out of range.

    ``gain`` and ``intensity`` are 0 to 1, ``rate`` -16 to 16. A switch is on above 0; a trigger
    without argument is on. Three numbers are a vector of an effect, a word an entry of a menu.
    """
    target, name, parameter = _parts(message.address)
    if not target or not _PARAMETER.fullmatch(parameter):
        return None
    arguments = message.arguments or ((True,) if parameter == "trigger" else ())
    is_scalar = target != "effect" or parameter in _SWITCHES or parameter in _RANGES
    if len(arguments) == 1 and isinstance(arguments[0], str):
        is_entry = not is_scalar and _ENTRY.fullmatch(arguments[0])
        return ValueChange(target, name, parameter, 0.0, (), arguments[0]) if is_entry else None
    numbers = tuple(float(x) for x in arguments if isinstance(x, int | float))
    lowest, highest = _RANGES.get(parameter, (-_LARGEST, _LARGEST))
    # NaN is in no range.
    if len(numbers) != len(arguments) or not all(lowest <= x <= highest for x in numbers):
        return None
    if len(numbers) != 1 and (len(numbers) != 3 or is_scalar):
        return None
    value = float(numbers[0] > 0.0) if parameter in _SWITCHES else numbers[0]
    return ValueChange(target, name, parameter, value, numbers if len(numbers) == 3 else ())


def _parts(address: str) -> tuple[str, str, str]:
    """Target, name and parameter of an address; "", "", "" for an unknown address."""
    if address in ("/time", "/rate"):
        return "time", "", address[1:]
    match address.split("/"):
        case ["", "hfx", "gain" | "mute" as parameter]:
            return "all", "", parameter
        case ["", "hfx", "effect" | "clip" as target, text, *rest] if len(rest) in (1, 3):
            name, value = _name(text), "/".join(rest)
            # Clips have triggers only, and only clips have them.
            if name and (target == "clip") == (value == "trigger"):
                return target, name, value
    return "", "", ""


def _name(text: str) -> str:
    """Decode a percent-encoded name; "" for an invalid one."""
    if not text or len(text) > 3 * _MAX_NAME:
        return ""
    try:
        return unquote(text, errors="strict")[:_MAX_NAME]
    except UnicodeDecodeError:
        return ""
