# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of clips, and rules of their content, each stated in ``docs/formats/clip.md``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.errors import InputError
from hfx_blender.files.findings import Finding
from hfx_blender.formats.clip.baked import FULL_SCALE
from hfx_blender.formats.clip.container import (
    MOST_TEXT,
    NONE,
    RECORDS,
    Records,
    Sections,
    refuse_long,
)

from .clip_reader import decoded, texts_at

_PARAMETERS: Final = {parameter.name for one in MODALITIES.values() for parameter in one.parameters}
_MOST_ROWS: Final = 2**31 - 1
_MOST_HZ: Final = 1e6
_HUGE: Final = float(np.finfo(np.float32).max)

_TEXTS: Final = {
    "TIME": ("title",),
    "DEVC": ("id", "name", "body"),
    "ACTR": ("id", "parts", "bone", "human"),
    "COLM": ("parameter", "unit"),
    "CLIP": ("name",),
    "BODY": ("name",),
    "BONE": ("name", "human", "mixamo", "unreal"),
    "MODL": ("id",),
    "EFCT": ("name", "model"),
    "SURF": ("name",),
}
_RANGES: Final = (
    ("DEVC", "first_actuator", "actuators", "ACTR"),
    ("DEVC", "first_column", "columns", "COLM"),
    ("ACTR", "first_column", "columns", "COLM"),
    ("ACTR", "first_row", "rows", "ROWS"),
    ("BODY", "first_bone", "bones", "BONE"),
    ("BODY", "first_model", "models", "MODL"),
    ("MODL", "first_vertex", "vertices", "VERT"),
    ("VERT", "first_weight", "weights", "WGHT"),
    ("EFCT", "first_filter", "filters", "FLTR"),
    ("EFCT", "first_painted", "painted", "PNTD"),
    ("REAC", "first_reached", "reached", "RCHV"),
    ("HMAP", "first_texel", "texels", "TEXL"),
)
"""Ranges of records: section, fields of first and count, target section."""

_INDICES: Final = (
    ("COLM", "actuator", "ACTR"),
    ("REAC", "actuator", "ACTR"),
    ("REAC", "model", "MODL"),
    ("SURF", "map", "HMAP"),
)
_LAST_MODALITY: Final = len(MODALITIES) - 1
_WHOLE: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "ACTR": {"modality": (0, _LAST_MODALITY), "columns": (1, 8), "rows": (1, NONE),
             "place": (0, 2), "side": (0, 2)},
    "COLM": {"neutral_number": (0, 65535)},
    "CLIP": {"loops": (0, 1)},
    "BODY": {"bones": (0, 65535)},
    "MODL": {"modality": (0, 2)},
    "EFCT": {"kind": (0, 1), "modality": (0, _LAST_MODALITY), "shape": (0, 3),
             "falloff": (0, 2), "filters": (0, 16)},
    "FLTR": {"kind": (0, 4), "operation": (0, 2), "about": (0, 2)},
    "REAC": {"modality": (0, _LAST_MODALITY), "statistic": (0, 1)},
    "HMAP": {"columns": (1, 65535), "rows": (1, 65535), "tiles": (0, 1)},
}  # fmt: skip
"""Lowest and highest value of whole-number fields; 32 bits otherwise."""

