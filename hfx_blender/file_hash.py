# SPDX-License-Identifier: GPL-3.0-or-later
"""What a file holds, as a hash."""

from __future__ import annotations

import errno
import hashlib
import os
from pathlib import Path


def sha256_of(path: Path) -> str:
    """SHA-256 of a file of any size, in hexadecimal digits.

    Raises
    ------
    OSError
        It cannot be read, or is no file with an end (a device, a pipe).
    """
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
