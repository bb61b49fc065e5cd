# SPDX-License-Identifier: GPL-3.0-or-later
"""The chart of a track: well-formed SVG that shows what was felt and played, and when."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import (
    TrackBody,
    TrackEffect,
    TrackHeader,
    TrackModel,
    TrackReader,
    TrackWriter,
)
from hfx_blender.errors import OutputError
from hfx_tools import chart_svg

SVG = "{http://www.w3.org/2000/svg}"
LEFT, WIDTH = chart_svg._LEFT, chart_svg._WIDTH  # of the plot in the picture


def _track(
    folder: Path,
    felt: tuple[int, ...],
    *,
    count: int = 100,
    rate_hz: int = 100,
    first_frame: int = 0,
    name: str = "Rain",
) -> TrackReader:
    """A track with one effect, felt on two vertices at these samples with level 0.5."""
    time = TimeBase(Fraction(rate_hz), Fraction(rate_hz), 0, first_frame, first_frame + count - 1)
    stream = Stream("e", "b", "pressure", "m")
    header = TrackHeader(
        time=time,
        models=(TrackModel("m", "pressure", "0" * 64, 10),),
        bodies=(TrackBody("b", "Anna"),),
        effects=(TrackEffect("e", name, "pressure", "volume", "m"),),
        streams=(stream,),
    )
    path = folder / "x.hfxtrack"
    with TrackWriter(path, header) as writer:
        if felt:
            indices = np.array(felt, np.int64)
            run = SampleRun(
                stream=stream,
                indices=indices,
                times_s=time.times_s(indices),
                levels=np.full(len(felt), 0.5),
                parameters=np.full((len(felt), 1), 5.0),
                offsets=np.arange(len(felt) + 1, dtype=np.int64) * 2,
                vertices=np.tile(np.int32([3, 4]), len(felt)),
                weights=np.ones(2 * len(felt), np.float32),
            )
            writer.append([run])
    return TrackReader(path)


def _raster(values: np.ndarray, neutral: float = 0.0) -> Raster:
    """A device with as many pressure actuators as there are columns, at 100 Hz."""
    count = values.shape[1]
    names = tuple(f"a{k}" for k in range(count))
    return Raster(
        device_id="pad",
        body_id="b",
        actuators=names,
        columns=tuple(Column(name, "pressure_kpa", "kPa") for name in names),
        times_s=np.arange(len(values)) / 100,
        rate_hz=Fraction(100),
        values=values,
        neutral=np.full(count, neutral),
        shortfalls=(),
        felt=(),
    )


def _drawn(track: TrackReader, rasters: tuple[Raster, ...], path: Path) -> ElementTree.Element:
    with track:
        chart_svg.write(track, rasters, path)
    return ElementTree.parse(path).getroot()


def _texts(picture: ElementTree.Element) -> list[str]:
    return [text.text or "" for text in picture.iter(f"{SVG}text")]


def _ticks(picture: ElementTree.Element) -> dict[str, float]:
    """Positions of the time axis's labels."""
    return {
        text.text or "": float(text.get("x", "nan"))
        for text in picture.iter(f"{SVG}text")
        if text.get("text-anchor") == "middle"
    }


