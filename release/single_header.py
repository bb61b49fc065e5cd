# SPDX-License-Identifier: GPL-3.0-or-later
"""The core of the players as one header with its licence: ``dist/hfx_player.h``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

CORE = Path(__file__).resolve().parents[1] / "players" / "core"
_INCLUDE = re.compile(r'^#include "(hfx_\w+\.h)"\n', re.MULTILINE)


def single_header(core: Path = CORE) -> str:
    """Text of ``hfx_player.h`` with each header of the core in the place of its ``#include``."""
    text = (core / "hfx_player.h").read_text("utf-8")
    text = _INCLUDE.sub(lambda line: (core / line[1]).read_text("utf-8"), text)
    licence = (core / "LICENSE").read_text("utf-8").strip()
    return f"/*\n{licence}\n*/\n\n{text}"


if __name__ == "__main__":
    target = Path(sys.argv[1] if sys.argv[1:] else "dist") / "hfx_player.h"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(single_header(), "utf-8")
    sys.stdout.write(f"{target}\n")
