# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces: samples of moving contacts, and device-specific drive c_v."""
