# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX: a haptic editor for full-body immersive experiences."""

__version__ = "0.1.0"
