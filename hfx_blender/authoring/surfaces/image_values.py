# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of Blender's images as arrays, for all depths and colour spaces."""

from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ...engine.arrays import F32, F64
from ...engine.texture.relief.linear_light import height_from_colour, linear_to_srgb, luminance
from ...engine.texture.scan import fill_holes
from ...errors import InputError, is_endless, refuse_no_file
from ...files.hashes import is_elsewhere

LARGEST = 8192  # largest edge of an image, pixels: larger images take gigabytes of memory
MOST_MISSING = 0.5


def data_of(image: bpy.types.Image) -> F64:
    """Stored values (H, W) of an image's first channel, bottom row first, without colour space.

    8-bit and 16-bit values are 0 to 1. Float values are unchanged, read again from the file; of a
    generated or unsaved float image, the values in memory, converted by Blender.

    Raises InputError: the image has no pixels, or too many, or its file is missing.
    """
    # Blender converts float images to linear light on loading; reloading as data avoids this.
    is_converted = image.is_float and not image.colorspace_settings.is_data
    if not is_converted or image.source == "GENERATED" or image.is_dirty:
        return pixels_of(image)[..., 0].astype(np.float64)
    copy = image.copy()  # reloads the file as data; the user's image is unchanged
    try:
        copy.colorspace_settings.is_data = True
        if not copy.size[0]:
            raise InputError(
                f"Image '{image.name}': its numbers cannot be read again from "
                f"'{image.filepath}': is the file missing?"
            )
        return pixels_of(copy)[..., 0].astype(np.float64)
    finally:
        bpy.data.images.remove(copy)


def brightness_of(image: bpy.types.Image) -> F64:
    """Luminance (H, W) in linear light, bottom row first, of RGB or a first channel as grey. Raises
    InputError: the image has no pixels, or too many."""
    pixels = _three_channels(image)
    # Blender stores 8-bit images as sRGB codes, and further images in linear light.
    return luminance(pixels) if image.is_float else height_from_colour(pixels)


def colours_of(image: bpy.types.Image) -> F64:
    """Colours (H, W, 3) of an image as sRGB values 0 to 1, bottom row first. Raises InputError: the
    image has no pixels, too many, or NaN."""
    pixels = _three_channels(image)
    if not np.isfinite(pixels).all():
        raise InputError(f"Image '{image.name}' has colours that are no finite numbers.")
    # As in brightness_of: only 8-bit images are stored as sRGB codes.
    return np.clip(linear_to_srgb(pixels) if image.is_float else pixels, 0.0, 1.0).astype(float)


def _three_channels(image: bpy.types.Image) -> F32:
    """RGB (H, W, 3) of an image as stored; the first channel thrice if there are fewer than 3."""
    pixels = pixels_of(image)
    return pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


def without_holes(grey: F64, name: str) -> tuple[F64, tuple[str, ...]]:
    """Fill non-finite values of a height map (H, W); return the filled map with notes. Raises
    InputError: more than half of the values are missing."""
    missing = float(np.mean(~np.isfinite(grey)))
    if missing > MOST_MISSING:
        raise InputError(
            f"'{name}': {missing:.0%} of its heights are missing or not numbers; at most "
            f"{MOST_MISSING:.0%} can be filled."
        )
    if not missing:
        return grey, ()
    return fill_holes(grey), (f"{missing:.1%} of the heights were missing and were filled",)


def pixels_of(image: bpy.types.Image) -> F32:
    """All channels of an image as stored by Blender, (H, W, C), bottom row first. Raises
    InputError: the image has no pixels or too many, or the file is a pipe or on another machine."""
    # Reading pixels loads the file, which must not be a pipe.
    if not image.has_data and image.source != "GENERATED" and not image.packed_files:
        source = Path(bpy.data.filepath) if bpy.data.filepath else None
        path = Path(bpy.path.abspath(image.filepath, library=image.library))
        if is_elsewhere(path, source) or is_endless(path):
            raise InputError(f"Image '{image.name}': {path} is no file of this computer.")
    width, height = image.size
    if not width or not height:
        raise InputError(f"Image '{image.name}' has no pixels; is its file missing or no image?")
    if max(width, height) > LARGEST:
        raise InputError(
            f"Image '{image.name}' has {width} x {height} pixels; at most {LARGEST} along an "
            "edge can be read. Scale it down first."
        )
    values = np.zeros(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, image.channels)


def load(path: str) -> bpy.types.Image:
    """Load an image file; InputError if missing, truncated, or no image for Blender."""
    refuse_no_file(Path(path))
    try:
        image = bpy.data.images.load(path)
    except RuntimeError as error:
        raise InputError(f"{path}: Blender cannot read it as an image.") from error
    # A truncated JPEG loads without an error.
    if image.size[0] and not is_jpeg_cut_off(Path(path)):
        return image
    is_empty = not image.size[0]
    bpy.data.images.remove(image)
    raise InputError(
        f"{path}: "
        + ("Blender cannot read it as an image." if is_empty else "the end of the file is missing.")
    )


def is_jpeg_cut_off(path: Path) -> bool:
    """Test for a JPEG without end marker after the first scan; False for files of another kind.
    Readers show the missing part grey. Source: ITU-T T.81, annex B. Raises OSError for an
    unreadable file."""
    data = path.read_bytes()
    if not data.startswith(b"\xff\xd8"):
        return False
    offset = 2
    # Segments before the first scan are skipped: an embedded thumbnail has its own end marker.
    while offset < len(data) and data[offset : offset + 2] != b"\xff\xda":
        is_fill = data[offset : offset + 2] == b"\xff\xff"
        offset += 1 if is_fill else 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return data.find(b"\xff\xd9", offset) < 0


def store(
    name: str, image: bpy.types.Image | None, channels: list[npt.ArrayLike]
) -> bpy.types.Image:
    """Store arrays (H, W) exactly, as the channels of a packed float image; return the image. A
    single array fills red, green and blue. An ``image`` with a single user is reused if the size is
    equal, else removed."""
    rows, columns = np.shape(channels[0])
    if image is not None and image.users > 1:
        image = None  # also used by a copy of the object
    elif image is not None and tuple(image.size) != (columns, rows):
        bpy.data.images.remove(image)
        image = None
    if image is None:
        image = bpy.data.images.new(name, columns, rows, float_buffer=True, is_data=True)
    # Blender converts no values of a float image without a colour space.
    pixels = np.ones((rows, columns, 4), np.float32)
    # The first array fills the colour channels without an array of their own.
    for k in range(3):
        pixels[..., k] = channels[k if k < len(channels) else 0]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def set_preview(image: bpy.types.Image, values: npt.ArrayLike, size: int = 128) -> None:
    """Set an image's preview from values (H, W): black is the minimum, white the maximum. Constant
    values are shown as their own grey value, clipped to 0 to 1."""
    # Nearest values suffice for an icon, and cost the same for images of any size.
    grid = np.asarray(values, np.float32)
    rows = np.linspace(0, grid.shape[0] - 1, size).round().astype(int)
    columns = np.linspace(0, grid.shape[1] - 1, size).round().astype(int)
    small = grid[rows][:, columns]
    low, high = float(small.min()), float(small.max())
    grey = (small - low) / (high - low) if high > low else np.clip(small, 0.0, 1.0)
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., :3] = grey[..., None]
    preview = image.preview_ensure()
    preview.image_size = (size, size)
    preview.image_pixels_float.foreach_set(pixels.ravel())
