# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial part of a clip: bodies, volumes and painted areas for avatars in a game."""

from typing import Any, Final

import numpy as np

from ...engine.arrays import F64, I64, ramp
from ...engine.body.levels_and_cells import level_count, level_of
from ...engine.body.model import PerceptualModel, load_model, load_skeleton
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.rendering.device_config import Actuator, RoomPlace
from ...engine.rendering.schemes import cells_of
from ...engine.response_filters.controls import About, FilterKind, Operation
from ...engine.scene import (
    BodyDescription,
    EffectDescription,
    HapticSurface,
    HapticVolume,
    PaintedArea,
    SkinBinding,
)
from ...engine.skin.skinned_model import BoundWeights
from ...engine.volume.shape import FalloffKind
from ...text import counted
from ..written import Written
from . import surface_maps
from .baked import Played
from .common_rigs import RigNames, rig_names
from .container import NONE, Records, Texts, records
from .spatial_recorder import EffectState, SpatialRecorder

_MODALITIES: Final = tuple(MODALITIES)
_FALLOFFS: Final = tuple(FalloffKind)
_KINDS: Final = tuple(FilterKind)
_OPERATIONS: Final = tuple(Operation)
_ABOUTS: Final = tuple(About)
_WHOLE: Final = 65535


def sections_of(
    recorder: SpatialRecorder, played: Played, texts: Texts
) -> tuple[dict[str, Records], Written]:
    """Sections of a scene's surfaces, bodies and further effects, and notes on losses; no bodies
    without effects. ``played`` is in the order of the baked part; ``texts`` receives all names."""
    surfaces, effects = (
        [item for item in recorder.effects() if isinstance(item[0].area, HapticSurface) == is_kind]
        for is_kind in (True, False)
    )
    explored = surface_maps.sections_of(surfaces, texts)
    lost = counted(
        recorder.left_out(),
        "a player evaluates no meshes, spots and drives, and surfaces only by micro-collisions",
    )
    if not effects:
        return explored, Written(notes=lost)
    models = tuple(dict.fromkeys(effect.model_id for effect, _ in effects))
    bodies = _Bodies(texts, models, recorder.detail)
    skinned = [b for b in recorder.scene.bodies if isinstance(b.binding, SkinBinding)]
    # Players pose skin by bones.
    unskinned_names = [b.name for b in recorder.scene.bodies if b not in skinned]
    lost += counted(unskinned_names, "bodies following a mesh cannot be posed by a player")
    for body in skinned:
        bodies.add(body)
    sections = bodies.sections()
    sections |= _effects(effects, bodies, texts)
    sections |= _reactions(played, bodies, {effect.modality for effect, _ in effects})
    fixed_actuators = [
        f"{x.name}: {actuator.id}"
        for x, _ in played
        for actuator in x.actuators
        if _has_fixed_place(actuator)
    ]
    lost += counted(fixed_actuators, "actuators at a place in the room follow no avatar")
    return sections | explored, Written(notes=lost)


class _Bodies:
    """Collector of bodies, bones, models and vertices. ``index`` maps a body id to the record
    number; ``stored_models`` a body and model id to the model's record number, the stored vertex of
    each vertex of the whole model (int, (V,)), and the whole model."""

    def __init__(self, texts: Texts, model_ids: tuple[str, ...], level: int) -> None:
        self._texts, self._level = texts, level
        self._models = [load_model(model_id) for model_id in model_ids]
        self.index: dict[str, int] = {}
        self.stored_models: dict[tuple[str, str], tuple[int, I64, PerceptualModel]] = {}
        self._rows: dict[str, list[Any]] = {
            name: [] for name in ("BODY", "BONE", "MODL", "VERT", "WGHT")
        }

    def sections(self) -> dict[str, Records]:
        """Sections ``BODY``, ``BONE``, ``MODL``, ``VERT`` and ``WGHT``."""
        sections = {name: records(name, self._rows[name]) for name in ("BODY", "BONE", "MODL")}
        for name in ("VERT", "WGHT"):
            sections[name] = np.concatenate([records(name, []), *self._rows[name]])
        return sections

    def add(self, body: BodyDescription) -> None:
        """Append the records of a body bound to an armature, with a level of detail of every model.
        Only bones with skin weights are stored. Fitted vertices replace those of a canonical
        model."""
        assert isinstance(body.binding, SkinBinding)
        binding, text = body.binding, self._texts.add
        placed = [
            binding.fitted[item.id].of(item) if item.id in binding.fitted else item
            for item in self._models
        ]
        bound = [BoundWeights.of(item, binding.bone_names) for item in placed]
        # Only bones with skin are stored; the last index stands for skin without any bone.
        used = np.unique(np.concatenate([item.bones for item in bound]))
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
        """Append ``model`` at the level of detail (or its coarsest), with vertices and weights.
        ``used`` are the binding's bone numbers of the stored bones, ascending."""
        level = min(self._level, level_count(model))
        chosen = level_of(model, level)
        # Vertices are reordered for players; coarse_of maps every vertex of the whole model
        # to its stored representative, through the new order.
        order = _neighbours_first(model, chosen.vertices.astype(np.int64))
        ids = chosen.vertices[order].astype(np.int64)
        vertices = sum(len(part) for part in self._rows["VERT"])
        self.stored_models[body_id, model.id] = (
            len(self._rows["MODL"]),
            # The argsort of a permutation is the inverse permutation: the file's position of each
            # chosen vertex.
            np.argsort(order)[chosen.coarse_of],
            model,
        )
        modality = _MODALITIES.index(model.modality)
        self._rows["MODL"].append(
            (self._texts.add(model.id), modality, level, vertices, len(ids), 0)
        )
        first = sum(len(part) for part in self._rows["WGHT"])
        vertex_records, skin = _skinned(weights, ids, used, first)
        self._rows["VERT"].append(vertex_records)
        self._rows["WGHT"].append(skin)


