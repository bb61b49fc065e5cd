# SPDX-License-Identifier: GPL-3.0-or-later
"""Asset library of the shipped sensations: a .blend of empties, and its catalogs.

``python -m hfx_tools.demo.sensation_assets FOLDER`` reads the folder's sensations and writes
``sensations.blend`` and ``blender_assets.cats.txt`` into the same folder. Each asset's picture is
the avatar, coloured by the maximum strength over time.
"""

from __future__ import annotations

import sys
import uuid
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from hfx_blender.authoring.effects import effect_exchange, effect_file, effects
from hfx_blender.authoring.effects.effect_assets import (
    AUTHOR,
    LIBRARY_FILE,
    SENSATION,
    has_effects_on_body,
)
from hfx_blender.authoring.effects.effect_file import SUFFIX, Sensation
from hfx_blender.engine.arrays import F64, Bool
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.colouring import COLD, PALETTES, Spread
from hfx_blender.files.atomic import atomic_file
from hfx_blender.playback.preview.preview_layers import spread_between
from hfx_blender.playback.timeline.timeline_record import record
from hfx_blender.processes import blender_session

from ..command_process.signal_watch import leave
from ..command_process.temporary_folder import temporary_folder
from ..felt_shares import SKIN, felt_shares
from .scene_file import forget_folders

CATALOGS = "blender_assets.cats.txt"
SIZE = 128
_MOMENTS = (0, 12, 24, 48)  # frames of drawn volumes
_POINTS = 1500  # points on the boundary of each volume
_NEAR_M = 0.1
_FAINT = 0.55
_NEUTRAL_C = 28.0  # between air and skin: lower temperatures are drawn as cold
WORN, AROUND = "Haptics/On the Body", "Haptics/Around the Body"

_SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # RFC 4122 name space of URLs


def catalog_id(path: str) -> str:
    """Identifier of a catalog, equal on every computer."""
    return str(uuid.uuid5(_SPACE, f"hfx_blender/{path}"))


def make(folder: Path) -> Path:
    """Write the asset library of a folder of sensations; returns the path of the .blend.

    Raises
    ------
    InputError
        A sensation's file is invalid.
    """
    sensations = {p.stem: effect_file.load(p) for p in sorted(folder.glob("*" + SUFFIX))}
    pictures = {stem: picture_of(sensation) for stem, sensation in sensations.items()}
    bpy.ops.wm.read_homefile(use_empty=True)
    for stem, sensation in sensations.items():
        _add_asset(stem, sensation, pictures[stem])
    lines = ["# Asset catalogs of Blender", "VERSION 1", ""]
    for path in ("Haptics", WORN, AROUND):
        lines.append(f"{catalog_id(path)}:{path}:{path.replace('/', '-')}")
    with atomic_file(folder / CATALOGS) as file:
        file.write(("\n".join(lines) + "\n").encode())
    target = folder / LIBRARY_FILE
    bpy.context.preferences.filepaths.save_version = 0
    forget_folders()
    with temporary_folder() as neutral:  # a .blend stores the path of its folder
        saved = Path(neutral, LIBRARY_FILE)
        bpy.ops.wm.save_as_mainfile(filepath=str(saved), compress=True, check_existing=False)
        with atomic_file(target) as file:
            file.write(saved.read_bytes())
    return target


def _add_asset(stem: str, sensation: Sensation, picture: F64) -> None:
    empty = bpy.data.objects.new(sensation.name, None)
    empty.empty_display_type = "SPHERE"
    empty.empty_display_size = 0.1
    empty[SENSATION] = stem
    empty.use_fake_user = True
    bpy.context.scene.collection.objects.link(empty)
    empty.asset_mark()
    data = empty.asset_data
    data.catalog_id = catalog_id(WORN if has_effects_on_body(sensation) else AROUND)
    data.description = sensation.description
    data.license = "GPL-3.0-or-later"
    data.author = AUTHOR
    for modality in dict.fromkeys(effect.modality for effect in sensation.effects):
        data.tags.new(modality, skip_if_exists=True)
    preview = empty.preview_ensure()
    preview.image_size = picture.shape[1], picture.shape[0]
    preview.image_pixels_float.foreach_set(picture[::-1].astype(np.float32).ravel())


def picture_of(sensation: Sensation) -> F64:
    """Draw the avatar in the colours of the maximum strengths, (SIZE, SIZE, 4), top row first."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    scene = bpy.context.scene
    scene.render.fps = 24
    body = effects.bodies_of(scene)[0]
    scene.frame_start, scene.frame_end = 0, 24 * 12
    scene.hfx.rate = 24.0
    effect_exchange.place_sensation(scene, sensation, body=body, frame=0.0)
    bpy.context.view_layer.update()
    *_, recorded = record(scene, may_step=True)
    assert recorded is not None
    contact = frozenset(e.id for e in recorded.described.effects if e.is_contact)
    avatar = load_avatar()
    strongest: dict[str, F64] = {}
    spreads: dict[str, Spread] = {}
    for frame in range(scene.frame_start, scene.frame_end + 1):
        index = recorded.index(frame)
        runs = [] if index is None else recorded.runs(index) or []
        samples = [sample for run in runs for sample in run]
        used = {sample.stream.model_id for sample in samples}
        for model_id in used - set(spreads):
            spreads[model_id] = spread_between(
                avatar.vertices.astype(np.float64), load_model(model_id)
            )
        if not samples:
            continue
        shares = felt_shares(
            samples,
            {key: spreads[key] for key in used},
            {key: len(load_model(key)) for key in used},
            contact,
        )
        for name, share in shares.items():
            strongest[name] = np.maximum(strongest.get(name, 0.0), share)
    faces = avatar.faces
    quads = faces[faces[:, 3] >= 0]
    triangles = np.concatenate([faces[:, :3], quads[:, [0, 2, 3]]])
    points = avatar.vertices.astype(np.float64)
    return _draw(points, triangles, _colours(strongest, len(points)), _volumes(scene))


def _colours(strongest: Mapping[str, F64], count: int) -> F64:
    """Colours (count, 3): skin blended with the legend's colour of the strongest modality alone."""
    colours = np.tile(SKIN, (count, 1))
    strengths = {name: share / share.max() for name, share in strongest.items() if share.any()}
    if strengths:
        shares = np.array(list(strengths.values()))
        legend = np.array([PALETTES["WARM_COLD"][name] for name in strengths])[
            shares.argmax(axis=0)
        ]
        colours += shares.max(axis=0)[:, None] * (legend - colours)
    return colours


