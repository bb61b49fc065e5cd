# SPDX-License-Identifier: GPL-3.0-or-later
"""New > Haptics: Blender asks about unsaved work, and only this file gets the avatar.

The question itself is in the journey ``tests/manual/gui/journeys/new_file.py``.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from hfx_blender.operators import workspace

pytestmark = pytest.mark.usefixtures("scene")


class Layout:
    """Stand-in for a menu's layout after Blender's own entries of *New*."""

    operator_context = "EXEC_DEFAULT"

    def __init__(self) -> None:
        self.drawn: list[tuple[str, str]] = []

    def operator(self, name: str, **_: Any) -> None:
        self.drawn.append((name, self.operator_context))


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Record calls of ``read_homefile``; without a window Blender asks no question."""
    calls: list[tuple[Any, ...]] = []
    fake = SimpleNamespace(read_homefile=lambda *how, **settings: calls.append((*how, settings)))
    monkeypatch.setattr(workspace.bpy.ops, "wm", fake)
    return calls


def begin_by_script() -> None:
    """Begin a file as *General* does."""
    bpy.ops.wm.read_homefile(app_template="", use_factory_startup=True)


def is_awaited() -> bool:
    return workspace.replace_cube_by_avatar in bpy.app.handlers.load_post


def test_the_entry_of_the_menu_is_invoked_so_that_blender_asks(reads: list[Any]) -> None:
    layout = Layout()
    workspace.draw_new_menu(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == [("hfx.new_file", "INVOKE_DEFAULT")]
    workspace.load_empty_file("INVOKE_DEFAULT")
    assert reads == [("INVOKE_DEFAULT", {"app_template": "", "use_empty": False})]
    assert is_awaited(), "the question may be open for a while"
    workspace.end_wait(None, bpy.context)


@pytest.mark.parametrize("menu", ["TOPBAR_MT_file_new", "TOPBAR_MT_file", "WM_MT_splash"])
def test_after_cancel_a_file_from_another_menu_gets_no_avatar(
    reads: list[Any], monkeypatch: pytest.MonkeyPatch, menu: str
) -> None:
    workspace.load_empty_file("INVOKE_DEFAULT")
    monkeypatch.undo()
    workspace.ENTRIES[menu](SimpleNamespace(layout=Layout()), bpy.context)
    begin_by_script()
    assert "Cube" in bpy.data.objects
    assert not [obj for obj in bpy.data.objects if obj.hfx.role == "BODY"]


def test_after_cancel_another_file_that_is_opened_stays_as_it_is(
    reads: list[Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.undo()
    begin_by_script()
    path = str(tmp_path / "other.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    with monkeypatch.context() as patch:
        patch.setattr(workspace.bpy.ops, "wm", SimpleNamespace(read_homefile=lambda *_, **__: None))
        workspace.load_empty_file("INVOKE_DEFAULT")
    bpy.ops.wm.open_mainfile(filepath=path)
    assert "Cube" in bpy.data.objects and not is_awaited()


def test_the_file_that_was_awaited_has_the_avatar_and_no_cube() -> None:
    workspace.load_empty_file()
    assert "Cube" not in bpy.data.objects
    assert [obj.name for obj in bpy.data.objects if obj.hfx.role == "BODY"] == ["Avatar"]
    assert not is_awaited()
