# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences of the extension: own colours, own folders, and the devices in them."""

from __future__ import annotations

import os

import bpy
from bpy.props import FloatVectorProperty, StringProperty

from ..engine.modality import MODALITIES
from ..files import resources

_ADDON = (__package__ or "").rpartition(".")[0]  # this extension, as Blender names it
_COLD = "cold"
_VARIABLES = {
    "effects_folder": resources.EFFECTS_VARIABLE,
    "devices_folder": resources.DEVICES_VARIABLE,
    "body_models_folder": resources.BODY_MODELS_VARIABLE,
}
"""Environment variables that name the folders: processes of ours are given them, too."""

_found_before: dict[str, str | None] = {}


def _recolour(self: HfxPreferences, _context: bpy.types.Context) -> None:
    self.take_colours()


def _refolder(self: HfxPreferences, _context: bpy.types.Context) -> None:
    self.take_folders()


def _colour(label: str, default: tuple[float, float, float]) -> FloatVectorProperty:
    return FloatVectorProperty(
        name=label,
        description=f"Colour of {label.lower()} where the colours of a scene are My Colours",
        subtype="COLOR_GAMMA",
        size=3,
        min=0.0,
        max=1.0,
        default=default,
        update=_recolour,
    )


def _folder(label: str, tip: str) -> StringProperty:
    return StringProperty(
        name=label,
        description=f"{tip}. Empty: the default folder",
        subtype="DIR_PATH",
        update=_refolder,
    )


class HfxPreferences(bpy.types.AddonPreferences):
    """Preferences of a user, independent of the open file."""

    bl_idname = _ADDON

    # Those of the palette "Warm and Cold", at first; its module needs numpy, which takes its time.
    vibration: _colour("Vibration", (0.9, 0.05, 0.05))
    pressure: _colour("Pressure", (0.05, 0.65, 0.08))
    temperature: _colour("Warmth", (1.0, 0.45, 0.0))
    cold: _colour("Cold", (0.1, 0.45, 1.0))
    wind: _colour("Wind", (0.1, 0.7, 0.75))

    effects_folder: _folder(
        "Effects", "Folder of your own sensations, which are listed in Add > Haptic > Sensation"
    )
    devices_folder: _folder("Devices", "Folder of your own device configurations")
    body_models_folder: _folder("Body Models", "Folder of your own sets of body models")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.label(text="My Colours (a scene chooses them in the HFX tab)", icon="COLOR")
        row = layout.row()
        for name in (*MODALITIES, _COLD):
            column = row.column()
            column.label(text=self.bl_rna.properties[name].name)
            column.prop(self, name, text="")
        column = layout.column()
        column.label(text="Folders", icon="FILE_FOLDER")
        column.use_property_split = True
        usual = {
            "effects_folder": resources.user_effects(),
            "devices_folder": resources.user_devices(),
            "body_models_folder": resources.user_body_models(),
        }
        for name, folder in usual.items():
            row = column.row()
            row.prop(self, name, placeholder=str(folder))
            button = row.row()
            button.enabled = folder.is_dir()
            button.operator("wm.path_open", text="", icon="WINDOW").filepath = str(folder)
        own = sorted(path.stem for path in resources.user_devices().glob("*.json"))
        names = ", ".join(own) or "none yet; Import Node Map or Layout in Live Devices adds some"
        layout.label(text=f"Your own devices: {names}", icon="OUTLINER_OB_FORCE_FIELD")

        _draw_scripts(layout)

    def take_colours(self) -> None:
        """Set the palette "My Colours" from the preferences."""
        from ..engine import colouring

        chosen = {name: tuple(getattr(self, name)) for name in (*MODALITIES, _COLD)}
        colouring.set_own_palette(chosen)

    def take_folders(self) -> None:
        """Set the folders to search, for this process and those that it starts."""
        for name, variable in _VARIABLES.items():
            _found_before.setdefault(variable, os.environ.get(variable))
            chosen = getattr(self, name)
            value = bpy.path.abspath(chosen) if chosen else _found_before[variable]
            if value is None:
                os.environ.pop(variable, None)
            else:
                os.environ[variable] = value


def _draw_scripts(layout: bpy.types.UILayout) -> None:
    """Draw the list of approved device scripts, with buttons to withdraw them."""
    from ..devices.live import approval

    column = layout.column()
    column.label(text="Approved Device Scripts", icon="FILE_SCRIPT")
    fault = approval.fault_of_list()
    found = approval.approved()
    if fault or not found:
        column.label(text=fault or "none", icon="ERROR" if fault else "NONE")
    for mark, path in sorted(found.items(), key=lambda each: each[1]):
        row = column.row()
        row.label(text=f"{path}  ({mark[:12]})")
        row.operator("hfx.live_revoke", text="", icon="X").fingerprint = mark


def preferences() -> HfxPreferences | None:
    """Preferences of the user; None where this is no installed extension, as in a script."""
    found = bpy.context.preferences.addons.get(_ADDON)
    return None if found is None else found.preferences


def register() -> None:
    bpy.utils.register_class(HfxPreferences)
    chosen = preferences()
    if chosen is not None:
        chosen.take_folders()
        if any(chosen.is_property_set(name) for name in (*MODALITIES, _COLD)):
            chosen.take_colours()


def unregister() -> None:
    for variable, value in _found_before.items():
        if value is None:
            os.environ.pop(variable, None)
        else:
            os.environ[variable] = value
    _found_before.clear()
    bpy.utils.unregister_class(HfxPreferences)
