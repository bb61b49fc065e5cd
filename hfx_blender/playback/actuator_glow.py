# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuators of the chosen devices as discs on the skin that glow with what they are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np
import numpy.typing as npt

from ..avatars import avatar_meshes
from ..engine.colouring import COLD, Colour
from ..engine.rendering.device import DeviceConfig
from ..engine.rendering.moment import MomentRenderer
from ..engine.samples import SampleRun
from ..errors import HfxError
from ..reading.live_scene import LiveScene
from .actuator_places import ActuatorPlaces, places_of
from .over_time import OverTime, devices_of
from .skin_now import Skins

F64 = npt.NDArray[np.float64]
F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

_CORNERS = 12
_ABOVE_SKIN_M = 0.004
_HALO = 2.6  # times a disc's radius, at full strength
_OFF = (0.06, 0.06, 0.07)
_RIM = 0.35  # of white in the rim, so that a disc is seen on any skin


@dataclass(frozen=True, eq=False)
class Discs:
    """What is drawn: triangles with a colour at each corner."""

    positions: F32  # (P, 3) world space, Blender's units
    colours: F32  # (P, 4)
    triangles: I32  # (F, 3)


@dataclass(eq=False)
class _Worn:
    """A device on a body."""

    device: DeviceConfig
    body: bpy.types.Object
    body_id: str
    places: ActuatorPlaces
    columns: npt.NDArray[np.int64]  # (A,) of the strengths
    neutral: F64  # (A,)
    reach: F64  # (A,) from neutral to full strength
    renderer: MomentRenderer


class ActuatorGlow:
    """The devices of one scene on its bodies."""

    def __init__(self, live: LiveScene, scene: bpy.types.Scene) -> None:
        self.faults: list[str] = []
        self._live = live
        self._worn: list[_Worn] = []
        for device in devices_of(scene, self.faults):
            for body, described in zip(live.objects.bodies, live.description.bodies, strict=True):
                try:
                    self._worn.append(_worn(live, device, body, described.id))
                except HfxError as error:
                    self.faults.append(str(error))
        bodies = [body for body in live.objects.bodies if any(w.body == body for w in self._worn)]
        self._wearers = [_Wearer(body, self._worn) for body in bodies]

    def strengths(
        self, runs: Sequence[SampleRun], recorded: OverTime | None, frame: float
    ) -> list[F64]:
        """How far each actuator of each device is from silence, (A,) in -1..1.

        What was recorded is taken where there is a record; else the moment is rendered.
        """
        index = None if recorded is None else recorded.index(frame)
        return [_share(worn, _values(worn, runs, recorded, index)) for worn in self._worn]

    def discs(
        self,
        strengths: Sequence[F64],
        palette: Mapping[str, Colour],
        unit_m: float,
        skins: Skins,
    ) -> Discs | None:
        """All actuators as they are to be drawn now; None where there are none."""
        drawn = []
        for wearer in self._wearers:
            found = wearer.places(self._live, skins)
            if found is None:
                continue
            centre, normal = found
            share = np.concatenate([strengths[k] for k in wearer.worn])
            radii, colours = wearer.look(share, palette, unit_m)
            above = centre + normal * (_ABOVE_SKIN_M / unit_m)
            at = _fans(above, normal, radii)
            drawn.append(
                Discs(
                    at.reshape(-1, 3),
                    colours.reshape(-1, 4),
                    _triangles(len(centre), radii.shape[1]),
                )
            )
        return _joined(drawn)


def _joined(drawn: Sequence[Discs]) -> Discs | None:
    if len(drawn) < 2:
        return drawn[0] if drawn else None
    firsts = np.cumsum([0, *(len(each.positions) for each in drawn)])
    return Discs(
        np.concatenate([each.positions for each in drawn]),
        np.concatenate([each.colours for each in drawn]),
        np.concatenate([e.triangles + int(k) for e, k in zip(drawn, firsts, strict=False)]),
    )


def _worn(live: LiveScene, device: DeviceConfig, body: bpy.types.Object, body_id: str) -> _Worn:
    counts = [len(each.type.controls) for each in device.actuators]
    strengths = [each.type.strength for each in device.actuators]
    neutral = np.array([each.neutral for each in strengths])
    return _Worn(
        device,
        body,
        body_id,
        places_of(body, device),
        np.cumsum([0, *counts])[:-1],
        neutral,
        np.array([max(e.highest - e.neutral, e.neutral - e.lowest, 1e-9) for e in strengths]),
        MomentRenderer(live.description, device, body_id=body_id),
    )


def _values(
    worn: _Worn, runs: Sequence[SampleRun], recorded: OverTime | None, index: int | None
) -> F64:
    if recorded is not None and index is not None:
        for device, raster in recorded.devices:
            if device.id == worn.device.id and raster.body_id == worn.body_id:
                found: F64 = raster.values[index, worn.columns]
                return found
    if not any(run.stream.body_id == worn.body_id and len(run) for run in runs):
        return worn.neutral
    return worn.renderer.values(runs)[worn.columns]


def _share(worn: _Worn, values: F64) -> F64:
    found: F64 = np.clip((values - worn.neutral) / worn.reach, -1.0, 1.0)
    return found


