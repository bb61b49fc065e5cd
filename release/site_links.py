# SPDX-License-Identifier: GPL-3.0-or-later
"""Hook of mkdocs for links that leave ``docs/``, and for the site's map.

Linked pages and pictures of other folders become files of the site under their path in the
repository. Links to code and folders become text: the site has no copy of them. A map for search
engines needs the site's address.
"""

from __future__ import annotations

import os
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")
_QUICK_START = "quick-start.md"  # the README's name in the site: mkdocs takes README.md as an index
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_COPIED = (".md", ".png", ".svg", ".gif", ".webp")
_MAP = "sitemap.xml"


def on_files(files: Files, config: Any) -> Files:
    """Add pages of the root and all files that pages link to. Leave the map out if the site has no
    address: all entries of the map would be empty."""
    template = files.get_file_from_path(_MAP)
    if not config.site_url:
        config.theme.static_templates.discard(_MAP)
        if template is not None:  # not rendered, mkdocs would copy it
            files.remove(template)
    pending = [*PAGES, *(f"docs/{file.src_uri}" for file in files if file.is_documentation_page())]
    seen = set(pending)
    while pending:
        path = pending.pop()
        source = ROOT / path
        if not path.startswith("docs/"):
            file = File.generated(config, _site_uri(path), abs_src_path=str(source))
            file.inclusion = InclusionLevel.NOT_IN_NAV if "/" in path else InclusionLevel.INCLUDED
            files.append(file)
        if path.endswith(".md"):
            for _, _, link in _LINK.findall(source.read_text(encoding="utf-8")):
                target = _in_repository(path, link)
                if target and target not in seen and target.endswith(_COPIED):
                    seen.add(target)
                    if not target.startswith("docs/"):
                        pending.append(target)
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links by repository into links by site."""
    uri = page.file.src_uri
    own = f"docs/{uri}" if (ROOT / "docs" / uri).is_file() else uri
    own = "README.md" if uri == _QUICK_START else own

    def replaced(match: re.Match[str]) -> str:
        mark, text, link = match.groups()
        target = _in_repository(own, link)
        if target is None:
            return match[0]
        site_uri = _site_uri(target)
        if files.get_file_from_path(site_uri) is None:
            return text
        place = posixpath.relpath(site_uri, posixpath.dirname(uri) or ".")
        _, mark_of_anchor, anchor = link.partition("#")
        return f"{mark}[{text}]({place}{mark_of_anchor}{anchor})"

    return _LINK.sub(replaced, markdown)


def _site_uri(path: str) -> str:
    return _QUICK_START if path == "README.md" else path.removeprefix("docs/")


def _in_repository(page: str, link: str) -> str | None:
    """Path of a link's existing target below the root; None for web addresses and anchors."""
    path = link.partition("#")[0]
    if not path or "://" in path or path.startswith("mailto:"):
        return None
    target = posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
    return target if os.path.exists(ROOT / target) else None
