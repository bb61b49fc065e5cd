# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of the preview: colours over avatars and glowing actuators, for the current samples."""

from collections.abc import Sequence

import bpy
import numpy as np

from ...avatars import avatar_meshes, stored_fits
from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel, load_model
from ...engine.colouring import PALETTES, Colour, Spread
from ...engine.samples import Sample, SampleRun
from ...errors import HfxError
from ...reading.live_scene import LiveScene
from ..evaluation import evaluation
from ..timeline.timeline_record import TimelineRecord
from .actuator_glow import ActuatorGlow, Discs
from .skin_colours import ColouredMesh, DisplayedSkins, Layer, Shown

MOST_BYTES = 96_000_000
"""Memory limit of the cache, bytes; frames beyond the limit are computed when drawn."""

Meshes = Sequence[tuple[ColouredMesh, Shown]]
"""Coloured parts of all displayed meshes at a time; empty without a visible colour."""


class PreviewFrameCache:
    """Cache of coloured mesh parts by sample index of a record, for a palette."""

    def __init__(self) -> None:
        self._record: TimelineRecord | None = None
        self._colours: tuple[Colour, ...] = ()  # users may edit their palette
        self._meshes: dict[int, Meshes] = {}  # by sample index of the record
        self._bytes = 0
        self._searched_count = 0  # frames of the range that `missing` has searched

    def forget(self) -> None:
        """Empty the cache, for another file or edited meshes."""
        self.__init__()  # type: ignore[misc]

    def at(self, recorded: TimelineRecord, palette: str, index: int) -> Meshes | None:
        """Mesh parts at sample ``index`` of a record; None if not cached.

        Another record or other colours than in the last call empty the cache.
        """
        colours = tuple(PALETTES[palette].values())
        if self._record is not recorded or self._colours != colours:
            self.forget()
            self._record, self._colours = recorded, colours
        return self._meshes.get(index)

    def keep(self, index: int, meshes: Meshes) -> None:
        """Store mesh parts under a sample index of the record last passed to :meth:`at`.

        No effect while :attr:`is_full`.
        """
        if self.is_full:
            return
        self._meshes[index] = meshes
        self._bytes += sum(shown.nbytes for _, shown in meshes)

    @property
    def is_full(self) -> bool:
        """Test for more than :data:`MOST_BYTES` of cached arrays."""
        return self._bytes > MOST_BYTES

    def missing(self, recorded: TimelineRecord, palette: str, first: int, last: int) -> int | None:
        """Sample index of the next uncached frame of ``first..last``, both inclusive.

        Each frame is searched once for a record and palette. None at the end, or when full.
        """
        self.at(recorded, palette, 0)  # empties the cache of another record
        while first + self._searched_count <= last and not self.is_full:
            index = recorded.index(first + self._searched_count)
            self._searched_count += 1
            if index is not None and index not in self._meshes:
                return index
        return None


_CLOSEST = 3  # perceptual vertices that colour a vertex of the avatar


