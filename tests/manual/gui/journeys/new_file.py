# SPDX-License-Identifier: GPL-3.0-or-later
"""New > Haptics, by Ctrl+N and in the File menu: Blender's own question, and each answer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

FILE_MENU = (41, 13)  # in the top bar
GENERAL, HAPTICS = "g", "h"  # underlined in the menu
SAVE, DONT_SAVE, CANCEL = "Return", "d", "Escape"


def steps(h: Any) -> Iterator[float]:
    yield from choose_by_key(h, HAPTICS, "1_menu.png")
    yield from avatar_stands(h, "without changes nothing is asked")
    h.shot("2_avatar.png")

    change(h)
    yield from choose_by_key(h, HAPTICS)
    h.shot("3_question.png")
    h.check("Mine" in bpy.data.objects, "it asks first")
    yield from answer(h, CANCEL)
    yield 1.0
    h.check("Mine" in bpy.data.objects, "Cancel keeps the file")
    yield from choose_by_key(h, GENERAL)
    yield from answer(h, DONT_SAVE)
    yield from h.until(lambda: "Cube" in bpy.data.objects, "General after that is General", 30)
    yield 2.0
    h.check(not bodies(), "without an avatar")

    change(h)
    yield from choose_by_key(h, HAPTICS)
    h.check("Mine" in bpy.data.objects, "it asks again")
    yield from answer(h, DONT_SAVE)
    yield from avatar_stands(h, "Don't Save begins the new file")

    change(h)
    path = Path(h.out, "mine.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    yield 0.5  # Blender counts the file as saved a little later
    change(h, "More")
    yield from h.click(*FILE_MENU)
    yield 0.8
    yield from h.key("n")
    yield 0.8
    h.shot("4_file_menu.png")
    yield from h.key(HAPTICS)
    yield 1.0
    h.shot("5_question_of_a_named_file.png")
    yield from answer(h, SAVE)
    yield from avatar_stands(h, "Save begins the new file")
    with bpy.data.libraries.load(str(path)) as (saved, _):
        names = list(saved.objects)
    h.check({"Mine", "More"} <= set(names), f"after it has saved the other one: {names}")

    change(h)
    h.show_files_inside()
    yield from choose_by_key(h, HAPTICS)
    yield from answer(h, SAVE)
    second = Path(h.out, "other.blend")
    yield from h.save_as(second)
    yield from h.until(second.exists, "Save of a file without a name asks for one, and saves", 20)
    yield 1.0
    h.check("Mine" in bpy.data.objects, "which ends the question, as for all new files")
    yield from choose_by_key(h, HAPTICS)
    yield from avatar_stands(h, "what is saved is left without a question")
    h.shot("6_end.png")

    change(h)
    yield from choose_by_key(h, HAPTICS)
    yield from answer(h, CANCEL)
    yield 0.5
    bpy.ops.wm.splash("INVOKE_DEFAULT")
    yield 1.0
    h.shot("7_splash.png")
    waits = [item.__name__ for item in bpy.app.handlers.load_post if "avatar" in item.__name__]
    h.check(not waits, f"a file that the splash screen begins gets no avatar: {waits}")
    yield from h.key("Escape")


def choose_by_key(h: Any, letter: str, shot: str = "") -> Iterator[float]:
    yield from h.move(*h.xy(h.region(), 0.4, 0.6))
    yield from h.key("ctrl+n")
    yield 0.8
    if shot:
        h.shot(shot)
    yield from h.key(letter)
    yield 1.0


def answer(h: Any, key: str) -> Iterator[float]:
    """Press the key of an answer of Blender's question."""
    yield from h.key(key)
    yield 0.5


def bodies() -> list[bpy.types.Object]:
    return [obj for obj in bpy.data.objects if obj.hfx.role == "BODY"]


def avatar_stands(h: Any, text: str) -> Iterator[float]:
    def is_new() -> bool:
        is_empty = not {"Cube", "Mine", "More"} & set(bpy.data.objects.keys())
        return bool(is_empty and len(bodies()) == 1 and h.window.workspace.name == "HFX")

    yield from h.until(is_new, text, 25)
    yield from h.until(lambda: h.region("UI").width > 150, "in the HFX workspace", 60)
    yield 1.0
    h.check(not bpy.data.filepath, "as a file without a name")


def change(h: Any, name: str = "Mine") -> None:
    with h.context():
        bpy.ops.object.empty_add()
        bpy.context.object.name = name
        h.undo_push()
    h.check(bpy.data.is_dirty, "there is unsaved work")
