# SPDX-License-Identifier: GPL-3.0-or-later
"""Another person in the scene: an installed variant, with the canonical vertex ids."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import body_sets
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
import oracle  # noqa: E402

from hfx_blender.avatars import bodies, body_binding, stored_fits  # noqa: E402
from hfx_blender.engine.body import model  # noqa: E402
from hfx_blender.engine.scene import SkinBinding  # noqa: E402
from hfx_blender.errors import InputError  # noqa: E402

PERSON = "hfx-avatar-1+0badcafe"
SCALE = 0.75


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: Any) -> Iterator[Path]:
    monkeypatch.setenv("HFX_BODY_MODELS", str(tmp_path))
    yield body_sets.scaled_variant(tmp_path / "Small", "+0badcafe", SCALE)
    model.load_model.cache_clear()
    model.load_avatar.cache_clear()


def test_a_variant_stands_in_the_scene_with_the_canonical_ids(installed: Path) -> None:
    assert bpy.ops.hfx.add_avatar(person=PERSON) == {"FINISHED"}
    rig = bpy.context.object
    skin = rig.hfx.avatar
    points = np.array([vertex.co for vertex in skin.data.vertices])
    assert points == pytest.approx(SCALE * model.load_avatar().vertices, abs=1e-6)
    for identity in model.manifest()["models"]:
        placed, shipped = stored_fits.model_of(rig, identity), model.load_model(identity)
        assert placed.vertices == pytest.approx(SCALE * shipped.vertices, abs=1e-6)
    binding = body_binding.binding_of(rig, ["hfx-pressure-1"])
    assert isinstance(binding, SkinBinding) and set(binding.fitted) == {"hfx-pressure-1"}
    effect = oracle.add_painted("Felt", "pressure", rig, part="head")
    assert effect.hfx.model_id == "hfx-pressure-1"


def test_the_average_adult_needs_no_fit(installed: Path) -> None:
    assert bpy.ops.hfx.add_avatar() == {"FINISHED"}
    assert not stored_fits.is_fitted(bpy.context.object)


def test_a_variant_whose_models_are_gone_is_refused_before_anything_is_made(
    installed: Path,
) -> None:
    (installed / "vibration.npz").unlink()
    before = len(bpy.data.objects)
    with pytest.raises(InputError, match=r"vibration\.npz: there is no such file"):
        bodies.add_avatar(bpy.context, avatar_id=PERSON)
    with pytest.raises(InputError, match="Avatar 'hfx-avatar-1\\+1' is unknown"):
        bodies.add_avatar(bpy.context, avatar_id="hfx-avatar-1+1")
    assert len(bpy.data.objects) == before
