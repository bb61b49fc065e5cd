# SPDX-License-Identifier: GPL-3.0-or-later
"""C sources beside this file, and their digest; uses the standard library only."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).with_name("source")
MARK: Final = "hfx_native"
"""First word of a library's description of its sources; the digest is the second. The module of a
wheel is named after both."""


def files(folder: Path = FOLDER) -> list[Path]:
    """Files that a library is built from, sorted: sources, headers, the compiler's options."""
    return sorted(path for end in ("*.c", "*.h", "flags.txt") for path in folder.glob(end))


def digest() -> str | None:
    """Digest of the sources, 16 hexadecimal digits; None without sources."""
    found = hashlib.sha256()
    paths = files()
    for path in paths:
        text = path.read_bytes().replace(b"\r\n", b"\n")  # git's line ends on Windows
        found.update(b"%s\0%d\0%s" % (path.name.encode(), len(text), text))
    return found.hexdigest()[:16] if paths else None
