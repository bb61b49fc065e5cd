# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices of a perceptual model that a device's actuators reach."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ...errors import InputError
from ..arrays import F64, I32, Bool
from ..body.model import PerceptualModel
from ..body.parts import PARTS, SIDES
from .device_config import Actuator, BodyPlace, DeviceConfig, Place, RoomPlace, VertexPlace

MAX_MISS_M = 0.2
"""Largest distance of an actuator's nearest vertex beyond its radius, metres. Temperature vertices
are 150 mm apart (Danieau et al. 2018, Table 1), so a place on skin is never this far from all
vertices; a farther place belongs to another body."""


def rows_of(
    device: DeviceConfig, actuators: Iterable[Actuator], model: PerceptualModel
) -> list[I32]:
    """Vertex ids reached by each actuator, ascending, on the side configured (not mirrored). Raises
    InputError, with device and actuator, for a place that does not fit this model."""
    rows = []
    for actuator in actuators:
        try:
            rows.append(vertices_of(actuator.place, model))
        except InputError as error:
            raise InputError(f"Device '{device.id}', actuator '{actuator.id}': {error}") from None
    return rows


def vertices_of(place: Place, model: PerceptualModel) -> I32:
    """Vertices of ``model`` reached by a place, ascending; a shared array, not to be changed.

    A place on the body always reaches the nearest vertex of the parts, even beyond the radius, so
    that an actuator between the vertices of a coarse model still plays. A place in the room reaches
    all vertices of the parts. Empty for named vertices without a set for this model. Raises
    InputError for a place that does not fit this model.
    """
    if isinstance(place, VertexPlace):
        return _named(place, model)
    if isinstance(place, RoomPlace):
        return np.flatnonzero(on_parts(place.parts, model)).astype(np.int32)
    patches = _PATCHES.setdefault(model, {})
    if place not in patches:
        # Editing a device makes new places without end, so a full cache begins from nothing.
        if len(patches) >= _MOST_PATCHES:
            patches.clear()
        patches[place] = _patch(place, model)
        patches[place].flags.writeable = False
    return patches[place]


_MOST_PATCHES: Final = 4096
_PATCHES: Final[WeakKeyDictionary[PerceptualModel, dict[BodyPlace, I32]]] = WeakKeyDictionary()
"""Cached patches; a device's checks, notes and cells need each of them."""


def on_parts(parts: tuple[str, ...], model: PerceptualModel) -> Bool:
    """Mask (V,) of the vertices on any of the named parts of the body."""
    return np.isin(model.part, [PARTS.index(part) for part in parts])


@lru_cache(maxsize=64)
def _skin_of(parts: tuple[str, ...], side: str | None, model: PerceptualModel) -> tuple[I32, F64]:
    """Vertices of a model on parts and a side (None: any), and their positions (3, n) at rest;
    cached."""
    allowed = on_parts(parts, model)
    if side is not None:
        allowed &= model.side == SIDES.index(side)
    vertices = np.flatnonzero(allowed).astype(np.int32)
    return vertices, np.ascontiguousarray(model.vertices[vertices].T, np.float64)


def _patch(place: BodyPlace, model: PerceptualModel) -> I32:
    """Vertices within the radius of a place, the nearest always; with all of the stroking parts.
    Raises InputError without a vertex on the parts, or with none within 0.2 m of the radius."""
    candidates, places = _skin_of(place.parts, place.side, model)  # vertices, and x, y, z of them
    where = " or ".join(place.parts) + (f" ({place.side})" if place.side else "")
    if not len(candidates):
        raise InputError(f"model '{model.id}' has no vertex on {where}.")
    x, y, z = (along - centre for along, centre in zip(places, place.centre_m, strict=True))
    distances = np.sqrt(x * x + y * y + z * z)
    nearest = int(np.argmin(distances))
    if distances[nearest] > place.radius_m + MAX_MISS_M:
        raise InputError(
            f"centre_m {list(place.centre_m)} is {distances[nearest]:.2f} m from the nearest "
            f"vertex on {where} of model '{model.id}', allowed is radius_m + {MAX_MISS_M} m."
        )
    within = distances <= place.radius_m
    within[nearest] = True
    # Stroking parts, as fingers over a phone, feel the effect everywhere.
    if place.stroked_by:
        strokers = np.flatnonzero(on_parts(place.stroked_by, model))
        return np.union1d(candidates[within], strokers).astype(np.int32)
    return np.asarray(candidates[within])


def _named(place: VertexPlace, model: PerceptualModel) -> I32:
    """Vertices listed for this model, in their order; empty if the place lists none. Raises
    InputError for another content hash, or an id beyond the model."""
    for named in place.sets:
        if named.model_id != model.id:
            continue
        if named.content_hash != model.content_hash:
            raise InputError(
                f"its vertices were chosen on another '{model.id}' (hash "
                f"{named.content_hash[:12]}..., this model has {model.content_hash[:12]}...)."
            )
        vertices = np.array(named.vertices, np.int32)  # ascending, so the last is the largest
        if vertices[-1] >= len(model):
            raise InputError(
                f"vertex {vertices[-1]} is not on model '{model.id}', which has {len(model)}."
            )
        return vertices
    return np.zeros(0, np.int32)
