# SPDX-License-Identifier: GPL-3.0-or-later
"""User actions: thin operators over plain functions, one file a topic.

Each module is registered: its classes, and what its ``register`` does.
"""

from __future__ import annotations

from ..blender import registration

register, unregister = registration.of_package(__name__, __path__)
