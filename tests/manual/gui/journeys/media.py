# SPDX-License-Identifier: GPL-3.0-or-later
"""A sound on the timeline, kept in step by playback; a video behind the body."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import bpy
import hands
import numpy as np
from movie_file import SOUND_HZ as MOVIE_HZ
from movie_file import write_movie

FPS = 24
START = 12
MOVIE_RATE, MOVIE_PICTURES = 20, 40
SOUND_S, SOUND_HZ = 4.0, 8000


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from hands.empty_scene(h, FPS)
    scene = bpy.context.scene
    scene.frame_end = 20 * FPS
    yield from hands.add_avatar(h)
    headers = yield from h.panels(h.region("UI"))
    yield from h.click(*headers[-1])
    yield 0.8
    h.shot("1_panel.png")

    sound, picture = h.out / "hum.wav", h.out / "wall.png"
    write_sound(sound)
    write_picture(picture)
    yield from hands.go_to(h, START)
    start = scene.frame_current
    yield from h.press_button("HFX_OT_add_sound")
    yield from h.save_as(sound)
    yield from h.until(lambda: sounds(), "the sound is a strip of the sequencer", 20)
    (strip,) = sounds()
    h.check(strip.frame_start == start, f"it begins at the current frame ({strip.frame_start:.0f})")
    length = strip.frame_final_duration
    h.check(abs(length - SOUND_S * FPS) <= 1, f"and lasts {length} frames")
    h.check(scene.sync_mode == "AUDIO_SYNC", "playing keeps in step with the sound")
    shown = getattr(h.window.workspace, "sequencer_scene", scene)  # since Blender 5.0
    h.check(shown == scene, "a Sequencer shows the strip")
    h.shot("2_sound.png")
    yield from felt_sound(h, start)

    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    scene = bpy.context.scene  # an undo has replaced the object
    frame = scene.frame_current
    yield from h.key("space")
    yield from h.until(lambda: scene.frame_current > frame, "Space plays", 60)
    yield from h.key("space")
    yield 0.5
    # Whether frames are left out to stay in step shows only where there is a sound card.

    before = set(bpy.data.objects)
    yield from h.press_button("HFX_OT_add_video")
    yield from h.save_as(picture)
    yield from h.until(lambda: set(bpy.data.objects) - before, "a screen is added", 20)
    (screen,) = set(bpy.data.objects) - before
    h.check(screen.empty_display_type == "IMAGE" and screen.location.y > 1.0, "behind the body")
    yield 0.5
    pixels = h.shot("3_screen.png")
    red, green, blue = hands.tint(pixels, h.xy_of((0.6, 0.0, 1.6)))
    h.check(red > 1.3 * blue and green > 1.3 * blue, "seen behind the avatar, as yellow as it is")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 0.8
    h.check("wall" not in bpy.data.objects, "Ctrl+Z takes the screen back")
    h.check(len(sounds()) == 1, "and leaves the sound")
    yield from flat_video(h)


def flat_video(h: Any) -> Iterator[float]:
    """20 pictures a second on a timeline of 24 frames a second."""
    movie = h.out / "clip.avi"
    ramp = (40 + 4 * np.arange(MOVIE_PICTURES)).astype(np.uint8)
    pictures = np.zeros((MOVIE_PICTURES, 32, 64, 3), np.uint8)
    pictures[..., 0], pictures[..., 2] = ramp[:, None, None], 255 - ramp[:, None, None]
    tone = 6000 * np.sin(np.arange(MOVIE_PICTURES * MOVIE_HZ // MOVIE_RATE) * 0.2)
    write_movie(movie, pictures, MOVIE_RATE, tone.astype(np.int16))
    scene = bpy.context.scene
    yield from hands.go_to(h, 2 * START)
    start = scene.frame_current
    yield from h.press_button("HFX_OT_add_video")
    yield from h.save_as(movie)
    yield from h.until(lambda: "clip" in bpy.data.objects, "a screen is added", 20)
    h.check(len(sounds()) == 2, "and its sound is on the timeline")
    reds = []
    times_s = (0.0, 0.5, 1.5, 3.0)
    for seconds in times_s:
        frame = start + round(seconds * FPS)
        scene.frame_set(frame)
        yield 0.8
        pixels = h.shot(f"4_video_{frame}.png")
        reds.append(float(hands.tint(pixels, h.xy_of((0.6, 0.0, 1.6)))[0]))
    # Decoders before 5.0 stretch colours; a video out of step would be 0.15 off in the end.
    first, *between, last = reds
    for seconds, red in zip(times_s[1:-1], between, strict=True):
        shown, due = (red - first) / (last - first), seconds * MOVIE_RATE / (MOVIE_PICTURES - 1)
        h.check(abs(shown - due) < 0.08, f"after {seconds} s: {shown:.2f} of it, due {due:.2f}")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    frame = scene.frame_current
    yield from h.key("space")
    yield from h.until(lambda: scene.frame_current != frame, "it plays", 60)
    yield from h.key("space")
    yield 0.5
    h.shot("5_played.png")


def felt_sound(h: Any, start: int) -> Iterator[float]:
    """Press *Feel This Sound* below a sound strip, and compare the effect's keys with the strip."""
    yield from h.press_button("HFX_OT_feel_sound")
    yield 0.8
    h.shot("2_feel_this_sound.png")
    yield from h.key("Return")
    if find_spec("scipy") is None:  # the small zip without scipy: a report names the package
        yield 1.0
        h.shot("2_needs_scipy.png")
        h.check("hum.wav" not in bpy.data.objects, "without scipy nothing is added")
        return
    yield from h.until(lambda: "hum.wav" in bpy.data.objects, "an effect follows the sound", 30)
    (clip,) = hands.clips_of(bpy.data.objects["hum.wav"])
    h.check(abs(clip.frame_start - start) < 0.1, "its clip begins with the strip")
    h.check(abs(clip.frame_end - clip.frame_start - SOUND_S * FPS) <= 1.5, "and is as long")
    h.shot("2_felt.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield from h.until(lambda: "hum.wav" not in bpy.data.objects, "Ctrl+Z takes it back", 10)


def sounds() -> list[Any]:
    editor = bpy.context.scene.sequence_editor
    strips = hands.module("blender.compat").strips(editor) if editor else ()
    return [strip for strip in strips if strip.type == "SOUND"]


def write_sound(path: Path) -> None:
    times = np.arange(round(SOUND_S * SOUND_HZ)) / SOUND_HZ
    samples = (8000 * np.sin(2 * np.pi * 220 * times)).astype("<i2")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SOUND_HZ)
        file.writeframes(samples.tobytes())


def write_picture(path: Path) -> None:
    image = bpy.data.images.new("made", 64, 32)
    image.pixels.foreach_set(np.tile(np.array([0.9, 0.8, 0.1, 1.0], np.float32), 64 * 32))
    image.file_format, image.filepath_raw = "PNG", str(path)
    image.save()
    bpy.data.images.remove(image)
