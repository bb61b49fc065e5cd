# SPDX-License-Identifier: GPL-3.0-or-later
"""Throw damaged files at every reader; one may refuse them, nothing else.

``python tests/fuzz/run.py --seconds 300``: changes valid files of every format, keeps what
reaches new lines of the readers, and reports crashes (an exception that is no ``InputError``),
hangs and growing memory. Coverage is taken with ``sys.monitoring`` or ``sys.settrace``; with
``--atheris FORMAT`` the same readers run under libFuzzer, if the package atheris is installed.
Not part of the test suite.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path

if "--atheris" in sys.argv:
    import atheris

    atheris.instrument_imports(include=["hfx_blender.formats"]).__enter__()

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "formats")]

from format_cases import RANGE, raster_for, signals  # noqa: E402,F401
from format_cases import signal as signal_of  # noqa: E402

from hfx_blender.devices.configuration import load_device  # noqa: E402
from hfx_blender.engine.body.model import load_model  # noqa: E402
from hfx_blender.errors import InputError  # noqa: E402
from hfx_blender.formats import files, glb, npz_raster, registry  # noqa: E402
from hfx_blender.formats.csv_raster import decode as decode_csv  # noqa: E402
from hfx_blender.formats.hjif import reader, to_signals  # noqa: E402
from hfx_blender.formats.signals import Transient  # noqa: E402

HANG_S = 10.0  # of this process's own work: a busy machine is no hang
MOST_BYTES = 64 << 10  # of one input
TOKENS = (
    b"null", b"true", b"-1", b"1e308", b"1e-308", b"1e999", b"NaN", b"[]", b"{}", b'""', b"0",
    b"4294967296", b"99999999999999999999", b'"\\ud800"', b"[[[[", b"1.5", b"-0", b'"Reference"',
    b'"Composite"', b'"id":7', b'"Curve"', b"\xff\xfe", b"\x00" * 8,
)  # fmt: skip

Target = Callable[[bytes], None]


def targets() -> dict[str, Target]:
    """Every reader with its checks: what a file of a stranger goes through."""
    found: dict[str, Target] = {}
    for name, kind in files.FILE_FORMATS.items():

        def target(content: bytes, kind: files.FileFormat = kind) -> None:
            findings = kind.validate(content, "x")
            is_valid = not any(each.severity == "error" for each in findings)
            if kind.signals is not None:
                try:
                    kind.signals(content, "x")
                except InputError:
                    # Too much at once, or too deep: valid, but not of a sane tool.
                    if is_valid and "too many" not in str(sys.exc_info()[1]):
                        if "HJIF:" not in str(sys.exc_info()[1]):
                            raise AssertionError("valid, but not read") from None

        found[name] = target
    found["npz"] = lambda content: void(npz_raster.decode(content, "x"))
    found["csv"] = lambda content: void(decode_csv(content, "x"))
    found["hjif"] = hjif
    return found


def void(value: object) -> None:
    """Forget a result."""


def hjif(content: bytes) -> None:
    """Read, write again, read again: the same; and unfold."""
    document = reader.decode(content, "x")
    assert reader.decode(reader.encode(document), "x") == document
    for each in to_signals.envelopes(document):
        assert len(each.strength) > 0
    to_signals.decode(content, "x")


def seeds(folder: Path) -> dict[str, list[bytes]]:
    """A few small valid files of each format."""
    from test_hjif import BEAT, sample, track_of

    device = load_device("forearm_band_left")
    raster = raster_for(device, rows=30)
    found: dict[str, list[bytes]] = {name: [] for name in files.FILE_FORMATS}
    for name in registry.DEVICE_FORMATS:
        if name.startswith("wav"):
            continue
        for path in registry.write(name, raster, device, folder / f"a.{name}").files:
            found[files.format_of(path).name].append(path.read_bytes())
    ticking = signal_of([0, 1, 0.5, 0], transients=[Transient(0.01, 0.9, 100.0)])
    for name in ("ahap", "haptic", "he", "openxr"):
        write = registry.DEVICE_FORMATS[name].write_signals
        assert write is not None
        for path in write([ticking], RANGE, folder / f"b.{name}", registry.DEFAULT_TOLERANCE).files:
            found[name].append(path.read_bytes())
    found["hjif"].append(json.dumps(sample()).encode())
    with track_of(folder, "vibration", "painted", BEAT) as track:
        for name in ("hjif", "jsonl"):
            for path in (
                registry.TRACK_FORMATS[name]
                .write(track, (), folder / "c", registry.DEFAULT_TOLERANCE)
                .files
            ):
                if path.suffix != glb.SUFFIX:
                    found[name].append(path.read_bytes())
    document = glb.Document()
    document.append("nodes", {"mesh": glb.add_model(document, load_model("hfx-temperature-1"))})
    found["glb"].append(document.encoded()[:MOST_BYTES])
    small = glb.Document()
    small.accessor(__import__("numpy").zeros((3, 3)))
    small.append("nodes", {"children": []})
    found["glb"].append(small.encoded())
    import struct

    form = struct.pack("<HHIIHH", 1, 1, 8000, 16000, 2, 16)
    found["wav"].append(
        b"RIFF" + struct.pack("<I", 44) + b"WAVEfmt " + struct.pack("<I", 16) + form
        + b"data" + struct.pack("<I", 8) + bytes(8)
    )  # fmt: skip
    return {
        name: sorted((data for data in each if len(data) <= MOST_BYTES), key=len)[:6]
        for name, each in found.items()
    }


def mutated(data: bytes, other: bytes, rng: random.Random) -> bytes:
    """A changed copy: JSON is changed as a tree half of the time, so that it stays JSON."""
    if rng.random() < 0.5:
        try:
            tree = json.loads(data)
        except ValueError:
            tree = None
        if isinstance(tree, dict | list):
            for _ in range(rng.choice((1, 1, 1, 2, 4))):
                change_tree(tree, rng)
            try:
                return json.dumps(tree).encode()
            except ValueError:  # a part was put into itself
                return data
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = rng.randrange(len(result) + 1)
        kind = rng.randrange(7)
        if kind == 0 and result:
            result[at % len(result)] ^= 1 << rng.randrange(8)
        elif kind == 1:
            result[at:at] = rng.choice(TOKENS)
        elif kind == 2:
            del result[at : at + rng.choice((1, 2, 8, 64, 512))]
        elif kind == 3 and other:
            start = rng.randrange(len(other))
            result[at:at] = other[start : start + rng.choice((4, 32, 256))]
        elif kind == 4 and result:
            result[at : at + 4] = rng.randrange(2**32).to_bytes(4, "little")
        elif kind == 5:
            end = at + rng.choice((1, 3, 8))
            result[at:end] = rng.choice(TOKENS)
        elif kind == 6 and result:
            result[at:at] = result[at : at + 64] * rng.choice((1, 2, 20))
    return bytes(result[:MOST_BYTES])


VALUES: tuple[object, ...] = (
    None, True, -1, 0, 1, 2, 1.5, 1e308, -1e308, 5e-324, 2**31, 2**64, "", "x", "\ud800", [], {},
    [[]], {"a": 1}, "Reference", "Composite", 7, 1000, 50_000, 10_000,
)  # fmt: skip


def change_tree(tree: object, rng: random.Random) -> None:
    """One change somewhere inside: replace, remove, double or swap a member."""
    at = tree
    for _ in range(rng.randrange(1, 14)):
        inner = (
            list(at.values()) if isinstance(at, dict) else list(at) if isinstance(at, list) else []
        )
        inner = [each for each in inner if isinstance(each, dict | list) and each]
        if not inner or rng.random() < 0.1:
            break
        at = rng.choice(inner)
    if isinstance(at, dict) and at:
        key = rng.choice(list(at))
        kind = rng.randrange(4)
        if kind == 0:
            at[key] = rng.choice(VALUES)
        elif kind == 1:
            del at[key]
        elif kind == 2:
            at[rng.choice(list(at))] = at[key]
        elif isinstance(at[key], int | float) and not isinstance(at[key], bool):
            at[key] = at[key] * rng.choice((-1, 0, 0.5, 2, 1000, 1e9)) + rng.choice((0, 0, 1, -1))
    elif isinstance(at, list) and at:
        k = rng.randrange(len(at))
        kind = rng.randrange(4)
        if kind == 0:
            at[k] = rng.choice(VALUES)
        elif kind == 1:
            del at[k]
        elif kind == 2:
            at.extend(at[k : k + 1] * rng.choice((1, 2, 40)))
        else:
            other = rng.randrange(len(at))
            at[k], at[other] = at[other], at[k]


class Coverage:
    """Lines of the readers that an input reaches."""

    def __init__(self) -> None:
        self._folder = str(Path(files.__file__).parent)
        self._seen: set[tuple[object, int]] = set()
        self._new = False

    def run(self, target: Target, content: bytes) -> bool:
        """Whether it reached something new."""
        self._new = False
        sys.settrace(self._call)
        try:
            target(content)
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

    def __len__(self) -> int:
        return len(self._seen)


def memory_mib() -> float:
    """The most that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def on_hang(number: int, frame: object) -> None:
    raise TimeoutError(f"no answer within {HANG_S} s")


