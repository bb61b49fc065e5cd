# SPDX-License-Identifier: GPL-3.0-or-later
"""A process of a fuzzing run: changed files for a single reader, guided by coverage.

Started by ``run.py``. With the package atheris the engine is libFuzzer; without atheris, inputs
reaching new lines are stored, by ``sys.settrace``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[3])]

try:
    import atheris
except ImportError:
    atheris = None
if atheris:
    # Readers only: each instrumented line costs time.
    with atheris.instrument_imports(
        include=[
            "hfx_blender.authoring.effects.effect_file",
            "hfx_blender.authoring.paths.path_file",
            "hfx_blender.authoring.effects.response_recipes",
            "hfx_blender.export.batch.units",
            "hfx_blender.export.batch.journal",
            "hfx_tools.commands.info",
            "hfx_blender.devices",
            "hfx_blender.engine.body.model",
            "hfx_blender.engine.track",
            "hfx_blender.formats",
        ]
    ):
        import readers

from mutation import changed_bytes, mutated  # noqa: E402
from readers import COMMANDS, CONVERSIONS, PARSERS, Reader, readers  # noqa: E402

from hfx_blender.errors import InputError  # noqa: E402
from hfx_blender.files import findings  # noqa: E402
from hfx_blender.formats import files  # noqa: E402

SLOW_S = 5.0  # limit of work for an input
HANG_S = 10.0  # of this process's own work: a busy machine is no hang
MOST_MIB = 1024  # limit of libFuzzer
MOST_BYTES = 64 << 10  # limit of an input
_REPORT_EVERY = 2000
_MOST_KEPT = 400
_MOST_FINDINGS = 20  # limit for an input: reporting all findings would take most of the time


class Hang(BaseException):
    """A reader does not come back."""


class SlowError(Exception):
    """A reader takes longer than a file is worth."""


class Watched:
    """A reader with counted, timed and guarded inputs; faults are recorded, not raised."""

    def __init__(self, name: str, reader: Reader, options: argparse.Namespace) -> None:
        self._name, self._reader, self._options = name, reader, options
        self._faults: dict[str, str] = {}
        self._slowest_s = 0.0
        self._first_mib = 0.0
        self._checked = -1
        self.count = 0
        self._end_s = time.process_time() + options.seconds
        signal.signal(signal.SIGPROF, self._on_tick)
        signal.setitimer(signal.ITIMER_PROF, HANG_S / 2, HANG_S / 2)

    def _on_tick(self, number: int, frame: object) -> None:
        if self._checked == self.count and self.count:
            raise Hang(f"no answer within {HANG_S} s of work")
        self._checked = self.count

    def __call__(self, content: bytes) -> None:
        self.count += 1
        began_s = time.process_time()
        try:
            self._reader(content)
        except InputError:
            pass
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._keep(error, content)
        ended_s = time.process_time()
        if ended_s - began_s > SLOW_S:
            self._keep(SlowError(f"{ended_s - began_s:.1f} s, allowed are {SLOW_S:g}"), content)
        if ended_s - began_s > self._slowest_s:
            self._slowest_s = ended_s - began_s
            (self._options.folder / f"slowest-{self._name}").write_bytes(content)
        if self.count % _REPORT_EVERY == 0 or self.count == self._options.inputs:
            self.report()
            # atheris 3.0 never frees the results of instrumented comparisons: with compared arrays,
            # a slice ends by memory, and the next slice goes on.
            is_full = atheris is not None and _memory_mib() > MOST_MIB / 2
            if is_full or self.count >= self._options.inputs or ended_s > self._end_s:
                os._exit(0)  # libFuzzer has no second way to exit without changing the report

    def _keep(self, error: BaseException, content: bytes) -> None:
        trace = traceback.extract_tb(error.__traceback__)
        position = type(error).__name__
        if trace:
            position += f" at {Path(trace[-1].filename).name}:{trace[-1].lineno}"
        if position not in self._faults:
            self._faults[position] = str(error)[:200]
            shown = position.replace(" ", "-").replace(":", "-")
            (self._options.folder / f"fault-{self._name}-{shown}").write_bytes(content)
            text = "".join(traceback.format_exception(error))
            (self._options.folder / f"fault-{self._name}-{shown}.txt").write_text(text)

    def report(self) -> None:
        """Leave the counts for ``run.py``."""
        now_mib = _memory_mib()
        self._first_mib = self._first_mib or now_mib
        self._options.report.write_text(
            json.dumps(
                {
                    "format": self._name,
                    "inputs": self.count,
                    "seconds": time.process_time(),
                    "slowest_s": self._slowest_s,
                    "first_mib": self._first_mib,
                    "last_mib": now_mib,
                    "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                    "faults": self._faults,
                }
            )
        )


def _memory_mib() -> float:
    """Present memory of this process; on a system without this figure, the peak."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return pages * resource.getpagesize() / 2**20


