# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimation of a surface's relief from the picture of its material, in a helper process.

The estimate is stored as an image in the .blend, which is the source of the surface.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from ...engine.texture.height_field import HeightField
from ...engine.texture.relief.relief_estimate import EstimatedRelief
from ...errors import InputError, OutputError
from ...processes.messages import decode_json
from ...processes.worker import Worker
from . import image_values, surface_sources, surfaces


class ReliefEstimation:
    """Estimation in a helper process, started at once.

    ``size_mm`` is width and height of the pictured material; ``tiles`` if opposite edges match.
    Raises InputError: the picture cannot be read. Raises OutputError: the temporary folder is not
    writable.
    """

    def __init__(self, picture: bpy.types.Image, size_mm: tuple[float, float], tiles: bool) -> None:
        colours = image_values.colours_of(picture).astype(np.float32)
        self.name, self.size_mm, self.tiles = picture.name, size_mm, tiles
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="hfx-relief-")
            source, self._target = (Path(self._folder.name) / f"{n}.npz" for n in ("in", "out"))
            np.savez(source, srgb=colours, size_m=np.divide(size_mm, 1000.0), tiles=tiles)
        except OSError as error:
            raise OutputError(f"The temporary folder cannot be written to ({error}).") from error
        self._worker = Worker(
            "engine.texture.relief.relief_worker", source, self._target, keeps_errors=True
        )
        self._worker.start()

    @property
    def is_running(self) -> bool:
        return self._worker.is_running

    def result(self) -> EstimatedRelief:
        """Estimated relief; waits for the process. InputError if the estimation failed."""
        try:
            # A refusal is a message of the worker; an exit code is a crash.
            refusal = self._worker.receive()
            if refusal is not None or self._worker.wait():
                reason = (
                    f"its process {self._worker.how_it_ended()}"
                    if refusal is None
                    else decode_json(refusal.body)["error"]
                )
                raise InputError(f"The relief of '{self.name}' was not estimated: {reason}")
            with np.load(self._target) as file:
                heights, slope, roughness = (
                    file[name] for name in ("heights_m", "slope", "roughness")
                )
        finally:
            self._folder.cleanup()
        rows, columns = heights.shape
        texel = self.size_mm[0] / 1000.0 / columns, self.size_mm[1] / 1000.0 / rows
        return EstimatedRelief(HeightField(heights, texel, self.tiles), slope, roughness)

    def stop(self) -> None:
        """End the process without a result."""
        self._worker.close(0.0)
        self._folder.cleanup()


def apply_estimate(obj: bpy.types.Object, estimation: ReliefEstimation) -> str:
    """Store an estimate as an object's surface, and make the maps; return notes.

    Raises InputError: the estimation failed, or the object cannot have a surface.
    """
    estimate = estimation.result()
    if not surfaces.is_surface(obj):
        surfaces.add_surface(obj, "IMAGE")
    settings = obj.hfx.surface
    height_mm = 1000.0 * float(estimate.field.heights_m.max())
    image = image_values.store(
        f"{estimation.name} Estimate", None, surface_sources.estimate_channels(estimate)
    )
    # The estimate knows its size, so the scale is entered rather than measured.
    settings.source, settings.image_kind, settings.image = "IMAGE", "ESTIMATE", image
    settings.roughness_image = None
    settings.height_mm = height_mm
    settings.use_own_scale, settings.uv_mm = True, estimation.size_mm
    surfaces.make_maps(obj)
    return f"The relief of '{estimation.name}' is an estimate, {height_mm:.3g} mm high"
