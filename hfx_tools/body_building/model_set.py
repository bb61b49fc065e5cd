# SPDX-License-Identifier: GPL-3.0-or-later
"""Folder of models as it is written: the files, and the manifest that lists them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from hfx_blender.engine.body.model import Avatar, PerceptualModel
from hfx_blender.engine.body.model_library import MANIFEST_FILE
from hfx_blender.errors import OutputError, UsageError
from hfx_blender.files import resources
from hfx_blender.files.atomic import atomic_file

MANIFEST_VERSION: Final = 1
AVATAR_FILE: Final = "avatar.npz"


def prepare(folder: Path, wanted: str | None) -> None:
    """Make the folder of a set.

    Parameters
    ----------
    wanted : str or None
        What other than the canonical models is to be written; None for those.

    Raises
    ------
    OutputError
        It cannot be made a folder.
    UsageError
        It holds the canonical models, which nothing else may replace.
    """
    if wanted is not None and folder.resolve() == resources.body_models().resolve():
        raise UsageError(f"{folder}: holds the canonical models; name another folder for {wanted}.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made a folder ({error.strerror}).") from error


def avatar_entry(avatar: Avatar) -> dict[str, Any]:
    """Entry of the manifest for an avatar."""
    return {
        "id": avatar.id,
        "file": AVATAR_FILE,
        "hash": avatar.content_hash,
        "vertices": len(avatar.vertices),
        "bones": len(avatar.skeleton.bone_names),
        **_origin(avatar),
    }


def model_entry(model: PerceptualModel) -> dict[str, Any]:
    """Entry of the manifest for a perceptual model."""
    return {
        "file": f"{model.modality}.npz",
        "hash": model.content_hash,
        "modality": model.modality,
        "vertices": len(model),
        **_origin(model),
        "statistics": model.provenance["statistics"],
    }


def _origin(item: Avatar | PerceptualModel) -> dict[str, Any]:
    keys = ("source", "licence", "canonical", "method")
    facts = {key: item.provenance[key] for key in keys if key in item.provenance}
    if isinstance(item, Avatar):
        facts.pop("method", None)
    return facts


def write_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest of a set, after all files that it lists."""
    write_json(folder / MANIFEST_FILE, manifest)


def write_json(path: Path, value: dict[str, Any]) -> None:
    with atomic_file(path) as file:
        file.write((json.dumps(value, indent=1) + "\n").encode())
