# SPDX-License-Identifier: GPL-3.0-or-later
"""Generation in a process of its own, which never makes Blender wait and can be cancelled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..processes.messages import Message, decode_json, json_message
from ..processes.worker import Worker


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
        self._worker = Worker("generation.worker", received=self._take, keeps_errors=True)
        self._worker.start()
        self._worker.send(json_message(dict(job)))

    def _take(self, _worker: Worker, message: Message) -> None:
        found = decode_json(message.body)
        self.share = float(found.get("share", self.share))
        self.fault = found.get("error", self.fault)
        if "made" in found:
            self.records.append(Path(found["made"]))

    @property
    def is_running(self) -> bool:
        """Test that it still works; afterwards all that it told is known."""
        if self._worker.is_running:
            return True
        self.wait()
        return False

    def wait(self) -> None:
        """Wait for its end."""
        if self._worker.wait() and not self.fault:
            self.fault = f"Generation {self._worker.how_it_ended()}"

    def cancel(self) -> None:
        """End it at once."""
        self._worker.close(0.0)
