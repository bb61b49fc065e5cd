# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects as scene objects: making them, finding them, their stable ids and painted areas."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import bpy

from ...blender.scene_info import metres_of, scene_objects
from ...blender.stored_values import stored_at
from ...engine.modality import MODALITIES
from ...errors import InputError
from .. import volumes

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ...engine.arrays import F64
    from ...engine.body.model import PerceptualModel

COLLECTION = "HFX Effects"

ON_A_BODY = ("PAINTED", "SPOT", "ACTUATORS")
"""Kinds of effects that belong to a body."""

VERTICES = "hfx_vertices"
WEIGHTS = "hfx_weights"
"""ID properties that carry a painted area along with its object, wherever it is copied."""


def effects_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The effects of a scene and of its background scenes, by name."""
    found = [obj for obj in scene_objects(scene) if obj.hfx.role == "EFFECT"]
    return sorted(found, key=lambda obj: obj.name)


def bodies_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The haptic bodies (armatures) of a scene and of its background scenes, by name."""
    found = [obj for obj in scene_objects(scene) if obj.hfx.role == "BODY"]
    return sorted(found, key=lambda obj: obj.name)


def present(body: bpy.types.Object, bodies: Sequence[bpy.types.Object]) -> bpy.types.Object | None:
    """Body among those of a scene: itself, or the only override of a linked one."""
    if body in bodies:
        return body
    ours = [o for o in bodies if o.override_library and o.override_library.reference == body]
    return ours[0] if len(ours) == 1 else None


def body_in(scene: bpy.types.Scene, effect: bpy.types.Object) -> bpy.types.Object | None:
    """Body of a scene that an effect is felt on; None if it was deleted, or none was chosen.

    An effect that never had a body is felt on the only one.
    """
    bodies, body = bodies_of(scene), effect.hfx.body
    if body is None and not effect.hfx.body_name and len(bodies) == 1:
        body = bodies[0]
    return None if body is None else present(body, bodies)


