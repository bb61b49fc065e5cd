# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of a scene as skinned, moving glTF nodes.

Each body is a node with the motion of the armature, and a child joint per bone with skin. The joint
is at the middle of this skin: the inverse bind matrix moves this point to the origin. A body
following a mesh has a joint per skin patch instead. Every perceptual model of the body is a mesh
with this skin, vertices in the body's rest pose and in the model's order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.active_rows import posed_rows
from ...engine.arrays import F32, F64, I64, ramp
from ...engine.body.model import PerceptualModel, load_model
from ...engine.kinematics.placement_motion import longest_axis
from ...engine.scene import (
    AnimationBlock,
    BodyDescription,
    SceneDescription,
    SkinBinding,
    SurfaceBinding,
)
from ...engine.skin.skinned_model import BoundWeights
from ...engine.skin.surface_joints import SurfaceJoints
from ...files.strict_json import clean
from .glb import TO_GLTF, Document, add_model, move, turned

_SET: Final = 4  # influences per vertex attribute of glTF
_STILL: Final = "rest"
_RECORDED: Final = ("indices", "to_world", "bones")


@dataclass(eq=False)
class _Motion:
    """Recorded poses of a body."""

    indices: list[I64] = field(default_factory=list)
    to_world: list[F64] = field(default_factory=list)  # (T, 4, 4)
    bones: list[F32] = field(default_factory=list)  # (T, B, 3, 4)
    errors_m: F64 = field(default_factory=lambda: np.zeros(2))  # patch errors: 99 %, largest


