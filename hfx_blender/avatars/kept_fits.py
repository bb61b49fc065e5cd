# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits of avatars, kept with the user's data: an avatar in many files is fitted once.

A fit is found by a hash of all that it depends on: the avatar's meshes, weights and bones, the
bone mapping, the layer that is felt, the body models and the code that fits. A file that cannot
be read or written is as good as none.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
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

_MOST: Final = 32
"""Number of kept fits, about 4 MB each; beyond it the one that was not used for longest goes."""


def key_of(
    subject: str, targets: Sequence[TargetAvatar], mapping: BoneMapping, *more: object
) -> str:
    """Hash of what a result depends on.

    Parameters
    ----------
    subject : str
        Kind of the result.
    more : of types whose text holds all that they are
    """
    known = hashlib.sha256(_edition())
    rigs = [sorted(each.items()) for each in (mapping.bones, mapping.fallbacks)]
    known.update(repr((subject, rigs, more)).encode())
    for target in targets:
        weights = target.weights
        bones = [(b.name, b.parent, *map(float, (*b.head, *b.tail))) for b in target.bones]
        known.update(repr((target.bone_names, bones, target.metres)).encode())
        for array in (
            *(target.vertices, target.triangles),
            *(weights.offsets, weights.bones, weights.values),
        ):
            known.update(repr((array.shape, array.dtype.str)).encode())
            known.update(np.ascontiguousarray(array).tobytes())
    return known.hexdigest()


@lru_cache(maxsize=1)
def _edition() -> bytes:
    """Hash of the code that fits, and of what it fits."""
    found = hashlib.sha256(load_avatar().content_hash.encode())
    engine = Path(shape_fields.__file__).parent
    parts = (*sorted(engine.glob("*.py")), Path(__file__).with_name("fitting.py"))
    for path in (resources.body_models() / shape_fields.SHAPES_FILE, *parts):
        found.update(path.read_bytes() if path.is_file() else b"")
    return found.digest()


def read(key: str) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
    """A kept result, as values for JSON and arrays; None if there is none."""
    path = _path(key)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        found = json.loads(arrays.pop("meta").tobytes())
        path.touch()
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    return found, arrays


def write(key: str, values: Mapping[str, object], arrays: Mapping[str, np.ndarray]) -> None:
    """Keep a result; the oldest ones go."""
    path = _path(key)
    meta = np.frombuffer(json.dumps(values).encode(), np.uint8)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as file:
            write_npz(file, {"meta": meta, **arrays})
        own = path.parent.glob(f"{'[0-9a-f]' * len(key)}.npz")  # the user may keep others there
        kept = sorted(own, key=lambda each: each.stat().st_mtime)
        for old in kept[:-_MOST]:
            old.unlink(missing_ok=True)
    except (OSError, HfxError):  # a full disk, a folder that cannot be written
        return


def _path(key: str) -> Path:
    return resources.kept_fits() / f"{key}.npz"
