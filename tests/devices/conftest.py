# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures for devices: a valid configuration, and a client closed after each test."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from device_documents import FULL

from hfx_blender.devices.live.client import LiveClient


@pytest.fixture
def full() -> dict[str, Any]:
    return copy.deepcopy(FULL)


@pytest.fixture
def stored(tmp_path: Path):
    """Return a function writing a configuration (or raw text or bytes) to a file."""

    def store(content: Any, name: str = "device.json") -> Path:
        path = tmp_path / name
        if not isinstance(content, bytes):
            text = content if isinstance(content, str) else json.dumps(content)
            content = text.encode()
        path.write_bytes(content)
        return path

    return store


@pytest.fixture(autouse=True)
def _patient(patient_devices: None) -> None: ...


@pytest.fixture
def client() -> Iterator[LiveClient]:
    live_client = LiveClient()
    yield live_client
    live_client.close()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "device.jsonl"
