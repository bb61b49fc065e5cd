# SPDX-License-Identifier: GPL-3.0-or-later
"""Registering modules with Blender, in order, and taking them back in reverse."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType

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
    """``register`` and ``unregister`` for all modules of a package that have both, by name.

    Parameters
    ----------
    name, path
        ``__name__`` and ``__path__`` of the package; its packages are searched, too.
    """

    def modules() -> list[ModuleType]:
        found = [each for each in walk_packages(path, f"{name}.") if not each.ispkg]
        imported = (import_module(each.name) for each in sorted(found, key=lambda each: each.name))
        return [module for module in imported if hasattr(module, "register")]

    return of_modules(modules)
