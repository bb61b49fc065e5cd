# SPDX-License-Identifier: GPL-3.0-or-later
"""Thalmic Myo by Bluetooth LE, with the commands of Thalmic Labs' ``myohw.h`` (2015)."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Mapping
from importlib import import_module
from typing import Any, Final

from hfx_blender.errors import DeviceError

CONTROL_SERVICE: Final = "d5060001-a904-deb9-4748-2c7f4a124842"
COMMAND: Final = "d5060401-a904-deb9-4748-2c7f4a124842"
_VIBRATE2: Final = 0x07
_STEPS: Final = 6
_HOLD_MS: Final = 300  # the motor stops by itself after this time
_REPEATED_S: Final = 0.15


def vibrate(strength: float) -> bytes:
    """Command of extended vibration: a step of 300 ms at a strength 0..1, five empty steps."""
    level = round(min(max(strength, 0.0), 1.0) * 255)
    steps = [(_HOLD_MS, level), *[(0, 0)] * (_STEPS - 1)]
    payload = b"".join(struct.pack("<HB", *step) for step in steps)
    return struct.pack("BB", _VIBRATE2, len(payload)) + payload


class Myo:
    """Arm band at a Bluetooth ``address``, or the first one found. Raises DeviceError: bleak is not
    installed, or the band is not found, cannot be connected, or is lost."""

    def __init__(self, address: str = "") -> None:
        try:
            bleak = import_module("bleak")
        except ImportError:
            raise DeviceError(
                "Bluetooth needs the package bleak: pip install 'hfx-blender[bluetooth]'."
            ) from None
        self._loop = asyncio.new_event_loop()
        self._level = -1.0
        self._sent_s = 0.0
        self._client: Any = self._done(self._connect(bleak, address))

    def set(self, values: Mapping[str, float]) -> None:
        """Vibrate with the largest of the strengths 0..1; the command is repeated while above 0."""
        level = max(values.values(), default=0.0)
        now_s = time.monotonic()
        is_old = level > 0.0 and now_s - self._sent_s > _REPEATED_S
        if level != self._level or is_old:
            # Not confirmed: a confirmation takes two intervals of the connection.
            self._done(self._client.write_gatt_char(COMMAND, vibrate(level), response=False))
            self._level, self._sent_s = level, now_s

    def close(self) -> None:
        """Stop the motor and disconnect."""
        self.set({})
        self._done(self._client.disconnect())
        self._loop.close()

    async def _connect(self, bleak: Any, address: str) -> Any:
        found: Any = address
        if not address:
            found = await bleak.BleakScanner.find_device_by_filter(
                lambda _device, seen: CONTROL_SERVICE in (x.lower() for x in seen.service_uuids)
            )
            if found is None:
                raise DeviceError("No Myo was found by Bluetooth. Wake the band up by moving it.")
        client = bleak.BleakClient(found)
        await client.connect()
        return client

    def _done(self, work: Any) -> Any:
        """Run a coroutine to its end; faults of bleak as DeviceError."""
        try:
            return self._loop.run_until_complete(work)
        except DeviceError:
            raise
        except Exception as error:  # of the system's Bluetooth, of many types
            raise DeviceError(f"The Myo cannot be reached by Bluetooth ({error}).") from None
