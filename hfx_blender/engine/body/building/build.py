# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body build``: the whole of ``body_models/`` from MakeHuman's data."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .... import resources
from ....atomic_files import atomic_file
from ....errors import OutputError, UsageError
from ..model import Avatar, PerceptualModel, WalkCycle, load_model, save
from ..parts import PARTS
from . import (
    assemble,
    correspondence,
    left_skin,
    quadric,
    remesh,
    segmentation,
    skeleton,
    skin,
    stats,
    thresholds,
    walk,
)
from . import source as source_data

Progress = Callable[[float, str], None]

AVATAR_ID = "hfx-avatar-1"
WALK_ID = "hfx-walk-1"
MANIFEST_VERSION = 1

_SOURCE = {
    "source": "MakeHuman base mesh hm08, default rig and weights, from the package "
    f"{source_data.PACKAGE} {source_data.VERSION} on PyPI",
    "licence": source_data.LICENCE,
}


def quiet(_share: float, _text: str) -> None:
    """Progress that nobody watches."""


def build(
    source: Path | None,
    destination: Path,
    targets: thresholds.Targets = thresholds.LITERATURE_MM,
    progress: Progress = quiet,
) -> dict[str, Any]:
    """Make the avatar, the walk cycle and one perceptual model for each modality.

    Parameters
    ----------
    source : Path, optional
        See :func:`.source.locate`.
    destination : Path
        Folder; files of the same names are replaced, each when it is complete, the manifest
        last.
    targets : dict
        From :func:`.thresholds.read`. A model of other spacings than the literature's gets an
        id of its own, and ``<modality>-map.npz`` leads to and from the canonical vertex ids.
    progress : callable
        Given the share that is done, 0..1, and what is being done.

    Returns
    -------
    dict
        The manifest, as written.

    Raises
    ------
    InputError
        The source data is missing or cannot be read.
    OutputError
        The folder or a file in it cannot be written.
    UsageError
        Other targets for the folder of the canonical models.
    """
    is_canonical = targets == thresholds.LITERATURE_MM
    if not is_canonical and destination.resolve() == resources.body_models().resolve():
        raise UsageError(
            f"{destination}: holds the canonical models; name another folder for other targets."
        )
    try:
        destination.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{destination}: cannot be made a folder ({error.strerror}).") from error
    progress(0.0, "reading the source")
    data = source_data.read(source_data.locate(source))
    names = skeleton.bone_order(data.rig)
    skins = skin.make(data, names)
    bones = skeleton.make(data, skins.scale, skins.ground_m)
    progress(0.02, "labelling body parts")
    part, side = segmentation.label(skins.dense, bones)
    avatar = _avatar(skins, bones, part, side)
    cycle = walk.make(avatar)

    left = left_skin.left_of(skins, part, side)
    dense = (left.points, left.triangles, skins.dense.weights[left.kept])
    models: list[PerceptualModel] = []
    decimated: list[dict[str, Any]] = []
    for number, (modality, spacings_mm) in enumerate(targets.items()):
        start, share = 0.05 + 0.95 * number / len(targets), 0.95 / len(targets)

        def part_of_it(
            done: float, text: str, at: float = start, by: float = share, what: str = modality
        ) -> None:
            progress(at + by * 0.9 * done, f"{what}: {text}")

        spacing_m = np.array(spacings_mm) / 1000.0
        mesh = remesh.remesh(left, spacing_m, part_of_it)
        progress(start + 0.92 * share, f"{modality}: quadric decimation, to compare")
        decimated.append(stats.decimated(quadric.decimate(left, spacing_m)))
        progress(start + 0.96 * share, f"{modality}: weights")
        provenance = {**_SOURCE, "method": remesh.METHOD, "targets_mm": _by_part(spacings_mm)}
        made = assemble.model(
            thresholds.model_id(modality, spacings_mm),
            modality,
            mesh.result(),
            mesh.areas_m2(),
            avatar,
            dense,
            provenance,
        )
        made.provenance["statistics"] = stats.statistics(
            made, mesh.largest_gaps_m(), mesh.errors_m()
        )
        models.append(made)
    for model in models:
        canonical_id = f"hfx-{model.modality}-1"
        if model.id != canonical_id:
            canonical = load_model(canonical_id)
            correspondence.save(model, canonical, destination / f"{model.modality}-map.npz")
    manifest = _write(destination, avatar, cycle, models, decimated)
    progress(1.0, "done")
    return manifest


def _by_part(values: tuple[float, ...]) -> dict[str, float]:
    return dict(zip(PARTS, values, strict=True))


def _avatar(skins: skin.Skins, bones: Any, part: Any, side: Any) -> Avatar:
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
    """Ascending numbers as runs: first and last of each."""
    breaks = np.flatnonzero(np.diff(ascending) != 1)
    first = ascending[np.concatenate(([0], breaks + 1))]
    last = ascending[np.concatenate((breaks, [len(ascending) - 1]))]
    return np.column_stack((first, last)).tolist()  # type: ignore[no-any-return]


def _write(
    destination: Path,
    avatar: Avatar,
    cycle: WalkCycle,
    models: list[PerceptualModel],
    decimated: list[dict[str, Any]],
) -> dict[str, Any]:
    common = {"source": _SOURCE["source"], "licence": _SOURCE["licence"]}
    manifest: dict[str, Any] = {
        "version": MANIFEST_VERSION,
        "avatar": {
            "id": avatar.id,
            "file": "avatar.npz",
            "hash": avatar.content_hash,
            "vertices": len(avatar.vertices),
            "bones": len(avatar.skeleton.bone_names),
            **common,
        },
        "walk": {
            "id": WALK_ID,
            "file": "walk.npz",
            "rate_hz": cycle.rate_hz,
            "stride_m": cycle.stride_m,
            "source": "made for this project",
            "licence": "CC0-1.0",
        },
        "models": {
            model.id: {
                "file": f"{model.modality}.npz",
                "hash": model.content_hash,
                "modality": model.modality,
                "vertices": len(model),
                **common,
                "statistics": model.provenance["statistics"],
                "quadric": by_quadrics,
            }
            for model, by_quadrics in zip(models, decimated, strict=True)
        },
    }
    save(avatar, destination / "avatar.npz")
    save(cycle, destination / "walk.npz")
    for model in models:
        save(model, destination / f"{model.modality}.npz")
    with atomic_file(destination / "manifest.json") as file:
        file.write((json.dumps(manifest, indent=1) + "\n").encode())
    return manifest
