# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: user actions, thin wrappers of plain functions, a file for each topic.

Registered for each module: classes, then the function ``register``.
"""

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
