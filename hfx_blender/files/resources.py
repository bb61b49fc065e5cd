# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of data: in a checkout, in an installed wheel, in an extension."""

import os
import sys
from pathlib import Path

from ..errors import HfxError

BODY_MODELS_VARIABLE = "HFX_BODY_MODELS"
DEVICES_VARIABLE = "HFX_DEVICES"
EFFECTS_VARIABLE = "HFX_EFFECTS"
USER_DATA_VARIABLE = "HFX_USER_DATA"

_PACKAGE = Path(__file__).resolve().parents[1]


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


def effect_library() -> Path:
    """Folder of the shipped sensations."""
    return _data_folder("effect_library")


def user_body_models() -> Path:
    """Folder of the sets of body models that the user has installed; it need not exist.

    The environment variable ``HFX_BODY_MODELS`` names another one.
    """
    return _named_by(BODY_MODELS_VARIABLE) or _user_data() / "body_models"


def user_devices() -> Path:
    """Folder of the user's own device configurations and scripts; it need not exist.

    The environment variable ``HFX_DEVICES`` names another one.
    """
    return _named_by(DEVICES_VARIABLE) or _user_data() / "devices"


def user_effects() -> Path:
    """Folder of the user's own sensations; it need not exist.

    The environment variable ``HFX_EFFECTS`` names another one.
    """
    return _named_by(EFFECTS_VARIABLE) or _user_data() / "effects"


def approved_scripts() -> Path:
    """File of the approved device scripts; it need not exist."""
    return _user_data() / "approved_scripts.json"


def time_on() -> Path:
    """Folder that remembers how long devices were on; it need not exist."""
    return _user_data() / "time_on"


def live_settings() -> Path:
    """File that remembers how the user's devices are connected; it need not exist."""
    return _user_data() / "live_devices.json"


def saved_areas() -> Path:
    """File of the user's own painted areas; it need not exist."""
    return _user_data() / "areas.json"


def surface_calibration() -> Path:
    """File of the calibrated strength of surfaces, per device; it need not exist."""
    return _user_data() / "surface_calibration.json"


def kept_fits() -> Path:
    """Folder of the fits to the user's avatars, which may be deleted; it need not exist."""
    return _user_data() / "fits"


def _user_data() -> Path:
    """Folder for our user data by the platform's convention, or by the variable
    ``HFX_USER_DATA``.
    """
    if named := _named_by(USER_DATA_VARIABLE):
        return named
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA") or _home() / "AppData" / "Roaming") / "hfx"
    if sys.platform == "darwin":
        return _home() / "Library" / "Application Support" / "hfx"
    return Path(os.environ.get("XDG_DATA_HOME") or _home() / ".local" / "share") / "hfx"


def _named_by(variable: str) -> Path | None:
    """Folder that an environment variable names; None where it is not set, or empty."""
    named = os.environ.get(variable)
    return Path(os.path.expanduser(named)) if named else None


def _home() -> Path:
    """The user's home folder; one that does not exist where the user has none (containers)."""
    try:
        return Path.home()
    except RuntimeError:
        return Path(os.sep).absolute() / "nonexistent"
