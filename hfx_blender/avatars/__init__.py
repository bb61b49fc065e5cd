# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars and their haptic bodies: the binding of body models to a user's rig."""
