# SPDX-License-Identifier: GPL-3.0-or-later
"""Game clips (``.hfxclip``): what devices play and what avatars can feel, for players in games.

``docs/formats/clip.md`` is the format's page; ``players/`` reads it in games.
"""

from __future__ import annotations

from typing import Final

DETAIL: Final = 1
"""Usual level of detail of bodies: 10 to 20 mm on the torso, as the paper's own."""

COARSEST: Final = 2
