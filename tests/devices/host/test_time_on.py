# SPDX-License-Identifier: GPL-3.0-or-later
"""Time on: no order of values, stops, stalls and connections exceeds the duty limit."""

from __future__ import annotations

import json
import math
import re
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_time import FakeClock
from hypothesis import given, settings
from hypothesis import strategies as st
from live_process import is_loud, rows_of, wait

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host import duty_budget_store
from hfx_blender.devices.host.duty_budget_store import DutyBudgetStore, Identity, identities
from hfx_blender.devices.host.guard import Guard
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.host.time_on import BudgetUse, DutyBudget
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.live.discovery import FoundPort
from hfx_blender.engine.rendering.device_config import (
    ButtplugEncoder,
    DeviceConfig,
    OutputConfig,
    WebsocketTransport,
)
from hfx_blender.files import resources

BAND = load_device("forearm_band_left")
STEP_S = 0.01


def limited(maximum_on_s: float, rest_s: float, slew_per_s: float = math.inf) -> DeviceConfig:
    changes = {"maximum_on_s": maximum_on_s, "rest_s": rest_s, "slew_per_s": slew_per_s}
    kinds = {name: replace(kind, **changes) for name, kind in BAND.actuator_types.items()}
    actuators = tuple(replace(a, type=kinds[a.type.name]) for a in BAND.actuators)
    return replace(BAND, actuator_types=kinds, actuators=actuators)


class Tally:
    """Time on of the first actuator behind a guard; values hold until the next step."""

    def __init__(self, device: DeviceConfig, accounts: tuple[DutyBudget, ...] = ()) -> None:
        self.device, self.accounts = device, accounts
        self.names = [str(number) for number in range(len(device.actuators))]
        self.on_s = self.off_s = self.longest_s = self._now_s = 0.0
        self._is_on = False
        self.guard = self.connected()

    def connected(self) -> Guard:
        guard = Guard(self.device)
        if self.accounts:
            guard.share([BudgetUse(account, self.names) for account in self.accounts])
        return guard

    def pass_time(self, seconds: float) -> None:
        if self._is_on:
            self.on_s += seconds
            self._now_s += seconds
            self.longest_s = max(self.longest_s, self._now_s)
        else:
            self.off_s += seconds
            self._now_s = 0.0

    def step(self, amplitude: float, step_s: float = STEP_S) -> bool:
        self.pass_time(step_s)
        values = self.guard.neutral.copy()
        values[::2] = amplitude
        self._is_on = bool(self.guard.limited(values, step_s)[0])
        return self._is_on

    def stop(self, played_s: float, now_s: float) -> None:
        """The bytes of a stop arrive after a delay."""
        self.pass_time(played_s)
        self._is_on = False
        self.guard.time_on.end(played_s, now_s)


def share_of(tally: Tally) -> float:
    return tally.on_s / (tally.on_s + tally.off_s)


def test_full_on_lasts_as_configured_and_the_rest_as_well():
    tally = Tally(limited(2.0, 1.0))
    on = [tally.step(15.0) for _ in range(600)]
    assert on[:200] == [True] * 200 and not any(on[200:300])
    assert on[301:501] == [True] * 200


@pytest.mark.parametrize("every", [2, 3, 50, 199])
def test_short_silences_empty_the_account_by_their_share_only(every):
    tally = Tally(limited(2.0, 1.0))
    for k in range(6000):
        tally.step(0.0 if k % every == 0 else 15.0)
    assert tally.longest_s <= 2.0 + 1e-9
    assert share_of(tally) <= 2.0 / 3.0 + 0.02


def test_sufficient_rest_in_the_values_is_never_extended():
    tally = Tally(limited(2.0, 1.0))
    for k in range(3000):
        expected = 15.0 if k % 200 < 100 else 0.0
        assert tally.step(expected) == bool(expected)


def test_weak_counts_as_strong_does():
    tally = Tally(limited(2.0, 1.0))
    on = [tally.step(1e-6) for _ in range(201)]
    assert on == [True] * 200 + [False]


