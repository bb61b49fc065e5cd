# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene of sound particles that meet, have offspring, age and die around a standing listener.

After simpleLife, the piece in Politis, Pugliese and Takala, "Spatial rendering of audio-tactile
feedback" (section 5): two particles at the start; each meeting may create another; the life span is
random, and the pitch is highest at birth and falls with age. Particles bounce off the listener, who
feels them on a belt. Each particle is a haptic sphere with keyframes and a clip of its own life.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import bpy
import numpy as np

from hfx_blender.authoring import clips
from hfx_blender.blender import compat
from hfx_blender.engine.arrays import F64

from ..spatial_sound.hearing import Hearing
from ..spatial_sound.loudspeakers import LAYOUTS
from ..spatial_sound.sound_settings import SoundSettings
from . import belt

FPS: Final = 30
DURATION_S: Final = 20.0
MOST: Final = 24
"""Largest number of particles at a time."""

DEVICE: Final = belt.DEVICE
SOUND: Final = SoundSettings(
    layout=LAYOUTS["ring8"], hearing=Hearing(reference_m=0.8, audible_m=3.0), ageing_s=0.8
)
_MEETING_M: Final = 0.4  # distance of a meeting
_APART_M: Final = 0.8  # distance after which a pair can meet again
_CHANCE: Final = 0.4  # of an offspring at a meeting
_LIFE_S: Final = (5.0, 10.0)
_BODY_M: Final = 0.2  # radius of the listener
_PULL: Final = 2.5  # towards the listener, 1/s^2
_UNREST: Final = 2.0  # random acceleration, m/s^2


@dataclass(eq=False)
class Particle:
    """Life of a particle, in frames, and its path."""

    born: int
    died: int  # first frame without the particle
    velocity: F64  # (3,) m/s
    path: list[F64] = field(default_factory=list)  # (3,) each frame, from the listener's waist, m
    parents: tuple[int, int] | None = None  # numbers of particles


def lives(frames: int, seed: int = 7, chance: float = _CHANCE) -> list[Particle]:
    """Simulate ``frames`` frames; particles by birth. Equal seeds give equal lives."""
    rng = np.random.default_rng(seed)
    particles = [_newborn(rng, 0, rng.normal(size=3) * [0.6, 0.6, 0.1]) for _ in range(2)]
    met: set[tuple[int, int]] = set()  # pairs that have not parted since
    for frame in range(frames):
        alive = [n for n, p in enumerate(particles) if p.born <= frame < p.died]
        for n in alive:
            if frame > particles[n].born:
                _move(particles[n], rng)
        for i, first in enumerate(alive):
            for second in alive[i + 1 :]:
                here, there = particles[first].path[-1], particles[second].path[-1]
                distance = float(np.linalg.norm(here - there))
                pair = first, second
                if distance > _APART_M:
                    met.discard(pair)
                if distance < _MEETING_M and pair not in met:
                    met.add(pair)
                    count = sum(p.died > frame for p in particles)
                    if rng.random() < chance and count < MOST and frame + 1 < frames:
                        child = _newborn(rng, frame + 1, 0.5 * (here + there))
                        child.parents = pair
                        # A child is no stranger to its parents.
                        met |= {(first, len(particles)), (second, len(particles))}
                        particles.append(child)
    for particle in particles:
        particle.died = min(particle.died, frames)
    return particles


def _newborn(rng: np.random.Generator, frame: int, place: F64) -> Particle:
    """Particle of a random life span and velocity, at ``place`` in its first frame."""
    span = round(rng.uniform(*_LIFE_S) * FPS)
    return Particle(frame, frame + span, rng.normal(size=3) * [1.0, 1.0, 0.2], [np.array(place)])


def _move(particle: Particle, rng: np.random.Generator) -> None:
    """Append the place of the next frame: pull, unrest, and a bounce off the listener."""
    place = particle.path[-1]
    pull = _PULL * np.array([1.0, 1.0, 4.0]) * place
    particle.velocity = particle.velocity + (rng.normal(size=3) * _UNREST - pull) / FPS
    place = place + particle.velocity / FPS
    radius = float(np.hypot(place[0], place[1]))
    if radius < _BODY_M:
        normal = np.append(place[:2] / max(radius, 1e-6), 0.0)
        inwards = min(float(particle.velocity @ normal), 0.0)
        particle.velocity = particle.velocity - 2.0 * inwards * normal
        place = place + (_BODY_M - radius) * normal
    particle.path.append(place)


def build(duration_s: float = DURATION_S, seed: int = 7) -> bpy.types.Scene:
    """Build the scene in a new, empty file; returns the scene at frame 0."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.name = "Life"
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, round(duration_s * FPS) - 1
    bpy.ops.hfx.add_avatar()
    template = _add_template()
    for number, particle in enumerate(lives(scene.frame_end + 1, seed)):
        _add_particle(scene, template, number, particle)
    bpy.data.objects.remove(template)
    scene.hfx.devices.add().name = DEVICE
    scene.frame_set(0)
    return scene


def _add_template() -> bpy.types.Object:
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", radius=belt.RADIUS_M, name="Life")
    template = bpy.context.object
    template.hfx.amplitude, template.hfx.frequency = 12.0, 150.0
    bpy.ops.hfx.add_response_filter(kind="impact")
    impact = template.hfx.response[0]
    impact.attack, impact.decay, impact.full_speed = 0.01, 0.12, 2.5
    bpy.ops.hfx.add_response_filter(kind="proximity")
    halo = template.hfx.response[1]
    halo.reach, halo.exponent, halo.influence = 0.12, 1.5, 0.25
    return template


def _add_particle(
    scene: bpy.types.Scene, template: bpy.types.Object, number: int, particle: Particle
) -> None:
    obj: Any = template.copy()
    obj.name = f"Particle {number + 1}"
    obj.hfx.uid = f"particle-{number + 1}"
    template.users_collection[0].objects.link(obj)
    waist = np.array([0.0, -0.05, belt.WAIST_M])
    places = waist + np.array(particle.path)
    for axis in range(3):
        keys = [(particle.born + k, float(place[axis])) for k, place in enumerate(places)]
        compat.set_keys(compat.own_fcurve(obj, "location", "Life", axis), keys)
    clips.add_clip(obj, particle.born, max(particle.died, particle.born + 1), name="Life")
