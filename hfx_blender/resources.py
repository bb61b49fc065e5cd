# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the shipped data lies: in a checkout, in an installed wheel, in an extension."""

from pathlib import Path

from .errors import HfxError

_PACKAGE = Path(__file__).resolve().parent


def _data_folder(name: str) -> Path:
    # A wheel and an extension carry the data inside the package; a checkout beside it.
    for folder in (_PACKAGE / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise HfxError(
        f"The folder '{name}' is missing from this installation "
        f"(looked in {_PACKAGE} and beside it)."
    )


def body_models() -> Path:
    """Folder of the perceptual models, the avatar and their manifest."""
    return _data_folder("body_models")


def device_configs() -> Path:
    """Folder of the shipped device configurations."""
    return _data_folder("device_configs")
