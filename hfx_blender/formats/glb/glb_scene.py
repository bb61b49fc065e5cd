# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene as glTF: bodies, haptic volumes as moving nodes, and draft MPEG triggers.

A haptic surface with a contact law is such a node, too; other surfaces are not in the scene.

Each volume is a trigger of the draft extension ``MPEG_interactivity`` (ISO/IEC 23090-14; Khronos
pull request 2503): a collision with the body plays perceptions of a companion HJIF file. The
extensions are used, not required: any reader shows bodies and moving nodes. A mesh with a contact
law has a material of the draft ``MPEG_haptic_material`` (pull request 2502): constant textures of
stiffness and friction, whose ``extras`` give the full scale that the draft does not define.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.active_rows import FARTHEST
from ...engine.arrays import F64, I32, I64
from ...engine.body.model import PerceptualModel
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.response_filters.controls import ContactLaw
from ...engine.scene import (
    AnimationBlock,
    EffectBlock,
    EffectDescription,
    HapticSurface,
    HapticVolume,
    SceneDescription,
    TimeBase,
)
from ...engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ...engine.volume.shape import Falloff, Shape
from ...files.atomic import atomic_file
from ...files.strict_json import clean
from ..pictures.png import encoded
from ..written import Written
from .glb import SUFFIX, TO_GLTF, Document, add_extensions, hjif_media, move, to_gltf
from .glb_bodies import BodyRecorder

_MATERIAL: Final = "MPEG_haptic_material"
_COLLISION, _ACTION_HAPTIC = 0, 7
_CAPSULE: Final = 3
_PRIMITIVES: Final[dict[type, tuple[int, dict[str, float]]]] = {
    Cuboid: (0, {"width": 2.0, "height": 2.0, "length": 2.0}),
    Cylinder: (2, {"radius": 1.0, "length": 2.0}),
    Sphere: (4, {"radius": 1.0}),
}
"""Number and size of the draft's primitives; a capsule has two ends instead of a centroid."""

_SHAPES: Final = {Cuboid: "cuboid", Sphere: "sphere", Cylinder: "cylinder", Capsule: "capsule"}
_ACTIVATE_ON, _PARALLEL, _PLAY = 2, 1, 0
_ALL_OF_THE_BODY: Final = 2**32 - 1
_RECORDED: Final = ("indices", "matrices", "values")


@dataclass(eq=False)
class _Volume:
    """Recorded motion of a volume; ``shape`` is None before the first active sample."""

    effect: EffectDescription
    shape: Shape | None = None
    indices: list[I64] = field(default_factory=list)
    matrices: list[F64] = field(default_factory=list)
    values: list[F64] = field(default_factory=list)  # (T, 1 + P) level and parameters
    changes_shape: bool = False


