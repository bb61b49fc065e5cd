# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses of all volumes of a scene: from contacts to samples."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ..arrays import I64, expand
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
from ..volume.shape import world_bounds
from .between_samples import refined
from .grazes import Contacts, may_graze
from .settling import Settling
from .touches import BodyPlaces, Moments


@dataclass(eq=False)
class Answering:
    """Contact responses of a scene's volumes, evaluated block by block."""

    scene: SceneDescription
    settling: Settling = field(default_factory=Settling)
    _places: tuple[ReachableBounds, BodyPlaces] | None = field(init=False, default=None)

    @property
    def memory_s(self) -> float:
        """Largest upper bound of an impact's duration over all responses, seconds; 0 without
        impacts. A part of a scene equals the whole only after evaluation of this time, and one
        sample more, before the part."""
        return max(
            (
                filter_.rings_s
                for effect in self.scene.effects
                if isinstance(effect.area, HapticVolume)
                for filter_ in effect.area.response
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
        """Apply the response of volume ``effect`` to the contacts ``run`` (None: none) with a body;
        None without a sample above 0. ``rows`` with the effect on may include rows of neighbouring
        blocks; samples are those of the own block. ``posed`` are rows with a pose. ``contacts``
        evaluates contacts at moments in between. ``is_clear``: no contact is possible, also not
        between rows. Updates the impacts of the stream."""
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
        # Far from skin at all samples; an impact may still be struck in between.
        if is_far and not may_graze(moments).any():
            self.settling.pass_over(stream, int(block.indices[rows[own[1] - 1]]))
            return None
        is_live = block.live_s is not None
        at_samples = run
        # Contacts of a sample include those since the sample before, each place of the skin at its
        # deepest moment. Impacts weigh moments, so these are found between samples.
        if has_impacts and not is_live and run is not None and math.isfinite(skin.skin.edge_m):
            touched = np.searchsorted(block.indices, run.indices)
            at_samples = contacts(replace(moments, rows=touched), np.zeros(len(touched), np.bool_))
        touches = moments.touches(stream, parameters, at_samples)
        if touches is None:
            return None
        if has_impacts:
            touches = refined(
                *(moments, touches, parameters, run, contacts),
                loud_until_s=self.settling.loud_until_s(stream),
                is_flat=effect.area.falloff.is_flat,
                is_live=is_live,
            )
            # Neighbours served the estimates only: each block settles its own samples.
            touches = touches.part(slice(*own))
        samples = self.settling.settle(touches)
        if samples is None or block.live_s is None:
            return samples
        # Live touches are timed by the clock, their samples by the scene.
        return replace(samples, times_s=self.scene.time.times_s(samples.indices))

    def _places_of(self, bounds: ReachableBounds, skin: BodySkin, pose: PoseBlock) -> BodyPlaces:
        """World positions of a body's clusters in a block, shared by all volumes: cached until
        ``bounds`` is another object."""
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
        """Quick test that a volume without contacts has no samples at ``rows``: no ringing impact,
        and no body box within the largest range of a proximity filter. False if undecided."""
        if self.settling.rings(stream) or len(animated.shapes) != 1 or not len(bounds.rows):
            return False
        assert isinstance(effect.area, HapticVolume) and animated.response is not None
        reaches = [
            float(animated.response[rows, f, 1].max())
            for f, filter_ in enumerate(effect.area.response)
            if filter_.kind is FilterKind.PROXIMITY
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
    """Run with a separate vertex set for each sample (``sets`` None): a copy, unless already so."""
    if run.sets is None:
        return run
    entries, _ = expand(run.offsets, run.sets)
    offsets = np.concatenate([[0], np.cumsum(run.sizes)]).astype(np.int64)
    vertices, weights = run.vertices[entries], run.weights[entries]
    return replace(run, sets=None, offsets=offsets, vertices=vertices, weights=weights)


def at_vertices_of(
    samples: SampleRun, contacts: SampleRun | None, name: str, *width: int
) -> npt.NDArray[np.float32]:
    """Column ``name`` (total, *width) of ``contacts``, of before the response, at the vertices of
    ``samples``, which have separate sets; 0 without contact there, or if ``contacts`` is None."""
    values = np.zeros((len(samples.vertices), *width), np.float32)
    column = None if contacts is None else getattr(contacts, name)
    if contacts is None or column is None:
        return values
    places = {int(index): k for k, index in enumerate(contacts.indices)}
    for j, index in enumerate(samples.indices.tolist()):
        if index not in places:
            continue
        k = places[index]
        known = slice(int(contacts.offsets[k]), int(contacts.offsets[k + 1]))
        own = slice(int(samples.offsets[j]), int(samples.offsets[j + 1]))
        vertices = contacts.vertices[known]
        at = np.searchsorted(vertices, samples.vertices[own])
        # Behind the last vertex searchsorted gives the length: made a valid index, which does not
        # match.
        at = np.minimum(at, len(vertices) - 1)
        is_known = vertices[at] == samples.vertices[own]
        values[own][is_known] = column[known][at[is_known]]
    return values
