# SPDX-License-Identifier: GPL-3.0-or-later
"""The spatial part of a clip: bodies, volumes and painted areas for avatars in a game."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ...engine.arrays import F64, I64
from ...engine.body.levels import level_count, level_of
from ...engine.body.model import PerceptualModel, load_model, load_skeleton
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.rendering.device_config import Actuator, DeviceConfig, RoomPlace
from ...engine.rendering.schemes import cells_of
from ...engine.response_filters.controls import About, FilterKind, Operation
from ...engine.scene import (
    BodyDescription,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    SkinBinding,
)
from ...engine.skin.bound_weights import BoundWeights
from ...engine.volume.shape import FalloffKind
from ...text import counted
from ..written import Written
from .baked import Played
from .common_rigs import RigNames, rig_names
from .container import NONE, Records, Texts, records
from .spatial_recorder import Seen, SpatialRecorder

_MODALITIES: Final = tuple(MODALITIES)
_FALLOFFS: Final = tuple(FalloffKind)
_KINDS: Final = tuple(FilterKind)
_OPERATIONS: Final = tuple(Operation)
_ABOUTS: Final = tuple(About)
_WHOLE: Final = 65535


def sections_of(
    recorder: SpatialRecorder, played: Played, texts: Texts
) -> tuple[dict[str, Records], Written]:
    """Sections of a scene's bodies and effects, and what had to be left out.

    Parameters
    ----------
    recorder : SpatialRecorder
        Of the whole scene.
    played : sequence of (DeviceConfig, Raster)
        Whose actuators react, in the order of the baked part.
    texts : Texts
        Gets all names.
    """
    effects = recorder.effects()
    lost = counted(recorder.left_out(), "a player evaluates no meshes, surfaces, spots and drives")
    if not effects:
        return {}, Written(notes=lost)
    models = tuple(dict.fromkeys(effect.model_id for effect, _ in effects))
    bodies = _Bodies(texts, models, recorder.detail)
    skinned = [b for b in recorder.scene.bodies if isinstance(b.binding, SkinBinding)]
    others = [b.name for b in recorder.scene.bodies if b not in skinned]
    lost += counted(others, "bodies that follow their mesh cannot be posed by a player")
    for body in skinned:
        bodies.add(body)
    found = bodies.sections()
    found |= _effects(effects, bodies, texts)
    found |= _reactions(played, bodies, {effect.modality for effect, _ in effects})
    standing = [
        f"{x.name}: {actuator.id}"
        for x, _ in played
        for actuator in x.actuators
        if _has_fixed_place(actuator)
    ]
    lost += counted(standing, "actuators at a place in the room follow no avatar")
    return found, Written(notes=lost)


class _Bodies:
    """Collector of bodies, their bones, models and vertices.

    Attributes
    ----------
    index : dict
        Body id to its number.
    kept : dict
        Body id and model id to the number of the model, the number that each vertex of the whole
        model has among the kept ones (those that are left out: of the one that stands for them),
        and the whole model.
    """

    def __init__(self, texts: Texts, model_ids: tuple[str, ...], level: int) -> None:
        self._texts, self._level = texts, level
        self._models = [load_model(model_id) for model_id in model_ids]
        self.index: dict[str, int] = {}
        self.kept: dict[tuple[str, str], tuple[int, I64, PerceptualModel]] = {}
        self._rows: dict[str, list[Any]] = {
            name: [] for name in ("BODY", "BONE", "MODL", "VERT", "WGHT")
        }

    def sections(self) -> dict[str, Records]:
        found = {name: records(name, self._rows[name]) for name in ("BODY", "BONE", "MODL")}
        for name in ("VERT", "WGHT"):
            found[name] = np.concatenate([records(name, []), *self._rows[name]])
        return found

    def add(self, body: BodyDescription) -> None:
        assert isinstance(body.binding, SkinBinding)
        binding, text = body.binding, self._texts.add
        placed = [
            binding.fitted[each.id].of(each) if each.id in binding.fitted else each
            for each in self._models
        ]
        bound = [BoundWeights.of(each, binding.bone_names) for each in placed]
        used = np.unique(np.concatenate([each.bones for each in bound]))
        used = used[used < len(binding.bone_names)]
        first_bone, first_model = len(self._rows["BONE"]), len(self._rows["MODL"])
        self.index[body.id] = len(self._rows["BODY"])
        self._rows["BONE"] += _bones(binding, used, self._models, bound, text)
        for model, weights in zip(self._models, bound, strict=True):
            self._add_model(body.id, model, weights, used)
        self._rows["BODY"].append(
            (text(body.name), first_bone, len(used), first_model, len(self._models), 0)
        )

    def _add_model(
        self, body_id: str, model: PerceptualModel, weights: BoundWeights, used: I64
    ) -> None:
        level = min(self._level, level_count(model))
        chosen = level_of(model, level)
        order = _neighbours_first(model, chosen.vertices.astype(np.int64))
        ids = chosen.vertices[order].astype(np.int64)
        vertices = sum(len(each) for each in self._rows["VERT"])
        self.kept[body_id, model.id] = (
            len(self._rows["MODL"]),
            np.argsort(order)[chosen.coarse_of],
            model,
        )
        modality = _MODALITIES.index(model.modality)
        self._rows["MODL"].append(
            (self._texts.add(model.id), modality, level, vertices, len(ids), 0)
        )
        first = sum(len(each) for each in self._rows["WGHT"])
        found, skin = _skinned(weights, ids, used, first)
        self._rows["VERT"].append(found)
        self._rows["WGHT"].append(skin)


def _neighbours_first(model: PerceptualModel, ids: I64) -> I64:
    """Order of vertices in which those that follow each other are near, on the same bone."""
    weights = model.weights
    owner = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    strongest = np.lexsort([-weights.values, owner])[weights.offsets[:-1]]
    bone = weights.bones[strongest][ids]
    places = model.vertices[ids].astype(np.float64)
    along = np.zeros(len(ids))
    for each in np.unique(bone):
        mine = bone == each
        spread = places[mine] - places[mine].mean(axis=0)
        along[mine] = spread[:, int(np.argmax(np.ptp(spread, axis=0)))]
    return np.lexsort([along, bone])


def _skinned(weights: BoundWeights, ids: I64, used: I64, first: int) -> tuple[Records, Records]:
    """Vertices with their places and skin weights; the weights add up to 65535 for each."""
    counts = np.diff(weights.offsets)[ids]
    entries = np.repeat(weights.offsets[ids], counts) + _within(counts)
    owners = np.repeat(np.arange(len(ids)), counts)
    bones, values = weights.bones[entries], weights.values[entries]
    is_moved = bones < weights.bone_count
    owners, bones, values = owners[is_moved], bones[is_moved], values[is_moved]
    exact = values * _WHOLE / np.bincount(owners, values, len(ids))[owners]
    shares = np.floor(exact)
    # What is missing goes to the largest remainders, one each.
    missing = _WHOLE - np.bincount(owners, shares, len(ids))
    order = np.lexsort([shares - exact, owners])
    counts = np.bincount(owners, minlength=len(ids))
    shares[order] += _within(counts) < missing[owners[order]]
    skin = np.zeros(len(owners), records("WGHT", []).dtype)
    skin["bone"], skin["weight"] = np.searchsorted(used, bones), shares
    found = np.zeros(len(ids), records("VERT", []).dtype)
    found["place"], found["id"] = weights.rest[ids, :3], ids
    found["first_weight"] = first + np.cumsum(counts) - counts
    found["weights"] = counts
    return found, skin


def _within(counts: I64) -> I64:
    """0, 1, ... for each group of ``counts`` entries."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _bones(
    binding: SkinBinding,
    used: I64,
    models: list[PerceptualModel],
    bound: list[BoundWeights],
    text: Any,
) -> list[tuple[Any, ...]]:
    """Records of the bones that move skin; those of the canonical skeleton have a rest pose."""
    names = [binding.bone_names[k] for k in used]
    skeleton = load_skeleton()
    number = {name: k for k, name in enumerate(skeleton.bone_names)}
    joints = _joints(used, models, bound)
    is_canonical = not binding.fitted
    found = []
    for k, name in enumerate(names):
        rig = rig_names(name) if is_canonical else joints[k]
        rest, length, parent = np.zeros(12, np.float32), 0.0, NONE
        if is_canonical and name in number:
            at = number[name]
            rest, length = skeleton.rest[at, :3].ravel(), float(skeleton.lengths_m[at])
            above = int(skeleton.parents[at])
            while above >= 0 and skeleton.bone_names[above] not in names[:k]:
                above = int(skeleton.parents[above])
            parent = names.index(skeleton.bone_names[above]) if above >= 0 else NONE
        found.append(
            (text(name), text(rig.human), text(rig.mixamo), text(rig.unreal), parent, length, rest)
        )
    return found


