# SPDX-License-Identifier: GPL-3.0-or-later
"""Invalid input of the track writer, and the fields of a header."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from track_synthetic import header, run

from hfx_blender.engine.samples import Stream
from hfx_blender.engine.scene import (
    BodyDescription,
    Clip,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.track import TrackBody, TrackHeader, TrackModel, TrackReader, TrackWriter
from hfx_blender.engine.track import writer as track_writer
from hfx_blender.engine.volume.shape import Falloff
from hfx_blender.errors import OutputError

HEADER = header(sample_count=300, vertex_count=50)
GOOD = run(HEADER, 0, [4, 5], [[1, 3], [3, 9]], [[0.5, 1.0], [1.0, 0.1]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"indices": np.array([5, 4])}, "ascend"),
        ({"indices": np.array([-1, 4])}, "ascend"),
        ({"indices": np.array([4, 300])}, "outside the time base"),
        ({"times_s": GOOD.times_s + 1e-3}, "times differ"),
        ({"levels": np.array([0.0, 1.0])}, "level"),
        ({"levels": np.array([np.nan, 1.0])}, "level"),
        ({"levels": np.array([1.0])}, "unequal length"),
        ({"parameters": np.ones((2, 1))}, "unequal length"),
        ({"parameters": np.full((2, 2), np.inf)}, "not finite"),
        ({"offsets": np.array([0, 2, 3])}, "offsets"),
        ({"offsets": np.array([0, 5, 4])}, "offsets"),
        ({"vertices": np.array([3, 1, 3, 9])}, "do not ascend"),
        ({"vertices": np.array([1, 1, 3, 9])}, "do not ascend"),
        ({"vertices": np.array([-1, 3, 3, 9])}, "not in the model"),
        ({"vertices": np.array([1, 3, 3, 50])}, "not in the model"),
        ({"weights": np.array([0.0, 1, 1, 1])}, "weights"),
        ({"weights": np.array([1.1, 1, 1, 1])}, "weights"),
        ({"weights": np.array([np.nan, 1, 1, 1])}, "weights"),
        ({"weights": np.ones(3)}, "weights"),
        ({"depth_m": np.full(4, np.nan)}, "depth_m"),
        ({"positions": np.zeros((4, 2))}, "positions"),
        ({"stream": Stream("e0", "nobody", "vibration", "m")}, "not a stream"),
    ],
)
def test_runs_that_break_their_promise(tmp_path, change, message):
    with pytest.raises(ValueError, match=message), TrackWriter(tmp_path / "a", HEADER) as writer:
        writer.append([replace(GOOD, **change)])
    assert list(tmp_path.iterdir()) == []


def test_samples_that_come_too_late(tmp_path):
    def at(stream, index):
        return run(HEADER, stream, [index], [[1]], [[1.0]])

    for blocks in (
        [[at(0, 5)], [at(0, 5)]],
        [[at(0, 5)], [at(0, 4)]],
        [[at(0, 200)], [at(0, 280)], [at(1, 100)]],
    ):
        with pytest.raises(ValueError, match="after later ones"):
            with TrackWriter(tmp_path / "a", HEADER) as writer:
                for block in blocks:
                    writer.append(block)


def test_channels_change_within_a_chunk(tmp_path):
    with pytest.raises(ValueError, match="channels change"):
        with TrackWriter(tmp_path / "a", HEADER) as writer:
            writer.append([GOOD])
            deeper = run(HEADER, 0, [6], [[1]], [[1.0]], depth_m=np.zeros(1, np.float32))
            writer.append([deeper])


def test_more_contacts_than_a_reader_can_hold(tmp_path, monkeypatch):
    for name in ("MAX_ENTRIES", "MAX_SET_ENTRIES"):
        with monkeypatch.context() as patch:
            patch.setattr(track_writer.codec, name, 1)  # of the 2 in each sample
            with pytest.raises(OutputError, match="one sample than a track holds"):
                with TrackWriter(tmp_path / "a", HEADER) as writer:
                    writer.append([GOOD])
            assert list(tmp_path.iterdir()) == []


def test_later_changes_of_input_arrays_have_no_effect(tmp_path):
    with TrackWriter(tmp_path / "a", HEADER, full_precision=True) as writer:
        mine = run(HEADER, 0, [4, 5], [[1, 3], [3, 9]], [[0.5, 1.0], [1.0, 0.1]])
        writer.append([mine])
        for array in (mine.vertices, mine.weights, mine.levels, mine.parameters):
            array[:] = 0
    with TrackReader(tmp_path / "a") as reader:
        (actual,) = reader.runs()
    assert actual.vertices.tolist() == [1, 3, 3, 9]
    assert actual.weights.tobytes() == GOOD.weights.tobytes()


@pytest.mark.parametrize("settings", [{"a": float("nan")}, {"a": object()}, {"a": {1, 2}}])
def test_settings_that_are_not_json(tmp_path, settings):
    with pytest.raises(ValueError), TrackWriter(tmp_path / "a", replace(HEADER, settings=settings)):
        pass
    assert list(tmp_path.iterdir()) == []


class Model(SimpleNamespace):
    """Stand-in for a perceptual model in a header."""

    def __len__(self):
        return self.size


def test_header_of_a_scene():
    bodies = (
        BodyDescription("anna", "Anna", SkinBinding(())),
        BodyDescription("bert", "Bert", SkinBinding(())),
    )
    area = PaintedArea("bert", np.array([1, 5], np.int32), np.ones(2, np.float32))
    scene = SceneDescription(
        TimeBase(Fraction(24), Fraction(100), 1, 1, 24),
        bodies,
        (
            EffectDescription("f", "Fire", "temperature", "t-1", HapticVolume(Falloff())),
            EffectDescription("k", "Knock", "wind", "p-1", area, False, (Clip("knock", 3.0, 5.0),)),
        ),
        source={"name": "a.blend"},
        warnings=("careful",),
    )
    models = {
        "t-1": Model(modality="temperature", content_hash="aa", size=700),
        "p-1": Model(modality="pressure", content_hash="bb", size=9000),
        "v-1": Model(modality="vibration", content_hash="cc", size=45000),
    }
    track_header = TrackHeader.of(scene, models, settings={"rate": 100}, tools={"hfx": "1"})
    assert track_header.models == (
        TrackModel("t-1", "temperature", "aa", 700),
        TrackModel("p-1", "pressure", "bb", 9000),
    )
    assert track_header.bodies == (TrackBody("anna", "Anna"), TrackBody("bert", "Bert"))
    assert [(s.effect_id, s.body_id, s.modality, s.model_id) for s in track_header.streams] == [
        ("f", "anna", "temperature", "t-1"),
        ("f", "bert", "temperature", "t-1"),
        ("k", "bert", "wind", "p-1"),
    ]
    assert [(e.kind, e.painted_vertices, e.clips) for e in track_header.effects] == [
        ("volume", None, ()),
        ("painted", 2, (Clip("knock", 3.0, 5.0),)),
    ]
    assert (track_header.source, track_header.warnings) == ({"name": "a.blend"}, ("careful",))
