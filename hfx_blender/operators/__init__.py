# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: user actions, thin wrappers of plain functions, one file for each topic.

Registered for each module: its classes, then its function ``register``.
"""

from __future__ import annotations

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
