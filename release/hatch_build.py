# SPDX-License-Identifier: GPL-3.0-or-later
"""Build hook of hatchling: compiles the library of ``engine/native`` and the players' core.

The package works without the first, slower, and without the second but for ``hfx feel``, so a
failure does not stop an installation. The
environment variable ``HFX_PLATFORM`` names another platform for a wheel, as in
``native_build.TARGETS``; a failure stops such a build.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release import core_build, native_build  # next to this file, not installed


class NativeLibraryHook(BuildHookInterface[Any]):
    """Hook for the library next to ``library.py``, in the tree (if editable) or in the wheel."""

    _work: tempfile.TemporaryDirectory[str] | None = None

    def dependencies(self) -> list[str]:
        root, target = Path(self.root), native_build.this_target()
        required = native_build.requirements(root)
        if required or target is None or not native_build.has_compiler():
            return required
        core = root / core_build.FOLDER / core_build.library_name(target)
        return [] if core_build.is_current(core, target, root) else [native_build.REQUIREMENT]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        platform = os.environ.get("HFX_PLATFORM")
        target = native_build.TARGETS[platform] if platform else native_build.this_target()
        if not native_build.wanted() or target is None:
            return
        root = Path(self.root)
        is_editable = version == "editable"
        is_wanted = bool(platform) or any(tag.platform == target.wheel for tag in sys_tags())
        for builder, place, loss in (
            (
                native_build,
                native_build.NATIVE / target.library,
                "its compiled library and works in numpy, slower",
            ),
            (
                core_build,
                core_build.FOLDER / core_build.library_name(target),
                "the players' core and without 'hfx feel'",
            ),
        ):
            library = root / place
            try:
                if not builder.is_current(library, target, root):
                    folder = library.parent if is_editable else self._folder()
                    library = builder.build(target, folder, native_build.compiler(), root)
            except Exception as error:
                if platform:
                    raise
                self.app.display_warning(f"HFX is installed without {loss}: {error}")
                continue
            if not is_editable and is_wanted:
                build_data["force_include"][str(library)] = place.as_posix()
                build_data["pure_python"] = False
                build_data["tag"] = f"py3-none-{target.wheel}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if self._work is not None:
            self._work.cleanup()
            self._work = None

    def _folder(self) -> Path:
        if self._work is None:
            self._work = tempfile.TemporaryDirectory(prefix="hfx_native_")
        return Path(self._work.name)
