# SPDX-License-Identifier: GPL-3.0-or-later
"""A clip of a few kilobytes with every kind of record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from walkers import RESPONSES

from hfx_blender.formats.clip.container import RECORDS, Texts, encoded, records


def write_small_clip(folder: Path, name: str = "walk", *, all_move: bool = True) -> Path:
    """Write a clip with one actuator, and a body of 40 vertices among four volumes; each vertex has
    two bones, or every eighth has none."""
    texts, text = Texts(), ""
    text = texts.add
    random = np.random.default_rng(len(name))
    rest = np.eye(4, dtype=np.float32)[:3].ravel()
    model, places = text("hfx-pressure-1"), random.uniform(-1.0, 1.0, (40, 3))
    moved = (np.arange(40) % 8 != 5) | all_move
    first = 2 * (np.cumsum(moved) - moved)
    vertices = records("VERT", [(places[k], k, first[k], 2 * moved[k]) for k in range(40)])
    skin = records("WGHT", [(k % 2, 25535 + 14465 * (k % 2)) for k in range(2 * moved.sum())])
    filters = [
        ("distance speed impact proximity sine".split().index(item.kind), 
         ("multiply", "add", "maximum").index(item.operation),
         ("centre", "axis", "time").index(item.about), controls)
        for of in RESPONSES for item, controls in of
    ]  # fmt: skip
    counts = [len(of) for of in RESPONSES]
    effects = [
        (text(f"Volume {k}"), 0, 1 if k else 0, 0xFFFFFFFF, model, k, 0.5 * (k == 3), k % 3, 0.7,
         0.9, [9.0, 80.0, 0.0, 0.0], 0.0, sum(counts[:k]), counts[k], 0, 0, rest, 0)
        for k in range(4)
    ]  # fmt: skip
    effects.append(
        (text("Painted"), 1, 1, 0, model, 0, 0.0, 0, 0.0, 0.5, [4.0, 0.0, 0.0, 0.0], 0.0,
         sum(counts), 0, 0, 5, rest, 0)
    )  # fmt: skip
    sections = {
        "TIME": records("TIME", [(50.0, 0.0, 100, 0)]),
        "DEVC": records("DEVC", [(text("d"), text("Device"), text("Body"), 0, 1, 0, 2, 250)]),
        "ACTR": records(
            "ACTR",
            [(text("a"), 0, 0, 2, 0, 4, 0, 1, 1, text("hand_palm"), text("wrist.L"),
              text("leftHand"), [0.5, 0.0, 1.0], 0.1, 20.0, 10.0, np.inf, np.inf, 1.0, 0)],
        ),
        "COLM": records(
            "COLM",
            [(text("amplitude_m_s2"), text("m/s^2"), 0, 0, 0.0, 10.0, 0.0),
             (text("frequency_hz"), text("Hz"), 0, 100, 60.0, 160.0, 61.0)],
        ),
        "ROWS": records("ROWS", [0, 10, 20, 60]),  # type: ignore[list-item]
        "VALU": np.arange(8, dtype=np.uint16) * 9000,
        "CLIP": records("CLIP", [(text("part"), 1, 0.2, 0.9)]),
        "BODY": records("BODY", [(text("Body"), 0, 2, 0, 1, 0)]),
        "BONE": records(
            "BONE",
            [(text("root"), text("hips"), text("Hips"), text("pelvis"), 0xFFFFFFFF, 0.1, rest),
             (text("wrist.L"), text("leftHand"), text("LeftHand"), text("hand_l"), 0, 0.2, rest)],
        ),
        "MODL": records("MODL", [(model, 1, 0, 0, 40, 0)]),
        "VERT": vertices,
        "WGHT": skin,
        "EFCT": records("EFCT", effects),
        "FLTR": records("FLTR", filters),
        "PNTD": records("PNTD", [(k, 0.2 * k) for k in range(5)]),
        "REAC": records("REAC", [(0, 0, 0, 0, 1.0, 0.0, 0, 10), (0, 0, 1, 1, 0.5, 90.0, 10, 5)]),
        "RCHV": records("RCHV", [(k, 1.0) for k in range(10)] + [(k, 0.5) for k in range(5)]),
        "SURF": records(
            "SURF",
            [(text("Tiles"), 0, (0.5, 9.0), (80.0, 260.0), (20.0, 8.0)),
             (text("Edge"), 1, (0.0, 4.0), (50.0, 50.0), (0.0, 0.0))],
        ),
        "HMAP": records(
            "HMAP", [(5, 4, (10.0, 8.0), 1, 0, 20, 0), (1, 6, (1.0, 9.0), 0, 20, 6, 0)]
        ),
        "TEXL": random.integers(0, 2**32, 26, dtype=np.uint32),
        "TEXT": texts.records,
    }  # fmt: skip
    assert set(sections) == set(RECORDS)
    path = folder / f"{name}.hfxclip"
    path.write_bytes(encoded(sections, name))
    return path
