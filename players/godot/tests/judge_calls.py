# SPDX-License-Identifier: MIT
"""Compare the plan of tests/controllers.gd with the calls received by an OpenXR runtime.

``python judge_calls.py plan.csv api_dump.txt``, with the output of Khronos' API dump layer. Each
frame with a strength above 0 calls for a pulse of the dead-man time on that controller; the first
silent frame afterwards calls for a pulse of strength 0. The exit code is 1 if a call is missing,
extra or different (amplitudes and frequencies as float32, durations to the nanosecond).
"""

import re
import struct
import sys
from pathlib import Path

STRONGEST_M_S2, DEAD_MAN_NS, SILENCE_NS = 10.0, 250_000_000, 10_000_000
CALL = re.compile(
    r"^XrResult xrApplyHapticFeedback\n(?:    .*\n)*?    XrPath .*subactionPath = (\d+)\n"
    r"(?:    .*\n)*?    XrDuration .*duration = (\d+)\n    float .*frequency = (\S+)\n"
    r"    float .*amplitude = (\S+)\n",
    re.MULTILINE,
)


def single(number: float) -> float:
    """Round to float32."""
    return struct.unpack("f", struct.pack("f", number))[0]


def planned(text: str) -> list[tuple[int, int, float, float]]:
    calls = []
    is_on = [False, False]
    for line in text.splitlines()[1:]:
        numbers = [float(field.strip('"')) for field in line.split(",")]
        for side in (0, 1):
            strength, frequency_hz = numbers[2 * side : 2 * side + 2]
            if strength > 0.0:
                share = single(single(strength) / STRONGEST_M_S2)
                calls.append((side + 1, DEAD_MAN_NS, single(frequency_hz), share))
            elif is_on[side]:
                calls.append((side + 1, SILENCE_NS, 0.0, 0.0))
            is_on[side] = strength > 0.0
    return calls


def main() -> int:
    plan = planned(Path(sys.argv[1]).read_text())
    calls = [
        (int(path), int(duration), single(float(frequency)), single(float(amplitude)))
        for path, duration, frequency, amplitude in CALL.findall(Path(sys.argv[2]).read_text())
    ]
    wrong = sum(expected != call for expected, call in zip(plan, calls, strict=False))
    wrong += abs(len(plan) - len(calls))
    sys.stdout.write(f"{len(plan)} calls planned, {len(calls)} found, {wrong} different\n")
    return 1 if wrong or not plan else 0


if __name__ == "__main__":
    sys.exit(main())
