# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of a study: one page of HTML with tables and plots, ready to print."""

from __future__ import annotations

import datetime
import html
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hfx_blender.files.atomic import atomic_file
from hfx_blender.text import printable
from hfx_blender.version import __version__

from ..charts import chart
from ..command_process.temporary_folder import temporary_folder
from .folder import Study
from .psychometric import Fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT: Final = "report.html"

_STYLE: Final = """\
body { font: 11pt/1.4 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
  color: #222; background: #fff; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; margin: .6rem 0; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #ccc; text-align: right; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 1rem 0; } svg { max-width: 100%; height: auto; }
.note { color: #555; font-size: .9rem; }
@media print { body { margin: 0; max-width: none; } table, figure { break-inside: avoid; } }
"""

_NAN: Final = "-"


def write(study: Study, results: Mapping[str, Any]) -> Path:
    """Write the page of a study's results into its folder; OutputError for an unwritable file."""
    path = study.folder / REPORT
    title = html.escape(printable(str(results["title"])))
    body = "\n".join(_sections(results))
    made = datetime.date.today().isoformat()
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>\n{_STYLE}</style></head><body>\n<h1>{title}</h1>\n{body}\n"
        f'<p class="note">hfx {__version__}, {made}. Intervals are 95 % intervals.</p>\n'
        "</body></html>\n"
    )
    with atomic_file(path) as file:
        file.write(page.encode())
    return path


def _sections(results: Mapping[str, Any]) -> Iterable[str]:
    """Yield the parts of the page: counts, results of the design, and questionnaire."""
    yield _paragraph(
        f"Design: {results['design']}. {results['participants']} participants, "
        f"{results['trials']} trials; median response time {results['response_time_s']:.2f} s."
    )
    catch = results["catch"]
    if catch["total"]:
        sign = "answered first" if results["design"] == "paired" else "right"
        yield _paragraph(f"Catch trials: {catch['successes']} of {catch['total']} {sign}.")
    yield from {
        "paired": _paired,
        "2afc": _thresholds,
        "staircase": _thresholds,
        "adjustment": _adjustment,
        "rating": _rating,
        "identification": _identification,
    }[results["design"]](results)
    if "nasa_tlx" in results:
        yield from _tlx(results["nasa_tlx"])


def _paired(results: Mapping[str, Any]) -> Iterable[str]:
    yield _heading("Pairs")
    yield _table(
        ["pair", "preferred first", "share", "interval", "p (binomial)", "p (Holm)"],
        [
            [
                f"{pair['first']} : {pair['second']}",
                f"{pair['successes']} of {pair['total']}",
                _percent(pair["share"]),
                _interval(pair, _percent),
                _p(pair["p"]),
                _p(pair["p_holm"]),
            ]
            for pair in results["pairs"]
        ],
    )
    yield _note(
        "Exact binomial tests against one half, Wilson's intervals. Trials count as independent; "
        "the next table shows whether participants agree."
    )
    yield _table(
        ["pair", "participants for the first", "for the second", "undecided"],
        [
            [
                f"{pair['first']} : {pair['second']}",
                *(str(pair["participants"][key]) for key in ("first", "second", "neither")),
            ]
            for pair in results["pairs"]
        ],
    )
    yield _note("Participants with p below 0.05 after Holm's correction over participants.")
    model, names = results["bradley_terry"], results["alternatives"]
    yield _heading("Bradley-Terry model")
    if model["is_finite"]:
        yield _table(
            ["alternative", "strength", "standard error", "interval"],
            [
                [name, _number(s), _number(e), f"{_number(low)} to {_number(high)}"]
                for name, s, e, low, high in zip(
                    names,
                    *(model[key] for key in ("strengths", "errors", "low", "high")),
                    strict=True,
                )
            ],
        )
        yield _note(
            f"Logarithms of odds, mean 0. Equal strengths: chi-squared {model['statistic']:.2f}, "
            f"{len(names) - 1} degrees of freedom, p {_p(model['p'])}."
        )
        yield _figure(
            lambda figure: _draw_strengths(figure, names, model), 640, 60 + 40 * len(names)
        )
    else:
        yield _paragraph("An alternative was always or never preferred: strengths have no limit.")
    order = results["order"]
    yield _paragraph(
        f"The first stimulus was preferred in {_percent(order['share'])} of all trials "
        f"({_interval(order, _percent)}, p {_p(order['p'])})."
    )
    if results["by_factor"]:
        yield _heading("By factor")
        yield _table(
            ["factor", "pair", "share", "interval", "p"],
            [
                [
                    f"{row['factor']} {row['value']}",
                    f"{row['first']} : {row['second']}",
                    _percent(row["share"]),
                    _interval(row, _percent),
                    _p(row["p"]),
                ]
                for row in results["by_factor"]
            ],
        )


