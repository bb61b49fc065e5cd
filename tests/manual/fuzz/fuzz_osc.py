# SPDX-License-Identifier: GPL-3.0-or-later
"""Hostile OSC datagrams: random bytes, damaged VMC bundles, deep bundles, NaN and foreign names.

``python tests/manual/fuzz/fuzz_osc.py --inputs 10000000`` decodes datagrams and applies the
messages to a tracked body and to live values; any exception, pose beyond its bounds or growth is
printed and ends with 1. ``--socket`` sends a part of them to a receiver for ``--seconds``, and
prints the longest :meth:`take` and the processor time of the receiver's thread in a frame (POSIX).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import random
import socket
import struct
import sys
import time
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.tracking.osc_packets import MAX_MESSAGES, decode
from hfx_blender.tracking.receiver import MAX_KEPT, OscReceiver, ReceivedMessage
from hfx_blender.tracking.value_addresses import change_of
from hfx_blender.tracking.vmc_body import PARENTS, VmcBody


def seeds() -> list[bytes]:
    """Valid datagrams: bones, a whole body, values, an OK, and bundles within bundles."""
    messages = []
    for name in (*list(PARENTS)[:6], "LastBone", "Tail"):
        builder = OscMessageBuilder("/VMC/Ext/Bone/Pos")
        builder.add_arg(name)
        for number in (0.1, 1.0, -0.1, 0.0, 0.0, 0.0, 1.0):
            builder.add_arg(number, "f")
        messages.append(builder.build())
    for address, value in (
        ("/hfx/effect/Rain/intensity", 0.5),
        ("/hfx/clip/Hit/trigger", 1.0),
        ("/hfx/gain", 1.0),
        ("/VMC/Ext/T", 3.0),
        ("/VMC/Ext/OK", 1.0),
    ):
        builder = OscMessageBuilder(address)
        builder.add_arg(value, "f")
        messages.append(builder.build())
    bundle = OscBundleBuilder(IMMEDIATELY)
    for message in messages:
        bundle.add_content(message)
    inner = bundle.build()
    outer = OscBundleBuilder(IMMEDIATELY)
    outer.add_content(inner)
    return [*(message.dgram for message in messages), inner.dgram, outer.build().dgram]


def hostile(generator: random.Random) -> Iterator[bytes]:
    """Datagrams without end."""
    valid = seeds()
    odd = [struct.pack(">f", x) for x in (math.nan, math.inf, -math.inf, 3e38, 2.0)]
    odd += [struct.pack(">i", x) for x in (-1, 0, 3, 2**31 - 1, -(2**31), 16, 1 << 20)]
    odd += [b"#bundle\0", b"/*\0\0", b",fff", b",[i]", b"\xff\xff\xff\xff", b"/VMC/Ext"]
    while True:
        kind = generator.randrange(8)
        if kind == 0:
            yield generator.randbytes(generator.randrange(64))
        elif kind == 1:  # bundles within bundles, with and without content
            content = generator.choice(valid[:13])
            for _ in range(generator.randrange(1, 40)):
                content = b"#bundle\0" + bytes(8) + struct.pack(">i", len(content)) + content
            yield content
        else:
            data = bytearray(generator.choice(valid))
            for _ in range(generator.randint(1, 4)):
                place = generator.randrange(0, len(data), 4) if len(data) else 0
                if kind < 5:
                    data[place : place + 4] = generator.choice(odd)
                else:
                    data[generator.randrange(len(data))] = generator.randrange(256)
            yield bytes(data[: generator.randint(0, len(data))] if kind == 7 else data)


def check(inputs: int, seed: int) -> str:
    """Apply datagrams; returns a sentence about the first fault, or ""."""
    body, begun = VmcBody(), time.monotonic()
    counts = {"messages": 0, "ignored": 0, "changes": 0}
    for number, datagram in zip(range(inputs), hostile(random.Random(seed)), strict=False):
        messages, ignored = decode(datagram)
        counts["messages"] += len(messages)
        counts["ignored"] += ignored
        if len(messages) > MAX_MESSAGES:
            return f"input {number}: {len(messages)} messages"
        body.update(ReceivedMessage(message, 1.0) for message in messages)
        for message in messages:
            change = change_of(message)
            if change is not None:
                counts["changes"] += 1
                if not math.isfinite(change.value):
                    return f"input {number}: {change}"
        for pose in (*body.poses.values(), *body.devices.values()):
            if not all(abs(x) <= 1000.0 for x in pose.position_m):
                return f"input {number}: {pose}"
            if abs(sum(x * x for x in pose.rotation) - 1.0) > 1e-6:
                return f"input {number}: {pose}"
        if len(body.poses) > 56 or len(body.devices) > 32:
            return f"input {number}: {len(body.poses)} poses, {len(body.devices)} devices"
        # A hostile pose must not hide the next ones.
        if number % 1000 == 0:
            body = VmcBody()
    seconds = time.monotonic() - begun
    print(f"{inputs} datagrams in {seconds:.0f} s: {counts}, refused poses reset")  # noqa: T201
    return ""


def send_flood(port: int, seed: int) -> None:
    """Send datagrams as fast as possible until the process is ended."""
    datagrams = hostile(random.Random(seed))
    prepared = [next(datagrams) for _ in range(5000)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in cycle(prepared):
            sender.sendto(datagram, ("127.0.0.1", port))


def flood(seconds: float, seed: int) -> str:
    """Receive a flood from another process; returns a sentence about a fault, or ""."""
    receiver, longest_s = OscReceiver(), 0.0
    sender = multiprocessing.get_context("spawn").Process(
        target=send_flood, args=(receiver.port, seed), daemon=True
    )
    sender.start()
    clock = time.pthread_getcpuclockid(receiver._thread.ident or 0)
    frames_s: list[float] = []
    try:
        while not receiver.take():
            time.sleep(0.01)
        frame_s, used_s = time.monotonic(), time.clock_gettime(clock)
        end = frame_s + seconds
        while frame_s < end:
            time.sleep(1 / 60)
            begun = time.perf_counter()
            taken = receiver.take()
            longest_s = max(longest_s, time.perf_counter() - begun)
            now_s, spent_s = time.monotonic(), time.clock_gettime(clock)
            # This process may have waited for more than a frame.
            frames_s.append((spent_s - used_s) / max(60.0 * (now_s - frame_s), 1.0))
            frame_s, used_s = now_s, spent_s
            if len(taken) > MAX_KEPT:
                return f"{len(taken)} messages at once"
    finally:
        receiver.close()
        sender.terminate()
    frames_s.sort()
    print(  # noqa: T201
        f"longest take {1000 * longest_s:.3f} ms; processor time of the receiver in a frame "
        f"{1000 * frames_s[len(frames_s) // 2]:.2f} ms (median), {1000 * frames_s[-1]:.2f} ms "
        f"(largest of {len(frames_s)})"
    )
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=45)
    parser.add_argument("--socket", action="store_true", help="send to a receiver instead")
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    fault = (
        flood(options.seconds, options.seed)
        if options.socket
        else check(options.inputs, options.seed)
    )
    if fault:
        print(fault)  # noqa: T201
    return int(bool(fault))


if __name__ == "__main__":
    sys.exit(main())
