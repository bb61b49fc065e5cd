# SPDX-License-Identifier: GPL-3.0-or-later
"""A client that is closed after each test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from hfx_blender.devices.live.client import LiveClient


@pytest.fixture(autouse=True)
def _patient(patient_devices: None) -> None: ...


@pytest.fixture
def client() -> Iterator[LiveClient]:
    made = LiveClient()
    yield made
    made.close()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "device.jsonl"