_REAL: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "TIME": {"start_s": (-1e300, 1e300)},
    "ACTR": {"slew_per_s": (0.0, np.inf), "maximum_on_s": (0.0, np.inf)},
    "EFCT": {"half_segment": (0.0, _HUGE), "share": (0.0, 1.0), "level": (0.0, 1.0)},
    "PNTD": {"weight": (0.0, 1.0)},
    "REAC": {"frequency_hz": (0.0, _HUGE)},
    "RCHV": {"factor": (0.0, 1.0)},
    "SURF": {"m_s2": (0.0, _HUGE), "hz": (0.0, _HUGE), "uv_mm": (0.0, _HUGE)},
    "HMAP": {"mm": (0.0, _HUGE)},
}
"""Lowest and highest value of floating-point fields; finite otherwise."""


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of the clip ``name``; InputError for an undecodable file."""
    return findings_of(decoded(content, name), name)


def read(content: bytes, name: str) -> dict[str, Records]:
    """Decode a valid clip to its sections; InputError with the place of the first finding."""
    sections = decoded(content, name)
    for finding in findings_of(sections, name):
        raise InputError(f"{name}: '{finding.place}' {finding.message} [{finding.code}].")
    return sections


def findings_of(sections: Sections, file_name: str) -> list[Finding]:
    """Return the findings of the first failing group of rules; later groups rely on earlier groups.
    Empty for a valid clip; TooLargeError then for a clip longer than the limit of duration."""
    text = sections["TEXT"]
    if not len(text) or text[0] or text[-1]:
        return [_finding("TEXT", "does not begin and end with a zero byte")]
    if np.diff(np.flatnonzero(text == 0)).max(initial=0) > MOST_TEXT + 1:
        return [_finding("TEXT", f"has a text of more than {MOST_TEXT} bytes")]
    try:
        text.tobytes().decode()
    except UnicodeDecodeError as error:
        return [_finding("TEXT", f"byte {error.start} is not UTF-8")]
    if len(sections["TIME"]) != 1:
        return [_finding("TIME", f"has {len(sections['TIME'])} records, allowed is one")]
    # Each group assumes that the groups before hold: offsets are compared with sizes first, so
    # a later group may index without bounds.
    kinds: tuple[Callable[[Sections], list[Finding]], ...] = (
        _time, _references, _numbers, _rows, _columns, _clips, _bodies, _spatial, _surfaces
    )  # fmt: skip
    for kind in kinds:
        findings = kind(sections)
        if findings:
            return findings
    refuse_long(sections, file_name)
    return []


def _finding(place: str, message: str, code: str = "RULE") -> Finding:
    """Create a finding of severity error with the code ``CLIP-<code>``."""
    return Finding(f"CLIP-{code}", place, message)


def _first(
    section: str, field: str, values: npt.NDArray[Any], is_bad: npt.NDArray[np.bool_], allowed: str
) -> list[Finding]:
    """List of one finding about the first record with ``is_bad``; empty if no record is bad.
    ``is_bad`` is (n,) or (n, ...). The message quotes ``values[k]`` and ``allowed``; the place is
    ``section[k].field``, or ``section[k]`` for an empty ``field``."""
    if not is_bad.any():
        return []
    k = int(np.argmax(is_bad.reshape(len(is_bad), -1).any(axis=1)))
    place = f"{section}[{k}].{field}" if field else f"{section}[{k}]"
    return [_finding(place, f"is {values[k]}, allowed is {allowed}")]


def _time(sections: Sections) -> list[Finding]:
    """Finding for a rate outside 0 (excluded) to 1 MHz, or else for rows outside 1 to 2**31 - 1."""
    at = sections["TIME"][0]
    if not 0.0 < at["rate_hz"] <= _MOST_HZ:
        return [_finding("TIME.rate_hz", f"is {at['rate_hz']:g}, allowed is up to {_MOST_HZ:g}")]
    if not 1 <= at["rows"] <= _MOST_ROWS:
        return [_finding("TIME.rows", f"is {at['rows']}, allowed is 1 to {_MOST_ROWS}")]
    return []


def _references(sections: Sections) -> list[Finding]:
    """Findings on text offsets, ranges of records and record numbers, at most one per field. An
    offset is the first byte of a text; the ranges of a field tile the target section in order; a
    record number is below the count of the target section."""
    findings: list[Finding] = []
    size = len(sections["TEXT"])
    for section, fields in _TEXTS.items():
        for field in fields:
            places = sections[section][field]
            is_bad = places >= size
            # A text begins at offset 0, or behind the zero byte of the text before.
            before = np.maximum(np.where(is_bad, 0, places), 1) - 1
            is_bad |= (places > 0) & (sections["TEXT"][before] != 0)
            findings += _first(section, field, places, is_bad, "the beginning of a text")
    for section, field, number, of in _RANGES:
        firsts, counts = (sections[section][key].astype(np.int64) for key in (field, number))
        # Ranges tile the target section without gaps or overlaps, so the first range starts
        # at 0, and each range where its predecessor ends.
        expected = np.concatenate([[0], np.cumsum(counts)])
        findings += _first(
            section, field, firsts, firsts != expected[:-1], "the end of the range before"
        )
        if not findings and expected[-1] != len(sections[of]):
            message = f"ranges have {expected[-1]} records of {of}, which has {len(sections[of])}"
            findings.append(_finding(f"{section}.{number}", message))
    for section, field, of in _INDICES:
        values, count = sections[section][field], len(sections[of])
        findings += _first(section, field, values, values >= count, f"below {count}")
    return findings


def _numbers(sections: Sections) -> list[Finding]:
    """Findings on fields outside ``_WHOLE`` or ``_REAL``, on NaN and infinity; ``reserved`` is 0.
    Infinity is allowed only in fields with the upper bound infinity."""
    findings: list[Finding] = []
    for section, kind in RECORDS.items():
        for field in kind.names or ():
            values = sections[section][field]
            most = 0.0 if field == "reserved" else float(NONE)
            low, high = _WHOLE.get(section, {}).get(field, (0.0, most))
            if values.dtype.kind == "f":
                low, high = _REAL.get(section, {}).get(field, (-np.inf, np.inf))
                # The negated comparison includes NaN. Infinity is allowed only as an upper bound.
                is_bad = ~((values >= low) & (values <= high))
                is_bad |= np.isinf(values) & (high < np.inf or low == -np.inf)
            else:
                is_bad = (values < low) | (values > high)
            allowed = f"{low:g} to {high:g}" if np.isfinite([low, high]).any() else "finite"
            findings += _first(section, field, values, is_bad, allowed)
    return findings


def _rows(sections: Sections) -> list[Finding]:
    """Findings on the rows of actuators, and on the number of values. Rows start at 0, ascend
    strictly and are below the clip's row count; each row has a value per column."""
    actuators, rows = sections["ACTR"], sections["ROWS"].astype(np.int64)
    if not len(actuators):
        return []
    firsts = actuators["first_row"].astype(np.int64)
    sizes = actuators["rows"].astype(np.int64) * actuators["columns"]
    expected = np.concatenate([[0], np.cumsum(sizes)])
    findings = _first(
        "ACTR",
        "first_value",
        actuators["first_value"],
        actuators["first_value"] != expected[:-1],
        "the end of the values before",
    )
    if expected[-1] != len(sections["VALU"]):
        message = f"has {len(sections['VALU'])} values, the rows of actuators {expected[-1]}"
        findings.append(_finding("VALU", message))
    # The first row of each actuator is 0; within an actuator the rows ascend strictly.
    ascends = np.ones(len(rows), np.bool_)
    ascends[1:] = rows[1:] > rows[:-1]
    ascends[firsts] = rows[firsts] == 0
    count = int(sections["TIME"][0]["rows"])
    is_bad = ~ascends | (rows >= count)
    return findings + _first("ROWS", "", rows, is_bad, f"ascending from 0 to {count - 1}")


