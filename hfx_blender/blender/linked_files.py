# SPDX-License-Identifier: GPL-3.0-or-later
"""External files of the open .blend: all files that datablocks refer to by path.

Most paths come from Blender's own list. Added are folders of baked simulations and of external
caches, files imported by geometry nodes, and scans.
"""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import bpy

from ..errors import InputError, is_endless
from ..files.hashes import FRAMES, MOST_FILES, holds_too_many, is_elsewhere, is_of_a_kind
from ..text import shortened
from . import compat, stored_values


@dataclass(frozen=True)
class LinkedFile:
    """External file, folder or numbered sequence of files."""

    path: Path
    user: str  # type and name of the datablock, for messages
    must_be: bool  # False for optional files: caches, and files with a copy in the .blend


def linked_files() -> dict[str, LinkedFile]:
    """External files of the open .blend, sorted by name. A relative path is named from ``//``, the
    folder of the .blend, so names stay valid if the folder is moved as a whole. An absolute path is
    the name itself."""
    files: dict[str, LinkedFile] = {}
    may_have = (obj for obj in bpy.data.objects if obj.modifiers or obj.particle_systems)
    folders = {obj: _folders_of(obj) for obj in may_have}
    of_objects = _paths_listed_by_blender(folders), _paths_of_objects(folders)
    for owner, raw, must_be in chain(*of_objects, _paths_of_nodes(), _paths_of_caches()):
        path = Path(bpy.path.abspath(raw, library=owner.library))
        # A numbered sequence names one file of many. The last digits become a placeholder.
        is_row = getattr(owner, "source", "") == "SEQUENCE" or getattr(owner, "is_sequence", False)
        if is_row and re.search(r"\d", path.name):
            path = path.with_name(re.sub(r"\d+(?=\D*$)", FRAMES, path.name, count=1))
        user = f"{owner.bl_rna.name.lower()} '{owner.name}'"
        name = str(path)
        if raw.startswith("//") and bpy.data.filepath:
            with suppress(ValueError):  # a path on another drive stays absolute
                relative = os.path.relpath(path, Path(bpy.data.filepath).parent)
                name = "//" + Path(relative).as_posix()
        # A file is required if any of its users requires it.
        must_be = must_be or (name in files and files[name].must_be)
        files[name] = LinkedFile(path, user, must_be)
    return dict(sorted(files.items()))


def files_read(files: Mapping[str, LinkedFile]) -> list[Path]:
    """Paths of the open .blend, if saved, and of those of its external ``files`` on this
    machine."""
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    paths = [file.path for file in files.values()]
    return [*filter(None, [source]), *(path for path in paths if not is_elsewhere(path, source))]


def refuse_endless() -> None:
    """Raise InputError if an external file is a pipe, device or socket: reading may never end."""
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    for name, file in linked_files().items():
        if not is_elsewhere(file.path, source) and is_endless(file.path):
            raise InputError(f"'{name}' of {file.user} is a pipe, a device or a socket, no file.")


def warnings_of_files(files: Mapping[str, LinkedFile]) -> list[str]:
    """Warnings: missing ``files``, folders in place of files, and files that --resume ignores."""
    source = Path(bpy.data.filepath) if bpy.data.filepath else None
    again = "--resume exports the scene again"
    warnings = []
    for name, file in files.items():
        fault = None
        if is_elsewhere(file.path, source):
            fault = f"is on another machine: it is not compared, and {again}"
        elif file.path.is_file() and not is_of_a_kind(file.path):
            fault = f"has an unknown file type: it is not read, and {again}"
        elif file.must_be and file.path.is_dir():
            fault = "is a folder, not a file: it is not used"
        elif file.must_be and _is_missing(file.path):
            fault = "is missing: its content is not in the export"
        elif holds_too_many(file.path):
            fault = f"holds more than {MOST_FILES} files: they are not compared, and {again}"
        if fault is not None:
            warnings.append(f"'{name}' of {file.user} {fault}")
    return warnings + missing_data()


