# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of samples to the actuators of a device."""

from .device_config import DeviceConfig
from .raster import Raster, Shortfall, Unrendered, unrendered
from .renderer import Renderer

__all__ = ["DeviceConfig", "Raster", "Renderer", "Shortfall", "Unrendered", "unrendered"]
