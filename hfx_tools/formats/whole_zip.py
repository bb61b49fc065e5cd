# SPDX-License-Identifier: GPL-3.0-or-later
"""Bytes outside of a ZIP archive, which its readers ignore."""

from __future__ import annotations

import os
import zipfile
from typing import BinaryIO, Final

_END: Final = b"PK\x05\x06"  # begins the last record of an archive
_END_BYTES: Final = 22  # size of this record without the comment


def excess_of(archive: zipfile.ZipFile, file: BinaryIO) -> str:
    """Clause about bytes before the first entry or after the end of an archive in ``file``, as of
    a doubled file; empty without any. Moves the position of ``file``."""
    first = min((entry.header_offset for entry in archive.infolist()), default=0)
    if first:
        return f"{first:,} bytes come before it"
    file.seek(-_END_BYTES - len(archive.comment), os.SEEK_END)
    return "" if file.read(len(_END)) == _END else "further bytes follow its end"
