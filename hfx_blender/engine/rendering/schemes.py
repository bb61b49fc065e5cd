# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering scheme of a device on a perceptual model: vertices that drive each actuator.

Panning schemes treat each touched vertex as a phantom sensation; an actuator takes the strongest of
several, as with coverage.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F32, F64, I32
from ..body.model import PerceptualModel
from ..body.parts import SIDES
from ..body.skin_distance import SkinDistances
from .actuator_vertices import on_parts, rows_of
from .coverage import ActuatorCells
from .device_config import Actuator, BodyPlace, DeviceConfig, Mount, RoomPlace
from .mounts import Pad, on_mount
from .panning.complex import FARTHEST_M
from .panning.constant_power import LinePanning, RingPanning, VectorBasePanning
from .panning.positional import GaussianSplatting, NearestPanning, PlanarPanning
from .panning.surface_panning import SkinNeighbours, parted, surface_gains

_LONE_SPACING_M: Final = 0.05  # spacing of a single actuator, metres
_RINGS: Final = ((0.5, 6), (1.0, 12))
"""Sample rings of a disc larger than the gaps between actuators: share of its radius, places."""

_NO_DIRECTION: Final = 1e-6
"""Share of a layout's size within which an actuator is in the middle and has no direction."""


def cells_of(
    device: DeviceConfig, actuators: Sequence[Actuator], model: PerceptualModel
) -> ActuatorCells:
    """Vertices of a model reached by each actuator, mirrored as the device, with factors. Raises
    InputError for a place that does not fit this model, or a missing package of the scheme."""
    rows = rows_of(device, actuators, model)
    factors = None
    panned = panned_layout(device, actuators, model)
    if panned is not None:
        driven = [np.flatnonzero(panned.gains[:, a] > 0.0) for a in range(len(actuators))]
        rows = [panned.vertices[d] for d in driven]
        factors = [panned.gains[d, a] for a, d in enumerate(driven)]
    # Places are configured for one side: mirror the vertices, sorted again.
    if device.is_mirrored:
        orders = [np.argsort(model.mirror[row]) for row in rows]
        rows = [model.mirror[row][order] for row, order in zip(rows, orders, strict=True)]
        if factors is not None:
            factors = [factor[order] for factor, order in zip(factors, orders, strict=True)]
    return ActuatorCells(rows, len(model), factors)


@dataclass(frozen=True, eq=False)
class PannedLayout:
    """Panning between actuators, on the configured side of the body."""

    vertices: I32  # (n,) vertices that drive any actuator, ascending
    gains: F64  # (n, A)
    fade: F64  # (n,) included in the gains: 1 within the layout, 0 far beyond it
    spacing_m: float  # distance of neighbouring actuators
    at: Callable[[F64], F64]  # places (m, 3) of rest space to gains (m, A), without the fade


def panned_layout(
    device: DeviceConfig, actuators: Sequence[Actuator], model: PerceptualModel
) -> PannedLayout | None:
    """Layout of actuators for a device's panning scheme; None without panning. Coverage, actuators
    in the room, and actuators without a vertex on this model do not pan. Raises InputError for a
    place that does not fit this model, or a missing package of the scheme."""
    try:
        return _panned_layout(device, actuators, model)
    except ModuleNotFoundError as error:  # as in the small zip of the extension
        raise InputError(
            f"Device '{device.name}': the rendering scheme '{device.scheme.name}' needs the Python "
            f"package {(error.name or '').partition('.')[0]}, which is missing here; 'coverage' "
            "does without it."
        ) from error


