# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of sound files, in blocks: of WAV files here, of other files by Blender's decoders."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.errors import InputError, refuse_no_file
from hfx_blender.files import limits
from hfx_blender.files.strict_json import mapped

from ..formats import wav_rules

SUFFIXES: Final = (".wav", ".flac", ".ogg", ".mp3", ".opus", ".m4a", ".aac")
_BLOCK: Final = 1 << 20  # samples over all channels
_CUT: Final = ("WAV-SIZE", "WAV-CHUNK")  # findings of a file that is cut short

Blocks = Iterator[npt.NDArray[np.float32]]


def is_sound(path: Path) -> bool:
    """Test a file's name for a suffix of sound files."""
    return path.name.lower().endswith(SUFFIXES)


def blocks_of(path: Path) -> tuple[Blocks, int, tuple[str, ...]]:
    """Blocks (n, channels) of full scale 1, samples a second, and notes on a damaged file.

    Raises InputError for a missing file, a file that is no sound or has no samples, and a sound
    longer than the limit of seconds.
    """
    refuse_no_file(path)
    content = mapped(path) if path.name.lower().endswith(".wav") else b""
    form, findings = wav_rules.inspect(content)
    # Blender decodes other formats, and WAV of other kinds: compressed, or longer than 4 GiB.
    if form is None or not form.is_plain:
        return _decoded_blocks(path)
    limits.SECONDS.check(form.frames / form.rate_hz, str(path), "it lasts")
    notes = tuple(f"{f.message}; it is read to its end" for f in findings if f.code in _CUT)
    return _wav_blocks(content, form), form.rate_hz, notes


def _wav_blocks(content: bytes, form: wav_rules.WavForm) -> Blocks:
    """Yield the blocks of a WAV file without compression."""
    width = form.channels * form.bits // 8
    most = max(_BLOCK // form.channels, 1)
    for first in range(0, form.frames, most):
        begin = form.begin + first * width
        count = min(most, form.frames - first)
        samples = _samples(content[begin : begin + count * width], form)
        yield samples.reshape(-1, form.channels)


def _decoded_blocks(path: Path) -> tuple[Blocks, int, tuple[str, ...]]:
    """The whole sound as a block, samples a second, and no notes, by Blender's decoders. Raises
    InputError for a file of another kind, TooLargeError for samples beyond the memory limit."""
    try:
        import bpy  # noqa: F401  # the module aud is a part of bpy

        aud = import_module("aud")
    except ImportError:
        raise InputError(
            f"{path}: only Blender's module bpy reads this file: install bpy."
        ) from None
    try:
        sound = aud.Sound(str(path))
        (rate, channels), count = sound.specs, sound.length
    except aud.error as error:
        raise InputError(f"{path}: cannot be read as a sound.") from error
    limits.SECONDS.check(count / rate, str(path), "it lasts")
    # Not in blocks: the decoders seek to the beginning of a packet, some samples off.
    limits.MEMORY.check(4.0 * count * channels, str(path), "its samples would take")
    return iter((sound.data(),)), round(rate), ()


def _samples(content: bytes, form: wav_rules.WavForm) -> npt.NDArray[np.float32]:
    """Samples of full scale 1 of whole frames; 8 bits are unsigned, the others signed."""
    if form.is_float:
        return np.frombuffer(content, f"<f{form.bits // 8}").astype(np.float32)
    if form.bits == 8:
        return (np.frombuffer(content, np.uint8).astype(np.float32) - 128.0) / 128.0
    if form.bits == 24:
        # The three bytes are the upper ones of 32 bits.
        raw = np.zeros((len(content) // 3, 4), np.uint8)
        raw[:, 1:] = np.frombuffer(content, np.uint8).reshape(-1, 3)
        return raw.reshape(-1).view("<i4").astype(np.float32) / np.float32(2**31)
    scale = np.float32(2 ** (form.bits - 1))
    return np.frombuffer(content, f"<i{form.bits // 8}").astype(np.float32) / scale
