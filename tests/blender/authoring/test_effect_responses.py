# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses and swarms of particles are kept in files of effects."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import responses
from hfx_blender.authoring.effects import effect_exchange, effect_file, effects, response_recipes
from hfx_blender.blender import compat
from hfx_blender.engine.response_filters.controls import FilterKind
from hfx_blender.errors import InputError

FPS = 25


@pytest.fixture
def ball(scene: Any) -> Any:
    """A ball with a filter of each kind; every property differs from the default."""
    scene.render.fps = FPS
    scene.unit_settings.scale_length = 0.5  # Blender's units are half a metre
    ball = effects.add_volume(scene, "vibration", "SPHERE", "Ball")
    ball.hfx.radius = 0.08
    for kind in FilterKind:
        responses.add_filter(ball, kind)
    distance, speed, impact, near, sine = ball.hfx.response
    distance.about, distance.near, distance.far = "axis", 0.1, 0.9
    distance.near_value, distance.far_value = 0.75, 0.25
    speed.still_speed, speed.full_speed, speed.is_muted = 0.25, 2.0, True
    impact.attack, impact.decay, impact.full_speed = 0.01, 0.12, 2.5
    impact.operation = "add"
    near.reach, near.exponent, near.influence = 0.25, 1.5, 0.25
    sine.domain, sine.wavelength, sine.depth, sine.phase = "centre", 0.3, 0.5, 0.125
    sine.operation = "maximum"
    for frame, value in ((10, 0.1), (35, 0.6)):
        distance.near = value
        ball.keyframe_insert("hfx.response[0].near", frame=frame)
    return ball


def again(effect: Any, path: Path, frame: float = 100.0, **placed: Any) -> Any:
    """Saved, loaded from the file, and made at a frame."""
    scene = bpy.context.scene
    effect_file.save(effect_exchange.sensation_of(scene, [effect], "Saved"), path)
    loaded = effect_file.load(path)
    effect_file.save(loaded, path.with_suffix(".again"))
    assert path.with_suffix(".again").read_bytes() == path.read_bytes()
    return effect_exchange.place_sensation(scene, loaded, body=None, frame=frame, **placed)[0]


def test_every_filter_comes_back_with_all_that_it_is(ball: Any, tmp_path: Path) -> None:
    created = again(ball, tmp_path / "a.hfxeffect")
    assert len(created.hfx.response) == 5
    for one, second in zip(ball.hfx.response, created.hfx.response, strict=True):
        assert responses.described(second) == responses.described(one)
        assert second.is_muted == one.is_muted
        for name in responses.properties_of(one):
            if (one.kind, name) != ("distance", "near"):  # "near" is animated, not constant
                assert getattr(second, name) == pytest.approx(getattr(one, name)), name


def test_keyframes_of_filters_come_back_at_their_times(ball: Any, tmp_path: Path) -> None:
    created = again(ball, tmp_path / "a.hfxeffect")
    (curve,) = [c for c in compat.fcurves(created) if c.data_path == "hfx.response[0].near"]
    keys = [tuple(key.co) for key in curve.keyframe_points]
    assert np.array(keys) == pytest.approx(np.array([(100.0, 0.1), (125.0, 0.6)]), abs=1e-5)
    bpy.context.scene.frame_set(125)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert created.evaluated_get(depsgraph).hfx.response[0].near == pytest.approx(0.6)


def test_a_file_has_metres_and_the_engines_names(ball: Any, tmp_path: Path) -> None:
    again(ball, tmp_path / "a.hfxeffect")
    content = json.loads((tmp_path / "a.hfxeffect").read_text())
    distance, *_, sine = content["effects"][0]["volume"]["response"]
    assert distance["controls"]["far_m"] == pytest.approx(0.45)  # 0.9 units of half a metre
    assert sine["controls"]["cycles"] == pytest.approx(0.15) and sine["about"] == "centre"
    assert distance["keys"]["near_m"][1] == pytest.approx([1.0, 0.3])


@pytest.fixture
def nest(ball: Any, scene: Any) -> Any:
    """An emitter instancing balls from a collection."""
    scene.unit_settings.scale_length = 1.0
    source = bpy.data.collections.new("Source")
    for collection in list(ball.users_collection):
        collection.objects.unlink(ball)
    source.objects.link(ball)
    mesh = bpy.data.meshes.new("Nest")
    mesh.from_pydata([(-1, -1, -1), (1, 1, 1), (1, -1, 1)], [], [(0, 1, 2)])
    nest = bpy.data.objects.new("Nest", mesh)
    scene.collection.objects.link(nest)
    nest.location, nest.scale = (1.0, 2.0, 3.0), (0.5, 0.25, 0.125)
    system = nest.modifiers.new("Swarm", "PARTICLE_SYSTEM").particle_system
    system.seed = 7
    settings = system.settings
    settings.count, settings.frame_end, settings.frame_start = 40, 60, 35
    settings.lifetime, settings.factor_random, settings.normal_factor = 250, 0.6, 0.3
    settings.drag_factor, settings.brownian_factor, settings.damping = 0.01, 0.5, 0.2
    settings.effector_weights.gravity = 0.25
    settings.render_type, settings.instance_collection = "COLLECTION", source
    bpy.context.view_layer.update()
    return nest


