# SPDX-License-Identifier: GPL-3.0-or-later
"""Valid device configurations with every field of the format."""

from __future__ import annotations

import copy
import json
from typing import Any

from hfx_blender.files import resources

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


def changed(**members: Any) -> dict[str, Any]:
    """Copy the full configuration and replace top-level members."""
    return copy.deepcopy(FULL) | members


def with_types(*types: dict[str, Any], **members: Any) -> dict[str, Any]:
    """Return a configuration with one actuator of each given type, placed in the room."""
    return {
        "schema": "hfx-device",
        "version": 1,
        "id": "types",
        "name": "Types",
        "actuator_types": {f"type{k}": item for k, item in enumerate(types)},
        "actuators": [
            {"id": f"a{k}", "type": f"type{k}", "place": {"room": {}}} for k in range(len(types))
        ],
        **members,
    }


LIMITS = {"minimum": 0, "maximum": 5}
STRENGTHS = {"pressure": ("pressure_kpa", "kPa"), "wind": ("speed_m_s", "m/s")}
VIBRATION = FULL["actuator_types"]["motor"] | {
    "slew_per_s": 100,
    "maximum_on_s": 5,
    "rest_s": 2,
    "limits": {
        "amplitude_m_s2": LIMITS,
        "frequency_hz": {"minimum": 60, "maximum": 200},
    },
}
FIXED = {
    "modality": "vibration",
    "parameters": {
        "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10, "neutral": 0},
        "frequency_hz": {"unit": "Hz", "fixed": 175},
    },
    "limits": {"frequency_hz": {"minimum": 175, "maximum": 175}},
}
OTHERS = [
    {
        "modality": modality,
        "parameters": {name: {"unit": unit, "minimum": 0, "maximum": 9, "neutral": 0}},
        "latency_ms": 5,
        "update_interval_ms": 20,
        "takes_waveform": False,
        "slew_per_s": 1,
        "maximum_on_s": 5,
        "rest_s": 2,
        "limits": {name: LIMITS},
    }
    for modality, (name, unit) in STRENGTHS.items()
]
THERMAL = FULL["actuator_types"]["peltier"] | {
    "latency_ms": 5,
    "update_interval_ms": 20,
    "takes_waveform": False,
    "slew_per_s": 1,
    "maximum_on_s": 5,
    "rest_s": 2,
}


def stepped(kind: dict[str, Any]) -> dict[str, Any]:
    """Return a type with a list of allowed values, ends and neutral, for each parameter."""
    kind = copy.deepcopy(kind)
    for parameter in kind["parameters"].values():
        ends = parameter["minimum"], parameter["maximum"], parameter.get("neutral", 0)
        parameter["values"] = sorted(set(ends))
    return kind


CUSTOM = {
    "duty": {"unit": "%", "minimum": 0, "maximum": 100, "neutral": 50},
    "pattern": {"choices": ["off", "sweep", "burst"]},
}
UNITS = {"vibration": "m/s^2", "pressure": "kPa", "temperature": "degC", "wind": "m/s"}
PAD = {
    "mount": {"origin_m": [0, 0.1, 1.2], "x_axis": [1, 0, 0], "y_axis": [0, 0, 1]},
    "actuators": [
        {
            "id": "p",
            "type": "motor",
            "place": {
                "pad": {"parts": ["torso"], "side": "left", "at_mm": [10, -20], "radius_m": 0.02}
            },
        }
    ],
    "substitutions": {},
}
BENT = PAD | {"mount": PAD["mount"] | {"bend_radius_mm": 150}}
SCHEMES = [
    {"scheme": "coverage", "options": {"statistic": "strongest"}},
    {"scheme": "barycentric", "options": {"law": "linear"}},
    {"scheme": "surface", "options": {"law": "power"}},
    {"scheme": "splat", "options": {"sigma_m": 0.01}},
    {"scheme": "brush", "options": {"duration_ms": 100}},
    {"scheme": "saltation", "options": {"interval_ms": 60, "tap_ms": 5}},
    *({"scheme": item, "options": {}} for item in ("nearest", "ring", "line", "vbap")),
]


def substituting(source: str, target: str) -> dict[str, Any]:
    """Return a configuration with a substitution of one modality by another."""
    kinds = {"vibration": VIBRATION, "temperature": THERMAL}
    kinds |= dict(zip(STRENGTHS, OTHERS, strict=True))
    how = {"as": target, "scale": {"value": 1, "unit": f"{UNITS[target]} per {UNITS[source]}"}}
    if target == "vibration":
        how["frequency_hz"] = 100
    return with_types(kinds[target], substitutions={source: how})


def with_list(document: dict[str, Any]) -> dict[str, Any]:
    """Return a copy with the output as the only item of a list of outputs."""
    document = copy.deepcopy(document)
    ids = [actuator["id"] for actuator in document["actuators"]]
    document["outputs"] = [document.pop("output") | {"actuators": ids}]
    return document


def documents(outputs: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return all configurations by name: shipped devices, then documents of further fields."""
    actual = {
        path.stem: json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(resources.device_configs().glob("*.json"))
    }
    actual["full"] = copy.deepcopy(FULL)
    actual["types"] = with_types(VIBRATION, FIXED, THERMAL, *OTHERS)
    actual["waveforms"] = with_types(
        *(
            VIBRATION | {"takes_waveform": True, "tone_pair": True, "waveform": w}
            for w in ("noise", "square", "sine")
        )
    )
    actual["custom"] = with_types(*({**k, "custom": CUSTOM} for k in (VIBRATION, THERMAL, *OTHERS)))
    kinds = ({**kind, "limits": {}} for kind in (VIBRATION, THERMAL, *OTHERS))
    actual["values"] = with_types(*map(stepped, kinds))
    actual["pad"] = changed(**PAD)
    actual["bent pad"] = changed(**BENT)
    actual |= {f"scheme {scheme['scheme']}": changed(rendering=scheme) for scheme in SCHEMES}
    pairs = [(a, b) for a in UNITS for b in UNITS if a != b]
    actual |= {f"{a} as {b}": substituting(a, b) for a, b in pairs}
    return actual | {f"output {kind}": item for kind, item in outputs.items()}
