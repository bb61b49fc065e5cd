# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound in step, flat and 360 degree pictures: Blender's own data, set up with one operator."""

from __future__ import annotations

import wave
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.blender import compat


@pytest.fixture
def beep(tmp_path: Path) -> Path:
    """Two seconds of sound."""
    path = tmp_path / "beep.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        tone = np.sin(np.arange(16000) * 0.3) * 8000
        file.writeframes(tone.astype("<i2").tobytes())
    return path


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    image = bpy.data.images.new("panorama", 64, 32)
    image.filepath_raw = str(tmp_path / "panorama.png")
    image.file_format = "PNG"
    image.save()
    bpy.data.images.remove(image)
    return tmp_path / "panorama.png"


@pytest.mark.skipif(
    not bpy.app.build_options.audaspace, reason="this Blender is built without Audaspace"
)
def test_a_sound_starts_at_the_current_frame_and_playing_keeps_in_step(
    scene: Any, beep: Path
) -> None:
    scene.render.fps = 24
    scene.frame_set(13)
    assert bpy.ops.hfx.add_sound(filepath=str(beep)) == {"FINISHED"}
    workspaces = list(bpy.data.workspaces)
    shown = [getattr(workspace, "sequencer_scene", scene) for workspace in workspaces]  # since 5.0
    assert workspaces and set(shown) == {scene}, "a Sequencer shows the strip"
    (strip,) = compat.strips(scene.sequence_editor)
    assert (strip.type, strip.frame_final_start, strip.frame_final_duration) == ("SOUND", 13, 48)
    assert scene.sync_mode == "AUDIO_SYNC"
    bpy.ops.hfx.add_sound(filepath=str(beep))
    first, second = compat.strips(scene.sequence_editor)
    assert first.channel != second.channel, "both are heard"


def test_a_flat_picture_stands_behind_the_body(scene: Any, picture: Path) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_video(filepath=str(picture))
    (screen,) = (obj for obj in scene.objects if obj.empty_display_type == "IMAGE")
    assert screen.data.filepath == str(picture)
    assert screen.location.y == pytest.approx(1.5)
    assert screen.empty_display_size == pytest.approx(4.4), "2.2 m high, twice as wide"


def test_a_panorama_becomes_the_world_and_the_old_one_is_kept(scene: Any, picture: Path) -> None:
    old = scene.world = bpy.data.worlds.new("Mine")
    bpy.ops.hfx.add_video(filepath=str(picture), projection="SPHERE")
    assert scene.world != old and old.use_fake_user
    nodes = scene.world.node_tree.nodes
    (texture,) = (node for node in nodes if node.type == "TEX_ENVIRONMENT")
    (link,) = texture.outputs["Color"].links
    assert link.to_node.type == "BACKGROUND" and texture.image.name == picture.name


@pytest.mark.parametrize("operator", ("add_sound", "add_video"))
def test_what_is_no_sound_and_no_picture_is_refused(
    scene: Any, tmp_path: Path, operator: str
) -> None:
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"nothing of the kind")
    for path in (broken, tmp_path / "missing.wav"):
        with pytest.raises(RuntimeError, match=path.name):
            getattr(bpy.ops.hfx, operator)(filepath=str(path))
    assert not bpy.data.images and not (
        scene.sequence_editor and len(compat.strips(scene.sequence_editor))
    )
