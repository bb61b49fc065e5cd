# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuators of the scene's devices as discs on the skin, glowing with their output."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from ...authoring.effects import effects
from ...avatars import avatar_meshes, stored_fits
from ...engine.arrays import F32, F64, I64
from ...engine.body.model import Avatar, load_avatar, load_model
from ...engine.colouring import COLD, Colour
from ...engine.rendering.actuator_vertices import on_parts, vertices_of
from ...engine.rendering.device_config import BodyPlace, DeviceConfig, Place, VertexPlace
from ...engine.rendering.moment import MomentRenderer
from ...engine.samples import SampleRun
from ...errors import HfxError
from ...reading.live_scene import LiveScene
from ..timeline.timeline_record import TimelineRecord, devices_of, notes_of
from .skin_colours import DisplayedSkins

ABOVE_SKIN_M = 0.004

MOST_DISCS = 256
"""Largest number of discs in one draw call: 32 bytes each, in a uniform buffer of 16 kB."""


@dataclass(frozen=True, eq=False)
class Looks:
    """Constant appearance of A actuators on a mesh, or in the room."""

    colours: F32  # (A, 3) at full strength
    cold: F32  # (A, 3) below neutral
    radii: F32  # (A,) Blender's units, of the world


@dataclass(frozen=True, eq=False)
class Discs:
    """Drawable discs of A actuators, in the space of their mesh or of the room.

    ``rows`` (B, 2, 4) have for each disc position and share of full strength in -1..1; then normal
    and a zero; padded with zeros to a multiple of :data:`MOST_DISCS`.
    """

    looks: Looks  # the same object until the appearance changes
    rows: F32
    matrix: Matrix  # disc space to world
    above: float  # offset along the normal, in disc space
    scale: float  # world length of one unit of disc space


@dataclass(eq=False)
class _DeviceOnBody:
    """Actuators of a device on a body; A strength values are chosen from all device values."""

    device: DeviceConfig
    body_id: str
    places: "ActuatorPlaces"
    columns: npt.NDArray[np.int64]  # (A,) of the strengths among the values
    neutral: F64  # (A,) silent strength
    reach: F64  # (A,) from neutral to full strength
    renderer: MomentRenderer
    fault: str = ""  # why it cannot be rendered

    def recorded(self, recorded: TimelineRecord) -> F32:
        """Strengths at all T times of a record, (T, A): 0 at neutral, 1 at full strength, clipped
        to -1..1. Zeros without recorded values of this device."""
        for device, raster in recorded.devices:
            if device.id == self.device.id and raster.body_id == self.body_id:
                return self._share(raster.values[:, self.columns])
        return np.zeros((len(recorded.frames), len(self.columns)), np.float32)

    def now(self, runs: Sequence[SampleRun]) -> F32:
        """Strengths for samples of a moment, (A,) in -1..1.

        Zeros without a sample of this body. An error of the renderer becomes :attr:`fault`; zeros
        from then on.
        """
        is_felt = any(run.stream.body_id == self.body_id and len(run) for run in runs)
        if self.fault or not is_felt:
            return np.zeros(len(self.columns), np.float32)
        try:
            return self._share(self.renderer.values(runs)[self.columns])
        except HfxError as error:
            self.fault = str(error)
            return self.now(runs)

    def _share(self, values: F64) -> F32:
        share = np.clip((values - self.neutral) / self.reach, -1.0, 1.0)
        return share.astype(np.float32)


