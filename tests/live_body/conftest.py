# SPDX-License-Identifier: GPL-3.0-or-later
"""Core of the players and a clip of a person with two controllers, a painted palm and a ball."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from core_library import ROOT, compiled

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model, load_skeleton
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.track import TrackHeader
from hfx_blender.formats.clip.clip_writer import write
from hfx_blender.formats.clip.spatial_recorder import SpatialRecorder
from hfx_tools.live_body import player_core


@pytest.fixture(autouse=True, scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Compile the core where the installation has not."""
    patch = pytest.MonkeyPatch()
    if not (player_core.FOLDER / player_core.NAME).is_file():
        source = (ROOT / "players/native/core_library.c").read_text(encoding="utf-8")
        source = source.replace('"../core/', '"')
        path = tmp_path_factory.mktemp("core") / player_core.NAME
        compiled(source, path, "-std=c99", "-shared", "-fPIC")
        native = player_core.load(path)
        patch.setattr(player_core, "library", lambda: native)
    yield
    patch.undo()


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clip of Anna with ``oculus_touch``: the left palm is painted at .5, 12 m/s^2 and 160 Hz."""
    model = load_model("hfx-vibration-1")
    palm = np.flatnonzero((model.part == PARTS.index("hand_palm")) & (model.vertices[:, 0] > 0.0))
    area = PaintedArea("b", palm.astype(np.int32), np.full(len(palm), 0.5, np.float32))
    scene = SceneDescription(
        TimeBase(Fraction(50), Fraction(50), 0, 0, 1),
        (BodyDescription("b", "Anna", SkinBinding(load_skeleton().bone_names)),),
        (EffectDescription("e", "Hit #1", "vibration", model.id, area),),
    )
    still = PoseBlock(np.ones(2, np.bool_), np.tile(np.eye(4), (2, 1, 1)))
    animated = EffectBlock(np.array([0.25, 1.0]), np.tile([12.0, 160.0], (2, 1)))
    recorder = SpatialRecorder(scene)
    recorder.add(AnimationBlock(np.arange(2), (animated,), (still,)))
    header = TrackHeader.of(scene, {model.id: model}, settings={}, tools={})
    device = load_device("oculus_touch")
    folder = tmp_path_factory.mktemp("clip")
    (path,) = write(header, [(device, render(header, [], device))], folder / "x", recorder).files
    return path
