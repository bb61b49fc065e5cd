# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from words and from pictures of other generators: colour, height and haptic map.

Pure Python and numpy; never imports ``bpy``. The back ends give a :class:`.generated.Generated`.
"""
