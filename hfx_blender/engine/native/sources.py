# SPDX-License-Identifier: GPL-3.0-or-later
"""C sources of the library and their digest; imports the standard library only, for the build."""

import hashlib
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).with_name("source")
MARK: Final = "hfx_native"
"""First word of a library's build description, before the digest; a wheel's module is named after
both."""


def files(folder: Path = FOLDER) -> list[Path]:
    """Files that determine the library, sorted: sources, headers and compiler options."""
    return sorted(path for end in ("*.c", "*.h", "flags.txt") for path in folder.glob(end))


def digest() -> str | None:
    """Digest of the sources, 16 hexadecimal digits; None without sources. CRLF counts as LF, as git
    may convert line ends."""
    hasher = hashlib.sha256()
    paths = files()
    for path in paths:
        text = path.read_bytes().replace(b"\r\n", b"\n")
        hasher.update(b"%s\0%d\0%s" % (path.name.encode(), len(text), text))
    return hasher.hexdigest()[:16] if paths else None
