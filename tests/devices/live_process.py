# SPDX-License-Identifier: GPL-3.0-or-later
"""Output process for tests: a client with heartbeats while waiting, and logging devices."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hfx_blender.devices.live.client import LiveClient

BAND = "forearm_band_left"  # eight motors: amplitude and frequency in turn
PATIENCE_S = 120.0
"""What does not happen for so long does not happen."""


def playing(amplitude: float = 10.0) -> np.ndarray:
    """Return values of the band with every motor playing."""
    return np.tile([amplitude, 100.0], 8)


def rows_of(log: Path) -> list[dict[str, Any]]:
    """Return the complete lines of a simulator's log."""
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    return [json.loads(line) for line in lines]


def is_loud(row: dict[str, Any]) -> bool:
    return "values" in row and any(row["values"][::2])


def wait(
    client: LiveClient, until: Callable[[], object], action: Callable[[], None] | None = None
) -> None:
    """Handle events until a condition is true; fails after the time limit."""
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end, f"never happened; devices: {client.devices}"
        client.events()
        client.heartbeat()
        if action is not None:
            action()
        time.sleep(0.005)


def play(client: LiveClient, name: str, log: Path, values: np.ndarray | None = None) -> None:
    """Connect a simulator and send values until the log shows output."""
    client.connect(name, BAND, {"kind": "simulator", "path": str(log)})
    sent = playing() if values is None else values
    wait(
        client,
        lambda: any(is_loud(row) for row in rows_of(log)),
        lambda: client.send(name, sent),
    )
    client.events()