def _neighbours_first(model: PerceptualModel, ids: I64) -> I64:
    """Order the vertices ``ids`` by strongest bone, then along the longest axis of its vertices.
    Returns indices into ``ids``; the axis is the coordinate axis with the largest spread."""
    # Players test a volume against the box of 32 successive vertices first: neighbours on the body
    # have small boxes.
    weights = model.weights
    _, owner = ramp(np.diff(weights.offsets))
    # Sorted by vertex, then by falling weight: the entry at a vertex's offset is the strongest.
    strongest = np.lexsort((-weights.values, owner))[weights.offsets[:-1]]
    bone = weights.bones[strongest][ids]
    places = model.vertices[ids].astype(np.float64)
    along = np.zeros(len(ids))
    for bone_index in np.unique(bone):
        is_of_bone = bone == bone_index
        spread = places[is_of_bone] - places[is_of_bone].mean(axis=0)
        along[is_of_bone] = spread[:, int(np.argmax(np.ptp(spread, axis=0)))]
    return np.lexsort([along, bone])


def _skinned(weights: BoundWeights, ids: I64, used: I64, first: int) -> tuple[Records, Records]:
    """Records VERT, at the rest places of ``weights``, and WGHT, of the vertices ``ids``.

    Weights of a vertex are shares of 65535, rounded by largest remainder; skin without a bone is
    dropped. ``used``: ascending bone numbers, stored as positions; ``first``: number of the first
    weight record.
    """
    counts = np.diff(weights.offsets)[ids]
    steps, owners = ramp(counts)
    entries = weights.offsets[ids][owners] + steps
    bones, values = weights.bones[entries], weights.values[entries]
    is_moved = bones < weights.bone_count
    owners, bones, values = owners[is_moved], bones[is_moved], values[is_moved]
    # Shares of the bones that are left sum to the whole again.
    exact = values * _WHOLE / np.bincount(owners, values, len(ids))[owners]
    shares = np.floor(exact)
    # Largest remainder method: the missing units go to the largest fractions, one each.
    missing = _WHOLE - np.bincount(owners, shares, len(ids))
    order = np.lexsort([shares - exact, owners])
    counts = np.bincount(owners, minlength=len(ids))
    shares[order] += ramp(counts)[0] < missing[owners[order]]
    skin = np.zeros(len(owners), records("WGHT", []).dtype)
    skin["bone"], skin["weight"] = np.searchsorted(used, bones), shares
    vertices = np.zeros(len(ids), records("VERT", []).dtype)
    vertices["place"], vertices["id"] = weights.rest[ids, :3], ids
    vertices["first_weight"] = first + np.cumsum(counts) - counts
    vertices["weights"] = counts
    return vertices, skin


def _bones(
    binding: SkinBinding,
    used: I64,
    models: list[PerceptualModel],
    bound: list[BoundWeights],
    text: Any,
) -> list[tuple[Any, ...]]:
    """Tuples of BONE for the bone numbers ``used``; ``text`` stores a string, returns its offset.
    Rest pose, length and nearest ancestor with skin are of the canonical skeleton; an avatar's
    bones have zeros, no parent, and rig names by :func:`_joints`."""
    names = [binding.bone_names[k] for k in used]
    skeleton = load_skeleton()
    number = {name: k for k, name in enumerate(skeleton.bone_names)}
    joints = _joints(used, models, bound)
    is_canonical = not binding.fitted
    bones = []
    for k, name in enumerate(names):
        rig = rig_names(name) if is_canonical else joints[k]
        rest, length, parent = np.zeros(12, np.float32), 0.0, NONE
        if is_canonical and name in number:
            at = number[name]
            rest, length = skeleton.rest[at, :3].ravel(), float(skeleton.lengths_m[at])
            above = int(skeleton.parents[at])
            # Parents precede children in the file: the nearest ancestor among the names
            # written so far.
            while above >= 0 and skeleton.bone_names[above] not in names[:k]:
                above = int(skeleton.parents[above])
            parent = names.index(skeleton.bone_names[above]) if above >= 0 else NONE
        bones.append(
            (text(name), text(rig.human), text(rig.mixamo), text(rig.unreal), parent, length, rest)
        )
    return bones


