# SPDX-License-Identifier: GPL-3.0-or-later
"""Duty budgets that outlive a connection, this process and Blender: a file for each device.

A file holds the loads and the time of writing by two clocks, monotonic and wall. The rest since
then is the shorter of the two differences, so that a wall clock that was set forward gives no rest.
A file of a killed process counts as on for the interval of writing; a damaged file as load 1.
"""

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

from ...engine.rendering import device_config
from ...errors import HfxError
from ...files.atomic import atomic_file
from ...files.locks import take_lock
from ..live.discovery import serial_ports
from ..transports.reservations import computer
from .clock import SYSTEM, Clock
from .encoders import Channels, osc_addresses
from .opening import kind_of, targets_of
from .output import OutputLostError
from .time_on import BudgetUse, DutyBudget

KEEP_S: Final = 1.0
"""Interval of saving changed budgets, seconds."""

# Time on after the last save of a killed process that no file tells of.
_UNKNOWN_S: Final = 2.0 * KEEP_S
_MOST_BYTES: Final = 1 << 20

_log = logging.getLogger(__name__)


class Identity(NamedTuple):
    """Name of a physical output, and the slot name of each actuator of a configuration.

    An address where possible, as a copied configuration under another id drives the same hardware.
    """

    name: str
    slots: tuple[str, ...]
    is_hardware: bool = True


def identities(
    device: device_config.DeviceConfig, target: Mapping[str, Any], *labels: str
) -> tuple[Identity, ...]:
    """Identities of the physical device behind a target; equal identities share budgets.

    ========================  ===================================================================
    target                    identity
    ========================  ===================================================================
    port with serial number   USB ids and serial number
    port without              two: the port's path, and the configuration's id
    VRC Haptics               the label, MAC address of the board
    network                   normalised address and label; slots are OSC addresses without
                              the configuration's id, features of a Buttplug device, or motors of
                              the bHaptics Player
    sound card                common to all cards, as a card has many names; slots are channels
    log, simulator            the configuration's id
    ========================  ===================================================================

    ``target``: as for :func:`.opening.open_output`.
    ``labels``: label of the device that a server chose, for each output; "" without a server.

    A device with several outputs has the identities of all of them. An actuator has a slot of its
    own in the identities of other outputs.
    """
    if target.get("kind") != "several":
        return _identities_of_part(device, target, *labels[:1])
    identities: list[Identity] = []
    for number, (part, part_target) in enumerate(
        zip(device.parts, targets_of(target), strict=True)
    ):
        ids = [actuator.id for actuator in part.actuators]
        for identity in _identities_of_part(part, part_target, *labels[number : number + 1]):
            # A slot of its own for each other actuator: a common one would be on whenever any of
            # them is.
            own = dict(zip(ids, identity.slots, strict=True))
            slots = tuple(own.get(x.id, f"elsewhere {x.id}") for x in device.actuators)
            identities.append(identity._replace(slots=slots))
    return tuple(identities)


def _identities_of_part(
    device: device_config.DeviceConfig, target: Mapping[str, Any], label: str = ""
) -> tuple[Identity, ...]:
    """Identities of a device with one output, as of :func:`identities`."""
    kind = target.get("kind")
    numbers = tuple(map(str, range(len(device.actuators))))
    if kind == "serial":
        # A serial number follows the board to any port; a port without one is known by its path.
        real = _real_port(str(target.get("port")))
        for port in serial_ports():
            if _real_port(port.name) == real and port.usb is not None and port.serial:
                usb = f"usb {port.usb[0]:04x}:{port.usb[1]:04x} {port.serial}"
                return (Identity(usb, numbers),)
        return Identity(f"port {real}", numbers), Identity(f"device {device.id}", numbers, False)
    if kind in ("udp", "websocket") and kind == kind_of(device):
        assert device.output is not None
        transport = device.output.transport
        if isinstance(device.output.encoder, device_config.VrcHapticsEncoder):
            return (Identity(f"vrc-haptics {label}", numbers),)
        host = computer(str(target.get("host", getattr(transport, "host", ""))))
        port_number = target.get("port", getattr(transport, "port", ""))
        how = device.output.encoder
        if isinstance(how, device_config.BhapticsEncoder) and isinstance(port_number, int):
            port_number -= how.sdk - 1  # both ports are of one Player
        name = f"{kind} {host}:{port_number} {label}".rstrip()
        return (Identity(name, _network_slots(device, how)),)
    if kind == "audio":
        first = target.get("first_channel", 1)
        vibrating = [a.type.modality == "vibration" for a in device.actuators]
        # Only vibration actuators have a channel, one after another.
        channels = np.cumsum(vibrating) - 1 + (first if isinstance(first, int) else 1)
        slots = (
            str(channel) if is_played else "none"
            for channel, is_played in zip(channels, vibrating, strict=True)
        )
        return (Identity("audio", tuple(slots)),)
    return (Identity(f"device {device.id}", numbers, False),)


