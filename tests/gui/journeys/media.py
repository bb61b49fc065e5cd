# SPDX-License-Identifier: GPL-3.0-or-later
"""A sound on the timeline, which playing is to keep in step with; a picture behind the body.

With ``--arg 360`` a picture is the world, too. EEVEE draws that: minutes without a graphics card.
"""

from __future__ import annotations

import wave
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands
import numpy as np

FPS = 24
START = 12
SOUND, VIDEO = -2, -1  # the last buttons of the tab
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
    yield from press(h, SOUND)
    yield from h.save_as(sound)
    yield from h.until(lambda: sounds(), "the sound is a strip of the sequencer", 20)
    (strip,) = sounds()
    h.check(strip.frame_start == start, f"it begins at the current frame ({strip.frame_start:.0f})")
    length = strip.frame_final_duration
    h.check(abs(length - SOUND_S * FPS) <= 1, f"and lasts {length} frames")
    h.check(scene.sync_mode == "AUDIO_SYNC", "playing keeps in step with the sound")
    h.shot("2_sound.png")

    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    frame = scene.frame_current
    yield from h.key("space")
    yield from h.until(lambda: scene.frame_current > frame, "Space plays", 60)
    yield from h.key("space")
    yield 0.5
    # Whether frames are left out to stay in step shows only where there is a sound card.

    before = set(bpy.data.objects)
    yield from press(h, VIDEO)
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
    if "360" in h.args:
        yield from press(h, VIDEO)
        yield from h.until(lambda: browser(h) is not None, "a file browser is open", 10)
        browser(h).spaces.active.active_operator.projection = "SPHERE"
        yield from h.save_as(picture)
        yield from h.until(lambda: bpy.context.scene.world.name == "wall", "it is the world", 300)
        h.shot("4_surroundings.png")


def press(h: Any, which: int) -> Iterator[float]:
    buttons = yield from h.op_buttons(h.region("UI"))
    yield from h.click(*buttons[which])
    yield 0.5


def browser(h: Any) -> bpy.types.Area | None:
    areas = h.window.screen.areas
    return next((area for area in areas if area.type == "FILE_BROWSER"), None)


def sounds() -> list[Any]:
    editor = bpy.context.scene.sequence_editor
    strips = hands.module("compat").strips(editor) if editor else ()
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
