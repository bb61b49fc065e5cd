# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound in real time: the offline mix at a constant pose, and no click of a turning head."""

from __future__ import annotations

import sys
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hfx_blender.errors import InputError
from hfx_tools.live_body.avatar_pose import AvatarPose
from hfx_tools.live_body.live_sound import BLOCK, LiveSound
from hfx_tools.spatial_sound.hearing import Hearing
from hfx_tools.spatial_sound.live_mix import LiveMix
from hfx_tools.spatial_sound.loudspeakers import LAYOUTS, Panner
from hfx_tools.spatial_sound.sound_settings import SoundSettings
from hfx_tools.spatial_sound.spatial_mix import Reverberators, SoundSource, SpatialMix

RATE_HZ = 48_000
TONES_HZ = np.array([220.0, 277.3])


@pytest.mark.parametrize(("name", "air"), [("stereo", 0.0), ("ring8", 100.0)])
def test_a_constant_pose_sounds_as_the_offline_mix(name: str, air: float) -> None:
    layout = LAYOUTS[name]
    panner = Panner(layout, Hearing(air=air))
    places, amplitudes = np.array([[1.0, 0.5, 0.0], [-2.0, 1.0, 0.3]]), np.array([0.5, 0.2])

    def reverberators() -> Reverberators:
        return Reverberators(len(layout), RATE_HZ, 0.3, BLOCK)

    sources = [
        SoundSource("", np.tile(place, (100, 1)), np.full(100, amplitude), np.full(100, tone))
        for place, amplitude, tone in zip(places, amplitudes, TONES_HZ, strict=True)
    ]
    offline = SpatialMix(sources, panner, reverberators(), Fraction(50), RATE_HZ)
    expected = np.concatenate(list(offline.blocks(8 * BLOCK)))
    live = LiveMix(TONES_HZ, panner, reverberators(), RATE_HZ, BLOCK)
    actual = np.concatenate([live.block(places, amplitudes) for _ in range(8)])
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(actual, expected, atol=1e-9)


def test_a_turning_head_makes_no_click() -> None:
    """Each loudspeaker's step is at most that of its sine, 2 pi f A / rate, and of its gain, which
    changes by at most 1 in a block."""
    layout = LAYOUTS["quad"]
    # Within an eighth of the reference distance the sound is nearly dry.
    panner = Panner(layout, Hearing(reference_m=1000.0, audible_m=1000.0, spread_m=0.01))
    mix = LiveMix(TONES_HZ[:1], panner, Reverberators(4, RATE_HZ, 0.01), RATE_HZ, BLOCK)
    blocks = []
    for step in range(40):  # a turn in 12 blocks, a quarter of a second
        angle = 2.0 * np.pi * step / 12
        place = np.array([[np.cos(angle), np.sin(angle), 0.0]])
        blocks.append(mix.block(place, np.ones(1)))
    signal = np.concatenate(blocks)
    largest = np.abs(np.diff(signal, axis=0)).max()
    dry_step = 2.0 * np.pi * 220.0 / RATE_HZ + 1.0 / BLOCK
    assert np.abs(signal).max() > 0.9
    assert largest <= dry_step * 1.01
    within = np.abs(np.diff(signal, axis=0))
    borders = within[BLOCK - 1 :: BLOCK]
    assert borders.max() <= within.max()


def test_a_lost_place_fades_within_a_block() -> None:
    panner = Panner(LAYOUTS["stereo"], Hearing())
    mix = LiveMix(TONES_HZ[:1], panner, Reverberators(2, RATE_HZ, 0.001), RATE_HZ, BLOCK)
    mix.block(np.array([[1.0, 0.0, 0.0]]), np.ones(1))
    fading = np.abs(mix.block(np.full((1, 3), np.nan), np.ones(1)))
    assert fading[:200].max() > 0.3 and fading[-200:].max() < 0.2
    silent = mix.block(np.full((1, 3), np.nan), np.ones(1))
    assert np.abs(silent[500:]).max() < 1e-6


def test_the_listener_is_the_head_of_the_avatar() -> None:
    """Hips at 1 m and head at 1.6 m; a body faces -Y, so a place in front is at -Y."""
    bones = [("hips", -1, 0.0, 1.0), ("head", 0, 0.0, 1.6), ("leftUpperLeg", 0, 0.1, 0.9)]
    bones += [("rightUpperLeg", 0, -0.1, 0.9)]
    rest = np.zeros((4, 3, 4))
    rest[:, :, :3] = np.eye(3)
    rest[:, 0, 3], rest[:, 2, 3] = [b[2] for b in bones], [b[3] for b in bones]
    pose = AvatarPose([b[0] for b in bones], [b[1] for b in bones], rest)
    matrices = rest.copy()
    matrices[:, :, 3] = 0.0  # at rest
    front = pose.listener(matrices) @ [0.0, -2.0, 1.6, 1.0]
    assert front == pytest.approx([2.0, 0.0, 0.0])
    # The head turns left by 90 degrees about its joint: what was in front is on the right.
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    matrices[1, :, :3] = turn
    assert pose.listener(matrices) @ [0.0, -2.0, 1.6, 1.0] == pytest.approx([0.0, -2.0, 0.0])


def test_blocks_reach_the_sound_card(monkeypatch: pytest.MonkeyPatch) -> None:
    streams: list[Any] = []

    class Stream:
        def __init__(self, **options: Any) -> None:
            self.options, self.is_open = options, True
            streams.append(self)

        def start(self) -> None: ...

        def abort(self) -> None:
            self.is_open = False

        def close(self) -> None: ...

    monkeypatch.setitem(sys.modules, "sounddevice", SimpleNamespace(OutputStream=Stream))
    bodies: Any = SimpleNamespace(
        volumes=[4], sources=lambda now_s, tone, touch: (np.array([[0.0, 1.0, 0.0]]), np.ones(1))
    )
    sound = LiveSound(bodies, SoundSettings())
    (stream,) = streams
    assert stream.options["channels"] == 2 and stream.options["blocksize"] == BLOCK
    out = np.ones((BLOCK, 2), np.float32)
    stream.options["callback"](out, BLOCK, None, None)
    assert not out.any(), "silent before the first pose"
    bodies.heard(0.0)
    for _ in range(2):
        stream.options["callback"](out, BLOCK, None, None)
    # A source on the left; the wet part is on both sides.
    assert np.abs(out[:, 0]).max() > 1.2 * np.abs(out[:, 1]).max() > 0.0
    sound.close()
    assert not stream.is_open
    bodies.volumes = []
    with pytest.raises(InputError, match="no volume"):
        LiveSound(bodies, SoundSettings())
