# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Up Person plays a strength while it is chosen, and is silent as soon as it is closed."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

DEVICE = "back_pad"
ROW = 26  # pixels between two fields of a dialog


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    bpy.context.scene.hfx.devices.add().name = DEVICE
    log = h.out / "pad.jsonl"
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.live_connect(name=DEVICE, kind="SIMULATOR", path=str(log))
    module = hands.module("playback.live.live")
    module.HOLD_S = 600.0  # silence comes from the dialog alone
    live = module.live
    # Without a graphics card a window takes longer to be drawn than a device waits for Blender.
    threading.Thread(target=show_life, args=(live,), daemon=True).start()
    yield from h.until(lambda: live.is_armed, "the simulator is connected and plays", 60)

    place = h.xy(h.region(), 0.4, 0.5)
    yield from h.move(*place)
    with h.context():
        bpy.ops.hfx.live_person("INVOKE_DEFAULT", name=DEVICE)
    yield 1.0
    h.shot("1_dialog.png")
    texts = yield from h.text_fields()
    profile = min(texts, key=lambda at: abs(at[0] - place[0]) + abs(at[1] - place[1]))
    x, y = profile[0], profile[1] + 2 * ROW  # Strong Enough
    inputs = bpy.context.preferences.inputs
    inputs.use_mouse_continuous = False  # a grabbed pointer of a virtual screen jumps
    yield from h.drag([(x, y), (x + 20, y), (x + 40, y)], step=0.3)
    inputs.use_mouse_continuous = True
    yield from h.until(lambda: any(loud_rows(log)), "a changed strength is played", 20)
    dialog, closed = hands.module("operators.live.live_operators").HFX_OT_live_person, []
    cancel = dialog.cancel
    dialog.cancel = lambda self, context: (closed.append(True), cancel(self, context))[1]
    yield from h.key("Escape")
    yield from h.until(lambda: closed, "Esc closes the dialog", 20)
    yield from h.until(lambda: not loud_rows(log)[-1], "and the device is silent", 20)
    h.shot("2_closed.png")


def show_life(live: Any) -> None:
    while live.states:
        live.client.heartbeat()
        time.sleep(0.05)


def loud_rows(log: Path) -> list[bool]:
    """Test of each row of the log for a strength above 0."""
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    return [any(json.loads(line).get("values", [0.0])[::2]) for line in lines]
