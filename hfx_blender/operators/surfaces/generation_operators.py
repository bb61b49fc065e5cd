# SPDX-License-Identifier: GPL-3.0-or-later
"""Material from words or a picture: made in a child process, shown, chosen, felt."""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import IntProperty

from ...blender.events import redraw
from ...blender.translation import translated
from ...errors import HfxError, InputError
from ...processes import blender_session
from ...version import __version__
from ..shared import ON_MESH, HfxOperator, ModalTimer

if TYPE_CHECKING:
    from ...generation.generation_process import GenerationProcess

_TICK_S = 0.1

running: GenerationProcess | None = None
"""Running generation; None without any."""

results: list[Path] = []
"""Files of the last generated surfaces, in order of creation."""

_folders: list[str] = []


def _job(context: bpy.types.Context) -> dict[str, Any]:
    """Request for the generation process, with a new folder: the words, or a picture file, whose
    pixels are saved in the folder. InputError without words or picture, or for an unreadable
    picture."""
    import numpy as np

    from ...authoring.surfaces import image_values

    settings = context.window_manager.hfx_generation
    folder = str(blender_session.new_temporary_folder("hfx_generated_"))
    _folders.append(folder)
    job = {
        "version": __version__,
        "folder": folder,
        "back_end": "library",
        "use_steps": settings.use_steps,
        "variations": settings.variations,
        "words": settings.words,
        "negative": settings.negative,
        "seed": settings.seed,
        "texels": settings.resolution,
    }
    if settings.source == "WORDS":
        if not settings.words.strip():
            raise InputError("Describe the material in words, such as 'worn blue denim'.")
        return job
    if not settings.picture:
        raise InputError("Choose a picture of a material.")
    path = bpy.path.abspath(settings.picture)
    # The process has no Blender: pixels are decoded here, in all of Blender's formats.
    image = image_values.load(path)
    try:
        pixels = os.path.join(folder, "pixels.npy")
        np.save(pixels, image_values.colours_of(image).astype(np.float32))
    finally:
        bpy.data.images.remove(image)
    return job | {
        "back_end": "folder",
        "variations": 1,
        "picture": os.path.abspath(path),
        "pixels": pixels,
        "size_mm": list(settings.size_mm),
        "height_mm": settings.height_mm,
        "tiles": settings.tiles,
    }


def _forget(except_folder: str = "") -> None:
    """Remove the folders of results, but for one; used results are packed into the .blend file."""
    for folder in [path for path in _folders if path != except_folder]:
        shutil.rmtree(folder, ignore_errors=True)
        _folders.remove(folder)


class HFX_OT_generate_surface(ModalTimer, HfxOperator):
    """Generate materials from text or a picture, and assign the first to the active object.

    A separate process generates; Blender stays usable
    """

    bl_label = "Make Material"

    _target = ""  # no annotation: Blender would register a property
    requires = ((lambda context: running is None, "A material is being made"),)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._begin(context)
        self.start_modal(context, _TICK_S)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        """Generate all variations and assign the first, before returning; for scripts."""
        self._begin(context)
        assert running is not None
        running.wait()
        return self._end(context)

    def _begin(self, context: bpy.types.Context) -> None:
        global running
        from ...generation.generation_process import GenerationProcess

        if importlib.util.find_spec("scipy") is None:  # the generation process needs scipy
            raise ModuleNotFoundError(name="scipy")
        try:
            running = GenerationProcess(_job(context))
        except OSError as error:
            raise HfxError(f"The generation process cannot be started ({error}).") from error
        active = context.object
        # By name: an undo while the process runs invalidates references.
        self._target = active.name if active is not None and active.type == "MESH" else ""

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        redraw("VIEW_3D")  # the panel's progress bar
        if running is not None and running.is_running:
            return {"PASS_THROUGH"}
        self.cancel(context)
        if running is None:  # by the operator Cancel
            self.report({"WARNING"}, translated("Cancelled: no material was made"))
            return {"CANCELLED"}
        return self.reported(lambda: self._end(context))

    def cancel(self, context: bpy.types.Context) -> None:
        """Remove the timer: the work has ended, or the window closes."""
        self.stop_timer(context)

    def _end(self, context: bpy.types.Context) -> str:
        global running
        assert running is not None
        # First of all: an error below must not leave an ended process as the running one.
        done, running = running, None
        done.cancel()  # the process has ended: closes its pipes only
        if done.fault:
            raise InputError(done.fault)
        results[:] = done.records
        _forget(str(results[0].parent) if results else "")
        target = bpy.data.objects.get(self._target)
        if target is None or target.mode != "OBJECT":
            return f"Made {len(results)} materials; choose one for an object"
        return _given(target, results[0])


def _given(obj: bpy.types.Object, record: Path) -> str:
    from ...authoring.surfaces import generated_surfaces

    material = generated_surfaces.apply_generated(obj, record)
    return f"'{obj.name}' has the material '{material.name}'; {obj.hfx.surface.note}"


class HFX_OT_cancel_generation(HfxOperator):
    """End the making of materials; nothing changes"""

    bl_label = "Cancel"
    bl_options = {"REGISTER"}
    requires = ((lambda context: running is not None, "No material is being made"),)

    def work(self, context: bpy.types.Context) -> None:
        stop()


class HFX_OT_use_generated(HfxOperator):
    """Assign this material and its haptic surface to the active object"""

    bl_label = "Use"

    number: IntProperty(name="Number", description="Of the variation", min=0)

    requires = (
        (
            lambda context: ON_MESH[0](context) and context.object.mode == "OBJECT",
            "Select a mesh, in Object Mode",
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        if self.number >= len(results):
            raise InputError(f"There is no variation {self.number + 1}; make materials first.")
        return _given(context.object, results[self.number])


def stop() -> None:
    """Cancel a running generation and end its process; otherwise no effect."""
    global running
    if running is not None:
        running.cancel()
        running = None


def unregister() -> None:
    stop()
    results.clear()
    _forget()
