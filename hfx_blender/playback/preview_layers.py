# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preview shows: colours over avatars and glowing actuators, as the engine says, now."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from ..avatars import avatar_meshes, retargeting
from ..engine.body.model import PerceptualModel, load_model
from ..engine.colouring import PALETTES, Spread, felt_shares, overlay
from ..engine.samples import SampleRun
from ..errors import HfxError
from ..reading.live_scene import LiveScene
from .actuator_glow import ActuatorGlow, Discs
from .evaluation import evaluation
from .over_time import OverTime

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

_CLOSEST = 3  # perceptual vertices that colour a vertex of the avatar
_ABOVE_SKIN = 0.0015
"""How far over the skin colours are drawn, metres, so that the two do not flicker."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Colours over one mesh of an avatar."""

    positions: F32  # (A, 3) world space, Blender's units
    normals: F32  # (A, 3) unit
    triangles: I32  # (F, 3) those of which anything shows
    colours: F32  # (A, 4)


class Preview:
    """What is felt in one scene, kept until something changes."""

    def __init__(self) -> None:
        self._scene: LiveScene | None = None
        self._glow: ActuatorGlow | None = None
        self._key: tuple[object, ...] = ()
        self._spreads: dict[tuple[str, str], Spread] = {}
        self._triangles: dict[str, I32] = {}
        self._runs: list[SampleRun] | None = None
        self._layers: list[Layer] | None = None
        self._strengths: list[F64] | None = None
        self.fault = ""

    def forget(self) -> None:
        """Work everything out anew: another file, or an undo."""
        self.__init__()  # type: ignore[misc]
        evaluation.forget()

    def touch(self) -> None:
        """Something moved; all is worked out when it is drawn next."""
        self._runs = self._layers = self._strengths = None
        evaluation.touch()

    def describe(self, context: bpy.types.Context) -> None:
        """Find out what there is to feel, if that changed; never while Blender draws."""
        scene = context.scene
        devices = tuple(device.name for device in scene.hfx.devices)
        evaluation.describe(context)
        key = (evaluation.generation, devices)
        if key == self._key:
            return
        self._key, self._scene, self._glow = key, evaluation.scene, None
        self.fault = evaluation.fault
        self._runs = self._layers = self._strengths = None
        self._spreads, self._triangles = {}, {}
        try:
            if self._scene is not None and devices:
                self._glow = ActuatorGlow(self._scene, scene)
                self.fault = "; ".join(self._glow.faults)
        except HfxError as error:
            self.fault = str(error)

    def layers(
        self, palette: str, recorded: OverTime | None = None, frame: float = 0.0
    ) -> list[Layer]:
        """Colours to be drawn now.

        Parameters
        ----------
        palette : str
            Key of ``colouring.PALETTES``.
        recorded : OverTime, optional
            A record that still holds: what is felt at ``frame`` is taken from it.
        frame : float
            The scene's present frame.
        """
        if self._layers is None:
            self._layers = []
            if self._scene is not None:
                try:
                    runs = self._felt(recorded, frame)
                    self._layers = self._coloured(self._scene, runs, palette)
                except (HfxError, ReferenceError) as error:
                    self.fault = str(error)
        return self._layers

    def discs(
        self, palette: str, recorded: OverTime | None = None, frame: float = 0.0
    ) -> Discs | None:
        """Actuators to be drawn now; parameters as for :meth:`layers`."""
        if self._scene is None or self._glow is None:
            return None
        try:
            if self._strengths is None:
                runs = () if recorded is not None else self._felt(None, frame)
                self._strengths = self._glow.strengths(runs, recorded, frame)
            unit_m = self._scene.objects.unit_m
            return self._glow.discs(self._strengths, PALETTES[palette], unit_m)
        except (HfxError, ReferenceError) as error:
            self.fault, self._glow = str(error), None
            return None

    def _felt(self, recorded: OverTime | None, frame: float) -> list[SampleRun]:
        if self._runs is None:
            assert self._scene is not None
            known = None if recorded is None else recorded.runs(frame)
            if known is None:  # live devices may have described another scene just now
                known = evaluation.runs() if evaluation.scene is self._scene else []
            self._runs = known
        return self._runs

    def _coloured(self, live: LiveScene, runs: list[SampleRun], palette: str) -> list[Layer]:
        found = []
        contact = frozenset(e.id for e in live.description.effects if e.is_contact)
        for body, described in zip(live.objects.bodies, live.description.bodies, strict=True):
            mine = [run for run in runs if run.stream.body_id == described.id]
            if not mine:
                continue
            for mesh in avatar_meshes.meshes_of(body):
                if mesh.visible_get() and mesh.mode == "OBJECT":
                    found += self._layer(live, body, mesh, mine, contact, palette)
        return found

    def _layer(
        self,
        live: LiveScene,
        body: bpy.types.Object,
        mesh: bpy.types.Object,
        runs: list[SampleRun],
        contact: frozenset[str],
        palette: str,
    ) -> list[Layer]:
        models = {run.stream.model_id for run in runs}
        spreads = {model: self._spread(body, mesh, model) for model in models}
        counts = {model: len(load_model(model)) for model in models}
        samples = [sample for run in runs for sample in run]
        colours = overlay(felt_shares(samples, spreads, counts, contact), PALETTES[palette])
        shown = colours[:, 3] > 0.0
        if not shown.any():
            return []
        evaluated = mesh.evaluated_get(live.objects.layer.depsgraph)
        size = len(mesh.data.vertices)
        if len(evaluated.data.vertices) != size:  # subdivided: the cage is coloured
            evaluated = mesh
        triangles = self._triangles_of(mesh, evaluated)
        positions, normals = _above(evaluated, size, live.objects.unit_m)
        chosen = shown[triangles[0]] | shown[triangles[1]] | shown[triangles[2]]
        drawn = np.ascontiguousarray(triangles[:, chosen].T)
        return [Layer(positions, normals, drawn, colours.astype(np.float32))]

    def _triangles_of(self, mesh: bpy.types.Object, evaluated: bpy.types.Object) -> I32:
        """A mesh's triangles (3, F); they stay while only its vertices move."""
        known = self._triangles.get(mesh.name)
        if known is not None and known.shape[1] == len(evaluated.data.loop_triangles):
            return known
        corners = np.zeros(len(evaluated.data.loop_triangles) * 3, np.int32)
        evaluated.data.loop_triangles.foreach_get("vertices", corners)
        found = self._triangles[mesh.name] = np.ascontiguousarray(corners.reshape(-1, 3).T)
        return found

    def _spread(self, body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
        key = (mesh.name, model_id)
        if key not in self._spreads:
            self._spreads[key] = _spread(body, mesh, model_id)
        return self._spreads[key]


def _above(evaluated: bpy.types.Object, size: int, unit_m: float) -> tuple[F32, F32]:
    """World positions of a mesh's vertices, a little over its skin, and their normals."""
    positions, normals = np.zeros(size * 3, np.float32), np.zeros(size * 3, np.float32)
    evaluated.data.attributes["position"].data.foreach_get("vector", positions)
    evaluated.data.vertex_normals.foreach_get("vector", normals)
    matrix = np.array(evaluated.matrix_world, np.float32)
    world = positions.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    inverse = np.array(evaluated.matrix_world.to_3x3().inverted_safe(), np.float32)
    outward = normals.reshape(-1, 3) @ inverse
    outward /= np.maximum(np.sqrt(np.einsum("ij,ij->i", outward, outward)), 1e-12)[:, None]
    return world + outward * np.float32(_ABOVE_SKIN / unit_m), outward


def _spread(body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
    """How a model's vertices colour a mesh's, both at rest."""
    points, _ = avatar_meshes.rest_surface(mesh)
    to_rest = np.array(body.matrix_world.inverted_safe() @ mesh.matrix_world, np.float64)
    return spread_between(
        points @ to_rest[:3, :3].T + to_rest[:3, 3], retargeting.model_of(body, model_id)
    )


def spread_between(points: F64, model: PerceptualModel) -> Spread:
    """How a model's vertices colour points (A, 3) in its space: by the nearest few."""
    from mathutils.kdtree import KDTree

    tree = KDTree(len(model))
    for index, vertex in enumerate(model.vertices.tolist()):
        tree.insert(vertex, index)
    tree.balance()
    found = [tree.find_n(point, _CLOSEST) for point in points.tolist()]
    return Spread.of_neighbours(
        np.array([[index for _, index, _ in each] for each in found]),
        np.array([[distance for _, _, distance in each] for each in found]),
    )
