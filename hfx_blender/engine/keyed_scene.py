# SPDX-License-Identifier: GPL-3.0-or-later
"""Upcoming state of a keyed scene: plain data, to be evaluated elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .arrays import F64
from .kinematics.keyed_rig import KeyedRig
from .scene import AnimationBlock, EffectBlock, PoseBlock, SceneDescription
from .tolerance import Tolerance
from .volume.shape import Shape


@dataclass(frozen=True, eq=False)
class KeyedScene:
    """Constant part of a keyed scene.

    Attributes
    ----------
    edition : int
        Rises with every edit; what is of another edition is void.
    description : SceneDescription
    tolerance : Tolerance
    record : tuple of str
        As :class:`~hfx_blender.engine.evaluate.Engine` takes it.
    shapes : tuple of Shape or None
        Of each effect.
    rigs : tuple of KeyedRig
        Of each body.
    """

    edition: int
    description: SceneDescription
    tolerance: Tolerance
    record: tuple[str, ...]
    shapes: tuple[Shape | None, ...]
    rigs: tuple[KeyedRig, ...]


@dataclass(frozen=True, eq=False)
class KeyedBlock:
    """Animated state at some frames of a keyed scene.

    Attributes
    ----------
    edition : int
    frames : (T,) float64
        Of the scene.
    effects : tuple of EffectBlock
        Without their shapes.
    worlds : tuple of (T, 4, 4) float64
        Of each body, armature to world, metres.
    channels : tuple of (T, C) float64
        Of each body, as its rig takes them.
    """

    edition: int
    frames: F64
    effects: tuple[EffectBlock, ...]
    worlds: tuple[F64, ...]
    channels: tuple[F64, ...]

    def at(self, row: int, scene: KeyedScene) -> AnimationBlock:
        """Block of a single frame, for the engine."""
        part = slice(row, row + 1)
        effects = tuple(
            _row(effect, part, shape)
            for effect, shape in zip(self.effects, scene.shapes, strict=True)
        )
        is_on = any(
            described.kind == "volume" and effect.levels[0] > 0.0
            for described, effect in zip(scene.description.effects, effects, strict=True)
        )
        poses = tuple(
            _pose(world[part], channels[part], rig, is_on or bool(scene.record))
            for world, channels, rig in zip(self.worlds, self.channels, scene.rigs, strict=True)
        )
        return AnimationBlock(np.zeros(1, np.int64), effects, poses)


def _row(effect: EffectBlock, part: slice, shape: Shape | None) -> EffectBlock:
    return replace(
        effect,
        levels=effect.levels[part],
        parameters=effect.parameters[part],
        matrices=None if effect.matrices is None else effect.matrices[part],
        shapes=() if shape is None else (shape,),
        place=None if effect.place is None else effect.place[part],
        drive=None if effect.drive is None else effect.drive[part],
    )


def _pose(world: F64, channels: F64, rig: KeyedRig, is_wanted: bool) -> PoseBlock:
    valid = np.array([is_wanted])
    return PoseBlock(valid, world, rig.skinning(channels) if is_wanted else None)
