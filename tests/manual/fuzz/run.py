# SPDX-License-Identifier: GPL-3.0-or-later
"""Throw damaged files at every reader; a refusal is the only allowed result besides success.

``python tests/manual/fuzz/run.py --inputs 10_000_000 --jobs 2 --folder fuzz`` changes small valid
files of every format, stores inputs reaching new code of the readers, and reports faults: an
exception other than ``InputError``, more than 5 s of work for an input, more than 1 GiB of memory.
``--work conversions`` does the same for conversions between all formats, ``--work commands`` for
every command reading a file, all in one process: the exit code must be documented. Each format gets
the same number of inputs, in slices of a process each; stored inputs stay in the folder for the
next run. Uses libFuzzer where the package atheris is installed. Not part of the test suite.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

_SOURCES = (
    "ahap", "haptic", "he", "openharmony", "openxr", "tact", "hjif", "hmpg", "npz", "csv", "track",
)  # fmt: skip
_PARSERS = (
    *_SOURCES, "jsonl", "glb", "wav", "device", "effect", "path", "nodemap", "unitouch",
    "texture", "png", "report", "model", "cloud", "clip",
)  # fmt: skip
_WORK = {
    "parsers": _PARSERS,
    "conversions": tuple(f"{source}-to" for source in _SOURCES),
    "commands": tuple(f"{item}-commands" for item in (*_PARSERS, "channels")),
}
_MOST_MIB = 1024  # memory limit of a process, at any time
_SMALL_BYTES = 3 << 10  # of an input, in seven of eight slices
_LARGE_BYTES = 32 << 10


class Campaign:
    """Counts of all formats, stored in ``totals.json`` so that a later run can continue."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._path = options.folder / "totals.json"
        names = options.formats.split(",") if options.formats else list(_WORK[options.work])
        self.totals: dict[str, dict[str, float]] = {}
        self.faults: dict[str, str] = {}
        if self._path.is_file():
            saved = json.loads(self._path.read_text())
            self.totals, self.faults = saved["totals"], saved["faults"]
        for name in names:
            self.totals.setdefault(
                name,
                {"inputs": 0, "seconds": 0, "slowest_s": 0, "growth_mib": 0, "peak_mib": 0,
                 "slices": 0},
            )  # fmt: skip
        self._share = -(-options.inputs // len(names))
        self._names = names
        self._running: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}

    def run(self) -> None:
        """Run until every format had its share; finished work of an interrupted run counts, too."""
        try:
            self._run()
        finally:
            for name, (process, report) in self._running.items():
                process.kill()
                process.wait()
                if report.is_file():
                    self._take(name, report, 0)

    def _run(self) -> None:
        while True:
            for name in self._next():
                self._start(name)
            if not self._running:
                return
            time.sleep(0.2)
            for name, (process, report) in list(self._running.items()):
                if process.poll() is not None:
                    del self._running[name]
                    self._take(name, report, process.returncode)

    def _next(self) -> list[str]:
        """Waiting formats with the fewest inputs so far."""
        waiting = [
            name
            for name in self._names
            if name not in self._running and self.totals[name]["inputs"] < self._share
        ]
        waiting.sort(key=lambda name: self.totals[name]["inputs"])
        return waiting[: self._options.jobs - len(self._running)]

    def _start(self, name: str) -> None:
        total = self.totals[name]
        report = self._options.folder / f"report-{name}.json"
        report.unlink(missing_ok=True)
        slice_number = int(total["slices"])
        total["slices"] += 1
        longest = _LARGE_BYTES if slice_number % 8 == 7 else _SMALL_BYTES
        left = int(self._share - total["inputs"])
        command = [
            sys.executable, str(Path(__file__).with_name("worker.py")), name,
            "--folder", str(self._options.folder), "--report", str(report),
            "--inputs", str(min(left, self._options.slice)), "--seconds", "240",
            "--seed", str(self._options.seed * 1000 + slice_number), "--longest", str(longest),
        ]  # fmt: skip
        with open(self._options.folder / f"messages-{name}.txt", "ab") as messages:
            process = subprocess.Popen(command, stdout=messages, stderr=messages)
        self._running[name] = (process, report)

    def _take(self, name: str, report: Path, code: int) -> None:
        total = self.totals[name]
        if report.is_file():
            document = json.loads(report.read_text())
            total["inputs"] += document["inputs"]
            total["seconds"] += document["seconds"]
            total["slowest_s"] = max(total["slowest_s"], document["slowest_s"])
            total["growth_mib"] = max(
                total["growth_mib"], document["last_mib"] - document["first_mib"]
            )
            total["peak_mib"] = max(total["peak_mib"], document["peak_mib"])
            if document["peak_mib"] > _MOST_MIB:
                self._fault(f"{name}: memory", f"{document['peak_mib']:.0f} MiB")
            for position, message in document["faults"].items():
                self._fault(f"{name}: {position}", message)
        if code != 0:
            self._fault(f"{name}: the process ended with {code}", f"see messages-{name}.txt")
        if not report.is_file():
            raise SystemExit(f"{name}: no input was read; see messages-{name}.txt")
        self._path.write_text(json.dumps({"totals": self.totals, "faults": self.faults}, indent=1))
        done = sum(item["inputs"] for item in self.totals.values())
        sys.stdout.write(
            f"{time.strftime('%H:%M:%S')} {name} {total['inputs']:.0f} "
            f"({document['inputs'] / document['seconds']:.0f} a second of work), slowest "
            f"{total['slowest_s']:.3f} s, memory {document['first_mib']:.0f} to "
            f"{document['last_mib']:.0f} MiB (most {total['peak_mib']:.0f}); all {done:.0f} "
            f"inputs, {len(self.faults)} faults\n"
        )
        sys.stdout.flush()

    def _fault(self, place: str, message: str) -> None:
        if place not in self.faults:
            self.faults[place] = message
            sys.stdout.write(f"FAULT {place}: {message}\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--inputs", type=int, default=120_000, help="of all formats together")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument(
        "--work",
        choices=list(_WORK),
        default="parsers",
        help="reading, all conversions, or all commands",
    )
    parser.add_argument("--formats", metavar="F,...", help="only some of them, by their names")
    parser.add_argument("--slice", type=int, default=100_000, help="inputs of one process")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("fuzz"), help="for all that is kept")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    campaign = Campaign(options)
    campaign.run()
    for name, total in campaign.totals.items():
        sys.stdout.write(
            f"  {name}: {total['inputs']:.0f} inputs in {total['seconds']:.0f} s of work, slowest "
            f"{total['slowest_s']:.3f} s, memory grew by {total['growth_mib']:.0f} MiB at most\n"
        )
    for position, message in campaign.faults.items():
        sys.stdout.write(f"  FAULT {position}: {message}\n")
    return 1 if campaign.faults else 0


if __name__ == "__main__":
    sys.exit(main())
