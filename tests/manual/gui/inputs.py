# SPDX-License-Identifier: GPL-3.0-or-later
"""Mouse and keyboard: real devices on an X display, else simulated events of Blender itself.

Both take window pixels from the top left corner, and keys as X names keys: ``"shift+a"``,
``"Return"``, ``"n"``. Every action is a generator of waits, in seconds.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from typing import Any

BUTTONS = {1: "LEFTMOUSE", 2: "MIDDLEMOUSE", 3: "RIGHTMOUSE"}
_BLENDER_KEYS = {
    "Return": "RET",
    "Escape": "ESC",
    "BackSpace": "BACK_SPACE",
    "Delete": "DEL",
    "Left": "LEFT_ARROW",
    "Right": "RIGHT_ARROW",
    "Up": "UP_ARROW",
    "Down": "DOWN_ARROW",
    "period": "PERIOD",
    " ": "SPACE",
    **{
        str(digit): name
        for digit, name in enumerate("ZERO ONE TWO THREE FOUR FIVE SIX SEVEN EIGHT NINE".split())
    },
}
_MODIFIERS = ("shift", "ctrl", "alt")


class RealInput:
    """``xdotool`` on Blender's X display; the window's corner is the screen's."""

    flags: tuple[str, ...] = ()

    def move(self, x: float, y: float) -> Iterator[float]:
        yield from self._call("mousemove", str(round(x)), str(round(y)))

    def glide(self, points: Sequence[tuple[float, float]], seconds: float) -> Iterator[float]:
        """Move evenly over points, independent of the window's drawing time."""
        pause = f"{seconds / max(len(points), 1):.4f}"
        chain = [("mousemove", str(round(x)), str(round(y)), "sleep", pause) for x, y in points]
        yield from self._call(*(word for item in chain for word in item))

    def dabs(self, points: Sequence[tuple[float, float]]) -> Iterator[float]:
        """Click on points within a few hundredths of a second."""
        chain = [("mousemove", str(round(x)), str(round(y)), "click", "1") for x, y in points]
        yield from self._call(*(word for item in chain for word in item))

    def press(self, button: int) -> Iterator[float]:
        yield from self._call("mousedown", str(button))

    def release(self, button: int) -> Iterator[float]:
        yield from self._call("mouseup", str(button))

    def key(self, keys: str) -> Iterator[float]:
        yield from self._call("key", keys)

    def text(self, text: str) -> Iterator[float]:
        yield from self._call("type", "--delay", "40", text)

    def hold(self, modifier: str) -> Iterator[float]:
        """Hold a modifier key down, for clicks, until :meth:`let_go`."""
        yield from self._call("keydown", modifier)

    def let_go(self, modifier: str) -> Iterator[float]:
        yield from self._call("keyup", modifier)

    @staticmethod
    def _call(*arguments: str) -> Iterator[float]:
        process = subprocess.Popen(["xdotool", *arguments])
        while process.poll() is None:
            yield 0.01
        if process.returncode:
            raise RuntimeError(f"xdotool {' '.join(arguments)} failed")
        yield 0.03


class SimulatedInput:
    """Blender's own simulation of events: any system, but Blender's window manager is not asked."""

    flags: tuple[str, ...] = ("--enable-event-simulate",)

    def __init__(self, window: Any) -> None:
        self._window = window
        self._at = (0, 0)
        self._held: dict[str, bool] = {}

    def move(self, x: float, y: float) -> Iterator[float]:
        self._at = (round(x), self._window.height - round(y))
        yield from self._event("MOUSEMOVE", "NOTHING")

    def glide(self, points: Sequence[tuple[float, float]], seconds: float) -> Iterator[float]:
        for point in points:
            yield from self.move(*point)
            yield seconds / len(points)

    def dabs(self, points: Sequence[tuple[float, float]]) -> Iterator[float]:
        for point in points:
            yield from self.move(*point)
            yield from self.press(1)
            yield from self.release(1)

    def press(self, button: int) -> Iterator[float]:
        yield from self._event(BUTTONS[button], "PRESS")

    def release(self, button: int) -> Iterator[float]:
        yield from self._event(BUTTONS[button], "RELEASE")

    def key(self, keys: str) -> Iterator[float]:
        *modifiers, key = keys.split("+")
        held = {name: name in modifiers for name in _MODIFIERS}
        kind = _BLENDER_KEYS.get(key, key.upper())
        # The typed text of a key is stated apart from the key; with Ctrl or Alt the text is empty.
        typed = key if len(key) == 1 and not (held["ctrl"] or held["alt"]) else ""
        yield from self._event(kind, "PRESS", unicode=typed, **held)
        yield from self._event(kind, "RELEASE", **held)

    def text(self, text: str) -> Iterator[float]:
        for letter in text:
            yield from self.key(letter)

    def hold(self, modifier: str) -> Iterator[float]:
        self._held[modifier] = True
        yield 0.03

    def let_go(self, modifier: str) -> Iterator[float]:
        del self._held[modifier]
        yield 0.03

    def _event(self, kind: str, value: str, **options: Any) -> Iterator[float]:
        x, y = self._at
        options = {**self._held, **options}
        if value == "PRESS" and options.get("unicode"):
            options["unicode"] = options["unicode"] or None
        else:
            options.pop("unicode", None)
        self._window.event_simulate(type=kind, value=value, x=x, y=y, **options)
        yield 0.03
