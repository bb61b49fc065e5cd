# SPDX-License-Identifier: GPL-3.0-or-later
"""Library of body models: manifests of the shipped set and of user-built sets.

A set is a folder with a ``manifest.json``, written by ``hfx body build``. The shipped set takes
precedence over the user's sets, the folders in
:func:`~hfx_blender.files.resources.user_body_models`.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from ...errors import InputError
from ...files import resources

MANIFEST_FILE: Final = "manifest.json"


@dataclass(frozen=True)
class Entry:
    """Manifest entry of a perceptual model or avatar."""

    id: str
    kind: str  # "model" or "avatar"
    folder: Path
    facts: Mapping[str, Any]  # values in the manifest
    is_shipped: bool

    @property
    def path(self) -> Path:
        """Path of the entry's .npz file."""
        return self.folder / str(self.facts["file"])

    @property
    def content_hash(self) -> str:
        """SHA-256 (hex) stated in the manifest."""
        return str(self.facts["hash"])


@lru_cache(maxsize=1)
def manifest() -> dict[str, Any]:
    """Manifest of the shipped set: file, hash, source, licence and statistics by id; cached."""
    return read_manifest(resources.body_models())


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a set. Raises InputError: the manifest is missing, unreadable, or names
    files outside its folder."""
    path = folder / MANIFEST_FILE
    try:
        index: dict[str, Any] = json.loads(path.read_bytes())
        _entries(folder, index, is_shipped=False)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; 'hfx body build' writes one.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: cannot be read as an index of models ({error}).") from error
    return index


def _entries(folder: Path, index: Mapping[str, Any], is_shipped: bool) -> list[Entry]:
    """Entries of a manifest, the avatar first. Raises ValueError: a file lies outside the folder,
    or a hash is empty."""
    entries = [
        Entry(id, "model", folder, facts, is_shipped) for id, facts in index["models"].items()
    ]
    if "avatar" in index:
        avatar = index["avatar"]
        entries.insert(0, Entry(avatar["id"], "avatar", folder, avatar, is_shipped))
    for entry in entries:
        if not entry.path.name or entry.path.parent != folder or not entry.content_hash:
            raise ValueError(f"'{entry.id}' names no file of this folder")
    return entries


def shipped() -> list[Entry]:
    """Entries of the shipped set, the avatar first, then models in the manifest's order."""
    return _entries(resources.body_models(), manifest(), is_shipped=True)


def installed() -> tuple[list[Entry], list[str]]:
    """Entries of the user's sets, sorted by folder, without ids of the shipped set, and faults. The
    first entry of each id is taken. Faults are one sentence for each unreadable set, and for each
    id with different content in two places."""
    first_by_id = {entry.id: entry for entry in shipped()}
    entries: list[Entry] = []
    faults: list[str] = []
    for path in sorted(resources.user_body_models().glob(f"*/{MANIFEST_FILE}")):
        folder = path.parent
        try:
            index = read_manifest(folder)
        except InputError as error:
            faults.append(str(error))
            continue
        for entry in _entries(folder, index, is_shipped=False):
            # A copy of a set with equal content is no fault; the first counts.
            first = first_by_id.setdefault(entry.id, entry)
            if first is entry:
                entries.append(entry)
            elif first.content_hash != entry.content_hash:
                first_place = "the shipped model" if first.is_shipped else f"{first.path}"
                faults.append(
                    f"Body model '{entry.id}' exists twice with different content: {first_place} "
                    f"({first.content_hash[:12]}...) and {entry.path} "
                    f"({entry.content_hash[:12]}...). Remove one."
                )
    return entries, faults


def model_sets() -> dict[str, tuple[str, ...]]:
    """Sorted model ids of the user's sets by folder name, sorted; without unreadable sets, and
    without variants, whose vertex ids are those of the canonical models."""
    sets = {}
    for path in sorted(resources.user_body_models().glob(f"*/{MANIFEST_FILE}")):
        with suppress(InputError):  # told by :func:`installed`
            index = read_manifest(path.parent)
            if "avatar" not in index:
                sets[path.parent.name] = tuple(sorted(index["models"]))
    return sets


def people() -> list[Entry]:
    """Avatar entries of the variants installed by the user, sorted by folder."""
    return [entry for entry in installed()[0] if entry.kind == "avatar"]


def find(identity: str, kind: str = "model") -> Entry:
    """Find a model or avatar by id; ``kind`` is "model" or "avatar". Raises InputError: the id is
    unknown, or the user's sets have two different models of this id."""
    # Most ids are shipped: the user's folders are read only for the others.
    for entry in shipped():
        if (entry.id, entry.kind) == (identity, kind):
            return entry
    entries, faults = installed()
    for fault in faults:
        if f"'{identity}'" in fault:
            raise InputError(fault)
    for entry in entries:
        if (entry.id, entry.kind) == (identity, kind):
            return entry
    label = "Body model" if kind == "model" else "Avatar"
    available_ids = [entry.id for entry in (*shipped(), *entries) if entry.kind == kind]
    unknown = f"{label} '{identity}' is unknown. Available: {', '.join(available_ids)}."
    raise InputError(" ".join((unknown, *faults)))


def owner_of_ids(model_id: str, provenance: Mapping[str, Any]) -> Entry:
    """Entry of the model that defines a model's vertex ids: the canonical model of a variant.
    ``provenance`` of a variant has ``canonical``, the id and hash of its model. Raises InputError:
    the canonical model is unknown, or is another edition than the variant was made from."""
    origin = provenance.get("canonical")
    if origin is None:
        return find(model_id)
    entry = find(origin["id"])
    if origin["hash"] != entry.content_hash:
        raise InputError(
            f"Body model '{model_id}' is a variant of another edition of '{entry.id}' "
            f"({origin['hash'][:12]}..., installed {entry.content_hash[:12]}...). Build it again."
        )
    return entry
