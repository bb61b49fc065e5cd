# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering samples to the actuators of a device."""

from .device import DeviceConfig
from .raster import Raster, Shortfall, Unrendered, unrendered
from .render import Renderer

__all__ = ["DeviceConfig", "Raster", "Renderer", "Shortfall", "Unrendered", "unrendered"]
