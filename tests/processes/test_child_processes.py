# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of this package never run a module of the current folder."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest
from strange_modules import CHILDREN, RAN, fill

from hfx_blender.processes import start
from hfx_tools import processes
from hfx_tools.command_process.signal_watch import end_children

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "hfx_blender"


@pytest.fixture(scope="module")
def strange(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("strange")
    fill(folder)
    fill(folder / "site-packages")
    return folder


PYTHONPATHS = ("", os.pathsep, os.pathsep.join(("nowhere", "site-packages", ".")))


def test_all_kinds_of_children_are_tried() -> None:
    runs = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removeprefix("hfx_blender.")
        for package in (PACKAGE, ROOT / "hfx_tools")
        for path in package.rglob("*.py")
        if 'if __name__ == "__main__"' in path.read_text(encoding="utf-8")
    }
    of_people = {"__main__", "hfx_tools.demo.sensation_assets"}
    assert runs - of_people - {"processes.child"} == set(CHILDREN)


@pytest.mark.parametrize("module", CHILDREN)
def test_no_child_runs_modules_of_the_current_folder(
    module: str, strange: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{os.pathsep}.{os.pathsep}site-packages")
    with start.start(
        start.command(module),
        {"PYTHONPROFILEIMPORTTIME": "1"},
        cwd=strange,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        _, err = process.communicate(timeout=120)
    assert RAN not in err and process.returncode != 77
    is_at_imports = "hfx_blender.errors" in err or "No module named 'torch'" in err  # foreign
    assert is_at_imports, "it came to its own imports"


def test_no_program_runs_modules_of_the_current_folder(strange: Path) -> None:
    """Programs given as source, as in the measurements."""
    source = "import sys, json, queue, numpy, hfx_tools.bench.safety.safety; print(sys.argv)"
    command = processes.program(source, "x", "y")
    done = subprocess.run(
        command, env=start.environment(), cwd=strange, capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("['-c', 'x', 'y']\n", "")


def test_no_process_is_started_by_one_that_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "ended", [])
    command = processes.program("import time; time.sleep(100)")
    with start.start(command) as running:
        end_children(30.0)
        assert running.wait(30)
        with pytest.raises(OSError, match="ending"):
            start.start(command)


def test_only_one_place_starts_processes() -> None:
    starters = {"subprocess": {"Popen", "run", "call", "check_call", "check_output", "getoutput"}}
    for path in PACKAGE.rglob("*.py"):
        if path == PACKAGE / "processes" / "start.py":
            continue
        source = path.read_text(encoding="utf-8")
        if not re.search(r"subprocess|multiprocessing|\bos\.(exec|spawn|popen|system)", source):
            continue
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                of, name = getattr(node.func.value, "id", ""), node.func.attr
                assert name not in starters.get(of, ()), f"{path}: {of}.{name}"
                is_os = of == "os" and name.startswith(("exec", "spawn", "popen", "system"))
                assert not is_os, f"{path}: {of}.{name}"
            elif isinstance(node, ast.Import | ast.ImportFrom):
                names = [alias.name for alias in node.names]
                assert "multiprocessing" not in {*names, getattr(node, "module", "")}, path


def test_absolute_entries_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = tmp_path / "mine"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((".", str(mine), "", "there")))
    assert start.environment()["PYTHONPATH"] == str(mine), "and nothing of ours"


# hfx itself


@pytest.fixture(scope="module")
def hfx(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Install the package as pip does: a script importing the package."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    variables = {"base": str(folder), "platbase": str(folder)}
    packages = Path(sysconfig.get_path("purelib", scheme="venv", vars=variables))
    scripts = Path(sysconfig.get_path("scripts", scheme="venv", vars=variables))
    present = [path for path in sys.path if Path(path).name == "site-packages"]
    (packages / "present.pth").write_text("\n".join([str(ROOT), *present]) + "\n")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, function = project["scripts"]["hfx"].split(":")
    script = scripts / "hfx"
    script.write_text(f"import sys\nfrom {module} import {function}\nsys.exit({function}())\n")
    python = scripts / ("python.exe" if os.name == "nt" else "python")
    return [str(python), str(script)]


# Modules imported by Python before the command's first line, from a PYTHONPATH with the current
# folder.
BEFORE_OURS = ("hfx_blender", "sitecustomize", "usercustomize", "_distutils_hack")


@pytest.fixture(scope="module")
def scene_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fill a folder with foreign modules, except for those imported by Python at the start."""
    folder = tmp_path_factory.mktemp("beside")
    fill(folder)
    code = "import sys, site; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    for name in {*loaded.stdout.split(), *BEFORE_OURS}:
        (folder / f"{name}.py").unlink(missing_ok=True)
    return folder


def _devices(hfx: list[str], cwd: Path, python_path: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*hfx, "device", "list"],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": python_path},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_hfx_runs_nothing_of_the_current_folder(hfx: list[str], strange: Path) -> None:
    done = _devices(hfx, strange, "")
    assert (done.returncode, done.stderr) == (0, "")
    assert "back_pad" in done.stdout


@pytest.mark.parametrize("python_path", PYTHONPATHS)
def test_hfx_imports_nothing_from_a_relative_pythonpath(
    hfx: list[str], scene_folder: Path, python_path: str
) -> None:
    done = _devices(hfx, scene_folder, python_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "back_pad" in done.stdout


def test_hfx_finds_pythons_library_as_the_current_folder(hfx: list[str]) -> None:
    done = _devices(hfx, Path(os.__file__).parent, ".")
    assert (done.returncode, done.stderr) == (0, "")


def test_hfx_uses_absolute_path_entries(hfx: list[str], tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.stderr.write('mine')\n")
    python_path = os.pathsep.join((".", str(tmp_path)))
    env = {**os.environ, "PYTHONPATH": python_path}
    for cwd in (tmp_path, tmp_path.parent):
        done = subprocess.run([*hfx, "--version"], cwd=cwd, env=env, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "mine")


def test_other_programs_keep_their_import_path(hfx: list[str], tmp_path: Path) -> None:
    (tmp_path / "found.py").write_text("print('found')\n")
    env = {**os.environ, "PYTHONPATH": "."}
    code = "import sys; before = list(sys.path); import found, hfx_blender.cli; "
    code += "assert sys.path == before"
    command = [hfx[0], "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.stdout == "found\n", done.stderr
