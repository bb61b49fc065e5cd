# SPDX-License-Identifier: GPL-3.0-or-later
"""Constant part of a scene: haptic objects with settings.

Faults preventing an export are raised before any time is evaluated.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...authoring import volumes
from ...authoring.effects import effect_values, effects, model_migration
from ...authoring.effects.effect_values import ShapeCache
from ...avatars import avatar_meshes, body_binding
from ...blender import linked_files
from ...blender.scene_info import metres_of, scene_objects
from ...blender.stored_values import bad_values
from ...engine.body.model import load_model
from ...engine.scene import (
    ActuatorArea,
    BodyDescription,
    Clip,
    EffectDescription,
    HapticSurface,
    HapticVolume,
    PaintedArea,
    SceneDescription,
    SpotArea,
    TimeBase,
)
from ...errors import InputError
from ...files.hashes import sha256_of
from ...text import MOST_LINES, MOST_NAMES, named, shortened
from ...version import __version__
from ..curves.animation_time import animation_frames, played_frame, sample_frames
from ..curves.curve_reading import is_steady
from ..stepped import reached
from ..stepped.simulation import Simulation
from . import activation, area_values, response_values, soundness, visibility
from .equal_settings import EqualSettings
from .scene_settings import scene_feel

IN_SCENE = ("VOLUME", "SURFACE")  # kinds of effects in the scene; bodies must be posed for them

ABSENT = "is disabled in viewports or excluded from the view layer"
_CURE = "press Move to Body in the panel Haptic Effect"

_Area = PaintedArea | HapticVolume | HapticSurface | SpotArea | ActuatorArea


@dataclass(frozen=True)
class HapticObjects:
    """Participating bodies and effects of a scene, with the activations of the effects."""

    scene: bpy.types.Scene
    layer: bpy.types.ViewLayer
    bodies: list[bpy.types.Object]
    effects: list[bpy.types.Object]
    activations: list[activation.Activation]
    warnings: tuple[str, ...]  # all warnings so far
    simulation: Simulation | None = None
    left_out: tuple[str, ...] = ()  # warnings about faulty effects and bodies
    notes: tuple[str, ...] = ()  # about NaN or infinite keyframes
    gone: Mapping[bpy.types.Object, str] = field(default_factory=dict)  # excluded effect -> reason
    equal: EqualSettings = field(default_factory=lambda: EqualSettings({}))  # of effects
    instancers: Sequence[bpy.types.Object] = ()  # objects that may show further objects
    # Effects that are off at all read times, also sources of instances, with reasons; no other
    # values of them are read.
    dormant: Mapping[bpy.types.Object, str] = field(default_factory=dict)

    @property
    def active(self) -> list[int]:
        """Indices of the effects that are not dormant, ascending."""
        return [k for k, effect in enumerate(self.effects) if effect not in self.dormant]

    @property
    def read(self) -> list[bpy.types.Object]:
        """Objects to read: effects that are not dormant, all bodies, then the avatar meshes of
        bodies bound to a surface."""
        bodies = [body for body in self.bodies if body_binding.surface_reason(body) is not None]
        followed = [mesh for body in bodies for mesh in avatar_meshes.meshes_of(body)]
        return [*(self.effects[k] for k in self.active), *self.bodies, *followed]

    @property
    def unit_m(self) -> float:
        """Metres per Blender unit."""
        return metres_of(self.scene)


def find(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> HapticObjects:
    """Collect the enabled bodies and effects of a scene, and warnings about excluded ones. Updates
    the view layer, and tags objects with unreported changes. Muted effects are included as
    silenced. Raises InputError without a body or effect, and if all of either are faulty."""
    # Evaluated copies may refer to removed data-blocks; reading such a reference would crash.
    layer.update()
    by_role = effects.by_role(scene)
    of_role = {role: sorted(found, key=lambda obj: obj.name) for role, found in by_role.items()}
    bodies, candidates = of_role.get("BODY", []), of_role.get("EFFECT", [])
    stored = {obj: visibility.stored_of(obj) for obj in (*candidates, *bodies)}
    if visibility.tag_changed(stored, layer):
        layer.update()
    refuse_bad_unit(scene)
    enabled = visibility.enabled_objects(scene, layer)
    bodies, body_warnings, left_out = _find_bodies(scene, layer, bodies, enabled)
    instancers = reached.instancers_of(scene)
    shown = [effect for effect in candidates if visibility.may_be_seen(effect, layer, enabled)]
    if not (shown or instancers):  # which may show volumes of other scenes
        if not candidates:
            raise _refusal([f"Scene '{scene.name}' has no haptic effects.", *_missing_data()])
        raise InputError(
            f"Scene '{scene.name}': all of its haptic effects are disabled in viewports."
        )
    # Blender reads a stored enum value that is no item, as of a later version, as "".
    roleless = by_role.get("", ())
    bad_roles = ((obj, bad) for obj in roleless for bad in bad_values(obj) if bad.path == "role")
    unknown = (f"object '{obj.name}': {bad}; it was left out" for obj, bad in bad_roles)
    warnings = (*unknown, *body_warnings)
    equal = EqualSettings({effect: stored[effect] for effect in shown})
    # Before all other values: Blender drops a stored value of another type on the first read.
    looked_at = equal.shared(lambda effect: (effect, soundness.warnings_of(effect)))

    def warnings_of(effect: bpy.types.Object) -> list[str]:
        first, texts = looked_at(effect)
        # Warnings name the effect.
        return texts if first == effect or not texts else soundness.warnings_of(effect)

    sound, faults = soundness.without_faulty(shown, warnings_of)
    warnings += tuple(text for texts in sound.values() for text in texts)
    needs_body = equal.shared(lambda effect: effects.needs_body(scene, effect))
    bodiless = {e: effects.missing_body_reason(e) for e in sound if needs_body(e)}
    sound = {effect: texts for effect, texts in sound.items() if effect not in bodiless}
    muted = {*effects.muted_effects(shown)} if bodiless else ()
    warnings += _excluded({e: why for e, why in bodiless.items() if e not in muted})
    if shown and not sound and not instancers:
        of_bodiless = (f"Effect '{e.name}' {why}; {_CURE}." for e, why in bodiless.items())
        raise _refusal((*faults.values(), *of_bodiless))
    left_out += soundness.left_out(faults)
    silent = {*map(equal.group_of, effects.muted_effects(equal.distinct(sound)))}
    activation_of = equal.shared(activation.activation_of)
    activations = [
        activation.SILENCED if equal.group_of(effect) in silent else activation_of(effect)
        for effect in sound
    ]
    seen = {*shown}  # quick membership, for thousands of effects
    gone = {effect: ABSENT for effect in candidates if effect not in seen}
    return HapticObjects(
        scene,
        layer,
        bodies,
        list(sound),
        activations,
        warnings,
        left_out=left_out,
        notes=soundness.non_finite_keyframes([*bodies, *sound]),
        gone={**gone, **bodiless, **_predicates(faults)},
        equal=equal,
        instancers=instancers,
    )


def _refusal(faults: Collection[str]) -> InputError:
    """InputError with the faults of a scene without any usable object, shortened to a few."""
    return InputError(" ".join(shortened(faults, MOST_LINES)))


def _missing_data() -> list[str]:
    """Sentences about missing linked data-blocks, which may be a body or effects."""
    return [f"{text[0].upper()}{text[1:]}." for text in linked_files.missing_data()]


def refuse_bad_unit(scene: bpy.types.Scene) -> None:
    """Raise InputError for a scene's Unit Scale outside 1e-9 to 1e9, or NaN; returns nothing."""
    unit = scene.unit_settings.scale_length
    if not 1e-9 <= unit <= 1e9:
        raise InputError(
            f"Scene '{scene.name}': its Unit Scale is {unit:g}, allowed is 1e-09 to 1e+09."
        )


