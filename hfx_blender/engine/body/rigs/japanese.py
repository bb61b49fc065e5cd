# SPDX-License-Identifier: GPL-3.0-or-later
"""Japanese bone names of MikuMikuDance models, put into the words that the reader knows.

The names are those of MMD's standard and semi-standard skeletons, which all of its models share.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Final

_JOINTS: Final = {
    "下半身": "lowerbody",
    "上半身": "upperbody",
    "首": "neck",
    "頭": "head",
    "肩": "shoulder",
    "腕": "upperarm",
    "腕捩": "upperarmtwist",
    "ひじ": "forearm",
    "肘": "forearm",
    "手捩": "forearmtwist",
    "手首": "hand",
    "足": "thigh",
    "ひざ": "shin",
    "膝": "shin",
    "足首": "foot",
    # The toe joint proper; "つま先" is the tip that the foot's controls aim at.
    "足先EX": "toe skin",
    "目": "eye",
    "胸": "breast",
    "親指": "thumb",
    "人指": "index",
    "人差指": "index",
    "人差し指": "index",
    "中指": "middle",
    "薬指": "ring",
    "小指": "pinky",
}
_SIDES: Final = {"左": "left", "右": "right"}
_NUMERALS: Final = str.maketrans("一二三", "123")
_NAME: Final = re.compile(r"([左右]?)(.+?)(\d*)([左右]?)(?:[._ ]([LR]))?")


def in_english(name: str) -> str:
    """A Japanese bone name in words, ``左ひじ`` as ``left forearm``; any other as it is.

    Names of controls and helpers are not in the table, and stay Japanese: nobody reads them.
    """
    if name.isascii():
        return name
    folded = unicodedata.normalize("NFKC", name).translate(_NUMERALS)
    match = _NAME.fullmatch(folded)
    if match is None:
        return name
    before, stem, number, after, mark = match.groups()
    side = _SIDES.get(before or after, {"L": "left", "R": "right"}.get(mark or "", ""))
    if stem not in _JOINTS:  # "足D": the bone that carries the skin, beside the one that is posed
        stem, carrier = stem.removesuffix("D"), True
    else:
        carrier = False
    if stem not in _JOINTS:
        return name
    return " ".join(w for w in (side, _JOINTS[stem], number, "skin" if carrier else "") if w)
