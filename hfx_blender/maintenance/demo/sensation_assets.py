# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the asset library of the shipped sensations: a .blend of empties, and its catalogs.

``python -m hfx_blender.maintenance.demo.sensation_assets FOLDER`` reads the folder's sensations
and writes ``sensations.blend`` and ``blender_assets.cats.txt`` beside them. Each asset's picture is
the avatar, coloured by the strongest that it ever feels.
"""

from __future__ import annotations

import sys
import tempfile
import uuid
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ... import blender_session
from ...atomic_files import atomic_file
from ...authoring import effect_exchange, effect_file, effects
from ...authoring.effect_assets import LIBRARY_FILE, SENSATION, is_worn
from ...authoring.effect_file import SUFFIX, Sensation
from ...engine.arrays import F64
from ...engine.body.model import load_avatar, load_model
from ...engine.colouring import Spread, overlay
from ...playback.preview_layers import spread_between
from ...playback.timeline_record import record
from ..felt_shares import SKIN, felt_shares

CATALOGS = "blender_assets.cats.txt"
SIZE = 128
WORN, AROUND = "Haptics/On the Body", "Haptics/Around the Body"

_SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # of names that are addresses


def catalog_id(path: str) -> str:
    """Identifier of a catalog, equal on every computer."""
    return str(uuid.uuid5(_SPACE, f"hfx_blender/{path}"))


def make(folder: Path) -> Path:
    """Write the asset library of a folder of sensations.

    Raises
    ------
    InputError
        A sensation's file is not as it should be.
    """
    found = {p.stem: effect_file.load(p) for p in sorted(folder.glob("*" + SUFFIX))}
    pictures = {stem: picture_of(sensation) for stem, sensation in found.items()}
    bpy.ops.wm.read_homefile(use_empty=True)
    for stem, sensation in found.items():
        _asset(stem, sensation, pictures[stem])
    lines = ["# Asset catalogs of Blender", "VERSION 1", ""]
    for path in ("Haptics", WORN, AROUND):
        lines.append(f"{catalog_id(path)}:{path}:{path.replace('/', '-')}")
    with atomic_file(folder / CATALOGS) as file:
        file.write(("\n".join(lines) + "\n").encode())
    target = folder / LIBRARY_FILE
    bpy.context.preferences.filepaths.save_version = 0
    with tempfile.TemporaryDirectory() as neutral:  # a .blend remembers where it was saved
        made = Path(neutral, LIBRARY_FILE)
        bpy.ops.wm.save_as_mainfile(filepath=str(made), compress=True, check_existing=False)
        with atomic_file(target) as file:
            file.write(made.read_bytes())
    return target


def _asset(stem: str, sensation: Sensation, picture: F64) -> None:
    empty = bpy.data.objects.new(sensation.name, None)
    empty.empty_display_type = "SPHERE"
    empty.empty_display_size = 0.1
    empty[SENSATION] = stem
    empty.use_fake_user = True
    bpy.context.scene.collection.objects.link(empty)
    empty.asset_mark()
    data = empty.asset_data
    data.catalog_id = catalog_id(WORN if is_worn(sensation) else AROUND)
    data.description = sensation.description
    data.license = "GPL-3.0-or-later"
    data.author = "HFX"
    for modality in dict.fromkeys(effect.modality for effect in sensation.effects):
        data.tags.new(modality, skip_if_exists=True)
    preview = empty.preview_ensure()
    preview.image_size = picture.shape[1], picture.shape[0]
    preview.image_pixels_float.foreach_set(picture[::-1].astype(np.float32).ravel())


def picture_of(sensation: Sensation) -> F64:
    """The avatar in the colours of the strongest that it feels, (SIZE, SIZE, 4) from the top."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    scene = bpy.context.scene
    scene.render.fps = 24
    body = effects.bodies_of(scene)[0]
    scene.frame_start, scene.frame_end = 0, 24 * 12
    scene.hfx.rate = 24.0
    effect_exchange.place(scene, sensation, body=body, frame=0.0)
    bpy.context.view_layer.update()
    *_, found = record(scene, may_step=True)
    assert found is not None
    contact = frozenset(e.id for e in found.described.effects if e.is_contact)
    avatar = load_avatar()
    strongest: dict[str, F64] = {}
    spreads: dict[str, Spread] = {}
    for frame in range(scene.frame_start, scene.frame_end + 1):
        runs = found.runs(frame) or []
        for model_id in {run.stream.model_id for run in runs} - set(spreads):
            spreads[model_id] = spread_between(
                avatar.vertices.astype(np.float64), load_model(model_id)
            )
        if not runs:
            continue
        used = {run.stream.model_id for run in runs}
        shares = felt_shares(
            [sample for run in runs for sample in run],
            {key: spreads[key] for key in used},
            {key: len(load_model(key)) for key in used},
            contact,
        )
        for name, share in shares.items():
            strongest[name] = np.maximum(strongest.get(name, 0.0), share)
    colours = np.tile([*SKIN, 1.0], (len(avatar.vertices), 1))
    if strongest:
        over = overlay(strongest)
        colours[:, :3] += over[:, 3:] * (over[:, :3] - colours[:, :3])
    faces = avatar.faces
    quads = faces[faces[:, 3] >= 0]
    triangles = np.concatenate([faces[:, :3], quads[:, [0, 2, 3]]])
    return _drawn(avatar.vertices.astype(np.float64), triangles, colours[:, :3])


def _drawn(points: F64, triangles: npt.NDArray[np.int32], colours: F64) -> F64:
    """The avatar from the front and from behind, side by side, drawn point by point."""
    picture = np.zeros((SIZE, SIZE, 4))
    middle, height = points.mean(axis=0), np.ptp(points[:, 2])
    corners, shades = points[triangles], colours[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    shares = np.array([(a, b, 4 - a - b) for a in range(5) for b in range(5 - a)]) / 4.0
    at = np.einsum("kc,fcx->fkx", shares, corners)
    tints = np.einsum("kc,fcx->fkx", shares, shades)
    for left, facing in ((0, -1.0), (SIZE // 2, 1.0)):  # the avatar looks along -Y
        light = np.clip(facing * normals[:, 1], 0.0, 1.0)
        seen = light > 0.0
        place, tint = at[seen].reshape(-1, 3), tints[seen].reshape(-1, 3)
        tint = np.clip(tint * np.repeat(0.45 + 0.55 * light[seen], len(shares))[:, None], 0.0, 1.0)
        scale = 0.94 * SIZE / height
        x = -facing * (place[:, 0] - middle[0]) * scale * 0.72 + left + SIZE / 4
        y = SIZE * 0.97 - (place[:, 2] - points[:, 2].min()) * scale
        inside = (x >= left) & (x < left + SIZE // 2) & (y >= 0) & (y < SIZE)
        order = np.argsort(-facing * place[:, 1] * -1.0)  # the nearest is drawn last
        order = order[inside[order]]
        picture[y[order].astype(int), x[order].astype(int), :3] = tint[order]
        picture[y[order].astype(int), x[order].astype(int), 3] = 1.0
    picture[..., :3] **= 1 / 2.2
    return picture


if __name__ == "__main__":
    blender_session.start()
    sys.stdout.write(f"{make(Path(sys.argv[1]))}\n")
    sys.stdout.flush()
    blender_session.leave(0)