def missing_data() -> list[str]:
    """One warning for each library with linked data-blocks that Blender found nowhere: the file is
    missing, or the data-block is renamed or removed in it."""
    warnings = []
    for library in bpy.data.libraries:
        missing = sorted(
            f"{data.bl_rna.name.lower()} '{data.name}'"
            for data in library.users_id
            if data.is_missing
        )
        if missing:
            warnings.append(
                f"linked data-blocks are missing from library '{library.name}' "
                f"({library.filepath}), and from the export: {', '.join(shortened(missing, 10))}"
            )
    return warnings


def _is_missing(path: Path) -> bool:
    """Test that no file has the path, or for a sequence or tiles the start of its name; True for an
    unreadable folder."""
    if path.exists():
        return False
    # A sequence or tiled image exists if any of the files does.
    start = re.split(f"{FRAMES}|<UDIM>|<UVTILE>", path.name)[0]
    if start == path.name:
        return True
    try:
        return not any(file.name.startswith(start) for file in path.parent.iterdir())
    except OSError:
        return True


_Path = tuple[bpy.types.ID, str, bool]
"""Datablock with a path, the path as stored, and a flag for files that must exist."""


def _paths_listed_by_blender(folders_of: Mapping[bpy.types.Object, set[str]]) -> Iterator[_Path]:
    """Yield the external files that Blender lists, without texts and packed files. Folders of bakes
    (``folders_of``, paths by object) and point caches are among these, and need not exist."""
    folders = {
        bpy.path.abspath(raw, library=obj.library)
        for obj, paths in folders_of.items()
        for raw in paths
    }
    for owner, paths in compat.file_path_map().items():
        if not paths:
            continue  # most data-blocks
        is_packed = getattr(owner, "packed_file", None) is not None
        if (
            isinstance(owner, bpy.types.Text)
            or is_packed
            or len(getattr(owner, "packed_files", ()))
        ):
            continue  # the .blend contains the data
        for raw in paths:
            path = bpy.path.abspath(raw, library=owner.library)
            # Blender 5 lists the folder of point caches even if missing.
            is_cache = Path(path).name.startswith("blendcache_")
            yield owner, raw, path not in folders and not is_cache


def _paths_of_objects(folders_of: Mapping[bpy.types.Object, set[str]]) -> Iterator[_Path]:
    """Yield cache folders of objects, and scan files of surfaces with that source; all optional."""
    for obj in bpy.data.objects:
        for raw in folders_of.get(obj, ()):
            yield obj, raw, False
        # The raw stored value: reading the property erases a value of another type.
        if not stored_values.stored_at(obj, "surface", "scan_path"):
            continue
        surface = obj.hfx.surface
        if obj.hfx.kind == "SURFACE" and surface.source == "SCAN" and surface.scan_path:
            yield obj, surface.scan_path, False  # the .blend contains the relief


def _paths_of_nodes() -> Iterator[_Path]:
    """Yield the value of each unlinked socket "Path" of geometry nodes' import nodes; required."""
    for tree in bpy.data.node_groups:
        for node in tree.nodes:
            for socket in node.inputs if node.bl_idname.startswith("GeometryNodeImport") else ():
                raw = getattr(socket, "default_value", "")
                if socket.name == "Path" and raw and not socket.is_linked:
                    yield tree, raw, True


def _paths_of_caches() -> Iterator[_Path]:
    """Yield the folders ``blendcache_<stem>`` of point caches next to the saved .blend, for the
    first object, and next to each library; they need not exist."""
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
    """Folders of baked simulations and external caches of an object, possibly missing."""
    folders = set()
    for modifier in obj.modifiers:
        if modifier.type == "NODES":
            folders |= {modifier.bake_directory}
            folders |= {bake.directory for bake in modifier.bakes if bake.use_custom_path}
        elif modifier.type == "OCEAN":
            folders.add(modifier.filepath)
        elif modifier.type == "FLUID" and modifier.domain_settings is not None:
            folders.add(modifier.domain_settings.cache_directory)
        cache = getattr(modifier, "point_cache", None)
        if cache is not None and cache.use_external:
            folders.add(cache.filepath)
    for system in obj.particle_systems:
        if system.point_cache.use_external:
            folders.add(system.point_cache.filepath)
    return folders - {""}