class ActuatorGlow:
    """Glow of all devices of a scene on all bodies."""

    def __init__(self, live: LiveScene, scene: bpy.types.Scene) -> None:
        self._faults: list[str] = []
        self._live = live
        self._on_bodies: list[_DeviceOnBody] = []  # actuators of the first body come first
        self._bodies: list[_BodyWithDevices] = []
        devices = devices_of(scene, self._faults)
        for body, described in zip(live.objects.bodies, live.description.bodies, strict=True):
            mine = []
            for device in devices:
                ranges = [actuator.type.strength for actuator in device.actuators]
                try:
                    on_body = _DeviceOnBody(
                        device,
                        described.id,
                        places_of(body, device),
                        device.strength_columns,
                        np.array([strength.neutral for strength in ranges]),
                        np.array([max(strength.reach, 1e-9) for strength in ranges]),
                        MomentRenderer(live.description, device, body_id=described.id),
                    )
                    mine.append(on_body)
                except HfxError as error:
                    self._faults.append(str(error))
            if mine:
                self._on_bodies += mine
                self._bodies.append(_BodyWithDevices(body, mine))
        self.notes = notes_of([glow.device for glow in self._on_bodies])
        self._known: tuple[TimelineRecord | None, F32 | None] = None, None

    @property
    def fault(self) -> str:
        """Errors of all devices, joined by semicolons; empty without an error."""
        faults = [*self._faults, *(glow.fault for glow in self._on_bodies)]
        return "; ".join(dict.fromkeys(filter(None, faults)))

    def recorded(self, recorded: TimelineRecord, index: int) -> F32:
        """Strengths of all actuators at sample ``index`` of a record, (A,) in -1..1.

        Zeros for devices without recorded values.
        """
        # Convert the whole record once: playback then takes one row a frame.
        record, shares = self._known
        if record is not recorded or shares is None:
            parts = [glow.recorded(recorded) for glow in self._on_bodies]
            shares = np.concatenate([np.zeros((len(recorded.frames), 0), np.float32), *parts], 1)
            self._known = recorded, shares
        row: F32 = shares[index]
        return row

    def now(self, runs: Sequence[SampleRun]) -> F32:
        """Strengths of all actuators for samples of a moment, (A,) in -1..1."""
        return np.concatenate(
            [np.zeros(0, np.float32), *(glow.now(runs) for glow in self._on_bodies)]
        )

    def discs(
        self, strengths: F32, palette: Mapping[str, Colour], unit_m: float, skins: DisplayedSkins
    ) -> list[Discs]:
        """Drawable discs of all actuators in the current pose, mesh by mesh.

        ``strengths`` (A,) are those of :meth:`now`; a Blender unit has ``unit_m`` metres.
        """
        discs = []
        first = 0
        for body in self._bodies:
            share = strengths[first : first + len(body)]
            first += len(body)
            discs += body.discs(self._live, skins, share, palette, unit_m)
        return discs


