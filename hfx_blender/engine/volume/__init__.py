# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes: unit shapes in their own space; an affine matrix places them in the world."""
