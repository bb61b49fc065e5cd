# SPDX-License-Identifier: GPL-3.0-or-later
"""Study plans: shape of the JSON document, checked values, and defaults of each design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import InputError
from hfx_blender.files.json_shapes import (
    PRINTABLE,
    Anything,
    Items,
    Node,
    Number,
    Record,
    Shape,
    Table,
    Text,
    node_of,
    read,
    strict,
    tagged,
)
from hfx_blender.text import printable

from .parameters import RANGES

Value = float | int | str
"""Value of a factor, as in the plan."""

Conditions = dict[str, Value]
"""Value by factor."""

MAX_ROWS: Final = 10_000
"""Largest number of trials of a participant, and of stimuli of a study."""

SHIPPED: Final = Path(__file__).with_name("plans")

_NAME: Final = Text(pattern=r"[A-Za-z0-9_-]{1,60}", note="1 to 60 letters, digits, - and _")
_FACTOR: Final = Text(pattern=r"[a-z][a-z0-9_]{0,39}", note="lower-case letters, digits and _")
_VALUES: Final = Items(Anything(), 1, 100, order="unique")
_SEVERAL: Final = Items(Anything(), 2, 100, order="unique")
_LEVELS: Final = Items(Number(), 2, 100, order="ascending")
_SCALE: Final = strict(
    {"id": _FACTOR, "text": PRINTABLE},
    {"lowest": PRINTABLE, "highest": PRINTABLE, "steps": Number(2, 9, is_whole=True)},
)
_FIXED: Final = ("strength", "speed_mm_s", "duration_ms", "frequency_hz")
_COMMON: Final[Mapping[str, Shape]] = {
    "title": PRINTABLE,
    "seed": Number(0, 2**32, is_whole=True),
    "participants": Number(1, 999, is_whole=True),
    "factors": Table(_VALUES, key=_FACTOR),
    "random": Table(_VALUES, key=_FACTOR),
    "repetitions": Number(1, 1000, is_whole=True),
    "sequence": Text(("random", "latin")),
    "blocks_by": _FACTOR,
    "gap_ms": Number(0, 10_000, "ms"),
    "training": Number(0, 100, is_whole=True),
    "catch": Number(0, 1000, is_whole=True),
    "breaks_every": Number(1, MAX_ROWS, is_whole=True),
    "noise": Number(0, 1),
    "device": PRINTABLE,
    "stimulus": strict(
        {},
        {
            "kind": Text(("auto", "line", "steady", "stroke", "file")),
            "path": PRINTABLE,
            **{name: RANGES[name] for name in _FIXED},
        },
    ),
    "texts": strict({}, dict.fromkeys(("welcome", "question", "pause", "end"), PRINTABLE)),
    "labels": Table(PRINTABLE),
    "questionnaire": Text(("nasa-tlx",)),
}


def _design(required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None) -> Record:
    return strict({"name": _NAME, **required}, {**_COMMON, **(optional or {})})


_THRESHOLD: Final = {"levels": Table(_LEVELS, 1, _FACTOR, "one factor with its levels")}
_FOR_THRESHOLD: Final[Mapping[str, Shape]] = {
    "reference": Number(),
    "guess": Number(0, 0.5),
    "scale": Text(("log", "linear")),
}
PLAN: Final = tagged(
    "design",
    {
        "paired": _design(
            {"compare": Table(_SEVERAL, 1, _FACTOR, "one factor or more, with the values")},
            {"orders": Text(("both", "balanced"))},
        ),
        "2afc": _design(_THRESHOLD, _FOR_THRESHOLD),
        "staircase": _design(
            _THRESHOLD, {**_FOR_THRESHOLD, "trials": Number(5, 1000, is_whole=True)}
        ),
        "identification": _design({"identify": _FACTOR}),
        "rating": _design({"scales": Items(_SCALE, 1, 20)}),
        "adjustment": _design({"adjust": Table(_LEVELS, 1, _FACTOR, "one factor and its levels")}),
    },
)
DESIGNS: Final = tuple(PLAN.kinds)

_TAKEN: Final = frozenset(
    "trial kind target staircase start stimulus stimulus_first stimulus_second onset onset_second "
    "duration trial_type response correct item score changes response_time latency_ms "
    "session".split()
)
"""Names of other columns in lists of trials and in answers."""

_QUESTIONS: Final = {
    "paired": "Which of the two do you prefer?",
    "2afc": "Which of the two was stronger?",
    "staircase": "Which of the two was stronger?",
    "identification": "Which of these was it?",
    "rating": "How was it?",
    "adjustment": "Adjust it until both feel equal.",
}
_TEXTS: Final = {
    "welcome": "You will feel touches and answer questions about them. Stop at any time with Esc.",
    "pause": "Take a break. Continue when you are ready.",
    "end": "That was the last question. Thank you.",
}


@dataclass(frozen=True)
class Scale:
    """Question of a rating with ``steps`` answers, 1 to ``steps``."""

    id: str
    text: str
    lowest: str = "not at all"
    highest: str = "very much"
    steps: int = 7


@dataclass(frozen=True)
class Plan:
    """Plan of a study; members have the names and units of the file.

    ``level_factor`` and ``levels`` are of the designs 2afc, staircase and adjustment, else "" and
    empty. ``path`` is the file of the plan, for relative names of stimuli.
    """

    name: str
    design: str
    path: Path
    title: str = ""
    seed: int = 0
    participants: int = 1
    factors: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    random: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    compare: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    orders: str = "both"
    level_factor: str = ""
    levels: tuple[Value, ...] = ()
    reference: float = 0.0
    guess: float = 0.5
    scale: str = ""
    trials: int = 40
    identify: str = ""
    scales: tuple[Scale, ...] = ()
    repetitions: int = 1
    sequence: str = "random"
    blocks_by: str = ""
    gap_ms: float = 400.0
    training: int = 0
    catch: int = 0
    breaks_every: int = 0
    noise: float = 0.0
    device: str = ""
    stimulus: Mapping[str, Any] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    questionnaire: str = ""

    @property
    def cells(self) -> list[Conditions]:
        """Every combination of the factors, the last factor fastest; one empty cell without."""
        return combinations(self.factors)

    @property
    def alternatives(self) -> list[Conditions]:
        """Compared conditions of a paired comparison, every combination of ``compare``."""
        return combinations(self.compare)

    @property
    def answers(self) -> tuple[Value, ...]:
        """Answers of an identification, the values of its factor; empty for other designs."""
        return self.factors[self.identify] if self.identify else ()

    @property
    def has_intervals(self) -> bool:
        """Test for trials of two stimuli."""
        return self.design in ("paired", "2afc", "staircase")

    def label(self, value: Value) -> str:
        """Text of a value on the screen."""
        return self.labels.get(as_text(value), as_text(value))


def combinations(factors: Mapping[str, tuple[Value, ...]]) -> list[Conditions]:
    """Every combination of the values of factors, the last factor fastest."""
    return [dict(zip(factors, values, strict=True)) for values in product(*factors.values())]


def as_text(value: Value) -> str:
    """Text of a value in tables: a number as in JSON."""
    return value if isinstance(value, str) else repr(value)


def read_plan(name: str | Path) -> Plan:
    """Read a plan: a file, or the name of a shipped plan. Raises InputError with file, field, found
    value and allowed values."""
    path = Path(name)
    shipped = sorted(path.stem for path in SHIPPED.glob("*.json"))
    if str(name) in shipped and not path.exists():
        path = SHIPPED / f"{name}.json"
    if not path.exists() and path.suffix.lower() != ".json":
        raise InputError(f"{path}: there is no such file; shipped plans are: {', '.join(shipped)}.")
    return _checked(read(path), path)


def plan_of(content: bytes, path: Path) -> Plan:
    """Plan of a file's content; ``path`` stands for the file in messages."""
    return _checked(node_of(content, str(path)), path)


