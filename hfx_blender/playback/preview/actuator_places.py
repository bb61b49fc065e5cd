# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the places of a device's actuators on an avatar."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from ...authoring.effects import effects
from ...avatars import avatar_meshes, stored_fits
from ...engine.arrays import F64, I64
from ...engine.body.model import Avatar, load_avatar, load_model
from ...engine.rendering.actuator_vertices import on_parts, vertices_of
from ...engine.rendering.device_config import BodyPlace, DeviceConfig, Place, VertexPlace

SMALLEST_M, LARGEST_M = 0.006, 0.02
"""Radii of the discs that stand for actuators."""

_NEAREST = 4
_ROOM_M = 0.45
"""Distance before the body at which an actuator that stands in the room is shown, metres."""


@dataclass(frozen=True, eq=False)
class ActuatorPlaces:
    """Places of a device's A actuators on a body; -1 for those that stand in the room."""

    mesh: I64  # (A,) which of the avatar's meshes
    vertex: I64  # (A,) of that mesh
    radius_m: F64  # (A,)
    at_rest: F64  # (A, 3) rest space of the body's armature


def places_of(body: bpy.types.Object, device: DeviceConfig) -> ActuatorPlaces:
    """Find each actuator's place on the skin that is seen.

    Raises
    ------
    InputError
        A place does not fit the body models.
    """
    count = len(device.actuators)
    avatar = load_avatar()
    canonical = np.zeros((count, 3))
    radii = np.full(count, LARGEST_M)
    in_room = np.zeros(count, np.bool_)
    for k, actuator in enumerate(device.actuators):
        model_id = effects.model_id_for(actuator.type.modality)
        canonical[k], radius, in_room[k] = _place(actuator.place, model_id, avatar)
        radii[k] = min(max(radius, SMALLEST_M), LARGEST_M)
    _spread_room(canonical, in_room)
    rest = np.zeros((count, 3))
    for modality in device.modalities:
        mine = [k for k, each in enumerate(device.actuators) if each.type.modality == modality]
        rest[mine] = _on_body(body, effects.model_id_for(modality), canonical[mine])
    mesh, vertex = _nearest_on_avatar(body, rest)
    mesh[in_room] = vertex[in_room] = -1
    return ActuatorPlaces(mesh, vertex, radii, rest)


def _place(place: Place, model_id: str, avatar: Avatar) -> tuple[F64, float, bool]:
    """Place on the canonical avatar, radius, and whether it stands in the room."""
    if isinstance(place, VertexPlace):
        each = next((s for s in place.sets if s.model_id == model_id), place.sets[0])
        model = load_model(each.model_id)
        chosen = model.vertices[vertices_of(VertexPlace((each,)), model)].astype(np.float64)
        middle = chosen.mean(axis=0)
        return middle, float(np.linalg.norm(chosen - middle, axis=1).mean()), False
    if isinstance(place, BodyPlace):
        # The avatar's vertices are closer together than any model's.
        point = BodyPlace(place.parts, place.centre_m, 0.0, place.side)
        (nearest,) = vertices_of(point, avatar)
        return avatar.vertices[nearest].astype(np.float64), place.radius_m, False
    chosen = avatar.vertices[on_parts(place.parts, avatar)]
    return chosen.mean(axis=0).astype(np.float64) - (0.0, _ROOM_M, 0.0), 2 * LARGEST_M, True


def _spread_room(points: F64, in_room: npt.NDArray[np.bool_]) -> None:
    """Place actuators of the room beside each other, not in one place."""
    which = np.flatnonzero(in_room)
    points[which, 0] += 0.12 * (np.arange(len(which)) - (len(which) - 1) / 2)


def _on_body(body: bpy.types.Object, model_id: str, points: F64) -> F64:
    """Map points from the canonical avatar to a body's own rest space, by the model's vertices near
    them.
    """
    model, own = load_model(model_id), stored_fits.model_of(body, model_id)
    before, after = model.vertices.astype(np.float64), own.vertices.astype(np.float64)
    scale = float(np.ptp(after, axis=0).max() / np.ptp(before, axis=0).max())
    found = np.zeros_like(points)
    for k, point in enumerate(points):
        distances = np.linalg.norm(before - point, axis=1)
        near = np.argpartition(distances, _NEAREST)[:_NEAREST]
        share = 1.0 / np.maximum(distances[near], 1e-6)
        share /= share.sum()
        found[k] = share @ after[near] + scale * (point - share @ before[near])
    return found


def _nearest_on_avatar(body: bpy.types.Object, points: F64) -> tuple[I64, I64]:
    """Mesh and vertex of the avatar that are nearest to points at rest."""
    mesh, vertex = np.full(len(points), -1), np.full(len(points), -1)
    best = np.full(len(points), np.inf)
    for number, each in enumerate(avatar_meshes.meshes_of(body)):
        skin, _ = avatar_meshes.rest_surface(each, stored_fits.shape_of(body, each))
        if not len(skin):
            continue
        to_rest = np.array(body.matrix_world.inverted_safe() @ each.matrix_world, np.float64)
        skin = skin @ to_rest[:3, :3].T + to_rest[:3, 3]
        for k, point in enumerate(points):
            distances = np.linalg.norm(skin - point, axis=1)
            nearest = int(distances.argmin())
            if distances[nearest] < best[k]:
                best[k], mesh[k], vertex[k] = distances[nearest], number, nearest
    return mesh, vertex