def _panned_layout(
    device: DeviceConfig, actuators: Sequence[Actuator], model: PerceptualModel
) -> PannedLayout | None:
    """Layout as :func:`panned_layout`; raises ModuleNotFoundError for a missing package."""
    if device.scheme.name == "coverage" or not actuators or unpanned(device, actuators, model):
        return None  # Renderer.notes reports the latter
    rows = rows_of(device, actuators, model)
    centres = np.zeros((len(actuators), 3))
    for k, (actuator, row) in enumerate(zip(actuators, rows, strict=True)):
        if isinstance(actuator.place, BodyPlace):
            centres[k] = actuator.place.centre_m
        else:  # the centroid of the skin that the vertices stand for
            areas = model.areas_m2[row].astype(np.float64)
            centres[k] = areas @ model.vertices[row] / areas.sum()
    spacing_m = _spacing_m(centres)
    # The vertex of each actuator that is nearest to its centre.
    away = (model.vertices[row] - centre for centre, row in zip(centres, rows, strict=True))
    nearest = (np.argmin(np.linalg.norm(offsets, axis=1)) for offsets in away)
    anchors = np.array([row[k] for row, k in zip(rows, nearest, strict=True)], np.int64)
    # The fade beyond the layout must not reach parts on which the device is not worn.
    candidates = _candidates(actuators, rows, model)
    if device.scheme.name in ("surface", "brush"):
        # Phantoms of the Tactile Brush share the power.
        law = "power" if device.scheme.name == "brush" else device.scheme.law
        panned = surface_gains(model, anchors, law)
        own = np.isin(panned.vertices, candidates)
        vertices, gains, fade = panned.vertices[own], panned.gains[own], panned.fade[own]
        return PannedLayout(vertices, gains, fade, spacing_m, panned.at)
    # Fade in space, as flat layouts have no skin: 1 up to one spacing away, 0 from two on.
    points = model.vertices[candidates].astype(np.float64)
    away_m = np.full(len(points), np.inf)
    for centre in centres:
        np.minimum(away_m, np.linalg.norm(points - centre, axis=1), out=away_m)
    fade = np.clip(2.0 - away_m / spacing_m, 0.0, 1.0)
    is_near = fade > 0.0
    vertices, points, fade = candidates[is_near], points[is_near], fade[is_near]
    # All flat schemes share the rule that neighbours are close along the skin.
    neighbours = SkinNeighbours(model, centres, anchors)
    gains_at = _FLAT[device.scheme.name](device, centres)

    def at(places: F64) -> F64:
        is_place = np.isfinite(places).all(axis=1)
        # Larger squares of coordinates may overflow.
        clipped = np.clip(np.where(is_place[:, None], places, 0.0), -FARTHEST_M, FARTHEST_M)
        return parted(gains_at(clipped) * is_place[:, None], neighbours.are_joined)

    return PannedLayout(vertices, at(points) * fade[:, None], fade, spacing_m, at)


def unpanned(device: DeviceConfig, actuators: Sequence[Actuator], model: PerceptualModel) -> str:
    """Reason why actuators cannot pan, as a predicate: any "stand in the room", or any "are nowhere
    on it" (without a vertex on the model); else empty. Raises InputError for a misfit."""
    if any(isinstance(actuator.place, RoomPlace) for actuator in actuators):
        return "stand in the room"
    if not all(len(row) for row in rows_of(device, actuators, model)):
        return "are nowhere on it"
    return ""


def _candidates(actuators: Sequence[Actuator], rows: list[I32], model: PerceptualModel) -> I32:
    """Ascending vertices on the parts and sides of body places; of other places, of ``rows``. A
    body place without a side stands for its parts on both sides."""
    allowed = np.zeros(len(model), np.bool_)
    for actuator, row in zip(actuators, rows, strict=True):
        configured = actuator.place
        if isinstance(configured, BodyPlace):
            on_place = on_parts(configured.parts, model)
            if configured.side is not None:
                on_place &= model.side == SIDES.index(configured.side)
            allowed |= on_place
        else:
            label = model.part[row].astype(np.int64) * len(SIDES) + model.side[row]
            every = model.part.astype(np.int64) * len(SIDES) + model.side
            allowed |= np.isin(every, label)
    return np.flatnonzero(allowed).astype(np.int32)


def _spacing_m(centres: F64) -> float:
    """Largest distance of nearest neighbours, m; 0.05 if all actuators are at one place. Actuators
    at one place are no neighbours of each other."""
    between = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    between[between == 0.0] = np.inf
    nearest = between.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(nearest.max()) if len(nearest) else _LONE_SPACING_M


