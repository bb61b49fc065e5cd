# SPDX-License-Identifier: GPL-3.0-or-later
"""Add-on preferences: custom colours, user folders, and the devices found there."""

import os

import bpy
from bpy.props import FloatVectorProperty, StringProperty

from ..blender.translation import translated
from ..engine.modality import MODALITIES
from ..files import resources

_ADDON = (__package__ or "").rpartition(".")[0]  # Blender's name of this extension
_COLD = "cold"
_FOLDERS = {
    "effects_folder": (resources.EFFECTS_VARIABLE, resources.user_effects),
    "devices_folder": (resources.DEVICES_VARIABLE, resources.user_devices),
    "body_models_folder": (resources.BODY_MODELS_VARIABLE, resources.user_body_models),
}
"""Environment variables of the folders, inherited by helper processes, and the folders in use."""

_initial_values: dict[str, str | None] = {}


def _colour(label: str, default: tuple[float, float, float]) -> FloatVectorProperty:
    return FloatVectorProperty(
        name=label,
        description=f"Colour of {label.lower()} in scenes with the palette My Colours",
        subtype="COLOR_GAMMA",
        size=3,
        min=0.0,
        max=1.0,
        default=default,
        update=lambda self, _context: self.apply_colours(),
    )


def _folder(label: str, tip: str) -> StringProperty:
    return StringProperty(
        name=label,
        description=f"{tip}. Empty: the default folder",
        subtype="DIR_PATH",
        update=lambda self, _context: self.apply_folders(),
    )


class HfxPreferences(bpy.types.AddonPreferences):
    """Preferences of the user, independent of the open file."""

    bl_idname = _ADDON

    # Defaults of the palette "Warm and Cold", copied, as importing its module needs numpy.
    vibration: _colour("Vibration", (0.9, 0.05, 0.05))
    pressure: _colour("Pressure", (0.05, 0.65, 0.08))
    temperature: _colour("Warmth", (1.0, 0.45, 0.0))
    cold: _colour("Cold", (0.1, 0.45, 1.0))
    wind: _colour("Wind", (0.1, 0.7, 0.75))

    effects_folder: _folder(
        "Effects", "Folder of your own sensations, listed in Add > Haptic > Sensation"
    )
    devices_folder: _folder("Devices", "Folder of your own device configurations")
    body_models_folder: _folder("Body Models", "Folder of your own sets of body models")

    def draw(self, _context: bpy.types.Context) -> None:
        from ..devices.live import approval

        layout = self.layout
        layout.operator("hfx.copy_system_information", icon="COPYDOWN")
        layout.label(text="My Colours (palette of a scene in the HFX tab)", icon="COLOR")
        row = layout.row()
        for name in (*MODALITIES, _COLD):
            column = row.column()
            column.label(text=self.bl_rna.properties[name].name)
            column.prop(self, name, text="")
        column = layout.column()
        column.label(text="Folders", icon="FILE_FOLDER")
        column.use_property_split = True
        for name, (_, folder_in_use) in _FOLDERS.items():
            folder = folder_in_use()
            row = column.row()
            row.prop(self, name, placeholder=str(folder))
            button = row.row()
            button.enabled = folder.is_dir()
            button.operator("wm.path_open", text="", icon="WINDOW").filepath = str(folder)
        devices = sorted(path.stem for path in resources.user_devices().glob("*.json"))
        names = (
            ", ".join(devices) or "none yet; Import Node Map or Layout in Live Devices adds some"
        )
        layout.label(text=translated(f"Your own devices: {names}"), icon="OUTLINER_OB_FORCE_FIELD")
        column = layout.column()
        column.label(text="Approved Device Scripts", icon="FILE_SCRIPT")
        fault, scripts = approval.fault_of_list(), approval.approved()
        if fault or not scripts:
            column.label(text=translated(fault or "none"), icon="ERROR" if fault else "NONE")
        for fingerprint, path in sorted(scripts.items(), key=lambda item: item[1]):
            row = column.row()
            row.label(text=f"{path}  ({fingerprint[:12]})")
            row.operator("hfx.live_revoke", text="", icon="X").fingerprint = fingerprint

    def apply_colours(self) -> None:
        """Set the palette "My Colours" to the colours of the preferences."""
        from ..engine import colouring

        chosen = {name: tuple(getattr(self, name)) for name in (*MODALITIES, _COLD)}
        colouring.set_own_palette(chosen)

    def apply_folders(self) -> None:
        """Set the environment variables of the search folders; "" restores the initial value."""
        for name, (variable, _) in _FOLDERS.items():
            # The value before the add-on is restored when a preference is cleared.
            _initial_values.setdefault(variable, os.environ.get(variable))
            folder = getattr(self, name)
            value = bpy.path.abspath(folder) if folder else _initial_values[variable]
            if value is None:
                os.environ.pop(variable, None)
            else:
                os.environ[variable] = value


def preferences() -> HfxPreferences | None:
    """Preferences of this extension; None if it is not enabled, as in a script."""
    addon = bpy.context.preferences.addons.get(_ADDON)
    return None if addon is None else addon.preferences


def register() -> None:
    bpy.utils.register_class(HfxPreferences)
    user = preferences()
    if user is not None:
        user.apply_folders()
        # Untouched colours need no palette, whose module would load numpy at Blender's start.
        if any(user.is_property_set(name) for name in (*MODALITIES, _COLD)):
            user.apply_colours()


def unregister() -> None:
    for variable, value in _initial_values.items():
        if value is None:
            os.environ.pop(variable, None)
        else:
            os.environ[variable] = value
    _initial_values.clear()
    bpy.utils.unregister_class(HfxPreferences)
