# SPDX-License-Identifier: GPL-3.0-or-later
"""Generation of surfaces in a separate process, so that Blender never waits: both sides.

The process takes a job and sends JSON messages ``{"share": 0..1}``, ``{"made": record's path}``
and ``{"error": sentence}``.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.texture.haptic_map import NoticeableSteps
from ..errors import HfxError
from ..processes.messages import Message, decode_json, json_message
from ..processes.worker import Owner, Worker
from . import library_search, picture_folder
from .generated import Generated, write


class GenerationProcess:
    """Parent side: process of a job, started when created; OSError if that fails."""

    def __init__(self, job: Mapping[str, Any]) -> None:
        self.share = 0.0  # completed share of the job, 0..1
        self.records: list[Path] = []  # record files of the finished surfaces, in order
        self.fault = ""  # reason of a failure; "" without a failure
        self._worker = Worker(
            "generation.generation_process", received=self._take, keeps_errors=True
        )
        self._worker.start()
        self._worker.send(json_message(dict(job)))

    def _take(self, _worker: Worker, message: Message) -> None:
        """Read a message of the process into share, records and fault."""
        content = decode_json(message.body)
        self.share = float(content.get("share", self.share))
        self.fault = content.get("error", self.fault)
        if "made" in content:
            self.records.append(Path(content["made"]))

    @property
    def is_running(self) -> bool:
        """Test that the process runs; once False, all its messages have been received."""
        if self._worker.is_running:
            return True
        self.wait()
        return False

    def wait(self) -> None:
        """Wait for the end of the process; a crash sets :attr:`fault`."""
        # An error that the process has sent says more than its exit.
        if self._worker.wait() and not self.fault:
            self.fault = f"Generation {self._worker.how_it_ended()}"

    def cancel(self) -> None:
        """Kill the process and wait until it has ended."""
        self._worker.close(0.0)


def run(job: Mapping[str, Any]) -> Iterator[tuple[float, Generated]]:
    """Generate the surfaces of a job; yield each with the share of the job then completed. Raises
    HfxError: the job cannot be done."""
    steps = NoticeableSteps() if job["use_steps"] else None
    count = int(job["variations"])
    for number in range(count):
        if job["back_end"] == picture_folder.NAME:
            width, height = job["size_mm"]
            surface = picture_folder.generate(
                Path(job["picture"]),
                # Decoded by Blender, as this process reads fewer picture formats.
                lambda path: np.asarray(np.load(job["pixels"], allow_pickle=False), np.float64),
                size_m=(width / 1000.0, height / 1000.0),
                depth_m=job["height_mm"] / 1000.0,
                tiles=job["tiles"],
                steps=steps,
            )
        else:
            surface = library_search.generate(
                job["words"],
                negative=job["negative"],
                seed=job["seed"] + number,
                texels=job["texels"],
                steps=steps,
            )
        yield (number + 1) / count, surface


def main() -> None:
    """Child side: do the job that the owner sends; send share and record of each surface, or the
    error, such as a missing package."""
    owner = Owner()
    job = decode_json(owner.receive().body)
    try:
        for share, surface in run(job):
            files = write(surface, Path(job["folder"]), job["version"]).files
            owner.send(json_message({"share": share, "made": str(files[-1])}))
    except HfxError as error:
        owner.send(json_message({"error": str(error)}))
    except ModuleNotFoundError as error:  # the extension's zip without wheels lacks scipy
        text = f"This needs the Python package {error.name}, which is missing."
        owner.send(json_message({"error": text}))


if __name__ == "__main__":
    main()
