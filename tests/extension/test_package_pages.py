# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages of each package of a release: links and named files are in the same package."""

from __future__ import annotations

import posixpath
import re
import tarfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import build_addon
from release import godot_zip, links, make, unity_package

_PATH = re.compile(r"(?<![$\w./~-])(?:[\w.~-]+/)+[\w.-]+\.\w{1,12}")


def dead_ends(files: Mapping[str, str]) -> list[str]:
    """Relative links, and paths in code of the text, without a file in the package.

    Parameters
    ----------
    files : mapping of str to str
        Name in the package -> text; the text of files that are no page does not matter. Paths in a
        paragraph that names the repository are not checked.
    """
    folders = {name[:k] for name in files for k, letter in enumerate(name) if letter == "/"}
    dead = []
    for page, text in files.items():
        if not page.endswith(".md"):
            continue
        place = posixpath.dirname(page)
        for link in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"\w+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = posixpath.normpath(posixpath.join(place, path)) if path else page
            if target not in files.keys() | folders:
                dead.append(f"{page}: {link}")
            elif anchor and anchor not in _anchors(files.get(target, "")):
                dead.append(f"{page}: {link}")
        for paragraph in re.split(r"\n\s*\n|\n(?=\d\. |- )", text):
            if "repository" in paragraph:
                continue
            paragraph = re.sub(r"\w+://\S+", "", paragraph)
            for code in re.findall(r"`([^`\n]+)`|^    (.+)$", paragraph, re.MULTILINE):
                for path in _PATH.findall(code[0] or code[1]):
                    places = {posixpath.normpath(posixpath.join(p, path)) for p in (place, "")}
                    if not places & files.keys() and not path.startswith("build/"):
                        dead.append(f"{page}: {path}")
    return dead


def _anchors(text: str) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).strip().replace(" ", "-") for line in headings}


def _text(content: bytes) -> str:
    return content.decode("utf-8", "replace")


def _godot(_folder: Path) -> dict[str, str]:
    return {name: _text(path.read_bytes()) for name, path in godot_zip.files().items()}


def _unity(_folder: Path) -> dict[str, str]:
    return {name: _text(content) for name, content in unity_package.package_files().items()}


def _extension(_folder: Path) -> dict[str, str]:
    return {name: _text(path.read_bytes()) for name, path in build_addon.files().items()}


def _core(folder: Path) -> dict[str, str]:
    with zipfile.ZipFile(make.core_package(folder)) as archive:
        return {name: _text(archive.read(name)) for name in archive.namelist()}


def _web(folder: Path) -> dict[str, str]:
    result = {}
    with tarfile.open(make.web_package(folder)) as tar:
        for entry in tar:
            file = tar.extractfile(entry)
            assert file is not None
            result[entry.name.removeprefix("package/")] = _text(file.read())
    return result


@pytest.mark.parametrize("package", [_godot, _unity, _extension, _core, _web])
def test_each_link_of_a_package_leads_to_a_file_inside(
    package: Callable[[Path], dict[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in for the compiler writes the web package's three files."""

    def compiled(*command: object) -> None:
        for name in ("hfx.js", "garage.html", "board.html"):
            Path(str(command[-1]), name).write_text("", encoding="utf-8")

    monkeypatch.setattr(make, "_run", compiled)
    files = package(tmp_path)
    assert any(name.endswith(".md") for name in files) or package is _extension
    assert dead_ends(files) == []


def test_dead_ends_of_a_package_are_found() -> None:
    page = (
        "# One Two\n[a](other.md) [b](#one-two) [c](#three) [d](https://e.org/f.md) [g](sub)\n\n"
        "Open `sub/x.py` and `sub/y.py`.\n\n    python sub/z.py\n\nIn the repository: `no/w.py`.\n"
    )
    files = {"page.md": page, "sub/x.py": "", "sub/page.md": "[up](../page.md#one-two) [h](x.md)"}
    assert dead_ends(files) == [
        "page.md: other.md",
        "page.md: #three",
        "page.md: sub/y.py",
        "page.md: sub/z.py",
        "sub/page.md: x.md",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("See [the page](a.md#b).", "See the page."),
        ("One.\n\n[Guide](a.md)\n\nTwo.", "One.\n\nTwo."),
        ("Notes are no warnings. [Guide](a.md)", "Notes are no warnings."),
        ("[All](a.md). [Numbers](b.md): units.", "Numbers: units."),
        ("![picture\nof a](a.png)\n\nText", "Text"),
        ("[web](https://e.org) and [part](#part)", "[web](https://e.org) and [part](#part)"),
        ("| [a](a.md), [b](b.md) |", "| a, b |"),
        ("    code\n\n    [x](y.md) z", "    code\n\n    x z"),
    ],
)
def test_a_page_without_relative_links_reads_as_text(text: str, expected: str) -> None:
    assert links.without_links(text) == expected
