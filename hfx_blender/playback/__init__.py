# SPDX-License-Identifier: GPL-3.0-or-later
"""Playback: the preview in the viewport and live devices, while the scene plays."""