def _mount(mount: Mount | None, centres: F64) -> Mount:
    """``mount`` or, for None, the least squares plane through actuators, their mean as origin."""
    if mount is not None:
        return mount
    middle = centres.mean(axis=0)
    axes = np.linalg.svd(centres - middle, full_matrices=True)[2]
    origin, x_axis, y_axis = (tuple(float(v) for v in vector) for vector in (middle, *axes[:2]))
    return Mount(origin, x_axis, y_axis)  # type: ignore[arg-type]


_Gains = Callable[[F64], F64]  # places (m, 3) of rest space to gains (m, A)


def _planar(device: DeviceConfig, centres: F64) -> _Gains:
    """Barycentric gains on the unrolled mount, closed where the layout surrounds the cylinder."""
    pad = Pad(_mount(device.mount, centres), centres, _spacing_m(centres))
    panning = PlanarPanning(pad.at(centres), device.scheme.law, pad.closed_m)
    return lambda points: panning.gains(pad.at(points))


def _ring(device: DeviceConfig, centres: F64) -> _Gains:
    """Gains of a ring by angle about the middle of a flat mount, or by arc length around a bent
    mount."""
    mount = _mount(device.mount, centres)
    if mount.bend_radius_m is not None:
        return _round(mount, centres, abs(mount.bend_radius_m))
    ring = on_mount(mount, centres)
    middle = 0.5 * (ring.min(axis=0) + ring.max(axis=0))

    def angles(places: F64) -> F64:
        return np.asarray(np.arctan2(*(places - middle).T[::-1]))

    panning = RingPanning(angles(ring))
    return lambda points: panning.gains(angles(on_mount(mount, points))[:, None])


def _round(mount: Mount, centres: F64, radius_m: float) -> _Gains:
    """Gains of a ring around the cylinder of a bent mount, by arc length over ``radius_m``."""
    panning = RingPanning(on_mount(mount, centres)[:, 0] / radius_m)
    return lambda points: panning.gains(on_mount(mount, points)[:, :1] / radius_m)


def _line(device: DeviceConfig, centres: F64) -> _Gains:
    """Gains of a line along the layout's x axis, closed where the layout surrounds the cylinder."""
    mount = _mount(device.mount, centres)
    pad = Pad(mount, centres, _spacing_m(centres))
    if mount.bend_radius_m is not None and pad.closed_m is not None:
        return _round(mount, centres, abs(mount.bend_radius_m))
    panning = LinePanning(pad.at(centres)[:, 0])
    return lambda points: panning.gains(pad.at(points)[:, :1])


def _vbap(device: DeviceConfig, centres: F64) -> _Gains:
    """Gains of VBAP about the middle of the actuators, in space, or in the plane of a flat layout.
    With an actuator in the middle the viewpoint moves behind the layout. Actuators all at one place
    share the power."""
    if not np.any(centres != centres[0]):  # a single place has no directions
        alone = PlanarPanning(np.zeros((len(centres), 2)), "power")
        return lambda points: alone.gains(points[:, :2])
    middle = 0.5 * (centres.min(axis=0) + centres.max(axis=0))
    if _have_directions(centres - middle):
        with suppress(ValueError):
            return _seen_from(middle, centres, np.eye(3))
    # Flat layout: pan by directions in its plane about its middle.
    mount = _mount(device.mount, centres)
    if mount.bend_radius_m is not None:  # a plane through the actuators is not the tangent plane
        mount = _mount(None, centres)
    axes = np.array([mount.x_axis, mount.y_axis])
    ring = on_mount(mount, centres)
    centre = np.array(mount.origin_m) + 0.5 * (ring.min(axis=0) + ring.max(axis=0)) @ axes
    if _have_directions((centres - centre) @ axes.T):
        return _seen_from(centre, centres, axes)
    normal = np.cross(*axes)
    # An actuator in the middle has no direction: move the viewpoint behind the layout.
    behind = centre - np.linalg.norm(centres - centre, axis=1).max() * normal
    with suppress(ValueError):
        return _seen_from(behind, centres, np.eye(3))
    return _seen_from(behind, centres, np.array([axes[0], normal]))  # a line


