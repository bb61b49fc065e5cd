# SPDX-License-Identifier: GPL-3.0-or-later
"""Recorders of the animation of volumes and bodies, for formats beyond samples (glb, clip)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.scene import AnimationBlock, SceneDescription
from ..formats.clip.spatial_recorder import SpatialRecorder
from ..formats.glb.glb_scene import VolumeRecorder

_SPATIAL = "clip."  # prefix of array names


class SceneRecorders:
    """Recorders that the chosen formats need.

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
        """True if any format needs a recorder."""
        return self.volumes is not None or self.spatial is not None

    def add(self, block: AnimationBlock) -> None:
        """Record the next block, in order of time."""
        for recorder in (self.volumes, self.spatial):
            if recorder is not None:
                recorder.add(block)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Recorded arrays by name, to be stored for :meth:`join`; empty without recorders."""
        arrays = {} if self.volumes is None else self.volumes.arrays()
        if self.spatial is not None:
            arrays |= {_SPATIAL + name: array for name, array in self.spatial.arrays().items()}
        return arrays

    def join(
        self,
        files: Sequence[Path],
        block_at: Callable[[int], Iterable[AnimationBlock]],
    ) -> None:
        """Replace the recordings by the files of :meth:`arrays` of all parts, in order of time.

        ``block_at`` reads the block of a sample, for the shapes of volumes.
        """
        parts: list[Mapping[str, npt.NDArray[Any]]] = []
        for file in files:
            with np.load(file, allow_pickle=False) as arrays:
                parts.append(dict(arrays))
        if self.volumes is not None:
            for first in self.volumes.first_samples(parts):
                for block in block_at(first):
                    self.volumes.add(block)
            self.volumes.replace(parts)
        if self.spatial is not None:
            own = [
                {k.removeprefix(_SPATIAL): v for k, v in part.items() if k.startswith(_SPATIAL)}
                for part in parts
            ]
            self.spatial.replace(own)
