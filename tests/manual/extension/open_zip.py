# SPDX-License-Identifier: GPL-3.0-or-later
"""Install extension zips into modules ``bpy``, enable them, add a body and effects, and export.

``python tests/manual/extension/open_zip.py ZIP… --python PYTHON…`` tests each zip with each Python.
A Python has the module ``bpy`` of a Blender; the test sees that module and Blender's own packages
only. Files of the same zips have to be equal in all Blenders. A zip named ``…-no_wheels`` has no
scipy; in every other zip scipy has to come from the zip.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

NAME = "bl_ext.user_default.hfx_blender"
_MAKE_BARE = """
import sys
from pathlib import Path
from packed_wheels import bare_python
print(bare_python(Path(sys.argv[1])))
"""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("zips", nargs="+", type=Path, metavar="ZIP")
    parser.add_argument("--python", nargs="+", default=[sys.executable])
    parser.add_argument("--inside", type=Path, metavar="FOLDER", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside is not None:
        use(options.zips[0].absolute(), options.inside)
    return run(options.zips, options.python)


def run(zips: Sequence[Path], pythons: Sequence[str]) -> int:
    """Test each zip with each Python; prints a line per pair, and returns 1 after a failure."""
    sums: dict[str, str] = {}
    failures = 0
    for python in pythons:
        with tempfile.TemporaryDirectory(prefix="hfx_zip_") as folder:
            bare = _bare(python, Path(folder, "python"))
            for path in zips:
                work = Path(folder, path.stem)
                work.mkdir()
                command = [bare, str(Path(__file__).resolve()), str(path.absolute())]
                done = subprocess.run(
                    [*command, "--inside", str(work)],
                    env={**_environment(), "BLENDER_USER_RESOURCES": str(work / "resources")},
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                    cwd=work,
                )
                lines = done.stdout.rstrip().splitlines() or [""]
                facts, _, total = lines[-1].partition(" | ")
                expected = sums.setdefault("files", total)
                is_good = done.returncode == 0 and bool(total) and total == expected
                failures += not is_good
                verdict = "ok" if is_good else f"FAILED ({done.returncode}, files {total})"
                sys.stdout.write(f"{path.name}: {facts}: {verdict}\n")
                if not is_good:
                    sys.stdout.write(done.stdout + done.stderr)
                sys.stdout.flush()
    return int(failures > 0)


def _environment() -> dict[str, str]:
    """Variables without those that add packages to Python."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("PYTHON") and name != "VIRTUAL_ENV"
    }


def _bare(python: str, folder: Path) -> str:
    """Make an environment with a Python's module ``bpy`` and Blender's packages; its Python."""
    done = subprocess.run(
        [python, "-c", _MAKE_BARE, str(folder)],
        env={
            **_environment(),
            "PYTHONPATH": str(Path(__file__).resolve().parents[2] / "extension"),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip().splitlines()[-1]


def use(extension: Path, folder: Path) -> None:
    """Install, use and export in this process; ends the process.

    Prints one line: versions, and after `` | `` the SHA-256 sum of the exported files.
    """
    Path(os.environ["BLENDER_USER_RESOURCES"]).mkdir(exist_ok=True)
    import bpy  # first: it makes the path to addon_utils
    import numpy

    import addon_utils  # isort: skip

    addon_utils.enable("bl_pkg")
    bpy.ops.extensions.package_install_files(
        filepath=str(extension), repo="user_default", enable_on_install=True
    )
    assert NAME in bpy.context.preferences.addons, "the extension is not enabled"
    assert "hfx_blender" not in sys.modules, "the extension is imported from elsewhere"
    scipy_version = "none"
    if "no_wheels" not in extension.name:
        import scipy

        resources = os.environ["BLENDER_USER_RESOURCES"]
        assert scipy.__file__.startswith(resources), f"{scipy.__file__} is not in the zip"
        scipy_version = scipy.__version__

    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 24
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Press")
    bpy.ops.hfx.fill_part(part="torso")
    bpy.ops.hfx.add_volume(modality="temperature", shape="SPHERE", name="Fire")
    bpy.context.object.location = (0.0, -0.3, 1.2)
    scene.hfx.devices.add().name = "back_pad"
    bpy.ops.hfx.export(filepath=str(folder / "out.hfxtrack"), formats={"csv"})
    files = sorted(folder.glob("*.csv"))
    assert files, "the export wrote no file"
    content = b"".join(path.name.encode() + path.read_bytes() for path in files)
    assert len(set(files[0].read_text(encoding="utf-8").splitlines())) > 2, "all rows are equal"
    total = hashlib.sha256(content).hexdigest()[:16]
    versions = f"Python {sys.version_info[0]}.{sys.version_info[1]}, NumPy {numpy.__version__}"
    line = f"Blender {bpy.app.version_string}, {versions}, scipy {scipy_version}"
    sys.stdout.write(f"{line} | {total}\n")
    sys.stdout.flush()
    os._exit(0)  # Blender's module may crash at the end of Python


if __name__ == "__main__":
    sys.exit(main())
