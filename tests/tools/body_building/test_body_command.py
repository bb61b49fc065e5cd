# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body``: refusals, listings, and output folders."""

from __future__ import annotations

import argparse
import io
import json
import shutil
from pathlib import Path
from typing import Any

import body_sets
import pytest

from hfx_blender.commands.console import Console
from hfx_blender.engine.body import levels_and_cells as level_files
from hfx_blender.errors import HfxError, InputError, UsageError
from hfx_blender.files import resources
from hfx_tools.body_building import build, variant_models
from hfx_tools.commands import body


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HFX_BODY_MODELS", str(tmp_path / "own"))
    return tmp_path / "own"


def run(*words: object) -> tuple[str, str]:
    """Return text of standard output and standard error."""
    parser = argparse.ArgumentParser()
    body.add_parser(parser.add_subparsers())
    options = parser.parse_args(["body", *map(str, words)])
    out, err = io.StringIO(), io.StringIO()
    assert options.run(options, Console(as_json=options.json, out=out, err=err)) == 0
    return out.getvalue(), err.getvalue()


@pytest.mark.parametrize(
    ("words", "message"),
    (
        (["--variant", "age=8", "--targets", "table1"], "remove --targets, --age, --joint-"),
        (["--variant", "age=8", "--method", "quadric"], "--joint-gradient and --method"),
        (["--variant", "age=8"], "--variant needs a separate folder"),
        (["--method", "quadric"], "--method quadric needs a separate folder"),
        (["--targets", "table1"], "--targets needs a separate folder"),
        (["--variant", "age=8", "--age", "70"], "remove --targets, --age, --joint-gradient"),
        (["--variant", "age=8", "--joint-gradient", "1"], "--joint-gradient and --method"),
        (["--age", "70"], "--age needs a separate folder"),
        (["--joint-gradient", "0.7"], "--joint-gradient needs a separate folder"),
        (["--joint-gradient", "0.7", "--method", "quadric"], "allowed is --method cells"),
        (["--install"], "--variant, --targets, --age, --joint-gradient or --method"),
        (["--joint-gradient", "1", "--install"], "are installed already"),
        (["--variant", "age=8", "--install", "-o", "x"], "remove -o DIR"),
        (["--variant", "age=8", "--install", "../x"], "expected a plain name"),
        (["--variant", "age=8", "--install", ".x"], "expected a plain name"),
        (["--levels", "--variant", "age=8"], "--levels allows only -o DIR"),
        (["--levels", "--joint-gradient", "0.7"], "--levels allows only -o DIR"),
    ),
)  # fmt: skip
def test_conflicting_options_are_refused(own: Path, words: list[str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        run("build", *words)
    assert not own.exists()


@pytest.mark.parametrize(
    ("words", "name"),
    (
        (["--variant", "height=1.8", "--install"], None),
        (["--variant", "height=1.8", "--install", "Grandma +1"], "Grandma +1"),
        (["--targets", "table1", "--install"], "table1"),
        (["--joint-gradient", "0.7", "--install"], "literature-joints-0.7"),
        (["--joint-gradient", "0.7", "--age", "70", "--install"], "literature-age-70-joints-0.7"),
        (["--method", "quadric", "--install"], "literature-quadric"),
        (["--method", "quadric", "--targets", "table1", "--install"], "table1-quadric"),
    ),
)
def test_a_set_is_installed_under_its_name(
    own: Path, words: list[str], name: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[Any] = []

    def build_nothing(_source: Any, folder: Path, *rest: Any) -> dict[str, Any]:
        requests.append((folder, rest))
        return {"models": {}}

    monkeypatch.setattr(build, "build", build_nothing)
    monkeypatch.setattr(variant_models, "build", build_nothing)
    said, _ = run("build", *words)
    folder, rest = requests[0]
    assert folder.parent == own and str(folder) in said
    assert folder.name == (name or f"variant-{rest[0].suffix[1:]}")


def test_stats_lists_levels_and_installed_models(own: Path) -> None:
    text, err = run("stats")
    assert not err and f"No user models in {own}" in text
    assert "pressure, levels of detail: 19210, 4803, 1201 vertices" in text
    body_sets.scaled_variant(own / "Eve", "+0badcafe", 0.9)
    text, err = run("stats")
    assert not err
    for name in ("avatar", "pressure", "vibration", "temperature"):
        line = next(line for line in text.splitlines() if f"hfx-{name}-1+0badcafe" in line)
        assert line.endswith(str(own / "Eve"))
    document = json.loads(run("stats", "--json")[0])
    assert [item["id"] for item in document["installed"]][1] == "hfx-pressure-1+0badcafe"
    assert document["levels"]["vibration"][0] == 41067 and len(document["parts"]) == 33
    named, _ = run("stats", "Eve")
    assert "6.75" in named.splitlines()[1]  # of the head, 0.9 times 7.5


def test_stats_reports_unusable_sets(own: Path) -> None:
    (own / "broken").mkdir(parents=True)
    (own / "broken" / "manifest.json").write_text("{")
    text, err = run("stats")
    assert "broken" in err and "cannot be read as an index" in err
    assert "pressure" in text


def test_the_comparison_has_both_ways_and_their_times(own: Path) -> None:
    text, _ = run("stats", "--compare")
    compared = text[text.index("Left half of the body") :]
    assert compared.count("processor time") == compared.count("all  ") == 3
    with pytest.raises(UsageError, match="--compare is for the shipped models"):
        run("stats", own, "--compare")


def test_levels_are_made_for_the_models_of_a_folder(own: Path, tmp_path: Path) -> None:
    for name in ("manifest.json", "pressure.npz", "vibration.npz", "temperature.npz"):
        shutil.copy(resources.body_models() / name, tmp_path)
    said, _ = run("build", "--levels", "-o", tmp_path)
    assert said.splitlines() == [
        "pressure: 2 levels",
        "vibration: 2 levels",
        "temperature: no levels",
    ]
    owner, levels = level_files.read_levels(tmp_path / "pressure-levels.npz")
    assert owner[0] == "hfx-pressure-1" and len(levels) == 2
    with pytest.raises(InputError, match=r"manifest\.json: there is no such file"):
        run("build", "--levels", "-o", tmp_path / "nowhere")


def test_a_folder_without_models_is_reported(own: Path, tmp_path: Path) -> None:
    with pytest.raises(HfxError, match="holds no body model"):
        run("stats", tmp_path)