def _checked(node: Node, path: Path) -> Plan:
    node.hold(PLAN)
    members: dict[str, Any] = dict(node.value)
    for table in ("factors", "random", "compare"):
        if table in members:
            members[table] = {
                name: _values(values) for name, values in node[table].members().items()
            }
    for table in ("levels", "adjust"):
        if table in members:
            if len(node[table].value) != 1:
                node[table].fail("one factor with its levels")
            ((members["level_factor"], levels),) = node[table].members().items()
            members.pop(table)
            members["levels"] = tuple(levels.value)
    members["scales"] = tuple(Scale(**scale) for scale in members.get("scales", ()))
    _refuse_repeated_factors(node, members)
    plan = Plan(path=path, **members)
    _refuse_misfits(node, plan)
    texts = _TEXTS | {"question": _QUESTIONS[plan.design]} | dict(plan.texts)
    defaults: dict[str, Any] = {"texts": texts, "title": plan.title or plan.name}
    if plan.levels and not plan.scale:
        # Ratios of strengths are perceived as steps; a level of 0 has no logarithm.
        is_positive = all(not isinstance(level, str) and level > 0 for level in plan.levels)
        defaults["scale"] = "log" if is_positive else "linear"
    return Plan(**{**vars(plan), **defaults})


def _values(node: Node) -> tuple[Value, ...]:
    """Values of a factor: finite numbers or printable texts of at most 400 characters."""
    for item in node.items():
        value = item.value
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        is_text = isinstance(value, str) and 0 < len(value) <= 400 and printable(value) == value
        if not is_number and not (is_text and value != "n/a" and value == value.strip()):
            item.fail("a number, or text of 1 to 400 printable characters other than n/a")
    return tuple(node.value)


