# SPDX-License-Identifier: GPL-3.0-or-later
"""Units done by the workers of a Dask cluster, which see the same files under the same names.

Dask needs nothing but Python on its side of a task, so each of its workers keeps Blender in a
process of its own. What Dask is good at stays its own: queues, machines that come and go, a
task whose machine died is done by another one.
"""

from __future__ import annotations

import queue
import socket
import tempfile
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any
from uuid import uuid4

from .. import __version__
from ..errors import HfxError
from .units import Outcome, Unit, failure
from .worker_process import WorkerProcess, do_with_care

_CONNECT_LIMIT_S = 10.0

Progress = Callable[[float], None]


class DaskWorkers:
    """The workers of a cluster.

    Parameters
    ----------
    address : str
        Of its scheduler, such as ``tcp://host:8786``.
    limit_s : float, optional
        Seconds that a unit may take.

    Raises
    ------
    HfxError
        Dask is not installed, or no scheduler answers.
    """

    def __init__(self, address: str, limit_s: float | None = None) -> None:
        try:
            import distributed
        except ImportError as error:
            raise HfxError(
                "--scheduler needs Dask, which is not installed here: pip install "
                "'hfx-blender[dask]' (on the machines of the cluster as well)."
            ) from error
        try:
            connect: Any = distributed.Client
            self._client: Any = connect(address, timeout=_CONNECT_LIMIT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise HfxError(f"--scheduler {address}: no scheduler answers ({reason}).") from error
        self._limit_s = limit_s
        self._tasks: dict[str, Any] = {}  # a task that nobody holds is cancelled

    @property
    def slots(self) -> int:
        """Number of threads of all present workers."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return max(sum(int(worker["nthreads"]) for worker in workers), 1)

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Start a unit; without progress reports."""
        key = f"hfx-{unit.kind}-{uuid4().hex}"
        result: Future[Outcome] = Future()

        def ended(task: Any) -> None:
            self._tasks.pop(key, None)
            if task.status == "finished":
                result.set_result(task.result())
            else:
                reason = repr(task.exception()) if task.status == "error" else task.status
                result.set_result(failure(unit, f"the cluster gave it up ({reason})", 1))

        task = self._client.submit(
            do_unit, unit.as_json(), self._limit_s, __version__, key=key, pure=False
        )
        self._tasks[key] = task
        task.add_done_callback(ended)
        return result

    def close(self) -> None:
        """Cancel units that have not started; results of running ones are lost with their
        folder.
        """
        self._client.cancel(list(self._tasks.values()))
        self._client.close()


_idle: queue.SimpleQueue[WorkerProcess] = queue.SimpleQueue()
"""Processes of this Dask worker that have no work; each thread takes one."""


def do_unit(text: str, limit_s: float | None, version: str) -> Outcome:
    """Do a unit on a machine of the cluster."""
    unit = Unit.from_json(text)
    here = socket.gethostname()
    if version != __version__:
        return failure(unit, f"the worker on {here} has hfx {__version__}, not {version}", 3)
    try:
        stage = Path(tempfile.mkdtemp(dir=unit.stage))
    except OSError as error:
        reason = f"the worker on {here} cannot write to {unit.folder} ({error.strerror})"
        return failure(unit, f"{reason}; all machines need the same folders", 3)
    try:
        worker = _idle.get_nowait()
    except queue.Empty:
        worker = WorkerProcess()
    try:
        return do_with_care(worker, unit.in_stage(stage), lambda share: None, limit_s)
    finally:
        _idle.put(worker)
