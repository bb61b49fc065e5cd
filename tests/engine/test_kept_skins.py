# SPDX-License-Identifier: GPL-3.0-or-later
"""Models and skins of a live session, kept over new descriptions of the scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from engine_synthetic import BONES, model, pose
from test_evaluate import TIMES, _animated, _ball, _block, _Loader, _scene

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.native import library
from hfx_blender.engine.scene import (
    BodyDescription,
    FittedModel,
    SceneDescription,
    SkinBinding,
    SurfaceAnchors,
    SurfaceBinding,
)
from hfx_blender.engine.skin.bound_clusters import Clusters
from hfx_blender.engine.skin.skin_table import SkinTable
from hfx_blender.engine.tolerance import PAPER, STANDARD

pytestmark = pytest.mark.skipif(not library.is_there(), reason="no compiled library, no tables")
BALL = _ball()


@pytest.fixture
def filled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the tables that were filled or bound."""
    calls: list[str] = []
    for kind, name in ((SkinTable, "_fill"), (Clusters, "_bind"), (Clusters, "_link")):
        method = getattr(kind, name)

        def noted(self: Any, *given: Any, method: Any = method, name: str = name) -> Any:
            calls.append(name)
            return method(self, *given)

        monkeypatch.setattr(kind, name, noted)
    return calls


def described(binding: SkinBinding | SurfaceBinding) -> SceneDescription:
    return replace(_scene(BALL), bodies=(BodyDescription("anna", "Anna", binding),))


def fit(shift_m: float = 0.0) -> FittedModel:
    """Fit of the model of the ball, moved to the side by ``shift_m``."""
    canonical = model(modality="pressure", seed=1)
    count = len(canonical)
    anchors = SurfaceAnchors(np.zeros((count, 3), np.int32), np.ones((count, 3)), np.zeros(count))
    moved = canonical.vertices + np.array([shift_m, 0.0, 0.0], np.float32)
    return FittedModel(canonical.id, "", moved, BONES, canonical.weights, anchors)


def fitted(shift_m: float = 0.0) -> SceneDescription:
    return described(SkinBinding(BONES, {"test-pressure": fit(shift_m)}))


def samples(engine: Engine) -> list[tuple[list[int], list[float]]]:
    runs = engine.evaluate(_block([_animated(BALL)], pose(TIMES, seed=2)))
    return [(run.vertices.tolist(), run.weights.tolist()) for run in runs]


def test_a_prepared_engine_fills_no_table_at_the_first_contact(filled: list[str]) -> None:
    engine = Engine(_scene(BALL), models=_Loader())
    engine.prepare()
    assert {"_fill", "_bind", "_link"} <= {*filled}
    filled.clear()
    assert samples(engine) == samples(Engine(_scene(BALL), models=_Loader())) != []
    prepared, filled[:] = filled.copy(), []
    samples(engine)
    assert filled == [] and prepared, "only the engine that was not prepared fills tables"


@pytest.mark.parametrize("describe", [lambda: _scene(BALL), fitted])
def test_a_new_description_uses_models_and_skins_further(describe: Any, filled: list[str]) -> None:
    before = Engine(describe(), models=_Loader())
    before.prepare()
    filled.clear()
    loader = _Loader()
    after = Engine(describe(), models=loader, before=before)
    after.prepare()
    assert samples(after) == samples(before) != []
    assert filled == [] and loader.asked == []


@pytest.mark.parametrize(
    "binding",
    [
        SkinBinding(BONES),
        SkinBinding(BONES, {"test-pressure": fit(0.2)}),
        SkinBinding((*BONES, "tail"), {"test-pressure": fit()}),
        SurfaceBinding({"test-pressure": fit().anchors}, "chosen"),
    ],
)
def test_a_body_that_is_bound_otherwise_gets_a_skin_of_its_own(
    binding: SkinBinding | SurfaceBinding,
) -> None:
    before, now = Engine(fitted(), models=_Loader()), described(binding)
    before.prepare()
    after = Engine(now, models=_Loader(), before=before)
    skins = [
        engine._skins.of(engine.scene.bodies[0], "test-pressure") for engine in (before, after)
    ]
    assert skins[0] is not skins[1] and skins[1].binding is binding


def test_a_moved_fit_is_felt() -> None:
    before = Engine(fitted(), models=_Loader())
    before.prepare()
    after = Engine(fitted(0.2), models=_Loader(), before=before)
    assert samples(after) == samples(Engine(fitted(0.2), models=_Loader())) != samples(before)


def test_another_tolerance_has_tables_of_its_own() -> None:
    before = Engine(_scene(BALL), models=_Loader(), tolerance=STANDARD)
    before.prepare()
    after = Engine(_scene(BALL), models=_Loader(), tolerance=PAPER, before=before)
    afresh = Engine(_scene(BALL), models=_Loader(), tolerance=PAPER)
    assert samples(after) == samples(afresh) != samples(before)
