# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample runs: their construction, shared by all kinds of areas."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..arrays import F32, I32, I64
from ..counters import Counters
from ..modality import MODALITIES
from ..samples import Impact, SampleRun, Stream
from ..scene import AnimationBlock, EffectBlock, EffectDescription, PoseBlock, SceneDescription
from ..skin.bound_skins import BoundSkins
from ..skin.posing import PosableModel
from . import on_demand


class SampleRunBuilder:
    """Builder of one scene's sample runs.

    Parameters
    ----------
    record : frozenset of str
        What samples carry besides vertices and weights.
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
        """Test for recorded positions or velocities."""
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
        positions: F32 | None,
        velocities: F32 | None,
        depth_m: F32 | None = None,
        surface: F32 | None = None,
        surface_normals: F32 | None = None,
        impact: Impact | None = None,
    ) -> SampleRun:
        """A run of an effect on a body at some rows of a block; see :class:`SampleRun`."""
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
            positions=positions if "positions" in self.record else None,
            velocities=velocities if "velocities" in self.record else None,
            depth_m=depth_m,
            surface=surface,
            surface_normals=surface_normals,
            impact=impact,
        )

    def motion(
        self,
        model: PosableModel,
        pose: PoseBlock,
        rows: I64,
        vertices: I32,
        offsets: I64,
        indices: I64,
    ) -> tuple[F32 | None, F32 | None]:
        """World positions and velocities (total, 3) of touched vertices; None if not wanted.

        Row ``k`` of ``rows`` touches ``vertices[offsets[k]:offsets[k + 1]]``; ``indices`` are
        the samples of the block. See :func:`on_demand.motion`.
        """
        if not self.wants_motion:
            return None, None
        self.counters.vertices_posed += len(vertices)
        return on_demand.motion(
            model,
            pose,
            rows,
            [vertices[a:b] for a, b in pairwise(offsets)],
            indices,
            1.0 / float(self.scene.time.rate_hz),
            with_velocities="velocities" in self.record,
        )
