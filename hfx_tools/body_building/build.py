# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body build``: all of ``body_models/`` from MakeHuman's data."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.levels_and_cells import CELLS_FILE
from hfx_blender.engine.body.model import (
    AVATAR_ID,
    Avatar,
    PerceptualModel,
    load,
    load_model,
)
from hfx_blender.engine.body.model_library import read_manifest
from hfx_blender.engine.body.parts import PARTS

from . import (
    assemble,
    correspondence,
    joint_gradient,
    left_skin,
    level_making,
    model_file,
    model_set,
    outer_skin,
    segmentation,
    shape_variation,
    skeleton,
    stats,
    thresholds,
    walk,
    walk_cycle,
)
from . import source as source_data
from .joint_gradient import JointGradient
from .left_skin import Half, LeftSkin
from .meshes import geodesic, measure, quadric, remesh
from .progress import Progress, quiet

WALK_ID: Final = "hfx-walk-1"

METHODS: Final = ("cells", "quadric")
"""Even cells, and the paper's decimation."""

_SOURCE: Final = {
    "source": "MakeHuman base mesh hm08, default rig and weights, from the package "
    f"{source_data.PACKAGE} {source_data.VERSION} on PyPI",
    "licence": source_data.LICENCE,
}


def build(
    source: Path | None,
    destination: Path,
    targets: thresholds.Targets = thresholds.LITERATURE_MM,
    progress: Progress = quiet,
    method: str = "cells",
    joint_factor: float = 1.0,
) -> dict[str, Any]:
    """Build a perceptual model for each modality; canonical models come with avatar and walk cycle.

    Parameters
    ----------
    source : Path, optional
        See :func:`.source.locate`.
    destination : Path
        Folder; each file of the same name is replaced as a whole, the manifest last.
    targets : dict
        From :func:`.thresholds.read`. A model with spacings unlike the literature's, or by another
        method, gets a new id, and ``<modality>-map.npz`` maps to and from the canonical vertex ids.
    progress : callable
        Called with the finished share, 0..1, and the current step.
    method : str
        Name from :data:`METHODS`.
    joint_factor : float
        Spacing of pressure and vibration at the joints of arm and leg, relative to the middle of
        the limb; see :class:`.joint_gradient.JointGradient`. Below 1 only with the method "cells".

    Returns the written manifest.

    Raises
    ------
    InputError
        The source data is missing or cannot be read, or the factor is not allowed; see
        :func:`.joint_gradient.check`.
    OutputError
        The folder or a file in it cannot be written.
    UsageError
        Non-canonical targets, method or factor with the folder of the canonical models.
    """
    if method not in METHODS:
        raise ValueError(f"method: expected one of {METHODS}, got '{method}'")
    joint_gradient.check(joint_factor, targets)
    if joint_factor != 1.0 and method != "cells":
        raise ValueError(f"joint_factor: expected 1 with the method '{method}', got {joint_factor}")
    is_canonical = targets == thresholds.LITERATURE_MM and method == "cells" and joint_factor == 1.0
    model_set.prepare(
        destination, None if is_canonical else "other targets, another method or a joint gradient"
    )
    progress(0.0, "reading the source")
    data = source_data.read(source_data.locate(source))
    names = skeleton.bone_order(data.rig)
    skins = outer_skin.make(data, names)
    bones = skeleton.make(data, skins.scale, skins.ground_m)
    progress(0.02, "labelling body parts")
    part, side = segmentation.label(skins.dense, bones)
    avatar = _avatar(skins, bones, part, side)

    left = left_skin.left_of(skins, part, side)
    dense = (left.points, left.triangles, skins.dense.weights[left.source_ids])
    models: list[PerceptualModel] = []
    compared: dict[str, Any] = {}
    seconds: dict[str, Any] = {}
    for number, (modality, spacings_mm) in enumerate(targets.items()):
        start, share = 0.05 + 0.9 * number / len(targets), 0.9 / len(targets)

        def share_of_progress(
            done: float, text: str, at: float = start, by: float = share, what: str = modality
        ) -> None:
            progress(at + by * 0.9 * done, f"{what}: {text}")

        spacing_m = np.array(spacings_mm) / 1000.0
        own_factor = joint_factor if modality in joint_gradient.MODALITIES else 1.0
        gradient = joint_gradient.make(bones, own_factor)
        thinned = {method: _THIN[method](left, spacing_m, gradient, share_of_progress)}
        # Decimation has one spacing a part: no comparison for a model with a gradient.
        if method == "cells" and gradient is joint_gradient.UNIFORM:
            share_of_progress(1.0, "quadric decimation, to compare")
            compared_mesh = thinned["quadric"] = _quadric(left, spacing_m, gradient, quiet)
            compared[modality] = stats.decimated(
                compared_mesh.half, compared_mesh.gaps_m, compared_mesh.errors_m
            )
        seconds[modality] = {f"{method_}_s": mesh.seconds for method_, mesh in thinned.items()}
        chosen = thinned[method]
        provenance = {
            **_SOURCE,
            "method": chosen.method,
            "targets_mm": dict(zip(PARTS, spacings_mm, strict=True)),
            **gradient.provenance(),
        }
        identity = thresholds.model_id(modality, spacings_mm, method, own_factor)
        model = assemble.model(
            identity, modality, chosen.half, chosen.areas_m2, avatar, dense, provenance
        )
        model.provenance["statistics"] = stats.statistics(model, chosen.gaps_m, chosen.errors_m)
        models.append(model)
    progress(0.95, "levels of detail")
    manifest: dict[str, Any] = {"version": model_set.MANIFEST_VERSION}
    if is_canonical:
        manifest |= _write_avatar(destination, avatar, walk.make(avatar))
        progress(0.96, "how people differ in shape")
        shape_variation.write(data, source_data.locate(source), avatar, destination)
    manifest["models"] = {
        model.id: model_set.model_entry(model)
        | ({"quadric": compared[model.modality]} if model.modality in compared else {})
        for model in models
    }
    _write_models(destination, models, is_canonical)
    model_set.write_json(destination / stats.TIMES_FILE, seconds)
    model_set.write_manifest(destination, manifest)
    progress(1.0, "done")
    return manifest


