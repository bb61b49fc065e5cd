# SPDX-License-Identifier: GPL-3.0-or-later
"""Example programs in C, Rust and Python print a clip as the core plays it."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from core_library import ROOT, Clip, Player, compiled
from small_clip import write_small_clip

EXAMPLES = ROOT / "players" / "examples"
BEHAVIOUR = ROOT / "players" / "conformance" / "behaviour"
PYTHON = EXAMPLES / "python" / "hfx_player.py"


@pytest.fixture(scope="module")
def library_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the compiled core."""
    folder = tmp_path_factory.mktemp("library")
    source = '#include "../native/live_body.c"\n#include "../native/live_player.c"\n'
    suffix = {"win32": "hfx_haptics.dll", "darwin": "libhfx_haptics.dylib"}
    name = suffix.get(sys.platform, "libhfx_haptics.so")
    compiled(source, folder / name, "-std=c99", "-shared", "-fPIC")
    return folder


def in_c(folder: Path) -> Path:
    build = ["cmake", "-S", str(EXAMPLES / "c"), "-B", str(folder)]
    if shutil.which("cmake"):
        subprocess.run(build, check=True, capture_output=True, timeout=120)
        subprocess.run(["cmake", "--build", folder], check=True, capture_output=True, timeout=120)
        return folder / "hfx_play"
    return compiled((EXAMPLES / "c" / "play.c").read_text(), folder / "hfx_play", "-std=c99")


def in_rust(folder: Path, library_folder: Path) -> Path:
    rust = EXAMPLES / "rust" / "src"
    start = ["rustc", "--edition", "2021", "-D", "warnings", "-L", str(library_folder)]
    crate = folder / "libhfx_player.rlib"
    of_crate = ["--crate-type", "rlib", "--crate-name", "hfx_player", "-o", crate, rust / "lib.rs"]
    subprocess.run([*start, *of_crate], check=True, timeout=120)
    program = folder / "hfx_play"
    of_program = ["--extern", f"hfx_player={crate}", "-o", program, rust / "main.rs"]
    subprocess.run([*start, *of_program], check=True, timeout=120)
    return program


def printed(content: bytes, name: str) -> list[str]:
    """Lines of a clip with columns ``a amplitude_m_s2`` and ``a frequency_hz``."""
    player = Player(Clip(content))
    assert player.replay(name) == 0
    player.loop(0)
    lines = ["time_s,a amplitude_m_s2,a frequency_hz"]
    while player.is_playing:
        values = player.advance(1.0 / 60.0)
        lines.append(",".join(f"{item:.4f}" for item in (player.position_s, *values)))
    return lines


@pytest.mark.parametrize("language", ["c", "rust", "python"])
def test_an_example_prints_a_clip(language: str, library_folder: Path, tmp_path: Path) -> None:
    if language == "rust" and shutil.which("rustc") is None:
        pytest.skip("Rust is not installed")
    build = tmp_path / "build"
    build.mkdir()
    start: list[Path | str] = [sys.executable, PYTHON]
    if language != "python":
        start = [in_c(build) if language == "c" else in_rust(build, library_folder)]
    clip = write_small_clip(tmp_path)
    library = next(library_folder.iterdir())
    with_library = {
        **os.environ, "HFX_LIBRARY": str(library), "LD_LIBRARY_PATH": str(library_folder)
    }  # fmt: skip

    def run(*arguments: Path | str) -> subprocess.CompletedProcess[str]:
        command = [*start, *arguments]
        return subprocess.run(
            command, env=with_library, capture_output=True, text=True, timeout=60, check=False
        )

    for name in ("", "part"):
        completed = run(clip, *([name] if name else []))
        assert completed.returncode == 0, completed.stderr
        assert completed.stdout.splitlines() == printed(clip.read_bytes(), name)
    assert run().returncode == 2
    broken = tmp_path / "broken.hfxclip"
    broken.write_bytes(clip.read_bytes()[:-1])
    for refused in (run(broken), run(clip, "nothing")):
        assert refused.returncode == 3 and len(refused.stderr.splitlines()) == 1


@pytest.fixture
def module(library_folder: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The Python example, imported."""
    monkeypatch.setenv("HFX_LIBRARY", str(next(library_folder.iterdir())))
    spec = importlib.util.spec_from_file_location("hfx_player", PYTHON)
    assert spec and spec.loader
    created = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(created)
    return created


@pytest.mark.parametrize(
    ("script", "name", "least"), [("behaviour", "behaviour", 70), ("placed", "ring", 40)]
)
def test_the_library_plays_the_behaviour_scripts(
    module: ModuleType, script: str, name: str, least: int
) -> None:
    content = (BEHAVIOUR / f"{name}.hfxclip").read_bytes()
    player, checks = module.Player(content), 0
    slack = [2.0 * (of[4] - of[3]) / 65535.0 + 1e-5 for of in player.columns()]
    for line in (BEHAVIOUR / f"{script}.txt").read_text().splitlines():
        call, _, expected = (part.strip() for part in line.partition("="))
        word, _, argument = call.partition(" ")
        if not line or line[0] == "#" or word == "devices":
            continue
        checks += 1
        if word == "open":
            player.close()
            player = module.Player(content)
        elif word == "play":
            assert player.play(argument) == (expected == "1"), line
        elif word == "parameter":
            name, factor = argument.split()
            assert player.set_parameter(name, float(factor)) == (not expected), line
        elif word == "playing":
            assert player.is_playing == (expected == "1"), line
        elif word == "position":
            assert player.position == pytest.approx(float(expected), abs=1e-6), line
        elif word == "advance":
            numbers = zip(
                player.advance(float(argument)), map(float, expected.split()), slack, strict=True
            )
            assert all(abs(value - right) <= most for value, right, most in numbers), line
        elif word in ("loop", "pause"):
            getattr(player, word)(argument == "1")
        else:
            getattr(player, word)(*map(float, argument.split()))
    assert checks >= least
    player.close()


def test_the_library_tells_the_columns_and_refuses_nothing_at_all(module: ModuleType) -> None:
    with module.Player((BEHAVIOUR / "behaviour.hfxclip").read_bytes()) as player:
        assert player.seconds == pytest.approx(1.0)
        assert player.named_clips() == ["Strike", "Hum loop"]
        assert player.columns()[2] == ("a", "temperature_c", "°C", 20.0, 40.0, 30.0)
        assert [device[:3] for device in player.devices()] == [
            ("pad_left", 0, 1), ("pad_right", 1, 1), ("heater", 2, 1)
        ]  # fmt: skip
        assert player.devices()[0].dead_man_s == 0.25
        player.play()
        assert player.advance(0.05)[0] == pytest.approx(1.0, abs=1e-3)
        assert player.silence() == [0.0, 0.0, 30.0]
        assert player._core.hfx_live_player_advance(player._self, None, None, 0) == -1
    core = player._core
    assert core.hfx_live_version() == 0x000100
    for name in ("play", "stop", "pause", "loop", "silence"):
        assert getattr(core, f"hfx_live_player_{name}")(None, None, 0) < 0
    assert core.hfx_live_player_is_playing(None) == 0
    for content in (b"", b"x" * 2000):
        with pytest.raises(ValueError, match="clip"):
            module.Player(content)
