# SPDX-License-Identifier: GPL-3.0-or-later
"""A video keeps its own frame rate in the timeline: flat, and 360 degrees as the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from movie_file import write_movie

from hfx_blender.authoring import media
from hfx_blender.blender import compat

RATE, PICTURES, START = 20, 40, 11


@pytest.fixture
def movie(tmp_path: Path) -> Path:
    """Two seconds of uniform grey pictures; picture k has the grey 5 + 6 k."""
    grey = (5 + 6 * np.arange(PICTURES)).astype(np.uint8)
    pictures = np.broadcast_to(grey[:, None, None, None], (PICTURES, 16, 32, 3))
    tone = (8000 * np.sin(np.arange(PICTURES * 400) * 0.17)).astype(np.int16)
    return write_movie(tmp_path / "clip.avi", pictures, RATE, tone)


def wanted(frame: int, fps: int) -> int:
    """Number of the expected picture at a frame of the scene, from 1."""
    return int(np.floor((frame - START) * RATE / fps + 1e-6)) + 1


def shown(screen: Any, frame: int) -> int:
    """Picture taken by Blender, by the rule for image users without repeat."""
    user = screen.evaluated_get(bpy.context.evaluated_depsgraph_get()).image_user
    counted = min(max(frame - user.frame_start + 1, 1), user.frame_duration)
    return int(counted + user.frame_offset)


@pytest.mark.parametrize("fps", [20, 24, 30, 60])
def test_the_picture_that_is_due_is_shown_at_any_frame_rate(
    scene: Any, movie: Path, fps: int
) -> None:
    scene.render.fps = fps
    scene.frame_set(START)
    bpy.ops.hfx.add_video(filepath=str(movie))
    (screen,) = media.videos_of(scene)
    for frame in (START, START + 1, START + 2, START + fps, START + 2 * fps - 1):
        scene.frame_set(frame)
        assert shown(screen, frame) == wanted(frame, fps), frame
    for frame, picture in ((-20, 1), (1, 1), (START - 1, 1), (START + 3 * fps, PICTURES)):
        scene.frame_set(frame)
        assert shown(screen, frame) == picture, "the first before it, the last after it"


def test_another_frame_rate_or_start_keeps_it_in_step(scene: Any, movie: Path) -> None:
    scene.render.fps = 20
    scene.frame_set(START)
    bpy.ops.hfx.add_video(filepath=str(movie))
    (screen,) = media.videos_of(scene)
    scene.render.fps = 30
    screen[media.START] = 41
    screen.update_tag()
    scene.frame_set(71)  # a second after the start
    assert shown(screen, 71) == RATE + 1


@pytest.mark.skipif(
    not bpy.app.build_options.audaspace, reason="this Blender is built without Audaspace"
)
def test_its_sound_is_put_on_the_timeline(scene: Any, movie: Path) -> None:
    scene.render.fps = 30
    scene.frame_set(START)
    bpy.ops.hfx.add_video(filepath=str(movie))
    (strip,) = compat.strips(scene.sequence_editor)
    assert strip.type == "SOUND" and strip.frame_final_start == START
    assert strip.frame_final_duration == pytest.approx(60, abs=1), "two seconds"
    assert scene.sync_mode == "AUDIO_SYNC"


def test_a_silent_video_and_one_without_its_sound_add_no_strip(scene: Any, tmp_path: Path) -> None:
    pictures = np.zeros((4, 16, 32, 3), np.uint8)
    silent = write_movie(tmp_path / "silent.avi", pictures, RATE)
    bpy.ops.hfx.add_video(filepath=str(silent))
    loud = write_movie(tmp_path / "loud.avi", pictures, RATE, np.ones(1600, np.int16))
    bpy.ops.hfx.add_video(filepath=str(loud), with_sound=False)
    editor = scene.sequence_editor
    assert editor is None or not len(compat.strips(editor))
    assert len(media.videos_of(scene)) == 2


def test_a_360_degree_video_is_rendered_in_step_as_the_world(
    scene: Any, movie: Path, tmp_path: Path
) -> None:
    """The grey identifies the picture; at 30 frames a second, 20 pictures a second."""
    scene.render.fps = 30
    scene.frame_set(START)
    bpy.ops.hfx.add_video(filepath=str(movie), projection="SPHERE")
    world = scene.world
    assert media.videos_of(scene) == [world]
    world.cycles.sampling_method = "NONE"
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(tmp_path / "seen.png")
    greys = []
    for frame in (START, START + 15, START + 45):
        scene.frame_set(frame)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        greys.append(image.pixels[0] * 255)
        bpy.data.images.remove(image)
    due = [5 + 6 * (wanted(frame, 30) - 1) for frame in (START, START + 15, START + 45)]
    assert greys == pytest.approx(due, abs=2.5)
