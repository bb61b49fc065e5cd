# SPDX-License-Identifier: GPL-3.0-or-later
"""Cache of preview frames, so that playing a record again only has to draw it."""

from __future__ import annotations

from collections.abc import Sequence

from ...engine.colouring import PALETTES, Colour
from ..timeline.timeline_record import TimelineRecord
from .coloured_mesh import ColouredMesh, Shown

MOST_BYTES = 96_000_000
"""Memory limit of the cache, bytes; frames beyond it are computed when they are drawn."""

Meshes = Sequence[tuple[ColouredMesh, Shown]]


class PreviewFrameCache:
    """Cache of the visible parts at times of one record, in one palette."""

    def __init__(self) -> None:
        self._of: TimelineRecord | None = None
        self._colours: tuple[Colour, ...] = ()  # a palette of one's own may change
        self._known: dict[int, Meshes] = {}  # by the record's samples
        self._bytes = 0
        self._asked = 0  # frames that have been looked at before they are drawn

    def forget(self) -> None:
        """Empty the cache: meshes may be other ones."""
        self.__init__()  # type: ignore[misc]

    def at(self, recorded: TimelineRecord, palette: str, index: int) -> Meshes | None:
        """Get the visible parts at a sample of a record; None where they are not cached."""
        colours = tuple(PALETTES[palette].values())
        if self._of is not recorded or self._colours != colours:
            self.forget()
            self._of, self._colours = recorded, colours
        return self._known.get(index)

    def keep(self, index: int, meshes: Meshes) -> None:
        """Store the visible parts at a sample of the record that was queried last."""
        if self.is_full:
            return
        self._known[index] = meshes
        self._bytes += sum(shown.nbytes for _, shown in meshes)

    @property
    def is_full(self) -> bool:
        """Test for the memory limit."""
        return self._bytes > MOST_BYTES

    def missing(self, recorded: TimelineRecord, palette: str, first: int, last: int) -> int | None:
        """Find the next sample of a frame range that is not cached; None at the end."""
        self.at(recorded, palette, 0)
        while first + self._asked <= last and not self.is_full:
            index = recorded.index(first + self._asked)
            self._asked += 1
            if index is not None and index not in self._known:
                return index
        return None
