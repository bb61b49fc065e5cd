# SPDX-License-Identifier: GPL-3.0-or-later
"""User's temporary folder: only folders made by the command are removed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hfx_blender.processes import start

pytest.importorskip("bpy")

LEAVE = """
import os, sys, tempfile
fault = sys.argv[1]
if fault:  # as where the disk is full, or has no inodes left
    tempfile.mkdtemp = lambda *_, **__: (_ for _ in ()).throw(OSError(28, fault))
from hfx_blender.processes import blender_session
from hfx_tools.command_process.signal_watch import leave
bpy = blender_session.start()
print(bpy.app.tempdir, os.environ.get("TMPDIR"), flush=True)
if fault:
    class App:  # Blender fell back to the temporary folder itself
        tempdir = os.environ["TMPDIR"] + os.sep
        binary_path = ""
    class Module:
        app = App
    sys.modules["bpy"] = Module
leave(7)
"""


def _leave(folder: Path, fault: str = "") -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", LEAVE, fault],
        env={**start.environment(), "TMPDIR": str(folder)},
        stdout=subprocess.PIPE,
        text=True,
        timeout=120,
    )
    assert done.returncode == 7
    return done.stdout.split()


def test_user_files_stay_in_a_folder_used_by_blender(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "thesis").write_text("precious")
    _leave(tmp_path, "No space left on device")
    assert (tmp_path / "theirs" / "thesis").read_text() == "precious"


def test_a_script_that_ends_by_itself_leaves_nothing(tmp_path: Path) -> None:
    script = "from hfx_blender.processes import blender_session; blender_session.start()"
    variables = {**start.environment(), "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], env=variables, timeout=120)
    assert done.returncode == 0 and list(tmp_path.iterdir()) == []


def test_folders_of_blender_are_removed_and_the_environment_restored(tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("precious")
    (tmp_path / "link").symlink_to(tmp_path)
    for name in ("", "link"):
        tempdir, seen = _leave(tmp_path / name)
        assert Path(tempdir).parents[1] == tmp_path / name and seen == str(tmp_path / name)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "thesis"]


@pytest.mark.skipif(shutil.which("unshare") is None, reason="needs a mount of its own")
def test_a_folder_that_is_really_full(tmp_path: Path) -> None:
    """The temporary folder is a full file system of 64 KiB and eight inodes."""
    script = (
        'mount -t tmpfs -o size=64k,nr_inodes=8 tmpfs "$1"; mkdir "$1/theirs"; '
        'echo precious > "$1/theirs/thesis"; for i in 1 2 3 4 5 6; do touch "$1/$i"; done; '
        'TMPDIR="$1" "$2" -c "$3" "" > /dev/null; code=$?; cat "$1/theirs/thesis"; exit $code'
    )
    mount = ["unshare", "-rm", "sh", "-c"]
    if subprocess.run([*mount, 'mount -t tmpfs tmpfs "$0"', tmp_path], check=False).returncode:
        pytest.skip("may not mount")
    done = subprocess.run(
        [*mount, script, "sh", tmp_path, sys.executable, LEAVE],
        env=start.environment(),
        stdout=subprocess.PIPE,
        text=True,
        timeout=120,
    )
    assert done.stdout == "precious\n" and done.returncode == 7
