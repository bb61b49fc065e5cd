# SPDX-License-Identifier: GPL-3.0-or-later
"""User interface: menus, panels and gizmos.

Registered for each module: classes, then the function ``register``. ``bl_order`` sorts the panels.
"""

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