def run(seconds: float, names: list[str], seed: int, keep: Path) -> int:
    """Fuzz for some time; the number of faults."""
    rng = random.Random(seed)
    readers = {name: each for name, each in targets().items() if name in names}
    with tempfile.TemporaryDirectory() as folder:
        corpus = {name: each for name, each in seeds(Path(folder)).items() if name in readers}
    coverage = Coverage()
    signal.signal(signal.SIGPROF, on_hang)
    counts = dict.fromkeys(readers, 0)
    slowest = dict.fromkeys(readers, 0.0)
    faults: dict[str, int] = {}
    for name in readers:
        for data in corpus[name]:
            coverage.run(readers[name], data)
    start_mib, end = memory_mib(), time.monotonic() + seconds
    while time.monotonic() < end:
        name = rng.choice(list(readers))
        data = mutated(rng.choice(corpus[name]), rng.choice(corpus[name]), rng)
        counts[name] += 1
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        try:
            # Tracing is slow: one input in eight tells about coverage.
            if counts[name] % 8 == 0:
                is_new = coverage.run(readers[name], data)
            else:
                readers[name](data)
                is_new = False
        except InputError:
            is_new = counts[name] % 8 == 0 and coverage._new
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            where = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{name}: {type(error).__name__} at {where.filename}:{where.lineno}: {error}"[
                :300
            ]
            if fault not in faults:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{name}-{len(faults)}").write_bytes(data)
                sys.stderr.write(fault + "\n")
            faults[fault] = faults.get(fault, 0) + 1
            continue
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        slowest[name] = max(slowest[name], time.process_time() - began)
        if is_new and len(corpus[name]) < 400:
            corpus[name].append(data)
    total = sum(counts.values())
    sys.stdout.write(
        f"{total} inputs in {seconds:.0f} s, {len(coverage)} lines reached, "
        f"memory {start_mib:.0f} to {memory_mib():.0f} MiB, {len(faults)} faults\n"
    )
    for name in readers:
        sys.stdout.write(
            f"  {name}: {counts[name]} inputs, {len(corpus[name])} kept, "
            f"slowest {slowest[name]:.2f} s\n"
        )
    return len(faults)


def run_atheris(name: str, arguments: list[str]) -> None:
    """The same under libFuzzer; never returns."""
    target = targets()[name]

    def once(content: bytes) -> None:
        try:
            target(content)
        except InputError:
            pass

    with tempfile.TemporaryDirectory() as folder:
        found = seeds(Path(folder))[name]
    corpus = Path(tempfile.mkdtemp(prefix=f"hfx-fuzz-{name}-"))
    for k, data in enumerate(found):
        (corpus / f"seed-{k}").write_bytes(data)
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], once)
    atheris.Fuzz()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--formats", default=",".join(files.FILE_FORMATS), metavar="F,...")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-faults"), help="for what failed")
    parser.add_argument("--atheris", metavar="FORMAT", help="under libFuzzer; its options follow")
    options, rest = parser.parse_known_args()
    if options.atheris:
        run_atheris(options.atheris, rest)
    return 1 if run(options.seconds, options.formats.split(","), options.seed, options.keep) else 0


if __name__ == "__main__":
    sys.exit(main())
