# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours that a preview lays over avatars: what the engine says is felt now."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from ..avatars import avatar_meshes, retargeting
from ..engine.body.model import load_model
from ..engine.colouring import PALETTES, Spread, felt_shares, overlay
from ..engine.samples import SampleRun
from ..errors import HfxError
from ..export import scene_tolerance
from ..reading.live_scene import LiveScene, signature_of

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

_CLOSEST = 3  # perceptual vertices that colour a vertex of the avatar
_ABOVE_SKIN = 0.0015
"""How far over the skin colours are drawn, metres, so that the two do not flicker."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Colours over one mesh of an avatar."""

    positions: F32  # (A, 3) world space, Blender's units
    triangles: I32  # (F, 3) those of which anything shows
    colours: F32  # (A, 4)


class Preview:
    """The colours of one scene, kept until something changes."""

    def __init__(self) -> None:
        self._scene: LiveScene | None = None
        self._key: tuple[object, ...] = ()
        self._spreads: dict[tuple[str, str], Spread] = {}
        self._layers: list[Layer] | None = None
        self.fault = ""

    def forget(self) -> None:
        """Work everything out anew: another file, or an undo."""
        self.__init__()

    def touch(self) -> None:
        """Something moved; colours are worked out when they are drawn next."""
        self._layers = None

    def describe(self, context: bpy.types.Context) -> None:
        """Find out what there is to feel, if that changed; never while Blender draws."""
        scene, layer = context.scene, context.view_layer
        key = (*signature_of(scene), layer.name, scene.hfx.tolerance)
        if key == self._key:
            return
        self._key, self._scene, self.fault = key, None, ""
        self.touch()
        try:
            self._scene = LiveScene(scene, layer, scene_tolerance(scene))
        except HfxError as error:
            self.fault = str(error)
        self._spreads = {}

    def layers(self, palette: str) -> list[Layer]:
        """What is to be drawn now."""
        if self._layers is None:
            self._layers = []
            if self._scene is not None:
                try:
                    self._layers = self._coloured(self._scene, palette)
                except (HfxError, ReferenceError) as error:
                    self.fault = str(error)
        return self._layers

    def _coloured(self, live: LiveScene, palette: str) -> list[Layer]:
        runs = live.runs()
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
        if not colours[:, 3].any():
            return []
        evaluated = mesh.evaluated_get(live.objects.layer.depsgraph)
        size = len(mesh.data.vertices)
        if len(evaluated.data.vertices) != size:  # subdivided: the cage is coloured
            evaluated = mesh
        shown = colours[:, 3] > 0.0
        corners = np.zeros(len(evaluated.data.loop_triangles) * 3, np.int32)
        evaluated.data.loop_triangles.foreach_get("vertices", corners)
        triangles = corners.reshape(-1, 3)
        return [
            Layer(
                _above(evaluated, size, live.objects.unit_m),
                np.ascontiguousarray(triangles[shown[triangles].any(axis=1)]),
                colours.astype(np.float32),
            )
        ]

    def _spread(self, body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
        key = (mesh.name, model_id)
        if key not in self._spreads:
            self._spreads[key] = _spread(body, mesh, model_id)
        return self._spreads[key]


def _above(evaluated: bpy.types.Object, size: int, unit_m: float) -> F32:
    """World positions of a mesh's vertices, a little over its skin."""
    positions, normals = np.zeros(size * 3, np.float32), np.zeros(size * 3, np.float32)
    evaluated.data.attributes["position"].data.foreach_get("vector", positions)
    evaluated.data.vertex_normals.foreach_get("vector", normals)
    matrix = np.array(evaluated.matrix_world, np.float64)
    world = positions.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    outward = normals.reshape(-1, 3) @ np.linalg.pinv(matrix[:3, :3])
    length = np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    return (world + outward / length * (_ABOVE_SKIN / unit_m)).astype(np.float32)


def _spread(body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
    """How a model's vertices colour a mesh's: by the nearest few, both at rest."""
    from mathutils.kdtree import KDTree

    model = retargeting.model_of(body, model_id)
    points, _ = avatar_meshes.rest_surface(mesh)
    to_rest = np.array(body.matrix_world.inverted_safe() @ mesh.matrix_world, np.float64)
    points = points @ to_rest[:3, :3].T + to_rest[:3, 3]
    tree = KDTree(len(model))
    for index, vertex in enumerate(model.vertices.tolist()):
        tree.insert(vertex, index)
    tree.balance()
    found = [tree.find_n(point, _CLOSEST) for point in points.tolist()]
    return Spread.of_neighbours(
        np.array([[index for _, index, _ in each] for each in found]),
        np.array([[distance for _, _, distance in each] for each in found]),
    )
