# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of files and folders in the documentation of the code exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hfx_blender"
PLACES = (ROOT, PACKAGE, PACKAGE / "devices" / "live", ROOT / "docs")


def missing_names(text: str) -> list[str]:
    """Names that look like files or folders of ours and are none."""
    found = re.findall(r"[\w.-]+/[\w./-]*|\b\w+\.py\b", text)
    names = {name.strip(".,") for name in found}
    known = {name for name in names if re.search(r"\.(py|json|md|h)$|/$", name)}
    return sorted(name for name in known if not any((place / name).exists() for place in PLACES))


@pytest.mark.parametrize("name", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_each_file_that_is_named_exists(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"https?:\S+", "", text)
    assert len(re.findall(r"`[^`]+/", text)) > 10
    assert missing_names(text) == []


def test_a_name_that_does_not_exist_is_found() -> None:
    assert missing_names("see `engine/contact/no_such.py` and `engine/scene.py`") == [
        "engine/contact/no_such.py"
    ]
