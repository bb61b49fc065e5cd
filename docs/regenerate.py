# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the pictures and the measured tables of the documentation anew.

``python docs/regenerate.py`` makes all; ``python docs/regenerate.py pictures`` or ``trade`` only
those. The trade takes a quarter of an hour on an idle machine, a minute or two with ``--short``.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "pictures"
SCENES = ("demo", "crowded", "fast", "fine")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help="pictures, trade")
    parser.add_argument("--scene", action="append", choices=SCENES, help="trade: only these")
    parser.add_argument("--short", action="store_true", help="trade: rough figures")
    options = parser.parse_args()
    subjects = options.subjects or ["pictures", "trade"]
    PICTURES.mkdir(exist_ok=True)
    if "pictures" in subjects:
        demo()
    if "trade" in subjects:
        for scene in options.scene or SCENES:
            trade(scene, options.short)


def demo() -> None:
    """The pictures that ``hfx demo`` draws."""
    with tempfile.TemporaryDirectory() as folder:
        hfx("demo", "-o", folder)
        for name in ("felt.png", "chart.svg"):
            shutil.copy(Path(folder) / name, PICTURES / name)


def trade(scene: str, short: bool) -> None:
    """One scene's plot, CSV and table in ``trade.md``."""
    from hfx_blender.bench import machine, trade_report

    command = ["bench", "trade", scene, *(["--short"] if short else [])]
    done = hfx(*command, "--json", "-o", str(PICTURES))
    record = json.loads(done)
    result = record["trade"]
    section = "\n".join(
        [
            f"`hfx {' '.join(command)}`",
            "",
            f"{trade_report.title(result)}. Measured on {machine.as_line(record['machine'])}"
            + (", a part of the scene only, timed once." if short else "."),
            "",
            f"![{scene}: time against error](pictures/trade-{scene}.svg)",
            "",
            trade_report.as_markdown(result),
        ]
    )
    page = DOCS / "trade.md"
    begin, end = f"<!-- {scene}: made by docs/regenerate.py -->", f"<!-- end of {scene} -->"
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"{page}: has no place for '{scene}'")
    made = pattern.sub(lambda _: f"{begin}\n{section}\n{end}", text)
    page.write_text(made, encoding="utf-8")


def hfx(*arguments: str) -> str:
    """Run a command of hfx; what it says."""
    command = [sys.executable, "-m", "hfx_blender.cli", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    main()
