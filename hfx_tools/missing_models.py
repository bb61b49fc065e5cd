# SPDX-License-Identifier: GPL-3.0-or-later
"""Body models of a track that are not installed."""

from __future__ import annotations

from pathlib import Path

from hfx_blender.engine.body.model_library import installed, shipped
from hfx_blender.engine.track.header import TrackHeader
from hfx_blender.errors import InputError
from hfx_blender.files import resources


def missing_models(header: TrackHeader) -> list[str]:
    """Ids of the body models of a track that are neither shipped nor installed."""
    known = {entry.id for entry in (*shipped(), *installed()[0]) if entry.kind == "model"}
    return [model.id for model in header.models if model.id not in known]


def how_to_install(path: Path, ids: list[str]) -> str:
    """Sentences about a track's missing models, and the ways to install their set."""
    return (
        f"{path}: these body models are not installed: {', '.join(ids)}. Copy the folder of their "
        f"set to {resources.user_body_models()}, or build the set with 'hfx body build --install'."
    )


def refuse_missing(path: Path, header: TrackHeader) -> None:
    """Raise InputError for a track whose body models are not all installed."""
    if ids := missing_models(header):
        raise InputError(how_to_install(path, ids))
