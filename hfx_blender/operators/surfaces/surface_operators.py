# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of haptic surfaces: maps, images, scans, relief from a picture, calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, StringProperty

from ...authoring.surfaces import material_relief, surfaces
from ...blender.translation import translated
from ...errors import InputError
from ...files import kinds
from ...properties.surface_properties import IMAGE_KINDS, SOURCES
from ...text import printable
from ..shared import ON_MESH, FileOperator, HfxOperator, ModalTimer

if TYPE_CHECKING:
    from ...authoring.surfaces.generated_surfaces import ReliefEstimation


def active_surface(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active object with a haptic surface; otherwise None."""
    return context.object if surfaces.is_surface(context.object) else None


def _made(operator: bpy.types.Operator, obj: bpy.types.Object) -> str:
    """Make the maps of an object's surface, and report a warning, if any; returns notes."""
    note = surfaces.make_maps(obj)
    if obj.hfx.surface.warning:
        text = f"'{obj.name}': {obj.hfx.surface.warning}."
        operator.report({"WARNING"}, translated(printable(text)))
    return note


ON_SURFACE = active_surface, "Select an object with a haptic surface"


class SurfaceOperator(HfxOperator):
    requires = (ON_SURFACE,)


class HFX_OT_add_surface(HfxOperator):
    """Add a haptic surface to the active object, and bake the maps"""

    bl_label = "Haptic Surface"

    source: EnumProperty(name="Source", description="Source of the relief", items=SOURCES[:-2])
    procedural: StringProperty(
        name="Library Material",
        description="Material, for the source Library",
        options={"SKIP_SAVE"},
    )
    requires = (ON_MESH,)

    def work(self, context: bpy.types.Context) -> str:
        obj = context.object
        surfaces.add_surface(obj, self.source)
        if self.procedural:
            obj.hfx.surface.procedural = self.procedural
        if self.source in ("IMAGE", "SCAN"):
            return f"'{obj.name}' needs {'an image' if self.source == 'IMAGE' else 'a scan'} now"
        try:
            return _made(self, obj)
        except InputError as error:
            # The surface is kept: the user can correct the error.
            self.report({"WARNING"}, translated(str(error)))
            return ""


class HFX_OT_remove_surface(SurfaceOperator):
    """Remove the haptic surface of the active object, with all maps"""

    bl_label = "Remove Surface"

    def work(self, context: bpy.types.Context) -> None:
        surfaces.remove_surface(context.object)


class HFX_OT_bake_surface(SurfaceOperator):
    """Bake the maps again from the current material, image or scan"""

    bl_label = "Make Maps"

    def work(self, context: bpy.types.Context) -> str:
        return _made(self, context.object)


class SurfaceFileOperator(FileOperator):
    requires = (ON_SURFACE,)


class HFX_OT_load_surface_image(SurfaceFileOperator):
    """Take an image of heights, or a photograph, as the surface"""

    bl_label = "Load Image"

    kind: EnumProperty(
        name="Image Holds", description="Meaning of the image's pixels", items=IMAGE_KINDS[:2]
    )
    filter_image: BoolProperty(default=True, options={"HIDDEN"})
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.surfaces import image_values

        settings = context.object.hfx.surface
        image = image_values.load(str(self.path()))
        if self.kind == "HEIGHT":
            image.colorspace_settings.is_data = True
            image.reload()  # the colour space applies on loading only
        settings.source, settings.image, settings.image_kind = "IMAGE", image, self.kind
        return _made(self, context.object)


class HFX_OT_load_scan(SurfaceFileOperator):
    """Take a scanned piece (PLY, XYZ, 16-bit picture) as the surface"""

    bl_label = "Load Scan"

    unit_mm: FloatProperty(
        name="Unit (mm)", description="Of a point cloud's numbers", default=1.0, min=1e-6
    )
    filter_glob: StringProperty(
        default="*.ply;*.xyz;*.txt;*.asc;*.csv;*.png;*.exr;*.tif;*.tiff", options={"HIDDEN"}
    )

    def work(self, context: bpy.types.Context) -> str:
        settings = context.object.hfx.surface
        settings.source, settings.scan_path = "SCAN", str(self.path())
        settings.scan_unit_mm = self.unit_mm
        return _made(self, context.object)


class HFX_OT_export_texture(SurfaceFileOperator):
    """Write the haptic map: two grey PNGs and a JSON of scale, ranges and steps"""

    bl_label = "Export Map"
    bl_options = {"REGISTER"}

    bits: EnumProperty(
        name="Depth",
        description="Of a pixel of the pictures",
        items=(
            ("16", "16 Bit", "Fine steps, for rendering"),
            ("8", "8 Bit", "Small files, for tools that read only 8 bits"),
        ),
    )
    filter_glob: StringProperty(default=f"*{kinds.TEXTURE_MAP_SUFFIX}", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ...formats.pictures import texture_map

        if not self.filepath:
            self.filepath = bpy.path.clean_name(context.object.name) + texture_map.SUFFIX
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str:
        from ...formats.pictures import texture_map

        path, texture = self.path(), surfaces.map_of(context.object)
        stem = path.with_name(path.name.removesuffix(texture_map.SUFFIX))
        bits = 8 if self.bits == "8" else 16
        written = texture_map.write(texture, stem, bits, context.object.name)
        return f"Wrote {', '.join(file.name for file in written.files)}"


class HFX_OT_import_texture(SurfaceFileOperator):
    """Use a haptic map, given by its JSON file, as the surface"""

    bl_label = "Import Map"

    filter_glob: StringProperty(default=f"*{kinds.TEXTURE_MAP_SUFFIX}", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        from ...formats.pictures import texture_map

        path = self.path()
        surfaces.store_map(context.object, texture_map.read(path), f"imported from {path.name}")
        return f"Imported {path.name}"


class HFX_OT_feel_fabric(HfxOperator):
    """Feel and hear two seconds of a stroke over the chosen reference fabric"""

    bl_label = "Feel It"
    bl_options = {"REGISTER"}

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.texture.haptic_map import DeviceRange
        from ...engine.texture.stroke import FAST_M_S, SLOW_M_S
        from ...playback import stroke_pad

        chosen = context.window_manager.hfx_surface_calibration
        speed = SLOW_M_S if chosen.speed == "SLOW" else FAST_M_S
        signal = stroke_pad.reference_signal(chosen.fabric, speed, chosen.drive * 1000.0)
        full = float(DeviceRange().amplitude_m_s2(1.0))
        stroke_pad.reference_stroke.play(signal, full)
        return f"{signal.amplitude_m_s2.mean() / full:.0%} of full strength"


_PAUSE_S = 0.1


def _picture_of(obj: bpy.types.Object | None) -> bpy.types.Image | None:
    """Only image of the base colour of an object's active material; otherwise None."""
    material = obj.active_material if obj is not None and obj.type == "MESH" else None
    if material is None or material.node_tree is None:
        return None
    return material_relief.colour_image_of(material)


class HFX_OT_estimate_relief(ModalTimer, HfxOperator):
    """Estimate relief and roughness from the picture of the material's base colour

    A photograph does not tell all: colours can be mistaken for relief. Esc cancels
    """

    bl_label = "Relief from Picture"

    size_mm: FloatVectorProperty(
        name="Size (mm)",
        description="Width and height of the pictured area",
        size=2,
        min=1e-3,
        max=1e6,
        default=(100.0, 100.0),
    )
    tiles: BoolProperty(name="Tiles", description="The picture repeats seamlessly", default=True)

    # No annotations, of which Blender would make properties.
    _is_invoked = False
    estimation = None
    _owner = ""

    requires = (
        (
            lambda context: _picture_of(context.object),
            "Select a mesh whose material has a picture as its base colour",
        ),
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        from ...authoring.surfaces import surface_uv

        self._is_invoked = True
        if not self.properties.is_property_set("size_mm"):
            try:
                self.size_mm = surface_uv.tile_mm(context.object)
            except InputError:
                pass  # no UV map: the user enters the size
        return context.window_manager.invoke_props_dialog(self)  # type: ignore[no-any-return]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Estimate at once for a script, or start the modal estimation after the dialog.

        Reports an error of the start and returns CANCELLED.
        """
        if not self._is_invoked or bpy.app.background:
            return super().execute(context)
        begun = self.reported(lambda: self.begin(context))
        return {"RUNNING_MODAL"} if begun == {"FINISHED"} else begun

    def begin(self, context: bpy.types.Context) -> None:
        """Start process and timer; the result is for the object that is active now."""
        self.estimation = self._started(context)
        # By name: an undo while the process runs invalidates references.
        self._owner = context.object.name
        self.start_modal(context, _PAUSE_S)
        context.workspace.status_text_set(translated("Estimating the relief. Esc: cancel"))

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.surfaces import generated_surfaces

        return generated_surfaces.apply_estimate(context.object, self._started(context))

    def _started(self, context: bpy.types.Context) -> ReliefEstimation:
        from ...authoring.surfaces.generated_surfaces import ReliefEstimation

        return ReliefEstimation(_picture_of(context.object), tuple(self.size_mm), self.tiles)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Apply the result once the process has ended; Esc cancels; other input passes through."""
        assert self.estimation is not None
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, translated("Cancelled: the surface was not changed"))
            return {"CANCELLED"}
        if event.type != "TIMER" or self.estimation.is_running:
            return {"PASS_THROUGH"}
        # Taken out first: `cancel` would stop the process and discard its result.
        estimation, self.estimation = self.estimation, None
        self.cancel(context)

        def apply() -> str:
            from ...authoring.surfaces import generated_surfaces

            obj = context.scene.objects.get(self._owner)
            if obj is None:  # deleted or renamed in the meantime
                estimation.stop()
                raise InputError(
                    f"'{self._owner}' was deleted or renamed: its relief was not made."
                )
            return generated_surfaces.apply_estimate(obj, estimation)

        return self.reported(apply)

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop a running estimation without a result; remove timer and status text."""
        if self.estimation is not None:
            self.estimation.stop()
            self.estimation = None
        self.stop_timer(context)
