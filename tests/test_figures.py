# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures in the documentation agree with the code."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.host import device_thread, host
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.files import json_shapes, limits, resources, strict_json
from hfx_blender.formats.device_files import (
    ahap,
    ahap_rules,
    haptic,
    he,
    he_rules,
    openxr,
    tact,
)
from hfx_blender.formats.hjif import envelopes, semantics
from hfx_blender.formats.sound import wav, waveforms
from hfx_tools.export_workers import local_workers
from hfx_tools.formats import signal_raster
from hfx_tools.spatial_sound import hearing, loudspeakers

DOCS = Path(__file__).resolve().parents[1] / "docs"
CLIPS = DOCS.parent / "players" / "conformance"


def _range(of: Any) -> tuple[float, float]:
    return of.lowest_hz, of.highest_hz


def _air_db() -> float:
    return round(float(8.0 * hearing.absorption_db_m(np.array([880.0]))[0]), 2)


FIGURES: tuple[tuple[str, str, Callable[[], Any]], ...] = (
    ("body-models.md", r"\*\*Pressure\*\*, (\S+) vert", lambda: len(load_model("hfx-pressure-1"))),
    (
        "body-models.md",
        r"\*\*Vibration\*\*, (\S+) vert",
        lambda: len(load_model("hfx-vibration-1")),
    ),
    ("body-models.md", r"Temperature has (\S+) vert", lambda: len(load_model("hfx-temperature-1"))),
    (
        "following-an-avatar.md",
        r"vibration model, (\S+) vertices",
        lambda: len(load_model("hfx-vibration-1")),
    ),
    ("formats/index.md", r"(\d+) to (\d+) Hz for AHAP", lambda: _range(ahap.DEFAULT_RANGE)),
    ("formats/index.md", r"(\d+) to (\d+) Hz for \.haptic", lambda: _range(haptic.DEFAULT_RANGE)),
    ("formats/index.md", r"(\d+) to (\d+) Hz for \.he\b", lambda: _range(he.DEFAULT_RANGE)),
    (
        "formats/index.md",
        r"at most (\d+) s, parameter curves of at most (\d+) points",
        lambda: (ahap_rules.MAX_EVENT_S, ahap_rules.MAX_CURVE_POINTS),
    ),
    (
        "formats/index.md",
        r"events of at most (\d+) points and (\d+) s .*, up to (\d+) a pattern",
        lambda: (
            he_rules.MAX_CURVE_POINTS,
            he_rules.MAX_DURATION_MS / 1000,
            he_rules.MAX_PATTERN_EVENTS,
        ),
    ),
    ("formats/index.md", r"at most (\d+) points, times in nanosec", lambda: openxr.MAX_POINTS),
    (
        "formats/index.md",
        r"references of HJIF stand for \| (\S+) \|",
        lambda: limits.UNFOLDED.default,
    ),
    ("formats/index.md", r"for each event \| (\S+) \|", lambda: limits.OVERLAP.default),
    (
        "formats/index.md",
        r"(\d+) MiB, or (\d+) times its own",
        lambda: (limits.UNPACKED.default / 2**20, limits.PACKING),
    ),
    (
        "formats/index.md",
        r"JSON \| (\d+) MiB; a device, a path or a layout (\d+) MiB",
        lambda: (strict_json.MAX_BYTES / 2**20, json_shapes.MAX_OWN_BYTES / 2**20),
    ),
    (
        "formats/index.md",
        r"(\d+) values a second; ticks are bursts that fade over (\d+) ms",
        lambda: (signal_raster.RATE_HZ, 1000 * signal_raster.TICK_S),
    ),
    (
        "formats/index.md",
        r"holds (\d+) events within (\d+) s, .* variant holds (\d+) events and (\d+) KiB",
        lambda: (
            he_rules.MAX_PATTERN_EVENTS,
            he_rules.MAX_RELATIVE_MS / 1000,
            he_rules.OPENHARMONY_MAX_EVENTS,
            he_rules.OPENHARMONY_MAX_BYTES / 2**10,
        ),
    ),
    ("formats/index.md", r"Strengths change every (\d+) ms", lambda: tact.INTERVAL_MS),
    ("formats/index.md", r"a channel an actuator, (\d+) kHz", lambda: wav.RATE_HZ / 1000),
    (
        "formats/hjif.md",
        r"averaged over (\d+) ms, its frequency .* over (\d+) ms, (\d+) values a second",
        lambda: (
            1000 * waveforms.AMPLITUDE_S,
            1000 * waveforms.FREQUENCY_S,
            waveforms.ROWS_HZ,
        ),
    ),
    # 600 is the smallest tick rate with whole ticks for 24 frames and 100 samples a second.
    ("formats/hjif.md", r"\((\d+) s at 24 frames and 100 s", lambda: envelopes.MAX_POSITION // 600),
    ("formats/hjif.md", r"level 1 up to (\d+) channels", lambda: semantics.MAX_CHANNELS[1]),
    (
        "players/testing.md",
        r"holds (\d+) clips with the values",
        lambda: len([*CLIPS.glob("*.hfxclip")]),
    ),
    ("formats/index.md", r"at a time \| (\d+) GiB", lambda: limits.MEMORY.default / 2**30),
    (
        "device-configuration.md",
        r"at most (\d+) MiB of UTF-8, nested at most (\d+) deep",
        lambda: (json_shapes.MAX_OWN_BYTES / 2**20, json_shapes.MAX_OWN_DEPTH),
    ),
    ("batch.md", r"replaced after (\d+) pieces", lambda: local_workers.RENEW_AFTER),
    ("live.md", r"a frame takes longer \| (\d+) ms", lambda: 1000 * host.HEARTBEAT_S),
    (
        "live.md",
        r"values of a device expire (\d+) ms",
        lambda: 1000 * device_thread.FREEZE_S,
    ),
    ("belt-demo.md", r"At most (\d+) loudspeakers", lambda: loudspeakers.MAX_LOUDSPEAKERS),
    (
        "belt-demo.md",
        r"distances of ([0-9.]+) to (\d+) m\.",
        lambda: (1.0 / hearing.FARTHEST_M, hearing.FARTHEST_M),
    ),
    ("belt-demo.md", r"air takes ([0-9.]+) dB from 880 Hz", _air_db),
    (
        "belt-demo.md",
        r"reference distance \(`--reference`, (\d+) m",
        lambda: _hearing().reference_m,
    ),
    ("belt-demo.md", r"`--audible`, (\d+) m", lambda: _hearing().audible_m),
)


def _hearing() -> hearing.Hearing:
    return hearing.Hearing()


@pytest.mark.parametrize(
    ("page", "pattern", "known"),
    FIGURES,
    ids=lambda each: None if callable(each) else str(each)[:30],
)
def test_a_figure_is_the_codes(page: str, pattern: str, known: Callable[[], Any]) -> None:
    matches = re.findall(pattern, (DOCS / page).read_text(encoding="utf-8"))
    assert len(matches) == 1, "the sentence is there once"
    texts = matches[0] if isinstance(matches[0], tuple) else matches
    printed = [float(text.replace(",", "")) for text in texts]
    values = known() if isinstance(known(), tuple) else (known(),)
    assert printed == [float(value) for value in values]


def test_each_shipped_device_and_modality_is_on_its_page() -> None:
    page = (DOCS / "devices.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| \S.*\|.*\|.*\|.*\|", page, re.MULTILINE)
    names = {path.stem for path in resources.device_configs().glob("*.json")}
    assert set(listed) == {re.sub(r"_(left|right)$", "", name) for name in names}
    text = (DOCS / "formats" / "index.md").read_text(encoding="utf-8")
    assert "all four modalities" in text and len(MODALITIES) == 4