def test_a_reset_forgets_nothing():
    tally = Tally(limited(2.0, 1.0))
    for k in range(3000):
        if k % 150 == 149:
            tally.guard.reset()
        tally.step(15.0)
    assert tally.longest_s <= 2.0 + 1e-9
    assert share_of(tally) <= 2.0 / 3.0 + 0.02


def test_a_stall_allows_no_more_than_a_short_step_does():
    at = {}
    for stall_s in (0.05, 3.0, 1e9):
        guard = Guard(limited(math.inf, 1.0, slew_per_s=10.0))
        expected = np.tile([15.0, 100.0], 8)
        guard.limited(expected, 0.02)
        at[stall_s] = guard.limited(expected, stall_s)[0]
    assert at[0.05] == at[3.0] == at[1e9] == pytest.approx(0.2 + 0.5)


@pytest.mark.parametrize("step_s", [0.0, -1.0, math.nan, math.inf])
def test_a_stopped_clock_is_no_rest_and_ends_time_on(step_s):
    tally = Tally(limited(2.0, 1.0))
    for _ in range(150):
        tally.step(15.0)
    expected = np.tile([15.0, 100.0], 8)
    while tally.guard.limited(expected, step_s)[0]:
        pass
    for _ in range(1000):
        tally.guard.limited(tally.guard.neutral, step_s)  # no rest
    assert tally.step(15.0) is False


def test_a_stall_while_on_counts_as_on():
    tally = Tally(limited(2.0, 1.0))
    tally.step(15.0)
    tally.step(15.0, 5.0)
    off = 0
    while not tally.step(15.0):
        off += 1
    assert off * STEP_S >= 2.5 - STEP_S  # 5 s on, emptied at 2 s a second


ACTIONS = st.lists(
    st.tuples(
        st.sampled_from(["step", "step", "step", "stop", "reset", "connect", "wait"]),
        st.sampled_from([15.0, 15.0, 0.001, 0.0, math.nan]),
        st.floats(0.001, 0.05),
        st.integers(1, 80),
    ),
    max_size=40,
)


@settings(max_examples=80, deadline=None)
@given(ACTIONS, st.floats(0.1, 2.0), st.floats(0.05, 2.0))
def test_no_order_of_things_is_on_for_more_than_its_share(actions, maximum_on_s, rest_s):
    account = DutyBudget()
    tally = Tally(limited(maximum_on_s, rest_s), (account,))
    now_s = 1000.0
    tally.guard.time_on.record_rest(now_s)
    tally.guard.reset()
    longest_step_s = 0.0
    for action, amplitude, step_s, times in actions:
        if action == "step":
            longest_step_s = max(longest_step_s, step_s)
            for _ in range(times):
                now_s += step_s
                tally.step(amplitude, step_s)
        elif action == "reset":
            tally.guard.reset()
        else:
            now_s += step_s
            longest_step_s = max(longest_step_s, step_s)
            tally.stop(step_s, now_s)
            if action == "connect":
                tally.guard = tally.connected()
            if action == "wait":
                now_s += step_s * times
                tally.pass_time(step_s * times)
            tally.guard.time_on.record_rest(now_s)
            tally.guard.reset()
    # Values hold until the next: the last step of each stretch may be longer than foreseen.
    assert tally.longest_s <= maximum_on_s + longest_step_s + 1e-6
    most_s = maximum_on_s * (1.0 + tally.off_s / rest_s)
    assert tally.on_s <= most_s + longest_step_s + 1e-6


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 60)), max_size=30))
def test_two_connections_of_one_device_share_one_account(pieces):
    account = DutyBudget()
    one, alternative = (Tally(limited(1.0, 0.5), (account,)) for _ in range(2))
    for tally in (one, alternative):
        tally.guard.time_on.record_rest(1000.0)
        tally.guard.reset()
    on_s = off_s = 0.0
    for first, second, times in pieces:
        for _ in range(times):
            is_on = [one.step(15.0 * first), alternative.step(15.0 * second)]
            on_s += STEP_S * any(is_on)
            off_s += STEP_S * (not any(is_on))
    assert on_s <= 1.0 * (1.0 + off_s / 0.5) + 3.0 * STEP_S


