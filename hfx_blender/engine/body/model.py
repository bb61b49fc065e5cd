# SPDX-License-Identifier: GPL-3.0-or-later
"""Dataclasses of body models (perceptual model, avatar, skeleton) and their files.

Coordinates are in *rest space*: the space of the canonical armature in its rest pose, metres,
Z up, body facing -Y, left side at +X, soles at Z = 0.
"""

import hashlib
import json
import zipfile
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from ...errors import InputError, refuse_no_file
from ...files import limits
from ..arrays import F32, F64, I32, I64, NPZ_DAMAGE, U8
from . import model_library
from .model_library import manifest as manifest

FORMAT_VERSION = 1

AVATAR_ID = "hfx-avatar-1"  # id of the shipped avatar, whose skeleton is the canonical one


@dataclass(frozen=True, eq=False)
class SkinWeights:
    """Sparse skin weights: row ``v`` is ``slice(offsets[v], offsets[v + 1])``. Entries of a row are
    sorted by bone, positive, and sum to 1."""

    offsets: I32  # (V + 1,)
    bones: I32  # (N,) index into the bone names of the model or avatar
    values: F32  # (N,)


@dataclass(frozen=True, eq=False)
class PerceptualModel:
    """Body mesh of one modality with vertices one two-point threshold apart. Source: Danieau et
    al., VRST 2018, section 3.1."""

    id: str
    modality: str  # "vibration", "pressure" or "temperature"
    vertices: F32  # (V, 3) rest space, metres
    triangles: I32  # (F, 3) counter-clockwise seen from outside
    normals: F32  # (V, 3) unit length, outward
    areas_m2: F32  # (V,) area of skin per vertex
    part: U8  # (V,) index into parts.PARTS
    side: U8  # (V,) index into parts.SIDES
    mirror: I32  # (V,) index of the vertex at (-x, y, z); an involution
    bone_names: tuple[str, ...]  # of the canonical skeleton
    weights: SkinWeights
    avatar_vertices: I32  # (V, 3) avatar vertices of the triangle below each vertex
    avatar_weights: F32  # (V, 3) barycentric, sum 1
    avatar_offset_m: F32  # (V,) signed distance along the triangle's normal
    provenance: dict[str, Any]  # source, licence, method, statistics

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the id, bone names and all arrays; identifies the vertex ids."""
        return _content_hash(self)

    def __len__(self) -> int:
        return len(self.vertices)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Canonical skeleton (MakeHuman's default rig), parents before children."""

    bone_names: tuple[str, ...]
    parents: I32  # (B,) -1 for a root
    rest: F32  # (B, 4, 4) bone to rest space, as Blender's ``bone.matrix_local``
    lengths_m: F32  # (B,)

    @cached_property
    def heads(self) -> dict[str, F64]:
        """Head (3,) of each bone, rest space."""
        heads = self.rest[:, :3, 3].astype(np.float64)
        return dict(zip(self.bone_names, heads, strict=True))


@dataclass(frozen=True, eq=False)
class Avatar:
    """Shipped avatar: skin mesh, skeleton and skin weights."""

    id: str
    vertices: F32  # (V, 3) rest space, metres
    faces: I32  # (F, 4) quads; -1 as last corner of a triangle
    uv: F32  # (F, 4, 2)
    part: U8  # (V,)
    side: U8  # (V,)
    skeleton: Skeleton
    weights: SkinWeights
    provenance: dict[str, Any]

    @cached_property
    def triangles(self) -> I64:
        """Halves (2 F, 3) of the quads: all first halves, then all second halves."""
        faces = self.faces.astype(np.int64)
        return np.concatenate((faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]))

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the id, bone names and all arrays."""
        return _content_hash(self)


_Stored = TypeVar("_Stored")
_Hashed = TypeVar("_Hashed", PerceptualModel, Avatar)


def stored_arrays(item: Any, prefix: str = "") -> dict[str, npt.NDArray[Any]]:
    """Arrays of a model by their names in its file; nested dataclasses as ``weights.values``.
    Arrays are not copied."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if isinstance(value, np.ndarray):
            arrays[prefix + field.name] = value
        elif isinstance(value, SkinWeights | Skeleton):
            arrays |= stored_arrays(value, f"{prefix}{field.name}.")
    return arrays


