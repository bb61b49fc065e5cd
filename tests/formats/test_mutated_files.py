# SPDX-License-Identifier: GPL-3.0-or-later
"""Small files with every member replaced by values of other kinds, and moved to every object.

``tests/manual/fuzz/run.py`` does the same at random, with any number, and through the commands.
"""

from __future__ import annotations

import copy
from contextlib import suppress

import pytest
from test_credits import AHAP, HAPTIC, HE, HJIF, TACT
from test_signal_formats import AHAP as CURVED
from test_signal_formats import HE2

from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats.files import decoded
from hfx_blender.formats.registry import FORMATS

VALUES = (None, True, -1, 1.5, 1e308, 10**400, "", "x", "NaN", "1e999", [], {}, [0], ["x"], [{}])
# Documents without members ignored by players, to check the neighbouring members.
UNNAMED = {"Version": 1.0, "Pattern": [{"Event": {"Time": 0.0}}, *CURVED["Pattern"]]}
SHORT = {**HE2, "PatternList": HE2["PatternList"][:1]}
SEEDS = {"ahap": [AHAP, UNNAMED], "haptic": [HAPTIC], "he": [HE, SHORT], "hjif": [HJIF]}
SEEDS |= {"tact": [TACT]}


def objects(tree):
    """Yield all objects within a document."""
    if isinstance(tree, dict):
        yield tree
    for item in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        yield from objects(item)


def changed(document):
    """Yield copies with one member of another value, or in another object."""
    whole = list(objects(document))
    keys = sorted({key for item in whole for key in item})
    for number, owner in enumerate(whole):
        for key in keys:
            for value in VALUES if key in owner else VALUES[3::5]:
                result = copy.deepcopy(document)
                list(objects(result))[number][key] = copy.deepcopy(value)
                yield result


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", SEEDS)
def test_a_changed_file_is_refused_or_read(kind):
    info = FORMATS[kind]
    for document in (item for seed in SEEDS[kind] for item in changed(seed)):
        content = encoded(document)
        with suppress(InputError):
            info.function("check")(content, "x")
        with suppress(InputError):
            decoded(info, content, "x")
