# SPDX-License-Identifier: GPL-3.0-or-later
"""Construction of sample runs, shared by all kinds of areas."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ..arrays import F32, I32, I64
from ..counters import Counters
from ..modality import MODALITIES
from ..samples import SampleRun, Stream
from ..scene import AnimationBlock, EffectBlock, EffectDescription, SceneDescription
from ..skin.bound_skins import BoundSkins
from . import on_demand


class SampleRunBuilder:
    """Builder of the sample runs of a scene.

    Parameters
    ----------
    record : frozenset of str
        Optional fields to record, see :mod:`.on_demand`.
    """

    def __init__(
        self,
        scene: SceneDescription,
        record: frozenset[str],
        skins: BoundSkins,
        counters: Counters,
    ) -> None:
        self.scene = scene
        self.record = record
        self.skins = skins
        self.counters = counters
        self.body_index = {body.id: i for i, body in enumerate(scene.bodies)}

    @property
    def wants_motion(self) -> bool:
        """True if positions or velocities are recorded."""
        return bool(self.record & {"positions", "velocities"})

    def run(
        self,
        effect: EffectDescription,
        body_id: str,
        animated: EffectBlock,
        rows: I64,
        block: AnimationBlock,
        *,
        sets: I64,
        offsets: I64,
        vertices: I32,
        weights: F32,
        **details: Any,
    ) -> SampleRun:
        """Run of an effect on a body at some rows of a block, with motion if recorded.

        ``details`` are further fields of :class:`SampleRun`; levels and parameters are clipped to
        their ranges.
        """
        indices = block.indices[rows]
        least, largest = MODALITIES[effect.modality].limits
        return SampleRun(
            stream=Stream(effect.id, body_id, effect.modality, effect.model_id),
            indices=indices,
            times_s=self.scene.time.times_s(indices),
            levels=np.minimum(np.maximum(animated.levels[rows], 0.0), 1.0),
            parameters=np.minimum(np.maximum(animated.parameters[rows], least), largest),
            sets=None if self.record else sets,
            offsets=offsets,
            vertices=vertices,
            weights=weights,
            **self.motion(effect, body_id, rows, vertices, offsets, block),
            **details,
        )

    def motion(
        self,
        effect: EffectDescription,
        body_id: str,
        rows: I64,
        vertices: I32,
        offsets: I64,
        block: AnimationBlock,
    ) -> dict[str, Any]:
        """Recorded fields among "positions" and "velocities" (total, 3), world space.

        Row ``k`` of ``rows`` has ``vertices[offsets[k]:offsets[k + 1]]``. See
        :func:`on_demand.motion`.
        """
        if not self.wants_motion:
            return {}
        if len(vertices):
            k = self.body_index[body_id]
            skin = self.skins.of(self.scene.bodies[k], effect.model_id).vertices
            self.counters.vertices_posed += len(vertices)
            positions, velocities = on_demand.motion(
                skin,
                block.poses[k],
                rows,
                [vertices[a:b] for a, b in pairwise(offsets)],
                block.indices,
                1.0 / float(self.scene.time.rate_hz),
                with_velocities="velocities" in self.record,
            )
        else:
            positions = velocities = np.zeros((0, 3), np.float32)
        columns = {"positions": positions, "velocities": velocities}
        return {name: column for name, column in columns.items() if name in self.record}
