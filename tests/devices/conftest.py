# SPDX-License-Identifier: GPL-3.0-or-later
"""A valid configuration that uses every field of the format."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from device_documents import FULL


@pytest.fixture
def full() -> dict[str, Any]:
    return copy.deepcopy(FULL)


@pytest.fixture
def stored(tmp_path: Path):
    """Writes a configuration (or raw text or bytes) to a file."""

    def store(content: Any, name: str = "device.json") -> Path:
        path = tmp_path / name
        if not isinstance(content, bytes):
            text = content if isinstance(content, str) else json.dumps(content)
            content = text.encode()
        path.write_bytes(content)
        return path

    return store
