# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets of body models for tests without sources: the shipped models, made smaller or larger."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from coarse_models import at_level

from hfx_blender.engine.body import model
from hfx_tools.body_building import model_file, model_set


def scaled_variant(folder: Path, suffix: str, scale: float) -> Path:
    """Write a set as ``hfx body build --variant`` does, for a person of another height."""
    folder.mkdir(parents=True, exist_ok=True)
    by = np.float32(scale)
    shipped = model.load_avatar()
    rest = shipped.skeleton.rest.copy()
    rest[:, :3, 3] *= by
    skeleton = replace(shipped.skeleton, rest=rest, lengths_m=by * shipped.skeleton.lengths_m)
    avatar = replace(
        shipped,
        id=shipped.id + suffix,
        vertices=by * shipped.vertices,
        skeleton=skeleton,
        provenance={**shipped.provenance, **_origin(shipped)},
    )
    model_file.save(avatar, folder / model_set.AVATAR_FILE)
    index = {
        "version": model_set.MANIFEST_VERSION,
        "variant": {"height": 1.8 * scale},
        "avatar": model_set.avatar_entry(avatar),
        "models": {},
    }
    for identity in model.manifest()["models"]:
        one = model.load_model(identity)
        copy = replace(
            one,
            id=one.id + suffix,
            vertices=by * one.vertices,
            areas_m2=by * by * one.areas_m2,
            avatar_offset_m=by * one.avatar_offset_m,
            provenance={**one.provenance, **_origin(one)},
        )
        model_file.save(copy, folder / f"{copy.modality}.npz")
        index["models"][copy.id] = model_set.model_entry(copy)
    model_set.write_manifest(folder, index)
    return folder


def _origin(item: model.PerceptualModel | model.Avatar) -> dict[str, dict[str, str]]:
    return {"canonical": {"id": item.id, "hash": item.content_hash}}


def coarse_set(folder: Path, suffix: str = "-quadric") -> tuple[str, ...]:
    """Write a set of coarse models of pressure and vibration, of ids as ``--method quadric`` has;
    returns the ids, sorted."""
    folder.mkdir(parents=True, exist_ok=True)
    index: dict[str, Any] = {"version": model_set.MANIFEST_VERSION, "models": {}}
    for modality in ("pressure", "vibration"):
        coarse, _ = at_level(model.load_model(f"hfx-{modality}-1"), 2)
        coarse = replace(coarse, id=f"hfx-{modality}-1{suffix}")
        model_file.save(coarse, folder / f"{modality}.npz")
        index["models"][coarse.id] = model_set.model_entry(coarse)
    model_set.write_manifest(folder, index)
    return tuple(sorted(index["models"]))