class VolumeRecorder:
    """Recorder of the motion of a scene's volumes and bodies, block by block."""

    def __init__(self, scene: SceneDescription) -> None:
        self._scene = scene
        self._bodies = BodyRecorder(scene)
        self._volumes = {
            k: _Volume(effect)
            for k, effect in enumerate(scene.effects)
            if isinstance(effect.area, HapticVolume)
            or (isinstance(effect.area, HapticSurface) and effect.area.law is not None)
        }

    def add(self, block: AnimationBlock) -> None:
        """Record the own active, finite samples of bodies and volumes; blocks in time order."""
        self._bodies.add(block)
        rows = block.own
        for k, volume in self._volumes.items():
            effect = block.effects[k]
            # A volume that is off in the whole block was not read.
            shapes = _shapes(volume.effect, effect)
            if effect.matrices is None or not shapes:
                continue
            finite = (np.abs(effect.matrices[rows]) <= FARTHEST).all(axis=(1, 2))
            finite &= np.isfinite(effect.parameters[rows]).all(axis=1)
            finite &= effect.levels[rows] > 0.0  # rows of inactive samples are undefined
            if not finite.any():
                continue
            volume.shape = volume.shape or shapes[0]
            volume.changes_shape |= len(shapes) > 1 or type(volume.shape) is not type(shapes[0])
            volume.indices.append(block.indices[rows][finite])
            volume.matrices.append(effect.matrices[rows][finite])
            values = np.column_stack([effect.levels[rows], effect.parameters[rows]])
            volume.values.append(values[finite])

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays of bodies and, by ``<effect number>.<name>``, of active volumes, for transfer."""
        arrays = self._bodies.arrays()
        for k, volume in self._volumes.items():
            if volume.shape is not None:
                for name in _RECORDED:
                    arrays[f"{k}.{name}"] = np.concatenate(getattr(volume, name))
                arrays[f"{k}.changes"] = np.array(volume.changes_shape)
                arrays[f"{k}.shape"] = np.array(type(volume.shape).__name__)
        return arrays

    def first_samples(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> list[int]:
        """Sorted distinct first active samples of the volumes in :meth:`arrays` of recorders. For
        each volume the first of ``parts``, in time order, with samples counts."""
        firsts = (
            next((int(part[f"{k}.indices"][0]) for part in parts if f"{k}.indices" in part), None)
            for k in self._volumes
        )
        return sorted({first for first in firsts if first is not None})

    def replace(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Replace the recording, except shapes, by :meth:`arrays` of recorders in time order."""
        self._bodies.replace(parts)
        # Shapes stay those of this process: parts hold only their names, for comparison.
        for k, volume in self._volumes.items():
            volume_parts = [part for part in parts if f"{k}.indices" in part]
            for name in _RECORDED:
                setattr(volume, name, [part[f"{k}.{name}"] for part in volume_parts])
            shapes = {str(part[f"{k}.shape"]) for part in volume_parts}
            volume.changes_shape = len(shapes) > 1 or any(
                part[f"{k}.changes"] for part in volume_parts
            )

    def write(
        self, models: Sequence[PerceptualModel], stem: Path, hjif_name: str | None = None
    ) -> Written:
        """Write ``stem.scene.glb`` with bodies, volumes and triggers.

        ``models`` are of the canonical body; each body gets all of them, fitted. ``hjif_name``:
        companion file with the perceptions of the triggers. Raises OutputError for an unwritable
        file; no partial file remains.
        """
        document = Document()
        triggers: list[dict[str, Any]] = []
        materials: list[dict[str, Any]] = []
        notes: list[str] = []
        roots, bodies = self._bodies.write(document, models, notes)
        nodes = []
        for volume in self._volumes.values():
            if volume.shape is None:
                notes.append(f"volume '{volume.effect.name}' is never active: not in the scene")
                continue
            nodes.append(self._add(document, volume, triggers, materials, bodies, notes))
        # Triggers refer to perceptions by modality, so they stay valid without a file.
        if triggers and hjif_name is None:
            notes.append("the glTF scene has no HJIF file, so its triggers play nothing")
        _add_extensions(document, triggers, materials, nodes, self._scene, hjif_name)
        shown = [*roots, *nodes]
        document.json["scenes"] = [{"nodes": shown} if shown else {}]  # glTF forbids empty lists
        document.json["scene"] = 0
        path = stem.with_name(f"{stem.name}.scene{SUFFIX}")
        with atomic_file(path) as file:
            file.write(document.encoded())
        return Written((path,), notes=tuple(notes))

    def _add(
        self,
        document: Document,
        volume: _Volume,
        triggers: list[dict[str, Any]],
        materials: list[dict[str, Any]],
        bodies: Sequence[int],
        notes: list[str],
    ) -> int:
        """Append a volume's node, its trigger (collision of ``bodies``), and the material of a mesh
        with a contact law; returns the node. A changed or sheared shape is noted in ``notes``."""
        assert volume.shape is not None
        indices, matrices = np.concatenate(volume.indices), np.concatenate(volume.matrices)
        placed = to_gltf(matrices)
        effect = volume.effect
        assert isinstance(effect.area, HapticVolume | HapticSurface)
        node: dict[str, Any] = {
            "name": clean(effect.name),
            "extras": _volume_extras(
                effect, volume.shape, matrices, np.concatenate(volume.values), self._scene.time
            ),
        }
        primitive = _primitive(volume.shape, placed[0])
        # The draft has no primitive of triangles: the node itself shows the mesh.
        if primitive is None:
            mesh: Any = volume.shape
            attributes = {"POSITION": document.accessor(np.asarray(mesh.vertices), is_vertex=True)}
            triangles = document.accessor(np.asarray(mesh.triangles).ravel(), is_index=True)
            item: dict[str, Any] = {
                "primitives": [{"attributes": attributes, "indices": triangles}]
            }
            if effect.area.law is not None:
                coordinates = np.full((len(mesh.vertices), 2), 0.5)
                attributes["TEXCOORD_0"] = document.accessor(coordinates, is_vertex=True)
                item["extensions"] = {_MATERIAL: {"hapticMaterialIndex": len(materials)}}
                materials.append(_haptic_material(document, effect.name, effect.area.law))
            node["mesh"] = document.append("meshes", item)
        times = self._scene.time.times_s(indices)
        times = times - self._scene.time.times_s(np.array([0]))[0]
        if move(document, node, times, placed).any():
            notes.append(f"volume '{effect.name}' is sheared, which glTF cannot animate")
        index = len(document.json["nodes"]) - 1
        if volume.changes_shape:
            notes.append(f"volume '{effect.name}' changes its shape; the first shape is written")
        # Any body touching the volume fires the trigger.
        trigger: dict[str, Any] = {"type": _COLLISION, "nodes": [*bodies, index]}
        if primitive is not None:
            trigger["primitives"] = [primitive]
        triggers.append(trigger)
        return index


