# SPDX-License-Identifier: GPL-3.0-or-later
"""Registering modules with Blender, in order, and taking them back in reverse."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType

import bpy

Registration = tuple[Callable[[], None], Callable[[], None]]
"""Functions ``register`` and ``unregister``."""


def of_modules(modules: Callable[[], Iterable[ModuleType]]) -> Registration:
    """``register`` and ``unregister`` for modules that have both.

    Parameters
    ----------
    modules : callable
        Imports them and returns them in order; called no earlier than ``register`` is, so that
        importing the package imports no ``bpy``.
    """

    def register() -> None:
        for module in modules():
            module.register()

    def unregister() -> None:
        for module in reversed([*modules()]):
            module.unregister()

    return register, unregister


def of_package(name: str, path: Iterable[str]) -> Registration:
    """``register`` and ``unregister`` for all modules of a package, by name.

    Blender gets the classes that a module defines, in their order, and then the module's own
    ``register`` is called, if it has one. Base classes are left out by their names: those that
    Blender knows begin with ``HFX_``, but for groups of properties.

    Parameters
    ----------
    name, path
        ``__name__`` and ``__path__`` of the package; its packages are searched, too.
    """

    def modules() -> list[ModuleType]:
        found = [each for each in walk_packages(path, f"{name}.") if not each.ispkg]
        return [import_module(each) for each in sorted(each.name for each in found)]

    def register() -> None:
        for module in modules():
            for each in _classes_of(module):
                bpy.utils.register_class(each)
            if hasattr(module, "register"):
                module.register()

    def unregister() -> None:
        for module in reversed(modules()):
            if hasattr(module, "unregister"):
                module.unregister()
            for each in reversed(_classes_of(module)):
                bpy.utils.unregister_class(each)

    return register, unregister


def _classes_of(module: ModuleType) -> list[type]:
    classes = [each for each in vars(module).values() if isinstance(each, type)]
    return [
        each
        for each in classes
        if each.__module__ == module.__name__
        and (each.__name__.startswith("HFX_") or issubclass(each, bpy.types.PropertyGroup))
    ]