# Kept beyond the process.


def used(folder: Path, seconds: float, clock: FakeClock) -> DutyBudgetStore:
    """Return the budgets of a device after a given time on and a stop."""
    store, now_s = DutyBudgetStore(folder, clock), clock.now()
    tally = Tally(limited(2.0, 1.0), (store.budget("it"),))
    tally.guard.time_on.record_rest(now_s)
    tally.guard.reset()
    for _ in range(round(seconds / STEP_S)):
        tally.step(15.0)
    tally.guard.time_on.end(0.0, now_s)
    return store


def left_s(folder: Path, clock: FakeClock) -> float:
    """Return the time on left to the device in a new process."""
    tally = Tally(limited(2.0, 1.0), (DutyBudgetStore(folder, clock).budget("it"),))
    tally.guard.time_on.record_rest(clock.now())
    tally.guard.reset()
    steps = 0
    while steps < 1000 and tally.step(15.0):
        steps += 1
    return steps * STEP_S


@pytest.fixture
def clock() -> FakeClock:
    """Replace the clock of output processes by a fake clock."""
    return FakeClock()


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    """Replace the system's wall clock by a fake clock at 1e9 s."""
    fake_clock = FakeClock()
    fake_clock.now_s = 1e9
    monkeypatch.setattr(duty_budget_store, "time", type("Time", (), {"time": fake_clock.now}))
    return fake_clock


def test_an_account_outlives_its_process(tmp_path, clock, wall):
    used(tmp_path, 1.5, clock).save()
    assert left_s(tmp_path, clock) == pytest.approx(0.5)


def test_time_without_a_process_is_rest(tmp_path, clock, wall):
    used(tmp_path, 1.5, clock).save()
    wall.now_s += 0.25
    clock.now_s += 0.25
    assert left_s(tmp_path, clock) == pytest.approx(1.0, abs=STEP_S)


@pytest.mark.parametrize(
    ("wall_s", "monotonic_s"), [(1e6, 0.0), (-1e6, 10.0), (0.0, 10.0), (1e6, -1000.0)]
)
def test_a_clock_that_was_set_is_no_rest(tmp_path, clock, wall, wall_s, monotonic_s):
    used(tmp_path, 1.5, clock).save()
    wall.now_s += wall_s
    clock.now_s += monotonic_s
    assert left_s(tmp_path, clock) == pytest.approx(0.5)


def test_a_killed_process_counts_as_on(tmp_path, clock, wall):
    budget_store = DutyBudgetStore(tmp_path, clock)
    tally = Tally(limited(2.0, 1.0), (budget_store.budget("it"),))
    tally.guard.time_on.record_rest(1000.0)
    tally.guard.reset()
    tally.step(15.0)
    budget_store.save()  # and no more
    assert left_s(tmp_path, clock) == 0.0


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "1", '{"filled": "x"}', '{"filled": [NaN]}', "[" * 100_000]
)
def test_a_damaged_account_rests_first(tmp_path, clock, wall, content):
    used(tmp_path, 0.1, clock).save()
    (path,) = tmp_path.iterdir()
    path.write_text(content)
    assert left_s(tmp_path, clock) == 0.0


def test_a_failure_to_save_stops_nothing(tmp_path, clock, caplog):
    (tmp_path / "file").write_text("")
    store = used(tmp_path / "file" / "folder", 1.5, clock)
    store.save()
    store.save()
    assert len(caplog.records) <= 2  # one warning for reading, one for writing


# Identity of a device.


def names_of(identities_found: Sequence[Identity]) -> list[str]:
    return [entry.name for entry in identities_found]


USB = FoundPort("/dev/ttyACM0", "", (0x2341, 0x43), "75")


def test_a_serial_number_identifies_the_device_at_any_port(monkeypatch):
    for values in (USB, replace(USB, name="/dev/ttyACM7")):
        monkeypatch.setattr(duty_budget_store, "serial_ports", lambda values=values: [values])
        actual = identities(BAND, {"kind": "serial", "port": values.name})
        assert names_of(actual) == ["usb 2341:0043 75"]


