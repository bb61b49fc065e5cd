# SPDX-License-Identifier: GPL-3.0-or-later
"""The firmware's C core on this computer, with simulated time: playback and refusals."""

import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.transports import wire_board as wire
from hfx_blender.devices.transports.wire_board import FrameKind, Reason
from hfx_tools.bench.safety.firmware_core import Board, built, compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

SILENT = [0] * 6
LOUD = [100, 200, 300, 400, 500, 65535]


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return built(tmp_path_factory.mktemp("core"))


@pytest.fixture
def board(library):
    return Board(library)


def configured(board, session=1, maximum_on_ms=0, channels=6, rest_ms=0):
    payload = wire.encode_configuration(session, channels, maximum_on_ms, rest_ms)
    board.take(wire.encode_frame(FrameKind.CONFIGURE, 0, payload))
    return zlib.crc32(payload)


def play(board, crc, levels=LOUD, sequence=1, live_ms=250):
    board.take(
        wire.encode_frame(FrameKind.VALUES, sequence, wire.encode_values(crc, levels, live_ms))
    )


def test_a_board_answers_its_configuration_and_plays(board):
    crc = configured(board)
    (answer,) = board.replies()
    assert answer.kind == FrameKind.READY and answer.payload == struct.pack("<IB", crc, 6)
    assert board.levels == SILENT
    play(board, crc)
    assert board.levels == LOUD and board.replies() == []


def test_values_without_or_for_another_configuration_are_refused(board):
    play(board, 0)
    assert board.levels == SILENT
    assert [reply.payload for reply in board.replies()] == [bytes([Reason.REFUSED])]
    crc = configured(board)
    play(board, crc)
    board.replies()
    play(board, crc ^ 1, sequence=2)
    assert board.levels == SILENT
    assert [reply.payload for reply in board.replies()] == [bytes([Reason.REFUSED])]


def test_the_dead_man_silences_after_250_ms_and_only_a_new_configuration_wakes(board):
    crc = configured(board)
    play(board, crc)
    board.wait(249)
    assert board.levels == LOUD
    board.replies()
    board.wait(1)
    assert board.levels == SILENT
    assert [reply.payload for reply in board.replies()] == [bytes([Reason.NO_VALUES])]
    play(board, crc, sequence=2)
    assert board.levels == SILENT
    crc = configured(board, session=2)
    assert board.levels == SILENT
    play(board, crc)
    assert board.levels == LOUD


def test_no_host_can_lengthen_the_dead_man(board):
    payload = struct.pack("<IBHI", 1, 6, 5000, 0)
    assert len(payload) == len(wire.encode_configuration(1, 6, 0))
    board.take(wire.encode_frame(FrameKind.CONFIGURE, 0, payload))
    play(board, zlib.crc32(payload), live_ms=65535)
    board.wait(249)
    assert board.levels == LOUD
    board.wait(1)
    assert board.levels == SILENT


def test_values_live_no_longer_than_they_say(board):
    crc = configured(board)
    play(board, crc, live_ms=40)
    board.wait(39)
    assert board.levels == LOUD
    board.wait(1)
    assert board.levels == SILENT
    play(board, crc, sequence=2, live_ms=65535)  # ended by the dead-man timer
    board.wait(250)
    assert board.levels == SILENT


def test_stop_is_always_taken_and_disarms(board):
    crc = configured(board)
    play(board, crc, sequence=500)
    board.replies()
    board.take(wire.encode_frame(FrameKind.STOP, 3))  # an old number does not matter
    assert board.levels == SILENT
    assert [reply.payload for reply in board.replies()] == [bytes([Reason.ASKED])]
    play(board, crc, sequence=501)
    assert board.levels == SILENT


def test_stop_passes_a_frame_that_was_cut_off(board):
    crc = configured(board)
    play(board, crc)
    half = wire.encode_frame(FrameKind.VALUES, 2, wire.encode_values(crc, LOUD))[:11]
    board.take(half + wire.encode_frame(FrameKind.STOP, 3))
    assert board.levels == SILENT


def test_a_frame_of_another_version_is_not_taken(board):
    crc = configured(board)
    content = struct.pack("<BBH", wire.VERSION + 1, FrameKind.VALUES, 1) + wire.encode_values(
        crc, LOUD
    )
    board.take(wire.encode_cobs(content + struct.pack("<I", zlib.crc32(content))) + b"\0")
    assert board.levels == SILENT


