# SPDX-License-Identifier: GPL-3.0-or-later
"""Folder of models: preparation, entries of the manifest, and the manifest file."""

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


def prepare(folder: Path, non_canonical: str | None) -> None:
    """Create the folder of a set of models.

    ``non_canonical``: description of the models in the error; None for the canonical models.

    Raises
    ------
    OutputError
        The folder cannot be created.
    UsageError
        Non-canonical models for the folder of the canonical models.
    """
    if non_canonical is not None and folder.resolve() == resources.body_models().resolve():
        raise UsageError(
            f"{folder}: holds the canonical models; name another folder for {non_canonical}."
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made a folder ({error.strerror}).") from error


def avatar_entry(avatar: Avatar) -> dict[str, Any]:
    """Entry of an avatar in the manifest."""
    return {
        "id": avatar.id,
        "file": AVATAR_FILE,
        "hash": avatar.content_hash,
        "vertices": len(avatar.vertices),
        "bones": len(avatar.skeleton.bone_names),
        **_origin(avatar),
    }


def model_entry(model: PerceptualModel) -> dict[str, Any]:
    """Entry of a perceptual model in the manifest."""
    return {
        "file": f"{model.modality}.npz",
        "hash": model.content_hash,
        "modality": model.modality,
        "vertices": len(model),
        **_origin(model),
        "statistics": model.provenance["statistics"],
    }


def _origin(item: Avatar | PerceptualModel) -> dict[str, Any]:
    keys = ("source", "licence", "canonical", "method", "joint_gradient")
    facts = {key: item.provenance[key] for key in keys if key in item.provenance}
    if isinstance(item, Avatar):
        facts.pop("method", None)
    return facts


def write_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest of a set; call last, after all listed files."""
    write_json(folder / MANIFEST_FILE, manifest)


def write_json(path: Path, value: dict[str, Any]) -> None:
    with atomic_file(path) as file:
        file.write((json.dumps(value, indent=1) + "\n").encode())