def test_a_port_without_a_serial_number_counts_by_path_and_by_configuration(monkeypatch):
    monkeypatch.setattr(duty_budget_store, "serial_ports", list)
    actual = identities(BAND, {"kind": "serial", "port": "/dev/ttyACM0"})
    assert names_of(actual) == ["port /dev/ttyACM0", "device forearm_band_left"]


def test_a_simulator_is_identified_by_configuration():
    targets: list[dict[str, Any]] = [{"kind": "simulator"}, {"kind": "simulator", "path": "a"}]
    assert len({identities(BAND, target) for target in targets}) == 1
    assert identities(BAND, {}) != identities(load_device("forearm_band_right"), {})


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "::1", "LOCALHOST"])
def test_local_addresses_are_one_identity_under_any_name(host):
    device = load_device("bhaptics_tactosy_left")
    actual = identities(device, {"kind": "websocket", "host": host})
    assert actual == identities(device, {"kind": "websocket"})


def osc(
    folder: Path, name: str, address: str = "/{actuator}/{control}", reverse: bool = False
) -> DeviceConfig:
    """Return the band behind OSC, limited to 1 s on and an hour of rest."""
    content = json.loads((resources.device_configs() / "forearm_band.json").read_text())
    for kind in content["actuator_types"].values():
        kind["maximum_on_s"], kind["rest_s"] = 1.0, 3600.0
    content["id"] = name
    content["output"] = {
        "encoder": {"kind": "osc", "address": address},
        "transport": {"kind": "udp", "host": "127.0.0.1", "port": 9000},
    }
    if reverse:
        content["actuators"].reverse()
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.json").write_text(json.dumps(content))
    return load_device(f"{name}_left", folder)


SPELLINGS: list[dict[str, Any]] = [
    {},
    {"host": "localhost"},
    {"host": "LocalHost."},
    {"host": "127.0.0.1", "port": 9000},
    {"host": "127.8.0.9"},
    {"host": "::1"},
    {"host": "0:0:0:0:0:0:0:1"},
    {"host": "::ffff:127.0.0.1"},
]


@pytest.mark.parametrize("target", SPELLINGS)
@pytest.mark.parametrize("address", ["/{actuator}/{control}", "/{device}/{actuator}/{control}"])
def test_a_copy_under_another_id_drives_the_same_hardware(tmp_path, target, address):
    one, two = (osc(tmp_path / "devices", name, address) for name in ("one", "two"))
    first = identities(one, {"kind": "udp"})
    assert identities(two, {"kind": "udp", **target}) == first
    assert identities(two, {"kind": "udp", "port": 9001}) != first
    assert identities(two, {"kind": "udp", "host": "192.168.250.250"}) != first


def test_actuators_are_identified_by_address_in_any_order(tmp_path):
    one, two = osc(tmp_path / "d", "one"), osc(tmp_path / "d", "two", reverse=True)
    (first,), (alternative,) = (identities(item, {"kind": "udp"}) for item in (one, two))
    assert first.name == alternative.name and first.slots == alternative.slots[::-1]
    assert len(set(first.slots)) == len(one.actuators)


def test_another_place_behind_the_same_port_is_other_hardware(tmp_path):
    one = osc(tmp_path / "d", "one")
    two = osc(tmp_path / "d", "two", "/second/{actuator}/{control}")
    (first,), (alternative,) = (identities(item, {"kind": "udp"}) for item in (one, two))
    assert first.name == alternative.name and not set(first.slots) & set(alternative.slots)


def test_motors_of_the_haptic_player_are_hardware_whichever_device_has_them():
    vest = load_device("bhaptics_tactsuit_x40")
    dots = vest.output.encoder.dots
    half = replace(
        vest,
        id="front",
        actuators=vest.actuators[:20],
        outputs=(replace(vest.output, encoder=replace(vest.output.encoder, dots=dots[:20])),),
    )
    (whole,), (part,) = (identities(item, {"kind": "websocket"}) for item in (vest, half))
    assert whole.name == part.name and part.slots == whole.slots[:20]