@pytest.mark.parametrize("count", [0, 1, 5, 7])
def test_values_for_more_or_fewer_channels_are_not_taken(board, count):
    crc = configured(board)
    play(board, crc)
    play(board, crc, [7] * count, sequence=2)
    assert board.levels == LOUD


def test_bytes_without_an_end_harm_nothing(board):
    """Memory beyond the buffer is protected, so an overrun crashes."""
    crc = configured(board)
    board.take(b"\x01" * 1000 + b"\0")
    play(board, crc)
    assert board.levels == LOUD


def test_older_and_repeated_values_are_dropped_also_where_numbers_wrap(board):
    crc = configured(board)
    play(board, crc, [1] * 6, sequence=65535)
    play(board, crc, [2] * 6, sequence=65534)
    play(board, crc, [2] * 6, sequence=65535)
    assert board.levels == [1] * 6
    play(board, crc, [3] * 6, sequence=0)
    assert board.levels == [3] * 6


ON = [9, 7, 0, 0, 0, 0]


class Player:
    """Player of frames on a board, every 10 ms."""

    def __init__(self, board, **limits):
        self.board, self.limits = board, limits
        self.on_ms = self.longest_ms = self._now_ms = self.all_ms = 0
        self.session = self.sequence = 0
        self.configure()

    def configure(self):
        self.session += 1
        self.crc = configured(self.board, session=self.session, **self.limits)

    def play(self, levels, ms):
        """Send frames of these levels for ``ms`` milliseconds; None sends no frames."""
        for _ in range(ms // 10):
            if levels is not None:
                self.sequence = (self.sequence + 1) & 0xFFFF
                play(self.board, self.crc, levels, self.sequence)
            for _ in range(10):
                is_on = self.board.levels[0] > 0
                self.board.wait(1)
                self.all_ms += 1
                self.on_ms += is_on
                self._now_ms = self._now_ms + 1 if is_on else 0
                self.longest_ms = max(self.longest_ms, self._now_ms)


def test_a_channel_is_on_for_so_long_and_then_rests_for_so_long(board):
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    player.play(ON, 3000)
    assert player.on_ms == 2000 and player.longest_ms == 1000
    player.play(ON, 10)
    assert board.levels[0] == 9


def test_others_play_on_while_one_rests(board):
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    player.play([9, 0, 0, 0, 0, 0], 500)
    player.play(ON, 500)
    assert board.levels[:2] == [0, 7]


@pytest.mark.parametrize("between", ["silence", "stop", "configure", "dead-man", "restart"])
def test_nothing_but_time_empties_the_account_of_time_on(board, between):
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    for _ in range(9):
        player.play(ON, 100)
        if between == "silence":
            player.play(SILENT, 10)
        elif between == "stop":
            board.take(wire.encode_frame(FrameKind.STOP, 0))
            assert board.levels == SILENT
            player.configure()
        elif between == "configure":
            player.configure()
        elif between == "restart":
            board.begin_again()
            player.configure()
    if between == "dead-man":
        player.play(None, 300)
        assert board.levels == SILENT
        player.configure()
    player.play(ON, 1500)
    assert player.longest_ms <= 1000
    assert player.on_ms <= 1000 + 2 * (player.all_ms - player.on_ms)


def test_a_stop_buys_no_time(board):
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    for _ in range(60):
        player.play(ON, 90)
        board.take(wire.encode_frame(FrameKind.STOP, 0))
        player.configure()
    assert player.longest_ms <= 1000
    assert player.on_ms <= 1000 + 2 * (player.all_ms - player.on_ms)


def test_after_a_loss_of_power_memory_is_not_believed(board):
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    player.play(ON, 1100)
    board.lose_power()
    board.begin_again()
    assert board.levels == SILENT
    player.configure()
    player.play(ON, 500)
    assert board.levels[:2] == [9, 7]


@pytest.mark.parametrize(
    ("maximum_on_ms", "rest_ms", "on_ms", "cycle_ms"),
    [
        (1000, 500, 1000, 1500),
        (1, 1, 1, 2),
        (120_000, 30_000, 30_000, 37_500),  # in the board's time, at the same share
        (1000, 0, 1000, 3000),  # none was named: the board's own
        (3000, 1, 3000, 3200),  # never a smaller share of rest than the board's own
        (500, 86_400_000, 500, None),
    ],
)
def test_time_on_and_rest_are_as_configured(board, maximum_on_ms, rest_ms, on_ms, cycle_ms):
    player = Player(board, maximum_on_ms=maximum_on_ms, rest_ms=rest_ms)
    player.play(ON, 10 if cycle_ms == 2 else cycle_ms or 5000)
    assert player.longest_ms <= on_ms and player.longest_ms >= on_ms * 0.9999 - 1
    assert player.on_ms <= on_ms or cycle_ms == 2


def test_time_on_is_counted_where_the_clock_wraps(board):
    board.now_ms = 2**32 - 700
    player = Player(board, maximum_on_ms=1000, rest_ms=500)
    player.play(ON, 1500)
    assert player.on_ms == player.longest_ms == 1000


steps = st.lists(
    st.tuples(
        st.sampled_from([ON, ON, ON, SILENT, None]),
        st.integers(1, 60).map(lambda k: 10 * k),
        st.sampled_from(["", "", "stop", "configure", "restart"]),
    ),
    max_size=30,
)


@settings(max_examples=60, deadline=None)
@given(steps, st.integers(50, 800), st.integers(50, 800))
def test_no_order_of_things_is_on_for_more_than_its_share(library, command, maximum_on_ms, rest_ms):
    board = Board(library)
    player = Player(board, maximum_on_ms=maximum_on_ms, rest_ms=rest_ms)
    for levels, ms, then in command:
        player.play(levels, ms)
        if then == "stop":
            board.take(wire.encode_frame(FrameKind.STOP, 0))
        if then == "restart":
            board.begin_again()
        if then or levels is None:
            player.configure()
    off_ms = player.all_ms - player.on_ms
    assert player.longest_ms <= maximum_on_ms
    assert player.on_ms <= maximum_on_ms * (1 + off_ms / rest_ms) + 1


def test_the_board_maximum_holds_for_any_host_limit(board):
    crc = configured(board, maximum_on_ms=2**32 - 1)
    for k in range(1, 320):
        play(board, crc, sequence=k)
        board.wait(100)
    assert board.levels == SILENT


def test_a_device_with_too_many_channels_is_refused(board):
    crc = configured(board, channels=7)
    (answer,) = board.replies()
    assert answer.payload == struct.pack("<IB", crc, 6)
    play(board, crc, [1] * 7)
    assert board.levels == SILENT


def test_the_clock_may_wrap(board):
    board.now_ms = 2**32 - 100
    crc = configured(board)
    for k in range(1, 5):
        play(board, crc, sequence=k)
        board.wait(60)
        assert board.levels == LOUD
    board.wait(190)
    assert board.levels == SILENT


@settings(max_examples=300, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=200), st.just(b"\0")), max_size=20))
def test_garbage_never_makes_a_sound_or_a_crash(library, pieces):
    board = Board(library)
    configured(board)
    for piece in pieces:
        board.take(piece)
        board.wait(1)
        assert board.levels == SILENT


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=94).filter(lambda content: 0 not in content))
def test_any_stuffed_bytes_are_understood_as_python_does(library, content):
    board = Board(library)
    board.take(content + b"\0")
    frame = wire.decode_frame(content)
    if frame is None or frame.kind not in (FrameKind.STOP, FrameKind.VALUES, FrameKind.CONFIGURE):
        assert board.replies() == []


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 255), st.integers(0, 65535), st.binary(max_size=80))
def test_any_intact_frame_is_taken_without_a_crash(library, kind, sequence, payload):
    board = Board(library)
    configured(board)
    board.replies()
    board.take(wire.encode_frame(kind, sequence, payload))
    board.wait(300)
    assert board.levels == SILENT


def test_values_with_one_changed_bit_are_not_played(library):
    board = Board(library)
    crc = configured(board)
    sent = wire.encode_frame(FrameKind.VALUES, 1, wire.encode_values(crc, LOUD))
    for bit in range(8, 8 * len(sent) - 8):  # not of the zeros at both ends
        changed = bytearray(sent)
        changed[bit // 8] ^= 1 << bit % 8
        board.take(bytes(changed))
        assert board.levels == SILENT
    board.take(sent)
    assert board.levels == LOUD
