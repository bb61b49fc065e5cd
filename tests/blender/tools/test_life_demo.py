# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of the piece simpleLife: meetings, offspring, age and death of particles; and the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_tools.demo import life

FRAMES = 600


def place(particle: life.Particle, frame: int) -> np.ndarray:
    return particle.path[frame - particle.born]


def test_offspring_are_born_where_their_parents_meet() -> None:
    particles = life.lives(FRAMES)
    assert [p.born for p in particles[:2]] == [0, 0], "two at the start"
    children = particles[2:]
    assert len(children) > 10
    for child in children:
        assert child.parents is not None
        first, second = (particles[n] for n in child.parents)
        meeting = child.born - 1
        assert max(first.born, second.born) <= meeting < min(first.died, second.died)
        here, there = place(first, meeting), place(second, meeting)
        assert np.linalg.norm(here - there) < 0.4
        assert child.path[0] == pytest.approx(0.5 * (here + there))
    for particle in particles:
        assert len(particle.path) == particle.died - particle.born
        if particle.died < FRAMES:
            assert 5.0 * 30 - 1 <= particle.died - particle.born <= 10.0 * 30 + 1
        assert (np.hypot(*np.array(particle.path[1:]).T[:2]) > 0.2 - 1e-9).all()
    alive = [sum(p.born <= frame < p.died for p in particles) for frame in range(FRAMES)]
    assert max(alive) <= life.MOST


def test_without_a_chance_nobody_is_born_and_seeds_repeat() -> None:
    assert len(life.lives(FRAMES, chance=0.0)) == 2
    first, again = life.lives(90, seed=3), life.lives(90, seed=3)
    assert np.array(first[0].path).tobytes() == np.array(again[0].path).tobytes()


def test_every_particle_is_a_volume_with_a_clip_of_its_life(registered: Any) -> None:
    scene = life.build(duration_s=4.0)
    particles = life.lives(120)
    volumes = effects.effects_of(scene)
    assert len(volumes) == len(particles) and len({v.hfx.uid for v in volumes}) == len(particles)
    by_name = {volume.name: volume for volume in volumes}
    for number, particle in enumerate(particles):
        volume = by_name[f"Particle {number + 1}"]
        ((_, strip),) = clips.strips_of(volume)
        assert (strip.frame_start, strip.frame_end) == (particle.born, particle.died)
        scene.frame_set(particle.born)
        expected = np.array([0.0, -0.05, 1.08]) + particle.path[0]
        assert np.array(volume.location) == pytest.approx(expected, abs=1e-5)
    assert life.SOUND.ageing_s > 0.0
