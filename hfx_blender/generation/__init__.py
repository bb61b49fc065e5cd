# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from words and from pictures of any generator: colour, height and haptic map.

Never imports ``bpy``. Back ends return a :class:`.generated.Generated`.
"""