def without_body(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Effects of a scene that need a body and have none in it, by name."""
    return [effect for effect in effects_of(scene) if needs_body(scene, effect)]


def needs_body(scene: bpy.types.Scene, effect: bpy.types.Object) -> bool:
    """Test for an effect that is felt on a body only and has none in a scene."""
    return effect.hfx.kind in ON_A_BODY and body_in(scene, effect) is None


def why_bodiless(effect: bpy.types.Object) -> str:
    """Reason why no body of a scene feels an effect; it goes on after the effect's name."""
    name = effect.hfx.body_name if effect.hfx.body is None else effect.hfx.body.name
    if not name:
        return "belongs to no body, and the scene has not exactly one"
    return f"belongs to body '{name}', which is not in the scene"


def remember_bodies(found: Iterable[bpy.types.Object]) -> None:
    """Store with effects the names of their bodies, which stay when a body is deleted."""
    for effect in found:
        # As they are stored: Blender forgets a value of another type where a property is read.
        body, name = (stored_at(effect, each) for each in ("body", "body_name"))
        if isinstance(body, bpy.types.Object) and effect.library is None and name != body.name:
            effect.hfx.body_name = body.name


def group_of(effect: bpy.types.Object) -> str:
    """Name of the group that an effect belongs to; "" for none."""
    return str(effect.hfx.group or effect.get("hfx_rain", ""))  # rain of earlier versions


def free_group(scene: bpy.types.Scene, name: str) -> str:
    """Name for a new group of effects: the given one, or with a number behind it."""
    known, found, number = {group_of(each) for each in effects_of(scene)}, name, 1
    while found in known:
        number += 1
        found = f"{name} {number}"
    return found


def move_to_body(found: Iterable[bpy.types.Object], body: bpy.types.Object) -> int:
    """Have effects felt on another body; returns how many.

    Their areas and paths are those of the canonical models, which all bodies share.
    """
    moved = [each for each in found if each.hfx.kind in ON_A_BODY and each.hfx.body != body]
    for effect in moved:
        effect.hfx.body = body
    return len(moved)


def is_locked(effect: bpy.types.Object) -> bool:
    """Test for an effect of a linked file that *Library Override > Make* took along.

    Blender greys out its settings until it is made editable.
    """
    return effect.override_library is not None and effect.override_library.is_system_override


def silenced(found: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """Effects of a scene that are muted, or not solo where others are."""
    found = list(found)
    any_solo = any(effect.hfx.is_solo for effect in found)
    return [e for e in found if e.hfx.is_muted or (any_solo and not e.hfx.is_solo)]


def model_id_for(modality: str) -> str:
    """Id of the perceptual model on which a modality is painted and felt."""
    return f"hfx-{MODALITIES[modality].model}-1"


def model_of(effect: bpy.types.Object) -> PerceptualModel:
    """Perceptual model on which an effect is painted and felt."""
    from ...engine.body.model import load_model  # Blender's start would wait for it

    return load_model(model_id_for(effect.hfx.modality))


def add_volume(
    scene: bpy.types.Scene, modality: str, shape: str, name: str | None = None
) -> bpy.types.Object:
    """An allocentric effect at the origin: a wire frame that is never rendered."""
    title = name or f"{modality.title()} {volumes.SHAPE_LABELS[shape]}"
    obj = bpy.data.objects.new(title, bpy.data.meshes.new(title))
    effect = _make_effect(scene, obj, modality, shape)
    effect.display_type = "WIRE"
    effect.hide_render = True
    volumes.refresh_display(effect)
    return effect


def volume_from_mesh(
    scene: bpy.types.Scene, modality: str, source: bpy.types.Object, name: str | None = None
) -> bpy.types.Object:
    """An allocentric effect with exactly the shape of a mesh object, moving along with it."""
    if source.type != "MESH":
        raise InputError(f"'{source.name}' is a {source.type.lower()}, not a mesh.")
    # A copy shares the mesh and brings the modifiers, so that it keeps the source's shape.
    copy = source.copy()
    copy.name = name or f"{source.name} {modality.title()}"
    copy.animation_data_clear()
    for constraint in list(copy.constraints):
        copy.constraints.remove(constraint)
    copy.parent = source
    copy.matrix_parent_inverse.identity()
    copy.matrix_basis.identity()
    effect = _make_effect(scene, copy, modality, "MESH")
    effect.display_type = "WIRE"
    effect.hide_render = True
    return effect


def add_painted(
    scene: bpy.types.Scene, modality: str, body: bpy.types.Object, name: str | None = None
) -> bpy.types.Object:
    """An egocentric effect on a body; its area is empty until it is painted."""
    effect = add_on_body(scene, modality, body, "PAINTED", name or f"Painted {modality.title()}")
    set_area(effect, [], [])
    return effect


def add_on_body(
    scene: bpy.types.Scene, modality: str, body: bpy.types.Object, kind: str, name: str
) -> bpy.types.Object:
    """Add an effect that belongs to a body, as an empty object."""
    if body.hfx.role != "BODY":
        raise InputError(f"'{body.name}' is not a haptic body.")
    effect = _make_effect(scene, bpy.data.objects.new(name, None), modality, None)
    effect.hfx.kind = kind
    effect.empty_display_type = "SINGLE_ARROW"
    effect.empty_display_size = 0.2 / metres_of(scene)
    effect.hfx.body = body
    return effect


def duplicate(effect: bpy.types.Object) -> bpy.types.Object:
    """A copy of an effect with an id and clips of its own, in the same collections."""
    copy = effect.copy()
    copy.hfx.uid = uuid.uuid4().hex
    if copy.animation_data is not None:
        if copy.animation_data.action is not None:
            copy.animation_data.action = copy.animation_data.action.copy()
        for track in copy.animation_data.nla_tracks:
            for strip in track.strips:
                if strip.action is not None:
                    strip.action = strip.action.copy()
    homes = [each for each in effect.users_collection if _is_own(each)]
    for collection in homes or [_collection(bpy.context.scene)]:
        collection.objects.link(copy)
    return copy


def _make_effect(
    scene: bpy.types.Scene, effect: bpy.types.Object, modality: str, shape: str | None
) -> bpy.types.Object:
    """Make an object an effect: a volume of a shape, or a painted one (None)."""
    # Kind and shape first: whatever is set draws the wires of a shape that is not a mesh.
    effect.hfx.kind = "PAINTED" if shape is None else "VOLUME"
    if shape is not None:
        effect.hfx.shape = shape
    effect.hfx.role = "EFFECT"
    effect.hfx.uid = uuid.uuid4().hex
    effect.hfx.modality = modality
    effect.color = volumes.modality_colour(modality)
    _collection(scene).objects.link(effect)
    return effect


def _collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """Collection for a new effect: one of our own that is visible, made if need be."""
    layer = bpy.context.view_layer if bpy.context.scene == scene else None
    unseen = set() if layer is None else set(_hidden(layer.layer_collection))
    for collection in scene.collection.children_recursive:
        is_ours = collection.name.startswith(COLLECTION)
        if is_ours and _is_own(collection) and collection not in unseen:
            return collection
    collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    return collection


def _is_own(collection: bpy.types.Collection) -> bool:
    """Test that objects can be added to a collection: those of a linked file take none."""
    return collection.library is None and collection.override_library is None


def _hidden(found: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    """Collections that are excluded from a view layer or hidden in it."""
    for child in found.children:
        if child.exclude or not child.is_visible:
            yield child.collection
        yield from _hidden(child)


def set_area(effect: bpy.types.Object, vertices: Iterable[int], weights: Iterable[float]) -> None:
    """Store a painted area: ids of the effect's perceptual model and a weight for each.

    Raises
    ------
    InputError
        An id is not of the model, or a weight is not in 0..1; the old area is kept.
    """
    model = model_of(effect)
    ids, strengths = checked_area(effect.name, list(vertices), list(weights), len(model))
    effect[VERTICES] = ids.tolist()
    effect[WEIGHTS] = strengths.tolist()
    effect.hfx.model_id = model.id
    effect.hfx.model_hash = model.content_hash


def store_weights(effect: bpy.types.Object, weights: F64) -> int:
    """Store the weights of all vertices (V,) as an effect's area; returns how many are painted.

    Raises
    ------
    InputError
        A weight is not in 0..1; the old area is kept.
    """
    vertices = weights.nonzero()[0]
    set_area(effect, vertices.tolist(), weights[vertices].tolist())
    return len(vertices)


def area(effect: bpy.types.Object) -> tuple[list[int], list[float]]:
    """The painted vertex ids and weights of an effect; empty where nothing was painted."""
    # An empty ID-property array has no element type and comes back as a plain list.
    return _stored(effect, VERTICES, int), _stored(effect, WEIGHTS, float)


def has_other_area(effect: bpy.types.Object) -> bool:
    """Test for an area that was painted on the model of another modality than the present one."""
    is_other = effect.hfx.model_id != model_id_for(effect.hfx.modality)
    return effect.hfx.kind == "PAINTED" and is_other and bool(area(effect)[0])


def _stored(effect: bpy.types.Object, key: str, kind: type) -> list[Any]:
    found = effect.get(key, [])
    try:
        values = list(found)
    except TypeError:
        values = [None]
    if not all(isinstance(each, kind) for each in values):
        raise InputError(
            f"Effect '{effect.name}': '{key}' is not a list of numbers; paint it again."
        )
    return values


def checked_area(
    name: str, vertices: list[int], weights: list[float], model_size: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """Ids (ascending) and weights of the vertices that are painted at all."""
    import numpy as np

    if len(vertices) != len(weights):
        raise InputError(
            f"Effect '{name}': {len(vertices)} painted vertices but {len(weights)} weights."
        )
    foreign = [vertex for vertex in vertices if not 0 <= vertex < model_size]
    if foreign:
        raise InputError(
            f"Effect '{name}': painted vertex {foreign[0]} is not one of the model's "
            f"{model_size} vertices."
        )
    ids = np.array(vertices, np.int64)
    strengths = np.array(weights, np.float32)
    if not (np.isfinite(strengths).all() and ((strengths >= 0) & (strengths <= 1)).all()):
        raise InputError(f"Effect '{name}': a painted weight is not a number from 0 to 1.")
    order = np.argsort(ids, kind="stable")
    order = order[strengths[order] > 0]
    ids, strengths = ids[order], strengths[order]
    if (np.diff(ids) == 0).any():
        raise InputError(f"Effect '{name}': a vertex is painted twice.")
    return ids.astype(np.int32), strengths


def unique_ids(objects: list[bpy.types.Object]) -> dict[str, str]:
    """A stable id for each object, by its full name, which tells linked files apart.

    Blender copies properties with the object, so copies share their ``uid``: the first by name
    keeps it, each other gets one derived from it, the same on every run.
    """
    known = {obj.hfx.uid or obj.name for obj in objects}
    counts: dict[str, int] = {}
    ids: dict[str, str] = {}
    for obj in sorted(objects, key=lambda obj: (obj.name, obj.name_full)):
        uid = own = obj.hfx.uid or obj.name
        counts[own] = counts.get(own, 0) + 1
        while counts[own] > 1 and uid in known:  # an id may look like a derived one
            uid = f"{own}-{counts[own]}"
            counts[own] += uid in known
        known.add(uid)
        ids[obj.name_full] = uid
    return ids


def settle_ids() -> None:
    """Write down the ids of copies, so that renaming cannot swap them afterwards."""
    owned = [obj for obj in bpy.data.objects if obj.hfx.role != "NONE" and obj.library is None]
    for name, uid in unique_ids(owned).items():
        bpy.data.objects[name, None].hfx.uid = uid
