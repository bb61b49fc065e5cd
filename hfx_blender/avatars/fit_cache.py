# SPDX-License-Identifier: GPL-3.0-or-later
"""Cache of avatar fits in the user's data folder, for avatars in several files.

An entry is found by a hash of the inputs: meshes, weights and bones of the avatar, bone mapping,
layer, body models and code of the fit. An unreadable entry counts as missing, and a failed write is
ignored.
"""

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from functools import lru_cache, reduce
from operator import getitem
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..engine.arrays import write_npz
from ..engine.body.model import load_avatar
from ..engine.body.rigs.mapping import BoneMapping
from ..engine.retargeting import shape_fields
from ..engine.retargeting.target import TargetAvatar
from ..errors import HfxError
from ..files import resources
from ..files.atomic import atomic_file

_MOST: Final = 32  # number of cached fits, about 4 MB each; the least recently used are deleted


def key_of(
    subject: str, targets: Sequence[TargetAvatar], mapping: BoneMapping, *more: object
) -> str:
    """Hexadecimal SHA-256 of code, ``subject`` (kind of result), mapping, avatars and ``more``."""
    digest = hashlib.sha256(_code_hash())
    rigs = [sorted(joints.items()) for joints in (mapping.bones, mapping.fallbacks)]
    digest.update(repr((subject, rigs, more)).encode())
    for target in targets:
        weights = target.weights
        bones = [(b.name, b.parent, *map(float, (*b.head, *b.tail))) for b in target.bones]
        digest.update(repr((target.bone_names, bones, target.metres)).encode())
        for array in (
            *(target.vertices, target.triangles),
            *(weights.offsets, weights.bones, weights.values),
        ):
            # Shape and type count too: equal bytes in another shape are other data.
            digest.update(repr((array.shape, array.dtype.str)).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def _code_hash() -> bytes:
    """SHA-256 digest of the avatar, its shape fields and the source code of fitting; a missing file
    counts as empty."""
    digest = hashlib.sha256(load_avatar().content_hash.encode())
    # A changed algorithm must not return earlier results.
    engine = Path(shape_fields.__file__).parent
    parts = (*sorted(engine.glob("*.py")), Path(__file__).with_name("fitting.py"))
    for path in (resources.body_models() / shape_fields.SHAPES_FILE, *parts):
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.digest()


def read(key: str) -> dict[str, Any] | None:
    """Cached document; None if missing or unreadable. Marks the entry as the newest."""
    path = _path(key)
    try:
        with np.load(path, allow_pickle=False) as stored:
            document = json.loads(stored["meta"].tobytes())
            # Names of arrays are paths, such as models/ID/vertices, back into the nested
            # dictionaries.
            for name in set(stored.files) - {"meta"}:
                *groups, last = name.split("/")
                reduce(getitem, groups, document)[last] = stored[name]
        path.touch()
    except (OSError, EOFError, ValueError, LookupError, TypeError, zipfile.BadZipFile):
        return None
    return document


def write(key: str, document: Mapping[str, object]) -> None:
    """Write nested dictionaries of JSON values and arrays into the cache, if the disk allows. The
    least recently used entries above the limit are deleted."""
    path = _path(key)
    arrays: dict[str, np.ndarray] = {}
    values = json.dumps(_without_arrays(document, "", arrays))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as file:
            write_npz(file, {"meta": np.frombuffer(values.encode(), np.uint8), **arrays})
        # Reading an entry renews its time, so the oldest are the least recently used.
        entries = path.parent.glob(f"{'[0-9a-f]' * len(key)}.npz")  # no file of another name
        oldest_first = sorted(entries, key=lambda entry: entry.stat().st_mtime)
        for entry in oldest_first[:-_MOST]:
            entry.unlink(missing_ok=True)
    except (OSError, HfxError):  # a full disk, a folder that cannot be written
        return


def _without_arrays(
    group: Mapping[str, object], prefix: str, arrays: dict[str, np.ndarray]
) -> dict[str, object]:
    """Copy of nested dictionaries without arrays, which are added to ``arrays`` by path."""
    values: dict[str, object] = {}
    for name, value in group.items():
        if isinstance(value, np.ndarray):
            arrays[prefix + name] = value
        elif isinstance(value, Mapping):
            values[name] = _without_arrays(value, f"{prefix}{name}/", arrays)
        else:
            values[name] = value
    return values


def _path(key: str) -> Path:
    """Path of the entry's .npz in the user's data folder."""
    return resources.kept_fits() / f"{key}.npz"
