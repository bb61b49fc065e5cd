# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine input: immutable scene description, independent of Blender.

:class:`SceneDescription` has the constant data, :class:`AnimationBlock` the animated data at some
times. Spaces: *world* (metres); *rest space* of the perceptual models; *shape space* of the unit
shapes.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal

import numpy as np

from .arrays import F32, F64, I32, I64, Bool
from .body.model import PerceptualModel, SkinWeights
from .response_filters.controls import ContactLaw, Filter, FilterKind
from .texture.haptic_map import SurfaceTexture
from .volume.shape import Falloff, Shape


@dataclass(frozen=True)
class TimeBase:
    """Times of the samples.

    Sample ``i`` is at ``i / rate_hz`` after ``frame_first``, possibly at a sub-frame. Time zero is
    the scene's first frame, independent of the exported range.
    """

    fps: Fraction
    rate_hz: Fraction
    scene_start: int  # frame at time zero
    frame_first: int  # exported range, inclusive
    frame_last: int

    def __post_init__(self) -> None:
        if self.fps <= 0 or self.rate_hz <= 0:
            raise ValueError(f"rates must be positive: fps {self.fps}, rate {self.rate_hz} Hz")
        if self.frame_last < self.frame_first:
            raise ValueError(f"empty frame range {self.frame_first} to {self.frame_last}")

    @property
    def sample_count(self) -> int:
        """Number of samples in the range, rounded up; the last frame lasts a whole frame."""
        # Exact arithmetic; floor division of the negative rounds up.
        duration = Fraction(self.frame_last - self.frame_first + 1) / self.fps
        return -int(-duration * self.rate_hz // 1)

    def frame(self, index: int) -> Fraction:
        """Exact frame of sample ``index``, also negative; a fraction at a sub-frame."""
        # One fraction without intermediate reductions: quick, and exact for any index.
        step = self._frames_per_sample
        return Fraction(
            self.frame_first * step.denominator + int(index) * step.numerator, step.denominator
        )

    def times_s(self, indices: I64) -> F64:
        """Times of samples in seconds since ``scene_start``, in the shape of ``indices``."""
        # A division for each sample instead of sums, so that errors do not add up.
        start_s, rate_hz = self._in_floats
        return start_s + np.asarray(indices, np.float64) / rate_hz

    @cached_property
    def _frames_per_sample(self) -> Fraction:
        """Exact step from sample to sample, in frames; a live frame asks for many samples."""
        return self.fps / self.rate_hz

    @cached_property
    def _in_floats(self) -> tuple[float, float]:
        """Time of the first sample since ``scene_start`` (seconds), and the rate (Hz)."""
        return float((self.frame_first - self.scene_start) / self.fps), float(self.rate_hz)


@dataclass(frozen=True, eq=False)
class SurfaceAnchors:
    """Anchors of a model's vertices on an avatar's surface."""

    corners: I32  # (V, 3) vertices of the avatar's mesh
    weights: F64  # (V, 3) barycentric, sum 1
    offset_m: F64  # (V,) along the unit normal of the triangle, avatar's local space


@dataclass(frozen=True, eq=False)
class FittedModel:
    """Perceptual model on a body's avatar: canonical ids, own positions and bones."""

    model_id: str
    model_hash: str
    vertices: F32  # (V, 3) rest space and unit of the body's armature
    bone_names: tuple[str, ...]  # bones of the armature
    weights: SkinWeights
    anchors: SurfaceAnchors  # offsets in the unit of the vertices

    def of(self, model: PerceptualModel) -> PerceptualModel:
        """Copy of the canonical ``model`` with the fitted vertices, bones and weights; ids and the
        rest stay."""
        return replace(
            model, vertices=self.vertices, bone_names=self.bone_names, weights=self.weights
        )

    def is_moved_as(self, fitted: "FittedModel | None") -> bool:
        """Test for equal vertices, bones and weights; anchors are not compared."""
        if fitted is None or self.bone_names != fitted.bone_names:
            return False
        own, given = (
            (fit.vertices, fit.weights.offsets, fit.weights.bones, fit.weights.values)
            for fit in (self, fitted)
        )
        return all(map(np.array_equal, own, given))


@dataclass(frozen=True, eq=False)
class SkinBinding:
    """Binding of a body to bones: linear blend skinning with each model's weights."""

    bone_names: tuple[str, ...]  # order of the pose matrices; a superset of the models' bones
    fitted: Mapping[str, FittedModel] = field(default_factory=dict)  # by model id; others canonical


@dataclass(frozen=True, eq=False)
class SurfaceBinding:
    """Binding of a body to an avatar's evaluated mesh (shape keys, cloth, Preserve Volume ...)."""

    anchors: Mapping[str, SurfaceAnchors]  # by model id
    reason: str  # reason against bones alone, for the report


@dataclass(frozen=True, eq=False)
class BodyDescription:
    """Haptic body of the scene."""

    id: str
    name: str
    binding: SkinBinding | SurfaceBinding


@dataclass(frozen=True)
class Clip:
    """Named interval of the timeline, only for readers of tracks."""

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
    """Area of an allocentric effect: a shape, placed by the blocks."""

    falloff: Falloff
    response: tuple[Filter, ...] = ()  # contact response filters
    law: ContactLaw | None = None  # None: samples without forces

    @property
    def has_impacts(self) -> bool:
        """True if any response filter is an impact, which rings after a contact."""
        return any(one.kind is FilterKind.IMPACT for one in self.response)


@dataclass(frozen=True, eq=False)
class HapticSurface:
    """Area of an object with a surface texture; vertices are in the blocks.

    The modality is vibration. Parameters in the blocks are the device's full amplitude and, for the
    textile renderer, the frequency.
    """

    triangles: I32  # (F, 3) of the object's vertices
    coordinates_m: F64  # (F, 3, 2) surface coordinates of the corners: UV times the size of a tile
    texture: SurfaceTexture
    reach_m: float = 0.005  # largest distance of touching skin
    max_contacts: int = 100  # simultaneous; fingertips first, then the nearest vertices
    uv_m: tuple[float, float] = (0.0, 0.0)  # size of a UV unit; 0 without a UV map
    law: ContactLaw | None = None  # None: samples without forces


@dataclass(frozen=True, eq=False)
class SpotArea:
    """Area of a disc on a body's skin; path position and radius are in the blocks."""

    body_id: str
    path: F64  # (n, 3) points on the canonical skin, rest space; n > 0, n = 1 is a fixed spot
    falloff: Falloff = field(default_factory=Falloff)


@dataclass(frozen=True)
class ActuatorArea:
    """Area of individual actuators of a device; strengths are in the blocks.

    Mango's vector sensation (Schneider et al., UIST 2015). No vertices, and silent on other
    devices.
    """

    body_id: str  # wearer of the device
    device_id: str
    actuators: tuple[str, ...]


EffectKind = Literal["painted", "volume", "spot", "actuators"]


@dataclass(frozen=True, eq=False)
class EffectDescription:
    """Effect of the scene, of one modality."""

    id: str
    name: str
    modality: str  # key of modality.MODALITIES
    model_id: str  # perceptual model with the vertices of its samples
    area: PaintedArea | HapticVolume | HapticSurface | SpotArea | ActuatorArea
    is_contact: bool = False  # temperature of a touched object, not of the air
    clips: tuple[Clip, ...] = ()

    @property
    def kind(self) -> EffectKind:
        """Kind of the effect's area; surfaces count as volumes."""
        if isinstance(self.area, PaintedArea):
            return "painted"
        if isinstance(self.area, SpotArea):
            return "spot"
        return "actuators" if isinstance(self.area, ActuatorArea) else "volume"


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """Constant data of a scene."""

    time: TimeBase
    bodies: tuple[BodyDescription, ...]
    effects: tuple[EffectDescription, ...]
    source: Mapping[str, Any] = field(default_factory=dict)  # name, hash, versions
    warnings: tuple[str, ...] = ()
    # Settings of perception, see ``rendering/conditioning/feel.py``; empty with all defaults.
    feel: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_volumes(self) -> bool:
        """True if any effect is a haptic volume; surfaces do not count."""
        return any(isinstance(effect.area, HapticVolume) for effect in self.effects)


Motion = Callable[[F64], F64]
"""Matrices at sample indices (n,) with fractions; may be called from any thread."""


@dataclass(frozen=True, eq=False)
class EffectBlock:
    """Animated values of an effect over a block.

    Other values are undefined at rows with level 0. Many silent effects may share one block.
    """

    levels: F64  # (T,) activation times intensity, 0..1
    parameters: F64  # (T, P) in the order of the modality's parameters
    matrices: F64 | None = None  # (T, 4, 4) shape or object space to world; None if painted
    shapes: tuple[Shape, ...] = ()  # volumes only; all shapes in the block
    shape_index: I32 | None = None  # (T,) index into shapes; None is always the first
    vertices: F64 | None = None  # (T or 1, V, 3) object space; surfaces only; 1 if rigid
    response: F64 | None = None  # (T, F, WIDTH) controls of the response filters
    matrices_at: Motion | None = None  # (n,) -> (n, 4, 4); None: known at samples only
    keys: F64 | None = None  # (k,) ascending sample indices at which its motion may turn
    place: F64 | None = None  # (T, 2) spots only; fraction of the path's length, radius in metres
    drive: F64 | None = None  # (T, A) actuators only; strengths 0..1

    def shapes_at(self, rows: I64) -> I64:
        """Index (k,) into ``shapes`` at rows (k,); 0 without ``shape_index``."""
        if self.shape_index is None:
            return np.zeros(len(rows), np.int64)
        return self.shape_index[rows].astype(np.int64)


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Animated pose of a body over a block; undefined at rows with ``valid`` False."""

    valid: Bool  # (T,)
    to_world: F64  # (T, 4, 4) armature (or avatar, for a surface binding) to world
    bones: F64 | None = None  # (T, B, 3, 4) rest space to posed armature space
    surface: F32 | None = None  # (T, A, 3) evaluated avatar vertices, avatar's local space
    to_world_at: Motion | None = None  # (n,) -> (n, 4, 4); None: known at samples only
    bones_at: Motion | None = None  # (n,) -> (n, B, 3, 4); None: known at samples only
    keys: F64 | None = None  # (k,) ascending sample indices at which its motion may turn

    @cached_property
    def is_repeated(self) -> Bool:
        """Mask (T,) of times with the pose of the time before."""
        known = [v for v in (self.to_world, self.bones, self.surface) if v is not None]
        equal = [(v[1:] == v[:-1]).all(axis=tuple(range(1, v.ndim))) for v in known]
        return np.concatenate([[False], np.all(equal, axis=0)])


@dataclass(frozen=True, eq=False)
class AnimationBlock:
    """Animated state of a scene at some times of the time base.

    ``indices`` ascend, with gaps at times without sensation. The first ``history`` rows belong to
    the previous block, the last ``future`` rows to the next, so that motion does not depend on the
    division into blocks.
    """

    indices: I64  # (T,) sample indices
    effects: tuple[EffectBlock, ...]  # in the order of the scene's effects
    poses: tuple[PoseBlock, ...]  # in the order of the scene's bodies
    history: int = 0
    live_s: F64 | None = None  # (T,) real times of live samples; None on the time base
    future: int = 0

    @property
    def own(self) -> slice:
        """Rows without history and future."""
        return slice(self.history, len(self.indices) - self.future)

    @property
    def own_indices(self) -> I64:
        """Sample indices (n,) of the :attr:`own` rows."""
        return self.indices[self.own]