def _thresholds(results: Mapping[str, Any]) -> Iterable[str]:
    yield _heading("Thresholds")
    yield from _groups(results)
    yield _table(
        ["participant", "condition", results["level"], "interval", "spread", "lapses"],
        [
            [
                fit["participant"],
                fit["condition"],
                _number(fit["threshold"]) + ("" if fit["is_bounded"] else " (outside)"),
                _interval(fit, _number),
                _number(fit["spread"]),
                _percent(fit["lapse"]),
            ]
            for fit in results["fits"]
        ],
    )
    yield _note(
        "Logistic psychometric functions; medians and intervals of the posterior. The threshold is "
        "half way between guessing and certainty, without guessing the point of subjective "
        "equality. Thresholds that the levels do not enclose are marked, and left out of means."
    )
    yield _figure(lambda figure: _draw_functions(figure, results), 640, 360)
    yield from _comparison(results["comparison"], results["conditions"])


def _adjustment(results: Mapping[str, Any]) -> Iterable[str]:
    yield _heading(f"Adjusted {results['level']}")
    yield from _groups(results)
    yield _figure(
        lambda figure: _draw_groups(figure, results), 640, 60 + 36 * len(results["groups"])
    )
    yield from _comparison(results["comparison"], results["conditions"])


def _groups(results: Mapping[str, Any]) -> Iterable[str]:
    yield _table(
        ["condition", "participants", "mean", "interval", "standard deviation"],
        [
            [
                group["condition"],
                str(group["participants"]),
                _number(group["mean"]),
                _interval(group, _number),
                _number(group["deviation"]),
            ]
            for group in results["groups"]
        ],
    )


def _rating(results: Mapping[str, Any]) -> Iterable[str]:
    for scale in results["scales"]:
        yield _heading(f"{scale['text']} (1 to {scale['steps']})")
        yield _table(
            ["condition", "answers", "median", "quartiles", "mean"],
            [
                [
                    row["condition"],
                    str(row["answers"]),
                    _number(row["median"]),
                    _interval(row, _number),
                    _number(row["mean"]),
                ]
                for row in scale["conditions"]
            ],
        )
        names = [row["condition"] for row in scale["conditions"]]
        yield from _comparison(scale["comparison"], names)


def _identification(results: Mapping[str, Any]) -> Iterable[str]:
    correct, names = results["correct"], results["answers"]
    yield _heading("Identification")
    yield _paragraph(
        f"{correct['successes']} of {correct['total']} right: {_percent(correct['share'])} "
        f"({_interval(correct, _percent)}); chance is {_percent(results['chance'])}, p "
        f"{_p(correct['p'])}. Transmitted information: {_number(results['information_bits'])} bits "
        f"of {math.log2(len(names)):.2f}."
    )
    yield _table(
        ["felt / answered", *names, "right", "interval"],
        [
            [name, *map(str, row), _percent(share["share"]), _interval(share, _percent)]
            for name, row, share in zip(
                names, results["confusion"], results["by_answer"], strict=True
            )
        ],
    )
    yield _figure(lambda figure: _draw_confusion(figure, results), 480, 420)
    yield from _comparison(results["comparison"], results["conditions"])


def _tlx(tlx: Mapping[str, Any]) -> Iterable[str]:
    yield _heading("NASA-TLX")
    yield _table(
        ["scale", "mean", "interval"],
        [
            [name.replace("_", " "), _number(mean), f"{_number(low)} to {_number(high)}"]
            for name, (mean, low, high) in {**tlx["scales"], "raw TLX": tlx["raw_tlx"]}.items()
        ],
    )
    sums = ", ".join(f"{label}: {value:g}" for label, value in tlx["sums"].items())
    yield _note(f"0 to 100, without weights. Sums of the six scales: {sums or 'none'}.")


