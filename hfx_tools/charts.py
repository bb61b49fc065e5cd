# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts as SVG, drawn by matplotlib."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hfx_blender.files.atomic import atomic_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SETTINGS: Final = {
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "font.size": 9.0,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "hfx",  # the same bytes for the same content
    "text.parse_math": False,  # a "$" in a name is a "$"
}
_PIXELS_PER_INCH: Final = 96


@contextmanager
def chart(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Context with an empty figure, written as SVG at the end, without the user's matplotlibrc.

    Names from files must be made :func:`~hfx_blender.text.printable` for XML.

    Parameters
    ----------
    path : Path
        Path of the SVG.
    width, height : float
        Pixels.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(), warnings.catch_warnings():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        # Browsers have the fonts for text in the SVG.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        size = width / _PIXELS_PER_INCH, height / _PIXELS_PER_INCH
        figure = Figure(size, layout="constrained")
        yield figure
        with atomic_file(path) as file:
            figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
