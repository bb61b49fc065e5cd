# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of ``hfx export``, and their checks before any scene is opened."""

import argparse
import os
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from ..engine.tolerance import Tolerance
from ..engine.tolerance import parse as parse_tolerance
from ..errors import UsageError
from ..export.batch.pieces import MOST_PIECES, pieces_folder
from ..export.result_files import scene_stem
from ..files.atomic import inputs_kept, refuse_taken
from ..formats.clip import COARSEST, DETAIL
from ..formats.registry import EXPORTED, FORMATS, refuse_unknown, suffixes
from ..processes import blender_session
from ..text import name_key
from .arguments import checked, pair_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``hfx export``."""
    in_blender = blender_session.inside_blender()
    parser.add_argument(
        "scenes",
        nargs="*" if in_blender else "+",
        type=Path,
        metavar="SCENE.blend",
        help="files to export" + ("; none: the open file" if in_blender else ""),
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="DIR")
    parser.add_argument(
        "-f",
        "--formats",
        action="extend",
        type=_names,
        metavar="F,...",
        help=f"{_names_of_formats(False)}; for devices {_names_of_formats(True)} (default: track; "
        "csv for devices)",
    )
    parser.add_argument("--frames", type=frames, metavar="A:B", help="both included")
    parser.add_argument(
        "--rate",
        type=checked(Fraction, lambda rate: 0 < rate <= 10000, "more than 0, at most 10000 Hz"),
        metavar="HZ",
        help="samples a second",
    )
    parser.add_argument(
        "--tolerance",
        type=_tolerance,
        metavar="T",
        help="preview, standard, exact, paper, or values such as 3mm,5ms,5%%: limits of the "
        "errors of edges, "
        "motion and strength; a contact may begin late by the ms plus the time that its "
        "approach takes for the mm (default: the scene's)",
    )
    parser.add_argument(
        "--device",
        action="append",
        metavar="NAME",
        help="a device by name or file; 'none' for no device (default: the scene's own)",
    )
    parser.add_argument("--scene", metavar="NAME", help="a scene of the file by name")
    add_profile(parser)
    parser.add_argument(
        "--full-precision", action="store_true", help="weights as 32-bit floats, not 8 bits"
    )
    parser.add_argument(
        "--record",
        action="extend",
        type=_names,
        default=[],
        metavar="WHAT,...",
        help="also record positions, velocities, depth of each vertex",
    )
    parser.add_argument(
        "--strict", action="store_true", help="a warning about a scene is an error: exit code 3"
    )
    parser.add_argument(
        "--per-clip",
        action="store_true",
        help="each named clip as files of its own, from time 0, instead of the whole timeline",
    )
    parser.add_argument(
        "--clip-detail",
        type=int,
        choices=range(COARSEST + 1),
        default=DETAIL,
        metavar="N",
        help="level of detail of bodies in game clips: 0 has all vertices, each further level "
        f"about a quarter of the vertices before (default: {DETAIL})",
    )
    work = parser.add_argument_group("many scenes, long scenes")
    work.add_argument("--jobs", type=int, default=1, metavar="N", help="worker processes")
    work.add_argument(
        "--cores",
        type=int,
        metavar="N",
        help="processor cores to use, shared among the workers (default: all of this machine); "
        "long scenes are evaluated on several, with the same results",
    )
    work.add_argument(
        "--resume",
        action="store_true",
        help="skip scenes with complete results, if the scene, its linked files, the options and "
        "the versions are unchanged",
    )
    work.add_argument(
        "--time-limit",
        type=checked(float, lambda seconds: 0.0 < seconds < 1e9, "seconds"),
        metavar="SECONDS",
        help="stop scenes, and parts of scenes, after this time",
    )
    work.add_argument(
        "--split",
        type=int,
        metavar="FRAMES",
        help="record scenes in parts of this many frames (default: the last long scenes, in one "
        "part per worker); the results are the same",
    )
    work.add_argument(
        "--piece",
        type=checked(
            pair_of(int, "/"),
            lambda piece: 1 <= piece[0] <= piece[1] <= MOST_PIECES,
            f"K/N, such as 1/8, with K from 1 to N and N to {MOST_PIECES}",
        ),
        metavar="K/N",
        help="record only piece K of N, for --merge; on a farm each piece is a job",
    )
    work.add_argument(
        "--merge",
        action="store_true",
        help="combine the pieces into the files of one export; needs the same options",
    )
    work.add_argument("--report", type=Path, metavar="FILE", help="write the result as JSON")


def add_profile(parser: argparse.ArgumentParser) -> None:
    """Add the option of a person's profile."""
    parser.add_argument(
        "--profile",
        default="",
        metavar="NAME",
        help="play at the strengths that a person feels ('hfx profile make')",
    )