class BodyRecorder:
    """Recorder of the motion of a scene's bodies, block by block."""

    def __init__(self, scene: SceneDescription) -> None:
        self._scene = scene
        self._motions = [_Motion() for _ in scene.bodies]
        self._patches: dict[str, SurfaceJoints] = {}  # by body

    def add(self, block: AnimationBlock) -> None:
        """Record the own samples of the next block, in time order, without unposed samples."""
        for body, motion, pose in zip(self._scene.bodies, self._motions, block.poses, strict=False):
            rows = posed_rows(pose)
            # Blocks hold samples of their neighbours too; each sample is recorded by its own block.
            rows = rows[(rows >= block.own.start) & (rows < block.own.stop)]
            if not len(rows):
                continue
            # glTF skins follow joints: a body on a mesh gets a joint for each patch of its skin,
            # fitted to the moved patch.
            if pose.surface is not None:
                patches = self._patches_of(body)
                bones: npt.NDArray[Any]
                bones, errors = patches.matrices(pose, rows)
                # Errors are lengths in rest space: the longest axis of the transform bounds them in
                # the world.
                scale = float(longest_axis(pose.to_world[rows, :3, :3]).max())
                motion.errors_m = np.maximum(motion.errors_m, scale * errors)
            else:
                bones = np.zeros((len(rows), 0, 3, 4)) if pose.bones is None else pose.bones[rows]
            motion.indices.append(block.indices[rows])
            motion.to_world.append(pose.to_world[rows])
            motion.bones.append(bones.astype(np.float32))

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays by ``body.<number>.<name>`` for transfer to a process, of posed bodies only."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        for k, motion in enumerate(self._motions):
            if motion.indices:
                for name in _RECORDED:
                    arrays[f"body.{k}.{name}"] = np.concatenate(getattr(motion, name))
                arrays[f"body.{k}.errors_m"] = motion.errors_m
        return arrays

    def replace(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Replace the recording by :meth:`arrays` of several recorders in time order."""
        for k, motion in enumerate(self._motions):
            mine = [part for part in parts if f"body.{k}.indices" in part]
            for name in _RECORDED:
                setattr(motion, name, [part[f"body.{k}.{name}"] for part in mine])
            errors = [part[f"body.{k}.errors_m"] for part in mine]
            motion.errors_m = np.max([np.zeros(2), *errors], axis=0)

    def _patches_of(self, body: BodyDescription) -> SurfaceJoints:
        """Skin patches of a body following a mesh, created at first use and cached."""
        assert isinstance(body.binding, SurfaceBinding)
        if body.id not in self._patches:
            self._patches[body.id] = SurfaceJoints(body.binding, load_model)
        return self._patches[body.id]

    def write(
        self, document: Document, models: Sequence[PerceptualModel], notes: list[str]
    ) -> tuple[list[int], list[int]]:
        """Add all bodies and extend ``notes``; returns all nodes but joints, and the mesh nodes."""
        roots: list[int] = []
        meshes: list[int] = []
        for body, motion in zip(self._scene.bodies, self._motions, strict=True):
            nodes = self._add(document, body, motion, models, notes)
            roots += nodes
            meshes += nodes[1:]
        return roots, meshes

    def _add(
        self,
        document: Document,
        body: BodyDescription,
        motion: _Motion,
        models: Sequence[PerceptualModel],
        notes: list[str],
    ) -> list[int]:
        """Add a body; returns its own node, then a node per model. A body never posed is at the
        origin. Patch errors and sheared bones go to ``notes``."""
        binding = body.binding
        node: dict[str, Any] = {"name": clean(body.name), "extras": {"hfx_body": clean(body.id)}}
        is_posed = bool(motion.indices)
        names: tuple[str, ...] = ()
        bound: list[BoundWeights] = []
        to_world = np.concatenate(motion.to_world) if is_posed else np.eye(4)[None]
        indices = np.concatenate(motion.indices) if is_posed else np.zeros(1, np.int64)
        times = self._scene.time.times_s(indices) - self._scene.time.times_s(np.zeros(1, int))
        if not isinstance(binding, SkinBinding):
            if is_posed:
                patches = self._patches_of(body)
                names, bound = patches.names, [patches.bound(model) for model in models]
                most_mm, all_mm = 1000.0 * motion.errors_m
                notes.append(
                    f"body '{body.name}' follows its mesh: in the scene file {len(names)} patches "
                    f"of its skin do, 99 % within {most_mm:.1f} mm, all within {all_mm:.1f} mm"
                )
        else:
            names, fitted = binding.bone_names, binding.fitted
            # A body on a user's rig has vertices fitted to the avatar, in the order of the model.
            models = [fitted[m.id].of(m) if m.id in fitted else m for m in models]
            bound = [BoundWeights.of(model, binding.bone_names) for model in models]
        used = np.unique(np.concatenate([np.zeros(0, np.int64), *(item.bones for item in bound)]))
        # The pivot of a bone is the weighted centre of its skin, (len(used), 3) in rest space.
        sums = np.zeros((len(used), 4))
        for weights in bound:
            _, owners = ramp(np.diff(weights.offsets))
            column = np.searchsorted(used, weights.bones)
            # Rest places are homogeneous: the last column sums the weights.
            np.add.at(sums, column, weights.values[:, None] * weights.rest[owners])
        pivots = sums[:, :3] / np.maximum(sums[:, 3:], 1e-12)
        children = []
        is_sheared = move(document, node, times, turned(to_world))
        root = len(document.json["nodes"]) - 1
        bones = np.concatenate(motion.bones) if is_posed else None
        for bone, pivot in zip(used.tolist(), pivots, strict=True):
            name = _STILL
            matrices = np.tile(np.eye(4), (len(times), 1, 1))
            # The number after the last bone stands for skin without a bone: its joint rests.
            if bone < len(names):
                name = names[bone]
                if bones is not None:
                    matrices[:, :3] = bones[:, bone]
            # The joint is at the pivot instead of the bone's origin; inverse bind
            # matrices compensate.
            matrices[:, :3, 3] += matrices[:, :3, :3] @ pivot
            joint: dict[str, Any] = {"name": clean(name)}
            is_sheared |= move(document, joint, times, turned(matrices))
            children.append(len(document.json["nodes"]) - 1)
        if is_sheared.any():
            notes.append(f"bones of body '{body.name}' are sheared, which glTF cannot animate")
        node_indices = [root]
        if children:
            document.json["nodes"][root]["children"] = children
            skin = self._add_skin(document, body.name, root, children, pivots)
        for k, model in enumerate(models):
            mesh = add_model(document, model)
            shown: dict[str, Any] = {"name": clean(f"{body.name}: {model.id}"), "mesh": mesh}
            if bound:
                _add_weights(document, mesh, bound[k], used)
                shown["skin"] = skin
            node_indices.append(document.append("nodes", shown))
        return node_indices

    def _add_skin(
        self, document: Document, name: str, root: int, joints: Sequence[int], pivots: F64
    ) -> int:
        """Add a skin of the nodes ``joints``, at ``pivots`` (J, 3), and return its index."""
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        inverse[:, :3, 3] = -(pivots @ TO_GLTF.T)
        # glTF stores matrices column by column.
        columns = inverse.transpose(0, 2, 1).reshape(-1, 16)
        return document.append(
            "skins",
            {
                "name": clean(name),
                "inverseBindMatrices": document.accessor(columns),
                "skeleton": root,
                "joints": list(joints),
            },
        )


def _add_weights(document: Document, mesh: int, weights: BoundWeights, used: I64) -> None:
    """Add joints (positions in ``used``) and weights, strongest first, in sets of four to a mesh.
    Weights of a vertex sum to 1; the sets hold all influences."""
    counts = np.diff(weights.offsets)
    column, owners = ramp(counts)
    # glTF's sets hold four influences each; importers that read one set get the strongest four.
    order = np.lexsort([-weights.values, owners])  # by vertex, then descending weight
    width = _SET * -(-int(counts.max(initial=1)) // _SET)
    joints = np.zeros((len(counts), width), np.uint16)
    shares = np.zeros((len(counts), width), np.float32)
    joints[owners, column] = np.searchsorted(used, weights.bones[order])
    shares[owners, column] = weights.values[order]
    # Rounded to 32 bits, sums may differ from 1, which validators report.
    shares /= shares.sum(axis=1, keepdims=True)
    attributes = document.json["meshes"][mesh]["primitives"][0]["attributes"]
    for k in range(width // _SET):
        part = slice(_SET * k, _SET * (k + 1))
        attributes[f"JOINTS_{k}"] = document.accessor(joints[:, part], is_vertex=True)
        attributes[f"WEIGHTS_{k}"] = document.accessor(shares[:, part], is_vertex=True)
