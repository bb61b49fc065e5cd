# SPDX-License-Identifier: GPL-3.0-or-later
"""Process that generates surfaces beside Blender: one job in, and messages out.

All are JSON; out go ``{"share": 0..1}``, ``{"made": PATH of a record}``, ``{"error": sentence}``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.texture.device_range import NoticeableSteps
from ..errors import HfxError
from ..processes.messages import decode_json, json_message
from ..processes.owner import Owner
from . import library_search, picture_folder
from .generated import Generated, write


def run(job: Mapping[str, Any]) -> Iterator[tuple[float, Generated]]:
    """Make the surfaces of a job, one by one, with the share that is done after each.

    Raises
    ------
    HfxError
        It cannot be done.
    """
    steps = NoticeableSteps() if job["use_steps"] else None
    count = int(job["variations"])
    for number in range(count):
        if job["back_end"] == picture_folder.NAME:
            made = _of_picture(job, steps)
        else:
            made = library_search.generate(
                job["words"],
                negative=job["negative"],
                seed=job["seed"] + number,
                texels=job["texels"],
                steps=steps,
            )
        yield (number + 1) / count, made


def _of_picture(job: Mapping[str, Any], steps: NoticeableSteps | None) -> Generated:
    width, height = job["size_mm"]
    return picture_folder.generate(
        Path(job["picture"]),
        # Blender has read the picture: no other process reads all that it does.
        lambda path: np.asarray(np.load(job["pixels"], allow_pickle=False), np.float64),
        size_m=(width / 1000.0, height / 1000.0),
        depth_m=job["height_mm"] / 1000.0,
        tiles=job["tiles"],
        steps=steps,
    )


def main() -> None:
    """Do the job that the owner sends, and tell it what is made."""
    owner = Owner()
    job = decode_json(owner.receive().body)
    try:
        for share, made in run(job):
            files = write(made, Path(job["folder"]), job["version"]).files
            owner.send(json_message({"share": share, "made": str(files[-1])}))
    except HfxError as error:
        owner.send(json_message({"error": str(error)}))
    except ModuleNotFoundError as error:  # the small extension comes without its wheels
        text = f"This needs the Python package {error.name}, which is missing."
        owner.send(json_message({"error": text}))


if __name__ == "__main__":
    main()