def _volumes(scene: bpy.types.Scene) -> tuple[F64, F64]:
    """Points (n, 3) on the boundaries of volumes at :data:`_MOMENTS`, metres, and their colours."""
    generator = np.random.default_rng(1)
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for frame in _MOMENTS:
        scene.frame_set(frame)
        for obj in reversed(effects.effects_of(scene)):  # the first effect is drawn last, on top
            if obj.hfx.kind == "VOLUME":
                inside = _boundary(obj, generator.uniform(-1.0, 1.0, (_POINTS, 3)))
                matrix = np.array(obj.matrix_world, dtype=np.float64)
                points.append(inside @ matrix[:3, :3].T + matrix[:3, 3])
                is_cold = obj.hfx.modality == "temperature" and obj.hfx.temperature < _NEUTRAL_C
                name = COLD if is_cold else obj.hfx.modality
                colours.append(np.tile(PALETTES["WARM_COLD"][name], (_POINTS, 1)))
    return np.concatenate(points), np.concatenate(colours)


def _boundary(obj: bpy.types.Object, points: F64) -> F64:
    """Project points (n, 3) of the cube from -1 to 1 to the boundary of a shape, local space."""
    hfx = obj.hfx
    if hfx.shape == "CUBOID":
        axis = np.abs(points).argmax(axis=1)
        points[np.arange(len(points)), axis] = np.sign(points[np.arange(len(points)), axis])
        return points * np.array(hfx.size) / 2.0
    if hfx.shape in ("CYLINDER", "CAPSULE"):
        points[:, :2] /= np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        return points * (hfx.radius, hfx.radius, hfx.height / 2.0)
    return hfx.radius * points / np.linalg.norm(points, axis=1, keepdims=True)


def _draw(
    points: F64, triangles: npt.NDArray[np.int32], colours: F64, volumes: tuple[F64, F64]
) -> F64:
    """Draw the avatar from the front and from behind, side by side, point by point.

    Points of volumes appear around the avatar and, if in front of the whole avatar, over it.
    """
    picture = np.zeros((SIZE, SIZE, 4))
    corners, shades = points[triangles], colours[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    shares = np.array([(a, b, 4 - a - b) for a in range(5) for b in range(5 - a)]) / 4.0
    surface_points = np.einsum("kc,fcx->fkx", shares, corners)
    tints = np.einsum("kc,fcx->fkx", shares, shades)
    for left, facing in ((0, -1.0), (SIZE // 2, 1.0)):  # the avatar looks along -Y
        light = np.clip(facing * normals[:, 1], 0.0, 1.0)
        seen = light > 0.0
        positions, tint = surface_points[seen].reshape(-1, 3), tints[seen].reshape(-1, 3)
        tint = np.clip(tint * np.repeat(0.45 + 0.55 * light[seen], len(shares))[:, None], 0.0, 1.0)
        x, y, inside = _to_pixels(positions, points, left, facing)
        order = np.argsort(-facing * positions[:, 1] * -1.0)  # the nearest is drawn last
        order = order[inside[order]]
        picture[y[order].astype(int), x[order].astype(int), :3] = tint[order]
        picture[y[order].astype(int), x[order].astype(int), 3] = 1.0
        positions, tint = volumes
        x, y, inside = _to_pixels(positions, points, left, facing)
        is_before = facing * positions[:, 1] > (facing * points[:, 1]).max() - _NEAR_M
        row, column = y.astype(int), x.astype(int)
        inside[inside] &= is_before[inside] | (picture[row[inside], column[inside], 3] == 0.0)
        picture[row[inside], column[inside], :3] = tint[inside]
        picture[row[inside], column[inside], 3] = np.where(is_before[inside], 1.0, _FAINT)
    picture[..., :3] **= 1 / 2.2
    return picture


def _to_pixels(points: F64, body: F64, left: int, facing: float) -> tuple[F64, F64, Bool]:
    """Columns and rows (n,) of points (n, 3) in a half of the picture, and a mask of visibility."""
    scale = 0.94 * SIZE / np.ptp(body[:, 2])
    x = -facing * (points[:, 0] - body[:, 0].mean()) * scale * 0.72 + left + SIZE / 4
    y = SIZE * 0.97 - (points[:, 2] - body[:, 2].min()) * scale
    return x, y, (x >= left) & (x < left + SIZE // 2) & (y >= 0) & (y < SIZE)


if __name__ == "__main__":
    blender_session.start()
    sys.stdout.write(f"{make(Path(sys.argv[1]))}\n")
    sys.stdout.flush()
    leave(0)
