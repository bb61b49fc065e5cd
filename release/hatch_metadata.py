# SPDX-License-Identifier: GPL-3.0-or-later
"""Metadata hook of hatchling: the description of a package, for PyPI.

The description is the README, with the installation of a published package instead of commands of
a clone. PyPI shows pictures and follows links of whole addresses only. The environment variable
``HFX_REPOSITORY``, as ``https://github.com/OWNER/NAME``, is the address of the repository that has
the files of the version's tag; without the variable the description has neither, and no list of
pages.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release.links import with_addresses, without_links  # next to this file, not installed

_PAGES = re.compile(r"(?<=^## Documentation\n).*?(?=^## )", re.DOTALL | re.MULTILINE)
_SOURCES = """
The source distribution of this package (`.tar.gz`) has all pages: `docs/index.md` lists them.

"""


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
            text = without_links(_PAGES.sub(_SOURCES, text))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def description(readme: str, installation: str) -> str:
    """Replace the section *Install* of the README, up to its table of Blenders."""
    head, _, rest = readme.partition("## Install\n")
    _, _, table = rest.partition("<!-- blender range -->\n")
    return f"{head}{installation}### Supported Blenders\n\n{table.replace('<!-- end -->', '')}"
