# SPDX-License-Identifier: GPL-3.0-or-later
"""Base class of the panels in the sidebar's HFX tab, and rows that several panels draw."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ClassVar

import bpy
import bpy.utils.previews

from ..blender.translation import translated
from ..operators.shared import draw_wrapped


class HfxPanel:
    """Base of the panels in the HFX tab. A panel is hidden while its ``subject`` is None."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "HFX"
    subject: ClassVar[Callable[[bpy.types.Context], object]] = staticmethod(lambda context: context)
    """Function of the context for the object that the panel shows; by default never None."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls.subject(context) is not None


def draw_with_unit(layout: bpy.types.UILayout, data: object, name: str, text: str) -> None:
    """Draw a number with a label before its value, and the keyframe button."""
    row = layout.row(align=True)
    row.use_property_split = False  # split labels are too narrow for units
    row.prop(data, name, text=text)
    row.prop_decorator(data, name)


def draw_contact_law(layout: bpy.types.UILayout, hfx: bpy.types.PropertyGroup) -> None:
    """Draw the stiffness of a volume or surface and, above 0, damping and friction."""
    for name in ("stiffness", "damping", "friction")[: 3 if hfx.stiffness > 0.0 else 1]:
        draw_with_unit(layout, hfx, name, translated(hfx.bl_rna.properties[name].name))


def draw_text(
    context: bpy.types.Context,
    layout: bpy.types.UILayout,
    text: str,
    icon: str = "NONE",
    reserved: int = 0,
) -> None:
    """Draw a sentence wrapped to the sidebar's width, less ``reserved`` letters, with 20 letters a
    line at least; the icon precedes the first line."""
    # Background mode has no region and no interface scale.
    width = 0 if context.region is None else context.region.width
    # About 7 pixels a letter, and 8 letters for margins and icon.
    letters = int(width / (7.0 * (context.preferences.system.ui_scale or 1.0))) - 8 - reserved
    draw_wrapped(layout.column(align=True), text, max(letters, 20), icon)


def filtered(
    rows: bpy.types.UIList, shown: Iterable[tuple[str, bool]]
) -> tuple[list[int], list[int]]:
    """Result of ``filter_items``: flags of a list's rows, without a new order.

    ``shown`` has the searched text of each row, and whether it is shown without a search. A search
    for part of the text, in any case, includes rows that are hidden otherwise.
    """
    pattern = rows.filter_name.lower()
    flags = [pattern in text.lower() if pattern else is_shown for text, is_shown in shown]
    return [rows.bitflag_filter_item if is_shown else 0 for is_shown in flags], []


class PictureIcons:
    """Icon numbers of picture files, which are loaded when first drawn, and held until `free`."""

    def __init__(self) -> None:
        self._previews: Any = None  # Blender's collection, once a picture was drawn

    def number_of(self, picture: Path, *, only_folder: bool = False) -> int:
        """Icon number of a picture; ``only_folder`` frees loaded pictures of other folders."""
        if self._previews is None:
            self._previews = bpy.utils.previews.new()
        name = str(picture)
        if name not in self._previews:
            for loaded in list(self._previews) if only_folder else ():
                if Path(loaded).parent != picture.parent:
                    del self._previews[loaded]
            preview_image = self._previews.load(name, name, "IMAGE")
            preview_image.image_size[:]  # forces loading: a later load would not redraw the panel
        return int(self._previews[name].icon_id)

    def free(self) -> None:
        """Free all pictures; a later call of `number_of` loads again."""
        if self._previews is not None:
            bpy.utils.previews.remove(self._previews)
            self._previews = None
