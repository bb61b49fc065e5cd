# SPDX-License-Identifier: GPL-3.0-or-later
"""Files besides the .blend that the open scene is made of: whatever it reaches by a path.

Blender is asked for them, so that no kind is forgotten; what it does not tell (folders of baked
simulations and external caches, files that geometry nodes import, our scans) is added.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..errors import InputError, is_endless
from ..files.hashes import FRAMES, MOST_FILES, holds_too_many, is_elsewhere, is_of_a_kind
from . import compat, stored_values


@dataclass(frozen=True)
class LinkedFile:
    """A file, a folder or a row of files."""

    path: Path
    user: str  # as messages name it
    must_be: bool  # nothing of it is in the .blend, and Blender does not make it by itself


def linked_files() -> dict[str, LinkedFile]:
    """External files of the open file, by name.

    A name begins with ``//``, the folder of the .blend, where the path is relative: so it means
    the same where that folder was moved as a whole. A path that is not is the name itself.
    """
    found: dict[str, LinkedFile] = {}
    for owner, raw, must_be in _paths():
        path = Path(bpy.path.abspath(raw, library=owner.library))
        if _is_row(owner, path):
            path = path.with_name(re.sub(r"\d+(?=\D*$)", FRAMES, path.name, count=1))
        user = f"{owner.bl_rna.name.lower()} '{owner.name}'"
        name = _name_of(raw, path)
        must_be = must_be or (name in found and found[name].must_be)
        found[name] = LinkedFile(path, user, must_be)
    return dict(sorted(found.items()))


def files_read() -> list[Path]:
    """The .blend that is open, and all files that it is made of."""
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    linked = [each.path for each in linked_files().values()]
    return [*filter(None, [source]), *(path for path in linked if not is_elsewhere(path, source))]


def refuse_endless() -> None:
    """Refuse an open file that names a pipe, a device or a socket as one of its files.

    Raises
    ------
    InputError
        Reading it might never end.
    """
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    for name, each in linked_files().items():
        if not is_elsewhere(each.path, source) and is_endless(each.path):
            raise InputError(f"'{name}' of {each.user} is a pipe, a device or a socket, no file.")


def missing() -> list[str]:
    """Warnings for files that should exist and do not, and for folders that are none of ours."""
    found = []
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    for name, each in linked_files().items():
        if is_elsewhere(each.path, source):
            found.append(
                f"'{name}' of {each.user} is on another machine: it is not compared, and --resume "
                "exports the scene again"
            )
        elif each.path.is_file() and not is_of_a_kind(each.path):
            found.append(
                f"'{name}' of {each.user} is of no kind of file that a scene is made of: it is "
                "not read, and --resume exports the scene again"
            )
        elif each.must_be and each.path.is_dir():
            found.append(f"'{name}' of {each.user} is a folder, not a file: nothing of it is used")
        elif each.must_be and _is_gone(each):
            found.append(
                f"'{name}' of {each.user} is not there: what it holds is not in the export"
            )
        elif holds_too_many(each.path):
            found.append(
                f"'{name}' of {each.user} holds more than {MOST_FILES} files: they are not "
                "compared, and --resume exports the scene again"
            )
    return found


def _is_gone(each: LinkedFile) -> bool:
    if each.path.exists():
        return False
    start = re.split(f"{FRAMES}|<UDIM>|<UVTILE>", each.path.name)[0]
    if start == each.path.name:
        return True
    try:
        return not any(p.name.startswith(start) for p in each.path.parent.iterdir())
    except OSError:
        return True


_Path = tuple[bpy.types.ID, str, bool]
"""Owner of a path, the path as it is stored, and whether the file must exist."""


def _paths() -> Iterator[_Path]:
    """Paths of all external files: those that Blender tells, and those that it does not."""
    yield from _told_paths()
    yield from _paths_of_objects()
    yield from _paths_of_nodes()
    yield from _paths_of_caches()


def _told_paths() -> Iterator[_Path]:
    folders = {
        bpy.path.abspath(raw, library=obj.library)
        for obj in bpy.data.objects
        for raw in _folders_of(obj)
    }
    for owner, paths in compat.file_path_map().items():
        if isinstance(owner, bpy.types.Text) or _is_packed(owner):
            continue  # the .blend holds them
        for raw in paths:
            path = bpy.path.abspath(raw, library=owner.library)
            # Blender 5 names the folder of point caches, whether anything is cached on disk or not.
            is_cache = Path(path).name.startswith("blendcache_")
            yield owner, raw, path not in folders and not is_cache


def _paths_of_objects() -> Iterator[_Path]:
    """Folders of modifiers and particles, and scans that surfaces were made from."""
    for obj in bpy.data.objects:
        for raw in _folders_of(obj):
            yield obj, raw, False
        # As it is stored: Blender forgets a value of another type where a property is read.
        if not stored_values.stored_at(obj, "surface", "scan_path"):
            continue
        surface = obj.hfx.surface
        if obj.hfx.kind == "SURFACE" and surface.source == "SCAN" and surface.scan_path:
            yield obj, surface.scan_path, False  # its relief is in the .blend


def _paths_of_nodes() -> Iterator[_Path]:
    """Files that geometry nodes import."""
    for tree in bpy.data.node_groups:
        for node in tree.nodes:
            for socket in node.inputs if node.bl_idname.startswith("GeometryNodeImport") else ():
                raw = getattr(socket, "default_value", "")
                if socket.name == "Path" and raw and not socket.is_linked:
                    yield tree, raw, True


def _paths_of_caches() -> Iterator[_Path]:
    """Folders of point caches beside the file, and beside its libraries."""
    source = Path(bpy.data.filepath)
    if bpy.data.filepath and bpy.data.objects:
        yield bpy.data.objects[0], f"//blendcache_{source.stem}", False
    for library in bpy.data.libraries:
        path = Path(bpy.path.abspath(library.filepath))
        raw = str(path.with_name(f"blendcache_{path.stem}"))
        if library.filepath.startswith("//") and bpy.data.filepath:
            raw = bpy.path.relpath(raw)
        yield library, raw, False


def _folders_of(obj: bpy.types.Object) -> set[str]:
    """Folders in which Blender bakes or has baked; they need not exist."""
    found = set()
    for modifier in obj.modifiers:
        if modifier.type == "NODES":
            found |= {modifier.bake_directory}
            found |= {bake.directory for bake in modifier.bakes if bake.use_custom_path}
        elif modifier.type == "OCEAN":
            found.add(modifier.filepath)
        elif modifier.type == "FLUID" and modifier.domain_settings is not None:
            found.add(modifier.domain_settings.cache_directory)
        cache = getattr(modifier, "point_cache", None)
        if cache is not None and cache.use_external:
            found.add(cache.filepath)
    for system in obj.particle_systems:
        if system.point_cache.use_external:
            found.add(system.point_cache.filepath)
    return found - {""}


def _is_packed(owner: bpy.types.ID) -> bool:
    files = getattr(owner, "packed_files", ())
    return getattr(owner, "packed_file", None) is not None or len(files) > 0


def _is_row(owner: bpy.types.ID, path: Path) -> bool:
    """Test a path for a numbered row of files, of which it names one."""
    is_row = getattr(owner, "source", "") == "SEQUENCE" or getattr(owner, "is_sequence", False)
    return bool(is_row) and re.search(r"\d", path.name) is not None


def _name_of(raw: str, path: Path) -> str:
    if not raw.startswith("//") or not bpy.data.filepath:
        return str(path)
    try:
        relative = os.path.relpath(path, Path(bpy.data.filepath).parent)
    except ValueError:  # on another drive
        return str(path)
    return "//" + Path(relative).as_posix()
