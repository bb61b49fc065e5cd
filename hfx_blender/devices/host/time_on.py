# SPDX-License-Identifier: GPL-3.0-or-later
"""Limit of time on: a duty budget for each actuator, whose load rises while on and falls at rest.

The load reaches 1 after ``maximum_on_s`` of being on, and returns to 0 after ``rest_s`` of rest; a
shorter rest lowers the load proportionally. At load 1 the actuator has to cool until load 0. So an
actuator is never on for longer than ``maximum_on_s`` without a break, and within any time t for at
most ``D t + (1 - D) maximum_on_s`` with ``D = maximum_on_s / (maximum_on_s + rest_s)``.

The strength does not matter: any value but silence is on. Time of unknown use counts as on.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ...engine.arrays import F64, I64, Bool
from ...engine.rendering.device_config import ActuatorType

UNSURE_S: Final = 0.05
"""Assumed length of a step of unknown length while an actuator is on, seconds: a clock may stand
still."""

# Upper bound of a load, which a stall may reach; after ten full rests an actuator has cooled.
_LARGEST_LOAD: Final = 10.0
_ROUNDING: Final = 1e-9


class DutyBudget:
    """Duty budgets of all slots of a physical device, kept between connections.

    A slot is a physical actuator; several configurations may number the same slot differently.
    Sequences have an entry for each slot. :attr:`lock` has to be held for all access.

    ``load``: 0 rested, 1 exhausted.
    ``is_cooling``: True for a slot that has to stay silent until load 0.
    ``names``: names of the slots.
    ``idle_s``: rest before ``idle_since_s`` that has not been counted, seconds.
    ``unknown_s``: time before ``idle_since_s`` in which the slot may have been on, seconds.
    ``others``: load of slots that are not in ``names``; such slots have to cool at 1.
    ``idle_since_s``: time of the last silence by the output process's clock; inf: not known.
    """

    def __init__(
        self,
        load: Sequence[float] = (),
        is_cooling: Sequence[bool] = (),
        *,
        names: Sequence[str] = (),
        idle_s: Sequence[float] = (),
        unknown_s: Sequence[float] = (),
        others: float = 0.0,
        idle_since_s: float = np.inf,
    ) -> None:
        self.lock = threading.Lock()
        self.load: F64 = np.array(load, np.float64)
        self.is_cooling: Bool = np.array(is_cooling, np.bool_)
        self.idle_since_s: F64 = idle_since_s - np.array(idle_s, np.float64)
        self.unknown_s: F64 = np.array(unknown_s, np.float64)
        self.slots = {name: slot for slot, name in enumerate(names)}
        self._others, self._others_since_s = others, idle_since_s
        self.on_begin: Callable[[], None] = lambda: None
        self.players: dict[TimeOn, Slots] = {}

    def slots_of(self, names: Sequence[str]) -> I64:
        """Slot numbers (A,) of ``names``; unknown names become slots with the load ``others``."""
        for name in names:
            self.slots.setdefault(name, len(self.slots))
        # Slots unknown so far have the load `others`: 1 after a damaged file, else rested.
        more = len(self.slots) - len(self.load)
        self.load = np.append(self.load, np.full(more, self._others))
        self.is_cooling = np.append(self.is_cooling, np.full(more, self._others >= 1.0))
        self.idle_since_s = np.append(self.idle_since_s, np.full(more, self._others_since_s))
        self.unknown_s = np.append(self.unknown_s, np.zeros(more))
        return np.array([self.slots[name] for name in names], np.int64)

    def is_used_before(self, player: "TimeOn | None") -> Bool:
        """Mask (slots,) of slots used by players that started before ``player``; None: by any."""
        is_used = np.zeros(len(self.load), np.bool_)
        for earlier, slots in self.players.items():
            if earlier is player:
                break
            is_used[slots.own] = True
        return is_used

    def is_on_for_others(self, player: "TimeOn") -> Bool:
        """Mask (slots,) of slots whose actuators are on now for players other than ``player``."""
        is_on = np.zeros(len(self.load), np.bool_)
        for playing, slots in self.players.items():
            if playing is not player:
                is_on[slots.on] = True
        return is_on


class Slots(NamedTuple):
    """Slot numbers of a player in a budget: of all actuators, and of actuators that are on."""

    own: I64
    on: I64


class BudgetUse(NamedTuple):
    """Budget of a device, and the slot names of A actuators; names may repeat."""

    budget: DutyBudget
    names: Sequence[str]


class TimeOn:
    """Use of a device's duty budgets by a connection, called a *player* of the budgets.

    ``kinds``: types of the A actuators.
    ``uses``: budgets that are all charged, and each of which can block an actuator. Empty: a new
    budget of this object.
    """

    def __init__(self, kinds: Sequence[ActuatorType], uses: Sequence[BudgetUse] = ()) -> None:
        self._count = len(kinds)
        maximum_on_s = np.array([kind.maximum_on_s for kind in kinds], np.float64)
        rest_s = np.array([kind.rest_s for kind in kinds], np.float64)
        self.is_limited = bool(np.isfinite(maximum_on_s).any())
        self._fills_per_s = 1.0 / maximum_on_s
        with np.errstate(divide="ignore"):
            self._empties_per_s = 1.0 / rest_s
        self._budgets: list[tuple[DutyBudget, I64]] = []  # slot numbers of the A actuators
        # Without given uses, a new budget with a slot for each actuator.
        own = BudgetUse(DutyBudget(), [str(number) for number in range(self._count)])
        # Names become slot numbers once, as budgets are charged at every step.
        for budget, names in uses or (own,):
            with budget.lock:
                self._budgets.append((budget, budget.slots_of(names)))
        self._lock = threading.Lock()  # the stop thread calls end()
        self._is_on = np.zeros(self._count, np.bool_)
        self._paid_s = np.zeros(self._count)  # time on from now that the load includes already

    def record_rest(self, now_s: float) -> None:
        """Record the time from the last silence of any player to ``now_s`` as rest.

        Time of unknown use before that is charged first. Slots in use by players now do not
        rest.
        """
        with self._lock:
            everything = np.ones(self._count, np.bool_)
            for budget, slots in self._budgets:
                with budget.lock:
                    # Unknown use lies before the rest, so the order of both matters.
                    self._fill(budget, slots, everything, budget.unknown_s[slots])
                    budget.unknown_s[slots] = 0.0
                    is_idle = ~budget.is_used_before(None)[slots]
                    self._empty(budget, slots[is_idle], now_s - budget.idle_since_s[slots], is_idle)
                    budget.idle_since_s[slots[is_idle]] = now_s

    def begin(self) -> None:
        """Register as a player of all budgets, with all actuators silent; loads stay.

        Calls ``on_begin`` of each budget, which saves the budget.
        """
        with self._lock:
            self._is_on = np.zeros(self._count, np.bool_)
            self._paid_s = np.zeros(self._count)
            for budget, slots in self._budgets:
                with budget.lock:
                    budget.players[self] = Slots(slots, slots[:0])
                budget.on_begin()

    def end(self, played_s: float, now_s: float) -> None:
        """Charge another ``played_s`` of the last values; rest begins at ``now_s`` for slots
        without another player. Ends the use: a repeated call changes nothing until :meth:`begin`.
        """
        with self._lock:
            for budget, slots in self._budgets:
                with budget.lock:
                    # Both the stop thread and the device thread end a use; the first counts.
                    if budget.players.pop(self, None) is None:
                        continue
                    self._fill(budget, slots, self._is_on, played_s)
                    budget.idle_since_s[slots[~budget.is_used_before(None)[slots]]] = now_s
            self._is_on = np.zeros(self._count, np.bool_)

    def blocked(self, is_requested: Bool, step_s: float) -> Bool:
        """Charge the last step and the coming one; mask (A,) of actuators that have to be silent.

        An actuator is blocked from the step that would exceed load 1 until load 0. Without limited
        actuators nothing is charged.
        A step counts as on if the actuator is on at the start or the end of the step, else as rest.

        ``is_requested`` (A,) bool: actuators to be on from now to the next call.
        ``step_s``: time since the last call, seconds; 0: not known.
        """
        is_blocked = np.zeros(self._count, np.bool_)
        if not self.is_limited:
            return is_blocked
        length_s = step_s if step_s > 0.0 else UNSURE_S
        with self._lock:
            # Two passes: an actuator blocked by one budget is off, and charges no other budget.
            for budget, slots in self._budgets:
                with budget.lock:
                    # The last step is charged in advance; a longer step costs the difference.
                    self._fill(budget, slots, self._is_on, np.maximum(length_s - self._paid_s, 0.0))
                    # Blocked already if the load would exceed 1 within the coming step.
                    would_be = budget.load[slots] + length_s * self._fills_per_s
                    is_exhausted = is_requested & (would_be > 1.0 + _ROUNDING)
                    budget.is_cooling[slots[is_exhausted]] = True
                    is_blocked |= budget.is_cooling[slots]
            is_on = is_requested & ~is_blocked
            for budget, slots in self._budgets:
                with budget.lock:
                    self._fill(budget, slots, is_on, length_s)
                    # A use that was ended by a stop in between begins again with these values.
                    budget.players.setdefault(self, Slots(slots, slots[is_on]))
                    is_busy = budget.is_on_for_others(self)
                    is_busy[slots[self._is_on | is_on]] = True
                    # Only the first of several players of a slot counts rest: no time counts twice.
                    is_busy |= budget.is_used_before(self)
                    rests = ~is_busy[slots]
                    self._empty(budget, slots[rests], np.full(self._count, step_s), rests)
                    budget.players[self] = Slots(slots, slots[is_on])
            self._is_on = is_on
            self._paid_s = np.where(is_on, length_s, 0.0)
        return is_blocked

    def _fill(self, budget: DutyBudget, slots: I64, is_on: Bool, length_s: float | F64) -> None:
        """Raise in place the load of slots (A,) of actuators in the mask ``is_on`` by ``length_s``,
        (A,) or scalar, divided by ``maximum_on_s``; at most 10."""
        load = budget.load
        # add.at, as several actuators may share a slot.
        np.add.at(load, slots, np.where(is_on, length_s * self._fills_per_s, 0.0))
        np.minimum(load, _LARGEST_LOAD, out=load)

    def _empty(self, budget: DutyBudget, slots: I64, length_s: F64, rests: Bool) -> None:
        """Lower the load in place by ``length_s`` (A,) of rest divided by ``rest_s``; none for 0,
        negative or NaN. ``slots`` belong to the actuators in the mask ``rests`` (A,), in order.
        Load 0 ends their cooling."""
        # Comparisons are False for NaN: a step of unknown length is no rest.
        length_s = np.where(length_s[rests] > 0.0, length_s[rests], 0.0)
        with np.errstate(over="ignore", invalid="ignore"):
            less = length_s * self._empties_per_s[rests]
        less[~(less > 0.0)] = 0.0
        load = budget.load[slots] - np.minimum(less, budget.load[slots])
        budget.load[slots] = np.where(load < _ROUNDING, 0.0, load)
        budget.is_cooling[slots] &= budget.load[slots] > 0.0
