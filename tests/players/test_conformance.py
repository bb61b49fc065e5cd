# SPDX-License-Identifier: GPL-3.0-or-later
"""The core meets ``players/conformance`` for any player, and loses no peak."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from core_library import ROOT, Body, Clip, Player

from hfx_tools.formats.validation import validate

FOLDER = ROOT / "players" / "conformance"
NAMES = sorted(path.stem for path in FOLDER.glob("*.txt"))


def test_the_folder_is_complete_and_small() -> None:
    assert len(NAMES) == 50
    assert {path.stem for path in FOLDER.glob("*.hfxclip")} == set(NAMES)
    assert sum(path.stat().st_size for path in FOLDER.rglob("*")) < 5e6


@pytest.mark.parametrize("name", NAMES)
def test_each_value_is_as_expected(name: str) -> None:
    path = FOLDER / f"{name}.hfxclip"
    assert validate(path)[1] == []
    clip = Clip(path.read_bytes())
    assert clip.error == 0
    player, scales = Player(clip), Scales(path)
    advanced = 0
    for number, line in enumerate((FOLDER / f"{name}.txt").read_text().splitlines(), 1):
        call, _, values = line.partition(" = ")
        word, *rest = call.split(" ", 1)
        argument = rest[0] if rest else ""
        if word == "columns":
            assert clip.columns == int(argument)
        elif word in ("advance", "silence"):
            actual = player.advance(float(argument)) if word == "advance" else player.silence()
            expected = np.array(values.split(), np.float64)
            assert (np.abs(actual - expected) <= scales.slack()).all(), f"line {number}: {call}"
            advanced += 1
        elif word == "parameter":
            parameter, factor = argument.split()
            assert player.parameter(parameter, float(factor)) == 0
            scales.parameter(parameter, float(factor))
        elif word == "named":
            assert player.named(argument) == 0
            scales.play()
        else:
            getattr(player, word)(*([float(argument)] if argument else []))
            getattr(scales, word, lambda *of: None)(*([float(argument)] if argument else []))
    assert advanced > 10


class Scales:
    """Allowed difference: a 65535th of full scale, enlarged by gain and factors."""

    def __init__(self, path: Path) -> None:
        from hfx_tools.formats import clip_rules
        from hfx_tools.formats.clip_reader import texts_at

        sections = clip_rules.read(path.read_bytes(), str(path))
        columns = sections["COLM"]
        self._names = np.array(texts_at(sections, columns["parameter"]))
        self._is_strength = np.isin(np.arange(len(columns)), sections["ACTR"]["first_column"])
        ends = np.maximum(np.abs(columns["lowest"]), np.abs(columns["highest"]))
        self._step = (columns["highest"] - columns["lowest"]) / 65535.0
        self._rounding = 1e-6 * ends  # of 32-bit floats
        self.play()

    def play(self) -> None:
        self._factors, self._gain = np.ones(len(self._step)), 1.0

    def gain(self, gain: float) -> None:
        self._gain = gain

    def parameter(self, name: str, factor: float) -> None:
        self._factors[self._names == name] = factor

    def slack(self) -> np.ndarray:
        scale = self._factors * np.where(self._is_strength, self._gain, 1.0)
        return np.asarray(self._step * np.maximum(scale, 1.0) + self._rounding)


@pytest.mark.parametrize(
    ("script", "name", "least"), [("behaviour", "behaviour", 80), ("placed", "ring", 40)]
)
def test_calls_behave_as_written_by_hand(script: str, name: str, least: int) -> None:
    folder = FOLDER / "behaviour"
    path = folder / f"{name}.hfxclip"
    clip = Clip(path.read_bytes())
    slack = Scales(path).slack() * 2.0  # at a gain of 2
    player, checks = Player(clip), 0
    for number, line in enumerate((folder / f"{script}.txt").read_text().splitlines(), 1):
        if not line or line.startswith("#"):
            continue
        call, _, expected = (part.strip() for part in line.partition("="))
        word, _, argument = call.partition(" ")
        place = f"line {number}: {line}"
        checks += 1
        if word == "open":
            player = Player(clip)
            player.stop()
        elif word == "play":
            assert (player.replay(argument) == 0) == bool(int(expected)), place
        elif word == "parameter":
            name, factor = argument.split()
            assert player.parameter(name, float(factor)) == (-7 if expected else 0), place
        elif word == "playing":
            assert player.is_playing == bool(int(expected)), place
        elif word == "position":
            assert player.position_s == pytest.approx(float(expected), abs=1e-6), place
        elif word == "devices":
            named = [str(k) for k in range(3) if clip.is_device(k, argument)]
            assert named == expected.split(), place
        elif word == "advance":
            actual = player.advance(float(argument))
            values = np.array(expected.split(), np.float64)
            assert (np.abs(actual - values) <= slack).all(), f"{place}: {actual}"
        else:
            getattr(player, word)(*map(float, argument.split()))
    assert checks >= least


def test_effects_of_one_clip_are_felt_on_the_body_of_another() -> None:
    folder = FOLDER / "behaviour"
    avatar, library = (
        Clip((folder / f"{name}.hfxclip").read_bytes()) for name in ("avatar", "library")
    )
    numbers = {"Dot": 0, "Ball": 1, "Numbers": 2, "Heat": 3}
    body, checks = Body(avatar, 0, library), 0
    for number, line in enumerate((folder / "effects.txt").read_text().splitlines(), 1):
        if not line or line.startswith("#"):
            continue
        call, _, expected = (part.strip() for part in line.partition("="))
        word, *arguments = call.split()
        checks += 1
        if word == "open":
            body = Body(avatar, 0, library)
            assert body.error == 0
            body.set_bones(np.eye(4)[None, :3])
        elif word == "evaluate":
            values = np.array(expected.split(), np.float64)
            actual = body.evaluate(float(arguments[0]))
            assert actual == pytest.approx(values, abs=1e-4), f"line {number}: {line}"
        else:
            effect, rest = numbers[arguments[0]], [float(text) for text in arguments[1:]]
            if word == "add":
                effect = body.add_volume(effect)
            if word in ("add", "volume"):
                matrix = rest[3] * np.eye(4)[:3]
                matrix[:, 3] = rest[:3]
                is_done = body.set_volume(effect, matrix) == 0 and body.trigger(effect, 1.0) == 0
            else:
                is_done = getattr(body, word)(effect, *rest) == 0
            assert is_done == bool(int(expected)), f"line {number}: {line}"
    assert checks > 20
