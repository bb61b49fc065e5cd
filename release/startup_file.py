# SPDX-License-Identifier: GPL-3.0-or-later
"""The file that has Python clean ``sys.path`` before the script ``hfx`` imports anything.

The scripts that pip makes import ``re`` and this package first. With ``PYTHONPATH=.`` these would
be a stranger's, if there are any in the current folder. A .pth file is read before that.
"""

from __future__ import annotations

from pathlib import Path

NAME = "_hfx_import_path.pth"  # read in the order of names: before setuptools' own

_SOURCE = Path(__file__).resolve().parents[1] / "hfx_blender" / "processes" / "import_path.py"
_LINE = (
    'import sys; "hfx" in "".join(sys.orig_argv[1:3]) and exec({source!r}, {{"__name__": ""}})\n'
)


def text() -> str:
    """Text of the file: one line, which does nothing unless Python runs ``hfx``."""
    return _LINE.format(source=_SOURCE.read_text(encoding="utf-8"))
