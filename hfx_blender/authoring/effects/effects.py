# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects as scene objects: creation, lookup, unique ids, bodies and painted areas."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ...blender.scene_info import metres_of, scene_objects
from ...blender.stored_values import stored_at
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...text import named
from .. import clips

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ...engine.arrays import F64
    from ...engine.body.model import PerceptualModel

COLLECTION = "HFX Effects"

ON_A_BODY = ("PAINTED", "SPOT", "ACTUATORS")
_SHORT = {"temperature": "Heat"}  # in names, as the list of effects is narrow
"""Kinds of effects on a body."""

VERTICES = "hfx_vertices"
WEIGHTS = "hfx_weights"
"""ID properties of a painted area, copied along with the object."""


def effects_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Effects of a scene and its background scenes, sorted by name."""
    return sorted(by_role(scene).get("EFFECT", ()), key=lambda obj: obj.name)


def bodies_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Haptic bodies (armatures) of a scene and its background scenes, sorted by name."""
    return sorted(by_role(scene).get("BODY", ()), key=lambda obj: obj.name)


def by_role(scene: bpy.types.Scene) -> dict[str, list[bpy.types.Object]]:
    """Objects of a scene and its background scenes by role, in the order of the scene; roles
    without objects are missing. The role is "" for a stored value that is no role."""
    objects: dict[str, list[bpy.types.Object]] = {}
    for obj in scene_objects(scene):
        objects.setdefault(obj.hfx.role, []).append(obj)
    return objects


def body_in(scene: bpy.types.Scene, effect: bpy.types.Object) -> bpy.types.Object | None:
    """Body of an effect in a scene; None for a deleted or ambiguous body. An effect that never had
    a body belongs to the only body of the scene."""
    bodies, body = bodies_of(scene), effect.hfx.body
    if body is None and not effect.hfx.body_name and len(bodies) == 1:
        body = bodies[0]
    if body is None or body in bodies:
        return body
    # A linked body is replaced by its override, if the scene has exactly one.
    overrides = [o for o in bodies if o.override_library and o.override_library.reference == body]
    return overrides[0] if len(overrides) == 1 else None