def fuzz_with_atheris(watched: Watched, options: argparse.Namespace, corpus: Path) -> None:
    """Fuzz with changes of libFuzzer and, half of the time, of ``mutation``. Never returns."""

    def mutator(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)

        def of_bytes(part: bytes) -> bytes:
            return atheris.Mutate(part, max(len(part) + 64, 128))

        return mutated(data, rng, of_bytes)[:most]

    atheris.Setup(
        [
            sys.argv[0],
            f"-seed={options.seed % 2**31 + 1}",
            f"-max_len={options.longest}",
            f"-rss_limit_mb={MOST_MIB}",
            "-timeout=3600",  # limit by the clock; the guard above limits the work
            f"-artifact_prefix={options.folder}/libfuzzer-",
            "-print_final_stats=0",
            "-verbosity=0",
            str(corpus),
        ],
        watched,
        custom_mutator=mutator,
    )
    atheris.Fuzz()


class Coverage:
    """Lines of the readers reached by an input."""

    def __init__(self) -> None:
        self._folder = str(Path(files.__file__).parents[2])
        self._seen: set[tuple[object, int]] = set()
        self._new = False

    def run(self, reader: Watched, content: bytes) -> bool:
        """Run a reader; returns True for new coverage."""
        self._new = False
        sys.settrace(self._call)
        try:
            reader(content)
        finally:
            sys.settrace(None)
        return self._new

    def _call(self, frame, event, argument):  # type: ignore[no-untyped-def]
        return self._line if frame.f_code.co_filename.startswith(self._folder) else None

    def _line(self, frame, event, argument):  # type: ignore[no-untyped-def]
        key = (frame.f_code, frame.f_lineno)
        if key not in self._seen:
            self._seen.add(key)
            self._new = True
        return self._line


def fuzz_plainly(watched: Watched, options: argparse.Namespace, corpus: Path) -> None:
    """Fuzz without libFuzzer: one input in eight measures coverage. Never returns."""
    rng = random.Random(options.seed)
    stored = [path.read_bytes() for path in sorted(corpus.iterdir())]
    coverage = Coverage()
    for data in stored:
        coverage.run(watched, data)

    def of_bytes(part: bytes) -> bytes:
        return changed_bytes(part, rng.choice(stored), rng)

    while True:
        data = mutated(rng.choice(stored), rng, of_bytes)
        data = data[: options.longest]
        if watched.count % 8:
            watched(data)
        elif coverage.run(watched, data) and len(stored) < _MOST_KEPT:
            stored.append(data)
            (corpus / f"kept-{options.seed}-{len(stored)}").write_bytes(data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("format", choices=(*PARSERS, *CONVERSIONS, *COMMANDS))
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--report", type=Path, required=True)
    parser.add_argument("--inputs", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=int, default=MOST_BYTES)
    options = parser.parse_args()
    corpus = options.folder / "corpus" / options.format
    if not corpus.is_dir():
        from seeds import seeds  # imports the tests' modules as well

        with tempfile.TemporaryDirectory() as folder:
            created = seeds(Path(folder), options.format)
            corpus.mkdir(parents=True)
            for k, data in enumerate(created):
                (corpus / f"seed-{k}").write_bytes(data)
    findings.MAX_FINDINGS = _MOST_FINDINGS  # type: ignore[misc]
    watched = Watched(options.format, readers(options.format), options)
    (fuzz_with_atheris if atheris else fuzz_plainly)(watched, options, corpus)


if __name__ == "__main__":
    main()
