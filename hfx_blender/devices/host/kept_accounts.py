# SPDX-License-Identifier: GPL-3.0-or-later
"""Accounts of time on that outlive a connection, this process and Blender: a file a device.

A file holds how full the accounts were and when, by two clocks. Rest since then is the shorter of
what they tell, so that a clock that was set forward gives none. A file that nobody finished (the
process was killed) counts as on for as long as one is not written; a damaged one as full.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import math
import os
import re
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.device_output import (
    BhapticsEncoder,
    ButtplugEncoder,
    Encoder,
    OscEncoder,
)
from ...errors import HfxError
from ...files.atomic import atomic_file
from ...files.locks import take_lock
from ..live.discovery import serial_ports
from ..transports.reservations import computer
from .clock import SYSTEM, Clock
from .encoders import Channels, osc_addresses
from .opening import kind_of
from .output import OutputLostError
from .time_on import Account, AccountUse

KEEP_S: Final = 1.0
"""Interval of saving changed accounts, seconds."""

_UNKNOWN_S: Final = 2.0 * KEEP_S
_MOST_BYTES: Final = 1 << 20

_log = logging.getLogger(__name__)


class Identity(NamedTuple):
    """Physical output: its name, and the name of the slot of each actuator there.

    Never the id of a configuration where there is an address: a copy under another id drives the
    same hardware.
    """

    name: str
    slots: tuple[str, ...]
    is_hardware: bool = True


def identities(
    device: DeviceConfig, target: Mapping[str, Any], there: str = ""
) -> tuple[Identity, ...]:
    """Identities of the physical device behind a target; targets that share one share accounts.

    A serial number where there is one. A port without counts by its path and by the
    configuration. A network address counts whatever its spelling, with the actuators there: by
    their OSC addresses (without the configuration's id), by the features of the device of a
    Buttplug server, by the motors of the bHaptics Player. All sound cards are one, with their
    channels: the same card has many names. What has no address is known by its configuration.

    Parameters
    ----------
    there : str
        The device that a server chose, once it is connected.
    """
    kind = target.get("kind")
    numbers = tuple(map(str, range(len(device.actuators))))
    if kind == "serial":
        real = _real_port(str(target.get("port")))
        for port in serial_ports():
            if _real_port(port.name) == real and port.usb is not None and port.serial:
                usb = f"usb {port.usb[0]:04x}:{port.usb[1]:04x} {port.serial}"
                return (Identity(usb, numbers),)
        return Identity(f"port {real}", numbers), Identity(f"device {device.id}", numbers, False)
    if kind in ("udp", "websocket") and kind == kind_of(device):
        assert device.output is not None
        transport = device.output.transport
        host = computer(str(target.get("host", getattr(transport, "host", ""))))
        port_number = target.get("port", getattr(transport, "port", ""))
        name = f"{kind} {host}:{port_number} {there}".rstrip()
        return (Identity(name, _network_slots(device, device.output.encoder)),)
    if kind == "audio":
        first = target.get("first_channel", 1)
        vibrating = [a.type.modality == "vibration" for a in device.actuators]
        channels = np.cumsum(vibrating) - 1 + (first if isinstance(first, int) else 1)
        slots = (
            str(channel) if is_played else "none"
            for channel, is_played in zip(channels, vibrating, strict=True)
        )
        return (Identity("audio", tuple(slots)),)
    return (Identity(f"device {device.id}", numbers, False),)


def _network_slots(device: DeviceConfig, how: Encoder) -> tuple[str, ...]:
    if isinstance(how, ButtplugEncoder):
        return tuple(str(feature) for feature, _ in how.outputs)
    if isinstance(how, BhapticsEncoder):
        dots = how.worn_dots(is_mirrored=device.is_mirrored)
        return tuple(f"{position} {index}" for position, index in dots)
    assert isinstance(how, OscEncoder)
    anonymous = replace(device, id="*")
    names = Channels(device).names
    by_name = dict(zip(names, osc_addresses(anonymous, how), strict=True))
    return tuple(
        by_name.get((each.id, each.type.strength.name), "none") for each in device.actuators
    )


def _real_port(name: str) -> str:
    """Path of a serial port without links; macOS has two names for one."""
    if os.name != "posix":
        return name.upper()
    return re.sub(r"^/dev/tty\.", "/dev/cu.", os.path.realpath(name))


@dataclass(eq=False)
class _Kept:
    """Account with its last saved state."""

    account: Account
    path: Path
    written: tuple[Any, ...] = ()
    users: int = 0
    lock: int | None = None  # descriptor of the locked file


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
            return self._of(identity).account

    def _of(self, identity: str) -> _Kept:
        known = self._kept.get(identity)
        if known is None:
            name = hashlib.sha256(identity.encode()).hexdigest()[:32] + ".json"
            path = self._folder / name
            known = self._kept[identity] = _Kept(_read(path, self._clock.now()), path)
            known.account.on_begin = self._changed.set
        return known

    @contextmanager
    def used(self, found: Sequence[Identity]) -> Iterator[list[AccountUse]]:
        """Context with the accounts of a device, which no other process uses meanwhile.

        Raises
        ------
        OutputLostError
            Another process uses one.
        """
        taken: list[str] = []
        uses = []
        try:
            for each in found:
                with self._lock:
                    known = self._kept.get(each.name)
                    lock = None
                    if each.is_hardware and (known is None or known.lock is None):
                        lock = _locked(self._folder, each.name)
                    known = self._of(each.name)
                    known.lock = known.lock if lock is None else lock
                    known.users += 1
                taken.append(each.name)
                uses.append(AccountUse(known.account, each.slots))
            yield uses
        finally:
            with self._lock:
                for name in taken:
                    self._give_back(name)

    def _give_back(self, name: str) -> None:
        known = self._kept[name]
        self._save(name, known)
        known.users -= 1
        if known.users or known.lock is None:
            return
        os.close(known.lock)
        known.lock = None
        if known.written == _state(known.account):
            del self._kept[name]  # another process may change it: it is read again

    def save(self) -> None:
        """Save changed accounts; an unwritable folder is reported once."""
        with self._lock:
            for identity, each in self._kept.items():
                self._save(identity, each)

    def _save(self, identity: str, each: _Kept) -> None:
        state = _state(each.account)
        if state == each.written:
            return
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


def _locked(folder: Path, identity: str) -> int | None:
    """Descriptor of a file that is locked until it is closed; None where there are no locks.

    Raises
    ------
    OutputLostError
        Another process has it.
    """
    path = folder / (hashlib.sha256(identity.encode()).hexdigest()[:32] + ".lock")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600)
    except OSError:
        return None  # the accounts cannot be saved either, which is told then
    try:
        take_lock(descriptor)
    except OSError as error:
        os.close(descriptor)
        if error.errno in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL):
            return None
        raise OutputLostError(
            "another process drives this hardware, and its time on is limited; disconnect it there."
        ) from None
    return descriptor


def _state(account: Account) -> tuple[Any, ...]:
    """State of an account: names, how full, resting, playing, idle since, unknown."""
    with account.lock:
        return (
            tuple(account.slots),
            tuple(account.filled.tolist()),
            tuple(account.is_resting.tolist()),
            tuple((~account.is_used_before(None)).tolist()),
            tuple(account.idle_since_s.tolist()),
            tuple(account.unknown_s.tolist()),
        )


def _write(path: Path, identity: str, state: tuple[Any, ...], now_s: float) -> None:
    names, filled, is_resting, is_idle, idle_since_s, unknown_s = state
    content = {
        "device": identity,
        "slots": names,
        "filled": filled,
        "is_resting": is_resting,
        "is_open": not all(is_idle),
        "idle_s": [
            max(now_s - since_s, 0.0) if idle and math.isfinite(since_s) else 0.0
            for idle, since_s in zip(is_idle, idle_since_s, strict=True)
        ],
        "unknown_s": unknown_s,
        "wall_s": time.time(),
        "monotonic_s": now_s,
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
        # Files of earlier versions: actuators by their numbers, all idle since the file's time.
        names = [str(each) for each in found.get("slots", range(len(filled)))]
        idle_s = [_number(each) for each in found.get("idle_s", [0.0] * len(filled))]
        unknown_s = [_number(each) for each in found.get("unknown_s", [0.0] * len(filled))]
        if len({len(each) for each in (filled, is_resting, set(names), idle_s, unknown_s)}) > 1:
            raise ValueError("lists of unequal length")
    except FileNotFoundError:
        return Account(idle_since_s=now_s)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s); its device rests first.", path, error)
        return Account(others=1.0, idle_since_s=now_s)
    # After a restart of the computer its clock begins anew: it has run at least this long.
    told_s = now_s - then_s if now_s >= then_s else now_s
    rest_s = max(min(told_s, time.time() - wall_s), 0.0)
    return Account(
        filled,
        is_resting,
        names=names,
        idle_s=idle_s,
        unknown_s=[each + (_UNKNOWN_S if is_open else 0.0) for each in unknown_s],
        idle_since_s=now_s - rest_s,
    )


def _number(found: object) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ValueError("not a number")
    if not (math.isfinite(found) and found >= 0.0):
        raise ValueError("not a number of 0 or more")
    return float(found)