def _refuse_repeated_factors(node: Node, members: Mapping[str, Any]) -> None:
    """Raise InputError for a factor in two places, or with the name of a column of trials."""
    seen = set(_TAKEN)
    for name in members.get("compare", ()):
        seen |= {f"{name}_first", f"{name}_second"}
    tables = [(key, members.get(key, {})) for key in ("factors", "random", "compare")]
    if members.get("level_factor"):
        tables.append(("adjust" if "adjust" in node else "levels", {members["level_factor"]: ()}))
    for key, table in tables:
        for name in table:
            if name in seen or name.startswith("rating_"):
                node[key].fail(f"a table without '{name}', which is the name of another column")
            seen.add(name)


def _refuse_misfits(node: Node, plan: Plan) -> None:
    """Raise InputError for members that do not fit one another."""
    names = ", ".join(plan.factors) or "none, as there are no factors"
    for key in ("identify", "blocks_by"):
        if key in node and node.value[key] not in plan.factors:
            node[key].fail(f"a factor of the plan: {names}")
    if plan.identify and len(plan.answers) < 2:
        node["factors"][plan.identify].fail("a list of 2 to 100 items")
    if plan.identify and len({plan.label(value) for value in plan.answers}) < len(plan.answers):
        node["labels"].fail("a different label for each answer")
    if plan.scale == "log" and not all(float(level) > 0 for level in plan.levels):
        node["levels"].fail("levels above 0 for a logarithmic scale")
    if "scales" in node and len({scale.id for scale in plan.scales}) < len(plan.scales):
        node["scales"].fail("scales with different ids")
    if plan.stimulus.get("kind") == "file" and "path" not in plan.stimulus:
        node["stimulus"].fail('a "path" as well, for a stimulus of the kind file')
    rows = row_count(plan)
    if rows > MAX_ROWS:
        key = "repetitions" if "repetitions" in node else "design"
        node[key].fail(f"a plan of at most {MAX_ROWS} trials for each participant, not {rows}")
    if plan.catch > rows:
        node["catch"].fail(f"a whole number of catch trials from 0 to {rows}, the number of trials")


def row_count(plan: Plan) -> int:
    """Number of trials of a participant, without training and catch trials."""
    count = prod(map(len, plan.factors.values())) * plan.repetitions
    if plan.design == "paired":
        alternatives = prod(map(len, plan.compare.values()))
        pairs = alternatives * (alternatives - 1) // 2
        return count * pairs * (2 if plan.orders == "both" else 1)
    if plan.design == "2afc":
        return count * len(plan.levels)
    return count * (plan.trials if plan.design == "staircase" else 1)
