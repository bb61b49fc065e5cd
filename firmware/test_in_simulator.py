# SPDX-License-Identifier: GPL-3.0-or-later
"""Test of the real sketch, compiled for an Arduino Uno and run in simavr, driven by the host.

Needs avr-gcc, avr-libc, the Arduino core, a C compiler, libsimavr and its parts (on Debian:
gcc-avr avr-libc arduino-core-avr libsimavr-dev). Run it apart from the tests:

    python firmware/test_in_simulator.py [trials]

The output is medians and maxima over all trials: values at the port to the pin, stop to silence,
host lost to silence. Times are of the wall clock; on a busy computer the simulated board runs
slower, so silence after a lost host is also given by the board's own clock.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports.serial_port import SerialPort
from hfx_blender.devices.transports.wire_board import WireBoard

SKETCH = Path(__file__).parent / "hfx_pwm"
CORE = Path("/usr/share/arduino/hardware/arduino/avr")
UNO = ["-mmcu=atmega328p", "-DF_CPU=16000000UL", "-DARDUINO=10819", "-DARDUINO_AVR_UNO"]

SIMULATOR = r"""
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <simavr/avr_ioport.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/parts/uart_pty.h>

/* Pins 3, 5, 6, 9, 10 and 11 of an Arduino Uno, as ports and bits. */
static const struct { int port, bit; } PINS[] = {
    {'D', 3}, {'D', 5}, {'D', 6}, {'B', 1}, {'B', 2}, {'B', 3},
};
/* Control register, its enabling bit, compare register: the duty that a pin really has. */
static const struct { int control, enabled, compare; } REGISTERS[] = {
    {0xB0, 0x20, 0xB4}, {0x44, 0x20, 0x48}, {0x44, 0x80, 0x47},
    {0x80, 0x80, 0x88}, {0x80, 0x20, 0x8A}, {0xB0, 0x80, 0xB3},
};

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

