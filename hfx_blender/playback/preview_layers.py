# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preview shows: colours over avatars and glowing actuators, as the engine says, now."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from ..avatars import avatar_meshes, retargeting
from ..engine.body.model import PerceptualModel, load_model
from ..engine.colouring import PALETTES, Spread
from ..engine.samples import SampleRun
from ..errors import HfxError
from ..reading.live_scene import LiveScene
from .actuator_glow import ActuatorGlow, Discs
from .evaluation import evaluation
from .over_time import OverTime
from .skin_colours import SkinColours
from .skin_now import Skin, Skins, triangles_of

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]

_CLOSEST = 3  # perceptual vertices that colour a vertex of the avatar
_ABOVE_SKIN = 0.0015
"""How far over the skin colours are drawn, metres, so that the two do not flicker."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Colours over those N vertices of an avatar's mesh at which anything shows, or nearly."""

    vertices: I64  # (N,) of the mesh, ascending
    positions: F32  # (N, 3) world space, Blender's units
    normals: F32  # (N, 3) unit
    triangles: I32  # (F, 3) of the N; the same array as long as they are the same
    colours: F32  # (N, 4) straight alpha


class Preview:
    """What is felt in one scene, kept until something changes."""

    def __init__(self) -> None:
        self._scene: LiveScene | None = None
        self._glow: ActuatorGlow | None = None
        self._key: tuple[object, ...] = ()
        self._spreads: dict[tuple[str, str], Spread] = {}
        self._meshes: dict[str, _ColouredMesh] = {}
        self._skins = Skins()
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
        self._skins.touch()
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
        self._spreads, self._meshes = {}, {}
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
            return self._glow.discs(self._strengths, PALETTES[palette], unit_m, self._skins)
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
            samples = [sample for run in mine for sample in run]
            for mesh in avatar_meshes.meshes_of(body):
                skin = self._skins.of(mesh, live.objects.layer.depsgraph)
                if skin is None:
                    continue
                coloured = self._coloured_mesh(body, mesh, mine)
                vertices, colours = coloured.colours.of(samples, contact, PALETTES[palette])
                if len(vertices):
                    found.append(coloured.layer(skin, vertices, colours, live.objects.unit_m))
        return found

    def _coloured_mesh(
        self, body: bpy.types.Object, mesh: bpy.types.Object, runs: list[SampleRun]
    ) -> _ColouredMesh:
        models = tuple(sorted({run.stream.model_id for run in runs}))
        known = self._meshes.get(mesh.name_full)
        if known is None or not known.models.issuperset(models):
            models = tuple({*models, *(known.models if known else ())})
            spreads = {model: self._spread(body, mesh, model) for model in models}
            counts = {model: (spread, len(load_model(model))) for model, spread in spreads.items()}
            known = _ColouredMesh(mesh, SkinColours(counts), frozenset(models))
            self._meshes[mesh.name_full] = known
        return known

    def _spread(self, body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
        key = (mesh.name_full, model_id)
        if key not in self._spreads:
            self._spreads[key] = _spread(body, mesh, model_id)
        return self._spreads[key]


class _ColouredMesh:
    """One mesh, and which of its triangles were drawn last."""

    def __init__(
        self, mesh: bpy.types.Object, colours: SkinColours, models: frozenset[str]
    ) -> None:
        self.colours, self.models = colours, models
        self._triangles = triangles_of(mesh)
        self._is_shown = np.zeros(len(mesh.data.vertices), np.bool_)
        self._place = np.zeros(len(mesh.data.vertices), np.int32)  # among the drawn ones
        self._shown = np.zeros(0, np.int64)
        self._drawn = np.zeros(0, np.int64)
        self._indices = np.zeros((0, 3), np.int32)

    def layer(self, skin: Skin, shown: I64, colours: F64, unit_m: float) -> Layer:
        """The triangles at which anything shows."""
        if not np.array_equal(shown, self._shown):
            self._choose(shown)
        positions, normals = skin.at(self._drawn)
        positions += normals * np.float32(_ABOVE_SKIN / unit_m)
        all_colours = np.zeros((len(self._drawn), 4), np.float32)
        all_colours[self._place[shown]] = colours
        return Layer(self._drawn, positions, normals, self._indices, all_colours)

    def _choose(self, shown: I64) -> None:
        flags, self._shown = self._is_shown, shown
        flags[:] = False
        flags[shown] = True
        a, b, c = (flags.take(corner) for corner in self._triangles)
        chosen = self._triangles.compress(a | b | c, axis=1)
        flags[chosen] = True  # those around them, too
        self._drawn = np.flatnonzero(flags)
        self._place[self._drawn] = np.arange(len(self._drawn), dtype=np.int32)
        self._indices = np.ascontiguousarray(self._place[chosen].T)


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
