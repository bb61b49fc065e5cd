# SPDX-License-Identifier: GPL-3.0-or-later
"""Laws from the share of an actuator in a phantom sensation to its gain.

Schneider et al., UIST 2015 ("Tactile Animation by Direct Manipulation of Grid Displays"): the
linear, logarithmic and power (Pacinian) variants of barycentric rendering. The text does not
print the logarithmic formula; ours is 0 at 0 and 1 at 1.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from ...arrays import F64

Law = Literal["linear", "log", "power"]
LAWS: Final[tuple[Law, ...]] = ("linear", "log", "power")


def gain(shares: F64, law: Law) -> F64:
    """Gains for shares that sum to 1 at each place, (n, A) -> (n, A).

    ``linear`` keeps the sum of gains, ``power`` the sum of their squares.
    """
    if law == "linear":
        return shares
    if law == "log":
        above_one = 1.0 + shares
        return np.log2(above_one, out=above_one)
    if law == "power":
        return np.sqrt(shares)
    raise ValueError(f"law: expected one of {', '.join(LAWS)}, got '{law}'")
