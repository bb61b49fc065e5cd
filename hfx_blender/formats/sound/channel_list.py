# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of the channel list of a WAV file: actuators of a device, or loudspeakers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from ...files.findings import Finding, Report
from ...files.json_shapes import Items, Number, Record, Shape, Text, check
from ...files.strict_json import parse, read_bytes

_CHANNEL: Final = Number(0, is_whole=True)
_SHARED: Final[dict[str, Shape]] = {
    "version": Number(1, 1, is_whole=True),
    "rate_hz": Number(1, is_whole=True),
    "start_s": Number(),
}
_KINDS: Final = {
    "hfx-wav-channels": Record(
        {
            **_SHARED,
            "format": Text(("hfx-wav-channels",)),
            "device": Text(),
            "body": Text(),
            "full_scale_m_s2": Number(0.0),
            "channels": Items(Record({"channel": _CHANNEL, "actuator": Text()}), least=1),
        }
    ),
    "hfx-sound-channels": Record(
        {
            **_SHARED,
            "format": Text(("hfx-sound-channels",)),
            "layout": Text(),
            "gain": Number(0.0, 1.0),
            "channels": Items(
                Record(
                    {
                        "channel": _CHANNEL,
                        "azimuth_deg": Number(-360.0, 360.0),
                        "elevation_deg": Number(-90.0, 90.0),
                    }
                ),
                least=1,
            ),
        }
    ),
}


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file; InputError if it is not JSON."""
    document = parse(content, name)
    report = Report("CHANNELS")
    kind = document.get("format") if isinstance(document, dict) else None
    first = next(iter(_KINDS.values()))
    check(_KINDS.get(kind, first) if isinstance(kind, str) else first, document, report)
    if not report.has_errors:
        for k, channel in enumerate(document["channels"]):
            if channel["channel"] != k:
                message = f"{channel['channel']} is not the channel's place in the sound, {k}"
                report.error("ORDER", ((None, "channels"), k), message)
    return report.findings


def facts(path: Path) -> dict[str, Any]:
    """Device or layout, rate and channel count of a valid file for ``hfx info``."""
    document = parse(read_bytes(path), str(path))
    origin = {key: document[key] for key in ("device", "body", "layout") if key in document}
    return {**origin, "rate_hz": document["rate_hz"], "channels": len(document["channels"])}