def test_a_swarm_is_saved_with_its_emitter_and_made_anew(nest: Any, tmp_path: Path) -> None:
    nest.select_set(True)
    path = tmp_path / "swarm.hfxeffect"
    bpy.ops.hfx.save_effects(filepath=str(path))
    (recipe,) = effect_file.load(path).effects
    assert isinstance(recipe.where, effect_file.VolumeRecipe)
    swarm = recipe.where.swarm
    assert swarm is not None
    assert (swarm.count, swarm.seed, swarm.lifetime_s) == (40, 7, 10.0)
    # Timed from the first key of the filter, at frame 10.
    assert (swarm.born_from_s, swarm.born_until_s) == (1.0, 2.0)
    assert swarm.location_m == pytest.approx((1.0, 2.0, 3.0))
    assert swarm.radii_m == pytest.approx((0.5, 0.25, 0.125))
    scene = bpy.context.scene
    scene.frame_set(110)
    bpy.ops.hfx.load_effects(filepath=str(path))
    emitter = bpy.context.object
    assert emitter != nest and emitter.particle_systems
    system = emitter.particle_systems[0]
    settings = system.settings
    assert (settings.count, system.seed, settings.lifetime) == (40, 7, 250.0)
    assert (settings.frame_start, settings.frame_end) == (135.0, 160.0)
    for name in ("factor_random", "normal_factor", "drag_factor", "brownian_factor", "damping"):
        of = nest.particle_systems[0].settings
        assert getattr(settings, name) == pytest.approx(getattr(of, name)), name
    assert settings.effector_weights.gravity == pytest.approx(0.25)
    (source,) = settings.instance_collection.objects
    assert source.name not in scene.objects and len(source.hfx.response) == 5


def test_particles_of_a_loaded_swarm_are_felt(nest: Any, tmp_path: Path) -> None:
    source = nest.particle_systems[0].settings.instance_collection.objects[0]
    bpy.data.objects.remove(nest)
    scene = bpy.context.scene
    recipe = effect_exchange.sensation_of(scene, [source], "One").effects[0]
    swarm = response_recipes.SwarmRecipe(12, born_until_s=0.0, radii_m=(0.5, 0.5, 0.5), gravity=0.0)
    where = replace(recipe.where, swarm=swarm)
    sensation = effect_file.Sensation("Swarm", "", (replace(recipe, where=where),))
    scene.frame_set(1)
    (created,) = effect_exchange.place_sensation(
        scene, sensation, body=None, frame=1.0, origin=(1.0, 0.0, 0.0)
    )
    for frame in range(1, 6):
        scene.frame_set(frame)
    places = [
        object_instance.matrix_world.translation[:]
        for object_instance in bpy.context.evaluated_depsgraph_get().object_instances
        if object_instance.is_instance and object_instance.object.original == created
    ]
    assert len(places) == 12
    away = np.linalg.norm(np.array(places) - (1.0, 0.0, 0.0), axis=1)
    assert away == pytest.approx(0.5, abs=0.05)


def document() -> dict[str, Any]:
    volume = {
        "shape": "SPHERE",
        "radius_m": 0.1,
        "response": [
            {
                "kind": "impact",
                "controls": {"influence": 1, "attack_s": 0, "decay_s": 0.1, "full_m_s": 1},
                "keys": {"decay_s": [[0, 0.1], [1, 0.2]]},
            },
            {
                "kind": "sine",
                "about": "time",
                "controls": {"influence": 1, "cycles": 2, "depth": 1, "phase": 0},
            },
        ],
        "swarm": {"count": 3},
    }
    effect = {
        "name": "e",
        "modality": "pressure",
        "parameters": {"pressure_kpa": 1},
        "volume": volume,
    }
    return {"schema": "hfx-effects", "version": 1, "name": "n", "effects": [effect]}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda v: v["response"].append(3), r"response\[2\]"),
        (lambda v: v["response"][0].update(kind="smell"), r"response\[0\].kind"),
        (lambda v: v["response"][0].pop("kind"), "'kind' is missing"),
        (lambda v: v["response"][0].update(about="axis"), "'about' is unknown"),
        (lambda v: v["response"][1].pop("about"), "'about' is missing"),
        (lambda v: v["response"][1].update(about="moon"), r"response\[1\].about"),
        (lambda v: v["response"][0].update(operation="divide"), "operation"),
        (lambda v: v["response"][0].update(muted=1), "muted"),
        (lambda v: v["response"][0]["controls"].pop("decay_s"), "decay_s"),
        (lambda v: v["response"][0]["controls"].update(decay_s=0), "decay_s"),
        (lambda v: v["response"][0]["controls"].update(cycles=1), "'cycles' is unknown"),
        (lambda v: v["response"][0]["keys"].update(cycles=[[0, 1]]), "cycles"),
        (lambda v: v["response"][0]["keys"].update(decay_s=[[1, 0.1], [0, 0.1]]), "decay_s"),
        (lambda v: v["response"][0]["keys"].update(decay_s=[[0, 99]]), "decay_s"),
        (lambda v: v["swarm"].update(count=0), "swarm.count"),
        (lambda v: v["swarm"].update(count=99_999), "swarm.count"),
        (lambda v: v["swarm"].update(lifetime_s=0), "lifetime_s"),
        (lambda v: v["swarm"].update(born_until_s=-1), "born_until_s"),
        (lambda v: v["swarm"].update(radii_m=[1, -1, 1]), "radii_m"),
        (lambda v: v["swarm"].update(wings=2), "'wings' is unknown"),
    ],
)
def test_faults_of_responses_and_swarms_name_their_place(
    tmp_path: Path, change: Any, place: str
) -> None:
    content = document()
    path = tmp_path / "bad.hfxeffect"
    path.write_text(json.dumps(content))
    effect_file.load(path)
    change(content["effects"][0]["volume"])
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=place) as caught:
        effect_file.load(path)
    assert "bad.hfxeffect" in str(caught.value)