def _joints(used: I64, models: list[PerceptualModel], bound: list[BoundWeights]) -> list[RigNames]:
    """Joint of the canonical skeleton that moves the same skin as each bone of an avatar."""
    shares: dict[RigNames, F64] = {}
    for model, weights in zip(models, bound, strict=True):
        of_bone = [rig_names(name) for name in model.bone_names]
        canonical = model.weights
        owner = np.repeat(np.arange(len(model)), np.diff(canonical.offsets))
        theirs = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
        for joint in dict.fromkeys(of_bone):
            is_it = np.array([each == joint for each in of_bone])[canonical.bones]
            share = np.bincount(owner[is_it], canonical.values[is_it], len(model))
            sums = np.bincount(
                weights.bones, weights.values * share[theirs], weights.bone_count + 1
            )
            shares[joint] = shares.get(joint, 0.0) + sums
    joints = list(shares)
    table = np.array([shares[each] for each in joints])
    return [joints[int(np.argmax(table[:, k]))] for k in used]


def _effects(
    effects: list[tuple[EffectDescription, Seen]], bodies: _Bodies, texts: Texts
) -> dict[str, Records]:
    """Records of volumes and painted areas, with their filters and vertices."""
    rows: list[tuple[Any, ...]] = []
    filters: list[tuple[Any, ...]] = []
    painted: list[Records] = []
    for effect, seen in effects:
        area = effect.area
        body, kind, falloff, share = NONE, 0, 0, 0.0
        first_filter, first_painted = len(filters), sum(map(len, painted))
        if isinstance(area, HapticVolume):
            falloff, share = _FALLOFFS.index(area.falloff.kind), area.falloff.share
            for stage, controls in zip(area.response, seen["controls"], strict=True):
                filters.append(
                    (
                        _KINDS.index(stage.kind),
                        _OPERATIONS.index(stage.operation),
                        _ABOUTS.index(stage.about),
                        controls,
                    )
                )
        elif isinstance(area, PaintedArea):
            if area.body_id not in bodies.index:
                continue
            body, kind = bodies.index[area.body_id], 1
            _, rank, _ = bodies.kept[area.body_id, effect.model_id]
            painted.append(_strongest("PNTD", rank[area.vertices], area.weights))
        parameters = np.zeros(4)
        parameters[: len(seen["parameters"])] = seen["parameters"]
        is_warm = effect.modality == "temperature"
        rows.append(
            (
                texts.add(effect.name),
                kind,
                _MODALITIES.index(effect.modality),
                body,
                texts.add(effect.model_id),
                seen["shape"],
                seen["half_segment"],
                falloff,
                min(max(share, 0.0), 1.0),
                seen["level"],
                parameters,
                neutral_temperature_c(effect.is_contact) if is_warm else 0.0,
                first_filter,
                len(filters) - first_filter,
                first_painted,
                sum(map(len, painted)) - first_painted,
                seen["matrix"][:3].ravel(),
                0,
            )
        )
    return {
        "EFCT": records("EFCT", rows),
        "FLTR": records("FLTR", filters),
        "PNTD": np.concatenate([records("PNTD", []), *painted]),
    }


