# SPDX-License-Identifier: GPL-3.0-or-later
"""User interface: menus, panels and gizmos.

Each module is registered: its classes, and what its ``register`` does. Panels are ordered by
``bl_order``.
"""

from __future__ import annotations

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
