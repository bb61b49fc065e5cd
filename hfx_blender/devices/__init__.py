# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic devices: configurations, scripts, and live output to hardware."""