def _strongest(section: str, vertices: I64, values: Any) -> Records:
    """Vertices with a value each, ascending; of several on one vertex the largest."""
    ids = np.unique(vertices)
    largest = np.zeros(len(ids), np.float32)
    np.maximum.at(largest, np.searchsorted(ids, vertices), values)
    found = np.zeros(len(ids), records(section, []).dtype)
    found["vertex"], found[found.dtype.names[1]] = ids, largest  # type: ignore[index]
    return found


def _reactions(played: Played, bodies: _Bodies, felt: set[str]) -> dict[str, Records]:
    """Records of which effects each actuator shows, by the vertices that it reaches."""
    rows: list[tuple[Any, ...]] = []
    reached: list[Records] = []
    first = 0
    for device, raster in played:
        for number, actuator in enumerate(device.actuators, first):
            for source in _MODALITIES:
                shown = _substitute(device, source, actuator.type.modality)
                if shown is None or source not in felt or _has_fixed_place(actuator):
                    continue
                for (body_id, _), (model, rank, whole) in bodies.kept.items():
                    if body_id != raster.body_id or whole.modality != MODALITIES[source].model:
                        continue
                    cells = cells_of(device, [actuator], whole)
                    factors = (
                        np.ones(len(cells.rows[0])) if cells.factors is None else cells.factors
                    )
                    mine = _strongest("RCHV", rank[cells.rows[0]], factors)
                    statistic = int(device.scheme.statistic == "mean")
                    at = sum(map(len, reached))
                    rows.append(
                        (number, model, _MODALITIES.index(source), statistic, *shown, at, len(mine))
                    )
                    reached.append(mine)
        first += len(device.actuators)
    return {
        "REAC": records("REAC", rows),
        "RCHV": np.concatenate([records("RCHV", []), *reached]),
    }


def _has_fixed_place(actuator: Actuator) -> bool:
    """Test for an actuator at a fixed place in the room."""
    return isinstance(actuator.place, RoomPlace) and actuator.place.at_m is not None


def _substitute(device: DeviceConfig, source: str, target: str) -> tuple[float, float] | None:
    """Scale and frequency with which a device shows one modality as another; None: not at all."""
    if source == target:
        return device.gain, 0.0
    substitution = device.substitutions.get(source)
    if substitution is None or substitution.target != target:
        return None
    return device.gain * substitution.scale, substitution.frequency_hz or 0.0