def _joints(used: I64, models: list[PerceptualModel], bound: list[BoundWeights]) -> list[RigNames]:
    """Rig names of the canonical joint with the largest skin overlap, one per bone of ``used``.
    Overlap: sum over vertices of the bone's weight in ``bound`` times the joint's in ``models``."""
    shares: dict[RigNames, F64] = {}
    for model, weights in zip(models, bound, strict=True):
        of_bone = [rig_names(name) for name in model.bone_names]
        canonical = model.weights
        _, owner = ramp(np.diff(canonical.offsets))
        _, weight_owner = ramp(np.diff(weights.offsets))
        for joint in dict.fromkeys(of_bone):
            # Overlap: skin weight of the bone times canonical weight of the joint, over vertices.
            is_it = np.array([names_of_joint == joint for names_of_joint in of_bone])[
                canonical.bones
            ]
            share = np.bincount(owner[is_it], canonical.values[is_it], len(model))
            sums = np.bincount(
                weights.bones, weights.values * share[weight_owner], weights.bone_count + 1
            )
            shares[joint] = shares.get(joint, 0.0) + sums
    joints = list(shares)
    table = np.array([shares[names_of_joint] for names_of_joint in joints])
    return [joints[int(np.argmax(table[:, k]))] for k in used]


def _effects(
    effects: list[tuple[EffectDescription, EffectState]], bodies: _Bodies, texts: Texts
) -> dict[str, Records]:
    """Records EFCT, FLTR and PNTD: effects with first states, response filters, painted vertices.
    Painted areas on bodies without an armature are skipped; painted areas have no filters."""
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
            # Several vertices of the whole model may have one stored vertex: the largest weight
            # counts.
            _, rank, _ = bodies.stored_models[area.body_id, effect.model_id]
            painted.append(_strongest("PNTD", rank[area.vertices], area.weights))
        # Records have room for four parameters, the most of any modality.
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
    """Records of the distinct ``vertices``, ascending, each with its largest ``values`` entry.
    ``section``: PNTD or RCHV; the values must be >= 0."""
    ids = np.unique(vertices)
    largest = np.zeros(len(ids), np.float32)
    np.maximum.at(largest, np.searchsorted(ids, vertices), values)
    strongest = np.zeros(len(ids), records(section, []).dtype)
    strongest["vertex"], strongest[strongest.dtype.names[1]] = ids, largest  # type: ignore[index]
    return strongest


def _reactions(played: Played, bodies: _Bodies, modalities: set[str]) -> dict[str, Records]:
    """Records REAC and RCHV: vertices and factors by which an actuator shows effects of a modality.
    One reaction per actuator, effect modality shown (as itself or substituted) and model of the
    device's body; none for actuators at a fixed place in the room."""
    rows: list[tuple[Any, ...]] = []
    reached: list[Records] = []
    # Actuators are numbered over all devices, in the order of the baked part's records.
    first = 0
    for device, raster in played:
        for number, actuator in enumerate(device.actuators, first):
            if _has_fixed_place(actuator):
                continue
            # A record per effect modality shown by the actuator, as itself or by
            # substitution; 0 Hz stands for the effect's own frequency.
            for source in _MODALITIES:
                substitution = device.substitutions.get(source)
                if source == actuator.type.modality:
                    gain, frequency_hz = device.gain, 0.0
                elif substitution is not None and substitution.target == actuator.type.modality:
                    gain = device.gain * substitution.scale
                    frequency_hz = substitution.frequency_hz or 0.0
                else:
                    continue
                if source not in modalities:
                    continue
                for (body_id, _), (model, rank, whole) in bodies.stored_models.items():
                    if body_id != raster.body_id or whole.modality != MODALITIES[source].model:
                        continue
                    cells = cells_of(device, [actuator], whole)
                    (vertices,) = cells.rows
                    factors = np.ones(len(vertices)) if cells.factors is None else cells.factors
                    strongest = _strongest("RCHV", rank[vertices], factors)
                    statistic = int(device.scheme.statistic == "mean")
                    shown = number, model, _MODALITIES.index(source), statistic, gain, frequency_hz
                    rows.append((*shown, sum(map(len, reached)), len(strongest)))
                    reached.append(strongest)
        first += len(device.actuators)
    return {"REAC": records("REAC", rows), "RCHV": np.concatenate([records("RCHV", []), *reached])}


def _has_fixed_place(actuator: Actuator) -> bool:
    """Test for a place in the room with a position ``at_m``."""
    return isinstance(actuator.place, RoomPlace) and actuator.place.at_m is not None
