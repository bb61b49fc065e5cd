# SPDX-License-Identifier: GPL-3.0-or-later
"""Process that estimates the relief of a picture while Blender stays usable.

``python -m hfx_blender.engine.texture.relief.relief_worker INPUT.npz OUTPUT.npz``: the input holds
the arguments of :func:`.relief_estimate.estimate`, the output heights in metres, slope and
roughness.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ....errors import HfxError
from ....processes.messages import json_message
from ....processes.worker import Owner
from .relief_estimate import estimate


def main(source: str, target: str) -> None:
    """Estimate the relief of ``source`` into ``target``; an HfxError is sent to the owner."""
    owner = Owner()
    with np.load(source) as file:
        srgb, size_m, tiles = file["srgb"], file["size_m"], bool(file["tiles"])
    try:
        relief = estimate(srgb, (float(size_m[0]), float(size_m[1])), tiles=tiles)
    except HfxError as error:
        owner.send(json_message({"error": str(error)}))
        return
    with Path(target).open("wb") as stream:
        np.savez(
            stream, heights_m=relief.field.heights_m, slope=relief.slope, roughness=relief.roughness
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