def _find_bodies(
    scene: bpy.types.Scene,
    layer: bpy.types.ViewLayer,
    bodies: list[bpy.types.Object],
    enabled: set[bpy.types.Object],
) -> tuple[list[bpy.types.Object], tuple[str, ...], tuple[str, ...]]:
    """Valid ``bodies``, warnings about corrected values, and one warning for each excluded
    body. Excluded: no armature, disabled (also a mesh of the avatar), unreadable values. Raises
    InputError without any body (another text if a collection instance has one) and if all are
    excluded."""
    if not bodies:
        # A linked character arrives as an instance of its collection.
        instancers = [obj for obj in scene_objects(scene) if obj.instance_collection is not None]
        for obj in instancers:
            for member in obj.instance_collection.all_objects:
                if member.hfx.role == "BODY":
                    raise InputError(
                        f"Scene '{scene.name}' shows the haptic body '{member.name}' only as an "
                        f"instance, by '{obj.name}', and instances are not posed: select it and "
                        "make a library override (Object > Library Override > Make), or make it "
                        "real."
                    )
        nobody = (
            f"Scene '{scene.name}' has no haptic body: nobody is there to feel its "
            "effects. Add one with Add > Haptic > Avatar, or mark an armature as a body."
        )
        raise _refusal([nobody, *_missing_data()])

    def check(body: bpy.types.Object) -> list[str]:
        warnings = soundness.warnings_of(body)
        if body.type != "ARMATURE":
            raise InputError(f"Body '{body.name}' is no armature: nothing poses it.")
        for obj in (body, *avatar_meshes.meshes_of(body)):
            if not visibility.may_be_seen(obj, layer, enabled):
                raise InputError(
                    f"Body '{body.name}': '{obj.name}' is disabled in viewports or excluded "
                    "from the view layer, so Blender does not pose it."
                )
        return warnings

    sound, faults = soundness.without_faulty(bodies, check)
    if not sound:
        raise _refusal(faults.values())
    if len({body.hfx.body_models for body in sound}) > 1:
        raise InputError(
            f"Scene '{scene.name}': its bodies have different sets of body models, and an effect "
            "is felt on one model by all bodies: choose a set in Body Models, in the panel Haptic "
            "Body."
        )
    warnings = tuple(text for texts in sound.values() for text in texts)
    return list(sound), warnings, soundness.left_out(faults)


