# SPDX-License-Identifier: GPL-3.0-or-later
"""The web package meets ``players/conformance`` in Node and in an installed browser."""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest
from core_library import ROOT

WEB = ROOT / "players" / "web"
CONFORMANCE = ROOT / "players" / "conformance"


def build_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("web_build", WEB / "build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


BUILD = build_module()
WASM = re.compile(r'const WASM = "([^"]+)"')


@pytest.fixture(scope="module")
def script() -> str:
    """Script of the package in the repository, without its exports."""
    text = (WEB / "dist" / "hfx.js").read_text("utf-8")
    assert text.endswith(BUILD.EXPORTS)
    return text.removesuffix(BUILD.EXPORTS)


@pytest.fixture(scope="module")
def built(script: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the package of the repository, and pages with it."""
    if shutil.which("node") is None:
        pytest.skip("Node is not installed")
    folder = tmp_path_factory.mktemp("web")
    BUILD.write(folder, script)
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


def test_the_package_in_the_repository_is_of_its_sources(script: str) -> None:
    """Otherwise: ``pip install ziglang``, ``python players/web/build.py``."""
    found = WASM.search(script)
    assert found is not None
    assert f"// Core: {BUILD.fingerprint()}\n" in script
    assert script == BUILD.package(base64.b64decode(found[1]))


def test_the_fingerprint_is_of_code_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(WEB.parent / "core", tmp_path / "core")
    (tmp_path / "web").mkdir()
    shutil.copy(WEB / "core.c", tmp_path / "web")
    expected = BUILD.fingerprint()
    monkeypatch.setattr(BUILD, "HERE", tmp_path / "web")
    header = tmp_path / "core" / "hfx_play.h"
    text = header.read_text("utf-8")
    header.write_bytes(f"/* a\r\ncomment */\r\n{text}\n".encode())
    assert BUILD.fingerprint() == expected
    header.write_text(text.replace("1e-6", "2e-6"), "utf-8")
    assert BUILD.fingerprint() != expected


def test_git_keeps_the_package_for_the_web() -> None:
    done = subprocess.run(
        ["git", "check-ignore", "--no-index", "players/web/dist/hfx.js"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode > 1:
        pytest.skip("this is no git repository")
    assert done.stdout == ""


def test_a_compiler_makes_the_same_core(built: Path, script: str, tmp_path: Path) -> None:
    """Another version of the compiler may write other bytes, which play the same."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("the package ziglang is not installed")
    BUILD.write(tmp_path, BUILD.package(BUILD.compiled()))
    (tmp_path / "package.json").write_text('{"type": "module"}')
    judged("node", WEB / "tests" / "conformance.mjs", tmp_path / "hfx.js", CONFORMANCE)


def judged(*command: object) -> None:
    done = subprocess.run(
        [str(item) for item in command], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_clips_bodies_and_pulses_are_as_expected_in_node(built: Path) -> None:
    judged("node", WEB / "tests" / "conformance.mjs", built / "hfx.js", CONFORMANCE)


def test_clips_bodies_and_pulses_are_as_expected_in_a_browser(built: Path) -> None:
    browser = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None
    )
    if browser is None:
        pytest.skip("Chromium is not installed")
    judged("node", WEB / "tests" / "browser.mjs", browser, built, CONFORMANCE)


def test_the_core_needs_nothing_and_each_page_is_one_file(built: Path) -> None:
    """The module imports Math alone, and the pages name no other file or address."""
    script = (built / "hfx.js").read_text()
    core = base64.b64decode(re.search(r'const WASM = "([^"]+)"', script)[1])  # type: ignore[index]
    assert 20_000 < len(core) <= 56_000
    assert core.count(b"\x04math") == 4
    assert b"wasi_snapshot" not in core and b"\x03env" not in core
    assert "import " not in script
    pages = [path.read_text() for path in built.glob("*.html")]
    assert len(pages) == 2
    assert not any(re.search(r"\b(?:src|href)=|https?://|\bimport\b", page) for page in pages)


def test_invalid_input_gives_one_sentence(built: Path) -> None:
    package = json.dumps((built / "hfx.js").as_uri())
    script = f"""
        import {{ readFileSync }} from "node:fs";
        import {{ HapticBody, HapticClip, HapticPlayer }} from {package};
        const bytes = readFileSync({json.dumps(str(CONFORMANCE / "touch.hfxclip"))});
        const tell = async (call) => {{
          try {{ await call(); }} catch (error) {{ console.log(error.code, error.message); }}
        }};
        await tell(() => HapticClip.from(new Uint8Array(0)));
        await tell(() => HapticClip.from(bytes.subarray(0, bytes.length - 1)));
        const clip = await HapticClip.from(bytes);
        await tell(() => new HapticPlayer(clip).play("Nothing"));
        await tell(() => new HapticBody(clip));
    """
    command = ["node", "--input-type=module", "-e", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines() == [
        "-2 This is no haptic clip.",
        "-1 The clip is cut off, or longer than it says.",
        "-7 The clip has no named clip 'Nothing'; it has: part 0.",
        "-6 The clip has no body: export it from a scene, not from a track.",
    ]