def _seen_from(origin: F64, centres: F64, axes: F64) -> _Gains:
    """Gains of VBAP by directions from ``origin`` (3,) along ``axes`` (2 or 3, 3)."""
    panning = VectorBasePanning((centres - origin) @ axes.T)
    return lambda points: panning.gains((points - origin) @ axes.T)


def _have_directions(offsets: F64) -> bool:
    """Test that every offset (A, D) is longer than 1e-6 of the longest."""
    away_m = np.linalg.norm(offsets, axis=1)
    return bool(away_m.min() > _NO_DIRECTION * away_m.max())


_FLAT: Final[dict[str, Callable[[DeviceConfig, F64], _Gains]]] = {
    "barycentric": _planar,
    "ring": _ring,
    "line": _line,
    "vbap": _vbap,
    "nearest": lambda device, centres: NearestPanning(centres).gains,
    "saltation": lambda device, centres: NearestPanning(centres).gains,
    "splat": lambda device, centres: GaussianSplatting(centres, device.scheme.sigma_m).gains,
}
"""Gains of the flat schemes, by name, of a device and its actuators' ``centres`` (A, 3)."""


class FocusPanning:
    """Gains of A actuators for spots anywhere on one model, rendered at their own place.

    Schneider et al., UIST 2015: the place of the virtual actuator is rendered, so that motion is
    smooth. A disc up to as wide as the gaps between actuators is a phantom sensation at its centre.
    For a wider disc each actuator takes the strongest of the phantom sensations within the disc.
    ``is_mirrored``: the layout is configured for the opposite side of the body.
    """

    def __init__(self, layout: PannedLayout, model: PerceptualModel, *, is_mirrored: bool) -> None:
        self._layout = layout
        self._skin = SkinDistances(model.vertices, model.triangles)
        self._normals = model.normals.astype(np.float64)
        self._fade = np.zeros(len(model))
        self._fade[layout.vertices] = layout.fade
        self._side = -1.0 if is_mirrored else 1.0

    def gains(self, focus: F32) -> F64:
        """Gains (n, A), 0..1, for spots (n, 4): centre in rest space and radius, m. A spot with a
        radius above half a spacing has the largest gains over its disc; gains fade beyond the
        layout."""
        # A resting spot repeats its focus: distinct ones are rendered once.
        known, which = np.unique(focus.astype(np.float64), axis=0, return_inverse=True)
        places = known[:, :3] * [self._side, 1.0, 1.0]
        beyond_m = known[:, 3] - 0.5 * self._layout.spacing_m
        fades, gains = np.zeros(len(known)), self._layout.at(places)
        for k, centre in enumerate(places):
            on_skin = self._skin.nearest(centre)
            fades[k] = on_skin.weights @ self._fade[on_skin.corners]
            if beyond_m[k] > 0.0 and fades[k] > 0.0:
                normal = on_skin.weights @ self._normals[on_skin.corners]
                disc = _disc(centre, normal, float(beyond_m[k]))
                gains[k] = np.maximum(gains[k], self._layout.at(disc).max(axis=0))
        return np.asarray(np.clip(gains * fades[:, None], 0.0, 1.0)[which.ravel()])


def _disc(centre: F64, normal: F64, radius_m: float) -> F64:
    """Points (18, 3) around ``centre`` in the plane across ``normal``: 6 on a ring of half
    ``radius_m``, then 12 on a ring of ``radius_m``."""
    # The further right singular vectors of a row are an orthonormal basis across the row.
    axes = np.linalg.svd(normal[None] / max(float(np.linalg.norm(normal)), 1e-12))[2]
    first_axis, second_axis = axes[1], axes[2]
    rings = []
    for share, count in _RINGS:
        angle = np.arange(count) * (2.0 * np.pi / count)
        ring = np.outer(np.cos(angle), first_axis) + np.outer(np.sin(angle), second_axis)
        rings.append(centre + share * radius_m * ring)
    return np.concatenate(rings)
