# SPDX-License-Identifier: GPL-3.0-or-later
"""Accounts of time on that outlive a connection, this process and Blender: a file a device.

A file holds how full the accounts were and when, by two clocks. Rest since then is the shorter of
what they tell, so that a clock that was set forward gives none. A file that nobody finished (the
process was killed) counts as on for as long as one is not written; a damaged one as full.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ...atomic_files import atomic_file
from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.device_output import BhapticsEncoder, ButtplugEncoder
from ...errors import HfxError
from .clock import SYSTEM, Clock
from .discovery import serial_ports
from .opening import kind_of
from .time_on import Account

KEEP_S: Final = 1.0
"""Interval of saving changed accounts, seconds."""

_UNKNOWN_S: Final = 2.0 * KEEP_S
_MOST_BYTES: Final = 1 << 20

_log = logging.getLogger(__name__)


def identities(device: DeviceConfig, target: Mapping[str, Any]) -> tuple[str, ...]:
    """Identities of the physical device behind a target; targets that share one share accounts.

    A serial number where there is one. A port without counts by its path and by the
    configuration, a network address together with the device there. What has no address is known
    by its configuration alone.
    """
    kind = target.get("kind")
    if kind == "serial":
        name = str(target.get("port"))
        real = os.path.realpath(name) if os.name == "posix" else name.upper()
        for port in serial_ports():
            at = os.path.realpath(port.name) if os.name == "posix" else port.name.upper()
            if at == real and port.usb is not None and port.serial:
                return (f"usb {port.usb[0]:04x}:{port.usb[1]:04x} {port.serial}",)
        return f"port {real}", f"device {device.id}"
    if kind in ("udp", "websocket") and kind == kind_of(device):
        assert device.output is not None
        how, transport = device.output.encoder, device.output.transport
        host = str(target.get("host", getattr(transport, "host", ""))).lower()
        host = "127.0.0.1" if host in ("localhost", "::1") else host
        port_number = target.get("port", getattr(transport, "port", ""))
        named = device.id
        if isinstance(how, ButtplugEncoder) and how.device_name:
            named = how.device_name
        elif isinstance(how, BhapticsEncoder):
            named = " ".join(sorted({position for position, _ in how.dots}))
        return (f"{kind} {host}:{port_number} {named}",)
    if kind == "audio":
        return (f"audio {target.get('interface', '')}:{target.get('first_channel', 1)}",)
    return (f"device {device.id}",)


@dataclass(eq=False)
class _Kept:
    """Account with its last saved state."""

    account: Account
    path: Path
    written: tuple[Any, ...] = ()


class KeptAccounts:
    """Accounts that this process has used.

    Parameters
    ----------
    folder : Path
        Of their files; it need not exist.
    clock : Clock
        The one that those who play go by.
    """

    def __init__(self, folder: Path, clock: Clock = SYSTEM) -> None:
        self._folder, self._clock = folder, clock
        self._kept: dict[str, _Kept] = {}
        self._lock = threading.Lock()
        self._is_told = False
        self._changed = threading.Event()

    def of(self, identity: str) -> Account:
        """Account of a physical device, with the state that other processes left."""
        with self._lock:
            known = self._kept.get(identity)
            if known is None:
                name = hashlib.sha256(identity.encode()).hexdigest()[:32] + ".json"
                path = self._folder / name
                known = self._kept[identity] = _Kept(_read(path, self._clock.now()), path)
                known.account.on_begin = self._changed.set
            return known.account

    def save(self) -> None:
        """Save changed accounts; an unwritable folder is reported once."""
        with self._lock:
            for identity, each in self._kept.items():
                state = _state(each.account)
                if state == each.written:
                    continue
                try:
                    _write(each.path, identity, state, self._clock.now())
                except (HfxError, OSError) as error:
                    if not self._is_told:
                        self._is_told = True
                        _log.warning("time on is not remembered: %s", error)
                else:
                    each.written = state

    def save_regularly(self) -> None:
        """Save changes for ever, and at once when a device begins; runs in a thread."""
        while True:
            self._changed.wait(KEEP_S)
            self._changed.clear()
            self.save()


def _state(account: Account) -> tuple[Any, ...]:
    """State of an account: how full, resting, playing, idle since."""
    with account.lock:
        return (
            tuple(account.filled.tolist()),
            tuple(account.is_resting.tolist()),
            bool(account.players),
            account.idle_since_s,
        )


def _write(path: Path, identity: str, state: tuple[Any, ...], now_s: float) -> None:
    filled, is_resting, is_open, idle_since_s = state
    idle_s = max(now_s - idle_since_s, 0.0) if math.isfinite(idle_since_s) else 0.0
    content = {
        "device": identity,
        "filled": filled,
        "is_resting": is_resting,
        "is_open": is_open,
        "wall_s": time.time() - idle_s,
        "monotonic_s": now_s - idle_s,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(json.dumps(content).encode())


def _read(path: Path, now_s: float) -> Account:
    try:
        with open(path, "rb") as file:
            found = json.loads(file.read(_MOST_BYTES))
        filled = [_number(each) for each in found["filled"]]
        is_resting = [each is not False for each in found["is_resting"]]
        wall_s, then_s = _number(found["wall_s"]), _number(found["monotonic_s"])
        is_open = found["is_open"] is not False
        if len(filled) != len(is_resting):
            raise ValueError("lists of unequal length")
    except FileNotFoundError:
        return Account(idle_since_s=now_s)
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s); its device rests first.", path, error)
        return Account(others=1.0, idle_since_s=now_s)
    # After a restart of the computer its clock begins anew: it has run at least this long.
    told_s = now_s - then_s if now_s >= then_s else now_s
    rest_s = max(min(told_s, time.time() - wall_s), 0.0)
    return Account(
        filled,
        is_resting,
        idle_since_s=now_s - rest_s,
        unknown_s=_UNKNOWN_S if is_open else 0.0,
    )


def _number(found: object) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ValueError("not a number")
    if not (math.isfinite(found) and found >= 0.0):
        raise ValueError("not a number of 0 or more")
    return float(found)