def _excluded(reasons: Mapping[bpy.types.Object, str]) -> tuple[str, ...]:
    """One warning for each reason of the excluded effects, with at most 12 names."""
    names_by_reason: dict[str, list[str]] = {}
    names = effects.shown_names(reasons)
    for effect, why in reasons.items():
        names_by_reason.setdefault(why, []).append(f"'{names[effect]}'")
    texts = []
    for why, quoted in names_by_reason.items():
        count, listed = len(quoted), named(quoted, MOST_NAMES)
        if count == 1:
            text = f"effect {listed} {why}: it was left out"
            curable = f"effect {listed} {why}: it was left out; {_CURE}"
        else:
            text = f"{count} effects were left out, as each {why}: {listed}"
            curable = f"{count} effects were left out, as each {why}; {_CURE}: {listed}"
        texts.append(text if why == ABSENT else curable)
    return tuple(texts)


def describe(
    haptics: HapticObjects,
    time: TimeBase,
    shapes: ShapeCache,
    *,
    always_posed: bool,
    more: Sequence[EffectDescription] = (),
) -> tuple[HapticObjects, SceneDescription]:
    """Describe the haptic objects of a scene for the engine; returns only the described objects,
    and the description. Volumes' shapes are cached in ``shapes``. With ``always_posed`` bodies are
    also posed for painted effects. The instances ``more`` follow the scene's own effects. Faulty
    effects and bodies, and effects on these bodies, are left out with a warning. Raises InputError
    with all faults if no effect or no body is left."""
    ids = effects.unique_ids([*haptics.bodies, *haptics.effects])
    names = effects.shown_names([*haptics.bodies, *haptics.effects])
    states = dict(zip(haptics.effects, haptics.activations, strict=True))

    def facts_of(effect: bpy.types.Object, is_dormant: bool) -> tuple[Any, ...]:
        clips = played_clips(haptics.scene, states[effect])
        return *_facts(effect, is_dormant, haptics, ids), clips

    facts_of_volume = haptics.equal.shared(facts_of)
    kind_of = haptics.equal.shared(lambda effect: effect.hfx.kind)
    depsgraph = haptics.layer.depsgraph
    shape_of = haptics.equal.shared(lambda effect: effect.evaluated_get(depsgraph).hfx.shape)

    def work(effect: bpy.types.Object) -> EffectDescription:
        is_dormant = effect in haptics.dormant
        is_volume = kind_of(effect) == "VOLUME"
        if is_volume and shape_of(effect) == "MESH" and not is_dormant and is_steady(effect):
            shapes.shape_of(effect, effect.evaluated_get(depsgraph))  # a bad mesh is reported now
        # The areas of other effects depend on more than settings.
        facts = (facts_of_volume if is_volume else facts_of)(effect, is_dormant)
        return EffectDescription(ids[effect], names[effect], *facts)

    described, faults = soundness.without_faulty(haptics.effects, work)
    if not described and not more:
        none = f"Scene '{haptics.scene.name}' has no haptic effects."
        raise _refusal(faults.values() or [none])
    frames = sample_frames(time, np.arange(time.sample_count))
    frames = animation_frames(haptics.scene, frames)
    # Binding a model to a body is slow: only models of effects that may be felt are bound.
    posed = {effect.model_id for effect in more}
    for effect, description in described.items():
        if description.model_id in posed or effect in haptics.dormant:
            continue
        is_posed = description.kind == "volume" or always_posed
        if is_posed and states[effect].may_be_on(frames).any():
            posed.add(description.model_id)
    bindings, unbound = soundness.without_faulty(
        haptics.bodies, lambda body: body_binding.binding_of(body, posed)
    )
    if not bindings:
        raise _refusal(unbound.values())
    if unbound:
        # Effects on these bodies become invalid too, so describe again without the bodies.
        left_out = (*haptics.left_out, *soundness.left_out(unbound))
        others = replace(haptics, bodies=list(bindings), left_out=left_out)
        return describe(others, time, shapes, always_posed=always_posed, more=more)
    valid = replace(
        haptics,
        effects=list(described),
        activations=[states[effect] for effect in described],
        left_out=(*haptics.left_out, *soundness.left_out(faults)),
        gone={**haptics.gone, **_predicates(faults)},
    )
    absent = {effect: why for effect, why in haptics.gone.items() if why == ABSENT}
    warnings = [*_excluded(absent), *haptics.warnings, *valid.left_out]
    warnings += filter(None, map(body_binding.warning_of, haptics.bodies))
    box_of = haptics.equal.shared(volumes.wire_box)
    for effect, description in described.items():
        if effect not in haptics.dormant and volumes.has_edited_wire(effect, box_of(effect)):
            warnings += soundness.warnings_of_wire(effect)
        # Forces act outwards: such a surface pushes only skin that is inside.
        if isinstance(description.area, HapticSurface) and description.area.law is not None:
            mesh = effect.evaluated_get(haptics.layer.depsgraph).data
            if area_values.points_inward(mesh):
                warnings.append(
                    f"surface '{effect.name}': its normals point inward, so it does not push skin "
                    "out; recalculate them (Mesh > Normals > Recalculate Outside)"
                )
    if bpy.app.autoexec_fail:
        warnings.append(
            "Blender did not run a script or a driver of this file "
            f"({bpy.app.autoexec_fail_message}): motion that depends on it is not exported"
        )
    return valid, SceneDescription(
        time=time,
        bodies=tuple(
            BodyDescription(ids[body], names[body], binding) for body, binding in bindings.items()
        ),
        effects=(*described.values(), *more),
        source=_source(haptics.scene),
        warnings=tuple(dict.fromkeys(warnings)),
        feel=scene_feel(haptics.scene),
    )


