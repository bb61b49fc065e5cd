# SPDX-License-Identifier: GPL-3.0-or-later
"""NLA tracks of clips."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from hfx_blender.authoring import clips


@pytest.mark.parametrize(
    ("start", "expected"), [(70.0, "Clips"), (15.0, "NlaTrack"), (35.0, "Clips")]
)
def test_clips_prefer_the_track_of_the_effect_to_one_of_a_duplicate(
    scene: Any, start: float, expected: str
) -> None:
    """Blender puts the copy of a duplicated strip onto a new track below."""
    bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", name="Ball")
    ball = bpy.data.objects["Ball"]
    copy = clips.add_clip(ball, 40.0, 60.0)
    ball.animation_data.nla_tracks[0].name = "NlaTrack"
    track = ball.animation_data.nla_tracks.new()
    track.name = "Clips"
    track.strips.new("Clip", 10, copy.action).frame_end = 30.0
    clips.add_clip(ball, start, start + 4.0, name="Later")
    owners = [t.name for t in ball.animation_data.nla_tracks if "Later" in t.strips]
    assert owners == [expected]
