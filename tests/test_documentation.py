# SPDX-License-Identifier: GPL-3.0-or-later
"""File and folder names in the documentation of the code exist."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hfx_blender.engine.body import model_library
from hfx_tools.body_building import stats, thresholds

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hfx_blender"
PLACES = (ROOT, PACKAGE, ROOT / "docs")


def missing_names(text: str) -> list[str]:
    """Names in the form of project files or folders without a file."""
    matches = re.findall(r"[\w.-]+/[\w./-]*|\b\w+\.(?:py|c|h)\b", text)
    names = {name.strip(".,") for name in matches}
    known = {name for name in names if re.search(r"\.(py|json|md|c|h)$|/$", name)}
    return sorted(
        name for name in known if not any((position / name).exists() for position in PLACES)
    )


@pytest.mark.parametrize("name", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_each_file_that_is_named_exists(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"https?:\S+", "", text)
    assert len(re.findall(r"`[^`]+/", text)) > 10
    assert missing_names(text) == []


PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *(
        path
        for path in sorted((ROOT / "players").rglob("*.md"))
        if not {"node_modules", "target"} & set(path.parts)
    ),
]


def broken_links(page: Path) -> list[str]:
    """Relative links of a page without a file, or without the heading that the link names."""
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    return broken


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and mkdocs make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", "-") for text in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_each_link_leads_somewhere(page: Path) -> None:
    assert broken_links(page) == []


def test_a_link_without_a_target_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One Two\n[a](#one-two) [b](#one) [c](page.md#one-two) [d](other.md)")
    assert broken_links(page) == ["#one", "other.md"]


def test_the_menu_of_the_site_lists_each_page_once() -> None:
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    listed = re.findall(r"^ +- (?:\w+: )?(\S+\.md)$", menu, re.MULTILINE)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    of_the_root = {"quick-start.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"}
    assert sorted(listed) == sorted(pages | of_the_root)


def test_python_files_that_the_compiled_part_names_exist() -> None:
    paths = [f"/{path.relative_to(ROOT).as_posix()}" for path in PACKAGE.rglob("*.py")]
    paths += [f"/release/{path.name}" for path in (ROOT / "release").glob("*.py")]
    named = {
        (source.name, name)
        for source in (PACKAGE / "engine" / "native" / "source").iterdir()
        for name in re.findall(r"[a-z][a-z_/]*\.py\b", source.read_text(encoding="utf-8"))
    }
    assert len(named) > 10
    missing = [pair for pair in named if not any(path.endswith(f"/{pair[1]}") for path in paths)]
    assert sorted(missing) == []


def test_a_name_that_does_not_exist_is_found() -> None:
    assert missing_names("see `engine/contact/no_such.py` and `engine/scene.py`") == [
        "engine/contact/no_such.py"
    ]


def test_files_of_devices_on_pages_name_shipped_devices_and_their_actuators() -> None:
    """Paths as ``out/scene/BODY/DEVICE/scene.BODY.DEVICE.ACTUATOR.ahap``."""
    named_actuators = 0
    for page in (ROOT / "docs").rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        for body, device, file in re.findall(r"out/scene/(\w+)/(\w+)/(\S+)", text):
            scene, of_body, of_device, *actuator, _ = file.split(".")
            assert (scene, of_body, of_device) == ("scene", body, device)
            path = ROOT / "device_configs" / f"{device}.json"
            known = [entry["id"] for entry in json.loads(path.read_text())["actuators"]]
            assert set(actuator) <= set(known), f"{page.name}: {file}"
            named_actuators += len(actuator)
    assert named_actuators > 0


def test_the_tables_of_body_models_are_those_of_the_manifest() -> None:
    page = (ROOT / "docs" / "body-models.md").read_text(encoding="utf-8")
    assert stats.as_markdown(model_library.manifest()) in page
    sole = "| foot sole | 464 | 10 | 10.01 | 0.138 | 7.27 | 0.41 | 16.1 (10.7) |"
    assert sole in page, "Table 1 stands as the paper prints it"
    assert thresholds.read("table1")["vibration"][-1] == 10.0, "and is not used there"


def test_counts_of_vertices_on_pages_are_those_of_the_shipped_models() -> None:
    counts = {
        model["modality"]: model["vertices"]
        for model in model_library.manifest()["models"].values()
    }
    actual = []
    for page in ("track-format.md", "following-an-avatar.md"):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        actual += re.findall(
            r"(vibration|pressure|temperature) (?:model, |\()([\d,]{3,}) vertices", text
        )
    assert len(actual) == 4
    assert [(name, count) for name, count in actual if count != f"{counts[name]:,}"] == []
