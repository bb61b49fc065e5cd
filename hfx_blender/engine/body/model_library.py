# SPDX-License-Identifier: GPL-3.0-or-later
"""Index of body models: the shipped ones, and those that a user has built and installed.

A set is a folder with a ``manifest.json``, as ``hfx body build`` writes it. The shipped set is
looked in first; the user's sets, the folders in
:func:`~hfx_blender.files.resources.user_body_models`, only for ids that it does not have.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from ...errors import InputError
from ...files import resources

MANIFEST_FILE: Final = "manifest.json"


@dataclass(frozen=True)
class Entry:
    """A perceptual model or an avatar of a set."""

    id: str
    kind: str  # "model" or "avatar"
    folder: Path
    facts: Mapping[str, Any]  # its entry in the manifest
    is_shipped: bool

    @property
    def path(self) -> Path:
        """File of the entry."""
        return self.folder / str(self.facts["file"])

    @property
    def content_hash(self) -> str:
        """SHA-256 of its content, as the manifest says."""
        return str(self.facts["hash"])


@lru_cache(maxsize=1)
def manifest() -> dict[str, Any]:
    """The index of ``body_models/``: for each id its file, hash, source, licence, statistics."""
    return read_manifest(resources.body_models())


def read_manifest(folder: Path) -> dict[str, Any]:
    """The index of a set.

    Raises
    ------
    InputError
        There is none, it cannot be read, or it names files outside of its folder.
    """
    path = folder / MANIFEST_FILE
    try:
        found: dict[str, Any] = json.loads(path.read_bytes())
        _entries(folder, found, is_shipped=False)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; 'hfx body build' writes one.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: cannot be read as an index of models ({error}).") from error
    return found


def _entries(folder: Path, index: Mapping[str, Any], is_shipped: bool) -> list[Entry]:
    found = [Entry(id, "model", folder, facts, is_shipped) for id, facts in index["models"].items()]
    if "avatar" in index:
        avatar = index["avatar"]
        found.insert(0, Entry(avatar["id"], "avatar", folder, avatar, is_shipped))
    for entry in found:
        if not entry.path.name or entry.path.parent != folder or not entry.content_hash:
            raise ValueError(f"'{entry.id}' names no file of this folder")
    return found


def shipped() -> list[Entry]:
    """Entries that come with the product."""
    return _entries(resources.body_models(), manifest(), is_shipped=True)


def installed() -> tuple[list[Entry], list[str]]:
    """Entries that the user has installed, by folder, without those that the product ships.

    Returns
    -------
    entries : list of Entry
    faults : list of str
        One sentence for each set that cannot be read, and for each id that stands for
        different things in two places.
    """
    known = {entry.id: entry for entry in shipped()}
    entries: list[Entry] = []
    faults: list[str] = []
    for folder in _user_sets():
        try:
            index = read_manifest(folder)
        except InputError as error:
            faults.append(str(error))
            continue
        for entry in _entries(folder, index, is_shipped=False):
            other = known.setdefault(entry.id, entry)
            if other is entry:
                entries.append(entry)
            elif other.content_hash != entry.content_hash:
                faults.append(_two_of_one_id(other, entry))
    return entries, faults


def _user_sets() -> Iterator[Path]:
    folder = resources.user_body_models()
    if folder.is_dir():
        yield from (each.parent for each in sorted(folder.glob(f"*/{MANIFEST_FILE}")))


def _two_of_one_id(one: Entry, other: Entry) -> str:
    where = "the shipped one" if one.is_shipped else f"{one.path}"
    return (
        f"Body model '{one.id}' is there twice with different content: {where} "
        f"({one.content_hash[:12]}...) and {other.path} ({other.content_hash[:12]}...); remove "
        "one of them."
    )


def find(identity: str, kind: str = "model") -> Entry:
    """Find a model or an avatar by its id.

    Raises
    ------
    InputError
        There is none of this id, or the user has installed two with different content.
    """
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
    what = "Body model" if kind == "model" else "Avatar"
    there = [entry.id for entry in (*shipped(), *entries) if entry.kind == kind]
    raise InputError(
        " ".join((f"{what} '{identity}' is unknown; there are: {', '.join(there)}.", *faults))
    )


def owner_of_ids(model_id: str, provenance: Mapping[str, Any]) -> Entry:
    """Model that defines a model's vertex ids: itself, or the one that it is a variant of.

    Parameters
    ----------
    provenance : mapping
        Of that model: a variant names what it varies as ``canonical``.

    Raises
    ------
    InputError
        That model is unknown, or a variant was made from another edition of it.
    """
    origin = provenance.get("canonical")
    if origin is None:
        return find(model_id)
    entry = find(origin["id"])
    if origin["hash"] != entry.content_hash:
        raise InputError(
            f"Body model '{model_id}' is a variant of another edition of '{entry.id}' "
            f"({origin['hash'][:12]}..., here it is {entry.content_hash[:12]}...); build it again."
        )
    return entry