def _comparison(comparison: Mapping[str, Any] | None, names: Sequence[str]) -> Iterable[str]:
    """Yield Friedman's and Wilcoxon's tests; nothing for a single condition."""
    if comparison is None:
        return
    count = comparison["participants"]
    if not math.isnan(comparison["p"]):
        yield _paragraph(
            f"Friedman's test of {count} participants: chi-squared {comparison['statistic']:.2f}, "
            f"{len(names) - 1} degrees of freedom, p {_p(comparison['p'])}; Kendall's W "
            f"{comparison['w']:.2f}."
        )
    if comparison["pairs"]:
        yield _table(
            ["conditions", "median difference", "p (Wilcoxon)", "p (Holm)"],
            [
                [
                    f"{names[pair['first']]} : {names[pair['second']]}",
                    _number(pair["difference"]),
                    _p(pair["p"]),
                    _p(pair["p_holm"]),
                ]
                for pair in comparison["pairs"]
            ],
        )


def _draw_strengths(figure: Figure, names: Sequence[str], model: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    places = np.arange(len(names))
    errors = 1.959964 * np.array(model["errors"])
    axes.errorbar(model["strengths"], places, xerr=errors, fmt="o", capsize=4)
    axes.set_yticks(places, [printable(name) for name in names])
    axes.invert_yaxis()
    axes.set_xlabel("strength (logarithm of odds)")


def _draw_groups(figure: Figure, results: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    groups = results["groups"]
    places = np.arange(len(groups))
    means = np.array([group["mean"] for group in groups])
    lows = np.array([group["low"] for group in groups])
    axes.errorbar(means, places, xerr=np.nan_to_num(means - lows), fmt="o", capsize=4)
    axes.set_yticks(places, [printable(group["condition"]) for group in groups])
    axes.invert_yaxis()
    axes.set_xlabel(printable(results["level"]))


def _draw_functions(figure: Figure, results: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    names = results["conditions"]
    for fit in results["fits"]:
        colour = f"C{names.index(fit['condition']) % 10}"
        counts = fit["counts"]
        levels = np.array([x for x, _, _ in counts])
        answered = np.array([n for _, _, n in counts])
        shares = np.array([y for _, y, _ in counts]) / answered
        axes.scatter(levels, shares, s=4.0 + 2.0 * answered, color=colour, alpha=0.5)
        fields = Fit.__dataclass_fields__
        function = Fit(**{name: fit[name] for name in fields})
        ends = levels.min(), levels.max()
        if function.is_logarithmic:
            axes.set_xscale("log")
            x = np.geomspace(*ends, 100)
        else:
            x = np.linspace(*ends, 100)
        axes.plot(x, [function.share(level) for level in x.tolist()], color=colour, linewidth=1.0)
    for k, name in enumerate(names[:10]):
        axes.plot([], [], color=f"C{k}", label=printable(name))
    axes.legend(loc="lower right")
    axes.set_xlabel(printable(results["level"]))
    axes.set_ylabel("share of answers for the target")
    axes.set_ylim(-0.03, 1.03)


def _draw_confusion(figure: Figure, results: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    names = [printable(name) for name in results["answers"]]
    table = np.array(results["confusion"], np.float64)
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), share in np.ndenumerate(shares):
        colour = "white" if share > 0.6 else "black"
        axes.text(column, row, f"{100.0 * share:.0f}", ha="center", va="center", color=colour)
    places = np.arange(len(names))
    axes.set_xticks(places, names, rotation=30, ha="right")
    axes.set_yticks(places, names)
    axes.set_xlabel("answered, % of the row")
    axes.set_ylabel("felt")


def _figure(draw: Callable[[Figure], None], width: float, height: float) -> str:
    """Plot as an SVG in the page."""
    with temporary_folder() as folder:
        path = Path(folder) / "plot.svg"
        with chart(path, width, height) as figure:
            draw(figure)
        text = path.read_text(encoding="utf-8")
    return f"<figure>{text[text.index('<svg') :]}</figure>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["<table><tr>" + "".join(f"<th>{_text(head)}</th>" for head in heads) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])


def _heading(text: str) -> str:
    return f"<h2>{_text(text)}</h2>"


def _paragraph(text: str) -> str:
    return f"<p>{_text(text)}</p>"


def _note(text: str) -> str:
    return f'<p class="note">{_text(text)}</p>'


def _text(text: str) -> str:
    return html.escape(printable(text))


def _number(value: float) -> str:
    return _NAN if math.isnan(value) else f"{value:.4g}"


def _percent(share: float) -> str:
    return _NAN if math.isnan(share) else f"{100.0 * share:.1f} %"


def _interval(row: Mapping[str, Any], shown: Callable[[float], str]) -> str:
    return f"{shown(row['low'])} to {shown(row['high'])}"


def _p(value: float) -> str:
    if math.isnan(value):
        return _NAN
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"