def _predicates(faults: Mapping[bpy.types.Object, str]) -> dict[bpy.types.Object, str]:
    """Text to show after the name of each excluded object, from its error message: without the
    words "Effect 'NAME'" at the start, else after the words "has a fault: "."""
    predicates = {}
    for obj, why in faults.items():
        rest = re.sub(rf"^[Ee]ffect '{re.escape(obj.name)}'", "", why.removesuffix("."))
        is_predicate = rest.startswith(" ")
        predicates[obj] = rest.strip() if is_predicate else f"has a fault: {rest.lstrip(' :')}"
    return predicates


def _facts(
    effect: bpy.types.Object,
    is_dormant: bool,
    haptics: HapticObjects,
    ids: Mapping[bpy.types.Object, str],
) -> tuple[str, str, _Area, bool]:
    """Modality, id of the model, area by kind, and flag of contact temperature of an effect's
    description; ``ids`` are unique ids. A dormant volume or surface becomes a volume with a
    falloff only. Raises InputError for a faulty area."""
    hfx = effect.hfx
    area: _Area
    if is_dormant and hfx.kind in IN_SCENE:
        area = HapticVolume(effect_values.falloff(hfx))
    elif hfx.kind == "PAINTED":
        area = _painted_area(effect, haptics, ids)
    elif hfx.kind == "SURFACE":
        evaluated = effect.evaluated_get(haptics.layer.depsgraph)
        area = area_values.surface_area(effect, evaluated, haptics.unit_m)
    elif hfx.kind == "SPOT":
        area = area_values.spot_area(effect, ids[_body_of(effect, haptics)])
    elif hfx.kind == "ACTUATORS":
        area = area_values.actuator_area(effect, ids[_body_of(effect, haptics)])
    else:
        area = response_values.volume_of(effect)
    model_id = effects.model_id_for(hfx.modality, haptics.bodies[0])
    return hfx.modality, model_id, area, hfx.temperature_reference == "CONTACT"