def _network_slots(
    device: device_config.DeviceConfig, how: device_config.Encoder
) -> tuple[str, ...]:
    """Name of the physical channel of each actuator: Buttplug feature, bHaptics position and motor,
    or OSC address of the strength, in which "*" replaces the id of the device's configuration;
    "none" without a channel."""
    if isinstance(how, device_config.ButtplugEncoder):
        return tuple(str(feature) for feature, _ in how.outputs)
    if isinstance(how, device_config.BhapticsEncoder):
        dots = how.worn_dots(is_mirrored=device.is_mirrored)
        return tuple(f"{position} {index}" for position, index in dots)
    assert isinstance(how, device_config.OscEncoder)
    # Two configurations with one address drive the same channel, also under different ids.
    anonymous = replace(device, id="*")
    names = Channels(device).names
    by_name = dict(zip(names, osc_addresses(anonymous, how), strict=True))
    return tuple(
        by_name.get((actuator.id, actuator.type.strength.name), "none")
        for actuator in device.actuators
    )


def _real_port(name: str) -> str:
    """Path of a serial port with links resolved, ``/dev/tty.*`` of macOS as ``/dev/cu.*``; the name
    in capitals on Windows."""
    if os.name != "posix":
        return name.upper()
    return re.sub(r"^/dev/tty\.", "/dev/cu.", os.path.realpath(name))


@dataclass(eq=False)
class _StoredBudget:
    """Budget of an identity, with the file and the last written state."""

    budget: DutyBudget
    path: Path
    written: tuple[Any, ...] = ()
    users: int = 0
    lock: int | None = None  # descriptor of the locked file


class DutyBudgetStore:
    """Duty budgets of all devices of this process, and their files in ``folder``, which is created
    when needed. ``clock``: clock of the device threads."""

    def __init__(self, folder: Path, clock: Clock = SYSTEM) -> None:
        self._folder, self._clock = folder, clock
        self._stored: dict[str, _StoredBudget] = {}
        self._lock = threading.Lock()
        self._has_warned = False
        self._changed = threading.Event()

    def budget(self, identity: str) -> DutyBudget:
        """Budget by the name of an :class:`Identity`; the first call reads the file."""
        with self._lock:
            return self._entry(identity).budget

    def _entry(self, identity: str) -> _StoredBudget:
        entry = self._stored.get(identity)
        if entry is None:
            name = hashlib.sha256(identity.encode()).hexdigest()[:32] + ".json"
            path = self._folder / name
            entry = self._stored[identity] = _StoredBudget(_read(path, self._clock.now()), path)
            entry.budget.on_begin = self._changed.set
        return entry

    @contextmanager
    def claimed(self, identities: Sequence[Identity]) -> Iterator[list[BudgetUse]]:
        """Context manager with a use of each identity's budget, in order; saves and unlocks the
        budgets at its end.

        Budgets of hardware are locked against other processes, if the folder is writable and has
        locks. Several devices of this process may share a budget.

        Raises OutputLostError: another process has locked a budget of hardware.
        """
        claimed: list[str] = []
        uses = []
        try:
            for identity in identities:
                with self._lock:
                    # One entry for all devices of this process that drive the same hardware.
                    entry = self._stored.get(identity.name)
                    lock = None
                    # The lock comes first: another process may write the file until then.
                    if identity.is_hardware and (entry is None or entry.lock is None):
                        lock = _locked(self._folder, identity.name)
                    entry = self._entry(identity.name)
                    entry.lock = entry.lock if lock is None else lock
                    entry.users += 1
                claimed.append(identity.name)
                uses.append(BudgetUse(entry.budget, identity.slots))
            yield uses
        finally:
            with self._lock:
                for name in claimed:
                    self._release(name)

    def _release(self, name: str) -> None:
        """End a use of the budget ``name``: save changes, and after the last use unlock its file
        and forget a saved budget."""
        entry = self._stored[name]
        self._save(name, entry)
        entry.users -= 1
        # Without a lock, as of simulators and logs, the budget stays in memory.
        if entry.users or entry.lock is None:
            return
        os.close(entry.lock)
        entry.lock = None
        # Another process may change the file from now on: the next use reads the file again. An
        # unsaved budget stays in memory.
        if entry.written == _state(entry.budget):
            del self._stored[name]

    def save(self) -> None:
        """Save changed budgets; a failure is logged once and never raised, and the next call tries
        again."""
        with self._lock:
            for identity, entry in self._stored.items():
                self._save(identity, entry)

    def _save(self, identity: str, entry: _StoredBudget) -> None:
        """Write a changed budget to its file; a failure keeps it as changed for the next call."""
        state = _state(entry.budget)
        if state == entry.written:
            return
        names, load, is_cooling, is_idle, idle_since_s, unknown_s = state
        now_s = self._clock.now()
        # The monotonic clock starts at 0 with the computer: rests are stored as durations, and
        # both clocks of the writing limit the rest that the next process counts.
        content = {
            "device": identity,
            "slots": names,
            "filled": load,
            "is_resting": is_cooling,
            "is_open": not all(is_idle),
            "idle_s": [
                max(now_s - since_s, 0.0) if idle and math.isfinite(since_s) else 0.0
                for idle, since_s in zip(is_idle, idle_since_s, strict=True)
            ],
            "unknown_s": unknown_s,
            "wall_s": time.time(),
            "monotonic_s": now_s,
        }
        try:
            entry.path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_file(entry.path) as file:
                file.write(json.dumps(content).encode())
        except (HfxError, OSError) as error:
            if not self._has_warned:
                self._has_warned = True
                _log.warning("time on is not remembered: %s", error)
        else:
            entry.written = state

    def save_regularly(self) -> None:
        """Save changes every :data:`KEEP_S` and at the start of a device; never returns.

        To be the target of a daemon thread.
        """
        while True:
            self._changed.wait(KEEP_S)
            self._changed.clear()
            self.save()


