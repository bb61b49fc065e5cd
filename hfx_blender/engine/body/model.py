# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models and the shipped avatar: their content and storage.

All coordinates are *rest space*: the space of the canonical armature in its rest pose, metres,
Z up, the body facing -Y, its left at +X, the soles at Z = 0.
"""

from __future__ import annotations

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...files import limits, resources
from ..arrays import F32, I32, NPZ_DAMAGE, U8
from . import model_library
from .model_library import manifest as manifest  # the index belongs to what it lists

FORMAT_VERSION = 1

AVATAR_ID = "hfx-avatar-1"
"""Id of the shipped avatar, whose skeleton is the canonical one."""


@dataclass(frozen=True, eq=False)
class SkinWeights:
    """Sparse skin weights: row ``v`` is ``slice(offsets[v], offsets[v + 1])``.

    Rows are sorted by bone, values are positive and sum to 1 in each row.
    """

    offsets: I32  # (V + 1,)
    bones: I32  # (N,) index into the bone names of the owner
    values: F32  # (N,)


@dataclass(frozen=True, eq=False)
class PerceptualModel:
    """A body mesh for one modality, its vertices one two-point threshold apart.

    Source of the idea: Danieau et al., VRST 2018, section 3.1.
    """

    id: str
    modality: str  # "vibration", "pressure" or "temperature"
    vertices: F32  # (V, 3) rest space, metres
    triangles: I32  # (F, 3) counter-clockwise seen from outside
    normals: F32  # (V, 3) unit length, outward
    areas_m2: F32  # (V,) one vertex's share of the skin
    part: U8  # (V,) index into parts.PARTS
    side: U8  # (V,) index into parts.SIDES
    mirror: I32  # (V,) the vertex at (-x, y, z); its own inverse
    bone_names: tuple[str, ...]  # of the canonical skeleton
    weights: SkinWeights
    avatar_vertices: I32  # (V, 3) triangle of avatar vertices that a vertex lies over
    avatar_weights: F32  # (V, 3) barycentric, sum 1
    avatar_offset_m: F32  # (V,) distance from that triangle along its normal
    provenance: dict[str, Any]  # source, licence, method, statistics

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over everything that defines the meaning of vertex ids, as hex."""
        return _content_hash(self)

    def __len__(self) -> int:
        return len(self.vertices)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The canonical skeleton (MakeHuman's default rig), parents before children."""

    bone_names: tuple[str, ...]
    parents: I32  # (B,) -1 for a root
    rest: F32  # (B, 4, 4) bone to rest space, as Blender's ``bone.matrix_local``
    lengths_m: F32  # (B,)


@dataclass(frozen=True, eq=False)
class Avatar:
    """The shipped avatar: skin mesh, skeleton and skin weights."""

    id: str
    vertices: F32  # (V, 3) rest space, metres
    faces: I32  # (F, 4) quads; a triangle repeats its last corner as -1
    uv: F32  # (F, 4, 2)
    part: U8  # (V,)
    side: U8  # (V,)
    skeleton: Skeleton
    weights: SkinWeights
    provenance: dict[str, Any]

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over mesh, skeleton and weights, as hex."""
        return _content_hash(self)


@dataclass(frozen=True, eq=False)
class WalkCycle:
    """Cycle of walking in place for the canonical skeleton, to be repeated."""

    rate_hz: float
    stride_m: float  # way covered in one cycle
    bone_names: tuple[str, ...]
    rotations: F32  # (T, B, 4) ``rotation_quaternion`` (w, x, y, z); the first is not repeated
    root_offset_m: F32  # (T, 3) rest-space offset of the root bone
    provenance: dict[str, Any]


_Stored = TypeVar("_Stored", PerceptualModel, Avatar, WalkCycle)
_Hashed = TypeVar("_Hashed", PerceptualModel, Avatar)


def stored_arrays(item: Any, prefix: str = "") -> dict[str, npt.NDArray[Any]]:
    """Arrays of a model by the names that they have in its file, those of its parts too."""
    found: dict[str, npt.NDArray[Any]] = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if isinstance(value, np.ndarray):
            found[prefix + field.name] = value
        elif isinstance(value, SkinWeights | Skeleton):
            found |= stored_arrays(value, f"{prefix}{field.name}.")
    return found


def _content_hash(item: PerceptualModel | Avatar) -> str:
    digest = hashlib.sha256()
    names = item.bone_names if isinstance(item, PerceptualModel) else item.skeleton.bone_names
    digest.update("\0".join((item.id, *names)).encode())
    for name, array in sorted(stored_arrays(item).items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).data)
    return digest.hexdigest()


def load(kind: type[_Stored], path: Path) -> _Stored:
    """Read a file of body_models/ or of a variant.

    Raises
    ------
    InputError
        The file is missing, is not such a file, or is of a newer version.
    """
    meta, arrays = _read(kind, path)
    if kind is PerceptualModel:
        _refuse_strange(path, meta, arrays)
    skeleton = _taken(arrays, "skeleton")
    if skeleton:
        meta["skeleton"] = _skeleton(meta, skeleton)
    weights = _taken(arrays, "weights")
    if weights:
        meta["weights"] = SkinWeights(**weights)
    if "bone_names" in meta:
        meta["bone_names"] = tuple(meta["bone_names"])
    return kind(**meta, **arrays)


ARRAYS: Final[dict[str, tuple[type[np.generic], int]]] = {
    "vertices": (np.float32, 2),
    "triangles": (np.int32, 2),
    "normals": (np.float32, 2),
    "areas_m2": (np.float32, 1),
    "part": (np.uint8, 1),
    "side": (np.uint8, 1),
    "mirror": (np.int32, 1),
    "avatar_vertices": (np.int32, 2),
    "avatar_weights": (np.float32, 2),
    "avatar_offset_m": (np.float32, 1),
    "weights.offsets": (np.int32, 1),
    "weights.bones": (np.int32, 1),
    "weights.values": (np.float32, 1),
}
"""Kind and dimensions of a perceptual model's arrays."""

_OF_VERTICES: Final = tuple(ARRAYS)[:1] + tuple(ARRAYS)[2:-3]
_FACTS: Final = {"id": str, "modality": str, "bone_names": list, "provenance": dict}


def _refuse_strange(path: Path, meta: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Reject content that is no perceptual model, by names, kinds and sizes.

    Raises
    ------
    InputError
        It names the first member that is not as it must be.
    """
    if set(meta) != set(_FACTS) or set(arrays) != set(ARRAYS):
        raise InputError(f"{path}: not a readable body model (it has not a model's members).")
    for name, fact in _FACTS.items():
        if type(meta[name]) is not fact:
            raise InputError(f"{path}: '{name}' is not a {fact.__name__}.")
    if not all(isinstance(each, str) for each in meta["bone_names"]):
        raise InputError(f"{path}: 'bone_names' holds something that is not text.")
    for name, (kind, dimensions) in ARRAYS.items():
        found = arrays[name]
        if not isinstance(found, np.ndarray):
            raise InputError(f"{path}: '{name}' is not an array.")
        if found.dtype != kind or found.ndim != dimensions:
            raise InputError(f"{path}: '{name}' is not {kind.__name__} of {dimensions} dimensions.")
        if kind is np.float32 and not np.isfinite(found).all():
            raise InputError(f"{path}: '{name}' has numbers that are not finite.")
    _refuse_unfit_sizes(path, arrays)
    if not _weights_fit(len(arrays["vertices"]), len(meta["bone_names"]), arrays):
        raise InputError(f"{path}: its skin weights do not fit its vertices and bones.")


def _refuse_unfit_sizes(path: Path, arrays: dict[str, npt.NDArray[Any]]) -> None:
    """Reject arrays of another length than the vertices, and numbers of vertices beyond them."""
    count = len(arrays["vertices"])
    for name in _OF_VERTICES:
        if len(arrays[name]) != count or (arrays[name].ndim == 2 and arrays[name].shape[1] != 3):
            raise InputError(f"{path}: '{name}' does not fit {count} vertices.")
    for name in ("triangles", "mirror"):
        ids = arrays[name]
        if (ids.ndim == 2 and ids.shape[1] != 3) or (ids.size and not 0 <= ids.min()):
            raise InputError(f"{path}: '{name}' is not ids of vertices.")
        if ids.size and ids.max() >= count:
            raise InputError(f"{path}: '{name}' names a vertex that is not there.")


def _weights_fit(vertices: int, bone_names: int, arrays: dict[str, npt.NDArray[Any]]) -> bool:
    """Test skin weights against the numbers of vertices and of bones."""
    offsets, bones = arrays["weights.offsets"], arrays["weights.bones"]
    return (
        len(offsets) == vertices + 1
        and offsets[0] == 0
        and offsets[-1] == len(bones) == len(arrays["weights.values"])
        and bool((np.diff(offsets) >= 0).all())
        and (not len(bones) or bool(0 <= bones.min() <= bones.max() < bone_names))
    )


def _taken(arrays: dict[str, Any], part: str) -> dict[str, Any]:
    """Remove the arrays of a part from the others, and return them."""
    mine = [name for name in arrays if name.startswith(f"{part}.")]
    return {name.partition(".")[2]: arrays.pop(name) for name in mine}


def _skeleton(meta: dict[str, Any], arrays: dict[str, Any]) -> Skeleton:
    return Skeleton(bone_names=tuple(meta["skeleton"]["bone_names"]), **arrays)


def _read(kind: type[_Stored], path: Path, part: str = "") -> tuple[dict[str, Any], dict[str, Any]]:
    """Read facts and arrays of a file, or only those of a part; see :func:`load`."""
    try:
        arrays = _stored_arrays(path, part)
        meta: dict[str, Any] = json.loads(arrays.pop("meta").tobytes())
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not a readable body model ({error}).") from error
    if not isinstance(meta, dict):
        raise InputError(f"{path}: not a readable body model (it tells nothing of itself).")
    found, version = meta.pop("format", None), meta.pop("version", None)
    if found != kind.__name__ or type(version) is not int or version > FORMAT_VERSION:
        raise InputError(
            f"{path}: expected a {kind.__name__} of version {FORMAT_VERSION} or older."
        )
    return meta, arrays


WORTH_THREADS = 1 << 18
"""Bytes of a file from which on two threads unpack it: they need not wait for each other."""


def _stored_arrays(path: Path, part: str) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as stored:
        if not isinstance(stored, np.lib.npyio.NpzFile):
            raise ValueError("one array, not an archive of some")
        unpacked_bytes = sum(each.file_size for each in stored.zip.infolist())
        limits.check_unpacked(unpacked_bytes, path.stat().st_size, str(path))
        names = [name for name in stored.files if name == "meta" or name.startswith(part)]
        if part or path.stat().st_size < WORTH_THREADS:
            return {name: stored[name] for name in names}
        sizes = {name: stored.zip.getinfo(f"{name}.npy").compress_size for name in names}
        halves: tuple[list[str], list[str]] = ([], [])
        for name in sorted(names, key=sizes.__getitem__, reverse=True):
            min(halves, key=lambda half: sum(sizes[each] for each in half)).append(name)

        def unpacked() -> dict[str, Any]:
            with np.load(path, allow_pickle=False) as again:  # readers cannot share a file
                return {name: again[name] for name in halves[1]}

        with ThreadPoolExecutor(1) as pool:
            others = pool.submit(unpacked)
            arrays = {name: stored[name] for name in halves[0]}
            return arrays | others.result()


@lru_cache(maxsize=8)
def load_model(model_id: str) -> PerceptualModel:
    """A perceptual model, shipped or installed by the user, by its id (``"hfx-pressure-1"``).

    Loaded once a process.

    Raises
    ------
    InputError
        There is no model of this id, or its file is not what its manifest says.
    """
    return _loaded(PerceptualModel, model_library.find(model_id))


@lru_cache(maxsize=4)
def load_avatar(avatar_id: str = AVATAR_ID) -> Avatar:
    """Load the shipped avatar, or that of an installed variant.

    Raises
    ------
    InputError
        There is no avatar of this id, or its file is not what its manifest says.
    """
    return _loaded(Avatar, model_library.find(avatar_id, "avatar"))


@lru_cache(maxsize=1)
def load_skeleton() -> Skeleton:
    """Load the canonical skeleton: that of the shipped avatar, of which nothing else is read."""
    meta, arrays = _read(Avatar, model_library.find(AVATAR_ID, "avatar").path, "skeleton.")
    return _skeleton(meta, _taken(arrays, "skeleton"))


def _loaded(kind: type[_Hashed], entry: model_library.Entry) -> _Hashed:
    found = load(kind, entry.path)
    # Shipped files were tested; files that a user has copied or edited were not.
    stated = entry.content_hash
    if not entry.is_shipped and (found.id, found.content_hash) != (entry.id, stated):
        raise InputError(
            f"{entry.path}: holds '{found.id}' ({found.content_hash[:12]}...), where the "
            f"manifest beside it says '{entry.id}' ({stated[:12]}...); build or copy it again."
        )
    return found


@lru_cache(maxsize=1)
def load_walk() -> WalkCycle:
    """The shipped walk cycle."""
    return load(WalkCycle, resources.body_models() / manifest()["walk"]["file"])
