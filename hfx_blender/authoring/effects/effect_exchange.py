# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between effects of a scene and effect files, and the library of sensations."""

from collections.abc import Sequence
from dataclasses import astuple, replace
from math import degrees, radians
from pathlib import Path

import bpy
import numpy as np

from ...blender import compat
from ...blender.scene_info import animation_fps, metres_of
from ...engine.body import areas
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...files import resources
from .. import clips, drawn_fades, painting, responses
from ..paths import paths, vector_sensations
from . import effects, model_migration, swarms
from .effect_file import (
    SUFFIX,
    ActuatorsRecipe,
    ClipRecipe,
    EffectRecipe,
    PartsArea,
    Sensation,
    SpotRecipe,
    VertexArea,
    VolumeRecipe,
    load,
)
from .effect_values import LAW, contact_law

OWN = "own/"  # prefix of the names of the user's sensations


def library() -> dict[str, Path]:
    """Shipped sensations: paths by file name without suffix, sorted."""
    return {path.stem: path for path in sorted(resources.effect_library().glob("*" + SUFFIX))}


def own_library() -> dict[str, Path]:
    """Sensations in the user's folder: paths by ``own/`` and file name without suffix, sorted."""
    folder = resources.user_effects()
    return {OWN + path.stem: path for path in sorted(folder.glob("*" + SUFFIX))}