@dataclass(frozen=True, eq=False)
class _Sheet:
    """Mesh of a haptic surface, which need not be closed."""

    vertices: F64  # (V, 3) object space
    triangles: I32  # (F, 3)

    @property
    def bounds(self) -> F64:
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def _shapes(effect: EffectDescription, block: EffectBlock) -> Sequence[Any]:
    """Shapes of an effect in a block, one mesh for each change of a surface; empty if not read."""
    if not isinstance(effect.area, HapticSurface) or block.vertices is None:
        return block.shapes
    return [_Sheet(vertices, effect.area.triangles) for vertices in block.vertices]


def _volume_extras(
    effect: EffectDescription, shape: Shape, matrices: F64, values: F64, time: TimeBase
) -> dict[str, Any]:
    """Extras of a volume's node, sufficient for a collider.
    ``docs/formats/scene-volume.schema.json`` is the schema. ``matrices`` (T, 4, 4): shape space to
    world at active samples; ``values`` (T, 1 + P): level and parameters at these samples."""
    assert isinstance(effect.area, HapticVolume | HapticSurface)
    falloff = getattr(effect.area, "falloff", Falloff())
    # Edge lengths in world space: columns of the matrix scale the extents of the shape.
    edges = np.linalg.norm(matrices[0, :3, :3], axis=0) * np.diff(shape.bounds, axis=0)[0]
    names = MODALITIES[effect.modality].parameter_names
    # A direction is a single vector in glTF axes instead of three ranges.
    parameters: dict[str, Any] = {
        name: _range(values[:, 1 + k])
        for k, name in enumerate(names)
        if not name.startswith("direction_")
    }
    if effect.modality == "wind":
        parameters["direction"] = (TO_GLTF @ values[0, 2:5]).round(6).tolist()
    if effect.modality == "temperature":
        parameters["neutral_c"] = neutral_temperature_c(effect.is_contact)
    return {
        "hfx_effect": clean(effect.id),
        "modality": effect.modality,
        "model": effect.model_id,
        "shape": _SHAPES.get(type(shape), "surface" if isinstance(shape, _Sheet) else "mesh"),
        "size_m": edges.round(6).tolist(),
        "level": _range(values[:, 0]),
        "parameters": parameters,
        "falloff": {
            "kind": "none" if falloff.is_flat else str(falloff.kind.value),
            "share": 0.0 if falloff.is_flat else falloff.share,
        },
        **({} if effect.area.law is None else {"contact_law": asdict(effect.area.law)}),
        "clips": [
            {
                "name": clean(clip.name),
                "start_s": _seconds(clip.frame_start, time),
                "end_s": _seconds(clip.frame_end, time),
            }
            for clip in effect.clips
        ],
    }


