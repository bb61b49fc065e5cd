# SPDX-License-Identifier: GPL-3.0-or-later
"""Start of a study's session by pip's ``hfx``, whose page opens in the browser."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ...blender.events import call_soon, redraw
from ...commands import left_out
from ...errors import InputError
from ...playback.live.live import live
from ...processes import start
from .connect_operators import LiveOperator, settings_of

_POLL_S = 0.5
_session: list[subprocess.Popen[bytes]] = []  # the running session
_OUTPUTS = {"AUDIO": "sound-card", "SIMULATOR": "simulator", "PAGE": "page"}


def hfx_command() -> list[str]:
    """Command line of pip's ``hfx``; empty where it is missing."""
    if left_out.module("study") is not None:  # Blender as a module, installed by pip
        return [sys.executable, "-m", "hfx_blender"]
    program = shutil.which("hfx")
    return [] if program is None else [program]


def _watch() -> float | None:
    """Poll the running session; the panel shows the sentence of a fault."""
    code = _session[0].poll()
    if code is None:
        return _POLL_S
    pipe = _session.pop().stderr
    lines = pipe.read().decode(errors="replace").strip().splitlines() if pipe is not None else []
    if code and lines:
        live.fault = lines[-1]
        redraw("VIEW_3D")
    return None


class HFX_OT_run_study(LiveOperator):
    """Run the next session of a study's folder with the connected device: pip's hfx opens a page in
    full screen. The device is disconnected here first"""

    bl_label = "Run Study"
    requires = (
        (
            lambda _context: hfx_command(),
            "A session needs pip's hfx: install hfx-blender with pip, and put the command hfx on "
            "the search path (PATH)",
        ),
    )

    directory: StringProperty(name="Folder", subtype="DIR_PATH", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, _context: bpy.types.Context) -> str:
        folder = Path(bpy.path.abspath(self.directory)).absolute()
        if not (folder / "plan.json").is_file():
            raise InputError(f"{folder}: it has no plan.json; 'hfx study make' makes a study.")
        if _session and _session[0].poll() is None:
            raise InputError("A session is running.")
        command = [*hfx_command(), "study", "run", os.fspath(folder)]
        for name in list(live.connected):
            output = _OUTPUTS.get(settings_of(name).kind, "device")
            command += ["--device", name, "--to", output]
            live.disconnect(name)  # the session owns the port
        _session[:] = [start.start(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)]
        call_soon(_watch, _POLL_S)
        return "The session opens in the browser"
