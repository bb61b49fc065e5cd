# SPDX-License-Identifier: GPL-3.0-or-later
"""The web package meets ``players/conformance`` in Node and in an installed browser."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from core_library import ROOT

WEB = ROOT / "players" / "web"
CONFORMANCE = ROOT / "players" / "conformance"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the package and the page, made by ``build.py``."""
    if shutil.which("node") is None:
        pytest.skip("Node is not installed")
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("the package ziglang is not installed")
    folder = tmp_path_factory.mktemp("web")
    subprocess.run([sys.executable, WEB / "build.py", folder], check=True, timeout=600)
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


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
    """The module has no imports, and the pages name no other file or address."""
    script = (built / "hfx.js").read_text()
    size = len(re.search(r'const WASM = "([^"]+)"', script)[1]) * 3 // 4  # type: ignore[index]
    assert 20_000 < size < 80_000
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
