# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit an avatar once for all files containing the avatar; a cancelled fit changes nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_avatar import mark, opened

from hfx_blender.avatars import bodies, stored_fits
from hfx_blender.engine.retargeting import retarget
from hfx_blender.errors import InputError
from hfx_blender.files import resources


def test_an_avatar_in_another_file_is_not_fitted_anew(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path))
    rig, skin = opened()
    steps = bodies.adding_body(rig, skin)
    for share in steps:
        assert 0.0 <= share <= 1.0
        if share > 0.5:
            break
    steps.close()  # as Esc does
    assert rig.hfx.role == "NONE" and stored_fits.FIT not in rig
    mark(rig, skin)
    first = _as_stored(rig)

    def warping(*_: object) -> Any:
        raise InputError("fitted anew")

    monkeypatch.setattr(retarget, "warping", warping)
    rig, skin = opened()
    mark(rig, skin)
    assert _as_stored(rig) == first
    rig, skin = opened()
    skin.data.vertices[100].co.x += 1e-4
    with pytest.raises(RuntimeError, match="fitted anew"):
        mark(rig, skin)
    rig, skin = opened()
    (stored,) = resources.kept_fits().glob("*.npz")
    stored.write_bytes(stored.read_bytes()[:1000])  # a damaged file is as good as none
    with pytest.raises(RuntimeError, match="fitted anew"):
        mark(rig, skin)


def _as_stored(rig: Any) -> list[Any]:
    models = [stored_fits.fitted_model(rig, model_id) for model_id in stored_fits.model_ids(rig)]
    arrays = [
        np.ravel(array) for model in models for array in stored_fits.arrays_of(model).values()
    ]
    faults = [part.faults for part in stored_fits.worst_first(stored_fits.quality_of(rig))]
    texts = [stored_fits.messages_of(rig, kind) for kind in ("warnings", "notes")]
    return [np.concatenate(arrays).tobytes(), faults, texts]
