# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks and facts of files, for formats that Blender writes and does not read."""
