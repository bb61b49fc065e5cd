# SPDX-License-Identifier: GPL-3.0-or-later
"""Recorders of a scene's animation for the formats that hold more of it than samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.scene import AnimationBlock, SceneDescription
from ..formats.clip.spatial_recorder import SpatialRecorder
from ..formats.glb.glb_scene import VolumeRecorder

_SPATIAL = "clip."  # before the names of its arrays


class SceneRecorders:
    """Recorders that some formats ask for.

    Attributes
    ----------
    volumes : VolumeRecorder or None
        For ``glb``.
    spatial : SpatialRecorder or None
        For ``clip``.
    """

    def __init__(self, scene: SceneDescription, formats: Sequence[str], detail: int) -> None:
        self.volumes = VolumeRecorder(scene) if "glb" in formats else None
        self.spatial = SpatialRecorder(scene, detail) if "clip" in formats else None

    @property
    def is_any(self) -> bool:
        """Test that a format asks for anything."""
        return self.volumes is not None or self.spatial is not None

    def add(self, block: AnimationBlock) -> None:
        """Take the next block, in the order of time."""
        for each in (self.volumes, self.spatial):
            if each is not None:
                each.add(block)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Recorded values as arrays that one process can hand on to another."""
        found = {} if self.volumes is None else self.volumes.arrays()
        if self.spatial is not None:
            found |= {_SPATIAL + name: each for name, each in self.spatial.arrays().items()}
        return found

    def join(
        self,
        files: Sequence[Path],
        block_at: Callable[[int], Iterable[AnimationBlock]],
    ) -> None:
        """Join what others recorded, files of :meth:`arrays` in the order of time.

        ``block_at`` reads the block of a sample, where the shape of a volume is taken from.
        """
        kept: list[Mapping[str, npt.NDArray[Any]]] = []
        for file in files:
            with np.load(file, allow_pickle=False) as arrays:
                kept.append(dict(arrays))
        if self.volumes is not None:
            for first in self.volumes.first_samples(kept):
                for block in block_at(first):
                    self.volumes.add(block)
            self.volumes.replace(kept)
        if self.spatial is not None:
            own = [
                {k.removeprefix(_SPATIAL): v for k, v in each.items() if k.startswith(_SPATIAL)}
                for each in kept
            ]
            self.spatial.replace(own)
