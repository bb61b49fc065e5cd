# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare strokes over the library's materials in the core with contacts of the engine.

``python tests/manual/players/check_surfaces.py --strokes 1000`` spreads the strokes over all
materials. A stroke begins anywhere, turns, stops, and goes beyond the border of the map.
Amplitudes count as equal within 1/255 of the surface's highest, frequencies within 1 Hz.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from core_library import Clip, Stroke

from hfx_blender.engine.scene import EffectDescription, HapticSurface
from hfx_blender.engine.texture.contact_path import ContactPaths
from hfx_blender.engine.texture.contact_rendering import ContactRenderer
from hfx_blender.engine.texture.haptic_map import HapticMap, SurfaceTexture
from hfx_blender.engine.texture.mcha import make_map
from hfx_blender.engine.texture.procedural import MATERIALS
from hfx_blender.formats.clip import surface_maps
from hfx_blender.formats.clip.container import Texts, encoded, records

FRAME_S = 1.0 / 72.0
_FRAMES = 60
_FULL_M_S2 = 12.0


@dataclass
class Counts:
    """Numbers of compared samples: moving ones, and equal amplitudes and frequencies of all."""

    samples: int = 0
    moving: int = 0
    amplitudes: int = 0
    frequencies: int = 0


def surface_of(material: str | HapticMap, texels: int = 512) -> EffectDescription:
    """Surface of a library material, or with a map."""
    if isinstance(material, str):
        field, roughness = MATERIALS[material].make(texels)
        material = make_map(field, roughness)
    texture = SurfaceTexture(map=material, device=material.device)
    area = HapticSurface(np.zeros((1, 3), np.int32), np.zeros((1, 3, 2)), texture)
    return EffectDescription("e", "Pad", "vibration", "hfx-vibration-1", area)


def clip_of(effect: EffectDescription, folder: Path) -> Path:
    """Write a clip of one surface, without devices, of 12 m/s^2."""
    texts = Texts()
    state = {"level": np.array(1.0), "parameters": np.array([_FULL_M_S2, 0.0])}
    sections = surface_maps.sections_of([(effect, state)], texts)
    sections |= {"TIME": records("TIME", [(1.0, 0.0, 1, 0)]), "TEXT": texts.records}
    path = folder / "surface.hfxclip"
    path.write_bytes(encoded(sections, path.name))
    return path


def drawn(random: np.random.Generator, size_m: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Places (T, 2) of a stroke with changing speed, up to 0.5 m/s, and pauses, m."""
    turn = random.uniform(0.0, 2.0 * np.pi) + np.cumsum(random.normal(0.0, 0.2, _FRAMES))
    speed = np.abs(random.normal(0.0, random.choice([0.02, 0.1, 0.3]), _FRAMES))
    speed[random.random(_FRAMES) < 0.1] = 0.0
    steps = FRAME_S * speed[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    start = random.uniform(-1.5, 1.5, 2) * size_m
    return np.asarray(start + np.cumsum(np.concatenate([np.zeros((1, 2)), steps[1:]]), axis=0))


def compare(effect: EffectDescription, folder: Path, strokes: int, seed: int) -> Counts:
    """Compare random strokes over a surface in the core and in the engine."""
    assert isinstance(effect.area, HapticSurface)
    texture = effect.area.texture
    assert texture.map is not None
    counts, random = Counts(), np.random.default_rng(seed)
    clip = Clip(clip_of(effect, folder).read_bytes())
    assert clip.error == 0
    for _ in range(strokes):
        places = drawn(random, texture.map.size_m)
        drive, expected_hz = ContactRenderer(texture, FRAME_S).render(paths_of(places))
        share = texture.device.amplitude_m_s2(drive) / texture.device.amplitude_m_s2(1.0)
        highest = float(texture.device.amplitude_m_s2(texture.map.intensity.max()))
        highest *= _FULL_M_S2 / float(texture.device.amplitude_m_s2(1.0))
        stroke = Stroke(clip)
        felt = np.array([stroke.feel(*uv, FRAME_S) for uv in places / texture.map.size_m])
        counts.samples += len(felt)
        is_moving = drive > 0.0
        counts.moving += int(np.count_nonzero(is_moving))
        apart = np.abs(felt[:, 0] - _FULL_M_S2 * share)
        counts.amplitudes += int(np.count_nonzero(apart <= highest / 255.0))
        is_near = np.abs(felt[:, 1] - expected_hz) <= 1.0
        counts.frequencies += int(np.count_nonzero(is_near | ~is_moving))
    return counts


def paths_of(places: npt.NDArray[np.float64]) -> ContactPaths:
    """Paths of one contact through places (T, 2) at successive times, without seams."""
    count = len(places)
    numbers = np.arange(count)
    starts = places[np.maximum(numbers - 1, 0)].T
    middles = 0.5 * (starts + places.T)
    zeros = np.zeros(count, np.int64)
    return ContactPaths(
        time=numbers,
        ids=zeros,
        triangle=zeros,
        weights=np.zeros((count, 3)),
        distance_m=np.zeros(count),
        coordinates_m=places,
        ends_m=np.stack([starts, middles, middles, places.T]),
        moved_m=np.zeros((count, 3)),
        before=numbers - 1,
        seams=np.zeros(0, np.int64),
        carried=0,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strokes", type=int, default=1000)
    options = parser.parse_args()
    each, total = -(-options.strokes // len(MATERIALS)), Counts()
    with tempfile.TemporaryDirectory() as folder:
        for seed, name in enumerate(MATERIALS):
            found = compare(surface_of(name), Path(folder), each, seed)
            for field in vars(total):
                setattr(total, field, getattr(total, field) + getattr(found, field))
    sys.stdout.write(
        f"{each * len(MATERIALS):,} strokes, {total.samples:,} samples ({total.moving:,} moving): "
        f"{total.samples - total.amplitudes:,} amplitudes and "
        f"{total.samples - total.frequencies:,} frequencies differ\n"
    )
    return int(total.amplitudes < total.samples or total.frequencies < total.samples)


if __name__ == "__main__":
    sys.exit(main())