def played_clips(scene: bpy.types.Scene, state: activation.Activation) -> tuple[Clip, ...]:
    """All clips of an activation in order, with ends in played instead of animation frames."""
    return tuple(
        Clip(clip.name, played_frame(scene, clip.frame_start), played_frame(scene, clip.frame_end))
        for clip in state.clips
    )


def _body_of(effect: bpy.types.Object, haptics: HapticObjects) -> bpy.types.Object:
    """Body of an effect on a body; raises InputError if the body was excluded."""
    body = effects.body_in(haptics.scene, effect)
    assert body is not None  # effects without a body were excluded
    if body not in haptics.bodies:
        raise InputError(
            f"Effect '{effect.name}' belongs to body '{body.name}', which was left out."
        )
    return body


def _painted_area(
    effect: bpy.types.Object, haptics: HapticObjects, ids: Mapping[bpy.types.Object, str]
) -> PaintedArea:
    """Painted vertices and weights, without weights outside 0..1. Raises InputError for another
    model or edition, an invalid vertex list, and nothing painted."""
    hfx, body = effect.hfx, _body_of(effect, haptics)
    vertices, weights = effects.area(effect)
    if len(vertices) == len(weights):  # the warning comes from soundness
        sound = [k for k, weight in enumerate(weights) if 0.0 <= weight <= 1.0]
        vertices, weights = [vertices[k] for k in sound], [weights[k] for k in sound]
    model_id = effects.model_id_for(hfx.modality, body)
    if hfx.model_id != model_id:
        raise InputError(
            f"Effect '{effect.name}' has no area on the {hfx.modality} model: expected "
            f"'{model_id}', found '{hfx.model_id or 'nothing painted'}'. Paint it, or keep what "
            "was painted on the other model (Keep Painted Area)."
        )
    # Vertex numbers are valid for one edition of a model only.
    model = load_model(model_id)
    if hfx.model_hash != model.content_hash:
        raise InputError(
            f"Effect '{effect.name}' was painted on another edition of '{model_id}' "
            f"({hfx.model_hash[:12]}, this is {model.content_hash[:12]})"
            f"{model_migration.missing_scipy_reason(model_id, hfx.model_hash)}."
        )
    checked = effects.checked_area(effect.name, vertices, weights, len(model))
    if not len(checked[0]):
        raise InputError(f"Effect '{effect.name}' is painted nowhere. Paint it, or delete it.")
    return PaintedArea(ids[body], *checked)


def _source(scene: bpy.types.Scene) -> dict[str, str]:
    """Origin of a description: scene name, Blender and add-on version; of a saved file also "file"
    (name) and "sha256"."""
    source = {"scene": scene.name, "blender": bpy.app.version_string, "hfx": __version__}
    path = Path(bpy.data.filepath)
    if bpy.data.filepath and path.is_file():
        source["file"] = path.name
        source["sha256"] = sha256_of(path)
    return source
