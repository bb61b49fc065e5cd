# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene's haptic volumes as glTF: nodes that move, and draft MPEG triggers.

Each volume is a trigger of the draft extension ``MPEG_interactivity`` (ISO/IEC 23090-14; Khronos
pull request 2503): when the body collides with it, the perceptions of an HJIF file beside it
are played. The extensions are used, never required: any reader sees bodies and moving nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..atomic_files import atomic_file
from ..engine.arrays import F64, I64
from ..engine.body.model import PerceptualModel
from ..engine.scene import AnimationBlock, EffectDescription, HapticVolume, SceneDescription
from ..engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..engine.volume.shape import Shape
from .checking import clean
from .glb import SUFFIX, TO_GLTF, Document, add_model
from .written import Written

_COLLISION, _ACTION_HAPTIC = 0, 7
_CUBOID, _CYLINDER, _CAPSULE, _SPHEROID = 0, 2, 3, 4
_ACTIVATE_ON, _PARALLEL, _PLAY = 2, 1, 0
_ALL_OF_THE_BODY: Final = 2**32 - 1
_MODALITIES: Final = {"temperature": 3, "vibration": 4, "pressure": 5, "wind": 5}  # 5: custom


@dataclass(eq=False)
class _Volume:
    """Recorded motion of one volume."""

    effect: EffectDescription
    shape: Shape | None = None
    indices: list[I64] = field(default_factory=list)
    matrices: list[F64] = field(default_factory=list)
    changes_shape: bool = False


class VolumeRecorder:
    """Recorder of the motion of a scene's volumes, block by block.

    Parameters
    ----------
    scene : SceneDescription
    """

    def __init__(self, scene: SceneDescription) -> None:
        self._scene = scene
        self._volumes = {
            k: _Volume(effect)
            for k, effect in enumerate(scene.effects)
            if isinstance(effect.area, HapticVolume)
        }

    def add(self, block: AnimationBlock) -> None:
        """Take the next block, in the order of time."""
        rows = block.own
        for k, volume in self._volumes.items():
            effect = block.effects[k]
            if effect.matrices is None or not effect.shapes:
                continue
            finite = np.isfinite(effect.matrices[rows]).all(axis=(1, 2))
            finite &= effect.levels[rows] > 0.0  # other rows may hold anything
            if not finite.any():
                continue
            shape = effect.shapes[0]
            volume.changes_shape |= len(effect.shapes) > 1
            volume.changes_shape |= volume.shape is not None and type(volume.shape) is not type(
                shape
            )
            volume.shape = volume.shape or shape
            volume.indices.append(block.indices[rows][finite])
            volume.matrices.append(effect.matrices[rows][finite])

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Motion of the volumes, as arrays that one process can hand on to another."""
        found: dict[str, npt.NDArray[Any]] = {}
        for k, volume in self._volumes.items():
            if volume.shape is not None:
                found[f"{k}.indices"] = np.concatenate(volume.indices)
                found[f"{k}.matrices"] = np.concatenate(volume.matrices)
                found[f"{k}.changes"] = np.array(volume.changes_shape)
                found[f"{k}.shape"] = np.array(type(volume.shape).__name__)
        return found

    def first_samples(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> list[int]:
        """The first sample of each volume in :meth:`arrays` of others, in the order of time."""
        firsts = (
            next((int(part[f"{k}.indices"][0]) for part in parts if f"{k}.indices" in part), None)
            for k in self._volumes
        )
        return sorted({first for first in firsts if first is not None})

    def replace(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Replace the recorded motion by that of others, given in the order of time; only the
        shapes are kept.
        """
        for k, volume in self._volumes.items():
            mine = [part for part in parts if f"{k}.indices" in part]
            volume.indices = [part[f"{k}.indices"] for part in mine]
            volume.matrices = [part[f"{k}.matrices"] for part in mine]
            shapes = {str(part[f"{k}.shape"]) for part in mine}
            volume.changes_shape = len(shapes) > 1 or any(part[f"{k}.changes"] for part in mine)

    def write(
        self, models: Sequence[PerceptualModel], stem: Path, hjif_name: str | None = None
    ) -> Written:
        """Write ``stem.scene.glb``.

        Parameters
        ----------
        models : sequence of PerceptualModel
            Stand in their rest pose, as what collides.
        stem : Path
        hjif_name : str, optional
            File beside it whose perceptions the triggers play.

        Raises
        ------
        OutputError
            The file cannot be written; nothing is left of it then.
        """
        document = Document()
        bodies = [
            document.append("nodes", {"name": clean(each.id), "mesh": add_model(document, each)})
            for each in models
        ]
        triggers: list[dict[str, Any]] = []
        notes: list[str] = []
        nodes = []
        for volume in self._volumes.values():
            if volume.shape is None:
                notes.append(f"volume '{volume.effect.name}' is never active: not in the scene")
                continue
            nodes.append(self._add(document, volume, triggers, bodies, notes))
        if triggers and hjif_name is None:
            notes.append("no HJIF file is beside the glTF scene: its triggers play nothing")
        _add_interactivity(document, triggers, nodes, self._scene, hjif_name)
        document.json["scenes"] = [{"nodes": [*bodies, *nodes]}]
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
        bodies: Sequence[int],
        notes: list[str],
    ) -> int:
        assert volume.shape is not None
        indices, matrices = np.concatenate(volume.indices), np.concatenate(volume.matrices)
        placed = _to_gltf(matrices)
        moves = bool((placed != placed[0]).any())
        effect = volume.effect
        node: dict[str, Any] = {
            "name": clean(effect.name),
            "extras": {
                "hfx_effect": clean(effect.id),
                "modality": effect.modality,
                "model": effect.model_id,
                "clips": [clean(clip.name) for clip in effect.clips],
            },
        }
        primitive = _primitive(volume.shape, placed[0])
        if primitive is None:
            node["mesh"] = _add_mesh(document, volume.shape)
        translations, rotations, scales, is_sheared = _decomposed(placed)
        if moves and is_sheared.any():
            notes.append(f"volume '{effect.name}' is sheared, which a moving node cannot be")
        if moves:
            node |= {
                "translation": translations[0].tolist(),
                "rotation": rotations[0].tolist(),
                "scale": scales[0].tolist(),
            }
        else:
            node["matrix"] = placed[0].T.ravel().tolist()  # column by column
        index = document.append("nodes", node)
        if moves:
            times = self._scene.time.times_s(indices)
            _animate(
                document,
                index,
                times - self._scene.time.times_s(np.array([0]))[0],
                {"translation": translations, "rotation": rotations, "scale": scales},
            )
        if volume.changes_shape:
            notes.append(f"volume '{effect.name}' changes its shape; the first one is written")
        trigger: dict[str, Any] = {"type": _COLLISION, "nodes": [*bodies, index]}
        if primitive is not None:
            trigger["primitives"] = [primitive]
        triggers.append(trigger)
        return index


