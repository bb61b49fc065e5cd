# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces: height fields, haptic maps, strokes and their rendering."""
