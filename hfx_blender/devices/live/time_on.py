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
from typing import Final

import numpy as np

from ...engine.arrays import F64, Bool
from ...engine.rendering.device import ActuatorType

UNSURE_S: Final = 0.05
"""A step of unknown length counts so much where an actuator is on: a clock may stand still."""

_MOST_FILLED: Final = 10.0  # after a stall; whatever has rested ten times as long has cooled
_ROUNDING: Final = 1e-9


class Account:
    """Accounts of one physical device, which outlive its connections.

    Parameters
    ----------
    filled : sequence of float
        How full each actuator's account is; 1 is full.
    is_resting : sequence of bool
        Whether each has to rest until it is empty.
    others : float
        How full those are that are not named.
    idle_since_s : float
        Since when nobody has played, by the clock of the output process.
    unknown_s : float
        So much longer each may have been on before that.
    """

    def __init__(
        self,
        filled: Sequence[float] = (),
        is_resting: Sequence[bool] = (),
        *,
        others: float = 0.0,
        idle_since_s: float = np.inf,
        unknown_s: float = 0.0,
    ) -> None:
        self.lock = threading.Lock()
        self.filled: F64 = np.array(filled, np.float64)
        self.is_resting: Bool = np.array(is_resting, np.bool_)
        self._others = others
        self.idle_since_s = idle_since_s
        self.unknown_s = unknown_s
        self.on_begin: Callable[[], None] = _no_callback
        self.players: dict[TimeOn, Bool] = {}  # players, and the actuators that each has on

    def fit(self, count: int) -> None:
        """Resize to the number of actuators."""
        more = count - len(self.filled)
        if more > 0:
            self.filled = np.append(self.filled, np.full(more, self._others))
            self.is_resting = np.append(self.is_resting, np.full(more, self._others >= 1.0))

    def is_on_for_others(self, player: TimeOn, count: int) -> Bool:
        """Mask (count,) of actuators that another player has on."""
        found = np.zeros(count, np.bool_)
        for other, is_on in self.players.items():
            if other is not player:
                shared = min(count, len(is_on))
                found[:shared] |= is_on[:shared]
        return found


class TimeOn:
    """Use of a device's accounts by one connection.

    Parameters
    ----------
    kinds : sequence of ActuatorType
        Of the A actuators.
    accounts : sequence of Account
        Every one is filled, and the fullest decides. None: an account of its own.
    """

    def __init__(self, kinds: Sequence[ActuatorType], accounts: Sequence[Account] = ()) -> None:
        self._count = len(kinds)
        maximum_on_s = np.array([kind.maximum_on_s for kind in kinds], np.float64)
        rest_s = np.array([kind.rest_s for kind in kinds], np.float64)
        self.is_limited = bool(np.isfinite(maximum_on_s).any())
        self._fills_per_s = 1.0 / maximum_on_s
        with np.errstate(divide="ignore"):
            self._empties_per_s = 1.0 / rest_s
        self._accounts = tuple(accounts) or (Account(),)
        self._lock = threading.Lock()  # a stop comes from a thread of its own
        self._is_on = np.zeros(self._count, np.bool_)
        self._paid_s = np.zeros(self._count)  # ahead, for the actuators that are on now

    def record_rest(self, now_s: float) -> None:
        """Record the time until ``now_s`` as rest, since the last player fell silent."""
        with self._lock:
            for account in self._accounts:
                with account.lock:
                    account.fit(self._count)
                    everything = np.ones(self._count, np.bool_)
                    self._fill(account, everything, account.unknown_s)
                    account.unknown_s = 0.0
                    if not account.players:
                        self._empty(account, ~everything, now_s - account.idle_since_s)
                        account.idle_since_s = now_s

    def begin(self) -> None:
        """Play from now on, from silence; nothing is forgotten."""
        with self._lock:
            self._is_on = np.zeros(self._count, np.bool_)
            self._paid_s = np.zeros(self._count)
            for account in self._accounts:
                with account.lock:
                    account.fit(self._count)
                    account.players[self] = self._is_on
                account.on_begin()

    def end(self, played_s: float, now_s: float) -> None:
        """Record silence from now on, after ``played_s`` more of the last values."""
        with self._lock:
            for account in self._accounts:
                with account.lock:
                    if account.players.pop(self, None) is None:
                        continue
                    self._fill(account, self._is_on, played_s)
                    if not account.players:
                        account.idle_since_s = now_s
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
        for account in self._accounts:
            with account.lock:
                account.fit(self._count)
                self._fill(account, self._is_on, np.maximum(length_s - self._paid_s, 0.0))
                would_be = account.filled[: self._count] + length_s * self._fills_per_s
                is_resting = account.is_resting[: self._count]
                is_resting |= wants_on & (would_be > 1.0 + _ROUNDING)
                held |= is_resting
        is_on = wants_on & ~held
        for account in self._accounts:
            with account.lock:
                self._fill(account, is_on, length_s)
                account.players.setdefault(self, is_on)
                if next(iter(account.players)) is self:  # time passes once for all who play
                    self._empty(account, self._is_on | is_on, step_s)
                account.players[self] = is_on
        self._is_on = is_on
        self._paid_s = np.where(is_on, length_s, 0.0)
        return held

    def _fill(self, account: Account, is_on: Bool, length_s: float | F64) -> None:
        filled = account.filled[: self._count]
        filled += np.where(is_on, length_s * self._fills_per_s, 0.0)
        np.minimum(filled, _MOST_FILLED, out=filled)

    def _empty(self, account: Account, is_on: Bool, length_s: float) -> None:
        if not length_s > 0.0:
            return
        filled, is_resting = account.filled[: self._count], account.is_resting[: self._count]
        rests = ~is_on & ~account.is_on_for_others(self, self._count)
        with np.errstate(over="ignore"):
            filled -= np.where(rests, np.minimum(length_s * self._empties_per_s, filled), 0.0)
        filled[filled < _ROUNDING] = 0.0
        is_resting &= filled > 0.0


def _no_callback() -> None:
    """Do nothing: the default of callbacks."""
