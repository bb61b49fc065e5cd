# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a plan's factors, checked for the kind of its stimuli without a device."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.files.json_shapes import Node, read

from .parameters import PARAMETERS, allowed_instead
from .plan import Plan, as_text

_KNOWN: Final = frozenset[str]().union(*PARAMETERS.values())
_NEEDED: Final = {"line": "direction", "stroke": "surface"}


def kind_of(plan: Plan) -> str:
    """Kind of a plan's stimuli, a key of ``PARAMETERS``."""
    kind = str(plan.stimulus.get("kind", "auto"))
    if kind != "auto":
        return kind
    if "path" in plan.stimulus:
        return "file"
    names = {*plan.factors, *plan.compare, *plan.random, plan.level_factor}
    for kind, sign in (("file", {"take", "effect"}), ("stroke", {"surface"})):
        if names & sign:
            return kind
    return "line" if "direction" in names else "steady"


def relevant_factors(plan: Plan) -> frozenset[str]:
    """Factors that the stimuli depend on. InputError for a compared, identified or varied factor
    without an effect, as all of its stimuli would be equal."""
    kind, known = kind_of(plan), _with_effect(plan)
    varied = {*plan.compare, plan.identify, plan.level_factor} - {""}
    for name in sorted(varied - known):
        raise InputError(
            f"{plan.path}: '{name}' is compared, but no stimulus of the kind {kind} depends on it; "
            f"allowed are {', '.join(sorted(known))}."
        )
    return known & {*plan.factors, *plan.random, *plan.compare, *varied}


def labels_of(plan: Plan) -> list[str]:
    """Names in ``factors`` that no stimulus depends on, in the order of the plan."""
    return [name for name in plan.factors if name not in _with_effect(plan)]


def refuse_values(plan: Plan) -> None:
    """Read the plan's file again, and raise InputError with field, value and allowed values for a
    value that a stimulus cannot have on any device, and for a missing factor of its kind."""
    node, kind = read(plan.path), kind_of(plan)
    relevant_factors(plan)
    # A file may show anything by a factor: "takes/{direction}.hfxtrack" has directions of its own.
    known = PARAMETERS["file"] if kind == "file" else _KNOWN
    tables = [
        node[key] for key in ("factors", "random", "compare", "levels", "adjust") if key in node
    ]
    for table in tables:
        for name, values in table.members().items():
            if name in known:
                _refuse(name, values.items())
    if plan.design in ("2afc", "staircase"):
        allowed = allowed_instead(plan.level_factor, plan.reference)
        if allowed and plan.level_factor in known:
            if "reference" in node:
                node["reference"].fail(f"{allowed} of {plan.level_factor}")
            raise InputError(
                f"{plan.path}: 'reference' is missing, and {plan.level_factor} cannot be 0; "
                f"allowed is {allowed}."
            )
    names = {*plan.factors, *plan.random, *plan.compare, plan.level_factor}
    if kind in _NEEDED and _NEEDED[kind] not in names:
        allowed = allowed_instead(_NEEDED[kind], "")
        raise InputError(
            f"{plan.path}: the factor '{_NEEDED[kind]}' is missing, which stimuli of the kind "
            f"{kind} need; allowed is {allowed}."
        )


def _with_effect(plan: Plan) -> frozenset[str]:
    in_path = re.findall(r"\{(\w+)\}", str(plan.stimulus.get("path", "")))
    return PARAMETERS[kind_of(plan)] | frozenset(in_path)


def _refuse(name: str, values: Iterable[Node]) -> None:
    """Raise InputError for the first value that the parameter cannot have."""
    for node in values:
        allowed = allowed_instead(name, node.value)
        if allowed:
            node.fail(allowed)
        if name == "device":
            try:
                load_device(as_text(node.value), resources.user_devices())
            except InputError as error:
                raise InputError(f"{node.file}: {node.path}: {error}") from error