def test_toys_of_equal_name_are_distinguished_by_the_server():
    how = ButtplugEncoder("", tuple((feature, "Vibrate") for feature in range(8)))
    toy = replace(BAND, outputs=(OutputConfig(how, WebsocketTransport("127.0.0.1", 12345)),))
    one, two = (identities(toy, {"kind": "websocket"}, index)[0] for index in "07")
    copy = identities(replace(toy, id="copy"), {"kind": "websocket", "host": "::1"}, "0")
    assert one.name != two.name and copy == (one,)


def test_a_link_to_a_port_is_the_port(tmp_path, monkeypatch):
    monkeypatch.setattr(duty_budget_store, "serial_ports", list)
    (tmp_path / "by-id").symlink_to("/dev/null")
    for name in (tmp_path / "by-id", "/dev/null"):
        actual = identities(BAND, {"kind": "serial", "port": str(name)})
        assert actual[0].name == "port /dev/null"
    names = [
        identities(BAND, {"kind": "serial", "port": f"/dev/{item}.usbmodem1"})[0].name
        for item in ("tty", "cu")  # macOS has two names per port
    ]
    assert len(set(names)) == 1


def test_channels_of_sound_cards_are_hardware():
    targets: list[dict[str, Any]] = [
        {"kind": "audio"},
        {"kind": "audio", "interface": "3", "first_channel": 2},
    ]
    (first,), (shifted,) = (identities(BAND, target) for target in targets)
    assert first.name == shifted.name and first.slots[1:] == shifted.slots[:-1]


def test_a_device_that_another_process_drives_is_refused(tmp_path, clock):
    actual = [Identity("udp this computer:9000", ("a",)), Identity("device x", ("0",), False)]
    first, second = DutyBudgetStore(tmp_path, clock), DutyBudgetStore(tmp_path, clock)
    with first.claimed(actual):
        with pytest.raises(OutputLostError, match="another process"), second.claimed(actual):
            pass
        with first.claimed(actual):  # another device of the same process
            pass
        with pytest.raises(OutputLostError, match="another process"), second.claimed(actual):
            pass
    with second.claimed(actual):
        pass


def test_time_on_in_another_process_counts(tmp_path, clock, wall):
    """Limit of 2 s on, 1 s of rest: .8 s in this process and .7 s in another leave .5 s."""
    device, actual = limited(2.0, 1.0), [Identity("udp x", tuple("01234567"))]
    processes = [DutyBudgetStore(tmp_path, clock) for _ in range(2)]
    on_s = []
    for process, steps in ((processes[0], 80), (processes[1], 70), (processes[0], 1000)):
        with process.claimed(actual) as uses:
            guard = Guard(device)
            guard.share(uses)
            guard.time_on.record_rest(clock.now())
            guard.reset()
            expected = np.tile([15.0, 100.0], 8)
            done = [bool(guard.limited(expected, STEP_S)[0]) for _ in range(steps)]
            on_s.append(STEP_S * (done.index(False) if False in done else steps))
            guard.time_on.end(0.0, clock.now())
    assert on_s == pytest.approx([0.8, 0.7, 0.5])


def test_two_devices_behind_one_port_keep_their_own_time(tmp_path, clock, wall):
    """Each device is on for 2 s and rests during the other device's turn."""
    store, device = DutyBudgetStore(tmp_path, clock), limited(2.0, 1.0)
    names = [tuple(f"{side}{number}" for number in range(8)) for side in "ab"]
    expected = np.tile([15.0, 100.0], 8)
    with (
        store.claimed([Identity("udp x", names[0])]) as a,
        store.claimed([Identity("udp x", names[1])]) as b,
    ):
        one, alternative = Guard(device), Guard(device)
        for guard, uses in ((one, a), (alternative, b)):
            guard.share(uses)
            guard.time_on.record_rest(clock.now())
            guard.reset()
        first = [bool(one.limited(expected, STEP_S)[0]) for _ in range(201)]
        second = []
        for _ in range(200):
            one.limited(one.neutral, STEP_S)
            second.append(bool(alternative.limited(expected, STEP_S)[0]))
        third = []
        for _ in range(200):
            third.append(bool(one.limited(expected, STEP_S)[0]))
            alternative.limited(alternative.neutral, STEP_S)
    assert first == [True] * 200 + [False]
    assert all(second) and all(third)


