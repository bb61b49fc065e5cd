# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of the core, against the sum of the format's page in double precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from core_library import Body, Clip

from hfx_blender.formats.clip.container import Texts, encoded, records

F64 = npt.NDArray[np.float64]
_BONES = 90
_VERTICES = 1500
_NEAR = 1e-4
"""Distance of a gauge from 1, within which single precision may decide either way."""


def test_skin_follows_any_bones_through_leaps(tmp_path: Path) -> None:
    """Vertices of 0 to 6 of 90 bones among two cuboids, which wait, leap, and come back."""
    random = np.random.default_rng(5)
    rest, shares = _skin(random)
    body = _body(tmp_path, rest, shares)
    reached = 0
    for frame in range(60):
        bones = _bones(random, 0.02 if frame % 7 else 1.5)
        body.set_bones(bones)
        volumes = [_cuboid(random, at) for at in (0, frame // 9 % 3)]
        for k, volume in enumerate(volumes):
            body.set_volume(k, volume)
        body.evaluate(1.0 / 90.0)
        posed = _posed(rest, shares, bones)
        for k, volume in enumerate(volumes):
            reached += _compare(body.weights(k), posed, volume)
    assert reached > 1000


def test_skin_is_felt_again_after_a_bone_was_no_number(tmp_path: Path) -> None:
    random = np.random.default_rng(6)
    rest, shares = _skin(random)
    body = _body(tmp_path, rest, shares)
    volume = np.diag([4.0, 4.0, 4.0, 1.0])[:3]
    bones = _bones(random, 0.1)
    for given in (bones, np.full_like(bones, np.nan), np.full_like(bones, np.inf), bones):
        body.set_bones(given)
        body.set_volume(0, volume)
        body.evaluate(1.0 / 90.0)
    assert _compare(body.weights(0), _posed(rest, shares, bones), volume) > 1000


def test_a_bone_of_no_numbers_takes_the_touch_of_its_own_vertices_alone(tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    rest, shares = _skin(random)
    body = _body(tmp_path, rest, shares)
    volume = np.diag([4.0, 4.0, 4.0, 1.0])[:3]
    bones = _bones(random, 0.1)
    is_sound = shares[:, 7] == 0.0
    posed = _posed(rest, shares, bones)
    for value in (0.0, np.nan, 1e38, -np.inf):
        broken = bones.copy()
        broken[7] = value
        body.set_bones(broken if value else bones)
        body.set_volume(0, volume)
        body.evaluate(1.0 / 90.0)
        weights = body.weights(0)
        assert _compare(weights[is_sound], posed[is_sound], volume) > 1000
        assert weights[~is_sound].any() == (value == 0.0)


def _skin(random: np.random.Generator) -> tuple[F64, F64]:
    """Rest places (V, 3) and shares in 1/65535 of each bone (V, B), of which every ninth vertex has
    none."""
    rest = np.sort(random.uniform(-1.0, 1.0, (_VERTICES, 3)), axis=0)
    shares = np.zeros((_VERTICES, _BONES))
    for k in range(_VERTICES):
        if k % 9 == 4:
            continue
        chosen = random.choice(_BONES, random.integers(1, 7), replace=False)
        parts = random.integers(1, 9000, len(chosen))
        parts[0] = 65535 - parts[1:].sum()
        shares[k, chosen] = parts
    return rest.astype(np.float32).astype(np.float64), shares


def _body(folder: Path, rest: F64, shares: F64) -> Body:
    clip = Clip(_clip(folder, rest, shares).read_bytes())
    body = Body(clip)
    assert clip.error == 0 and body.error == 0
    return body


def _bones(random: np.random.Generator, size: float) -> F64:
    """Matrices (B, 3, 4) near the rest pose."""
    return np.eye(4)[:3] + size * random.normal(size=(_BONES, 3, 4)) * ([[0.3] * 3 + [1.0]] * 3)


def _cuboid(random: np.random.Generator, at: int) -> F64:
    """A turned and stretched matrix (3, 4); `at`: 0 in the middle, 1 beside, 2 far from all."""
    turned = np.linalg.qr(random.normal(size=(3, 3)))[0] * random.uniform(0.1, 0.6, 3)
    return np.column_stack([turned, [0.7 * at, 0.0, 30.0 * (at == 2)]])


def _posed(rest: F64, shares: F64, bones: F64) -> F64:
    """Places (V, 3): sum of share times matrix times rest place."""
    homogeneous = np.column_stack([rest, np.ones(len(rest))])
    moved = np.einsum("bij,vj->vbi", bones, homogeneous)
    places = np.einsum("vb,vbi->vi", shares / 65535.0, moved)
    return np.where(shares.any(axis=1)[:, None], places, rest)


def _compare(weights: npt.NDArray[np.float32], posed: F64, volume: F64) -> int:
    """Compare with a cuboid without falloff; return the number of vertices inside."""
    inverse = np.linalg.inv(volume[:, :3])
    gauge = np.abs((posed - volume[:, 3]) @ inverse.T).max(axis=1)
    is_sure = np.abs(gauge - 1.0) > _NEAR
    np.testing.assert_array_equal(weights[is_sure], (gauge <= 1.0)[is_sure])
    return int(np.count_nonzero(gauge[is_sure] <= 1.0))


def _clip(folder: Path, rest: F64, shares: F64) -> Path:
    """Write a clip of a body among two cuboids that is felt by no device's actuator."""
    texts = Texts()
    text = texts.add
    model, still = text("hfx-pressure-1"), np.eye(4, dtype=np.float32)[:3].ravel()
    links = [np.flatnonzero(item) for item in shares]
    first = np.cumsum([0, *map(len, links)])
    effect = (1, 0xFFFFFFFF, model, 0, 0.0, 0, 0.0, 1.0, [9.0, 0.0, 0.0, 0.0], 0.0)
    sections = {
        "TIME": records("TIME", [(50.0, 0.0, 100, 0)]),
        "DEVC": records("DEVC", [(text("d"), text("Device"), text("Body"), 0, 1, 0, 1, 250)]),
        "ACTR": records(
            "ACTR",
            [(text("a"), 1, 0, 1, 0, 1, 0, 1, 1, text("hand_palm"), text("bone 0"), text(""),
              [0.0, 0.0, 0.0], 0.1, 0.0, 0.0, np.inf, np.inf, 1.0, 0)],
        ),
        "COLM": records("COLM", [(text("pressure_kpa"), text("kPa"), 0, 0, 0.0, 10.0, 0.0)]),
        "ROWS": records("ROWS", [0]),  # type: ignore[list-item]
        "VALU": np.zeros(1, np.uint16),
        "BODY": records("BODY", [(text("Body"), 0, _BONES, 0, 1, 0)]),
        "BONE": records(
            "BONE",
            [(text(f"bone {k}"), text(""), text(""), text(""), 0xFFFFFFFF, 0.0, still)
             for k in range(_BONES)],
        ),
        "MODL": records("MODL", [(model, 1, 0, 0, len(rest), 0)]),
        "VERT": records(
            "VERT", [(rest[k], k, first[k], len(links[k])) for k in range(len(rest))]
        ),
        "WGHT": records(
            "WGHT", [(b, int(shares[k, b])) for k, bones in enumerate(links) for b in bones]
        ),
        "EFCT": records(
            "EFCT", [(text(f"Volume {k}"), 0, *effect, 0, 0, 0, 0, still, 0) for k in range(2)]
        ),
        "TEXT": texts.records,
    }  # fmt: skip
    path = folder / "skin.hfxclip"
    path.write_bytes(encoded(sections, "skin"))
    return path
