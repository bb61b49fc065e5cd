# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare logged onsets of stimuli with the arrival of bytes at a pseudo-terminal.

``python tests/manual/study/check_onsets.py --stimuli 1000`` takes four minutes; POSIX only.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import tty
from contextlib import closing
from pathlib import Path

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.files import resources
from hfx_tools.study.device_player import DevicePlayer
from hfx_tools.study.stimuli import Stimulus

OUTPUT = {
    "encoder": {"kind": "text", "full_scale": 1000, "start": "m ", "separator": " ", "stop": "off"},
    "transport": {"kind": "serial", "baud": 115200},
}


def read_times(master: int, results: int) -> None:
    """Write the time of the first line with strength after each silence, until "end"."""
    is_on, rest = False, b""
    while True:
        rest += os.read(master, 4096)
        now_s = time.monotonic()
        *lines, rest = rest.split(b"\n")
        for line in lines:
            if line == b"end":
                os._exit(0)
            is_strong = line.startswith(b"m ") and any(c in line[2:] for c in b"123456789")
            if is_strong and not is_on:
                os.write(results, f"{now_s!r}\n".encode())
            is_on = is_strong


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--stimuli", type=int, default=1000)
    options = parser.parse_args()
    document = json.loads((resources.device_configs() / "waist_belt.json").read_text())
    master, slave = os.openpty()
    tty.setraw(slave)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "belt.json"
        path.write_text(json.dumps({**document, "output": OUTPUT}))
        device = load_device(str(path))
        values = np.tile(device.neutral, (10, 1))
        values[:, device.strength_columns] = 0.5 * device.actuators[0].type.strength.highest
        stimulus = Stimulus("s", "", "belt", values, 0.01)
        reading, writing = os.pipe()
        # A process of its own: Python's lock would delay a thread.
        if os.fork() == 0:
            if os.geteuid() == 0:
                os.nice(-20)
            read_times(master, writing)
        os.close(writing)
        logged, echoes = [], []
        with closing(LiveClient()) as client:
            target = {"kind": "serial", "port": os.ttyname(slave)}
            client.connect("belt", path, target)
            player = DevicePlayer(client, {"belt": device})
            player.wait_ready()
            player.idle(0.5)
            rng = np.random.default_rng(1)
            for _ in range(options.stimuli):
                playback = player.play(stimulus)
                logged.append(playback.onset_s)
                echoes.append(playback.latency_s)
                player.idle(0.12 + float(rng.uniform(0.0, 0.02)))
            client.stop_all("end")
    os.write(slave, b"\nend\n")
    with os.fdopen(reading) as lines:
        onsets = [float(line) for line in lines]
    # Under load two stimuli may join at the port; each log has its nearest arrival.
    arrived = np.array(onsets)
    nearest = np.abs(np.array(logged)[:, None] - arrived[None, :]).argmin(axis=1)
    errors_ms = 1000.0 * (arrived[nearest] - np.array(logged))
    reported = np.array([echo is not None for echo in echoes])
    sys.stdout.write(
        f"{len(errors_ms)} stimuli, {int(reported.sum())} with a report: arrival after the log "
        f"{np.median(errors_ms):.2f} ms (median), |difference| p99 "
        f"{np.percentile(np.abs(errors_ms), 99):.2f} ms, largest {np.abs(errors_ms).max():.2f} ms; "
        f"load {os.getloadavg()[0]:.1f}\n"
    )


if __name__ == "__main__":
    main()
