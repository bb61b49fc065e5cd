# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound and video for haptic scenes, as Blender's strips, image empties and worlds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..blender import compat
from ..blender.scene_info import fps_of, metres_of
from ..errors import InputError, refuse_no_file
from ..files import limits
from .effects import effects

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

START = "hfx_video_start"  # ID property of a screen or world: start frame of its video
_LONGEST = 300_000  # frames; limit of an image user in all Blender versions

_SCREEN_HEIGHT = 2.2
_SCREEN_BEHIND = 1.5
"""Distance of a screen behind the body, metres."""


def add_sound(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.SoundStrip:
    """Add a sound to the scene's sequencer, from ``frame`` on in a free channel, and synchronise
    playback to sound. Workspaces without a scene for their Sequencer get this scene. Raises
    InputError: the file is missing or has no sound."""
    refuse_no_file(path)
    editor = scene.sequence_editor or scene.sequence_editor_create()
    strips = compat.strips(editor)
    # Strips of a channel cannot overlap.
    used_channels = [s.channel for s in strips if s.frame_final_start <= frame < s.frame_final_end]
    try:
        strip = strips.new_sound(path.name, str(path), max(used_channels, default=0) + 1, frame)
    except RuntimeError as error:
        raise InputError(f"{path}: cannot be read as a sound ({error}).") from error
    if strip.sound.channels == "INVALID":
        strips.remove(strip)
        raise InputError(f"{path}: has no sound.")
    # Since 5.0 a Sequencer shows the scene chosen in its workspace: none at first.
    for workspace in bpy.data.workspaces:
        if getattr(workspace, "sequencer_scene", scene) is None:
            workspace.sequencer_scene = scene
    scene.sync_mode = "AUDIO_SYNC"
    scene.use_audio_scrub = True
    return strip


def sound_of(source: bpy.types.SoundStrip | Path) -> tuple[npt.NDArray[np.float32], int]:
    """Samples (n, channels) of a file or of the visible part of a sound strip of the current scene,
    at its original speed, and samples a second. Raises InputError: the sound cannot be read;
    TooLargeError: it exceeds the memory limit."""
    try:
        import aud
    except ImportError:
        raise InputError("This Blender is built without sound, and cannot read any.") from None
    is_file = isinstance(source, Path)
    name = str(source) if is_file else f"Sound '{source.name}'"
    if is_file:
        refuse_no_file(source)
        sound = aud.Sound(name)
    else:  # only the evaluated copy of a sound is loaded
        sound = source.sound.evaluated_get(bpy.context.evaluated_depsgraph_get()).factory
    try:
        (rate, channels), count = sound.specs, sound.length
        limits.MEMORY.check(4.0 * count * channels, name, "its samples would take")
        samples = sound.data()
    except (AttributeError, aud.error) as error:
        raise InputError(f"{name}: cannot be read as a sound.") from error
    if is_file:
        return samples, round(rate)
    fps = fps_of(source.id_data)
    skipped_s = (source.frame_final_start - source.frame_start) / fps + source.sound_offset
    first = max(round(skipped_s * rate), 0)
    return samples[first : first + round(source.frame_final_duration / fps * rate)], round(rate)


def add_screen(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.Object:
    """Add a screen with a video, from ``frame`` on, or picture behind the first body, or behind the
    3D cursor. Raises InputError: the file is missing, or no picture or video."""
    image = _image(path)
    screen = bpy.data.objects.new(path.stem, None)
    screen.empty_display_type = "IMAGE"
    screen.data = image
    metres = metres_of(scene)
    width, height = image.size
    # The display size of an image empty is the length of the longer side.
    screen.empty_display_size = _SCREEN_HEIGHT / metres * max(width / height, 1.0)
    screen.empty_image_offset = (-0.5, 0.0)
    screen.rotation_euler = (1.5707963, 0.0, 0.0)  # faces the front view
    bodies = effects.bodies_of(scene)
    position = bodies[0].matrix_world.translation if bodies else scene.cursor.location
    screen.location = (position[0], position[1] + _SCREEN_BEHIND / metres, position[2])
    screen.use_empty_image_alpha = False
    scene.collection.objects.link(screen)
    if image.source == "MOVIE":
        _play(scene, image, frame, screen, screen, "image_user")
    return screen


def add_surroundings(scene: bpy.types.Scene, path: Path, frame: int) -> bpy.types.World:
    """Add an equirectangular video, from ``frame`` on, or picture as the scene's world.

    The world before is unlinked; a world of the user gets a fake user. Raises InputError: the file
    is missing, or no picture or video.
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
        user = f'nodes["{bpy.utils.escape_identifier(texture.name)}"].image_user'
        _play(scene, image, frame, world, world.node_tree, user)
    links.new(texture.outputs["Color"], background.inputs["Color"])
    # A world without users would be lost on saving.
    if scene.world is not None and START not in scene.world:
        scene.world.use_fake_user = True
    scene.world = world
    return world


def videos_of(scene: bpy.types.Scene) -> list[bpy.types.Object | bpy.types.World]:
    """Screens and world of a scene with a video, in this order."""
    owners = [*scene.objects, *([scene.world] if scene.world is not None else [])]
    return [owner for owner in owners if START in owner]


def _image(path: Path) -> bpy.types.Image:
    """Load a picture or video, or return it if loaded; InputError for another file."""
    refuse_no_file(path)
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    # Blender loads any file as an image; only the size tells that there are no pixels.
    if 0 in tuple(image.size):
        if not image.users:
            bpy.data.images.remove(image)
        raise InputError(f"{path}: is neither a picture nor a video.")
    return image


def _play(
    scene: bpy.types.Scene,
    image: bpy.types.Image,
    frame: int,
    owner: bpy.types.Object | bpy.types.World,
    driven: bpy.types.ID,
    user_path: str,
) -> None:
    """Play a video from a frame on at the video's frame rate, independent of the scene's; at the
    scene's for a video without a rate. Blender advances a picture per scene frame. A driver of the
    frame offset corrects this. The start is an ID property: a driver that reads the driven image
    user is a dependency cycle. Raises RuntimeError for a file that Blender cannot read."""
    user = driven.path_resolve(user_path)
    user.frame_start = 1
    user.frame_duration = _LONGEST  # Blender's limit of frames
    user.use_auto_refresh = True
    owner[START] = frame
    # Blender tells the frame rate of a movie clip only; 0 if it finds none.
    clip = bpy.data.movieclips.load(str(Path(bpy.path.abspath(image.filepath))))
    rate = float(clip.fps) or fps_of(scene)
    bpy.data.movieclips.remove(clip)
    driver = driven.driver_add(f"{user_path}.frame_offset").driver
    driver.type = "SCRIPTED"
    kind = "WORLD" if isinstance(owner, bpy.types.World) else "OBJECT"
    for name, id_type, id_block, path in (
        ("start", kind, owner, f'["{START}"]'),
        ("fps", "SCENE", scene, "render.fps"),
        ("base", "SCENE", scene, "render.fps_base"),
    ):
        variable = driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        target.id_type, target.id, target.data_path = id_type, id_block, path
    # Blender shows picture max(frame, 1) + offset. The millionth prevents rounding down.
    due = f"floor((frame - start) * {rate:.9g} * base / fps + 0.000001) + 1"
    driver.expression = f"min(max({due}, 1), {max(image.frame_duration, 1)}) - max(frame, 1)"
