# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of an export are readable, at and beyond each limit of the readers."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from format_cases import raster_for
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from test_hjif import track_of

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.files import limits
from hfx_blender.files.limits import Limit
from hfx_blender.formats import writing
from hfx_blender.formats.files import format_of, without_invalid_files
from hfx_blender.formats.rasters import npz_raster
from hfx_blender.formats.registry import FORMATS
from hfx_tools.commands.played_clip import PlayedClip
from hfx_tools.formats import npz_reader
from hfx_tools.formats.validation import validate

DEVICE = load_device("phone_lra")  # one vibration actuator: 2 columns and the times
OF_DEVICES = tuple(id for id in FORMATS if id not in ("track", "glb"))
SHORT_S = 7.0
RATE_HZ = 50


def _written(folder: Path, rows: int, formats=OF_DEVICES):
    """Export a scene with one effect; return written files and reasons for omitted files."""
    raster = replace(raster_for(DEVICE, rows=rows, rate_hz=Fraction(RATE_HZ)), body_id="b")
    with track_of(folder, "vibration", "painted", [1.0] * rows, fps=Fraction(RATE_HZ)) as track:
        return without_invalid_files(
            writing.write_all(
                formats, [(folder / "a", DEVICE, raster)], track, (DEVICE,), folder / "a"
            )
        )


def _assert_readable(path: Path) -> None:
    info, findings = validate(path)
    # A mesh beyond the limit is left out, and the export reports this.
    errors = [finding.code for finding in findings if finding.severity == "error"]
    assert [code for code in errors if not code.endswith("-MESH")] == [], path
    if info.facts:
        info.function("facts")(path)
    if info.id == "clip":
        PlayedClip(path, {"phone": DEVICE})


@settings(max_examples=15, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    rows=st.integers(300, 400),
    most_bytes=st.one_of(st.integers(7000, 10_500), st.integers(10_000, 60_000)),
)
def test_written_files_are_readable_at_and_beyond_each_limit(
    tmp_path_factory: pytest.TempPathFactory, rows: int, most_bytes: int
) -> None:
    """300 to 400 rows last 6 to 8 s, at a limit of 7; 3 numbers a row take 7200 to 9600 bytes."""
    load_model("hfx-vibration-1")  # before limits are lowered
    folder = tmp_path_factory.mktemp("limits")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limits, "SECONDS", Limit(SHORT_S, "s"))
        patch.setattr(limits, "MEMORY", Limit(float(most_bytes), "bytes"))
        written = _written(folder, rows)
        for path in written.files:
            _assert_readable(path)
        ids = {format_of(path).id for path in written.files}
    seconds = rows / RATE_HZ
    assert ("haptic" in ids) == (seconds <= SHORT_S)
    assert not ("npz" in ids and 24 * rows > most_bytes)
    text = " ".join(written.left_out)
    for id in ("csv", "npz", "hjif", "clip", "haptic", "jsonl"):
        assert id in ids or FORMATS[id].title in text or f"a{FORMATS[id].suffix}" in text, id


def test_a_highly_compressed_silent_raster_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = 20_000  # two constant columns: packed about 30 times, as are the times
    monkeypatch.setattr(limits, "PACKING", 10.0)
    monkeypatch.setattr(limits, "UNPACKED", Limit(8.0 * rows, "bytes"))
    path = tmp_path / "a.raster.npz"
    npz_raster.write(raster_for(DEVICE, np.zeros((rows, 2)), rows=rows), path)
    assert path.stat().st_size < 24 * rows / 10
    assert len(npz_reader.read(path).times_s) == rows
