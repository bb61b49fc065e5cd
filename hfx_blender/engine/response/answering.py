# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses of a whole scene: from the engine's contacts to samples."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..arrays import I64
from ..contact.reachable_bounds import ReachableBounds
from ..modality import MODALITIES
from ..response_filters.controls import FilterKind
from ..samples import SampleRun, Stream
from ..scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
)
from ..skin.cell_coverage import BodySkin
from ..volume.placing_matrix import world_bounds
from .between_samples import refined
from .grazes import Contacts, may_graze
from .settling import Settling
from .touches import BodyPlaces, Moments


@dataclass(eq=False)
class Answering:
    """Applies the responses of a scene's volumes, block after block."""

    scene: SceneDescription
    settling: Settling = field(default_factory=Settling)
    _places: tuple[ReachableBounds, BodyPlaces] | None = field(init=False, default=None)

    @property
    def memory_s(self) -> float:
        """Longest ringing of any response, seconds: evaluate this much time, and one sample more,
        before a part so that the part equals the whole."""
        return max(
            (
                each.rings_s
                for effect in self.scene.effects
                if isinstance(effect.area, HapticVolume)
                for each in effect.area.response
            ),
            default=0.0,
        )

    def answer(
        self,
        effect: EffectDescription,
        body: BodyDescription,
        animated: EffectBlock,
        block: AnimationBlock,
        rows: I64,
        posed: I64,
        skin: BodySkin,
        pose: PoseBlock,
        bounds: ReachableBounds,
        run: SampleRun | None,
        contacts: Contacts,
        *,
        is_clear: bool,
    ) -> SampleRun | None:
        """Apply the response of a volume to its contacts with a body.

        ``rows`` may be of the blocks beside, too: only the block's own are answered. ``is_clear``
        tells that nothing can have been touched between them.
        """
        assert isinstance(effect.area, HapticVolume)
        stream = Stream(effect.id, body.id, effect.modality, effect.model_id)
        own = np.searchsorted(rows, [block.own.start, block.own.stop]).tolist()
        if own[0] == own[1]:
            return None
        has_impacts = effect.area.has_impacts
        is_far = run is None and self._is_far(stream, animated, rows, bounds, effect)
        if is_far and (is_clear or not has_impacts):
            self.settling.pass_over(stream, int(block.indices[rows[own[1] - 1]]))
            return None
        times = block.live_s
        if times is None:
            times = self.scene.time.times_s(block.indices)
        parameters = np.clip(animated.parameters, *MODALITIES[effect.modality].limits)
        moments = Moments(
            animated,
            effect.area.response,
            rows,
            block.indices,
            times,
            posed,
            skin,
            pose,
            bounds,
            self._places_of(bounds, skin, pose),
        )
        if is_far and not may_graze(moments).any():
            self.settling.pass_over(stream, int(block.indices[rows[own[1] - 1]]))
            return None
        touches = moments.touches(stream, parameters, run)
        if touches is None:
            return None
        if has_impacts:
            touches = refined(
                *(moments, touches, parameters, run, contacts),
                loud_until_s=self.settling.loud_until_s(stream),
                is_live=block.live_s is not None,
            )
            touches = touches.part(slice(*own))
        felt = self.settling.settle(touches)
        if felt is None or block.live_s is None:
            return felt
        return replace(felt, times_s=self.scene.time.times_s(felt.indices))

    def _places_of(self, bounds: ReachableBounds, skin: BodySkin, pose: PoseBlock) -> BodyPlaces:
        """Positions of a body's clusters, shared by all volumes of a block."""
        if self._places is None or self._places[0] is not bounds:
            self._places = bounds, BodyPlaces(skin, pose, bounds.rows)
        return self._places[1]

    def _is_far(
        self,
        stream: Stream,
        animated: EffectBlock,
        rows: I64,
        bounds: ReachableBounds,
        effect: EffectDescription,
    ) -> bool:
        """Quick test that a volume which touches nobody cannot be felt; the usual case among
        hundreds."""
        if self.settling.rings(stream) or len(animated.shapes) != 1 or not len(bounds.rows):
            return False
        assert isinstance(effect.area, HapticVolume) and animated.response is not None
        reaches = [
            float(animated.response[rows, f, 1].max())
            for f, each in enumerate(effect.area.response)
            if each.kind is FilterKind.PROXIMITY
        ]
        if not reaches:
            return True
        assert animated.matrices is not None
        boxes = world_bounds(animated.shapes[0], animated.matrices[rows])
        at = np.searchsorted(bounds.rows, rows)
        low = bounds.low[at].min(axis=1) - max(reaches)
        high = bounds.high[at].max(axis=1) + max(reaches)
        meets = (boxes[:, 0] <= high) & (boxes[:, 1] >= low)
        return not meets.all(axis=1).any()


def with_own_sets(run: SampleRun) -> SampleRun:
    """Copy of a run in which each sample has a vertex set of its own."""
    if run.sets is None:
        return run
    parts = [slice(int(a), int(b)) for a, b in pairwise(run.offsets)]
    chosen = [parts[j] for j in run.sets.tolist()]
    return replace(
        run,
        sets=None,
        offsets=np.concatenate([[0], np.cumsum(run.sizes)]).astype(np.int64),
        vertices=np.concatenate([run.vertices[part] for part in chosen]),
        weights=np.concatenate([run.weights[part] for part in chosen]),
    )


def depths_of(felt: SampleRun, contacts: SampleRun | None) -> npt.NDArray[np.float32]:
    """Depths (total,) of samples, each with its own set: 0 without contact.

    ``contacts`` are those that were answered; they hold depths.
    """
    depths = np.zeros(len(felt.vertices), np.float32)
    if contacts is None or contacts.depth_m is None:
        return depths
    places = {int(index): k for k, index in enumerate(contacts.indices)}
    for j, index in enumerate(felt.indices.tolist()):
        if index not in places:
            continue
        k = places[index]
        known = slice(int(contacts.offsets[k]), int(contacts.offsets[k + 1]))
        mine = slice(int(felt.offsets[j]), int(felt.offsets[j + 1]))
        vertices = contacts.vertices[known]
        at = np.searchsorted(vertices, felt.vertices[mine])
        at = np.minimum(at, len(vertices) - 1)
        is_known = vertices[at] == felt.vertices[mine]
        depths[mine] = np.where(is_known, contacts.depth_m[known][at], 0.0)
    return depths
