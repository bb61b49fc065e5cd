# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic devices: their configurations, and live output to hardware."""