def _locked(folder: Path, identity: str) -> int | None:
    """Lock ``<hash of identity>.lock`` until the returned descriptor is closed; creates folder and
    file. None if the folder is not writable or the file system has no locks. Raises
    OutputLostError: another process holds the lock."""
    path = folder / (hashlib.sha256(identity.encode()).hexdigest()[:32] + ".lock")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600)
    except OSError:
        return None  # saving fails, too, and logs a warning
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


def _state(budget: DutyBudget) -> tuple[Any, ...]:
    """Copy of a budget as tuples, for comparison and saving: slot names, and for each slot load, is
    cooling, is idle (no user), time of the last silence, seconds of unknown use."""
    with budget.lock:
        return (
            tuple(budget.slots),
            tuple(budget.load.tolist()),
            tuple(budget.is_cooling.tolist()),
            tuple((~budget.is_used_before(None)).tolist()),
            tuple(budget.idle_since_s.tolist()),
            tuple(budget.unknown_s.tolist()),
        )


def _read(path: Path, now_s: float) -> DutyBudget:
    """Read a budget; rested without a file, all slots exhausted and cooling with a damaged file.
    Rest since the writing is counted; two seconds of unknown use for a file of a killed process."""
    try:
        with open(path, "rb") as file:
            content = json.loads(file.read(_MOST_BYTES))
        load = [_number(value) for value in content["filled"]]
        is_cooling = [value is not False for value in content["is_resting"]]
        wall_s, monotonic_s = _number(content["wall_s"]), _number(content["monotonic_s"])
        is_open = content["is_open"] is not False
        # Files of earlier versions: actuators by their numbers, all idle since the file's time.
        names = [str(name) for name in content.get("slots", range(len(load)))]
        idle_s = [_number(value) for value in content.get("idle_s", [0.0] * len(load))]
        unknown_s = [_number(value) for value in content.get("unknown_s", [0.0] * len(load))]
        if len({len(column) for column in (load, is_cooling, set(names), idle_s, unknown_s)}) > 1:
            raise ValueError("lists of unequal length")
    except FileNotFoundError:
        return DutyBudget(idle_since_s=now_s)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s); its device rests first.", path, error)
        return DutyBudget(others=1.0, idle_since_s=now_s)
    # A restart of the computer sets the monotonic clock to 0: the rest has then lasted at least
    # for the time on the clock.
    elapsed_s = now_s - monotonic_s if now_s >= monotonic_s else now_s
    rest_s = max(min(elapsed_s, time.time() - wall_s), 0.0)
    return DutyBudget(
        load,
        is_cooling,
        names=names,
        idle_s=idle_s,
        # An open file: the process was killed, and the device may have been on.
        unknown_s=[value + (_UNKNOWN_S if is_open else 0.0) for value in unknown_s],
        idle_since_s=now_s - rest_s,
    )


def _number(value: object) -> float:
    """Convert a finite int or float of at least 0 to float; ValueError for bool and all else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("not a number")
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError("not a number of 0 or more")
    return float(value)
