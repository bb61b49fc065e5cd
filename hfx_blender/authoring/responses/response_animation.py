# SPDX-License-Identifier: GPL-3.0-or-later
"""Animation of filters: it names them by their place in the stack, so it moves along with them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import bpy

from ...blender import compat

PATH = re.compile(r"hfx\.response\[(\d+)\]\.(\w+)$")


def renumber(effect: bpy.types.Object, order: Sequence[int | None]) -> None:
    """Rename curves and drivers to follow their filters.

    Parameters
    ----------
    order : sequence of int or None
        The new place of the filter that was at each place; None: it is gone, and so is its
        animation.
    """
    data = effect.animation_data
    if data is None:
        return
    for curves in (data.drivers, *compat.curve_collections(effect)):
        for curve in list(curves):
            match = PATH.match(curve.data_path)
            if match is None or int(match[1]) >= len(order):
                continue
            to = order[int(match[1])]
            if to is None:
                curves.remove(curve)
            else:
                curve.data_path = f"hfx.response[{to}].{match[2]}"