def _outline(picture: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """The drawn area of the first effect: x, and height above the base line."""
    polygon = next(picture.iter(f"{SVG}polygon"))
    points = [[float(n) for n in each.split(",")] for each in polygon.get("points", "").split()]
    x, y = np.array(points).T
    return x, y[0] - y


def test_an_effect_is_drawn_when_it_was_felt(tmp_path: Path) -> None:
    # Felt from 0.2 s to 0.3 s of one second, at half of the full level.
    picture = _drawn(_track(tmp_path, tuple(range(20, 30))), (), tmp_path / "x.svg")
    x, height = _outline(picture)
    seen = x[height > 0]
    assert seen.min() == pytest.approx(LEFT + 0.2 * WIDTH, abs=0.1)
    assert seen.max() == pytest.approx(LEFT + 0.3 * WIDTH, abs=0.1)
    full = 46 - 10
    assert set(np.round(height, 6)) == {0.0, full / 2}
    assert "Rain" in _texts(picture)
    assert "pressure, up to 2 vertices" in _texts(picture)


def test_a_sample_lasts_until_the_next(tmp_path: Path) -> None:
    # Ten samples on 480 columns: all of them felt is one area without gaps.
    picture = _drawn(_track(tmp_path, tuple(range(10)), count=10), (), tmp_path / "x.svg")
    _, height = _outline(picture)
    assert (height[1:-1] > 0).all()


def test_one_short_sample_of_a_long_track_is_seen(tmp_path: Path) -> None:
    picture = _drawn(_track(tmp_path, (54_321,), count=100_000), (), tmp_path / "x.svg")
    x, height = _outline(picture)
    assert x[height > 0].mean() == pytest.approx(LEFT + 0.54321 * WIDTH, abs=2.0)


def test_what_nobody_felt_has_an_empty_row(tmp_path: Path) -> None:
    picture = _drawn(_track(tmp_path, ()), (), tmp_path / "x.svg")
    assert (_outline(picture)[1] == 0).all()
    assert "pressure, up to 0 vertices" in _texts(picture)


def test_a_device_shows_each_actuator_against_the_strongest(tmp_path: Path) -> None:
    values = np.full((100, 3), 1.0)
    values[50:, 1] = 5.0  # neutral is 1: plays 4 from 0.5 s on
    values[:, 2] = 2.0  # plays 1, a quarter of that, all the time
    picture = _drawn(_track(tmp_path, ()), (_raster(values, neutral=1.0),), tmp_path / "x.svg")
    assert "pad" in _texts(picture) and "3 actuators" in _texts(picture)
    rows = [each for each in picture.iter(f"{SVG}rect") if each.get("fill-opacity")]
    facts = [
        (float(r.get("x", 0)), float(r.get("width", 0)), float(r.get("fill-opacity", 0)))
        for r in rows
    ]
    assert facts == [(LEFT + WIDTH / 2, WIDTH / 2, 1.0), (LEFT, WIDTH, 0.25)]
    assert float(rows[0].get("y", 0)) < float(rows[1].get("y", 0))


def test_the_time_axis_has_round_labels_at_their_places(tmp_path: Path) -> None:
    picture = _drawn(_track(tmp_path, (), count=1550), (), tmp_path / "x.svg")
    ticks = _ticks(picture)
    assert list(ticks) == [f"{k} s" for k in range(16)]
    assert ticks["7 s"] == pytest.approx(LEFT + 7 / 15.5 * WIDTH, abs=0.1)


def test_times_before_the_scene_begins_are_labelled_too(tmp_path: Path) -> None:
    picture = _drawn(_track(tmp_path, (), count=155, first_frame=-105), (), tmp_path / "x.svg")
    ticks = _ticks(picture)
    assert next(iter(ticks)) == "-1 s" and "0 s" in ticks and "-0.3 s" in ticks
    assert all(len(label) <= 6 for label in ticks), ticks


@pytest.mark.parametrize("count", [1, 5, 100, 6_000, 360_000, 36_000_000])
def test_every_length_has_a_readable_axis(tmp_path: Path, count: int) -> None:
    picture = _drawn(_track(tmp_path, (), count=count), (), tmp_path / "x.svg")
    places = list(_ticks(picture).values())
    assert 1 <= len(places) <= 21
    assert (np.diff(places) > 40).all()


@pytest.mark.parametrize("name", ["<&>\"'", "Regen \u96e8", "bell\x07", "B\u00e4r\udc80", "]]>"])
def test_any_name_makes_well_formed_xml(tmp_path: Path, name: str) -> None:
    track = _track(tmp_path, (3,), name=name)
    texts = _texts(_drawn(track, (_raster(np.zeros((100, 1))),), tmp_path / "x.svg"))
    shown = "".join(each if each.isprintable() else "?" for each in name)
    assert shown in texts


def test_the_same_bytes_every_time_and_nothing_half_written(tmp_path: Path) -> None:
    rasters = (_raster(np.eye(100)[:, :4]),)
    for name in ("a.svg", "b.svg"):
        _drawn(_track(tmp_path, (1, 2, 50)), rasters, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    with _track(tmp_path, ()) as track, pytest.raises(OutputError, match=r"none/x\.svg"):
        chart_svg.write(track, (), tmp_path / "none" / "x.svg")