def _to_gltf(matrices: F64) -> F64:
    """Shape space to glTF's world, (T, 4, 4)."""
    turn = np.eye(4)
    turn[:3, :3] = TO_GLTF
    return np.asarray(turn @ matrices)


def _primitive(shape: Shape, matrix: F64) -> dict[str, Any] | None:
    """A shape as a draft primitive; its axes are width x, height y, length z. None: a mesh."""
    placed = {"transformationMatrix": matrix.T.ravel().tolist()}
    centre = [0.0, 0.0, 0.0]
    if isinstance(shape, Cuboid):
        size = {"width": 2.0, "height": 2.0, "length": 2.0}
        return {"type": _CUBOID, **size, "centroid": centre, **placed}
    if isinstance(shape, Sphere):
        return {"type": _SPHEROID, "radius": 1.0, "centroid": centre, **placed}
    if isinstance(shape, Cylinder):
        return {"type": _CYLINDER, "radius": 1.0, "length": 2.0, "centroid": centre, **placed}
    if isinstance(shape, Capsule):
        ends = {
            "baseCentroid": [0.0, 0.0, -shape.half_segment],
            "topCentroid": [0.0, 0.0, shape.half_segment],
        }
        return {"type": _CAPSULE, "radius": 1.0, **ends, **placed}
    return None


def _add_mesh(document: Document, shape: Any) -> int:
    attributes = {"POSITION": document.accessor(np.asarray(shape.vertices), is_vertex=True)}
    triangles = document.accessor(np.asarray(shape.triangles).ravel(), is_index=True)
    return document.append(
        "meshes", {"primitives": [{"attributes": attributes, "indices": triangles}]}
    )


