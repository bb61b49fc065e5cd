# SPDX-License-Identifier: GPL-3.0-or-later
"""Make ``players/conformance``: clips, and the expected output of a player for each clip.

``python tests/manual/players/make_conformance.py`` rewrites the folder, from seeds and from the
demo scenes, in about two minutes. Expected values are computed by ``telling.py`` from rasters, not
by a player. ``players/conformance/README.md`` describes the files.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from check_spatial import moments
from check_surfaces import FRAME_S, drawn, paths_of, surface_of
from clip_cases import DEMOS, SPECS, Case, cases
from hand_clips import avatar_clip, library_clip, ring_clip
from walkers import RATE_HZ, walk

from hfx_blender.engine.scene import EffectDescription, HapticSurface
from hfx_blender.engine.texture.contact_rendering import ContactRenderer
from hfx_blender.engine.texture.haptic_map import HapticMap
from hfx_blender.formats.clip import surface_maps
from hfx_blender.formats.clip.container import Texts, encoded, records

FOLDER = Path(__file__).resolve().parents[3] / "players" / "conformance"
_MOST_VALUES = 2500  # of a clip


def script_of(case: Case) -> str:
    """Calls and expected values of a clip, a line each; see the folder's README."""
    telling = case.telling
    random = np.random.default_rng(list(case.name.encode()))
    columns = len(telling.low)
    lines = [f"columns {columns}"]
    frames = min(max(_MOST_VALUES // columns, 12), 160)
    usual = random.choice([1 / 60, 1 / 72, 1 / 90, 1 / 30])
    for frame in range(frames):
        if frame == 0 or random.random() < 0.06:
            lines.append(_call(case, random, frame))
        step = usual if random.random() < 0.7 else random.uniform(0.005, 0.2)
        step = float(f"{step:.6g}")
        lines.append(_values(f"advance {step:.6g}", telling.advance(step), telling.slack))
    lines.append(_values("silence", telling.silence(), telling.slack))
    return "\n".join(lines) + "\n"


def _call(case: Case, random: np.random.Generator, frame: int) -> str:
    telling = case.telling
    names = ("gain", "parameter", "seek", "loop", "pause", "stop", "play", "named")
    name = "play" if frame == 0 else str(random.choice(names))
    if (name == "named" and not telling.clips) or (name == "stop" and frame < 10):
        name = "play"
    if not telling.playing or telling.paused:
        name = "play"  # nothing is felt otherwise
    value: object = ""
    if name == "gain":
        value = float(f"{random.uniform(0.0, 2.0):.3g}")
    elif name == "seek":
        value = float(f"{random.uniform(0.0, telling.end_s):.4g}")
    elif name in ("loop", "pause"):
        value = 1
    elif name == "named":
        value = str(random.choice(sorted(telling.clips)))
    elif name == "parameter":
        factor = float(f"{random.uniform(0.2, 1.5):.3g}")
        known = [item for item in telling.parameters if not item.startswith("direction")]
        parameter = str(random.choice(known))
        telling.parameter(parameter, factor)
        return f"parameter {parameter} {factor:g}"
    if value == "":
        getattr(telling, name)()
        return name
    getattr(telling, name)(value)
    return f"{name} {value if isinstance(value, str) else f'{value:.6g}'}"


def _values(call: str, values: np.ndarray, slack: np.ndarray) -> str:
    """A call with values, of as many digits as the slack needs."""
    digits = np.maximum(np.ceil(-np.log10(slack)) + 1, 0).astype(int)
    texts = (f"{value:.{n}f}" for value, n in zip(values, digits, strict=True))
    shown = " ".join(text.rstrip("0").rstrip(".") if "." in text else text for text in texts)
    return f"{call} = {shown}"


def write_walk(folder: Path) -> None:
    """Write ``walk``: a body among volumes at a coarse level, and the engine's values."""
    with tempfile.TemporaryDirectory() as name:
        path, messages = moments(walk(4, 0.15, volumes=8, responds=True), Path(name), 3)
        lines = []
        for row, moment in enumerate(messages):
            lines += [f"bone {k} {_numbers(at)}" for k, at in enumerate(moment.bones)]
            for k, (matrix, factor) in enumerate(zip(moment.volumes, moment.factors, strict=True)):
                lines.append(f"volume {k} {factor:.7g} {_numbers(matrix)}")
            lines.append(f"evaluate {1.0 / RATE_HZ if row else 0.0:.9g}")
            for k, samples in enumerate(moment.felt):
                item = (f"{v}:{samples[v]:.4f}" for v in np.flatnonzero(samples))
                lines.append(" ".join((f"felt {k}", *item)))
        folder.mkdir(exist_ok=True)
        shutil.copy(path, folder / "walk.hfxclip")
    (folder / "walk.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_behaviour(folder: Path) -> None:
    """Write ``behaviour.hfxclip``, ten rows of three devices, and the clips of ``hand_clips``; the
    calls are written by hand."""
    texts = Texts()
    text, rows = texts.add, 10
    ids = ("pad_left", "pad_right", "heater")
    strengths = [(text("amplitude_m_s2"), text("m/s^2"), k, 0, 0.0, 65.535, 0.0) for k in (0, 1)]
    heat = (text("temperature_c"), text("°C"), 2, 32768, 20.0, 40.0, 30.0)
    limits = ([0.0] * 3, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 0)
    values = [
        *(1000 * (np.arange(rows) + first) for first in (1, 11)),
        np.where(np.arange(rows), np.round(65535 * (10 + np.arange(rows)) / 20.0), 32768),
    ]
    sections = {
        "TIME": records("TIME", [(10.0, 0.0, rows, 0)]),
        "DEVC": records(
            "DEVC",
            [(text(id), text(id), text("Body"), k, 1, k, 1, 250) for k, id in enumerate(ids)],
        ),
        "ACTR": records(
            "ACTR",
            [
                (text("a"), 2 * (k == 2), k, 1, rows * k, rows, rows * k, *[0] * 5, *limits)
                for k in range(3)
            ],
        ),
        "COLM": records("COLM", [*strengths, heat]),
        "ROWS": np.tile(np.arange(rows, dtype=np.uint32), 3),
        "VALU": np.concatenate(values).astype(np.uint16),
        "CLIP": records("CLIP", [(text("Strike"), 0, 0.2, 0.5), (text("Hum loop"), 1, 0.5, 0.8)]),
        "TEXT": texts.records,
    }
    (folder / "behaviour.hfxclip").write_bytes(encoded(sections, "behaviour"))
    for name, content in (("ring", ring_clip), ("avatar", avatar_clip), ("library", library_clip)):
        (folder / f"{name}.hfxclip").write_bytes(content())


def write_surfaces(folder: Path) -> None:
    """Write ``strokes``: three materials, one of them without tiling, and the engine's contacts."""
    texts, lines, random = Texts(), [], np.random.default_rng(7)
    surfaces = [surface_of(name, texels=48) for name in ("gravel-sharp", "metal-satin")]
    edged = replace(_map_of(surface_of("wood-weathered", texels=40)), tiles=False)
    surfaces.append(surface_of(edged))
    surfaces = [replace(surface, name=f"Pad {k}") for k, surface in enumerate(surfaces)]
    full = {"level": np.array(0.5), "parameters": np.array([20.0, 0.0])}  # 10 m/s^2
    sections = surface_maps.sections_of([(surface, full) for surface in surfaces], texts)
    sections |= {"TIME": records("TIME", [(1.0, 0.0, 1, 0)]), "TEXT": texts.records}
    folder.mkdir(exist_ok=True)
    (folder / "strokes.hfxclip").write_bytes(encoded(sections, "strokes"))
    for number in [*range(len(surfaces))] * 5:
        assert isinstance(surfaces[number].area, HapticSurface)
        map_ = _map_of(surfaces[number])
        places = drawn(random, map_.size_m)
        drive, hertz = ContactRenderer(surfaces[number].area.texture, FRAME_S).render(
            paths_of(places)
        )
        amplitude = 10.0 * map_.device.amplitude_m_s2(drive) / map_.device.amplitude_m_s2(1.0)
        lines.append(f"surface {number}")
        for (u, v), strength, frequency in zip(places / map_.size_m, amplitude, hertz, strict=True):
            values = f"{strength:.5g} {frequency:.6g}" if strength > 0.0 else "0"
            lines.append(f"feel {u:.12g} {v:.12g} {FRAME_S:.9g} = {values}")
    (folder / "strokes.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _map_of(surface: EffectDescription) -> HapticMap:
    assert isinstance(surface.area, HapticSurface) and surface.area.texture.map is not None
    return surface.area.texture.map


def _numbers(matrix: np.ndarray) -> str:
    return " ".join(f"{item:.7g}" for item in matrix.ravel())


def main() -> None:
    for old in (*FOLDER.glob("*.hfxclip"), *FOLDER.glob("*.txt")):
        old.unlink()
    with tempfile.TemporaryDirectory() as name:
        for case in cases(Path(name)):
            shutil.copy(case.path, FOLDER / case.path.name)
            (FOLDER / f"{case.name}.txt").write_text(script_of(case), encoding="utf-8")
    write_walk(FOLDER / "spatial")
    write_behaviour(FOLDER / "behaviour")
    write_surfaces(FOLDER / "surfaces")
    total = sum(item.stat().st_size for item in FOLDER.rglob("*"))
    count = len(SPECS) + len(DEMOS)
    sys.stdout.write(f"{count} clips, {total / 2**20:.2f} MiB in {FOLDER}\n")


if __name__ == "__main__":
    main()
