# SPDX-License-Identifier: GPL-3.0-or-later
"""Relative links of Markdown pages that leave the repository inside a package."""

from __future__ import annotations

import re

# Relative links and pictures: no address of the web, no heading of the same page.
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)")
# A sentence that is one relative link, at the beginning of a paragraph or after another sentence.
_SENTENCE = re.compile(rf"\A{_LINK.pattern}(?:\.\s*|\Z)|(?<=[.!?])\s+{_LINK.pattern}(?:\.|\Z)")


def with_addresses(text: str, repository: str, tag: str) -> str:
    """Turn relative links of a Markdown text into addresses of a repository's files at a tag."""

    def replaced(match: re.Match[str]) -> str:
        mark, caption, path = match.groups()
        kind = "raw" if mark else "blob"
        return f"{mark}[{caption}]({repository}/{kind}/{tag}/{path})"

    return _LINK.sub(replaced, text)


def without_links(text: str) -> str:
    """Remove relative pictures and sentences that are one relative link, and turn other relative
    links of a Markdown text into their captions."""
    paragraphs = [_SENTENCE.sub("", paragraph) for paragraph in text.split("\n\n")]
    paragraphs = [
        _LINK.sub(lambda match: "" if match[1] else match[2], paragraph)
        for paragraph in paragraphs
        if paragraph.strip()
    ]
    return "\n\n".join(paragraphs)
