# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips of ``players/conformance/behaviour``, made by hand, for calls with results made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfx_blender.formats.clip.container import NONE, Texts, encoded, records

REST = np.eye(4, dtype=np.float32)[:3].ravel()
_NO_LIMITS = (20.0, 10.0, np.inf, np.inf, 1.0, 0)  # latency and limits of an actuator


def ring(count: int, height_m: float, radius_m: float = 0.2, y_m: float = 0.0) -> np.ndarray:
    """Places on a circle round the vertical axis, counterclockwise from X, metres, (count, 3)."""
    angles = 2.0 * np.pi * np.arange(count) / count
    x, y = radius_m * np.cos(angles), y_m + radius_m * np.sin(angles)
    return np.stack([x, y, np.full(count, height_m)], axis=1)


class _Devices:
    """Devices whose actuators hold one value each for the whole clip."""

    def __init__(self, texts: Texts) -> None:
        self.text = texts.add
        self.devices: list[tuple[Any, ...]] = []
        self.actuators: list[tuple[Any, ...]] = []
        self.columns: list[tuple[Any, ...]] = []
        self.numbers: list[int] = []

    def add(
        self, id: str, values: list[tuple[float, ...]], places: np.ndarray, place: int = 1
    ) -> None:
        """Append a device of vibrations, in m/s^2 and maybe Hz, or (``place`` 2) of wind."""
        first, first_column = len(self.actuators), len(self.columns)
        for k, (value, at) in enumerate(zip(values, places, strict=True)):
            side = 1 + k if id == "touch" else 0
            self.actuators.append(
                (self.text(f"{id} {k}"), 3 * (place == 2), len(self.columns), len(value),
                 len(self.actuators), 1, len(self.numbers), place, side, 0, 0, 0, at, 0.05,
                 *_NO_LIMITS)
            )  # fmt: skip
            strength = ("amplitude_m_s2", "m/s^2") if place == 1 else ("speed_m_s", "m/s")
            kinds = ((*strength, 65.535), ("frequency_hz", "Hz", 655.35))
            for number, (parameter, unit, full) in zip(value, kinds, strict=False):
                self.columns.append(
                    (
                        self.text(parameter),
                        self.text(unit),
                        len(self.actuators) - 1,
                        0,
                        0.0,
                        full,
                        0.0,
                    )
                )
                self.numbers.append(round(65535 * number / full))
        self.devices.append(
            (self.text(id), self.text(id), self.text("Avatar"), first, len(values), first_column,
             len(self.columns) - first_column, 250)
        )  # fmt: skip

    def sections(self) -> dict[str, Any]:
        return {
            "TIME": records("TIME", [(1.0, 0.0, 100, 0)]),
            "DEVC": records("DEVC", self.devices),
            "ACTR": records("ACTR", self.actuators),
            "COLM": records("COLM", self.columns),
            "ROWS": np.zeros(len(self.actuators), np.uint32),
            "VALU": np.array(self.numbers, np.uint16),
        }


def ring_clip() -> bytes:
    """Belt of 8, vest of two rows of 4, controllers, back pad and fan: 23 columns, constant."""
    texts = Texts()
    devices = _Devices(texts)
    single = [
        [(float(value),) for value in row]
        for row in ([8, 0, 0, 0, 0, 0, 0, 2], [4, 0, 0, 0], [0, 12, 0, 0])
    ]
    devices.add("belt", single[0], ring(8, 1.1))
    rows = np.concatenate([ring(4, height_m, y_m=-0.03) for height_m in (1.2, 1.4)])
    devices.add("vest", single[1] + single[2], rows)
    hands = np.array([[0.5, -0.24, 1.06], [-0.5, -0.24, 1.06]])
    devices.add("touch", [(6.0, 100.0), (1.0, 200.0)], hands)
    devices.add("pad", [(3.0,), (0.0,)], np.array([[0.1, 0.06, 1.3], [-0.1, 0.06, 1.3]]))
    devices.add("fan", [(5.0,)], np.zeros((1, 3)), place=2)
    return encoded({**devices.sections(), "TEXT": texts.records}, "ring")


def avatar_clip(level: int = 0) -> bytes:
    """Body of two rings of 8 vertices, numbered 0, 4, ... 60, one actuator each; no effects."""
    texts = Texts()
    devices, text = _Devices(texts), texts.add
    places = np.concatenate([ring(8, 1.0), ring(8, 1.2)])
    devices.add("suit", [(0.0,)] * 16, places)
    sections = devices.sections() | _body(text, "Avatar", places, 4 * np.arange(16), level)
    sections["REAC"] = records("REAC", [(k, 0, 0, 0, 1.0, 0.0, k, 1) for k in range(16)])
    sections["RCHV"] = records("RCHV", [(k, 1.0) for k in range(16)])
    return encoded({**sections, "TEXT": texts.records}, "avatar")


def library_clip(numbers: np.ndarray | None = None, level: int = 0) -> bytes:
    """Effects alone: no device, and a body of another size with vertices in another order."""
    texts = Texts()
    text = texts.add
    numbers = 60 - 4 * np.arange(16) if numbers is None else numbers
    vibration, heat = text("hfx-vibration-1"), text("hfx-thermal-1")
    ball = 0.05 * np.eye(4)[:3]
    ball[:, 3] = 10.0, 0.0, 0.0
    dot = list(numbers).index(0)
    effects = [
        # name, kind, modality, body, model, level, strength, first painted, painted
        ("Dot", 1, 0, 0, vibration, 0.5, 10.0, 0, 1),
        ("Ball", 0, 0, NONE, vibration, 1.0, 4.0, 1, 0),
        ("Numbers", 1, 0, NONE, vibration, 1.0, 6.0, 1, 2),
        ("Heat", 1, 2, 0, heat, 1.0, 6.0, 3, 0),
    ]
    sections = {
        "TIME": records("TIME", [(1.0, 0.0, 1, 0)]),
        **_body(text, "Dummy", 3.0 * ring(len(numbers), 2.0), numbers, level),
        "EFCT": records(
            "EFCT",
            [(text(name), kind, modality, body, model, 1, 0.0, 0, 0.0, level_of,
              [strength, 80.0, 0.0, 0.0], 0.0, 0, 0, first, count,
              (REST if kind else ball.ravel().astype(np.float32)), 0)
             for name, kind, modality, body, model, level_of, strength, first, count in effects],
        ),
        "PNTD": records("PNTD", [(dot, 1.0), (8, 0.5), (999, 1.0)]),
        "TEXT": texts.records,
    }  # fmt: skip
    return encoded(sections, "library")


def _body(
    text: Any, name: str, places: np.ndarray, numbers: np.ndarray, level: int
) -> dict[str, Any]:
    """Records of a body of one bone and one model."""
    count = len(places)
    return {
        "BODY": records("BODY", [(text(name), 0, 1, 0, 1, 0)]),
        "BONE": records("BONE", [(text("root"), 0, 0, 0, NONE, 0.1, REST)]),
        "MODL": records("MODL", [(text("hfx-vibration-1"), 0, level, 0, count, 0)]),
        "VERT": records("VERT", [(at, numbers[k], k, 1) for k, at in enumerate(places)]),
        "WGHT": records("WGHT", [(0, 65535)] * count),
    }
