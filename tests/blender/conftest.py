# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender for tests: an empty scene with the add-on registered, settings of nobody."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from typing import Any

import pytest

# Before bpy is imported: nobody's preferences, add-ons or start-up file. Each process removes its
# own folder at its end, so a worker does not take that of the process that started it.
_PREFIX = "hfx_test_"
if os.path.basename(os.environ.get("BLENDER_USER_RESOURCES", _PREFIX)).startswith(_PREFIX):
    os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix=_PREFIX)


@pytest.fixture(scope="session")
def registered() -> Iterator[Any]:
    """The ``bpy`` module with the add-on registered."""
    from hfx_blender.processes import blender_session

    yield blender_session.start()


@pytest.fixture
def scene(registered: Any) -> Any:
    """A new, empty scene."""
    registered.ops.wm.read_homefile(use_empty=True)
    return registered.context.scene


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the mesh volumes that are made from now on."""
    from hfx_blender.engine.volume.mesh import MeshVolume

    names: list[str] = []
    real = MeshVolume.__post_init__

    def post_init(self: MeshVolume) -> None:
        names.append(self.name)
        real(self)

    monkeypatch.setattr(MeshVolume, "__post_init__", post_init)
    return names
