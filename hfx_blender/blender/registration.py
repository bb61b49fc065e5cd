# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration of modules with Blender, and unregistration in reverse order."""

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType

import bpy

Registration = tuple[Callable[[], None], Callable[[], None]]
"""Functions ``register`` and ``unregister``."""


def of_package(name: str, path: Iterable[str]) -> Registration:
    """Functions ``register`` and ``unregister`` for all modules of a package, sorted by name.
    ``name`` and ``path`` describe the package; subpackages are included, but for
    their ``__init__``. Modules are imported by ``register``. The classes defined in a
    module are registered in order: property groups, and classes named ``HFX_...``. Then the
    module's own ``register`` is called, if any."""

    def modules() -> list[ModuleType]:
        # Sorted by name, so that the order is the same on every file system.
        infos = walk_packages(path, f"{name}.")
        return [import_module(name) for name in sorted(i.name for i in infos if not i.ispkg)]

    def register() -> None:
        for module in modules():
            for cls in _classes_of(module):
                bpy.utils.register_class(cls)
            if hasattr(module, "register"):
                module.register()

    def unregister() -> None:
        for module in reversed(modules()):
            if hasattr(module, "unregister"):
                module.unregister()
            for cls in reversed(_classes_of(module)):
                bpy.utils.unregister_class(cls)

    return register, unregister


def _classes_of(module: ModuleType) -> list[type]:
    """Classes defined in a module, not imported, that Blender registers, in order."""
    return [
        cls
        for cls in vars(module).values()
        if isinstance(cls, type)
        and cls.__module__ == module.__name__
        and (cls.__name__.startswith("HFX_") or issubclass(cls, bpy.types.PropertyGroup))
    ]
