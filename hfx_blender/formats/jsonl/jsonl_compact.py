# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of the compact JSON Lines of samples of earlier versions.

Lines state changes from earlier lines; the header has ``"encoding": "compact"``. A set with
``from`` is another set with changed vertices: ``gaps`` are the differences of ascending vertex ids
(the first from 0), ``weights`` the new weights in 1/255, 0 for a removed vertex. Effects and bodies
are indices into the header's lists. Missing ``parameters`` repeat the last sample of the same
effect and body. ``docs/formats/samples.schema.json`` is the schema.
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any, Final

from ...engine.modality import MODALITIES
from ...files import limits
from ...files.findings import Report
from ...files.json_shapes import Items, Number, Text, check, loose, strict
from ...files.strict_json import Place

ENCODING: Final = "compact"

_STEPS: Final = 255
_ENTRY_BYTES: Final = 64.0  # approximate memory of a vertex in an unpacked set
_ID = Number(0, 2**31 - 1, is_whole=True)
_SET = strict(
    {
        "type": Text(("set",)),
        "set": _ID,
        "gaps": Items(_ID),
        "weights": Items(Number(0, _STEPS, is_whole=True)),
    },
    {"from": _ID},
)
_SAMPLE = loose(
    {"type": Text(("sample",)), "t": Number(), "effect": _ID, "body": _ID, "set": _ID},
    {"parameters": Items(Number())},
)


class CompactDecoder:
    """Decoder of compact lines, in file order, to lines of the plain encoding."""

    def __init__(self, header: dict[str, Any], name: str) -> None:
        self.header = {key: value for key, value in header.items() if key != "encoding"}
        self._name = name
        self._unfolded = 0
        self._sets: dict[int, dict[int, int]] = {}
        self._parameters: dict[tuple[int, int], list[float]] = {}

    def line(self, value: Any, report: Report, place: Place) -> Any:
        """Decode a set or sample; None after a reported fault; other lines are unchanged."""
        kind = value.get("type") if isinstance(value, dict) else None
        if kind not in ("set", "sample"):
            return value
        before = report.count
        check(_SET if kind == "set" else _SAMPLE, value, report, place)
        if report.count > before:
            return None
        return (self._set if kind == "set" else self._sample)(value, report, place)

    def _set(self, value: dict[str, Any], report: Report, place: Place) -> Any:
        """Decode a set to the plain encoding; None after a reported fault.

        Raises TooLargeError beyond the memory limit of all sets.
        """
        base = value.get("from")
        if base is not None and base not in self._sets:
            report.error("SET-FROM", place, f"there is no set {base} before it")
            return None
        ids = list(accumulate(value["gaps"]))
        if len(ids) != len(value["weights"]):
            report.error("SET-SIZE", place, "there are not as many weights as gaps")
            return None
        steps = {
            **(self._sets[base] if base is not None else {}),
            **dict(zip(ids, value["weights"], strict=True)),
        }
        # Each line may copy a large set: the total is limited, not the line.
        self._unfolded += len(steps)
        limits.MEMORY.check(_ENTRY_BYTES * self._unfolded, self._name, "its sets would take")
        steps = {vertex: step for vertex, step in sorted(steps.items()) if step}
        self._sets[value["set"]] = steps
        weights = [round(step / _STEPS, 6) for step in steps.values()]
        return {"type": "set", "set": value["set"], "vertices": [*steps], "weights": weights}

    def _sample(self, value: dict[str, Any], report: Report, place: Place) -> Any:
        """Decode a sample with ids of effect and body, and named parameters; None after a fault."""
        effects, bodies = self.header.get("effects", ()), self.header.get("bodies", ())
        key = (value["effect"], value["body"])
        parameters = value.get("parameters", self._parameters.get(key))
        if key[0] >= len(effects) or key[1] >= len(bodies) or parameters is None:
            message = "the header has no such effect or body, or its parameters were never given"
            report.error("SAMPLE-ID", place, message)
            return None
        self._parameters[key] = parameters
        names = MODALITIES[effects[key[0]]["modality"]].parameter_names
        if len(parameters) != len(names):
            report.error("SAMPLE-PARAMETERS", place, f"expected {', '.join(names)}")
            return None
        return {
            **value,
            "effect": effects[key[0]]["id"],
            "body": bodies[key[1]]["id"],
            "parameters": dict(zip(names, parameters, strict=True)),
        }
