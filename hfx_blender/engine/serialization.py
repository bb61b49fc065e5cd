# SPDX-License-Identifier: GPL-3.0-or-later
"""Serialization of scenes, blocks and samples between two processes of this program.

They are pickles of the engine's own plain data. Whoever reads one makes nothing but that and
arrays, whatever is in it; the package may have another name on the other side, as in Blender.
"""

from __future__ import annotations

import io
import pickle
from dataclasses import is_dataclass
from enum import Enum
from importlib import import_module
from typing import Any, Final

from .volume.mesh import MeshVolume

_ENGINE: Final = __package__
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


def encode_object(value: object) -> bytes:
    """A value as bytes."""
    return pickle.dumps(value, protocol=5)


def decode_object(body: bytes) -> Any:
    """Restore a value from :func:`encode_object` bytes.

    Raises
    ------
    pickle.UnpicklingError
        They are of something that is never handed over.
    """
    return _Unpickler(io.BytesIO(body)).load()


def _is_plain(kind: Any) -> bool:
    """Test for a type whose making does nothing beyond it."""
    is_type = isinstance(kind, type)
    return is_type and (is_dataclass(kind) or issubclass(kind, (Enum, MeshVolume)))


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        _, is_ours, within = module.rpartition(".engine.")
        if is_ours and "." not in name:
            found = getattr(import_module(f"{_ENGINE}.{within}"), name, None)
            if _is_plain(found) and found.__module__ == f"{_ENGINE}.{within}":
                return found
        if f"{module}.{name}" in _PLAIN:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is no plain data")
