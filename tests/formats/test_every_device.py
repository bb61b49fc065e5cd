# SPDX-License-Identifier: GPL-3.0-or-later
"""Every shipped device in every format: the raster plays in the file, or a note names the loss.

The readers here are a few lines each, written from the formats' pages alone.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from format_cases import raster_for

from hfx_blender.devices.configuration import list_devices, load_device
from hfx_blender.formats import writing
from hfx_blender.formats.registry import FORMATS

AT_S = 0.25


def _between(points, at):
    """Return the value of (time, value) points at a time."""
    return float(np.interp(at, *np.array(points, float).T))


def _ahap(path):
    pattern = json.loads(path.read_text())["Pattern"]
    points = [
        (curve["Time"] + point["Time"], point["ParameterValue"])
        for curve in (event["ParameterCurve"] for event in pattern if "ParameterCurve" in event)
        if curve["ParameterID"] == "HapticIntensityControl"
        for point in curve["ParameterCurveControlPoints"]
    ]
    return _between(points, AT_S)


def _haptic(path):
    signals = json.loads(path.read_text())["signals"]["continuous"]["envelopes"]
    return _between(
        [(signal["time"], signal["amplitude"]) for signal in signals["amplitude"]], AT_S
    )


def _events(path):
    document = json.loads(path.read_text())
    channels = document.get("Channels", [{"Pattern": document.get("Pattern", [])}])
    patterns = document.get("PatternList", [{"AbsoluteTime": 0, **item} for item in channels])
    points = []
    for pattern in patterns:
        for event in (entry["Event"] for entry in pattern["Pattern"]):
            start = pattern.get("AbsoluteTime", 0) + event.get("RelativeTime", 0)
            start += event.get("StartTime", 0)
            level = event["Parameters"]["Intensity"] / 100
            for point in event["Parameters"]["Curve"]:
                points.append(((start + point["Time"]) / 1000, level * point["Intensity"]))
    return _between(points, AT_S)


READERS = {
    "ahap": (".ahap", _ahap),
    "haptic": (".haptic", _haptic),
    "he": (".he", _events),
    "he1": (".v1.he", _events),
    "openharmony": (".openharmony.json", _events),
}


def _openxr(folder, device):
    levels = {}
    for channel in json.loads((folder / "x.openxr.json").read_text())["channels"]:
        points = [
            ((frame["start"] + point["time"]) / 1e9, point["value"])
            for frame in channel["frames"]
            for point in frame["amplitudePoints"]
        ]
        levels[channel["actuator"]] = _between(points, AT_S)
    return levels


def _wav(folder, device):
    data = (folder / "x.wav").read_bytes()
    names = json.loads((folder / "x.wav.channels.json").read_text())["channels"]
    rows = np.frombuffer(data[data.index(b"data") + 8 :], "<i2").reshape(-1, len(names)) / 32767
    peak = np.abs(rows[int(48000 * 0.2) : int(48000 * 0.3)]).max(axis=0)
    return dict(zip([name["actuator"] for name in names], peak.tolist(), strict=True))


def _tact(folder, device):
    """Return levels by the configuration's dots; for other devices only the number of levels."""
    levels = []
    for path in folder.glob("*.tact"):
        for track in json.loads(path.read_text())["project"]["tracks"]:
            for effect in track["effects"]:
                for group, mode in effect["modes"].items():
                    for feedback in mode["dotMode"]["feedback"]:
                        start = effect["startTime"] + feedback["startTime"]
                        end = effect["startTime"] + feedback["endTime"]
                        if start <= 1000 * AT_S < end:
                            for dot in feedback["pointList"]:
                                levels.append((group, dot["index"], dot["intensity"]))
    dots = getattr(device.output.encoder, "dots", None) if device.output else None
    if dots:
        by_dot = {(group, index): level for group, index, level in levels}
        if device.is_mirrored:  # worn on the right, as configured for the left
            dots = [(group.removesuffix("L") + "R", index) for group, index in dots]
        pairs = zip(device.actuators, dots, strict=True)
        return {actuator.id: by_dot.get(dot, 0.0) for actuator, dot in pairs}
    full = _wanted(device)
    return {
        name: level
        for name, level in full.items()
        if any(abs(level - actual) <= 0.0051 for _, _, actual in levels)
    }


WHOLE = {"openxr": _openxr, "wav": _wav, "tact": _tact}


def _wanted(device):
    """Return a different level for each vibration actuator."""
    vibrating = [item for item in device.actuators if item.type.modality == "vibration"]
    levels = 1.0 - 0.8 * np.arange(len(vibrating)) / max(len(vibrating), 1)
    full = max((item.type.strength.highest for item in vibrating), default=0.0)
    return {
        item.id: min(level, item.type.strength.highest / full)
        for item, level in zip(vibrating, levels.tolist(), strict=True)
    }


@pytest.mark.parametrize("name", sorted(list_devices()))
def test_every_format_plays_the_raster_or_reports_the_loss(name, tmp_path):
    device = load_device(name)
    expected = _wanted(device)
    raster = raster_for(device, rows=50)
    kinds = {item.id: item.type for item in device.actuators}
    full = max((kinds[entry].strength.highest for entry in expected), default=0.0)
    for k, column in enumerate(raster.columns):
        if column.parameter == "amplitude_m_s2":
            raster.values[:, k] = expected[column.actuator] * full
        elif column.parameter == "frequency_hz":
            raster.values[:, k] = kinds[column.actuator].controls[1].lowest
        else:
            control = next(c for c in kinds[column.actuator].controls if c.name == column.parameter)
            raster.values[:, k] = 0.5 * (control.lowest + control.highest)
    formats = tuple(id for id, info in FORMATS.items() if info.is_of_device)
    played = [(tmp_path / "x", device, raster)]
    written = writing.write_all(formats, played, None, (device,), tmp_path / "x")
    with (tmp_path / "x.csv").open(newline="") as file:
        header, *rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    for k, column in enumerate(raster.columns):
        column_index = header.index(f"{column.actuator}.{column.parameter} [{column.unit}]")
        assert float(rows[25][column_index]) == pytest.approx(raster.values[25, k], rel=1e-8)
    for format_name, (suffix, read) in READERS.items():
        title = FORMATS[format_name].title
        named = (title, f"the format {format_name} ")
        text = " ".join(reason for reason in written.left_out if any(n in reason for n in named))
        for actuator, level in expected.items():
            path = tmp_path / f"x.{actuator}{suffix}"
            if path.exists():
                assert read(path) == pytest.approx(level, abs=0.0211), (format_name, actuator)
            else:
                assert actuator in text, (format_name, actuator)
    for format_name, read in WHOLE.items():
        title = FORMATS[format_name].title
        named = (title, f"the format {format_name} ")
        text = " ".join(reason for reason in written.left_out if any(n in reason for n in named))
        if not expected:
            assert device.id in text
        elif f"no {title} for it" in text:
            assert device.id in text
        else:
            actual = read(tmp_path, device)
            for actuator, level in expected.items():
                if actuator not in text and " more)" not in text:  # long lists are cut
                    where = (format_name, actuator)
                    assert actual[actuator] == pytest.approx(level, abs=0.0151), where