class Preview:
    """Colours and actuators of a scene, cached until a change."""

    def __init__(self) -> None:
        self._scene: LiveScene | None = None
        self._glow: ActuatorGlow | None = None
        self.key: tuple[object, ...] = ()  # changes with each description
        self._spreads: dict[tuple[str, str], Spread] = {}
        self._meshes: dict[str, ColouredMesh] = {}
        self._frames = PreviewFrameCache()
        self._skins = DisplayedSkins()
        self._contact: frozenset[str] = frozenset()
        self._layers: list[Layer] | None = None
        self._discs: list[Discs] | None = None
        self._colours: tuple[object, ...] = ()  # palette of the cached layers
        self.fault = ""
        self.notes: list[str] = []  # differences of the glow from the real output

    @property
    def is_slow(self) -> bool:
        """Test for haptic volumes evaluated without the compiled library."""
        return self._scene is not None and bool(self._scene.engine.notes)

    def forget(self) -> None:
        """Discard everything, and the shared evaluation: another file, or an undo."""
        self.__init__()  # type: ignore[misc]
        evaluation.forget()

    def invalidate(self) -> None:
        """Discard colours, discs, skins and samples; keep the description."""
        self._layers = self._discs = None
        self._skins.invalidate()
        evaluation.invalidate()

    def describe(self, context: bpy.types.Context) -> None:
        """Describe the scene after a change of effects, bodies, devices or tolerance.

        Discards all cached colours then; otherwise no effect. Errors become :attr:`fault`. Never
        call this while Blender draws.
        """
        scene = context.scene
        devices = tuple((device.name, device.scheme) for device in scene.hfx.devices)
        evaluation.describe(context)
        key = (evaluation.generation, devices)
        if key == self.key:
            return
        self.key, self._scene, self._glow = key, evaluation.scene, None
        self.fault, self.notes = evaluation.fault, []
        self._layers = self._discs = None
        # Bodies, meshes and models may differ from the last description.
        self._spreads, self._meshes = {}, {}
        self._frames.forget()
        # Contacts of warmth are coloured by another neutral temperature.
        described = () if self._scene is None else self._scene.description.effects
        self._contact = frozenset(effect.id for effect in described if effect.is_contact)
        try:
            if self._scene is not None and devices:
                self._glow = ActuatorGlow(self._scene, scene)
                self.fault, self.notes = self._glow.fault, self._glow.notes
        except HfxError as error:
            self.fault = str(error)

    def layers(
        self, palette: str, recorded: TimelineRecord | None = None, frame: float = 0.0
    ) -> list[Layer]:
        """Colour layers of the current frame; empty without visible colours, and after an error,
        which is in :attr:`fault`.

        ``palette``: key of ``colouring.PALETTES``. ``recorded``: valid record; its samples at
        ``frame``, the scene's current frame, are used instead of an evaluation.
        """
        self._take_colours(palette)
        if self._layers is None:
            self._layers = []
            if self._scene is not None:
                try:
                    self._layers = self._laid_over(self._scene, palette, recorded, frame)
                except ReferenceError:
                    pass  # an object was removed: the scene is described again after the drawing
                except HfxError as error:
                    self.fault = str(error)
        return self._layers

    def prepare(self, palette: str, recorded: TimelineRecord, first: int, last: int) -> bool:
        """Cache the next missing frame of ``first..last`` (inclusive) of a record.

        Returns False if all are cached or the cache is full, after an error, and without a
        description.
        """
        index = self._frames.missing(recorded, palette, first, last)
        if self._scene is None or index is None:
            return False
        try:
            self._recorded(self._scene, palette, recorded, index)
        except (HfxError, ReferenceError):  # drawing reports the error
            return False
        return True

    def discs(
        self, palette: str, recorded: TimelineRecord | None = None, frame: float = 0.0
    ) -> list[Discs]:
        """Discs of actuators at the current frame; parameters as for :meth:`layers`.

        Empty without devices, and after an error, which stops the glow until the next description.
        """
        self._take_colours(palette)
        if self._scene is None or self._glow is None:
            return []
        try:
            if self._discs is None:
                index = None if recorded is None else recorded.index(frame)
                if recorded is None or index is None:
                    strengths = self._glow.now(self._runs(self._scene))
                    self.fault = self._glow.fault or self.fault
                else:
                    strengths = self._glow.recorded(recorded, index)
                unit_m = self._scene.objects.unit_m
                self._discs = self._glow.discs(strengths, PALETTES[palette], unit_m, self._skins)
            return self._discs
        except ReferenceError:  # as in `layers`
            return []
        except HfxError as error:
            self.fault, self._glow = str(error), None
            return []

    def _take_colours(self, palette: str) -> None:
        """Discard colours after a change of the palette, or of its user-defined colours."""
        colours = tuple(PALETTES[palette].items())
        if colours != self._colours:
            self._colours, self._layers, self._discs = colours, None, None

    def _runs(self, live: LiveScene) -> list[SampleRun]:
        # Live devices may have described another scene just now.
        return evaluation.runs() if evaluation.scene is live else []

    def _laid_over(
        self, live: LiveScene, palette: str, recorded: TimelineRecord | None, frame: float
    ) -> list[Layer]:
        """Colour layers on the posed skins, of a record at ``frame`` or, beyond it, of the open
        scene; meshes edited since the description are left out."""
        # Frames outside of the record, and samples beyond its memory limit, are evaluated.
        index = None if recorded is None else recorded.index(frame)
        shown = None
        if recorded is not None and index is not None:
            shown = self._recorded(live, palette, recorded, index)
        if shown is None:
            shown = self._shown(live, palette, self._runs(live))
        layers = []
        for coloured, part in shown:
            # Skip meshes edited since the description: their vertices have other numbers.
            skin = self._skins.of(coloured.mesh, live.objects.layer.depsgraph)
            if skin is not None and skin.size == coloured.size:
                layers.append(coloured.layer(skin, part, live.objects.unit_m))
        return layers

    def _recorded(
        self, live: LiveScene, palette: str, recorded: TimelineRecord, index: int
    ) -> Meshes | None:
        """Mesh parts at sample ``index`` of a record, cached; None if the record has no samples
        there, beyond its memory limit."""
        known = self._frames.at(recorded, palette, index)
        runs = recorded.runs(index) if known is None else None
        if runs is not None:
            known = self._shown(live, palette, runs)
            self._frames.keep(index, known)
        return known

    def _shown(self, live: LiveScene, palette: str, runs: list[SampleRun]) -> Meshes:
        """Coloured parts of the visible avatar meshes for samples; meshes without colour are left
        out."""
        samples = [sample for run in runs for sample in run]
        visible = []
        for body, described in zip(live.objects.bodies, live.description.bodies, strict=True):
            mine = [sample for sample in samples if sample.stream.body_id == described.id]
            for mesh in avatar_meshes.meshes_of(body) if mine else ():
                if mesh.visible_get():
                    coloured = self._coloured_mesh(body, mesh, mine)
                    shown = coloured.shown(mine, self._contact, PALETTES[palette])
                    visible += [] if shown is None else [(coloured, shown)]
        return visible

    def _coloured_mesh(
        self, body: bpy.types.Object, mesh: bpy.types.Object, samples: list[Sample]
    ) -> ColouredMesh:
        """Cached mesh with interpolations from at least the models of ``samples``; built again for
        further models, and after an edit of the mesh that changes its number of vertices."""
        models = {sample.stream.model_id for sample in samples}
        known = self._meshes.get(mesh.name_full)
        if known is not None and known.size != len(mesh.data.vertices):  # the mesh was edited
            known = None
            self._spreads = {k: s for k, s in self._spreads.items() if k[0] != mesh.name_full}
        # Rebuild for a new model, with the models so far: alternating modalities in successive
        # frames would otherwise rebuild the mesh in each frame.
        if known is None or not known.models.issuperset(models):
            models |= known.models if known else set()
            spreads = {model: self._spread(body, mesh, model) for model in models}
            counts = {model: (spread, len(load_model(model))) for model, spread in spreads.items()}
            known = ColouredMesh(mesh, counts)
            self._meshes[mesh.name_full] = known
        return known

    def _spread(self, body: bpy.types.Object, mesh: bpy.types.Object, model_id: str) -> Spread:
        """Interpolation from a model's vertices to a mesh's, both at rest; cached."""
        key = (mesh.name_full, model_id)
        if key not in self._spreads:
            points, _ = avatar_meshes.rest_surface(body, mesh, stored_fits.shape_of(body, mesh))
            self._spreads[key] = spread_between(points, stored_fits.model_of(body, model_id))
        return self._spreads[key]


def spread_between(points: F64, model: PerceptualModel) -> Spread:
    """Interpolation from a model's vertices to points (A, 3) in model space, by the nearest few
    vertices."""
    from mathutils.kdtree import KDTree

    # mathutils' tree needs no scipy, which the small zip of the extension lacks.
    tree = KDTree(len(model))
    for index, vertex in enumerate(model.vertices.tolist()):
        tree.insert(vertex, index)
    tree.balance()
    nearest = [tree.find_n(point, _CLOSEST) for point in points.tolist()]
    return Spread.of_neighbours(
        np.array([[index for _, index, _ in neighbours] for neighbours in nearest]),
        np.array([[distance for _, _, distance in neighbours] for neighbours in nearest]),
    )
