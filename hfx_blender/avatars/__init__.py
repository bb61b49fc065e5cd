# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars and their haptic bodies: how a body model is bound to somebody's rig."""
