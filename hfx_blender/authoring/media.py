# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound and video that haptics go with: Blender's own strips, image empties and worlds."""

from __future__ import annotations

from pathlib import Path

import bpy

from .. import compat
from ..errors import InputError
from . import effects

_SCREEN_HEIGHT = 2.2
_SCREEN_BEHIND = 1.5
"""Where a flat video stands, seen from the front of the body, metres."""


def add_sound(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.SoundStrip:
    """Put a sound into the scene's sequencer, and let playing keep in step with it.

    Raises
    ------
    InputError
        The file is not there, or holds no sound.
    """
    _check(path)
    editor = scene.sequence_editor or scene.sequence_editor_create()
    strips = compat.strips(editor)
    taken = [s.channel for s in strips if s.frame_final_start <= frame < s.frame_final_end]
    try:
        strip = strips.new_sound(path.name, str(path), max(taken, default=0) + 1, frame)
    except RuntimeError as error:
        raise InputError(f"{path}: cannot be read as a sound ({error}).") from error
    if strip.sound.channels == "INVALID":
        strips.remove(strip)
        raise InputError(f"{path}: holds no sound.")
    scene.sync_mode = "AUDIO_SYNC"
    scene.use_audio_scrub = True
    return strip


def add_screen(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.Object:
    """A flat video or picture that stands behind the first body.

    Raises
    ------
    InputError
        The file is not there, or is neither a picture nor a video.
    """
    image = _image(path)
    screen = bpy.data.objects.new(path.stem, None)
    screen.empty_display_type = "IMAGE"
    screen.data = image
    unit = scene.unit_settings
    metres = 1.0 if unit.system == "NONE" else unit.scale_length
    width, height = image.size
    # The size of an image empty is that of its longer side.
    screen.empty_display_size = _SCREEN_HEIGHT / metres * max(width / height, 1.0)
    screen.empty_image_offset = (-0.5, 0.0)
    screen.rotation_euler = (1.5707963, 0.0, 0.0)  # it faces the front view
    bodies = effects.bodies_of(scene)
    place = bodies[0].matrix_world.translation if bodies else scene.cursor.location
    screen.location = (place[0], place[1] + _SCREEN_BEHIND / metres, place[2])
    screen.use_empty_image_alpha = False
    if image.source == "MOVIE":
        _play(screen.image_user, image, frame)
    scene.collection.objects.link(screen)
    return screen


def add_surroundings(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.World:
    """An equirectangular video or picture as the scene's world; the old world is kept unused.

    Raises
    ------
    InputError
        The file is not there, or is neither a picture nor a video.
    """
    image = _image(path)
    world = bpy.data.worlds.new(path.stem)
    if not world.node_tree:
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = next((n for n in nodes if n.type == "BACKGROUND"), None)
    if background is None:
        background = nodes.new("ShaderNodeBackground")
        output = nodes.new("ShaderNodeOutputWorld")
        links.new(background.outputs["Background"], output.inputs["Surface"])
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.location = background.location.x - 300, background.location.y
    texture.image = image
    if image.source == "MOVIE":
        _play(texture.image_user, image, frame)
    links.new(texture.outputs["Color"], background.inputs["Color"])
    if scene.world is not None:
        scene.world.use_fake_user = True
    scene.world = world
    return world


def _check(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file.")


def _image(path: Path) -> bpy.types.Image:
    _check(path)
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    if 0 in tuple(image.size):
        if not image.users:
            bpy.data.images.remove(image)
        raise InputError(f"{path}: is neither a picture nor a video.")
    return image


def _play(user: bpy.types.ImageUser, image: bpy.types.Image, frame: int) -> None:
    user.frame_start = frame
    user.frame_duration = max(image.frame_duration, 1)
    user.use_auto_refresh = True