def make_levels(folder: Path, progress: Progress = quiet) -> dict[str, int]:
    """Rebuild the levels of detail of a folder's models, without the source data.

    Returns modality to the number of levels.

    Raises
    ------
    InputError
        The folder has no models.
    OutputError
        A file cannot be written.
    """
    index = read_manifest(folder)
    counts: dict[str, int] = {}
    for number, entry in enumerate(index["models"].values()):
        progress(number / len(index["models"]), f"{entry['modality']}: levels of detail")
        counts[entry["modality"]] = level_making.save(
            load(PerceptualModel, folder / entry["file"]), folder
        )
    progress(1.0, "done")
    return counts


@dataclass(frozen=True, eq=False)
class _Thinned:
    """Thinned mesh of the left half, with measurements against the skin."""

    method: str
    half: Half
    areas_m2: F64  # (V,) skin of each vertex
    gaps_m: F64  # (parts,) largest distance from skin to the nearest vertex
    errors_m: F64  # (parts,) mean distance from skin to the mesh
    seconds: float  # processor time


def _cells(left: LeftSkin, spacing_m: F64, gradient: JointGradient, progress: Progress) -> _Thinned:
    began = time.process_time()
    mesh = remesh.remesh(left, spacing_m, progress, gradient)
    seconds = round(time.process_time() - began, 1)
    return _Thinned(
        remesh.METHOD,
        mesh.result(),
        mesh.areas_m2(),
        mesh.largest_gaps_m(),
        mesh.errors_m(),
        seconds,
    )


def _quadric(
    left: LeftSkin, spacing_m: F64, _gradient: JointGradient, progress: Progress
) -> _Thinned:
    progress(0.0, "quadric decimation")
    began = time.process_time()
    half = quadric.decimate(left, spacing_m)
    seconds = round(time.process_time() - began, 1)
    samples = left_skin.sample(left, spacing_m)
    both = np.concatenate((half.points, half.points * (-1.0, 1.0, 1.0)))
    return _Thinned(
        quadric.METHOD,
        half,
        quadric.areas_m2(half, samples),
        measure.gaps_m(samples, both),
        measure.errors_m(samples, half.points, half.triangles),
        seconds,
    )


_THIN: Final = {"cells": _cells, "quadric": _quadric}


def _avatar(skins: outer_skin.Skins, bones: Any, part: Any, side: Any) -> Avatar:
    count = len(skins.avatar.vertices)
    return Avatar(
        id=AVATAR_ID,
        vertices=skins.avatar.vertices.astype(np.float32),
        faces=skins.avatar.faces,
        uv=skins.uv.astype(np.float32),
        part=part[:count],
        side=side[:count],
        skeleton=bones,
        weights=assemble.sparse_weights(skins.avatar.weights),
        provenance={
            **_SOURCE,
            "method": "average adult, smoothed, scaled to 1.8 m; eyes and mouth closed",
            "source_vertices": _ranges(skins.source_vertices),
        },
    )


def _ranges(ascending: Any) -> list[list[int]]:
    """Compress ascending numbers to runs [first, last]."""
    breaks = np.flatnonzero(np.diff(ascending) != 1)
    first = ascending[np.concatenate(([0], breaks + 1))]
    last = ascending[np.concatenate((breaks, [len(ascending) - 1]))]
    return np.column_stack((first, last)).tolist()  # type: ignore[no-any-return]


def _write_avatar(folder: Path, avatar: Avatar, cycle: walk_cycle.WalkCycle) -> dict[str, Any]:
    """Write avatar and walk cycle; returns both entries of the manifest."""
    model_file.save(avatar, folder / model_set.AVATAR_FILE)
    model_file.save(cycle, folder / "walk.npz")
    walk_entry = {
        "id": WALK_ID,
        "file": "walk.npz",
        "rate_hz": cycle.rate_hz,
        "stride_m": cycle.stride_m,
        "source": "made for this project",
        "licence": "CC0-1.0",
    }
    return {"avatar": model_set.avatar_entry(avatar), "walk": walk_entry}


def _write_models(folder: Path, models: list[PerceptualModel], is_canonical: bool) -> None:
    """Write models with levels of detail, cells of skin, and maps to and from canonical ids."""
    pressure = next((model for model in models if model.modality == "pressure"), None)
    for model in models:
        model_file.save(model, folder / f"{model.modality}.npz")
        level_making.save(model, folder)
        canonical_id = thresholds.canonical_id(model.modality)
        if model.id != canonical_id:
            canonical = load_model(canonical_id)
            correspondence.save(model, canonical, folder / f"{model.modality}-map.npz")
        if model.modality == "temperature":
            if not is_canonical or pressure is None:
                pressure = load_model(thresholds.canonical_id("pressure"))
            geodesic.save(model, pressure, folder / CELLS_FILE)
