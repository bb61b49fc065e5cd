# SPDX-License-Identifier: GPL-3.0-or-later
"""Authoring: effects, areas, volumes, clips, and their files."""
