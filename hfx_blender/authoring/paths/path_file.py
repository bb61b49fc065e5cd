# SPDX-License-Identifier: GPL-3.0-or-later
"""Path files (``.hfxpath``) on the skin, and the library of shipped paths.

A file contains the control points of a path, and optionally a motion. There is no code
and no file path in a file.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ...errors import InputError
from ...files import json_shapes, kinds, resources
from ...files.atomic import atomic_file
from ...files.kinds import refuse_another

SUFFIX: Final = kinds.PATH_SUFFIX
SCHEMA: Final = "hfx-path"
VERSION: Final = 1

KINDS: Final = ("straight", "curve", "traced")
MAX_POINTS: Final = 100_000
_MOST_BYTES: Final = 16 << 20
"""Largest file; a point takes up to 90 bytes."""

Place = tuple[float, float, float]


@dataclass(frozen=True)
class PathRecipe:
    """Path through points of the canonical body's rest space, metres."""

    name: str
    points_m: tuple[Place, ...]
    kind: str = "straight"  # "straight" (shortest paths), "curve" or "traced" (point after point)
    is_closed: bool = False
    description: str = ""
    motion: tuple[tuple[float, float], ...] = ()  # (seconds, share of the path)


def _path(
    schema: str, version: int, kind: str, name: str, points_m: tuple[Place, ...], **more: Any
) -> PathRecipe:
    is_closed = more.pop("closed", 0) == 1
    return PathRecipe(name, points_m, kind, is_closed, **more)


POINTS: Final = json_shapes.Items(json_shapes.numbers(3, -3.0, 3.0, "m"), 1, MAX_POINTS)
CLOSED: Final = json_shapes.Number(0, 1, is_whole=True)
_PATH: Final = json_shapes.strict(
    {
        "schema": json_shapes.Text((SCHEMA,)),
        "version": json_shapes.Number(VERSION, VERSION, is_whole=True),
        "name": json_shapes.PRINTABLE,
        "kind": json_shapes.Text(KINDS),
        "points_m": POINTS,
    },
    {"description": json_shapes.PRINTABLE, "closed": CLOSED, "motion": json_shapes.curve()},
    into=_path,
)


def load(path: Path) -> PathRecipe:
    """Read and check a path file; InputError with file, field, found and allowed value."""
    return recipe_of(json_shapes.read(path, _MOST_BYTES))


def recipe_of(document: json_shapes.Node) -> PathRecipe:
    """Path of a parsed document; errors of :func:`load`."""
    refuse_another(document.value, document.file, SCHEMA)
    path: PathRecipe = document.read(_PATH)
    return path


def save(recipe: PathRecipe, path: Path) -> None:
    """Write a path file; an existing file is replaced only after a complete write.

    Raises InputError for a path that :func:`load` would refuse: too many points. Raises
    OutputError: the file cannot be written.
    """
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "version": VERSION,
        "name": recipe.name,
        "kind": recipe.kind,
        "closed": int(recipe.is_closed),
        "points_m": recipe.points_m,
    }
    if recipe.description:
        document["description"] = recipe.description
    if recipe.motion:
        document["motion"] = recipe.motion
    content = (json.dumps(document, indent=1) + "\n").encode()
    recipe_of(json_shapes.node_of(content, f"Path '{recipe.name}'", _MOST_BYTES))
    with atomic_file(path) as file:
        file.write(content)


def library() -> dict[str, Path]:
    """Shipped paths: file paths by file name without suffix, sorted."""
    folder = resources.effect_library() / "paths"
    return {path.stem: path for path in sorted(folder.glob("*" + SUFFIX))}


def load_library(name: str) -> PathRecipe:
    """Load a shipped path by name; InputError lists the known names otherwise."""
    files = library()
    if name not in files:
        raise InputError(f"There is no path '{name}' in the library: {', '.join(files)}.")
    return load(files[name])
