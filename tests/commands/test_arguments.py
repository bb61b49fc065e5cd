# SPDX-License-Identifier: GPL-3.0-or-later
"""Order of the arguments of commands, and values that begin with a minus."""

from __future__ import annotations

from pathlib import Path

import pytest

from hfx_blender.cli import build_parser
from hfx_blender.errors import UsageError

FILES = ["a", "b", "c"]


@pytest.mark.parametrize(
    "words",
    [
        "export a b c -o D -f csv",
        "export a -o D b -f csv c",
        "export -o D a -f csv b c",
        "export -o D a b -f csv c",
        "validate a b c --strict --largest 2",
        "validate a --strict b --largest 2 c",
        "validate --strict --largest 2 a b --json c",
    ],
)
def test_files_stand_before_between_and_after_options(words: str) -> None:
    options = build_parser().parse_args(words.split())
    files = options.scenes if words.startswith("export") else options.files
    assert files == [Path(name) for name in FILES]
    assert (
        (options.output, options.formats) == (Path("D"), ["csv"])
        if hasattr(options, "formats")
        else options.strict and options.largest == 2.0
    )


@pytest.mark.parametrize(
    "words", ["validate a --stric b", "export a -o D --jsn b", "convert a b c"]
)
def test_an_unknown_option_or_argument_is_named(words: str) -> None:
    with pytest.raises(UsageError, match=r"unrecognized arguments: (--stric|--jsn|c)"):
        build_parser().parse_args(words.split())


def test_no_file_is_refused() -> None:
    for words in ("export -o D", "validate --strict"):
        with pytest.raises(UsageError, match="are required"):
            build_parser().parse_args(words.split())


def test_values_may_begin_with_a_minus() -> None:
    parse = build_parser().parse_args
    assert parse("export a --frames -10:20 b".split()).frames == (-10, 20)
    assert parse("play t.hfxtrack --device d --from -.5".split()).begin == -0.5
    assert parse("texture stroke x --from -1,2 --to 3,4".split()).start == (-1.0, 2.0)
    assert parse("validate -3.csv".split()).files == [Path("-3.csv")]
