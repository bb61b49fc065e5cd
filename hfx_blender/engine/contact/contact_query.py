# SPDX-License-Identifier: GPL-3.0-or-later
"""Query of the contacts of one volume with one body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arrays import I64, Bool
from ..counters import Counters
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..volume.shape import Falloff
from .reachable_bounds import ReachableBounds

if TYPE_CHECKING:
    from concurrent.futures import Executor


@dataclass(frozen=True, eq=False)
class ContactQuery:
    """One volume and one body at some rows of a block, and what is asked about their contacts."""

    effect: EffectBlock  # of a volume
    falloff: Falloff
    skin: BodySkin
    pose: PoseBlock
    bounds: ReachableBounds
    counters: Counters
    rows: I64  # (n,) at which the volume is active, ascending, a subset of ``bounds.rows``
    follows: Bool  # (n,) the row before is the sample before: what passed in between is felt, too
    reported: Bool  # (n,) the others are only there to be followed from
    own_sets: bool = False  # rows share no vertex sets
    with_details: bool = False  # places of contacts
    with_impact: bool = False  # how contacts began, however slowly
    threads: Executor | None = None  # for the compiled part, which works while this one goes on
    title: str = "a volume"  # in warnings

    @property
    def asks_details(self) -> bool:
        """Test for anything that needs :class:`.contact_details.Details`."""
        return self.with_details or self.with_impact
