# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart of a track: well-formed SVG with felt and played strengths over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any
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
from hfx_tools import charts
from hfx_tools.demo import demo_charts

SVG = "{http://www.w3.org/2000/svg}"
ROW = 0.8  # height of a full level


def _track(
    folder: Path,
    felt: tuple[int, ...],
    *,
    count: int = 100,
    rate_hz: int = 100,
    first_frame: int = 0,
    name: str = "Rain",
) -> TrackReader:
    """Write a track with one effect, at level 0.5 on two vertices at the given samples."""
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
    """Return a device with as many pressure actuators as columns, at 100 Hz."""
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


Drawn = Callable[..., Any]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawn:
    """Draw a track and rasters into a file; returns matplotlib's axes."""
    figures: list[Any] = []

    @contextmanager
    def chart(*arguments: Any) -> Iterator[Any]:
        with charts.chart(*arguments) as figure:
            figures.append(figure)
            yield figure

    def draw(track: TrackReader, rasters: tuple[Raster, ...], path: Path) -> Any:
        with track:
            demo_charts.draw_track(track, rasters, path)
        return figures[-1].axes[0]

    monkeypatch.setattr(demo_charts, "chart", chart)
    return draw


def _texts(path: Path) -> list[str]:
    return [text.text or "" for text in ElementTree.parse(path).iter(f"{SVG}text")]


def _ticks(axes: Any) -> dict[str, float]:
    """Return visible labels of the time axis, and the labels' times."""
    first, last = axes.get_xlim()
    return {
        label.get_text(): float(at)
        for at, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
        if first <= at <= last
    }


def _outline(axes: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the drawn area of the first effect: edge times, and heights between the edges."""
    values, edges, bottom = axes.patches[0].get_data()
    return edges, (values - bottom) / ROW


def test_an_effect_is_drawn_at_its_contact_times(tmp_path: Path, drawn: Drawn) -> None:
    # Contact from 0.2 s to 0.3 s of one second, at half of the full level.
    axes = drawn(_track(tmp_path, tuple(range(20, 30))), (), tmp_path / "x.svg")
    edges_s, heights = _outline(axes)
    np.testing.assert_allclose(edges_s, [0.0, 0.2, 0.3, 1.0], atol=1e-9)
    np.testing.assert_allclose(heights, [0.0, 0.5, 0.0], atol=1e-9)
    assert {"Rain", "pressure, up to 2 vertices"} <= set(_texts(tmp_path / "x.svg"))


def test_a_sample_lasts_until_the_next(tmp_path: Path, drawn: Drawn) -> None:
    # Ten samples of contact on 480 columns form a single area without gaps.
    _, heights = _outline(drawn(_track(tmp_path, tuple(range(10)), count=10), (), tmp_path / "x"))
    np.testing.assert_allclose(heights, [0.5])


def test_one_short_sample_of_a_long_track_is_seen(tmp_path: Path, drawn: Drawn) -> None:
    track = _track(tmp_path, (54_321,), count=100_000)
    edges_s, heights = _outline(drawn(track, (), tmp_path / "x.svg"))
    middles_s = (edges_s[:-1] + edges_s[1:]) / 2
    assert middles_s[heights > 0] == pytest.approx([543.21], abs=1000 / 480)


def test_an_effect_without_contacts_has_an_empty_row(tmp_path: Path, drawn: Drawn) -> None:
    _, heights = _outline(drawn(_track(tmp_path, ()), (), tmp_path / "x.svg"))
    assert (heights == 0).all()
    assert "pressure, up to 0 vertices" in _texts(tmp_path / "x.svg")


def test_a_device_shows_each_actuator_against_the_strongest(tmp_path: Path, drawn: Drawn) -> None:
    values = np.full((100, 3), 1.0)
    values[50:, 1] = 5.0  # neutral is 1: plays 4 from 0.5 s on
    values[:, 2] = 2.0  # plays 1, a quarter of the maximum, all the time
    axes = drawn(_track(tmp_path, ()), (_raster(values, neutral=1.0),), tmp_path / "x.svg")
    assert {"pad", "3 actuators"} <= set(_texts(tmp_path / "x.svg"))
    (image,) = axes.images
    shares = image.get_array()
    assert image.get_extent()[:2] == [0.0, 1.0] and shares.shape == (3, 480)
    np.testing.assert_allclose(shares[:, :240], np.tile([[0.0], [0.0], [0.25]], 240))
    np.testing.assert_allclose(shares[:, 240:], np.tile([[0.0], [1.0], [0.25]], 240))


def test_the_time_axis_has_round_labels_at_their_places(tmp_path: Path, drawn: Drawn) -> None:
    ticks = _ticks(drawn(_track(tmp_path, (), count=1550), (), tmp_path / "x.svg"))
    assert ticks == {f"{k} s": k for k in range(16)}


def test_times_before_the_scene_begins_are_labelled_too(tmp_path: Path, drawn: Drawn) -> None:
    axes = drawn(_track(tmp_path, (), count=155, first_frame=-105), (), tmp_path / "x.svg")
    ticks = _ticks(axes)
    # matplotlib formats the minus sign
    assert next(iter(ticks)) == "-1 s" and "0 s" in ticks and "0.4 s" in ticks
    assert all(len(label) <= 6 for label in ticks), ticks


@pytest.mark.parametrize("count", [1, 5, 100, 6_000, 360_000, 36_000_000])
def test_every_length_has_a_readable_axis(tmp_path: Path, drawn: Drawn, count: int) -> None:
    ticks = _ticks(drawn(_track(tmp_path, (), count=count), (), tmp_path / "x.svg"))
    assert 1 <= len(ticks) <= 21
    shares = np.diff(list(ticks.values())) / (count / 100)
    assert (shares > 1 / 25).all()


@pytest.mark.parametrize(
    "name", ["<&>\"'", "Regen \u96e8", "bell\x07", "B\u00e4r\udc80", "]]>", "$x^2$", "a$"]
)
def test_any_name_makes_well_formed_xml(
    tmp_path: Path, drawn: Drawn, name: str, recwarn: pytest.WarningsRecorder
) -> None:
    drawn(_track(tmp_path, (3,), name=name), (_raster(np.zeros((100, 1))),), tmp_path / "x.svg")
    escaped = {"bell\x07": "bell\\x07", "B\u00e4r\udc80": "B\u00e4r\\udc80"}
    assert escaped.get(name, name) in _texts(tmp_path / "x.svg")
    assert not recwarn.list


def test_the_same_bytes_every_time_and_nothing_half_written(tmp_path: Path) -> None:
    rasters = (_raster(np.eye(100)[:, :4]),)
    for name in ("a.svg", "b.svg"):
        with _track(tmp_path, (1, 2, 50)) as track:
            demo_charts.draw_track(track, rasters, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    with _track(tmp_path, ()) as track, pytest.raises(OutputError, match=r"none/x\.svg"):
        demo_charts.draw_track(track, (), tmp_path / "none" / "x.svg")


def test_settings_of_the_user_change_nothing(tmp_path: Path) -> None:
    import matplotlib

    with _track(tmp_path, (1,)) as track:
        demo_charts.draw_track(track, (), tmp_path / "a.svg")
        with matplotlib.rc_context({"text.usetex": True, "svg.fonttype": "path", "font.size": 30}):
            demo_charts.draw_track(track, (), tmp_path / "b.svg")
            assert matplotlib.rcParams["font.size"] == 30
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
