# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene of the audio-tactile belt: particles around a walker with a belt of eight motors.

After simpleLife, the installation of Politis, Pugliese, Takala: freely flying objects, felt on
approach and impact, and heard from their direction. A particle system instances one haptic
sphere; force fields parented to the walker keep the swarm around the waist.
"""

from __future__ import annotations

from math import pi

import bpy

from ..spatial_sound.hearing import Hearing
from ..spatial_sound.loudspeakers import LAYOUTS
from ..spatial_sound.sound_settings import SoundSettings
from .walking import add_walk

FPS = 30
DURATION_S = 8.0
BIRTH_FRAMES = 60  # frames of particle births
PARTICLES = 100
RADIUS_M = 0.05
WAIST_M = 1.08
WAY = ((0.0, 1.5, 0.0), (0.0, -1.5, 0.0), (2.5, -2.2, 0.0))

DEVICE = "waist_belt"
SOUND = SoundSettings(  # single particles are audible
    layout=LAYOUTS["ring8"], hearing=Hearing(reference_m=0.8, audible_m=2.0, spread_m=0.25)
)
PARTICLE = "Particle"


def build(particles: int = PARTICLES, duration_s: float = DURATION_S) -> bpy.types.Scene:
    """Build the scene in a new, empty file; returns the scene at frame 0."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.name = "Belt"
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, round(duration_s * FPS) - 1
    scene.gravity = (0.0, 0.0, 0.0)  # flying particles do not fall
    body = _add_walker()
    collection = bpy.data.collections.new("Swarm")
    scene.collection.children.link(collection)
    _add_forces(collection, body)
    _add_swarm(collection, _add_particle(), particles, duration_s)
    _add_camera(scene, collection)
    scene.hfx.devices.add().name = DEVICE
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    scene.frame_set(0)
    return scene


def _add_walker() -> bpy.types.Object:
    bpy.ops.hfx.add_avatar()
    body = bpy.context.object
    add_walk(body, WAY, 0, round(DURATION_S * FPS))
    return body


def _add_particle() -> bpy.types.Collection:
    """Add the haptic sphere, in a new collection outside of the scene."""
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", radius=RADIUS_M, name=PARTICLE)
    particle = bpy.context.object
    hfx = particle.hfx
    hfx.amplitude, hfx.frequency = 12.0, 150.0
    bpy.ops.hfx.add_response_filter(kind="impact")
    impact = hfx.response[0]
    impact.attack, impact.decay, impact.full_speed = 0.01, 0.12, 2.5
    bpy.ops.hfx.add_response_filter(kind="proximity")  # the tactile halo
    halo = hfx.response[1]
    halo.reach, halo.exponent, halo.influence = 0.12, 1.5, 0.25
    own = bpy.data.collections.new("Particle")
    for collection in list(particle.users_collection):
        collection.objects.unlink(particle)
    own.objects.link(particle)
    own.use_fake_user = True
    return own


def _add_forces(collection: bpy.types.Collection, body: bpy.types.Object) -> None:
    """Add force fields around the walker's waist, and a collision ellipsoid of the body."""
    pull = _follower(collection, "Pull", body)
    pull.field.type = "HARMONIC"
    pull.field.strength = 1.6
    pull.field.harmonic_damping = 0.02
    whirl = _follower(collection, "Whirl", body)
    whirl.field.type = "VORTEX"
    whirl.field.strength = 0.08
    wind = _follower(collection, "Unrest", body)
    wind.field.type = "TURBULENCE"
    wind.field.strength, wind.field.size, wind.field.seed = 3.0, 0.6, 3
    import bmesh

    mesh = bpy.data.meshes.new("Bouncer")
    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=16, v_segments=8, radius=1.0)
    shape.to_mesh(mesh)
    shape.free()
    bouncer = bpy.data.objects.new("Bouncer", mesh)
    collection.objects.link(bouncer)
    bouncer.parent = body
    bouncer.location, bouncer.scale = (0.0, -0.049, WAIST_M), (0.14, 0.09, 0.45)
    bouncer.hide_render = True
    bouncer.display_type = "WIRE"
    bouncer.modifiers.new("Collision", "COLLISION")
    bouncer.collision.damping_factor = 0.15


def _follower(
    collection: bpy.types.Collection, name: str, body: bpy.types.Object
) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, None)
    collection.objects.link(obj)
    obj.parent = body
    obj.location = (0.0, -0.05, WAIST_M)
    obj.empty_display_size = 0.2
    if obj.field is None or obj.field.type == "NONE":
        with bpy.context.temp_override(object=obj, active_object=obj):
            bpy.ops.object.forcefield_toggle()
    return obj


def _add_swarm(
    collection: bpy.types.Collection,
    particle: bpy.types.Collection,
    count: int,
    duration_s: float,
) -> None:
    """Add the particle system, emitting around the walker's first steps."""
    import bmesh

    mesh = bpy.data.meshes.new("Nest")
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=3, radius=1.0)
    shape.to_mesh(mesh)
    shape.free()
    nest = bpy.data.objects.new("Nest", mesh)
    collection.objects.link(nest)
    nest.location, nest.scale = (WAY[0][0], WAY[0][1], WAIST_M), (1.6, 1.6, 0.25)
    nest.show_instancer_for_render = nest.show_instancer_for_viewport = False
    system = nest.modifiers.new("Swarm", "PARTICLE_SYSTEM").particle_system
    system.seed = 7
    settings = system.settings
    settings.count = count
    settings.frame_start, settings.frame_end = 0, BIRTH_FRAMES
    settings.lifetime = duration_s * FPS + 10
    system.point_cache.frame_start = 0
    settings.normal_factor = 0.0
    settings.object_align_factor = (0.0, 0.0, 0.0)
    settings.factor_random = 0.6
    settings.drag_factor = 0.01
    settings.particle_size = 1.0
    settings.use_size_deflect = False
    settings.render_type = "COLLECTION"
    settings.instance_collection = particle


def _add_camera(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (5.5, -4.0, 2.6), (0.43 * pi, 0.0, 0.3 * pi)
    collection.objects.link(camera)
    scene.camera = camera
