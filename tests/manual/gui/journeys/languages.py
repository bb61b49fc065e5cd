# SPDX-License-Identifier: GPL-3.0-or-later
"""The editor in German and Japanese: panels, menus, tooltips and reports are translated.

Blender needs its languages, which some distributions leave out; without them nothing is checked.
For the extension's own texts a list of languages suffices: a file ``languages`` in Blender's folder
``datafiles/locale`` (of Debian: ``/usr/share/locale``) with the lines ``1:Automatic:DEFAULT``,
``2:German:de_DE`` and ``3:Japanese:ja_JP``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

TEXTS = {  # label of an operator, and a report with values
    "de": ("Haptischen Körper hinzufügen", "'A' bewegt sich nicht"),
    "ja": ("ハプティックボディを追加", "'A' は動きません"),
}


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.live_add(name="insoles")
    h.undo_push()
    view = bpy.context.preferences.view
    known = view.bl_rna.properties["language"].enum_items.keys()
    translated = hands.module("blender.translation").translated
    for language, (label, report) in TEXTS.items():
        codes = [code for code in known if code.partition("_")[0] == language]
        if not codes:
            h.check(True, f"this Blender has no language '{language}'")
            continue
        view.language = codes[0]
        yield 1.5
        h.check(bpy.app.translations.pgettext_iface("Add Haptic Body") == label, label)
        text = "'A' does not move; draw a path to move it"
        h.check(translated(text).startswith(report), translated(text))
        h.shot(f"{language}_1_body.png")
        yield from h.move(*h.xy(h.region(), 0.3, 0.6))
        yield from h.key("shift+a")
        yield 0.6
        rows = yield from h.menu()
        yield from h.submenu(rows[-1])
        h.shot(f"{language}_2_menu.png")
        yield from h.key("Escape", "Escape", "Escape")
        bpy.context.view_layer.objects.active = None
        yield 1.0
        for panel in (4, 3):  # Live Devices
            headers = yield from h.panels(h.region("UI"))
            if len(headers) > panel:
                yield from h.click(h.region("UI").x + 60, headers[-3][1])
                break
        yield 1.0
        h.shot(f"{language}_3_devices.png")
        with h.context():
            bpy.ops.hfx.live_connect("INVOKE_DEFAULT", name="insoles")
        yield 2.0
        yield from h.move(*h.xy(h.region(), 0.5, 0.5))
        yield 0.5
        h.shot(f"{language}_4_connect.png")
        yield from h.key("Escape")
        with h.context():
            bpy.ops.hfx.add_painted(modality="pressure")
            bpy.ops.hfx.add_clip()
        yield 1.5
        h.shot(f"{language}_5_effect.png")
        with h.context():
            bpy.ops.hfx.add_volume(shape="SPHERE", modality="temperature")
        yield 1.5
        h.shot(f"{language}_6_volume.png")
        for effect in [obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT"]:
            bpy.data.objects.remove(effect)
        bpy.context.view_layer.objects.active = bpy.data.objects["Avatar"]
        yield 1.0
