# SPDX-License-Identifier: GPL-3.0-or-later
"""Metadata hook of hatchling: the description of a package, for PyPI.

The description is the README, with the installation of a published package instead of commands of
a clone. PyPI shows pictures and follows links of whole addresses only. The environment variable
``HFX_REPOSITORY``, as ``https://github.com/OWNER/NAME``, is the address of the repository that has
the files of the version's tag; without the variable the description has neither.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)")  # relative links and pictures


class ReadmeHook(MetadataHookInterface):
    """Hook that sets ``readme``."""

    def update(self, metadata: dict[str, Any]) -> None:
        root = Path(self.root)
        text = description(
            (root / "README.md").read_text(encoding="utf-8"),
            (root / "release" / "pypi_install.md").read_text(encoding="utf-8"),
        )
        repository = os.environ.get("HFX_REPOSITORY", "")
        if repository:
            text = with_addresses(text, repository.rstrip("/"), f"v{metadata['version']}")
        else:
            text = without_links(text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def description(readme: str, installation: str) -> str:
    """Replace the section *Install* of the README, up to its table of Blenders."""
    head, _, rest = readme.partition("## Install\n")
    _, _, table = rest.partition("<!-- blender range -->\n")
    return f"{head}{installation}### Supported Blenders\n\n{table.replace('<!-- end -->', '')}"


def with_addresses(text: str, repository: str, tag: str) -> str:
    """Turn relative links of a Markdown text into addresses of a repository's files at a tag."""

    def replaced(match: re.Match[str]) -> str:
        mark, caption, path = match.groups()
        kind = "raw" if mark else "blob"
        return f"{mark}[{caption}]({repository}/{kind}/{tag}/{path})"

    return _LINK.sub(replaced, text)


def without_links(text: str) -> str:
    """Remove relative pictures of a Markdown text, and turn relative links into their captions."""
    return _LINK.sub(lambda match: "" if match[1] else match[2], text)
