# SPDX-License-Identifier: GPL-3.0-or-later
"""Metadata hook of hatchling: the README as description of a package, for PyPI.

PyPI shows pictures and follows links of whole addresses only. The environment variable
``HFX_REPOSITORY``, as ``https://github.com/OWNER/NAME``, is the address of the repository that has
the files of the version's tag; without the variable links stay as they are.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class ReadmeHook(MetadataHookInterface):
    """Hook that sets ``readme``."""

    def update(self, metadata: dict[str, Any]) -> None:
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        repository = os.environ.get("HFX_REPOSITORY", "")
        if repository:
            text = with_addresses(text, repository.rstrip("/"), f"v{metadata['version']}")
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def with_addresses(text: str, repository: str, tag: str) -> str:
    """Turn relative links of a Markdown text into addresses of a repository's files at a tag."""

    def replaced(match: re.Match[str]) -> str:
        mark, caption, path = match.groups()
        kind = "raw" if mark else "blob"
        return f"{mark}[{caption}]({repository}/{kind}/{tag}/{path})"

    return re.sub(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)", replaced, text)
