# SPDX-License-Identifier: GPL-3.0-or-later
"""Serialization of scenes, blocks and samples between two processes of this program.

They are pickles of the engine's own plain data. Whoever reads one makes nothing but that and
arrays, whatever is in it; the package may have another name on the other side, as in Blender.
A message is its length (uint64, little-endian) and its body.
"""

from __future__ import annotations

import io
import pickle
import struct
from collections.abc import Mapping
from dataclasses import is_dataclass
from enum import Enum
from importlib import import_module
from typing import IO, Any, Final

from ...own_processes import read_exactly
from ..volume.mesh import MeshVolume

_ENGINE: Final = __package__.rpartition(".")[0]
_LENGTH: Final = struct.Struct("<Q")
_PLAIN: Final = frozenset(
    {
        "fractions.Fraction",
        "numpy.dtype",
        "numpy.ndarray",
        "numpy.core.multiarray._reconstruct",
        "numpy._core.multiarray._reconstruct",
        "numpy.core.multiarray.scalar",
        "numpy._core.multiarray.scalar",
        "numpy.core.numeric._frombuffer",
        "numpy._core.numeric._frombuffer",
    }
)


def send(stream: IO[bytes], body: bytes) -> None:
    """Write one message."""
    stream.write(_LENGTH.pack(len(body)))
    stream.write(body)
    stream.flush()


def receive(stream: IO[bytes]) -> bytes | None:
    """Read one message; None at the end, also in the middle of one."""
    head = read_exactly(stream, _LENGTH.size)
    return None if head is None else read_exactly(stream, _LENGTH.unpack(head)[0])


def encode_object(value: object, meshes: Mapping[MeshVolume, int] | None = None) -> bytes:
    """A value as bytes; of the meshes named, only their numbers."""
    file = io.BytesIO()
    _Pickler(file, meshes or {}).dump(value)
    return file.getvalue()


def decode_object(body: bytes, meshes: Mapping[int, MeshVolume] | None = None) -> Any:
    """Restore a value from :func:`encode_object` bytes; meshes by their numbers.

    Raises
    ------
    pickle.UnpicklingError
        They are of something that is never handed over.
    """
    return _Unpickler(io.BytesIO(body), meshes or {}).load()


def _is_plain(kind: Any) -> bool:
    """Test for a type whose making does nothing beyond it."""
    is_type = isinstance(kind, type)
    return is_type and (is_dataclass(kind) or issubclass(kind, (Enum, MeshVolume)))


class _Pickler(pickle.Pickler):
    def __init__(self, file: IO[bytes], meshes: Mapping[MeshVolume, int]) -> None:
        super().__init__(file, protocol=5)
        self._meshes = meshes

    def persistent_id(self, obj: object) -> int | None:
        return self._meshes.get(obj) if isinstance(obj, MeshVolume) else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: IO[bytes], meshes: Mapping[int, MeshVolume]) -> None:
        super().__init__(file)
        self._meshes = meshes

    def persistent_load(self, number: int) -> MeshVolume:
        return self._meshes[number]

    def find_class(self, module: str, name: str) -> Any:
        _, is_ours, within = module.rpartition(".engine.")
        if is_ours and "." not in name:
            found = getattr(import_module(f"{_ENGINE}.{within}"), name, None)
            if _is_plain(found) and found.__module__ == f"{_ENGINE}.{within}":
                return found
        if f"{module}.{name}" in _PLAIN:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is no plain data")
