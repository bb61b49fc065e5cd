# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender for tests: an empty scene with the add-on registered, without user settings."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from typing import Any

import pytest

# Set before the import of bpy: no user preferences, add-ons or start-up file. Each process removes
# only its own folder at the end, so that a worker leaves the folder of the parent process alone.
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
    """Names of the mesh volumes created from now on."""
    from hfx_blender.engine.volume.mesh import MeshVolume

    names: list[str] = []
    real = MeshVolume.__post_init__

    def post_init(self: MeshVolume) -> None:
        names.append(self.name)
        real(self)

    monkeypatch.setattr(MeshVolume, "__post_init__", post_init)
    return names
