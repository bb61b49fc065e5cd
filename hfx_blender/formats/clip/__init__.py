# SPDX-License-Identifier: GPL-3.0-or-later
"""Game clips (``.hfxclip``): device output and avatar effects for players in games.

``docs/formats/clip.md`` specifies the format; ``players/`` has readers for games.
"""

from typing import Final

DETAIL: Final = 1  # default level of detail of bodies: 10 to 20 mm on the torso, as in the paper
COARSEST: Final = 2
