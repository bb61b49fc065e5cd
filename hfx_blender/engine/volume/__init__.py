# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes: unit shapes in shape space, placed in the world by affine matrices."""