def _decomposed(matrices: F64) -> tuple[F64, F64, F64, npt.NDArray[np.bool_]]:
    """Translations (T, 3), rotations (T, 4) x y z w without jumps, scales (T, 3), sheared (T,)."""
    linear = matrices[:, :3, :3]
    scales = np.linalg.norm(linear, axis=1)
    scales[np.linalg.det(linear) < 0.0, 0] *= -1.0
    axes = linear / np.where(scales == 0.0, 1.0, scales)[:, None, :]
    products = axes.transpose(0, 2, 1) @ axes
    is_sheared = np.abs(products - np.eye(3)).max(axis=(1, 2)) > 1e-4
    left, _, right = np.linalg.svd(axes)  # the nearest rotation
    rotations = _quaternions(left @ right)
    flips = np.cumprod(np.where((rotations[1:] * rotations[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    rotations[1:] *= flips[:, None]
    return matrices[:, :3, 3], rotations, scales, is_sheared


def _quaternions(rotations: F64) -> F64:
    """Quaternions x, y, z, w of rotation matrices (T, 3, 3), by the eigenvector."""
    m = rotations
    k = np.empty((len(m), 4, 4))
    k[:, 0] = np.stack(
        [
            m[:, 0, 0] - m[:, 1, 1] - m[:, 2, 2],
            m[:, 1, 0] + m[:, 0, 1],
            m[:, 2, 0] + m[:, 0, 2],
            m[:, 2, 1] - m[:, 1, 2],
        ],
        axis=1,
    )
    k[:, 1] = np.stack(
        [
            m[:, 1, 0] + m[:, 0, 1],
            m[:, 1, 1] - m[:, 0, 0] - m[:, 2, 2],
            m[:, 2, 1] + m[:, 1, 2],
            m[:, 0, 2] - m[:, 2, 0],
        ],
        axis=1,
    )
    k[:, 2] = np.stack(
        [
            m[:, 2, 0] + m[:, 0, 2],
            m[:, 2, 1] + m[:, 1, 2],
            m[:, 2, 2] - m[:, 0, 0] - m[:, 1, 1],
            m[:, 1, 0] - m[:, 0, 1],
        ],
        axis=1,
    )
    k[:, 3] = np.stack(
        [
            m[:, 2, 1] - m[:, 1, 2],
            m[:, 0, 2] - m[:, 2, 0],
            m[:, 1, 0] - m[:, 0, 1],
            m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2],
        ],
        axis=1,
    )
    _, vectors = np.linalg.eigh(k)
    found: F64 = vectors[:, :, -1]
    return found * np.where(found[:, 3:] < 0.0, -1.0, 1.0)


def _animate(document: Document, node: int, times_s: F64, columns: dict[str, F64]) -> None:
    """Add keyframes where something moves; linear in between."""
    values = np.hstack(list(columns.values()))
    keep = np.ones(len(times_s), np.bool_)
    keep[1:-1] = (values[1:-1] != values[:-2]).any(axis=1) | (values[1:-1] != values[2:]).any(
        axis=1
    )
    clock = document.accessor(times_s[keep])
    animation: dict[str, Any] = {"samplers": [], "channels": []}
    for k, (path, column) in enumerate(columns.items()):
        output = document.accessor(column[keep])
        animation["samplers"].append({"input": clock, "output": output, "interpolation": "LINEAR"})
        animation["channels"].append({"sampler": k, "target": {"node": node, "path": path}})
    document.append("animations", animation)


def _add_interactivity(
    document: Document,
    triggers: list[dict[str, Any]],
    nodes: Sequence[int],
    scene: SceneDescription,
    hjif_name: str | None,
) -> None:
    """The draft extensions: for each trigger an action that plays its effect's modality."""
    if not triggers:
        return
    modalities = {clean(effect.id): effect.modality for effect in scene.effects}
    actions, behaviors = [], []
    for k, node in enumerate(nodes):
        effect_id = document.json["nodes"][node]["extras"]["hfx_effect"]
        media = {
            "mediaIndex": 0,
            "perceptionIndices": [],  # all that the file has of this modality
            "hapticModality": [_MODALITIES[modalities[effect_id]]],
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
    if hjif_name is not None:
        extensions["MPEG_media"] = {
            "media": [
                {
                    "name": hjif_name,
                    "alternatives": [{"mimeType": "application/json", "uri": hjif_name}],
                }
            ]
        }
    document.json["extensions"] = extensions
    document.json["extensionsUsed"] = sorted(extensions)