def _columns(sections: Sections) -> list[Finding]:
    """Findings on the first bad owner, parameter and range (lowest <= neutral <= highest) of
    columns."""
    columns = sections["COLM"]
    owners = np.repeat(np.arange(len(sections["ACTR"])), sections["ACTR"]["columns"])
    # Ranges tile the section, so the owner of each column is known without its field.
    findings = _first(
        "COLM", "actuator", columns["actuator"], columns["actuator"] != owners, "its own"
    )
    for k, name in enumerate(texts_at(sections, columns["parameter"])):
        if name not in _PARAMETERS:
            allowed = ", ".join(sorted(_PARAMETERS))
            findings.append(_finding(f"COLM[{k}].parameter", f"is '{name}', allowed are {allowed}"))
            break
    low, high, neutral = (columns[field] for field in ("lowest", "highest", "neutral"))
    is_bad = (low > high) | (low < -_HUGE) | (high > _HUGE)
    findings += _first("COLM", "highest", high, is_bad, "not below 'lowest'")
    is_bad = (neutral < low) | (neutral > high)
    return findings + _first("COLM", "neutral", neutral, is_bad, "'lowest' to 'highest'")


def _clips(sections: Sections) -> list[Finding]:
    """Findings on the first clip without 0 <= start < end, beyond the track's end, or with a taken
    name."""
    clips, at = sections["CLIP"], sections["TIME"][0]
    lasts_s = float(at["rows"]) / float(at["rate_hz"])
    is_bad = (clips["start_s"] < 0.0) | (clips["start_s"] >= clips["end_s"])
    findings = _first("CLIP", "start_s", clips["start_s"], is_bad, "0 or more, before 'end_s'")
    findings += _first(
        "CLIP", "end_s", clips["end_s"], clips["end_s"] > lasts_s, f"up to {lasts_s:g}"
    )
    taken: set[str] = set()
    for k, name in enumerate(texts_at(sections, clips["name"])):
        if name in taken:
            findings.append(_finding(f"CLIP[{k}].name", f"is '{name}', as another clip's"))
            break
        taken.add(name)
    return findings