def _range(values: F64) -> dict[str, float]:
    """First, lowest and highest value of (T,), rounded to 6 decimals."""
    return {
        "first": round(float(values[0]), 6),
        "lowest": round(float(values.min()), 6),
        "highest": round(float(values.max()), 6),
    }


def _seconds(frame: float, time: TimeBase) -> float:
    """Time of a frame, s from the first exported frame, rounded to 1 us."""
    return round((frame - time.frame_first) / float(time.fps), 6)


def _primitive(shape: Shape, matrix: F64) -> dict[str, Any] | None:
    """Trigger primitive of MPEG_interactivity (a draft extension of glTF) as JSON: a unit shape
    (radius 1, edges 2) and its matrix (4, 4) to the world, which has the true size. None for a
    mesh, which the extension cannot hold."""
    placed = {"transformationMatrix": matrix.T.ravel().tolist()}
    if isinstance(shape, Capsule):
        ends = {
            "baseCentroid": [0.0, 0.0, -shape.half_segment],
            "topCentroid": [0.0, 0.0, shape.half_segment],
        }
        return {"type": _CAPSULE, "radius": 1.0, **ends, **placed}
    if type(shape) not in _PRIMITIVES:
        return None
    kind, size = _PRIMITIVES[type(shape)]
    return {"type": kind, **size, "centroid": [0.0, 0.0, 0.0], **placed}


def _haptic_material(document: Document, name: str, law: ContactLaw) -> dict[str, Any]:
    """Material of MPEG_haptic_material: white textures of one texel, times the full scale."""
    texture = document.texture(encoded(np.full((1, 1), 255, np.uint8)))
    item = {"texture": {"index": texture}, "type": "Low_Resolution"}
    stiffness = {"full_scale": law.stiffness_n_m, "unit": "N/m"}
    friction = {"full_scale": law.friction, "unit": "1"}
    both = {"stiffness": stiffness, "friction": friction}
    return {"name": clean(name)} | {k: [item | {"extras": v}] for k, v in both.items()}


def _add_extensions(
    document: Document,
    triggers: list[dict[str, Any]],
    materials: list[dict[str, Any]],
    nodes: Sequence[int],
    scene: SceneDescription,
    hjif_name: str | None,
) -> None:
    """Add the draft extensions: an action and a behaviour per trigger; nothing without triggers.
    ``nodes`` are the volumes' nodes in the order of ``triggers``. Media need ``hjif_name``."""
    if not triggers:
        return
    modalities = {clean(effect.id): effect.modality for effect in scene.effects}
    actions, behaviors = [], []
    # Trigger k belongs to node k: a behaviour joins the trigger with an action at this node, and
    # the action plays the perceptions of the effect's modality.
    for k, node in enumerate(nodes):
        effect_id = document.json["nodes"][node]["extras"]["hfx_effect"]
        media = {
            "mediaIndex": 0,
            "perceptionIndices": [],  # all perceptions of this modality
            "hapticModality": [MODALITIES[modalities[effect_id]].gltf],
            "hapticControl": _PLAY,
            "loop": False,
        }
        actions.append(
            {
                "type": _ACTION_HAPTIC,
                "hapticActionNodes": [
                    {
                        "node": node,
                        "actionLocation": _ALL_OF_THE_BODY,
                        "useCollider": True,
                        "hapticActionMedias": [media],
                    }
                ],
            }
        )
        behaviors.append(
            {
                "triggers": [k],
                "actions": [k],
                "triggersCombinationControl": "#1",
                "triggersActivationControl": _ACTIVATE_ON,
                "actionsControl": _PARALLEL,
            }
        )
    extensions: dict[str, Any] = {
        "MPEG_interactivity": {"triggers": triggers, "actions": actions, "behaviors": behaviors}
    }
    if materials:
        extensions[_MATERIAL] = {"materials": materials}
    if hjif_name is not None:
        extensions["MPEG_media"] = hjif_media(hjif_name)
    add_extensions(document, extensions)
