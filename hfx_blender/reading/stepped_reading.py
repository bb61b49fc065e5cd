# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading single times of a scene that is stepped through."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ..avatars import body_binding
from ..engine.scene import SceneDescription, SurfaceBinding
from ..errors import InputError
from . import activation, effect_values, response_values, skin_values
from .scene_description import HapticObjects
from .scene_rows import EffectRow, PoseRow, Row
from .stepping import Stepper
from .surface_reading import SurfaceVertices


class SteppedReading:
    """Reads effects and bodies from whatever scene is stepped."""

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, shapes: effect_values.Shapes
    ) -> None:
        self._found = found
        self._scene = scene
        self._shapes = shapes
        self._vertices = SurfaceVertices()
        self.times_stepped = 0
        self.faults: dict[str, set[int]] = {}
        """Meshes that stopped to be volumes: what is wrong, and the samples at which it was."""

    def read(
        self, index: int, stepper: Stepper, effects: Iterable[int], bodies: Iterable[int]
    ) -> Row:
        """Set a sample's time, and read some effects and bodies."""
        stepper.set_frame(self._scene.time.frame(index))
        self.times_stepped += 1
        row = Row(index)
        row.effects = {k: self._read_effect(k, stepper, index) for k in effects}
        row.poses = {k: self._read_pose(k, stepper) for k in bodies}
        return row

    def add_poses(self, row: Row, stepper: Stepper, bodies: Iterable[int]) -> None:
        """Read bodies at the time that is set already."""
        row.poses |= {k: self._read_pose(k, stepper) for k in bodies}

    def _read_effect(self, which: int, stepper: Stepper, index: int) -> EffectRow:
        effect, state = self._found.effects[which], self._found.activations[which]
        evaluated = stepper.evaluated(effect)
        hfx = evaluated.hfx
        values = EffectRow()
        if state.source is activation.Source.OFF or not evaluated.is_evaluated:
            return values
        values.level = state.level(hfx)
        matrix = effect_values.world_of(evaluated)
        values.parameters = effect_values.parameters(hfx, matrix)
        values.place = skin_values.place(hfx, self._found.unit_m)
        values.drive = skin_values.drive(hfx)
        if hfx.kind == "SURFACE":
            try:
                values.vertices = self._vertices.of(effect, evaluated)
            except InputError as error:
                values.vertices, values.level = self._vertices.last_of(effect), 0.0
                self.faults.setdefault(str(error), set()).add(index)
            values.matrix = effect_values.to_metres(matrix, self._found.unit_m)
        if hfx.kind == "VOLUME":
            try:
                values.shape = self._shapes.shape_of(effect, evaluated)
            except InputError as error:
                values.shape = self._shapes.last_of(effect)
                if values.shape is None:
                    raise
                values.level = 0.0  # silent while its mesh has no inside
                self.faults.setdefault(str(error), set()).add(index)
            values.matrix = effect_values.shape_matrices(matrix, self._found.unit_m, hfx)
            values.response = self._response(effect, hfx, index)
        return values

    def _response(
        self, effect: bpy.types.Object, hfx: bpy.types.PropertyGroup, index: int
    ) -> np.ndarray | None:
        controls = response_values.controls(hfx, self._found.unit_m)
        if controls is None:
            return None
        time = self._scene.time
        frame = np.array([float(time.frame(index))])
        return response_values.with_even_phase(
            effect, controls[None], frame, time.scene_start, float(time.fps)
        )[0]

    def _read_pose(self, which: int, stepper: Stepper) -> PoseRow:
        body: bpy.types.Object = self._found.bodies[which]
        binding = self._scene.bodies[which].binding
        unit_m = self._found.unit_m
        if isinstance(binding, SurfaceBinding):
            matrix = effect_values.world_of(stepper.evaluated(body.hfx.avatar))
            surface = body_binding.read_surfaces(body, stepper.evaluated)
            return PoseRow(effect_values.to_metres(matrix, unit_m), surface=surface)
        armature = stepper.evaluated(body)
        matrices = np.zeros(len(binding.bone_names) * 16, np.float32)
        armature.pose.bones.foreach_get("matrix_channel", matrices)  # column-major
        bones = matrices.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3]
        matrix = effect_values.world_of(armature)
        return PoseRow(effect_values.to_metres(matrix, unit_m), bones=bones)
