# SPDX-License-Identifier: GPL-3.0-or-later
"""Regenerate the pictures and the measured tables of the documentation.

``python docs/regenerate.py`` makes all; ``python docs/regenerate.py pictures``, ``devices``,
``schema``, ``assets``, ``bodies``, ``tracks``, ``surfaces``, ``trade`` or ``avatars`` only those.
``schema`` is the JSON Schema of device configurations. ``assets`` is the library of the Asset
Browser, to be regenerated when a sensation of ``effect_library`` changes. The trade takes half an
hour on an idle machine, a minute or two with ``--short``. ``avatars`` fits models to a hundred
avatars with a known result; this subject needs MakeHuman's data (for the source see
``tests/engine/retargeting/retarget_report.py``), takes long, and is made only if named. The table
of ``safety`` is made from the output of ``hfx bench safety --json``, idle and with ``--busy``:
``python docs/regenerate.py safety --record IDLE.json --record BUSY.json``. The README's moving
picture is made from the pictures of the journey ``moving_picture`` (see ``CONTRIBUTING.md``):
``python docs/regenerate.py film --frames out/gui/moving_picture``.
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
from typing import Any

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "pictures"
SCENES = ("demo", "crowded", "fast", "fine")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "subjects",
        nargs="*",
        metavar="SUBJECT",
        help="pictures, devices, schema, assets, bodies, tracks, surfaces, trade, safety, "
        "avatars, film",
    )
    parser.add_argument("--scene", action="append", choices=SCENES, help="trade: only these")
    parser.add_argument(
        "--record", action="append", type=Path, default=[], help="safety: of 'hfx bench safety'"
    )
    parser.add_argument("--frames", type=Path, help="film: results of the journey")
    parser.add_argument("--short", action="store_true", help="trade: rough figures")
    options = parser.parse_args()
    usual = "pictures devices schema assets bodies tracks surfaces trade"
    subjects = options.subjects or usual.split()
    PICTURES.mkdir(exist_ok=True)
    if "pictures" in subjects:
        demo()
    if "devices" in subjects:
        devices()
    if "schema" in subjects:
        schema()
    if "assets" in subjects:
        folder = str(DOCS.parent / "effect_library")
        module = "hfx_tools.demo.sensation_assets"
        subprocess.run([sys.executable, "-P", "-m", module, folder], check=True)
    if "bodies" in subjects:
        bodies()
    if "tracks" in subjects:
        command = [sys.executable, str(DOCS.parent / "tests/engine/track/size_report.py")]
        sizes = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        replace_part(DOCS / "track-format.md", "sizes", sizes.strip())
    if "surfaces" in subjects:
        surfaces()
    if "trade" in subjects:
        for scene in options.scene or SCENES:
            trade(scene, options.short)
    if "avatars" in subjects:
        for script, *more in (("retarget_report.py",), ("dressed_report.py", "--write")):
            path = DOCS.parent / "tests/engine/body" / script
            subprocess.run([sys.executable, str(path), *more], check=True)
    if "safety" in subjects:
        if not options.record:
            parser.error("safety: no --record")
        safety([json.loads(path.read_text(encoding="utf-8")) for path in options.record])
    if "film" in subjects:
        if options.frames is None:
            parser.error("film: no --frames")
        film(options.frames)


def demo() -> None:
    """Copy the pictures drawn by ``hfx demo`` into the documentation."""
    with tempfile.TemporaryDirectory() as folder:
        hfx("demo", "-o", folder)
        for name in ("felt.png", "chart.svg"):
            shutil.copy(Path(folder) / name, PICTURES / name)
        hfx("demo", "--scene", "belt", "-o", folder)
        shutil.copy(Path(folder) / "belt.svg", PICTURES / "belt.svg")


def bodies() -> None:
    """Write the tables of vertex spacing in ``body-models.md``."""
    from hfx_blender.engine.body import model_library
    from hfx_tools.body_building import stats

    replace_part(DOCS / "body-models.md", "spacing", stats.as_markdown(model_library.manifest()))


def surfaces() -> None:
    """Measure renderer against roughness (picture, table), classified strokes, and words."""
    from hfx_tools.bench.surfaces import textile_correlation, texture, texture_chart, words

    result = textile_correlation.correlation(20)
    texture_chart.draw(result, PICTURES / "surfaces-roughness.svg")
    replace_part(DOCS / "surfaces.md", "correlation", textile_correlation.as_markdown(result))
    replace_part(DOCS / "surfaces.md", "judge", texture.as_markdown())
    replace_part(DOCS / "surfaces-from-words.md", "words", words.as_markdown())


def devices() -> None:
    """Draw the places of each shipped device's actuators, and the gallery in ``devices.md``."""
    import device_pictures

    folder = DOCS.parent / "device_configs" / "pictures"  # the editor shows them, too
    names = sorted(path.stem for path in folder.parent.glob("*.json"))
    for name in names:
        device_pictures.draw(name, folder / f"{name}.png")
    gallery = "\n".join(f"| `{n}` | ![{n}](../device_configs/pictures/{n}.png) |" for n in names)
    replace_part(DOCS / "devices.md", "gallery", f"| device | worn |\n|---|---|\n{gallery}")


def schema() -> None:
    """Write the JSON Schema of device configurations, for editors."""
    from hfx_blender.files import resources
    from hfx_tools.json_schema import device_schema

    path = resources.device_configs() / "schema" / "device.schema.json"
    path.write_text(device_schema(), encoding="utf-8")


def trade(scene: str, short: bool) -> None:
    """Measure time against error of a scene; writes plot, CSV and the table in ``trade.md``."""
    from hfx_tools.bench import machine
    from hfx_tools.bench.trade import trade_report

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
    replace_part(DOCS / "trade.md", scene, section)


def safety(records: list[dict[str, Any]]) -> None:
    """Write the table of silence in ``live.md`` from records of ``hfx bench safety --json``."""
    from hfx_tools.bench import machine
    from hfx_tools.bench.safety import safety

    caption = f"Measured on {machine.as_one_line([record['machine'] for record in records])}."
    table = safety.as_markdown(records)
    replace_part(DOCS / "live.md", "safety", f"{caption}\n\n{table}")


def film(folder: Path) -> None:
    """Join the pictures of the journey ``moving_picture`` to an animated WebP."""
    from PIL import Image

    facts = json.loads((folder / "film.json").read_text(encoding="utf-8"))
    paths = [folder / f"film_{number:04}.png" for number in range(len(facts["milliseconds"]))]
    first, *others = (Image.open(path).convert("RGB").crop(facts["box"]) for path in paths)
    first.save(
        PICTURES / "editor.webp",
        save_all=True,
        append_images=others,
        duration=facts["milliseconds"],
        loop=0,  # for ever
        quality=70,
        method=6,
    )


def replace_part(page: Path, name: str, content: str) -> None:
    """Replace the marked part of a page.

    Raises
    ------
    SystemExit
        The page has no such markers.
    """
    begin, end = f"<!-- {name}: made by docs/regenerate.py -->", f"<!-- end of {name} -->"
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"{page}: no markers of '{name}'")
    updated = pattern.sub(lambda _: f"{begin}\n{content}\n{end}", text)
    page.write_text(updated, encoding="utf-8")


def hfx(*arguments: str) -> str:
    """Run a command of hfx; returns its standard output."""
    command = [sys.executable, "-P", "-m", "hfx_blender", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    main()
