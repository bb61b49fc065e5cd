# SPDX-License-Identifier: GPL-3.0-or-later
"""Any Blender executable without user settings: command line, and a separate window."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path


class BlenderError(Exception):
    """Blender failed at a requested action."""


class BlenderProcess:
    """Calls of one executable with a shared folder for settings, extensions and temporary files."""

    def __init__(self, executable: Path, folder: Path) -> None:
        self.executable = executable
        self.resources = folder / "resources"
        (folder / "tmp").mkdir(parents=True, exist_ok=True)
        self.resources.mkdir(exist_ok=True)
        self.environment = {
            **os.environ,
            "BLENDER_USER_RESOURCES": str(self.resources),
            "TMPDIR": str(folder / "tmp"),
        }
        # For the caller's Python, not Blender's.
        for name in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"):
            self.environment.pop(name, None)

    def background(self, *arguments: str) -> str:
        """Run without a window and return the printed output.

        Raises
        ------
        BlenderError
            Blender ended with an error; the message is the output.
        """
        command = ["--background", "--offline-mode", "--python-exit-code", "1", *arguments]
        return self.call(*command)

    def command(self, *arguments: str) -> str:
        """Run ``blender --command``; raises like :meth:`background`."""
        return self.call("--offline-mode", "--command", *arguments)

    def install(self, extension: Path) -> None:
        """Validate an extension's zip, install and enable the extension."""
        path = str(extension.resolve())
        self.command("extension", "validate", path)
        self.command("extension", "install-file", "-r", "user_default", "-e", path)

    def call(self, *arguments: str) -> str:
        done = subprocess.run(
            [str(self.executable), *arguments],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
        )
        if done.returncode:
            raise BlenderError(f"blender {' '.join(arguments)}: {done.returncode}\n{done.stdout}")
        return done.stdout