def _names_of_formats(of_devices: bool) -> str:
    """Ids of export formats for devices, or of the other formats, joined by commas."""
    infos = (FORMATS[id] for id in EXPORTED)
    names = [i.id for i in infos if of_devices == (i.is_of_device or bool(i.write_played))]
    return ", ".join(names)


def check(options: argparse.Namespace) -> None:
    """Raise UsageError for options that no scene could be exported with, InputError for an unusable
    device."""
    from ..devices.configuration import load_device
    from ..devices.configurations.person_profile import load, personal
    from ..engine.areas.sample_run_builder import ON_DEMAND

    refuse_unknown(options.formats or (), "-f")
    # A faulty device or profile ends the command before any scene is opened.
    for name in options.device or ():
        if name != "none":
            personal(load_device(name), options.profile)
    if options.profile:
        load(options.profile)
    unknown = sorted(set(options.record) - ON_DEMAND)
    if unknown:
        raise UsageError(f"--record {unknown[0]}: expected some of {', '.join(sorted(ON_DEMAND))}")
    for name, what in (("jobs", "1"), ("cores", "1"), ("split", "1 frame")):
        count = getattr(options, name)
        if count is not None and count < 1:
            raise UsageError(f"--{name} {count}: expected at least {what}")
    if options.piece is not None and options.merge:
        raise UsageError("--merge: comes after all pieces, in a command without --piece")
    if options.split is not None and (options.piece is not None or options.merge):
        raise UsageError("--split: makes parts within one command; --piece K/N has pieces already")
    if options.report is not None:
        with inputs_kept(options.scenes):
            refuse_taken(options.report)
        _refuse_result(options)
    for path in (*options.scenes, options.output):
        blender_session.refuse_name(path)
    # Results of all scenes are in the same folder, named by the scenes.
    _refuse_same_names([scene_stem(path) for path in options.scenes])


def _refuse_same_names(stems: Sequence[str]) -> None:
    """Raise UsageError for scenes whose results may have equal file names on some file system."""
    groups: dict[str, list[str]] = {}
    for stem in stems:
        groups.setdefault(name_key(stem), []).append(stem)
    colliding = [list(dict.fromkeys(group)) for group in groups.values() if len(group) > 1]
    texts = [
        f"several scenes are named '{names[0]}'"
        if len(names) == 1
        else f"scenes {' and '.join(map(repr, names))} have names that are one where case or "
        "accents do not count"
        for names in colliding
    ]
    if texts:
        cure = "; rename one of them" if any(len(names) > 1 for names in colliding) else ""
        raise UsageError(f"{'; '.join(texts)}: their results would collide{cure}")


def _refuse_result(options: argparse.Namespace) -> None:
    """Raise UsageError for a ``--report`` with the name of a possible result of a scene."""
    from ..files.kinds import REPORT_SUFFIX

    folder = Path(os.path.realpath(options.output))
    report = Path(os.path.realpath(options.report.parent)) / options.report.name
    of_results = (REPORT_SUFFIX, *suffixes(options.formats or EXPORTED))
    # A report with the name of a result would collide with the result. Links are resolved, as
    # both names may lead to the same file.
    for stem in [scene_stem(path) for path in options.scenes] or [open_stem()]:
        is_there = report.parent == folder or folder / stem in report.parents
        name = name_key(report.name)
        is_result = name.startswith(name_key(f"{stem}.")) and name.endswith(of_results)
        is_piece = report.parent == pieces_folder(folder, stem) and "-of-" in report.name
        if (is_there and is_result) or is_piece:
            raise UsageError(
                f"--report {options.report}: is a result of this export, of '{stem}'; choose "
                "another name, such as batch.json"
            )


def open_stem() -> str:
    """File stem for the results of the open file; ``untitled`` for an unsaved file."""
    import bpy

    return scene_stem(Path(bpy.data.filepath)) or "untitled"


def _names(text: str) -> list[str]:
    """Split names at commas."""
    return text.split(",")


frames = checked(pair_of(int, ":"), lambda pair: True, "A:B, two frames")
"""Parser of A:B, first and last frame, for argparse."""


def _tolerance(text: str) -> Tolerance:
    try:
        return parse_tolerance(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