# Through the whole output process.


def test_no_copy_walks_round_the_time_limit_over_the_network(tmp_path, monkeypatch):
    """Two configurations alternate at one address: 1 s on in total, as the rest takes an hour."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data" / "hfx"))
    for name in ("one", "two"):
        osc(tmp_path / "devices", name, reverse=name == "two")
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.setblocking(False)
    loud: list[tuple[float, bool]] = []

    def receive() -> None:
        with suppress(BlockingIOError):
            while True:
                content, now_s = receiver.recv(65536), time.monotonic()
                # Find the value after each amplitude's address and ",f", each padded to a multiple
                # of four bytes.
                places = [m.end() for m in re.finditer(rb"amplitude_m_s2\0+,f\0\0", content)]
                loud.append((now_s, any(content[at : at + 4] != bytes(4) for at in places)))

    client = LiveClient()
    try:
        for turn in range(3):
            target = {"kind": "udp", "port": receiver.getsockname()[1]}
            target["host"] = ("127.0.0.1", "localhost", "127.0.0.1")[turn]
            name = ("one", "two", "one")[turn]
            client.connect("it", f"{name}_left", target, folder=tmp_path / "devices")
            wait(client, lambda: client.devices["it"].is_armed)
            until = time.monotonic() + 0.6

            def play() -> None:
                client.send("it", np.tile([10.0, 100.0], 8))
                receive()

            wait(client, lambda until=until: time.monotonic() > until, play)
    finally:
        client.close()
        receive()
        receiver.close()
    on_s = sum(min(b[0] - a[0], 0.1) for a, b in pairwise(loud) if a[1])
    assert 0.2 < on_s < 1.15  # with a margin for a busy machine


@pytest.mark.parametrize("between", ["stop", "connect", "process"])
def test_no_way_round_the_time_limit_of_a_live_device(tmp_path, monkeypatch, between):
    """The time on is 1 s in total, as the rest takes an hour."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data" / "hfx"))
    folder = tmp_path / "devices"
    folder.mkdir()
    content = json.loads((resources.device_configs() / "forearm_band.json").read_text())
    for kind in content["actuator_types"].values():
        kind["maximum_on_s"], kind["rest_s"] = 1.0, 3600.0
    (folder / "mine.json").write_text(json.dumps({**content, "id": "mine"}))
    logs = [tmp_path / f"{k}.jsonl" for k in range(3)]
    expected = np.tile([10.0, 100.0], 8)

    def connect(log: Path) -> None:
        client.connect("it", "mine_left", {"kind": "simulator", "path": str(log)}, folder=folder)

    client = LiveClient()
    try:
        loud_s = 0.0
        for log in logs:
            if log is logs[0] or between != "stop":
                connect(log)
            wait(client, lambda client=client: client.devices["it"].is_armed)
            until = time.monotonic() + 0.6
            wait(
                client,
                lambda until=until: time.monotonic() > until,
                lambda client=client: client.send("it", expected),
            )
            if between == "stop":
                client.stop_all()
                client.arm()
                continue
            client.disconnect("it")
            if between == "process":
                client.close()
                client = LiveClient()
        client.close()
        loud_s = sum(seconds_on(log) for log in logs)
    finally:
        client.close()
    assert 0.2 < loud_s < 1.1  # with a margin for a busy machine


def seconds_on(log: Path) -> float:
    """Return the sum of the intervals after perceptible rows, each at most 0.1 s."""
    rows = rows_of(log)
    return sum(
        min(after["time_s"] - row["time_s"], 0.1) for row, after in pairwise(rows) if is_loud(row)
    )
