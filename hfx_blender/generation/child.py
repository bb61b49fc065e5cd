# SPDX-License-Identifier: GPL-3.0-or-later
"""Generation in a process of its own, which never makes Blender wait and can be cancelled."""

from __future__ import annotations

import json
import subprocess
import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ..processes import start

_MODULE: Final = "generation.worker"
_END_S: Final = 5.0
_SHOWN: Final = 300  # characters of an unexpected failure


class GenerationChild:
    """Process that does one job.

    Attributes
    ----------
    share : float
        0..1 of what is done.
    records : list of Path
        Records of the surfaces made, in their order.
    fault : str
        Reason of a failure, "" if there is none.
    """

    def __init__(self, job: Mapping[str, Any]) -> None:
        """Start the process.

        Raises
        ------
        OSError
            It cannot be started.
        """
        self.share = 0.0
        self.records: list[Path] = []
        self.fault = ""
        self._errors = tempfile.TemporaryFile()
        self._process = start.start(
            start.command(_MODULE),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        assert self._process.stdin is not None
        with suppress(OSError):  # it has ended at once: its exit code tells
            self._process.stdin.write(json.dumps(dict(job)).encode())
            self._process.stdin.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with suppress(ValueError):
                line_read = json.loads(line)
                self.share = float(line_read.get("share", self.share))
                self.fault = line_read.get("error", self.fault)
                if "made" in line_read:
                    self.records.append(Path(line_read["made"]))

    @property
    def is_running(self) -> bool:
        """Test that it still works; afterwards all that it told is known."""
        if self._process.poll() is None:
            return True
        self._reader.join(_END_S)
        if self._process.returncode and not self.fault:
            self._errors.seek(0)
            last = self._errors.read().decode(errors="replace").strip().splitlines()[-1:]
            self.fault = f"Generation ended with code {self._process.returncode}: "
            self.fault += "".join(last)[:_SHOWN]
        return False

    def wait(self) -> None:
        """Wait for its end."""
        self._process.wait()
        _ = self.is_running

    def cancel(self) -> None:
        """End it at once."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait(_END_S)
        self._reader.join(_END_S)
        self._errors.close()
