# SPDX-License-Identifier: GPL-3.0-or-later
"""User interface: menus, panels and gizmos.

A module that has ``register`` and ``unregister`` is registered; panels are ordered by ``bl_order``.
"""

from __future__ import annotations

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