def place_sensation(
    scene: bpy.types.Scene,
    sensation: Sensation,
    *,
    body: bpy.types.Object | None,
    frame: float,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> list[bpy.types.Object]:
    """Add all effects of a sensation to a scene; nothing is added if an error is raised. ``body``
    is the body of painted effects, points and vectors, ``frame`` the frame of time 0 of clips and
    paths, ``origin`` (3,) the world position of the volumes' origin in Blender units. Raises
    InputError: a body is missing, or an area was painted on another model."""
    # All checks come first, as a failed effect must not leave an incomplete sensation.
    for effect in sensation.effects:
        _check_recipe(effect, body)
    fps = animation_fps(scene)
    created = []
    # Several effects of a sensation share a group.
    is_alone = len(sensation.effects) == 1 or not sensation.name
    group = "" if is_alone else effects.free_group(scene, sensation.name)
    for recipe in sensation.effects:
        name = recipe.name if is_alone else f"{sensation.name} {recipe.name}"
        if isinstance(recipe.where, VolumeRecipe):
            effect = effects.add_volume(scene, recipe.modality, recipe.where.shape, name)
            _apply_volume(scene, effect, recipe.where, frame, origin)
        elif isinstance(recipe.where, SpotRecipe):
            assert body is not None
            effect = paths.add_spot(scene, recipe.modality, body, name)
            spot = recipe.where
            effect.hfx.radius = spot.radius_m / metres_of(scene)
            effect.hfx.falloff, effect.hfx.falloff_share = spot.falloff, spot.falloff_share
            effect.hfx.path_position = spot.position
            paths.apply(scene, effect, spot.path, frame)
        elif isinstance(recipe.where, ActuatorsRecipe):
            assert body is not None
            effect = vector_sensations.add_named(
                scene, recipe.modality, recipe.where.device, recipe.where.curves, body, name
            )
            for actuator, fade_keys in recipe.where.curves:
                timed = [(frame + time * fps, value) for time, value in fade_keys]
                vector_sensations.set_curve(effect, actuator, timed)
        else:
            assert body is not None
            effect = effects.add_painted(scene, recipe.modality, body, name)
            painting.set_weights(effect, _painted_weights(recipe, body))
        for control in MODALITIES[recipe.modality].controls:
            setattr(effect.hfx, control.prop, recipe.parameters[control.name])
        effect.hfx.group, effect.hfx.intensity = group, recipe.intensity
        effect.hfx.temperature_reference = recipe.temperature_reference
        for clip in recipe.clips:
            start = frame + clip.start_s * fps
            strip = clips.add_clip(
                effect,
                start,
                start + clip.duration_s * fps,
                name=clip.name,
                fade_in=clip.fade_in_s * fps,
                fade_out=clip.fade_out_s * fps,
                profile=[(time * fps, value) for time, value in clip.profile],
                repeat=clip.repeat,
            )
            if clip.drawn_fades:
                fade_keys = [(start + time * fps, value) for time, value in clip.drawn_fades]
                drawn_fades.set_keys(effect, strip, fade_keys)
        created.append(effect)
    return created


def _check_recipe(recipe: EffectRecipe, body: bpy.types.Object | None) -> None:
    """Raise InputError for an effect on a body if ``body`` is None, a spot is wind or its path
    leaves the skin, or an area is invalid or of an unknown edition of the model. Volumes pass."""
    where = recipe.where
    if isinstance(where, VolumeRecipe):
        return
    if body is None:
        raise InputError(
            f"'{recipe.name}' is painted on a body: add an avatar, or select a haptic body."
        )
    if isinstance(where, SpotRecipe):
        if recipe.modality == "wind":
            raise InputError(f"'{recipe.name}': wind is not felt at a point on the skin.")
        paths.skin().on_skin(where.path.points_m)
    if isinstance(where, VertexArea):
        model = load_model(effects.model_id_for(recipe.modality, body))
        # Vertex numbers are valid for one edition only, unless that edition can be transferred.
        if (where.model_id, where.model_hash) != (model.id, model.content_hash):
            if _transferred(where, model) is not None:
                return
            raise InputError(
                f"'{recipe.name}' was painted on another edition of the body model "
                f"('{where.model_id}', {where.model_hash[:12]}; this is '{model.id}', "
                f"{model.content_hash[:12]})."
            )
        effects.checked_area(recipe.name, list(where.vertices), list(where.weights), len(model))


def _transferred(area: VertexArea, model: PerceptualModel) -> np.ndarray | None:
    """Weights (V,) on ``model`` of an area of an earlier edition or of another set of models; None
    for an unknown edition, and for a model of another modality."""
    if not area.model_id.startswith(f"hfx-{model.modality}-"):
        return None
    return model_migration.transferred_area(
        area.model_id, area.model_hash, list(area.vertices), list(area.weights), model
    )


def _painted_weights(recipe: EffectRecipe, body: bpy.types.Object) -> np.ndarray:
    """Weights (V,) of a checked painted effect on a body's model: its vertices, transferred from
    another edition or set, or its body parts with a softened edge."""
    model = load_model(effects.model_id_for(recipe.modality, body))
    where = recipe.where
    if isinstance(where, VertexArea):
        if where.model_hash != model.content_hash:
            transferred = _transferred(where, model)
            assert transferred is not None  # checked
            return transferred
        weights = np.zeros(len(model))
        weights[list(where.vertices)] = where.weights
        return weights
    assert isinstance(where, PartsArea)
    # Whole parts are smoothed into a soft edge on the present model.
    is_in_parts = painting.part_flags(model, where.parts, where.side)
    return areas.smooth(model, is_in_parts.astype(np.float64), where.smooth)


def _apply_volume(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    volume: VolumeRecipe,
    frame: float,
    origin: Sequence[float],
) -> None:
    unit_m = metres_of(scene)
    # Files hold metres. Sizes are properties and not the object's scale, so that the volume can be
    # scaled afterwards.
    effect.hfx.radius = volume.radius_m / unit_m
    effect.hfx.height = volume.height_m / unit_m
    effect.hfx.size = [edge / unit_m for edge in volume.size_m]
    effect.hfx.falloff = volume.falloff
    effect.hfx.falloff_share = volume.falloff_share
    for name, value in zip(LAW, astuple(volume.law) if volume.law else (), strict=False):
        setattr(effect.hfx, name, value)
    effect.location = [o + x / unit_m for o, x in zip(origin, volume.location_m, strict=True)]
    effect.rotation_euler = [radians(angle) for angle in volume.rotation_deg]
    fps = animation_fps(scene)
    # Paths of a file are F-curves of the location, one per axis.
    for axis in range(3) if volume.path else ():
        keys = [(frame + t * fps, origin[axis] + place[axis] / unit_m) for t, place in volume.path]
        compat.set_keys(compat.own_fcurve(effect, "location", "Path", axis), keys)
    responses.add_response(effect, volume.response, unit_m, frame, fps)
    if volume.swarm is not None:
        swarms.add_swarm(scene, effect, volume.swarm, unit_m, frame, fps, origin)


def sensation_of(
    scene: bpy.types.Scene,
    chosen: Sequence[bpy.types.Object],
    name: str,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> Sensation:
    """Create a sensation from effects of a scene, with time 0 at the earliest start of
    their clips, keyframes and particle systems.
    ``origin`` (3,) is the world position that volumes are relative to, Blender units. Raises
    InputError: there are no effects, an effect has the shape of a mesh or is a surface, or a clip
    is a meta strip."""
    if not chosen:
        raise InputError("Select the effects to save first.")
    fps = animation_fps(scene)
    starts = [strip.frame_start for obj in chosen for _, strip in clips.strips_of(obj)]
    animated = ("hfx.drive[", "hfx.response[")  # besides location and path position
    starts += [
        key.co[0]
        for obj in chosen
        for curve in compat.fcurves(obj)
        if curve.data_path in ("location", paths.POSITION) or curve.data_path.startswith(animated)
        for key in curve.keyframe_points
    ]
    starts += [
        system.settings.frame_start for obj in chosen for _, system in swarms.emitters(scene, obj)
    ]
    # Time 0 of the file is the first event of the selection.
    first = min(starts, default=0.0)
    origin_m = [x * metres_of(scene) for x in origin]
    recipes = []
    for effect in chosen:
        hfx = effect.hfx
        controls = MODALITIES[hfx.modality].controls
        strips = clips.strips_of(effect)
        recipe = EffectRecipe(
            name=effect.name,
            modality=hfx.modality,
            parameters={c.name: float(getattr(hfx, c.prop)) for c in controls},
            where=_where_recipe(scene, effect, first, fps),
            intensity=float(hfx.intensity) * hfx.group_gain,
            temperature_reference=hfx.temperature_reference,
            clips=tuple(_clip_recipe(effect, strip, first, fps) for _, strip in strips),
        )
        recipes.append(_relative_to(recipe, origin_m))
    return Sensation(name, "", tuple(recipes))


def _relative_to(recipe: EffectRecipe, origin_m: Sequence[float]) -> EffectRecipe:
    """Copy of a volume with all positions minus ``origin_m`` (3,); other effects as given."""
    volume = recipe.where
    if not isinstance(volume, VolumeRecipe):
        return recipe

    def moved(position: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = (a - b for a, b in zip(position, origin_m, strict=True))
        return x, y, z

    # Every position of the volume moves along with the origin.
    swarm = volume.swarm
    if swarm is not None:
        swarm = replace(swarm, location_m=moved(swarm.location_m))
    path = tuple((time, moved(position)) for time, position in volume.path)
    where = replace(volume, location_m=moved(volume.location_m), path=path, swarm=swarm)
    return replace(recipe, where=where)


def _where_recipe(
    scene: bpy.types.Scene, effect: bpy.types.Object, first: float, fps: float
) -> PartsArea | VertexArea | VolumeRecipe | SpotRecipe | ActuatorsRecipe:
    """Area, volume, spot or actuators of an effect, times in seconds from frame ``first``. Raises
    InputError for a surface, and for a volume with the shape of a mesh."""
    if effect.hfx.kind == "SURFACE":
        raise InputError(
            f"'{effect.name}' is a surface, which stays with its object; export its map instead."
        )
    if effect.hfx.kind == "PAINTED":
        weights = painting.weights_of(effect)
        vertices = np.flatnonzero(weights > 0.0)
        model = effects.model_of(effect)
        rounded = (round(weight, 6) for weight in weights[vertices].tolist())
        painted = tuple(vertices.tolist())
        return VertexArea(model.id, model.content_hash, painted, tuple(rounded))
    if effect.hfx.kind == "SPOT":
        path = paths.recipe_of(scene, effect, "")
        return SpotRecipe(
            replace(path, motion=paths.motion_keys(scene, effect, first)),
            radius_m=round(float(effect.hfx.radius) * metres_of(scene), 6),
            falloff=effect.hfx.falloff,
            falloff_share=float(effect.hfx.falloff_share),
            position=float(effect.hfx.path_position),
        )
    if effect.hfx.kind == "ACTUATORS":
        curves = vector_sensations.curves_of(effect, first, fps)
        return ActuatorsRecipe(effect.hfx.device, curves)
    return _volume_recipe(scene, effect, first, fps)


def _volume_recipe(
    scene: bpy.types.Scene, effect: bpy.types.Object, first: float, fps: float
) -> VolumeRecipe:
    hfx = effect.hfx
    if hfx.shape == "MESH":
        raise InputError(
            f"'{effect.name}' has the shape of a mesh, which a file of effects cannot hold; keep "
            "it as a .blend and append it."
        )
    unit_m = metres_of(scene)
    # The world matrix includes parents, which a file does not have.
    location, rotation, scale = effect.matrix_world.decompose()
    moves = [curve for curve in compat.fcurves(effect) if curve.data_path == "location"]
    curves = {curve.array_index: curve for curve in moves}
    # A path has a common list of times; axes without a keyframe at a time are evaluated.
    times = sorted({key.co[0] for curve in moves for key in curve.keyframe_points})
    path = tuple(
        (
            (time - first) / fps,
            tuple(
                unit_m * (curves[axis].evaluate(time) if axis in curves else location[axis])
                for axis in range(3)
            ),
        )
        for time in times
    )
    return VolumeRecipe(
        hfx.shape,
        radius_m=hfx.radius * unit_m * abs(scale[0]),
        height_m=hfx.height * unit_m * abs(scale[2]),
        size_m=tuple(e * unit_m * abs(s) for e, s in zip(hfx.size, scale, strict=True)),
        falloff=hfx.falloff,
        falloff_share=hfx.falloff_share,
        law=contact_law(hfx),
        location_m=tuple(unit_m * x for x in location),
        rotation_deg=tuple(degrees(angle) for angle in rotation.to_euler()),
        path=path,  # type: ignore[arg-type]
        response=responses.response_recipe(effect, unit_m, first, fps),
        swarm=swarms.swarm_recipe(scene, effect, unit_m, first, fps),
    )


def _clip_recipe(
    effect: bpy.types.Object, strip: bpy.types.NlaStrip, first: float, fps: float
) -> ClipRecipe:
    keys = clips.profile_of(effect, strip)
    return ClipRecipe(
        name=strip.name,
        start_s=(strip.frame_start - first) / fps,
        duration_s=(strip.frame_end - strip.frame_start) / fps,
        fade_in_s=strip.blend_in / fps,
        fade_out_s=strip.blend_out / fps,
        repeat=strip.repeat,
        profile=clips.timed_shares(keys, strip.action_frame_start, fps),
        # Bezier handles are not stored: a drawn fade becomes its values at whole frames.
        drawn_fades=tuple(
            ((frame - strip.frame_start) / fps, value)
            for frame, value in drawn_fades.sampled(strip)
        ),
    )


def load_library(name: str) -> Sensation:
    """Load a shipped or user's sensation by name; InputError lists the known names otherwise."""
    sensations = {**library(), **own_library()}
    if name not in sensations:
        raise InputError(f"There is no sensation '{name}' in the library: {', '.join(sensations)}.")
    return load(sensations[name])