class _BodyWithDevices:
    """A body with the actuators of all its devices, in the order of the devices."""

    def __init__(self, body: bpy.types.Object, devices: Sequence[_DeviceOnBody]) -> None:
        self._body = body
        places = [glow.places for glow in devices]
        self._radius_m = np.concatenate([place.radius_m for place in places])
        self._modalities = [a.type.modality for glow in devices for a in glow.device.actuators]
        mesh = np.concatenate([place.mesh for place in places])
        vertex = np.concatenate([place.vertex for place in places])
        # Mesh, numbers of its actuators, and their vertices.
        self._on = [
            (part, np.flatnonzero(mesh == number), vertex[mesh == number])
            for number, part in enumerate(avatar_meshes.meshes_of(body))
            if (mesh == number).any()
        ]
        self._in_room = np.flatnonzero(mesh < 0)
        at_rest = np.concatenate([place.at_rest for place in places])[self._in_room]
        self._room = _empty_rows(len(at_rest))
        self._room[: len(at_rest), 0, :3] = at_rest
        self._room[: len(at_rest), 1, 1] = -1.0  # discs in the room face the body's front at rest
        self._looks: tuple[tuple[object, ...], list[Looks]] = (), []

    def __len__(self) -> int:
        return len(self._radius_m)

    def discs(
        self,
        live: LiveScene,
        skins: DisplayedSkins,
        share: F32,
        palette: Mapping[str, Colour],
        unit_m: float,
    ) -> list[Discs]:
        """Discs of each displayed mesh, then of the room; ``share`` (A,) has the strengths.

        Meshes are skipped while hidden, in other modes, and with too few vertices after an edit.
        """
        graph, discs = live.objects.layer.depsgraph, []
        *on_skin, in_room = self._looks_of(palette, unit_m)
        for (mesh, mine, vertices), looks in zip(self._on, on_skin, strict=True):
            skin = skins.of(mesh, graph)
            if skin is None or skin.size <= vertices.max():
                continue
            rows, count = _empty_rows(len(mine)), len(mine)
            rows[:count, 0, :3] = skin.positions.take(vertices, axis=0)
            rows[:count, 0, 3] = share.take(mine)
            rows[:count, 1, :3] = skin.normals.take(vertices, axis=0)
            discs.append(_placed(looks, rows, skin.world, unit_m))
        if len(self._in_room):
            rows = self._room.copy()
            rows[: len(self._in_room), 0, 3] = share.take(self._in_room)
            world = self._body.evaluated_get(graph).matrix_world.copy()
            discs.append(_placed(in_room, rows, world, unit_m))
        return discs

    def _looks_of(self, palette: Mapping[str, Colour], unit_m: float) -> list[Looks]:
        """Appearances: one for each mesh with actuators, then one for actuators in the room.

        The same objects until palette or unit change.
        """
        known, looks = self._looks
        key = (unit_m, *palette.values())  # users may edit their palette
        if known != key:
            named = [palette[name] for name in self._modalities]
            cold = [palette[COLD if n == "temperature" else n] for n in self._modalities]
            colours, below = np.array(named, np.float32), np.array(cold, np.float32)
            radii = (self._radius_m / unit_m).astype(np.float32)
            looks = [
                Looks(colours[mine], below[mine], radii[mine])
                for mine in (*(mine for _, mine, _ in self._on), self._in_room)
            ]
            self._looks = key, looks
        return looks


