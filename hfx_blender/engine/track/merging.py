# SPDX-License-Identifier: GPL-3.0-or-later
"""Merges a track that was recorded in parts: the result has the bytes of one recording."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...errors import InputError
from .reader import TrackReader
from .writer import TrackWriter


def merge(parts: Iterable[Path], path: Path) -> None:
    """Write the recording that several files hold the parts of.

    Parameters
    ----------
    parts : iterable of Path
        Tracks with the same header, in the order of time. Each holds whole chunks
        (``layout.SAMPLES_PER_CHUNK``) that none of the others holds.

    Raises
    ------
    InputError
        There is no part, one is damaged, is of another recording or out of order.
    OutputError
        The file cannot be written.
    """
    files = list(parts)
    if not files:
        raise InputError(f"{path}: there are no parts of it.")
    with TrackReader(files[0]) as first:
        header, precise = first.header, first.full_precision
    with TrackWriter(path, header, full_precision=precise) as writer:
        for file in files:
            with TrackReader(file) as part:
                writer.copy(part)
