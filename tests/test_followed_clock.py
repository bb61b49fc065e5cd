# SPDX-License-Identifier: GPL-3.0-or-later
"""The clock of another program is followed: expected times are the senders' own formulas."""

import random

import numpy as np
import pytest

from hfx_tools.commands.followed_clock import ClockFollower, MidiTimeCode


def differences(sender, hertz, jitter_s, seconds=30.0, step_s=0.01, change=None):
    """Differences of the followed time from ``sender(t)`` at each 10 ms after 3 s."""
    follower, chance, arrivals = ClockFollower(), random.Random(7), []
    for k in range(int(seconds * hertz)):
        sent_s = k / hertz
        arrivals.append((sent_s + chance.uniform(0.0, jitter_s), sender(sent_s)))
    arrivals.sort()
    found, k = [], 0
    for now_s in np.arange(0.0, seconds - 0.1, step_s):
        while k < len(arrivals) and arrivals[k][0] <= now_s:
            follower.hear_time(arrivals[k][1], arrivals[k][0])
            k += 1
        position_s = follower.position_s(now_s)
        if now_s > 3.0:
            found.append(np.nan if position_s is None else position_s - sender(now_s))
    return np.array(found)


@pytest.mark.parametrize("drift", [-500e-6, 0.0, 500e-6])
@pytest.mark.parametrize("hertz", [25.0, 60.0])
def test_drift_stays_below_10_ms_with_jitter_and_different_clocks(drift, hertz):
    found = differences(lambda t: 12.0 + (1.0 + drift) * t, hertz, 0.02)
    assert np.abs(found).max() < 0.010


def test_steps_of_25_frames_a_second_are_followed_by_their_edges():
    follower, found = ClockFollower(), []
    for k in range(60 * 20):  # 60 messages a second of a time with 25 steps a second
        now_s = k / 60.0
        follower.hear_time(np.floor(now_s * 25.0 + 1e-9) / 25.0, now_s)
        if now_s > 3.0:
            found.append(follower.position_s(now_s) - now_s)
    # An edge is seen at most one message after its time, 16.7 ms.
    assert -0.010 < np.mean(found) <= 0.0 and np.abs(found).max() < 1.0 / 60.0


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_speed_without_rate_messages_is_learnt(speed):
    found = differences(lambda t: speed * t, 25.0, 0.01)
    assert np.abs(found).max() < 0.010 * max(speed, 1.0)


def test_a_jump_is_silence_of_50_ms_and_then_the_new_time():
    follower = ClockFollower()
    for k in range(50):
        follower.hear_time(k * 0.04, k * 0.04)
    follower.hear_time(100.0, 2.0)
    assert follower.position_s(2.04) is None
    assert follower.position_s(2.06) == pytest.approx(100.06)


def test_a_stopped_or_lost_sender_is_silence_within_two_seconds():
    follower = ClockFollower()
    for k in range(50):
        follower.hear_time(k * 0.04, k * 0.04)
    assert follower.position_s(2.2) is not None  # some messages may be lost
    assert follower.position_s(2.6) is None
    for k in range(50):  # it repeats its time, as a paused player
        follower.hear_time(1.96, 3.0 + k * 0.04)
    assert follower.position_s(4.97) is None


def test_a_rate_of_zero_is_silence_at_once_and_goes_on_from_there():
    follower = ClockFollower()
    follower.hear_time(5.0, 0.0)
    follower.hear_rate(0.0, 1.0)
    assert follower.position_s(1.0) is None
    follower.hear_rate(2.0, 2.0)
    follower.hear_time(6.1, 2.04)  # 6.0 at the stop, and 0.04 s at double speed are 6.08
    assert follower.position_s(2.14) == pytest.approx(6.28, abs=0.02)


def test_midi_time_code_of_quarter_frames_and_full_frames():
    code = MidiTimeCode()
    # 01:02:03:04 at 25 frames: hours with the rate 1 in bits 5 and 6 are 0x21.
    pieces = [4, 0, 3, 0, 2, 0, 1, 2]
    times = [code.seconds(bytes((0xF1, k << 4 | piece))) for k, piece in enumerate(pieces)]
    assert times[:7] == [None] * 7
    assert times[7] == pytest.approx(3723.0 + (4 + 1.75) / 25.0)
    full = bytes.fromhex("f07f7f0101 21020304 f7".replace(" ", ""))
    assert code.seconds(full) == pytest.approx(3723.16)
    # Drop-frame: 00:01:00:02 follows 00:00:59:29, which is frame 1799.
    drop = bytes((0xF0, 0x7F, 0x7F, 1, 1, 0x40, 1, 0, 2, 0xF7))
    assert code.seconds(drop) == pytest.approx(1800 * 1001 / 30000)
    assert code.seconds(bytes((0xF1, 0x70))) is None  # out of order
    assert code.seconds(b"\x90\x40\x40") is None