def _empty_rows(count: int) -> F32:
    """Zeros (B, 2, 4) for ``count`` discs, B a multiple of :data:`MOST_DISCS`."""
    return np.zeros((-(-count // MOST_DISCS) * MOST_DISCS, 2, 4), np.float32)


def _placed(looks: Looks, rows: F32, matrix: Matrix, unit_m: float) -> Discs:
    """Discs 4 mm above the skin; ``matrix``: disc space to world, ``unit_m``: metres of a unit."""
    # The cube root of the determinant is the mean scale of a matrix with unequal scales.
    scale = max(abs(matrix.determinant()) ** (1 / 3), 1e-12)
    return Discs(looks, rows, matrix, ABOVE_SKIN_M / unit_m / scale, scale)


SMALLEST_M, LARGEST_M = 0.006, 0.02
"""Radii of the actuators' discs."""

_NEAREST = 4
# Distance of a disc in the room from the body's front, metres.
_ROOM_M = 0.45


@dataclass(frozen=True, eq=False)
class ActuatorPlaces:
    """Mesh and vertex of a device's A actuators on a body; -1 for actuators in the room."""

    mesh: I64  # (A,) which of the avatar's meshes
    vertex: I64  # (A,) of that mesh
    radius_m: F64  # (A,)
    at_rest: F64  # (A, 3) rest space of the body's armature


def places_of(body: bpy.types.Object, device: DeviceConfig) -> ActuatorPlaces:
    """Nearest vertex of a body's avatar meshes at rest for each actuator, and radius of its disc.

    Raises InputError: a configured place does not fit the body models.
    """
    count = len(device.actuators)
    avatar = load_avatar()
    canonical = np.zeros((count, 3))
    radii = np.full(count, LARGEST_M)
    in_room = np.zeros(count, np.bool_)
    for k, actuator in enumerate(device.actuators):
        model_id = effects.model_id_for(actuator.type.modality, body)
        canonical[k], radius, in_room[k] = _canonical_place(actuator.place, model_id, avatar)
        radii[k] = min(max(radius, SMALLEST_M), LARGEST_M)
    # Discs in the room stand side by side along X, 0.12 m apart and centred.
    which = np.flatnonzero(in_room)
    canonical[which, 0] += 0.12 * (np.arange(len(which)) - (len(which) - 1) / 2)
    # Fitted bodies have a model of their own for each modality: move the places of a modality with
    # the vertices of its model, so that a disc is where the actuator's effects are felt.
    rest = np.zeros((count, 3))
    for modality in device.modalities:
        mine = [k for k, a in enumerate(device.actuators) if a.type.modality == modality]
        rest[mine] = _bound_places(body, effects.model_id_for(modality, body), canonical[mine])
    mesh, vertex = _nearest_on_avatar(body, rest)
    mesh[in_room] = vertex[in_room] = -1
    return ActuatorPlaces(mesh, vertex, radii, rest)


def _canonical_place(place: Place, model_id: str, avatar: Avatar) -> tuple[F64, float, bool]:
    """Point (3,) on the canonical avatar and radius, metres; True for a place in the room.

    The mean of a vertex set, of the first set if none is of ``model_id``, and the mean distance
    from it; the vertex nearest to a body place; a point in front of body parts in the room.
    """
    if isinstance(place, VertexPlace):
        vertex_set = next((s for s in place.sets if s.model_id == model_id), place.sets[0])
        model = load_model(vertex_set.model_id)
        chosen = model.vertices[vertices_of(VertexPlace((vertex_set,)), model)].astype(np.float64)
        # A vertex set has no centre of its own.
        middle = chosen.mean(axis=0)
        return middle, float(np.linalg.norm(chosen - middle, axis=1).mean()), False
    if isinstance(place, BodyPlace):
        # The avatar's vertices are closer together than any model's.
        point = BodyPlace(place.parts, place.centre_m, 0.0, place.side)
        (nearest,) = vertices_of(point, avatar)
        return avatar.vertices[nearest].astype(np.float64), place.radius_m, False
    chosen = avatar.vertices[on_parts(place.parts, avatar)]
    return chosen.mean(axis=0).astype(np.float64) - (0.0, _ROOM_M, 0.0), 2 * LARGEST_M, True


def _bound_places(body: bpy.types.Object, model_id: str, points: F64) -> F64:
    """Map points (P, 3) from the canonical avatar to a body's rest space: the mean of the nearest
    four model vertices by inverse distance, plus the offset from it, scaled by the body's size."""
    model, own = load_model(model_id), stored_fits.model_of(body, model_id)
    before, after = model.vertices.astype(np.float64), own.vertices.astype(np.float64)
    scale = float(np.ptp(after, axis=0).max() / np.ptp(before, axis=0).max())
    bound = np.zeros_like(points)
    for k, point in enumerate(points):
        distances = np.linalg.norm(before - point, axis=1)
        # Four vertices surround a point on the skin; a single vertex would make a disc jump.
        near = np.argpartition(distances, _NEAREST)[:_NEAREST]
        share = 1.0 / np.maximum(distances[near], 1e-6)
        share /= share.sum()
        # The mean of the vertices moves with the fit; the point's offset from it is scaled.
        bound[k] = share @ after[near] + scale * (point - share @ before[near])
    return bound


def _nearest_on_avatar(body: bpy.types.Object, points: F64) -> tuple[I64, I64]:
    """Nearest mesh, by number, and vertex of points (P, 3) in rest space, (P,) each; -1 without
    vertices."""
    mesh, vertex = np.full(len(points), -1), np.full(len(points), -1)
    # Smallest distance so far, over all meshes.
    best = np.full(len(points), np.inf)
    for number, part in enumerate(avatar_meshes.meshes_of(body)):
        skin, _ = avatar_meshes.rest_surface(body, part, stored_fits.shape_of(body, part))
        if not len(skin):
            continue
        for k, point in enumerate(points):
            distances = np.linalg.norm(skin - point, axis=1)
            nearest = int(distances.argmin())
            if distances[nearest] < best[k]:
                best[k], mesh[k], vertex[k] = distances[nearest], number, nearest
    return mesh, vertex
