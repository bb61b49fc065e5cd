# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine input: immutable scene description, independent of Blender.

A :class:`SceneDescription` says what there is and does not change over time; blocks of
:class:`AnimationBlock` say what is where at which time. Spaces: *world* is the scene's, metres;
*rest space* is that of the perceptual models; *shape space* is that of the unit shapes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal

import numpy as np

from .arrays import F32, F64, I32, I64, Bool
from .body.model import PerceptualModel, SkinWeights
from .response_filters.controls import Filter, FilterKind
from .texture.surface_texture import SurfaceTexture
from .volume.shape import Falloff, Shape


@dataclass(frozen=True)
class TimeBase:
    """Times of the samples.

    Sample ``i`` is taken ``i / rate_hz`` after ``frame_first``, at a sub-frame if it falls
    between frames. Time zero is the scene's own first frame, whatever range is exported.
    """

    fps: Fraction
    rate_hz: Fraction
    scene_start: int  # frame at time zero
    frame_first: int  # exported range, both included
    frame_last: int

    def __post_init__(self) -> None:
        if self.fps <= 0 or self.rate_hz <= 0:
            raise ValueError(f"rates must be positive: fps {self.fps}, rate {self.rate_hz} Hz")
        if self.frame_last < self.frame_first:
            raise ValueError(f"empty frame range {self.frame_first} to {self.frame_last}")

    @property
    def sample_count(self) -> int:
        """Samples that cover the range; the last frame lasts a whole frame."""
        duration = Fraction(self.frame_last - self.frame_first + 1) / self.fps
        return -int(-duration * self.rate_hz // 1)

    def frame(self, index: int) -> Fraction:
        """Exact frame of a sample; not a whole number at a sub-frame."""
        step = self._frames_per_sample
        return Fraction(
            self.frame_first * step.denominator + int(index) * step.numerator, step.denominator
        )

    def times_s(self, indices: I64) -> F64:
        """Seconds since ``scene_start`` of the samples with these indices."""
        start_s, rate_hz = self._in_floats
        return start_s + np.asarray(indices, np.float64) / rate_hz

    @cached_property
    def _frames_per_sample(self) -> Fraction:
        return self.fps / self.rate_hz

    @cached_property
    def _in_floats(self) -> tuple[float, float]:
        """Seconds from ``scene_start`` to the first sample, and the rate."""
        return float((self.frame_first - self.scene_start) / self.fps), float(self.rate_hz)


@dataclass(frozen=True, eq=False)
class SurfaceAnchors:
    """Anchors of one model's vertices on an avatar's surface."""

    corners: I32  # (V, 3) vertices of the avatar's mesh
    weights: F64  # (V, 3) barycentric, sum 1
    offset_m: F64  # (V,) along the unit normal of the triangle, avatar's local space


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A perceptual model on one body's own avatar: the same vertices, other places and bones."""

    model_id: str
    model_hash: str
    vertices: F32  # (V, 3) rest space of the body's own armature, in its unit
    bone_names: tuple[str, ...]  # of that armature
    weights: SkinWeights
    anchors: SurfaceAnchors  # offsets in the unit of the vertices

    def of(self, model: PerceptualModel) -> PerceptualModel:
        """Copy of the model with this body's places and bones."""
        return replace(
            model, vertices=self.vertices, bone_names=self.bone_names, weights=self.weights
        )


@dataclass(frozen=True, eq=False)
class SkinBinding:
    """The body follows bones: linear blend skinning with each model's own weights."""

    bone_names: tuple[str, ...]  # order of the pose matrices; a superset of the models' bones
    fitted: Mapping[str, FittedModel] = field(default_factory=dict)  # by model id; else canonical


@dataclass(frozen=True, eq=False)
class SurfaceBinding:
    """The body follows an avatar's evaluated surface (shape keys, cloth, Preserve Volume...)."""

    anchors: Mapping[str, SurfaceAnchors]  # by model id
    reason: str  # why bones alone would not do, for the report


@dataclass(frozen=True, eq=False)
class BodyDescription:
    """Haptic body of the scene."""

    id: str
    name: str
    binding: SkinBinding | SurfaceBinding


@dataclass(frozen=True)
class Clip:
    """Named interval of the timeline, for readers of a track; it drives nothing."""

    name: str
    frame_start: float
    frame_end: float


@dataclass(frozen=True, eq=False)
class PaintedArea:
    """Area of an egocentric effect: vertices of the effect's model on one body."""

    body_id: str
    vertices: I32  # (n,) ascending
    weights: F32  # (n,) in (0, 1]


@dataclass(frozen=True, eq=False)
class HapticVolume:
    """Area of an allocentric effect: a shape, whose placement is in the blocks."""

    falloff: Falloff
    response: tuple[Filter, ...] = ()  # how it answers a touch

    @property
    def has_impacts(self) -> bool:
        """Test for a filter whose impacts ring."""
        return any(each.kind is FilterKind.IMPACT for each in self.response)


@dataclass(frozen=True, eq=False)
class HapticSurface:
    """Area of an object that is felt by moving over it; its vertices are in the blocks.

    The effect's modality is vibration. Its parameters in the blocks are the device's full
    amplitude and, for the textile renderer, the one frequency.
    """

    triangles: I32  # (F, 3) of the object's vertices
    coordinates_m: F64  # (F, 3, 2) surface coordinates of the corners: UV times the size of a tile
    texture: SurfaceTexture
    reach_m: float = 0.005  # skin that is no farther from the surface touches it
    max_contacts: int = 100  # at once; fingertips first, then what is nearest


@dataclass(frozen=True, eq=False)
class SpotArea:
    """Area of a disc on one body's skin; its place on its path and its radius are in the blocks."""

    body_id: str
    path: F64  # (n, 3) n > 0 places on the skin of the canonical body, rest space; one: it rests
    falloff: Falloff = field(default_factory=Falloff)


@dataclass(frozen=True)
class ActuatorArea:
    """Area of the actuators of one device; their strengths are in the blocks.

    Mango's vector sensation (Schneider et al., UIST 2015). Nothing is felt of it on the skin,
    and no other device plays it.
    """

    body_id: str  # who wears the device
    device_id: str
    actuators: tuple[str, ...]


EffectKind = Literal["painted", "volume", "spot", "actuators"]


@dataclass(frozen=True, eq=False)
class EffectDescription:
    """Effect of the scene, of one modality."""

    id: str
    name: str
    modality: str  # key of modality.MODALITIES
    model_id: str  # perceptual model that it is felt on
    area: PaintedArea | HapticVolume | HapticSurface | SpotArea | ActuatorArea
    is_contact: bool = False  # temperature of a touched object, not of the air
    clips: tuple[Clip, ...] = ()

    @property
    def kind(self) -> EffectKind:
        """Kind of the effect's area: on the body, in the scene (volumes and surfaces), on
        a device.
        """
        if isinstance(self.area, PaintedArea):
            return "painted"
        if isinstance(self.area, SpotArea):
            return "spot"
        return "actuators" if isinstance(self.area, ActuatorArea) else "volume"


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """Description of a scene: everything that does not change over time."""

    time: TimeBase
    bodies: tuple[BodyDescription, ...]
    effects: tuple[EffectDescription, ...]
    source: Mapping[str, Any] = field(default_factory=dict)  # name, hash, versions
    warnings: tuple[str, ...] = ()

    @property
    def has_volumes(self) -> bool:
        """Test for volumes whose contacts have to be found."""
        return any(isinstance(each.area, HapticVolume) for each in self.effects)


@dataclass(frozen=True, eq=False)
class EffectBlock:
    """Animated values of one effect over a block.

    Rows where ``levels`` is 0 may hold anything else.
    """

    levels: F64  # (T,) activation times intensity, 0..1
    parameters: F64  # (T, P) in the order of the modality's parameters
    matrices: F64 | None = None  # (T, 4, 4) shape or object space to world; not for painted ones
    shapes: tuple[Shape, ...] = ()  # volumes only; the shapes that occur in the block
    shape_index: I32 | None = None  # (T,) index into shapes; None: always the first
    vertices: F64 | None = None  # (T or 1, V, 3) object space; surfaces only; 1: does not deform
    response: F64 | None = None  # (T, F, WIDTH) controls of the filters of its response
    place: F64 | None = None  # (T, 2) spots only; share of the path's length, radius in metres
    drive: F64 | None = None  # (T, A) actuators only; strength of each, 0..1

    def shapes_at(self, rows: I64) -> I64:
        """Index of the volume's shape at some rows, (k,)."""
        if self.shape_index is None:
            return np.zeros(len(rows), np.int64)
        return self.shape_index[rows].astype(np.int64)


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Animated pose of one body over a block. Rows where ``valid`` is False were not read."""

    valid: Bool  # (T,)
    to_world: F64  # (T, 4, 4) armature (or avatar, for a surface binding) to world
    bones: F64 | None = None  # (T, B, 3, 4) rest space to posed armature space
    surface: F32 | None = None  # (T, A, 3) evaluated avatar vertices, avatar's local space


@dataclass(frozen=True, eq=False)
class AnimationBlock:
    """Animated state of a scene at some times of the time base.

    ``indices`` ascend and may have gaps (times at which nothing can be felt are left out).
    The first ``history`` rows belong to the block before, the last ``future`` rows to the one
    after; they are only there so that motion does not depend on how time was split.
    """

    indices: I64  # (T,) sample indices
    effects: tuple[EffectBlock, ...]  # in the order of the scene's effects
    poses: tuple[PoseBlock, ...]  # in the order of the scene's bodies
    history: int = 0
    live_s: F64 | None = None  # (T,) real times of samples that no time base spaces
    future: int = 0

    @property
    def own(self) -> slice:
        """Rows that are evaluated with this block."""
        return slice(self.history, len(self.indices) - self.future)

    @property
    def own_indices(self) -> I64:
        """Sample indices of :attr:`own` rows, (n,)."""
        return self.indices[self.own]