def _content_hash(item: PerceptualModel | Avatar) -> str:
    """SHA-256 (hex) of id, bone names, and name, dtype, shape and bytes of each array, by name."""
    digest = hashlib.sha256()
    names = item.bone_names if isinstance(item, PerceptualModel) else item.skeleton.bone_names
    digest.update("\0".join((item.id, *names)).encode())
    for name, array in sorted(stored_arrays(item).items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        # Name, type and shape are hashed, too: equal bytes of another layout are another model.
        digest.update(np.ascontiguousarray(array).reshape(-1).data)
    return digest.hexdigest()


def load(kind: type[_Stored], path: Path) -> _Stored:
    """Read a perceptual model, avatar or another dataclass from an .npz file. Raises InputError:
    the file is missing, damaged, of another kind or of a newer version."""
    meta, arrays = _read(kind, path)
    if kind is PerceptualModel:
        _check_model(path, meta, arrays)
    skeleton = _pop_part(arrays, "skeleton")
    if skeleton:
        meta["skeleton"] = Skeleton(tuple(meta["skeleton"]["bone_names"]), **skeleton)
    weights = _pop_part(arrays, "weights")
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
"""Dtype and number of dimensions of each array of a perceptual model."""

_OF_VERTICES: Final = tuple(ARRAYS)[:1] + tuple(ARRAYS)[2:-3]
_FACTS: Final = {"id": str, "modality": str, "bone_names": list, "provenance": dict}


def _check_model(path: Path, meta: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Check member names, dtypes, dimensions and sizes of a perceptual model's content, finite
    floats, and skin weights. Raises InputError at the first invalid member, with its name; returns
    nothing."""
    if set(meta) != set(_FACTS) or set(arrays) != set(ARRAYS):
        raise InputError(f"{path}: not a readable body model (missing or unknown members).")
    for name, expected_type in _FACTS.items():
        if type(meta[name]) is not expected_type:
            raise InputError(f"{path}: '{name}' is not a {expected_type.__name__}.")
    if not all(isinstance(name, str) for name in meta["bone_names"]):
        raise InputError(f"{path}: 'bone_names' has an entry other than text.")
    for name, (kind, dimensions) in ARRAYS.items():
        array = arrays[name]
        if not isinstance(array, np.ndarray):
            raise InputError(f"{path}: '{name}' is not an array.")
        if array.dtype != kind or array.ndim != dimensions:
            raise InputError(f"{path}: '{name}' is not {kind.__name__} of {dimensions} dimensions.")
        if kind is np.float32 and not np.isfinite(array).all():
            raise InputError(f"{path}: '{name}' has NaN or infinite values.")
    _check_sizes(path, arrays, len(meta["bone_names"]))


def _check_sizes(path: Path, arrays: dict[str, npt.NDArray[Any]], bones: int) -> None:
    """Check that arrays by vertex have one row per vertex, two-dimensional ones three columns, that
    ids in triangles and mirror are in range, and that skin weights have a row per vertex and bone
    ids below ``bones``. Raises InputError at the first invalid array; returns nothing."""
    count = len(arrays["vertices"])
    for name in _OF_VERTICES:
        if len(arrays[name]) != count or (arrays[name].ndim == 2 and arrays[name].shape[1] != 3):
            raise InputError(f"{path}: '{name}' does not fit {count} vertices.")
    for name in ("triangles", "mirror"):
        ids = arrays[name]
        if (ids.ndim == 2 and ids.shape[1] != 3) or (ids.size and not 0 <= ids.min()):
            raise InputError(f"{path}: '{name}' is not a list of vertex ids.")
        if ids.size and ids.max() >= count:
            raise InputError(f"{path}: '{name}' has an id beyond the last of {count} vertices.")
    # Row offsets rise from 0 to the number of entries; C code later trusts them.
    offsets, ids = arrays["weights.offsets"], arrays["weights.bones"]
    has_rows = len(offsets) == count + 1 and offsets[0] == 0 and (np.diff(offsets) >= 0).all()
    is_full = has_rows and offsets[-1] == len(ids) == len(arrays["weights.values"])
    if not is_full or (len(ids) and not 0 <= ids.min() <= ids.max() < bones):
        raise InputError(f"{path}: the skin weights do not fit the vertices and bones.")


def _pop_part(arrays: dict[str, Any], part: str) -> dict[str, Any]:
    """Remove the arrays ``<part>.<name>`` from ``arrays``; return a dict by ``<name>``."""
    names = [name for name in arrays if name.startswith(f"{part}.")]
    return {name.partition(".")[2]: arrays.pop(name) for name in names}


def _read(kind: type[_Stored], path: Path, part: str = "") -> tuple[dict[str, Any], dict[str, Any]]:
    """Read metadata and arrays of a file; with ``part``, only arrays with this name prefix. Raises
    InputError: the file is missing, damaged, of another kind, of a newer version, or unpacks to
    more than :mod:`hfx_blender.files.limits` allow."""
    refuse_no_file(path)
    try:
        with path.open("rb") as file:
            # numpy takes a file of another kind for pickled objects.
            if not zipfile.is_zipfile(file):
                raise ValueError("no .npz archive, or cut short")
        with np.load(path, allow_pickle=False) as stored:
            # The sizes in the archive's index are checked before anything is unpacked.
            unpacked_bytes = sum(member.file_size for member in stored.zip.infolist())
            limits.check_unpacked(unpacked_bytes, path.stat().st_size, str(path))
            arrays = {x: stored[x] for x in stored.files if x == "meta" or x.startswith(part)}
        meta: dict[str, Any] = json.loads(arrays.pop("meta").tobytes())
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not a readable body model ({error}).") from error
    if not isinstance(meta, dict):
        raise InputError(f"{path}: not a readable body model (metadata missing).")
    kind_name, version = meta.pop("format", None), meta.pop("version", None)
    if kind_name != kind.__name__ or type(version) is not int or version > FORMAT_VERSION:
        raise InputError(
            f"{path}: expected a {kind.__name__} of version {FORMAT_VERSION} or older."
        )
    return meta, arrays


@lru_cache(maxsize=8)
def load_model(model_id: str) -> PerceptualModel:
    """Perceptual model by id (``"hfx-pressure-1"``), shipped or installed by the user; cached.
    Raises InputError: unknown id, unreadable file, or content hash different from the manifest."""
    return _loaded(PerceptualModel, model_library.find(model_id))


@lru_cache(maxsize=4)
def load_avatar(avatar_id: str = AVATAR_ID) -> Avatar:
    """Shipped avatar or avatar of an installed variant, by id; cached. Raises InputError: unknown
    id, unreadable file, or content hash different from the manifest."""
    return _loaded(Avatar, model_library.find(avatar_id, "avatar"))


@lru_cache(maxsize=1)
def load_skeleton() -> Skeleton:
    """Canonical skeleton, read from the avatar file without the mesh; cached."""
    meta, arrays = _read(Avatar, model_library.find(AVATAR_ID, "avatar").path, "skeleton.")
    return Skeleton(tuple(meta["skeleton"]["bone_names"]), **_pop_part(arrays, "skeleton"))


def _loaded(kind: type[_Hashed], entry: model_library.Entry) -> _Hashed:
    """Load the file of an entry. Raises InputError: unreadable, or, unless shipped, with another id
    or content hash than in the manifest."""
    item = load(kind, entry.path)
    # Hashing costs time; the test suite already checks the shipped files.
    expected_hash = entry.content_hash
    if not entry.is_shipped and (item.id, item.content_hash) != (entry.id, expected_hash):
        raise InputError(
            f"{entry.path}: holds '{item.id}' ({item.content_hash[:12]}...), but the manifest "
            f"says '{entry.id}' ({expected_hash[:12]}...). Build or copy the model again."
        )
    return item
