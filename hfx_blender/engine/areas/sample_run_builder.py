# SPDX-License-Identifier: GPL-3.0-or-later
"""Construction of sample runs, shared by all kinds of areas."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ..active_rows import ActiveEffect
from ..arrays import F32, I32, I64
from ..counters import Counters
from ..modality import MODALITIES
from ..samples import SampleRun, Stream
from ..scene import SceneDescription
from ..skin.bound_skins import BoundSkins
from . import on_demand


class SampleRunBuilder:
    """Builder of the sample runs of a scene; ``record`` has fields of :mod:`.on_demand`."""

    def __init__(
        self, scene: SceneDescription, record: frozenset[str], skins: BoundSkins, counters: Counters
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
        active: ActiveEffect,
        body_id: str,
        *,
        sets: I64,
        offsets: I64,
        vertices: I32,
        weights: F32,
        **details: Any,
    ) -> SampleRun:
        """Run of an effect on a body at the active rows, with motion if recorded; levels and
        parameters are clipped to the allowed ranges. ``details`` are further fields of
        :class:`SampleRun`. If fields are recorded, ``sets`` must give each row a set of its own,
        and is dropped."""
        effect, animated, rows = active.effect, active.animated, active.rows
        indices = active.block.indices[rows]
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
            **self.motion(active, body_id, vertices, offsets),
            **details,
        )

    def motion(
        self, active: ActiveEffect, body_id: str, vertices: I32, offsets: I64
    ) -> dict[str, Any]:
        """Recorded fields among "positions" and "velocities" (total, 3), world space.

        Row ``k`` of the active rows has ``vertices[offsets[k]:offsets[k + 1]]``. See
        :func:`on_demand.motion`.
        """
        if not self.wants_motion:
            return {}
        if len(vertices):
            k = self.body_index[body_id]
            skin = self.skins.of(self.scene.bodies[k], active.effect.model_id).vertices
            self.counters.vertices_posed += len(vertices)
            positions, velocities = on_demand.motion(
                skin,
                active.block.poses[k],
                active.rows,
                [vertices[a:b] for a, b in pairwise(offsets)],
                active.block.indices,
                1.0 / float(self.scene.time.rate_hz),
                with_velocities="velocities" in self.record,
            )
        else:
            positions = velocities = np.zeros((0, 3), np.float32)
        columns = {"positions": positions, "velocities": velocities}
        return {name: column for name, column in columns.items() if name in self.record}
