# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of samples to the actuators of a device."""
