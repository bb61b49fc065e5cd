# SPDX-License-Identifier: GPL-3.0-or-later
"""What is felt as colours of one mesh: only where there is something to be seen.

The same colours as ``engine.colouring`` gives, with all effects of a modality spread at once and
arrays that are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..engine.colouring import Colour, Spread, colour_name, overlay, strengths
from ..engine.samples import Sample

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class _Spreading:
    """A model's vertices on a mesh."""

    def __init__(self, spread: Spread, vertex_count: int) -> None:
        self._nearest = [np.ascontiguousarray(column) for column in spread.nearest.T]
        self._shares = [np.ascontiguousarray(c, np.float32) for c in spread.shares.T]
        self._felt = np.zeros(vertex_count, np.float32)
        self._part = np.zeros(len(spread.nearest), np.float32)

    def of(self, samples: Iterable[tuple[Sample, bool]]) -> F32:
        """How strongly the mesh's vertices (A,) feel samples together."""
        felt = self._felt
        felt[:] = 0.0
        for sample, is_contact in samples:
            count = len(sample.vertices)
            here = replace(sample, vertices=np.arange(count, dtype=np.int32))
            felt[sample.vertices] += strengths(here, count, is_contact)
        found = np.zeros(len(self._part), np.float32)
        for nearest, shares in zip(self._nearest, self._shares, strict=True):
            felt.take(nearest, out=self._part, mode="clip")
            self._part *= shares
            found += self._part
        return found


class SkinColours:
    """Colours of one mesh of A vertices.

    Parameters
    ----------
    spreads : mapping of str to (Spread, int)
        By model, with the number of its vertices.
    """

    def __init__(self, spreads: Mapping[str, tuple[Spread, int]]) -> None:
        self._spreading = {model: _Spreading(*each) for model, each in spreads.items()}

    def of(
        self,
        samples: Iterable[Sample],
        contact_effects: frozenset[str],
        palette: Mapping[str, Colour],
    ) -> tuple[I64, F64]:
        """Vertices (N,) that show anything, and their colours and opacities (N, 4)."""
        groups: dict[tuple[str, str], list[tuple[Sample, bool]]] = {}
        for sample in samples:
            if not len(sample.vertices):
                continue
            is_contact = sample.stream.effect_id in contact_effects
            name = colour_name(sample, is_contact)
            groups.setdefault((sample.stream.model_id, name), []).append((sample, is_contact))
        felt: dict[str, F32] = {}
        for (model, name), mine in groups.items():
            here = self._spreading[model].of(mine)
            felt[name] = felt[name] + here if name in felt else here
        if not felt:
            return np.zeros(0, np.int64), np.zeros((0, 4))
        most = np.maximum.reduce(list(felt.values()))
        shown = np.flatnonzero(most > 0.0)
        if not len(shown):
            return shown, np.zeros((0, 4))
        shares = {
            name: np.sqrt(np.minimum(each[shown].astype(np.float64), 1.0))
            for name, each in felt.items()
        }
        return shown, overlay(shares, palette)