def effects_without_body(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Effects of a scene that need a body and have none, sorted by name."""
    return [effect for effect in effects_of(scene) if needs_body(scene, effect)]


def needs_body(scene: bpy.types.Scene, effect: bpy.types.Object) -> bool:
    """Test for an effect of a kind on a body, without a body in the scene."""
    return effect.hfx.kind in ON_A_BODY and body_in(scene, effect) is None


def missing_body_reason(effect: bpy.types.Object) -> str:
    """Reason for the missing body of an effect, to follow the effect's name in a sentence."""
    name = effect.hfx.body_name if effect.hfx.body is None else effect.hfx.body.name
    if not name:
        return "belongs to no body, and the scene has not exactly one"
    # Blender clears the pointer to a deleted body, and the stored name stays. A body that has this
    # name now is another body.
    namesake = bpy.data.objects.get(name)
    if effect.hfx.body is None and namesake is not None and namesake.hfx.role == "BODY":
        return "belongs to a body that was deleted"
    return f"belongs to body '{name}', which is not in the scene"


def store_body_names(objects: Iterable[bpy.types.Object]) -> None:
    """Store the name of an assigned body on each unlinked effect, where it differs."""
    for effect in objects:
        # Raw stored values: reading the property erases a value of another type.
        body, name = (stored_at(effect, prop) for prop in ("body", "body_name"))
        if isinstance(body, bpy.types.Object) and effect.library is None and name != body.name:
            effect.hfx.body_name = body.name


def group_of(effect: bpy.types.Object) -> str:
    """Name of an effect's group; "" without one."""
    # Earlier versions had groups of rain only, in an ID property.
    return str(effect.hfx.group or effect.get("hfx_rain", ""))


def free_group(scene: bpy.types.Scene, name: str) -> str:
    """Unused group name in a scene: the given name, with a number appended if needed."""
    groups, free_name, number = {group_of(effect) for effect in effects_of(scene)}, name, 1
    while free_name in groups:
        number += 1
        free_name = f"{name} {number}"
    return free_name


def set_group(scene: bpy.types.Scene, objects: Iterable[bpy.types.Object], name: str) -> None:
    """Move effects to a group with gain and mute of its present effects in the scene; for "" out of
    any group, with gain 1 and not muted."""
    members = (effect.hfx for effect in effects_of(scene) if name and group_of(effect) == name)
    gain, mute = next(((hfx.group_gain, hfx.is_group_muted) for hfx in members), (1.0, False))
    for effect in objects:
        # Rain is replaced by its name in an ID property, which names a group of earlier versions.
        effect.hfx.group = name or (effect.name if effect.get("hfx_rain") else "")
        effect.hfx.group_gain, effect.hfx.is_group_muted = gain, mute


def move_to_body(objects: Iterable[bpy.types.Object], body: bpy.types.Object) -> int:
    """Assign effects to another body; return the number of changed effects. Areas and paths stay
    valid between bodies with the same set of models. Volumes and surfaces are skipped."""
    moved = [obj for obj in objects if obj.hfx.kind in ON_A_BODY and obj.hfx.body != body]
    for effect in moved:
        effect.hfx.body = body
    return len(moved)


def is_locked(effect: bpy.types.Object) -> bool:
    """Test for a linked effect, or one in a system override, made along with another override of
    the file. Blender disables its settings until it is made editable."""
    override = effect.override_library
    return effect.library is not None or (override is not None and override.is_system_override)


def without_locked(objects: Iterable[bpy.types.Object]) -> tuple[list[bpy.types.Object], str]:
    """Effects that are not locked, in order, and the end of a report with the names of the locked
    ones, "" without any. Raises InputError: all effects are locked."""
    objects = list(objects)
    locked = [effect for effect in objects if is_locked(effect)]  # Blender saves no changes of them
    if locked and len(locked) == len(objects):
        raise InputError(f"'{locked[0].name}' belongs to a linked file. Press Make Editable first.")
    names = named([effect.name for effect in locked])
    ending = f"; linked effects stay unchanged: {names}" if locked else ""
    return [effect for effect in objects if effect not in locked], ending


def muted_effects(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """Muted effects, and effects that are not solo if another given effect is."""
    objects = list(objects)
    # A mute counts even for an effect that is solo.
    any_solo = any(effect.hfx.is_solo for effect in objects)
    return [e for e in objects if is_muted(e) or (any_solo and not e.hfx.is_solo)]


def is_muted(effect: bpy.types.Object) -> bool:
    """Test for an effect that is muted by itself or with its group."""
    return bool(effect.hfx.is_muted or effect.hfx.is_group_muted)


def model_id_for(modality: str, body: bpy.types.Object | None) -> str:
    """Id of a modality's perceptual model in the set of a body; without a body, or if the set has
    no such model, of the shipped model."""
    shipped = f"hfx-{MODALITIES[modality].model}-1"
    ids = () if body is None else body.hfx.body_models.split()
    return next((own for own in ids if own.startswith(f"{shipped}-")), shipped)


def model_id_of(effect: bpy.types.Object) -> str:
    """Id of the perceptual model of an effect's present modality, in the set of its body."""
    return model_id_for(effect.hfx.modality, body_of(effect))


def body_of(effect: bpy.types.Object) -> bpy.types.Object | None:
    """Body of an effect; for no body or a linked one, the body in the open scene, or None."""
    body = effect.hfx.body
    is_local = body is not None and body.library is None  # a linked body may have an override
    return body if is_local else body_in(bpy.context.scene, effect)


def model_of(effect: bpy.types.Object) -> PerceptualModel:
    """Perceptual model of the effect's present modality, not of its stored area."""
    from ...engine.body.model import load_model  # not needed at Blender's start

    return load_model(model_id_of(effect))


def add_volume(
    scene: bpy.types.Scene, modality: str, shape: str, name: str | None = None
) -> bpy.types.Object:
    """Add a volume at the world origin, shown as wires; default name as "Pressure Sphere"."""
    label = "Box" if shape == "CUBOID" else shape.title()
    title = name or f"{_SHORT.get(modality, modality.title())} {label}"
    obj = bpy.data.objects.new(title, bpy.data.meshes.new(title))
    return _make_effect(scene, obj, modality, shape)


def volume_from_mesh(
    scene: bpy.types.Scene, modality: str, source: bpy.types.Object, name: str | None = None
) -> bpy.types.Object:
    """Add a volume effect with the shape of a mesh object, parented to that object: a copy that
    shares the mesh, without animation, constraints and rigid body. Raises InputError for another
    type of object."""
    if source.type != "MESH":
        raise InputError(f"'{source.name}' is a {source.type.lower()}, not a mesh.")
    # A copy shares the mesh and copies the modifiers, so that edits of the mesh apply to both.
    copy = source.copy()
    copy.name = name or f"{source.name} {_SHORT.get(modality, modality.title())}"
    copy.animation_data_clear()
    for constraint in list(copy.constraints):
        copy.constraints.remove(constraint)
    # As a child without offset it moves with the source.
    copy.parent = source
    copy.matrix_parent_inverse.identity()
    copy.matrix_basis.identity()
    effect = _make_effect(scene, copy, modality, "MESH")
    if effect.rigid_body is not None:  # simulated below a simulated parent: a dependency cycle
        with bpy.context.temp_override(scene=scene, object=effect, active_object=effect):
            bpy.ops.rigidbody.object_remove()
    return effect


def add_painted(
    scene: bpy.types.Scene, modality: str, body: bpy.types.Object, name: str | None = None
) -> bpy.types.Object:
    """Add a painted effect with an empty area; InputError if ``body`` is no haptic body."""
    name = name or f"Painted {_SHORT.get(modality, modality.title())}"
    effect = add_on_body(scene, modality, body, "PAINTED", name)
    set_area(effect, [], [])
    return effect


def add_on_body(
    scene: bpy.types.Scene, modality: str, body: bpy.types.Object, kind: str, name: str
) -> bpy.types.Object:
    """Add an effect of a kind on a body, as an empty; InputError for an object that is no body."""
    if body.hfx.role != "BODY":
        raise InputError(f"'{body.name}' is not a haptic body.")
    effect = _make_effect(scene, bpy.data.objects.new(name, None), modality, None)
    effect.hfx.kind = kind
    effect.empty_display_type = "SINGLE_ARROW"
    effect.empty_display_size = 0.2 / metres_of(scene)
    effect.hfx.body = body
    return effect


def duplicate(effect: bpy.types.Object) -> bpy.types.Object:
    """Copy an effect with a new id and copied actions into its local collections, or into ``HFX
    Effects`` of the current scene without any. The copy is local, also that of a linked effect. The
    clips of the copy are the only selected ones."""
    clips.deselect_all()
    copy = effect.copy()
    if copy.override_library is not None:
        copy.make_local(clear_liboverride=True)  # an override does not store a painted area
    copy.hfx.uid = uuid.uuid4().hex
    if copy.animation_data is not None:
        # Object.copy() shares the actions: an edited clip would change on both effects.
        if copy.animation_data.action is not None:
            copy.animation_data.action = copy.animation_data.action.copy()
        for track in copy.animation_data.nla_tracks:
            for strip in track.strips:
                strip.select = True
                if strip.action is not None:
                    strip.action = strip.action.copy()
    collections = [collection for collection in effect.users_collection if _is_editable(collection)]
    for collection in collections or [_collection(bpy.context.scene)]:
        collection.objects.link(copy)
    return copy


def _make_effect(
    scene: bpy.types.Scene, effect: bpy.types.Object, modality: str, shape: str | None
) -> bpy.types.Object:
    """Turn a new object into an effect with a new id, and link it: a volume of ``shape``, shown as
    wires, or a painted effect for None."""
    # Kind and shape first: assigning the modality sets the colour and redraws the wires.
    effect.hfx.kind = "PAINTED" if shape is None else "VOLUME"
    if shape is not None:
        effect.hfx.shape = shape
        effect.display_type, effect.hide_render = "WIRE", True
    effect.hfx.role = "EFFECT"
    effect.hfx.uid = uuid.uuid4().hex
    effect.hfx.modality = modality
    _collection(scene).objects.link(effect)
    return effect


def _collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """First local collection of a scene whose name starts with ``HFX Effects``, and that the
    current view layer does not hide; created if missing."""
    # An effect in a hidden collection would be left out of exports without the user's intention.
    layer = bpy.context.view_layer if bpy.context.scene == scene else None
    hidden = set() if layer is None else set(_hidden(layer.layer_collection))
    for collection in scene.collection.children_recursive:
        is_for_effects = collection.name.startswith(COLLECTION)
        if is_for_effects and _is_editable(collection) and collection not in hidden:
            return collection
    collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    return collection


def _is_editable(collection: bpy.types.Collection) -> bool:
    """Test for a collection that is neither linked nor an override."""
    return collection.library is None and collection.override_library is None


def _hidden(parent: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    """Yield collections at any depth below ``parent`` that are excluded or not visible."""
    for child in parent.children:
        if child.exclude or not child.is_visible:
            yield child.collection
        yield from _hidden(child)


def set_area(effect: bpy.types.Object, vertices: Iterable[int], weights: Iterable[float]) -> None:
    """Store a painted area: vertex ids of the effect's perceptual model, and their weights. Raises
    InputError: an id is not in the model, or a weight is not 0 to 1; the old area is unchanged."""
    model = model_of(effect)
    ids, strengths = checked_area(effect.name, list(vertices), list(weights), len(model))
    effect[VERTICES] = ids.tolist()
    effect[WEIGHTS] = strengths.tolist()
    effect.hfx.model_id = model.id
    effect.hfx.model_hash = model.content_hash


def store_weights(effect: bpy.types.Object, weights: F64) -> int:
    """Store weights (V,) of all vertices as an effect's area; return how many are not zero. Raises
    InputError: a weight is not 0 to 1; the old area is unchanged."""
    vertices = weights.nonzero()[0]
    set_area(effect, vertices.tolist(), weights[vertices].tolist())
    return len(vertices)


def area(effect: bpy.types.Object) -> tuple[list[int], list[float]]:
    """Painted vertex ids and weights of an effect; two empty lists without an area."""
    return _stored(effect, VERTICES, int), _stored(effect, WEIGHTS, float)


def has_other_area(effect: bpy.types.Object) -> bool:
    """Test for an area painted on a perceptual model of another modality or set."""
    if effect.hfx.kind != "PAINTED" or effect.hfx.model_id == model_id_of(effect):
        return False
    return bool(area(effect)[0])


def _stored(effect: bpy.types.Object, key: str, kind: type) -> list[Any]:
    """List in an ID property, [] if missing; raises InputError for another type or for items that
    are not of ``kind``."""
    stored = effect.get(key, [])
    try:
        values = list(stored)
    except TypeError:
        values = [None]
    if not all(isinstance(value, kind) for value in values):
        raise InputError(
            f"Effect '{effect.name}': '{key}' is not a list of numbers; paint it again."
        )
    return values


def checked_area(
    name: str, vertices: list[int], weights: list[float], model_size: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """Check an area; return its ids (ascending, int32) and weights without zeros. Raises
    InputError: numbers of ids and weights differ, an id is not in the model or is repeated, or a
    weight is not 0 to 1."""
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
    # Equal areas give equal tracks: the stored order and zeros do not matter.
    order = np.argsort(ids, kind="stable")
    order = order[strengths[order] > 0]
    ids, strengths = ids[order], strengths[order]
    if (np.diff(ids) == 0).any():
        raise InputError(f"Effect '{name}': a vertex is painted twice.")
    return ids.astype(np.int32), strengths


def unique_ids(objects: list[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """Unique id of each object: its ``uid``, or name. Copies share the ``uid``: the first by name
    has it, further objects ``uid-2``, ``uid-3`` ..., equal on each run."""
    uids = {obj: obj.hfx.uid or obj.name for obj in objects}
    used = {*uids.values()}
    # Sorted by name, the original ("Ball") precedes its copies ("Ball.001").
    counts: dict[str, int] = {}
    ids: dict[bpy.types.Object, str] = {}
    for obj in sorted(objects, key=lambda obj: (obj.name, obj.name_full)):
        uid = stored_uid = uids[obj]
        counts[stored_uid] = counts.get(stored_uid, 0) + 1
        while counts[stored_uid] > 1 and uid in used:  # a stored id may equal a derived one
            uid = f"{stored_uid}-{counts[stored_uid]}"
            counts[stored_uid] += uid in used
        used.add(uid)
        ids[obj] = uid
    return ids


def shown_names(objects: Iterable[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """Name of each object; the full name, with the library, if the file has more of that name."""
    if not bpy.data.libraries:
        return {obj: obj.name for obj in objects}
    counts = Counter(obj.name for obj in bpy.data.objects)
    return {obj: obj.name if counts[obj.name] == 1 else obj.name_full for obj in objects}


def store_unique_ids() -> None:
    """Store the unique ids of local objects, before renaming can change their order."""
    owned = [obj for obj in bpy.data.objects if obj.hfx.role != "NONE" and obj.library is None]
    for obj, uid in unique_ids(owned).items():
        obj.hfx.uid = uid