class _Wearer:
    """One body with all of the actuators that are on it."""

    def __init__(self, body: bpy.types.Object, worn: Sequence[_Worn]) -> None:
        self.body = body
        self.worn = [k for k, each in enumerate(worn) if each.body == body]
        places = [worn[k].places for k in self.worn]
        self._radius_m = np.concatenate([each.radius_m for each in places])
        self.modalities = [a.type.modality for k in self.worn for a in worn[k].device.actuators]
        self._is_thermal = np.array([name == "temperature" for name in self.modalities])
        self._palette: Mapping[str, Colour] | None = None
        self._share = np.zeros(0)
        self._look = np.zeros((0, 4), np.float32), np.zeros((0, 1, 4), np.float32)
        self._at_rest = np.concatenate([each.at_rest for each in places])
        self._centres, self._normals = np.zeros((2, *self._at_rest.shape))
        mesh = np.concatenate([each.mesh for each in places])
        vertex = np.concatenate([each.vertex for each in places])
        self._on = [
            (each, np.flatnonzero(mesh == number), vertex[mesh == number])
            for number, each in enumerate(avatar_meshes.meshes_of(body))
            if (mesh == number).any()
        ]
        self._free = sum(len(mine) for _, mine, _ in self._on) < len(mesh)  # some stand in the room

    def look(self, share: F64, palette: Mapping[str, Colour], unit_m: float) -> tuple[F32, F32]:
        """Radii and colours, see :func:`_look`; kept as long as the shares stay."""
        if self._palette is not palette or not np.array_equal(share, self._share):
            self._palette, self._share = palette, share
            colour = np.array([palette[name] for name in self.modalities])
            cold = self._is_thermal & (share < 0.0)
            colour[cold] = palette[COLD]
            self._look = _look(self._radius_m / unit_m, colour, np.abs(share))
        return self._look

    def places(self, live: LiveScene, skins: Skins) -> tuple[F64, F64] | None:
        """Centres and normals in the world, Blender's units; None where the skin is not shown."""
        graph = live.objects.layer.depsgraph
        if self._free:
            matrix = np.array(self.body.evaluated_get(graph).matrix_world, np.float64)
            self._centres[:] = self._at_rest @ matrix[:3, :3].T + matrix[:3, 3]
            self._normals[:] = -_unit(matrix[None, :3, 1])
        for mesh, mine, vertices in self._on:
            skin = skins.of(mesh, graph)
            if skin is None or skin.size <= vertices.max():
                return None
            self._centres[mine], self._normals[mine] = skin.at(vertices)
        return self._centres, self._normals


def _unit(vectors: F64) -> F64:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    found: F64 = vectors / np.maximum(lengths, 1e-12)
    return found


def _look(radius: F64, colour: F64, share: F64) -> tuple[F32, F32]:
    """A disc with a rim for each actuator, and around it a halo that fades out.

    Radii (A, R) of its rings, and colours (A, P, 4) of its corners.
    """
    seen = np.sqrt(share[:, None])  # as the skin's colours: the lower half shows, too
    inner = np.array(_OFF) * (1.0 - seen) + colour * seen + (1.0 - colour) * 0.45 * seen
    rim = np.clip(inner * (1.0 - _RIM) + _RIM, 0.0, 1.0)
    halo = radius * (1.0 + (_HALO - 1.0) * share)
    rings: tuple[tuple[F64, F64 | float], ...] = ((inner, 1.0), (rim, 1.0))
    radii = [radius * 0.8, radius]
    if share.any():
        rings += (colour, 0.75 * seen), (colour, 0.0)
        radii += [radius, halo]
    colours = np.ones((len(radius), 1 + len(rings) * _CORNERS, 4), np.float32)
    colours[:, 0, :3] = inner
    for k, (rgb, alpha) in enumerate(rings):
        part = slice(1 + k * _CORNERS, 1 + (k + 1) * _CORNERS)
        colours[:, part, :3] = rgb[:, None]
        colours[:, part, 3] = alpha
    return np.stack(radii, axis=1).astype(np.float32), colours


def _fans(centre: F64, normal: F64, radii: F32) -> F32:
    """The corners of discs and their rings, (A, P, 3)."""
    # Across is the normal times the world's Z, or its X where that is nearly the normal.
    x, y, z = normal.T
    nothing = np.zeros(len(centre))
    across = _unit(np.where(np.abs(z) < 0.9, (y, -x, nothing), (nothing, z, -y)).T)
    u, v, w = across.T
    along = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
    ring = _COS * across[:, None] + _SIN * along[:, None]  # (A, C, 3)
    found = np.empty((len(centre), 1 + radii.shape[1] * _CORNERS, 3), np.float32)
    found[:, 0] = centre
    rings = radii[:, :, None, None] * ring.astype(np.float32)[:, None]
    rings += centre.astype(np.float32)[:, None, None]
    found[:, 1:] = rings.reshape(len(centre), -1, 3)
    return found


@lru_cache(8)
def _triangles(count: int, rings: int) -> I32:
    """Of discs with two rings, or four of which two are a halo."""
    steps = np.arange(count, dtype=np.int32) * (1 + rings * _CORNERS)
    return (_one_fan(rings)[None] + steps[:, None, None]).reshape(-1, 3)


def _one_fan(rings: int) -> I32:
    found = []
    for k in range(_CORNERS):
        here, after = 1 + k, 1 + (k + 1) % _CORNERS
        found.append((0, here, after))
        for ring in range(0, rings, 2):  # the rim, and the halo
            a, b = here + ring * _CORNERS, after + ring * _CORNERS
            c, d = a + _CORNERS, b + _CORNERS
            found += [(a, c, b), (b, c, d)]
    return np.array(found, np.int32)


_ANGLES = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
_COS, _SIN = np.cos(_ANGLES)[None, :, None], np.sin(_ANGLES)[None, :, None]
