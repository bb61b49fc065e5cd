# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures of the documentation anew: ``python docs/regenerate.py``."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PICTURES = Path(__file__).resolve().parent / "pictures"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "hfx_blender.cli", "demo", "-o", folder], check=True)
        PICTURES.mkdir(exist_ok=True)
        for name in ("felt.png", "chart.svg"):
            shutil.copy(Path(folder) / name, PICTURES / name)


if __name__ == "__main__":
    main()