def _bodies(sections: Sections) -> list[Finding]:
    """Findings on bodies: parents precede bones, weights are of the body's bones, sum 65535."""
    bodies, models, vertices = sections["BODY"], sections["MODL"], sections["VERT"]
    # Number of each bone within its own body: parents are numbered within the body too.
    own = np.concatenate([np.zeros(0, np.int64), *(np.arange(n) for n in bodies["bones"])])
    parents = sections["BONE"]["parent"]
    is_bad = (parents != NONE) & (parents >= own)
    # Players pose bones in the order of the file, so a parent is posed before its children.
    findings = _first("BONE", "parent", parents, is_bad, "a bone before it")
    # The bone count of a body is repeated down to its weights. Ranges tile their sections in order,
    # so repetition joins the records without an index.
    bones_of_model = np.repeat(bodies["bones"], bodies["models"])
    bones_of_vertex = np.repeat(bones_of_model, models["vertices"])
    weights = sections["WGHT"]
    most = np.repeat(bones_of_vertex, vertices["weights"])
    findings += _first(
        "WGHT", "bone", weights["bone"], weights["bone"] >= most, "a bone of the body"
    )
    # Sums over ranges as differences of a running sum.
    ends = np.concatenate([[0], np.cumsum(weights["weight"].astype(np.int64))])
    firsts = vertices["first_weight"].astype(np.int64)
    sums = ends[firsts + vertices["weights"]] - ends[firsts]
    is_bad = (vertices["weights"] > 0) & (sums != 65535)
    return findings + _first("VERT", "weights", sums, is_bad, "65535 in all")


def _spatial(sections: Sections) -> list[Finding]:
    """Findings on bodies of effects; on actuators, vertices and factors (above 0) of reactions.
    Actuators ascend; vertices of a reaction or painted area ascend strictly."""
    bodies = sections["EFCT"]["body"]
    is_bad = (bodies != NONE) & (bodies >= len(sections["BODY"]))
    findings = _first("EFCT", "body", bodies, is_bad, f"below {len(sections['BODY'])}")
    reactions = sections["REAC"]
    # Model numbers may be used as indices: an earlier group has checked all references.
    counts = sections["MODL"]["vertices"][reactions["model"]]
    reached = sections["RCHV"]["vertex"]
    actuators = reactions["actuator"].astype(np.int64)
    findings += _first(
        "REAC", "actuator", actuators, np.diff(actuators, prepend=0) < 0, "ascending"
    )
    most = np.repeat(counts, reactions["reached"])
    findings += _first("RCHV", "vertex", reached, reached >= most, "a vertex of the model")
    factors = sections["RCHV"]["factor"]
    findings += _first("RCHV", "factor", factors, factors <= 0.0, "above 0, up to 1")
    # Vertices ascend strictly within each range; at the first vertex of a range any is allowed.
    for section, values, counts in (
        ("RCHV", reached, reactions["reached"]),
        ("PNTD", sections["PNTD"]["vertex"], sections["EFCT"]["painted"]),
    ):
        owners = np.repeat(np.arange(len(counts)), counts)
        is_bad = (np.diff(owners, prepend=-1) == 0) & (
            np.diff(values.astype(np.int64), prepend=-1) <= 0
        )
        findings += _first(section, "vertex", values, is_bad, "above the one before")
    return findings


def _surfaces(sections: Sections) -> list[Finding]:
    """Findings on maps without size or with another number of texels than columns times rows, and
    on descending amplitudes or frequencies of surfaces."""
    maps = sections["HMAP"]
    expected = maps["columns"].astype(np.int64) * maps["rows"]
    is_bad = maps["texels"] != expected
    findings = _first("HMAP", "texels", maps["texels"], is_bad, "columns times rows")
    findings += _first("HMAP", "mm", maps["mm"], maps["mm"] <= 0.0, "above 0")
    for field in ("m_s2", "hz"):
        values = sections["SURF"][field]
        findings += _first("SURF", field, values, values[:, 0] > values[:, 1], "lowest, highest")
    return findings


def values_of(sections: Sections, actuator: int) -> tuple[Records, F64]:
    """Decode an actuator (record number) of a valid clip: stored rows (n,), values (n, columns).
    Values equal to the column's neutral number are exactly the neutral value."""
    at = sections["ACTR"][actuator]
    count, columns = int(at["rows"]), int(at["columns"])
    first_row, first_value = int(at["first_row"]), int(at["first_value"])
    rows = sections["ROWS"][first_row : first_row + count]
    numbers = sections["VALU"][first_value : first_value + count * columns]
    column_records = sections["COLM"][int(at["first_column"]) :][:columns]
    numbers = numbers.reshape(count, columns)
    lowest, highest = column_records["lowest"], column_records["highest"]
    values = lowest + (highest - lowest) * (numbers / FULL_SCALE)
    # The neutral value rarely falls on a step. Its number means exactly neutral, so actuators at
    # rest stay at rest.
    is_neutral = numbers == column_records["neutral_number"]
    return rows, np.where(is_neutral, column_records["neutral"], values)