int main(int count, char **arguments)
{
    elf_firmware_t image = {0};
    if (count < 2 || elf_read_firmware(arguments[1], &image))
        return 2;
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    image.frequency = 16000000;
    avr_load_firmware(avr, &image);
    avr->log = LOG_ERROR;
    uart_pty_t pty;
    uart_pty_init(avr, &pty);
    uart_pty_connect(&pty, '0');
    printf("port %s\n", pty.pty.slavename);
    fflush(stdout);
    int before[6] = {0};
    double began = now();
    avr_cycle_count_t zero = avr->cycle, told = 0;
    for (;;) {
        for (int i = 0; i < 400; i++) {
            int state = avr_run(avr);
            if (state == cpu_Done || state == cpu_Crashed)
                return 3;
        }
        int changed = 0;
        for (int i = 0; i < 6; i++) {
            avr_ioport_state_t port;
            avr_ioctl(avr, AVR_IOCTL_IOPORT_GETSTATE(PINS[i].port), &port);
            int is_pwm = avr->data[REGISTERS[i].control] & REGISTERS[i].enabled;
            int is_high = (port.port >> PINS[i].bit) & 1;
            int duty = is_pwm ? avr->data[REGISTERS[i].compare] : is_high ? 255 : 0;
            changed |= duty != before[i];
            before[i] = duty;
        }
        if (changed || avr->cycle - told > 32000) {
            told = avr->cycle;
            printf("%.6f %.6f", now(), avr->cycle / 16e6);
            for (int i = 0; i < 6; i++)
                printf(" %d", before[i]);
            printf("\n");
            fflush(stdout);
        }
        double ahead = (double)(avr->cycle - zero) / 16e6 - (now() - began);
        if (ahead > 0.0005) {
            struct timespec rest = {0, (long)(ahead * 1e9)};
            nanosleep(&rest, NULL);
        } else if (ahead < -0.05) { /* the computer was busy: do not run after the lost time */
            zero = avr->cycle;
            began = now();
        }
    }
}
"""


def run(command: list[str]) -> None:
    subprocess.run(command, check=True)


def sketch_image(folder: Path) -> Path:
    """Build the sketch with the flags of the Arduino tools; returns the path of the ELF image."""
    includes = [f"-I{CORE / 'cores' / 'arduino'}", f"-I{CORE / 'variants' / 'standard'}"]
    common = [*UNO, "-Os", "-w", "-ffunction-sections", "-fdata-sections", *includes]
    main = folder / "sketch.cpp"
    main.write_text("#include <Arduino.h>\n" + (SKETCH / "hfx_pwm.ino").read_text())
    objects = []
    core = CORE / "cores" / "arduino"
    unused = ("WString.cpp",)  # newer compilers reject this file; the sketch uses no strings
    sources = [main, SKETCH / "hfx_core.c", *core.glob("*.c*")]
    sources = [path for path in sources if path.name not in unused]
    for source in [*sources, *core.glob("*.S")]:
        object_file = folder / (source.name + ".o")
        compiler = "avr-g++" if source.suffix == ".cpp" else "avr-gcc"
        extra = (
            ["-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"]
            if compiler == "avr-g++"
            else ["-std=gnu11"]
        )
        if source.suffix == ".S":
            extra = ["-x", "assembler-with-cpp"]
        run([compiler, *common, *extra, f"-I{SKETCH}", "-c", str(source), "-o", str(object_file)])
        objects.append(str(object_file))
    image = folder / "hfx_pwm.elf"
    run(["avr-gcc", *UNO, "-Os", "-w", "-Wl,--gc-sections", *objects, "-lm", "-o", str(image)])
    run(["avr-size", str(image)])
    return image


def simulator(folder: Path) -> Path:
    """Build the simulated board; the program prints wall clock, board clock and six duties."""
    source, program = folder / "simulator.c", folder / "simulator"
    source.write_text(SIMULATOR)
    run(
        [
            *("cc", "-O2", "-w", "-I/usr/include/simavr", str(source), "-o", str(program)),
            *("-lsimavrparts", "-lsimavr", "-lpthread"),
        ]
    )
    return program


class Pins:
    """Duties (0..255) of the six simulated pins, read from the simulator's output."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        self._stream = process.stdout
        self._rest = ""
        self.duties = [0] * 6
        self.changed_s = 0.0  # wall clock
        self.board_s = 0.0  # the board's own clock, a few milliseconds ago at most

    def wait(self, is_true, within_s: float = 2.0) -> float:
        """Read until the duties pass a test; returns the wall-clock time of their last change.

        Raises
        ------
        SystemExit
            The test fails for ``within_s`` seconds.
        """
        until = time.monotonic() + within_s
        while True:
            self.read()
            if is_true(self.duties):
                return self.changed_s
            if time.monotonic() > until:
                raise SystemExit(f"the pins stay at {self.duties}")
            time.sleep(0.0002)

    def read(self) -> None:
        with contextlib.suppress(BlockingIOError, TypeError):
            self._rest += os.read(self._stream.fileno(), 65536).decode()
        *lines, self._rest = self._rest.split("\n")
        for line in lines:
            wall, board, *words = line.split()
            duties = [int(word) for word in words]
            if duties != self.duties:
                self.changed_s, self.duties = float(wall), duties
                self.changed_board_s = float(board)
            self.board_s = float(board)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", nargs="?", type=int, default=100)
    trials = parser.parse_args().trials
    device = load_device("arduino_uno_pwm")
    on = np.tile([15.0, 150.0], 6)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        image = sketch_image(folder)
        process = subprocess.Popen(
            [str(simulator(folder)), str(image)], stdout=subprocess.PIPE, text=True
        )
        try:
            assert process.stdout is not None
            while not (line := process.stdout.readline()).startswith("port "):
                pass
            port_name = line.split()[1]
            pins = Pins(process)
            durations_s: dict[str, list[float]] = {"values": [], "stop": [], "host lost": []}
            durations_s["host lost, board's clock"] = []
            board = WireBoard(device, SerialPort(port_name, 115200))
            for _ in range(trials):
                _armed(board, on, pins)
                half = on.copy()
                half[::2] *= random.uniform(0.3, 0.8)
                began = time.monotonic()
                board.send(half)
                durations_s["values"].append(pins.wait(lambda d: max(d) < 255) - began)
                began = time.monotonic()
                board.stop()
                durations_s["stop"].append(pins.wait(lambda d: max(d) == 0) - began)
            for _ in range(max(trials // 5, 1)):
                _armed(board, on, pins)
                board.send(on)
                began = time.monotonic()
                pins.read()
                on_board = pins.board_s
                durations_s["host lost"].append(pins.wait(lambda d: max(d) == 0) - began)
                durations_s["host lost, board's clock"].append(pins.changed_board_s - on_board)
                with contextlib.suppress(OutputLostError):
                    board.send(on)
                board.stop()
            board.close()
            for kind, times in durations_s.items():
                ordered = sorted(times)
                print(  # noqa: T201
                    f"{kind}: {len(times)} trials, median {1000 * ordered[len(times) // 2]:.1f} ms,"
                    f" max {1000 * ordered[-1]:.1f} ms"
                )
        finally:
            process.kill()
    sys.exit(0)


def _armed(board: WireBoard, on: np.ndarray, pins: Pins) -> None:
    until = time.monotonic() + 3.0
    while min(pins.duties) < 255:
        board.send(on)
        time.sleep(0.005)
        pins.read()
        if time.monotonic() > until:
            raise SystemExit(f"the board does not play: {pins.duties}")


if __name__ == "__main__":
    main()
