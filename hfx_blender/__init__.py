# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX: a haptic editor for full-body immersive experiences.

Importing this package imports no ``bpy``; :func:`register` does.
"""

from __future__ import annotations

from types import ModuleType

from . import registration

__version__ = "0.1.0"


def _modules() -> tuple[ModuleType, ...]:
    from . import handlers, operators, preferences, properties, ui
    from .playback import live, preview

    return preferences, properties, operators, ui, handlers, preview, live


register, unregister = registration.of_modules(_modules)
