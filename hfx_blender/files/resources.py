# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders and files of shipped data (checkout, wheel or extension) and of the user's data."""

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
    # Wheel and extension: inside the package. Checkout: next to the package.
    for folder in (_PACKAGE / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise HfxError(
        f"The folder '{name}' is missing from this installation "
        f"(looked in {_PACKAGE} and beside it)."
    )


def body_models() -> Path:
    """Folder of the shipped perceptual models, the avatar and their manifest."""
    return _data_folder("body_models")


def device_configs() -> Path:
    """Folder of the shipped device configurations."""
    return _data_folder("device_configs")


def effect_library() -> Path:
    """Folder of the shipped sensations."""
    return _data_folder("effect_library")


def user_body_models() -> Path:
    """Folder of installed body model sets, or the variable ``HFX_BODY_MODELS``; may be missing."""
    return _named_by(BODY_MODELS_VARIABLE) or _user_data() / "body_models"


def user_devices() -> Path:
    """Folder of the user's device configurations and scripts, or ``HFX_DEVICES``; may be absent."""
    return _named_by(DEVICES_VARIABLE) or _user_data() / "devices"


def user_effects() -> Path:
    """Folder of the user's sensations, or the variable ``HFX_EFFECTS``; may be missing."""
    return _named_by(EFFECTS_VARIABLE) or _user_data() / "effects"


def approved_scripts() -> Path:
    """File of approved device scripts; may be missing."""
    return _user_data() / "approved_scripts.json"


def time_on() -> Path:
    """Folder of the recorded on-times of devices; may be missing."""
    return _user_data() / "time_on"


def live_settings() -> Path:
    """File of the connection settings of live devices; may be missing."""
    return _user_data() / "live_devices.json"


def saved_areas() -> Path:
    """File of the user's painted areas; may be missing."""
    return _user_data() / "areas.json"


def profiles() -> Path:
    """Folder of the profiles of persons; may be missing."""
    return _user_data() / "profiles"


def surface_calibration() -> Path:
    """File of the calibrated surface strength of each device; may be missing."""
    return _user_data() / "surface_calibration.json"


def kept_fits() -> Path:
    """Cache folder of fits to the user's avatars; may be missing or deleted."""
    return _user_data() / "fits"


def _user_data() -> Path:
    """Folder of the user's data by the platform's convention, or the variable ``HFX_USER_DATA``."""
    if named := _named_by(USER_DATA_VARIABLE):
        return named
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA") or _home() / "AppData" / "Roaming") / "hfx"
    if sys.platform == "darwin":
        return _home() / "Library" / "Application Support" / "hfx"
    data = os.environ.get("XDG_DATA_HOME", "")  # its specification ignores a relative path
    return Path(data if os.path.isabs(data) else _home() / ".local" / "share") / "hfx"


def _named_by(variable: str) -> Path | None:
    """Folder in an environment variable; None for an unset or empty variable."""
    value = os.environ.get(variable)
    return Path(os.path.expanduser(value)) if value else None


def _home() -> Path:
    """Home folder of the user; a missing folder for users without a home (containers)."""
    try:
        return Path.home()
    except RuntimeError:
        return Path(os.sep).absolute() / "nonexistent"
