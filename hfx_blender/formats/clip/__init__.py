# SPDX-License-Identifier: GPL-3.0-or-later
"""Game clips (``.hfxclip``): what devices play and what avatars can feel, for players in games.

``docs/formats/clip.md`` is the format's page; ``players/`` reads it in games.
"""
