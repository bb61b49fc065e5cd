# SPDX-License-Identifier: GPL-3.0-or-later
"""Time on: an account for each actuator that being on fills and nothing but rest empties.

It is full after ``maximum_on_s`` of being on, and empty again ``rest_s`` of rest later; a shorter
rest empties it by its share. A full one rests until it is empty. So an actuator is never on for
longer than ``maximum_on_s`` at a stretch, nor in any time t for more than
``D t + (1 - D) maximum_on_s`` with ``D = maximum_on_s / (maximum_on_s + rest_s)``.

How strongly it is on makes no difference. What is not known is never taken for rest.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ...engine.arrays import F64, I64, Bool
from ...engine.rendering.device import ActuatorType

UNSURE_S: Final = 0.05
"""A step of unknown length counts so much where an actuator is on: a clock may stand still."""

_MOST_FILLED: Final = 10.0  # after a stall; whatever has rested ten times as long has cooled
_ROUNDING: Final = 1e-9


class Account:
    """Accounts of one physical device, which outlive its connections: one a slot.

    A slot is a physical actuator, by whatever number a configuration knows it.

    Parameters
    ----------
    filled : sequence of float
        How full each slot's account is; 1 is full.
    is_resting : sequence of bool
        Whether each has to rest until it is empty.
    names : sequence of str, optional
        Of the slots; by default numbers from 0.
    idle_s : sequence of float
        For how long each had rested by ``idle_since_s``, not yet counted.
    unknown_s : sequence of float
        So much longer each may have been on before that.
    others : float
        How full those are that are not named.
    idle_since_s : float
        Since when nobody has played, by the clock of the output process.
    """

    def __init__(
        self,
        filled: Sequence[float] = (),
        is_resting: Sequence[bool] = (),
        *,
        names: Sequence[str] = (),
        idle_s: Sequence[float] = (),
        unknown_s: Sequence[float] = (),
        others: float = 0.0,
        idle_since_s: float = np.inf,
    ) -> None:
        self.lock = threading.Lock()
        self.filled: F64 = np.array(filled, np.float64)
        self.is_resting: Bool = np.array(is_resting, np.bool_)
        self.idle_since_s: F64 = idle_since_s - np.array(idle_s, np.float64)
        self.unknown_s: F64 = np.array(unknown_s, np.float64)
        self.slots = {name: slot for slot, name in enumerate(names)}
        self._others, self._others_since_s = others, idle_since_s
        self.on_begin: Callable[[], None] = _no_callback
        self.players: dict[TimeOn, Slots] = {}

    def slots_of(self, names: Sequence[str]) -> I64:
        """Slots (A,) by their names; new ones are made."""
        for name in names:
            self.slots.setdefault(name, len(self.slots))
        more = len(self.slots) - len(self.filled)
        self.filled = np.append(self.filled, np.full(more, self._others))
        self.is_resting = np.append(self.is_resting, np.full(more, self._others >= 1.0))
        self.idle_since_s = np.append(self.idle_since_s, np.full(more, self._others_since_s))
        self.unknown_s = np.append(self.unknown_s, np.zeros(more))
        return np.array([self.slots[name] for name in names], np.int64)

    def is_used_before(self, player: TimeOn | None) -> Bool:
        """Mask (slots,) of those of players that began before one; None: of all."""
        found = np.zeros(len(self.filled), np.bool_)
        for other, slots in self.players.items():
            if other is player:
                break
            found[slots.own] = True
        return found

    def is_on_for_others(self, player: TimeOn) -> Bool:
        """Mask (slots,) of those that another player has on."""
        found = np.zeros(len(self.filled), np.bool_)
        for other, slots in self.players.items():
            if other is not player:
                found[slots.on] = True
        return found


class Slots(NamedTuple):
    """Slots of a player in an account: all of its actuators, and those that are on."""

    own: I64
    on: I64


class AccountUse(NamedTuple):
    """Account of a device, and the name of the slot of each actuator in it."""

    account: Account
    names: Sequence[str]


class TimeOn:
    """Use of a device's accounts by one connection.

    Parameters
    ----------
    kinds : sequence of ActuatorType
        Of the A actuators.
    uses : sequence of AccountUse
        Every account is filled, and the fullest decides. None: an account of its own.
    """

    def __init__(self, kinds: Sequence[ActuatorType], uses: Sequence[AccountUse] = ()) -> None:
        self._count = len(kinds)
        maximum_on_s = np.array([kind.maximum_on_s for kind in kinds], np.float64)
        rest_s = np.array([kind.rest_s for kind in kinds], np.float64)
        self.is_limited = bool(np.isfinite(maximum_on_s).any())
        self._fills_per_s = 1.0 / maximum_on_s
        with np.errstate(divide="ignore"):
            self._empties_per_s = 1.0 / rest_s
        self._accounts: list[tuple[Account, I64]] = []  # with the slots of the A actuators
        for account, names in uses or (own_use(self._count),):
            with account.lock:
                self._accounts.append((account, account.slots_of(names)))
        self._lock = threading.Lock()  # a stop comes from a thread of its own
        self._is_on = np.zeros(self._count, np.bool_)
        self._paid_s = np.zeros(self._count)  # ahead, for the actuators that are on now

    def record_rest(self, now_s: float) -> None:
        """Record the time until ``now_s`` as rest, since the last player fell silent."""
        with self._lock:
            everything = np.ones(self._count, np.bool_)
            for account, slots in self._accounts:
                with account.lock:
                    self._fill(account, slots, everything, account.unknown_s[slots])
                    account.unknown_s[slots] = 0.0
                    is_idle = ~account.is_used_before(None)[slots]
                    self._empty(
                        account, slots[is_idle], now_s - account.idle_since_s[slots], is_idle
                    )
                    account.idle_since_s[slots[is_idle]] = now_s

    def begin(self) -> None:
        """Play from now on, from silence; nothing is forgotten."""
        with self._lock:
            self._is_on = np.zeros(self._count, np.bool_)
            self._paid_s = np.zeros(self._count)
            for account, slots in self._accounts:
                with account.lock:
                    account.players[self] = Slots(slots, slots[:0])
                account.on_begin()

    def end(self, played_s: float, now_s: float) -> None:
        """Record silence from now on, after ``played_s`` more of the last values."""
        with self._lock:
            for account, slots in self._accounts:
                with account.lock:
                    if account.players.pop(self, None) is None:
                        continue
                    self._fill(account, slots, self._is_on, played_s)
                    account.idle_since_s[slots[~account.is_used_before(None)[slots]]] = now_s
            self._is_on = np.zeros(self._count, np.bool_)

    def held_off(self, wants_on: Bool, step_s: float) -> Bool:
        """Actuators (A,) that may not be on now.

        A step counts as on if it begins or ends so, as rest if it does neither.

        Parameters
        ----------
        wants_on : (A,)
        step_s : float
            Time since the last call; 0 is unknown.
        """
        if not self.is_limited:
            return np.zeros(self._count, np.bool_)
        with self._lock:
            return self._held_off(wants_on, step_s)

    def _held_off(self, wants_on: Bool, step_s: float) -> Bool:
        length_s = step_s if step_s > 0.0 else UNSURE_S
        held = np.zeros(self._count, np.bool_)
        for account, slots in self._accounts:
            with account.lock:
                self._fill(account, slots, self._is_on, np.maximum(length_s - self._paid_s, 0.0))
                would_be = account.filled[slots] + length_s * self._fills_per_s
                is_full = wants_on & (would_be > 1.0 + _ROUNDING)
                account.is_resting[slots[is_full]] = True
                held |= account.is_resting[slots]
        is_on = wants_on & ~held
        for account, slots in self._accounts:
            with account.lock:
                self._fill(account, slots, is_on, length_s)
                account.players.setdefault(self, Slots(slots, slots[is_on]))
                is_busy = account.is_on_for_others(self)
                is_busy[slots[self._is_on | is_on]] = True
                # Time passes once for all who play with a slot.
                is_busy |= account.is_used_before(self)
                rests = ~is_busy[slots]
                self._empty(account, slots[rests], np.full(self._count, step_s), rests)
                account.players[self] = Slots(slots, slots[is_on])
        self._is_on = is_on
        self._paid_s = np.where(is_on, length_s, 0.0)
        return held

    def _fill(self, account: Account, slots: I64, is_on: Bool, length_s: float | F64) -> None:
        filled = account.filled
        # Several actuators may share a slot.
        np.add.at(filled, slots, np.where(is_on, length_s * self._fills_per_s, 0.0))
        np.minimum(filled, _MOST_FILLED, out=filled)

    def _empty(self, account: Account, slots: I64, length_s: F64, rests: Bool) -> None:
        """Empty slots, those of the actuators that rest; a length that is no time is no rest."""
        length_s = np.where(length_s[rests] > 0.0, length_s[rests], 0.0)
        with np.errstate(over="ignore", invalid="ignore"):
            less = length_s * self._empties_per_s[rests]
        less[~(less > 0.0)] = 0.0
        filled = account.filled[slots] - np.minimum(less, account.filled[slots])
        account.filled[slots] = np.where(filled < _ROUNDING, 0.0, filled)
        account.is_resting[slots] &= account.filled[slots] > 0.0


def own_use(count: int) -> AccountUse:
    """New account of nobody else, for a number of actuators."""
    return AccountUse(Account(), [str(number) for number in range(count)])


def _no_callback() -> None:
    """Do nothing: the default of callbacks."""
