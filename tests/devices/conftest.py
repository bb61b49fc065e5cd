# SPDX-License-Identifier: GPL-3.0-or-later
"""A valid configuration that uses every field of the format."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest

FULL: dict[str, Any] = {
    "schema": "hfx-device",
    "version": 1,
    "id": "test_sleeve",
    "name": "Test sleeve",
    "description": "Every field once.",
    "brand": {
        "vendor": "Nobody",
        "model": "None",
        "usb": [{"vendor_id": "0x2341", "product_id": "0x0043"}],
        "serial": "HFX-*",
    },
    "size_m": {"width": 0.2, "height": 0.1},
    "side": "left",
    "actuator_types": {
        "motor": {
            "modality": "vibration",
            "parameters": {
                "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 15},
                "frequency_hz": {"unit": "Hz", "minimum": 60, "maximum": 250, "neutral": 80},
            },
            "latency_ms": 30,
            "update_interval_ms": 20,
            "takes_waveform": False,
            "resonance_hz": 175,
            "drive": [
                {"frequency_hz": 80, "points": [[0, 0], [0.5, 2], [1, 6]]},
                {"frequency_hz": 175, "points": [[0, 0], [0.5, 6], [1, 15]]},
            ],
            "detection_thresholds": [[80, 0.3], [250, 0.05]],
            "limits": {"amplitude_m_s2": {"maximum": 12}},
        },
        "lra": {
            "modality": "vibration",
            "parameters": {
                "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10},
                "frequency_hz": {"unit": "Hz", "fixed": 175},
            },
        },
        "peltier": {
            "modality": "temperature",
            "parameters": {
                "temperature_c": {"unit": "degC", "minimum": 10, "maximum": 45, "neutral": 33}
            },
            "limits": {"temperature_c": {"minimum": 15, "maximum": 40}},
        },
    },
    "actuators": [
        {
            "id": "a",
            "type": "motor",
            "place": {
                "placement": {
                    "parts": ["forearm"],
                    "side": "left",
                    "centre_m": [0.41, -0.05, 1.2],
                    "radius_m": 0.02,
                }
            },
        },
        {
            "id": "b",
            "type": "lra",
            "place": {
                "vertices": [{"model": "hfx-vibration-1", "hash": "0" * 64, "ids": [1, 5, 9]}]
            },
        },
        {
            "id": "c",
            "type": "peltier",
            "place": {
                "room": {
                    "reaches": ["head", "torso"],
                    "at_m": [0, -2, 1.2],
                    "aim": [0, 0.5, 0],
                    "range_m": 3,
                    "cone_deg": 60,
                }
            },
        },
    ],
    "rendering": {"scheme": "coverage", "options": {"statistic": "mean"}},
    "substitutions": {
        "pressure": {
            "as": "vibration",
            "scale": {"value": 1, "unit": "m/s^2 per kPa"},
            "frequency_hz": 80,
        },
        "wind": {"as": "temperature", "scale": {"value": -0.5, "unit": "degC per m/s"}},
    },
    "defaults": {"gain": 1.5},
}


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
