# SPDX-License-Identifier: GPL-3.0-or-later
"""Outputs of a device: the simulator, or a real connection."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ...engine.rendering.device import DeviceConfig
from . import opening
from .output import Output
from .simulator import Simulator

SIMULATOR: Final = "simulator"


def open_output(device: DeviceConfig, target: Mapping[str, Any]) -> Output:
    """Open the output that ``target`` names.

    Parameters
    ----------
    target : mapping
        ``{"kind": "simulator"}``, with the ``path`` of a log if one is wanted; other kinds as
        :func:`~hfx_blender.devices.host.opening.open_output` takes them.

    Raises
    ------
    OutputLostError
        There is no such output, or it cannot be opened.
    """
    if target.get("kind") == SIMULATOR:
        path = target.get("path")
        return Simulator(None if path is None else Path(str(path)))
    return opening.open_output(device, target)
