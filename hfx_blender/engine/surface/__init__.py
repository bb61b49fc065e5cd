# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces in a scene: samples of skin that moves over them, and each device's c_v."""
